#!/usr/bin/env bash
# netCDF4 hides the brightest voxels of a volume that names no fill value.
#
# Versions: netCDF4 1.7.5.1.post1, xarray 2026.9.0, h5py 3.16.0.
# Expected: a variable without `_FillValue` and `missing_value` has no missing voxels.
# Seen: netCDF4 masks the values that netCDF uses for voxels never written: 65535 in uint16, -32767 in int16,
#     and 255 in uint8 of a netCDF file. It does so for plain HDF5 by h5py (16 bits), too.
#     `fill_value=False`, which says that nothing is filled, helps for 8 bits and not for 16 bits.
#     xarray reads the same files with all voxels. The documentation mentions default fill values only in passing.
# Why it matters: 65535 and 255 are saturated voxels of CT and microscopy. Means and maxima leave them out.
# Work with it: call `set_auto_mask(False)` on the data set, and apply `_FillValue` where the file has one.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check \
    netCDF4==1.7.5.1.post1 xarray==2026.9.0 h5py==3.16.0 numpy==2.4.6 pandas==3.1.1
venv/bin/python - <<'EOF'
import sys

import h5py
import netCDF4
import numpy as np
import xarray as xr


def check(what, seen, noted):
    print(f"{what}: {seen}")
    if seen != noted:
        sys.exit(f"The behaviour changed. Noted was: {noted}")


extremes = {"u1": 255, "u2": 65535, "i2": -32767}


def write(name, **options):
    with netCDF4.Dataset(name, "w") as file:
        file.createDimension("x", 3)
        for kind, extreme in extremes.items():
            file.createVariable(kind, kind, ("x",), **options)[:] = np.array([1, extreme, 3], kind)


def missing(name, mask=True):
    with netCDF4.Dataset(name) as file:
        file.set_auto_mask(mask)
        return {kind: int(np.ma.count_masked(file[kind][:])) for kind in extremes}


write("volume.nc")
with h5py.File("volume.h5", "w") as file:
    for kind, extreme in extremes.items():
        file[kind] = np.array([1, extreme, 3], kind)
write("unfilled.nc", fill_value=False)

with netCDF4.Dataset("volume.nc") as file:
    check("attributes", [file[kind].ncattrs() for kind in extremes], [[], [], []])
check("missing, netCDF", missing("volume.nc"), {"u1": 1, "u2": 1, "i2": 1})
check("missing, HDF5", missing("volume.h5"), {"u1": 0, "u2": 1, "i2": 1})
check("missing, fill_value=False", missing("unfilled.nc"), {"u1": 0, "u2": 1, "i2": 1})
check("missing, set_auto_mask(False)", missing("volume.nc", mask=False), {"u1": 0, "u2": 0, "i2": 0})
with xr.open_dataset("volume.nc", engine="netcdf4") as data:
    check("by xarray", [data[k].values.tolist() for k in extremes], [[1, v, 3] for v in extremes.values()])
EOF
