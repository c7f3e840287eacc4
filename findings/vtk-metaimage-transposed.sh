#!/usr/bin/env bash
# VTK and ITK turn the same MetaImage file in opposite directions.
#
# Versions: VTK 9.7.2, SimpleITK 2.5.7 (ITK 5.4.8).
# Expected: a volume turned by 30 degrees is turned by 30 degrees in both.
# Seen: ITK lists `TransformMatrix` axis by axis, VTK row by row. Each transposes the matrix of the other's file.
#     Each reads its own file right. Voxels, spacing and origin agree.
# Why it matters: MetaImage is a common way from ITK to VTK. Oblique scans turn the wrong way, without a warning.
#     Axes that are only flipped are right, because their matrix is symmetric.
# Work with it: take each three numbers of `TransformMatrix` as one axis, as ITK does.
#     Transpose the direction matrix after a file has changed sides.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check \
    vtk==9.7.2 SimpleITK==2.5.7 numpy==2.4.6
venv/bin/python - <<'EOF'
import sys

import numpy as np
import SimpleITK as sitk
import vtk


def check(what, seen, noted):
    print(f"{what}: {seen}")
    if seen != noted:
        sys.exit(f"The behaviour changed. Noted was: {noted}")


c, s = np.cos(np.radians(30)), np.sin(np.radians(30))
matrix = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def by_vtk(name):
    reader = vtk.vtkMetaImageReader()
    reader.SetFileName(name)
    reader.Update()
    found = reader.GetOutput().GetDirectionMatrix()
    return np.array([[found.GetElement(i, j) for j in range(3)] for i in range(3)])


def by_itk(name):
    return np.array(sitk.ReadImage(name).GetDirection()).reshape(3, 3)


def compare(found):
    return "same" if np.allclose(found, matrix) else "transposed" if np.allclose(found, matrix.T) else "other"


image = sitk.GetImageFromArray(np.zeros((2, 3, 4), "int16"))
image.SetDirection(matrix.ravel().tolist())
sitk.WriteImage(image, "itk.mha")

image = vtk.vtkImageData()
image.SetDimensions(4, 3, 2)
image.AllocateScalars(vtk.VTK_SHORT, 1)
image.GetPointData().GetScalars().Fill(0)
image.SetDirectionMatrix(*matrix.ravel())
writer = vtk.vtkMetaImageWriter()
writer.SetFileName("vtk.mha")
writer.SetInputData(image)
writer.Write()

check("written by ITK, read by ITK", compare(by_itk("itk.mha")), "same")
check("written by VTK, read by VTK", compare(by_vtk("vtk.mha")), "same")
check("written by ITK, read by VTK", compare(by_vtk("itk.mha")), "transposed")
check("written by VTK, read by ITK", compare(by_itk("vtk.mha")), "transposed")
EOF
