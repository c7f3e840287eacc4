#!/usr/bin/env bash
# VTK shows the upper half of a TIFF picture twice and loses the lower half.
#
# Versions: VTK 9.7.2, Pillow 13.0.0.
# Expected: a TIFF of single bits, or of colours in JPEG, is read as it is.
#     The documentation promises nearly every TIFF file.
# Seen: the lower half is the upper half mirrored. The picture below has ones on its diagonal; VTK returns a V.
#     It has four numbers per pixel (red, green, blue, opacity). Nothing is reported.
#     Files that VTK decodes itself, for example grey values of 8 or 16 bits in strips, are right.
# Why it matters: masks and label slices are often TIFF of single bits. Half of each slice is wrong.
# Work with it: write masks as 8 bits. Read bits by another library and hand the array to VTK.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check \
    vtk==9.7.2 pillow==13.0.0 numpy==2.4.6
venv/bin/python - <<'EOF'
import sys

import numpy as np
import vtk
from PIL import Image
from vtk.util.numpy_support import vtk_to_numpy


def check(what, seen, noted):
    print(f"{what}: {seen}")
    if seen != noted:
        sys.exit(f"The behaviour changed. Noted was: {noted}")


def read(name):
    reader = vtk.vtkTIFFReader()
    reader.SetFileName(name)
    reader.Update()
    image = reader.GetOutput()
    width, height, _ = image.GetDimensions()
    return vtk_to_numpy(image.GetPointData().GetScalars()).reshape(height, width, -1)


diagonal = np.eye(6, dtype=bool)
v_shape = np.concatenate([diagonal[:3], diagonal[2::-1]])
Image.fromarray(diagonal).save("bits.tif")
bits = read("bits.tif")
check("bits, components", bits.shape[2], 4)
print((bits[:, :, 0] > 0).astype(int))
check("bits, diagonal", bool(((bits[:, :, 0] > 0) == diagonal).all()), False)
check("bits, upper half twice", bool(((bits[:, :, 0] > 0) == v_shape).all()), True)

ramp = np.repeat(np.arange(0, 240, 5, dtype="uint8"), 48).reshape(48, 48)
Image.fromarray(np.stack([ramp] * 3, 2)).save("colours.tif", compression="jpeg")
rows = read("colours.tif")[:, 24, 0].astype(int)
print("JPEG colours, a column:", rows.tolist())
check("JPEG colours, upper half right", bool((abs(rows - ramp[:, 24])[:24] < 6).all()), True)
check("JPEG colours, lower half mirrored", bool((rows == rows[::-1]).all()), True)

Image.fromarray(diagonal.astype("uint8")).save("bytes.tif")
check("8 bits, diagonal", bool((read("bytes.tif")[:, :, 0] == diagonal).all()), True)
EOF
