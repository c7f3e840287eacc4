"""Makes the files in FOLDER that test TIFF by JPEG and zstd, with tifffile, imagecodecs and, for tables that chunks share, Pillow's libtiff.

Grey is 2 x + 3 y + 10 z; red, green and blue are 40 + 2 x, 50 + 3 y and 200 - x - y; what zstd holds is (3 x + 5 y + 7 z + x y z) modulo 251,
times 199 where there are 16 bits, over 7 where there are floats."""
import sys

import numpy as np
import tifffile
from PIL import Image

folder = sys.argv[1]
z, y, x = np.meshgrid(np.arange(3), np.arange(36), np.arange(40), indexing="ij")
grey = (2 * x + 3 * y + 10 * z).astype("u1")
colour = np.stack([40 + 2 * x, 50 + 3 * y, 200 - x - y], axis=-1).astype("u1")
exact = (3 * x + 5 * y + 7 * z + x * y * z) % 251


def write(name, voxels, photometric="minisblack", **how):
    tifffile.imwrite(f"{folder}/{name}.tif", voxels, photometric=photometric, metadata=None, software=False, **how)


jpeg = {"compression": "jpeg", "compressionargs": {"level": 95}}
write("jpeg-grey-strips", grey, rowsperstrip=16, **jpeg)
write("jpeg-grey-tiles", grey, tile=(32, 16), **jpeg)
for name, subsampling, how in [("tiles", "444", {"tile": (32, 32)}), ("strips", "420", {"rowsperstrip": 16})]:
    write(f"jpeg-ycbcr-{name}", colour[0], "rgb", compression="jpeg", compressionargs={"level": 95, "subsampling": subsampling}, **how)
pages = [Image.fromarray(page) for page in grey]
pages[0].save(f"{folder}/jpeg-tables-grey.tif", compression="jpeg", quality=95, save_all=True, append_images=pages[1:])
Image.fromarray(colour[0]).save(f"{folder}/jpeg-tables-rgb.tif", compression="jpeg", quality=95)

zstd = {"compression": "zstd"}
write("zstd-u8-strips", exact.astype("u1"), rowsperstrip=16, **zstd)
write("zstd-u16-tiles-predictor", (199 * exact).astype("u2"), tile=(16, 32), predictor=True, **zstd)
write("zstd-u16-big-endian", (199 * exact).astype(">u2"), rowsperstrip=7, byteorder=">", **zstd)
write("zstd-u16-big-endian-predictor", (199 * exact).astype(">u2"), rowsperstrip=7, byteorder=">", predictor=True, **zstd)
write("zstd-f32-tiles-predictor", (exact / 7).astype("f4"), tile=(16, 16), predictor=True, **zstd)
write("zstd-white-is-zero", exact.astype("u1"), "miniswhite", rowsperstrip=16, **zstd)
write("zstd-rgb-predictor", colour[0], "rgb", tile=(16, 16), predictor=True, **zstd)
write("zstd-planes", np.moveaxis(colour[0], -1, 0).copy(), "rgb", planarconfig="separate", tile=(16, 16), **zstd)
# A seed for fuzzing, small enough for every input to be as long.
write("zstd-f32-predictor", (exact[0, :12, :16] / 7).astype("f4"), rowsperstrip=5, predictor=True, **zstd)
