#!/usr/bin/env bash
# ITK stores the direction matrix transposed in its HDF5 files.
#
# Versions: SimpleITK 2.5.7 (ITK 5.4.8), h5py 3.16.0.
# Expected: the data set `Directions` is the matrix that `GetDirection()` gives: its columns are the axes of the voxels.
# Seen: its rows are the axes. ITK transposes again when it reads, so that ITK alone does not notice.
# Why it matters: a program that takes the matrix as it stands turns an oblique scan the wrong way.
#     A matrix that only flips axes is symmetric and hides the mistake.
# Work with it: row i of `Directions` is the direction of voxel axis i. `Spacing`, `Origin` and `Dimension` are x, y, z.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check \
    SimpleITK==2.5.7 h5py==3.16.0 numpy==2.4.6
venv/bin/python - <<'EOF'
import sys

import h5py
import numpy as np
import SimpleITK as sitk


def check(what, seen, noted):
    print(f"{what}: {seen}")
    if seen != noted:
        sys.exit(f"The behaviour changed. Noted was: {noted}")


c, s = np.cos(np.radians(30)), np.sin(np.radians(30))
matrix = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
image = sitk.GetImageFromArray(np.zeros((2, 3, 4), "int16"))
image.SetDirection(matrix.ravel().tolist())
sitk.WriteImage(image, "turned.h5")

check("ITK reads its file right", np.allclose(sitk.ReadImage("turned.h5").GetDirection(), matrix.ravel()), True)
with h5py.File("turned.h5") as file:
    stored = file["ITKImage/0/Directions"][()]
print("GetDirection()", matrix.round(3).tolist())
print("Directions    ", stored.round(3).tolist())
check("equal", np.allclose(stored, matrix), False)
check("equal when transposed", np.allclose(stored, matrix.T), True)
EOF
