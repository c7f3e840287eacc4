"""Makes pairs of ANALYZE 7.5 in FOLDER by nibabel: 6 x 5 x 4 voxels of x + 10 y + 100 z, spacing 1, 1.5 and 2.5."""
import sys

import nibabel
import numpy as np

folder = sys.argv[1]
x, y, z = np.meshgrid(np.arange(6), np.arange(5), np.arange(4), indexing="ij")
ramp = x + 10 * y + 100 * z
KINDS = [("i16", nibabel.analyze.AnalyzeImage, "<i2", "<"), ("i16-big-endian", nibabel.analyze.AnalyzeImage, ">i2", ">"),
         ("f32", nibabel.analyze.AnalyzeImage, "<f4", "<"), ("u8-two-frames", nibabel.analyze.AnalyzeImage, "u1", "<"),
         ("scaled", nibabel.spm2analyze.Spm2AnalyzeImage, "<i2", "<")]
for name, kind, dtype, order in KINDS:
    voxels = np.stack([ramp % 256, (ramp + 7) % 256], axis=-1) if "frames" in name else ramp
    header = kind.header_class(endianness=order)
    header.set_data_dtype(np.dtype(dtype))
    header.set_data_shape(voxels.shape)
    header.set_zooms([1, 1.5, 2.5, 1][: voxels.ndim])
    image = kind(voxels.astype(dtype), None, header)
    if name == "scaled":
        # Shares of 0.25, kept as whole numbers.
        header["scl_slope"] = 0.25
        with open(f"{folder}/{name}.hdr", "wb") as out:
            out.write(header.binaryblock)
        with open(f"{folder}/{name}.img", "wb") as out:
            out.write(voxels.astype(dtype).tobytes(order="F"))
        continue
    nibabel.save(image, f"{folder}/{name}.img")
