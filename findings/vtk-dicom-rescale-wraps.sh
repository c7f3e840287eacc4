#!/usr/bin/env bash
# VTK wraps DICOM values around when an integer rescale leaves the range of 16 bits.
#
# Versions: VTK 9.7.2, SimpleITK 2.5.7, pydicom 3.0.2.
# Expected: values after rescale slope and intercept are right; the type is chosen so that they fit.
# Seen: vtkDICOMImageReader returns 16 bits whenever slope and intercept are whole numbers.
#     60000 - 1024 becomes -6560, and 60000 * 2 becomes 54464. Nothing is reported.
#     A fractional slope gives float32 and right values. SimpleITK reads both files right.
# Why it matters: the densest parts turn dark in volumes that use all 16 bits, for example of industrial CT.
# Work with it: read such series by ITK or pydicom.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check \
    vtk==9.7.2 SimpleITK==2.5.7 pydicom==3.0.2 numpy==2.4.6
venv/bin/python - <<'EOF'
import sys

import numpy as np
import pydicom
import SimpleITK as sitk
import vtk
from vtk.util.numpy_support import vtk_to_numpy


def check(what, seen, noted):
    print(f"{what}: {seen}")
    if seen != noted:
        sys.exit(f"The behaviour changed. Noted was: {noted}")


def dicom(name, stored, slope, intercept, z=0):
    data = pydicom.Dataset()
    data.file_meta = pydicom.dataset.FileMetaDataset()
    data.file_meta.TransferSyntaxUID = pydicom.uid.ExplicitVRLittleEndian
    data.SOPClassUID = data.file_meta.MediaStorageSOPClassUID = "1.2.840.10008.5.1.4.1.1.2"
    data.SOPInstanceUID = data.file_meta.MediaStorageSOPInstanceUID = f"1.2.3.4.{z + 1}"
    data.StudyInstanceUID, data.SeriesInstanceUID = "1.2.3", "1.2.3.4"
    data.Modality, data.InstanceNumber = "CT", z + 1
    data.Rows, data.Columns = stored.shape
    data.SamplesPerPixel, data.PhotometricInterpretation = 1, "MONOCHROME2"
    data.BitsAllocated, data.BitsStored, data.HighBit, data.PixelRepresentation = 16, 16, 15, 0
    data.PixelSpacing, data.ImagePositionPatient = [1, 1], [0, 0, z]
    data.ImageOrientationPatient = [1, 0, 0, 0, 1, 0]
    data.RescaleSlope, data.RescaleIntercept = slope, intercept
    data.PixelData = stored.astype("<u2").tobytes()
    data["PixelData"].VR = "OW"
    data.save_as(name, enforce_file_format=True)


def by_vtk(name):
    reader = vtk.vtkDICOMImageReader()
    reader.SetFileName(name)
    reader.Update()
    found = vtk_to_numpy(reader.GetOutput().GetPointData().GetScalars())
    return str(found.dtype), found.tolist()


stored = np.array([[1, 2000, 60000]])
for slope, intercept, noted in [
    (1, -1024, ("int16", [-1023, 976, -6560])),
    (2, 0, ("uint16", [2, 4000, 54464])),
    (0.5, 0, ("float32", [0.5, 1000.0, 30000.0])),
]:
    dicom("slice.dcm", stored, slope, intercept)
    right = (stored * slope + intercept).ravel().tolist()
    check(f"slope {slope}, intercept {intercept}, by VTK", by_vtk("slice.dcm"), noted)
    check("    by SimpleITK", sitk.GetArrayFromImage(sitk.ReadImage("slice.dcm")).ravel().tolist(), right)
EOF
