"""Writes the image of FOLDER/binary-64-le.vti anew, its arrays compressed by LZ4 in blocks of 64 bytes, and by LZMA, which is refused."""
import sys

import vtk

reader = vtk.vtkXMLImageDataReader()
reader.SetFileName(f"{sys.argv[1]}/binary-64-le.vti")
reader.Update()
for name, compressor, mode, is_wide, is_big, is_base64 in [
    ("appended-lz4-32-le", vtk.vtkLZ4DataCompressor, "Appended", False, False, False),
    ("appended-b64-lz4-64-be", vtk.vtkLZ4DataCompressor, "Appended", True, True, True),
    ("binary-lz4-64-le", vtk.vtkLZ4DataCompressor, "Binary", True, False, False),
    ("appended-lzma-32-le", vtk.vtkLZMADataCompressor, "Appended", False, False, False),
]:
    writer = vtk.vtkXMLImageDataWriter()
    writer.SetInputConnection(reader.GetOutputPort())
    writer.SetFileName(f"{sys.argv[1]}/{name}.vti")
    writer.SetCompressor(compressor())
    writer.SetBlockSize(64)
    getattr(writer, f"SetDataModeTo{mode}")()
    (writer.SetHeaderTypeToUInt64 if is_wide else writer.SetHeaderTypeToUInt32)()
    (writer.SetByteOrderToBigEndian if is_big else writer.SetByteOrderToLittleEndian)()
    writer.SetEncodeAppendedData(is_base64)
    assert writer.Write()
