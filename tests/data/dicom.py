"""Makes FOLDER/baseline.dcm and FOLDER/lossless-{8,12,16}.dcm: ramps of 24 x 18 pixels (7 x + 5 y, times 1, 16, 250), compressed by GDCM."""
import sys, tempfile
import gdcm, numpy as np
from pydicom.dataset import Dataset, FileMetaDataset
from pydicom.uid import CTImageStorage, ExplicitVRLittleEndian

y, x = np.mgrid[0:18, 0:24]
KINDS = [("baseline", 8, 1, gdcm.TransferSyntax.JPEGBaselineProcess1), ("lossless-8", 8, 1, gdcm.TransferSyntax.JPEGLosslessProcess14_1),
         ("lossless-12", 12, 16, gdcm.TransferSyntax.JPEGLosslessProcess14_1), ("lossless-16", 16, 250, gdcm.TransferSyntax.JPEGLosslessProcess14_1)]
for name, bits, factor, syntax in KINDS:
    data = Dataset()
    data.file_meta = FileMetaDataset()
    data.file_meta.TransferSyntaxUID, data.file_meta.MediaStorageSOPClassUID = ExplicitVRLittleEndian, CTImageStorage
    data.file_meta.MediaStorageSOPInstanceUID = data.SOPInstanceUID = "1.2.3.4"
    data.SOPClassUID, data.Modality, data.SeriesInstanceUID, data.StudyInstanceUID = CTImageStorage, "OT", "1.2.3", "1.2"
    data.Rows, data.Columns, data.SamplesPerPixel, data.PhotometricInterpretation = 18, 24, 1, "MONOCHROME2"
    data.BitsAllocated, data.BitsStored, data.HighBit, data.PixelRepresentation = (8 if bits == 8 else 16), bits, bits - 1, 0
    data.PixelSpacing, data.ImagePositionPatient, data.ImageOrientationPatient = [1, 1], [0, 0, 0], [1, 0, 0, 0, 1, 0]
    data.PixelData = ((7 * x + 5 * y) * factor).astype("u1" if bits == 8 else "<u2").tobytes()
    with tempfile.NamedTemporaryFile(suffix=".dcm") as plain:
        data.save_as(plain.name, enforce_file_format=True)
        reader = gdcm.ImageReader()
        reader.SetFileName(plain.name)
        assert reader.Read()
        change = gdcm.ImageChangeTransferSyntax()
        change.SetTransferSyntax(gdcm.TransferSyntax(syntax))
        change.SetInput(reader.GetImage())
        assert change.Change(), name
        writer = gdcm.ImageWriter()
        writer.SetFileName(f"{sys.argv[1]}/{name}.dcm")
        writer.SetFile(reader.GetFile())
        writer.SetImage(change.GetOutput())
        assert writer.Write()
