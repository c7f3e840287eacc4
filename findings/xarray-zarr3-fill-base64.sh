#!/usr/bin/env bash
# xarray stores a float `_FillValue` in Zarr 3 as base64 text, and refuses to read it as a number.
#
# Versions: xarray 2026.9.0, zarr 3.1.6.
# Expected: the attribute `_FillValue` is a number, as in CF and in xarray's own Zarr 2 and netCDF files.
# Seen: for float arrays the attribute is text: base64 of the 8 bytes of a little-endian float64, also for float32 data.
#     -9999.25 is written as "AAAAAKCHw8A=". Integers stay numbers. The array's `fill_value` is NaN, not -9999.25.
#     In Zarr 2 the same number is the array's `fill_value`, and the attribute does not exist.
#     xarray raises TypeError when another program has written the number -9999.25 as the attribute.
# Why it matters: a reader that looks for a number finds none, and shows voxels of -9999.25 as data.
# Work with it: when `_FillValue` of a Zarr 3 float array is text, decode base64 and unpack a little-endian float64.
#     To write for xarray, write that text. For integer arrays, write the number.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check \
    xarray==2026.9.0 zarr==3.1.6 numpy==2.4.6 pandas==3.1.1
venv/bin/python - <<'EOF'
import base64
import json
import struct
import sys
from pathlib import Path

import numpy as np
import xarray as xr
import zarr


def check(what, seen, noted):
    print(f"{what}: {seen}")
    if seen != noted:
        sys.exit(f"The behaviour changed. Noted was: {noted}")


data = xr.Dataset({"v": (("y", "x"), np.array([[1.0, np.nan], [2.0, 3.0]]))})


def write(kind, fill, zarr_format):
    encoding = {"v": {"dtype": kind, "_FillValue": fill}}
    data.to_zarr("v.zarr", mode="w", zarr_format=zarr_format, consolidated=False, encoding=encoding)


write("f4", np.float32(-9999.25), 3)
array = json.loads(Path("v.zarr/v/zarr.json").read_text())
text = array["attributes"]["_FillValue"]
check("float32, attribute", text, "AAAAAKCHw8A=")
check("decoded", struct.unpack("<d", base64.b64decode(text))[0], -9999.25)
check("float32, fill_value", array["fill_value"], "NaN")
check("voxels by zarr", zarr.open_array("v.zarr/v", mode="r")[:].tolist(), [[1.0, -9999.25], [2.0, 3.0]])

write("i2", -999, 3)
check("int16, attribute", json.loads(Path("v.zarr/v/zarr.json").read_text())["attributes"]["_FillValue"], -999)

write("f4", np.float32(-9999.25), 2)
check("Zarr 2, fill_value", json.loads(Path("v.zarr/v/.zarray").read_text())["fill_value"], -9999.25)
check("Zarr 2, attribute", "_FillValue" in json.loads(Path("v.zarr/v/.zattrs").read_text()), False)

group = zarr.open_group("other.zarr", mode="w", zarr_format=3)
group.create_array("v", shape=(2,), dtype="f4", dimension_names=["x"], attributes={"_FillValue": -9999.25})
try:
    xr.open_zarr("other.zarr", consolidated=False).load()
    refused = "read"
except TypeError as error:
    refused = type(error).__name__
check("number as attribute, by xarray", refused, "TypeError")
EOF
