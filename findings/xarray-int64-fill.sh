#!/usr/bin/env bash
# xarray merges different 64-bit labels, and drops valid ones, as soon as a variable has `_FillValue`.
#
# Versions: xarray 2026.9.0, netCDF4 1.7.5.1.post1.
# Expected: only voxels that equal `_FillValue` become missing. Other integers stay what they are, or xarray warns.
# Seen: xarray reads an int64 variable with `_FillValue` as float64, without a warning.
#     Three labels that differ by 1 become one label. The numbers are rounded to multiples of 128.
#     With `_FillValue` = -2**63, the next 512 integers become missing, too: the comparison is made in float64.
#     Without `_FillValue`, the same integers are read exactly.
# Why it matters: segment numbers of large label volumes can have 60 bits, and 0 is often their fill value.
# Work with it: open with `mask_and_scale=False` and compare with `_FillValue` as integers.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check \
    xarray==2026.9.0 netCDF4==1.7.5.1.post1 numpy==2.4.6 pandas==3.1.1
venv/bin/python - <<'EOF'
import sys
import warnings

import numpy as np
import xarray as xr


def check(what, seen, noted):
    print(f"{what}: {seen}")
    if seen != noted:
        sys.exit(f"The behaviour changed. Noted was: {noted}")


warnings.simplefilter("error", UserWarning)
warnings.simplefilter("error", RuntimeWarning)


def read(values, fill, name, **options):
    data = xr.Dataset({"v": ("x", np.array(values, "i8"))})
    if fill is not None:
        data.v.attrs["_FillValue"] = np.int64(fill)
    data.to_netcdf(name)
    with xr.open_dataset(name, **options) as opened:
        return opened.v.values


first = 720575940379270001
labels = [0, first, first + 1, first + 2]
merged = read(labels, 0, "labels.nc")
check("type with _FillValue", str(merged.dtype), "float64")
check("missing", np.isnan(merged).tolist(), [True, False, False, False])
check("labels", [int(v) for v in merged[1:]], [720575940379270016] * 3)
check("type without _FillValue", str(read(labels, None, "plain.nc").dtype), "int64")
stored = read(labels, 0, "stored.nc", mask_and_scale=False)
check("labels, mask_and_scale=False", stored.tolist(), labels)

low = -(2**63)
near = read([low, low + 1, low + 512, low + 513], low, "near.nc")
check("missing near -2**63", np.isnan(near).tolist(), [True, True, True, False])
EOF
