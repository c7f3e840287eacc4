#!/usr/bin/env bash
# ITK and VTK read half-precision TIFF as 16-bit integers.
#
# Versions: SimpleITK 2.5.7 (ITK 5.4.8), VTK 9.7.2, tifffile 2026.3.3.
# Expected: the voxels -1, 0, 0.5, 1 are read as these numbers, or the file is refused.
# Seen: both ignore SampleFormat = 3 (floating point) when a sample has 16 bits. They return the bits as uint16:
#     48128, 0, 14336, 15360. Negative numbers become the greatest ones. Nothing is reported.
# Why it matters: half precision saves space, for example for volumes that neural networks put out.
#     The picture looks plausible, because the bits of positive numbers grow with the numbers.
# Work with it: write float32. Values that were read so are right again after a view as float16.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check \
    SimpleITK==2.5.7 vtk==9.7.2 tifffile==2026.3.3 numpy==2.4.6
venv/bin/python - <<'EOF'
import sys

import numpy as np
import SimpleITK as sitk
import tifffile
import vtk
from vtk.util.numpy_support import vtk_to_numpy


def check(what, seen, noted):
    print(f"{what}: {seen}")
    if seen != noted:
        sys.exit(f"The behaviour changed. Noted was: {noted}")


voxels = np.array([[-1, 0, 0.5, 1]], "float16")
tifffile.imwrite("half.tif", voxels)
check("by tifffile", tifffile.imread("half.tif").tolist(), [[-1.0, 0.0, 0.5, 1.0]])

noted = ("uint16", [48128, 0, 14336, 15360])
found = sitk.GetArrayFromImage(sitk.ReadImage("half.tif")).ravel()
check("by SimpleITK", (str(found.dtype), found.tolist()), noted)
check("bits as float16", found.view("float16").tolist(), voxels.ravel().tolist())

reader = vtk.vtkTIFFReader()
reader.SetFileName("half.tif")
reader.Update()
found = vtk_to_numpy(reader.GetOutput().GetPointData().GetScalars())
check("by VTK", (str(found.dtype), found.tolist()), noted)
EOF
