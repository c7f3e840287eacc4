"""Makes FOLDER/colours-rgb.dcm: red, green and blue of 24 x 16 pixels (40 + 5 x, 50 + 6 y, 200 - 3 x - 2 y) by JPEG that is said to be RGB, and is."""
import sys

import imagecodecs
import numpy as np
from pydicom.dataset import Dataset, FileMetaDataset
from pydicom.encaps import encapsulate
from pydicom.uid import JPEGBaseline8Bit, SecondaryCaptureImageStorage

y, x = np.mgrid[0:16, 0:24]
colours = np.stack([40 + 5 * x, 50 + 6 * y, 200 - 3 * x - 2 * y], axis=-1).astype("u1")
data = Dataset()
data.file_meta = FileMetaDataset()
data.file_meta.TransferSyntaxUID, data.file_meta.MediaStorageSOPClassUID = JPEGBaseline8Bit, SecondaryCaptureImageStorage
data.file_meta.MediaStorageSOPInstanceUID = data.SOPInstanceUID = "1.2.3.4"
data.SOPClassUID, data.Modality, data.SeriesInstanceUID, data.StudyInstanceUID = SecondaryCaptureImageStorage, "OT", "1.2.3", "1.2"
data.Rows, data.Columns, data.SamplesPerPixel, data.PhotometricInterpretation, data.PlanarConfiguration = 16, 24, 3, "RGB", 0
data.BitsAllocated, data.BitsStored, data.HighBit, data.PixelRepresentation = 8, 8, 7, 0
data.PixelData = encapsulate([imagecodecs.jpeg8_encode(colours, level=95, colorspace="RGB", outcolorspace="RGB")])
data["PixelData"].VR = "OB"
data.save_as(f"{sys.argv[1]}/colours-rgb.dcm", enforce_file_format=True)
