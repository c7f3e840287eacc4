#!/usr/bin/env bash
# mrcfile and ITK ignore the header words of MRC maps that say which axis is x, y and z.
#
# Versions: mrcfile 1.5.4, SimpleITK 2.5.7 (ITK 5.4.8), gemmi 0.7.5.
# Expected: where MAPC, MAPR, MAPS are 3, 2, 1, columns run along z and sections along x. Readers turn the array,
#     or say that it is not in the usual order.
# Seen: mrcfile returns the same array for 1, 2, 3 and for 3, 2, 1, and calls the file valid.
#     Its `voxel_size` is that of x, y, z, and so belongs to other axes than `data` suggests. ITK does the same:
#     it gives columns the voxel size of x, which are 3 units apart here. gemmi turns the array.
# Why it matters: crystallography programs write other orders. The map is turned or mirrored, and stretched
#     where voxels are not cubes.
# Work with it: transpose `data` by `header.mapc`, `mapr` and `maps` before using `voxel_size`, or read by gemmi.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check \
    mrcfile==1.5.4 SimpleITK==2.5.7 gemmi==0.7.5 numpy==2.4.6
venv/bin/python - <<'EOF'
import sys

import gemmi
import mrcfile
import numpy as np
import SimpleITK as sitk


def check(what, seen, noted):
    print(f"{what}: {seen}")
    if seen != noted:
        sys.exit(f"The behaviour changed. Noted was: {noted}")


stored = np.arange(24, dtype="float32").reshape(2, 3, 4)  # sections, rows, columns


def write(name, order):
    with mrcfile.new(name) as file:
        file.set_data(stored)
        header = file.header
        header.mapc, header.mapr, header.maps = order
        size = dict(zip(order, stored.shape[::-1]))  # voxels along x (1), y (2), z (3)
        header.mx, header.my, header.mz = (size[axis] for axis in (1, 2, 3))
        header.cella = tuple(size[axis] * float(axis) for axis in (1, 2, 3))  # voxels of 1 x 2 x 3


def by_gemmi(name):
    grid = gemmi.read_ccp4_map(name, setup=True).grid
    return np.array(grid, copy=True).shape


for name, order, shape in [("usual.mrc", (1, 2, 3), (4, 3, 2)), ("turned.mrc", (3, 2, 1), (2, 3, 4))]:
    write(name, order)
    check(f"{order}, valid", mrcfile.validate(name), True)
    with mrcfile.open(name) as file:
        check(f"{order}, mrcfile, same array", bool((file.data == stored).all()), True)
        check(f"{order}, mrcfile, voxel size x, y, z", file.voxel_size.tolist(), (1.0, 2.0, 3.0))
    image = sitk.ReadImage(name)
    check(f"{order}, ITK, size", image.GetSize(), (4, 3, 2))
    check(f"{order}, ITK, spacing", image.GetSpacing(), (1.0, 2.0, 3.0))
    check(f"{order}, gemmi, voxels along x, y, z", by_gemmi(name), shape)
EOF
