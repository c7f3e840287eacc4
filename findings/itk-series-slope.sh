#!/usr/bin/env bash
# ITK cuts off fractions of a DICOM series when only its first slice has a whole rescale slope.
#
# Versions: SimpleITK 2.5.7 (ITK 5.4.8), pydicom 3.0.2.
# Expected: each slice is scaled by its own slope, as PET needs it, in a type that holds all of them.
# Seen: each slice is scaled by its own slope, but the type is that of the first file.
#     With slopes 1 and 4.5 the type is uint16, and 4.5 becomes 4. With slopes 4.5 and 1 the type is float64.
#     Nothing is reported.
# Why it matters: values of the other slices are wrong by up to 1. Where all values are small, little is left.
# Work with it: pass `outputPixelType=SimpleITK.sitkFloat64` to `ReadImage`, or read each slice by pydicom.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check \
    SimpleITK==2.5.7 pydicom==3.0.2 numpy==2.4.6
venv/bin/python - <<'EOF'
import sys

import numpy as np
import pydicom
import SimpleITK as sitk


def check(what, seen, noted):
    print(f"{what}: {seen}")
    if seen != noted:
        sys.exit(f"The behaviour changed. Noted was: {noted}")


def dicom(name, stored, slope, intercept, z=0):
    data = pydicom.Dataset()
    data.file_meta = pydicom.dataset.FileMetaDataset()
    data.file_meta.TransferSyntaxUID = pydicom.uid.ExplicitVRLittleEndian
    data.SOPClassUID = data.file_meta.MediaStorageSOPClassUID = "1.2.840.10008.5.1.4.1.1.128"
    data.SOPInstanceUID = data.file_meta.MediaStorageSOPInstanceUID = f"1.2.3.4.{z + 1}"
    data.StudyInstanceUID, data.SeriesInstanceUID = "1.2.3", "1.2.3.4"
    data.Modality, data.InstanceNumber = "PT", z + 1
    data.Rows, data.Columns = stored.shape
    data.SamplesPerPixel, data.PhotometricInterpretation = 1, "MONOCHROME2"
    data.BitsAllocated, data.BitsStored, data.HighBit, data.PixelRepresentation = 16, 16, 15, 0
    data.PixelSpacing, data.ImagePositionPatient = [1, 1], [0, 0, z]
    data.ImageOrientationPatient = [1, 0, 0, 0, 1, 0]
    data.RescaleSlope, data.RescaleIntercept = slope, intercept
    data.PixelData = stored.astype("<u2").tobytes()
    data["PixelData"].VR = "OW"
    data.save_as(name, enforce_file_format=True)


def read(slopes, **options):
    for z, slope in enumerate(slopes):
        dicom(f"{z}.dcm", np.array([[1, 2, 3], [1, 2, 3]]), slope, 0, z)
    image = sitk.ReadImage(["0.dcm", "1.dcm"], **options)
    return image.GetPixelIDTypeAsString(), sitk.GetArrayFromImage(image)[:, 0].tolist()


whole = [1, 2, 3]
scaled = [4.5, 9.0, 13.5]
check("slopes 1 and 4.5", read([1, 4.5]), ("16-bit unsigned integer", [whole, [4, 9, 13]]))
check("slopes 4.5 and 1", read([4.5, 1]), ("64-bit float", [scaled, whole]))
right = read([1, 4.5], outputPixelType=sitk.sitkFloat64)
check("slopes 1 and 4.5, as float64", right, ("64-bit float", [whole, scaled]))
EOF
