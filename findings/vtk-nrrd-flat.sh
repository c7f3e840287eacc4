#!/usr/bin/env bash
# VTK reads a scalar NRRD volume as a flat picture with many numbers per pixel.
#
# Versions: VTK 9.7.2, SimpleITK 2.5.7, pynrrd 1.1.3.
# Expected: a file with `sizes: 4 3 2` and `kinds: domain domain domain` is a volume of 4 x 3 x 2 voxels.
# Seen: vtkNrrdReader takes the first axis for components: 3 x 2 x 1 pixels of 4 numbers each.
#     The spacings move along with it: 1, 2, 3 becomes 2, 3, 1. Nothing is reported.
#     Files of SimpleITK and of pynrrd, with and without `kinds`, are read so.
# Why it matters: a CT of 512 x 512 x 200 voxels becomes 512 x 200 x 1 pixels of 512 numbers.
# Work with it: the voxels are complete and in the right order. Set the dimensions, the spacing and one component again,
#     or read the file by pynrrd or ITK.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check \
    vtk==9.7.2 SimpleITK==2.5.7 pynrrd==1.1.3 numpy==2.4.6
venv/bin/python - <<'EOF'
import sys

import nrrd
import numpy as np
import SimpleITK as sitk
import vtk
from vtk.util.numpy_support import vtk_to_numpy


def check(what, seen, noted):
    print(f"{what}: {seen}")
    if seen != noted:
        sys.exit(f"The behaviour changed. Noted was: {noted}")


voxels = np.arange(24, dtype="int16").reshape(2, 3, 4)
image = sitk.GetImageFromArray(voxels)
image.SetSpacing((1.0, 2.0, 3.0))
sitk.WriteImage(image, "itk.nrrd")
nrrd.write("pynrrd.nrrd", voxels.T, {"spacings": [1.0, 2.0, 3.0]})

for name in ["itk.nrrd", "pynrrd.nrrd"]:
    reader = vtk.vtkNrrdReader()
    reader.SetFileName(name)
    reader.Update()
    flat = reader.GetOutput()
    check(f"{name}, dimensions", flat.GetDimensions(), (3, 2, 1))
    check(f"{name}, components", flat.GetNumberOfScalarComponents(), 4)
    check(f"{name}, spacing", flat.GetSpacing(), (2.0, 3.0, 1.0))
    stored = vtk_to_numpy(flat.GetPointData().GetScalars()).reshape(2, 3, 4)
    check(f"{name}, voxels in order", bool((stored == voxels).all()), True)
EOF
