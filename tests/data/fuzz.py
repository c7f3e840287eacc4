"""Makes the files in FOLDER that the fuzzing of small readers begins with: archives of NumPy and Zarr, pictures, a TIFF of half floats, the HDF5
file of a BigDataViewer."""
import io
import struct
import sys
import zipfile
import zlib

import h5py
import numpy as np

folder = sys.argv[1]
ramp = np.arange(24).reshape(2, 3, 4)
np.savez(f"{folder}/stored.npz", v=ramp.astype("<f2"))
np.savez_compressed(f"{folder}/deflated.npz", v=ramp.astype("<i2"))

# Zarr 2 with half floats, gzip and one chunk of four missing; Zarr 3 with a shard; each as an archive.
array = '{"zarr_format":2,"shape":[2,3,4],"chunks":[2,3,2],"dtype":"<f2","compressor":{"id":"zlib","level":1},"fill_value":1.5,' \
        '"order":"C","filters":null,"dimension_separator":"."}'
shard = '{"zarr_format":3,"node_type":"array","shape":[2,3,4],"data_type":"int16","chunk_grid":{"name":"regular","configuration":' \
        '{"chunk_shape":[2,3,4]}},"chunk_key_encoding":{"name":"default","configuration":{"separator":"/"}},"fill_value":7,"codecs":' \
        '[{"name":"sharding_indexed","configuration":{"chunk_shape":[2,3,2],"codecs":[{"name":"bytes","configuration":{"endian":' \
        '"little"}}],"index_codecs":[{"name":"bytes","configuration":{"endian":"little"}}],"index_location":"end"}}]}'
half = ramp[:, :, :2].astype("<i2").tobytes()
index = struct.pack("<4Q", 0, len(half), 2**64 - 1, 2**64 - 1)
entries = {
    "stored.zarr.zip": {".zarray": array.encode(), "0.0.0": zlib.compress(ramp[:, :, :2].astype("<f2").tobytes())},
    "deflated.zarr.zip": {"a/zarr.json": shard.encode(), "a/c/0/0/0": half + index},
}
for name, files in entries.items():
    method = zipfile.ZIP_DEFLATED if name.startswith("deflated") else zipfile.ZIP_STORED
    with zipfile.ZipFile(f"{folder}/{name}", "w", method) as out:
        for entry, data in files.items():
            out.writestr(zipfile.ZipInfo(entry, (2026, 1, 1, 0, 0, 0)), data, method)


def png(width, height, bits, rows):
    """A grey PNG of these rows."""
    def part(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    head = struct.pack(">IIBBBBB", width, height, bits, 0, 0, 0, 0)
    body = zlib.compress(b"".join(b"\0" + row for row in rows))
    return b"\x89PNG\r\n\x1a\n" + part(b"IHDR", head) + part(b"IDAT", body) + part(b"IEND", b"")


with open(f"{folder}/grey.png", "wb") as out:
    out.write(png(4, 3, 16, [row.astype(">u2").tobytes() for row in ramp[0] * 2700]))

# One page of half floats, in two strips with a gap between.
strips = [np.arange(n, n + 8).astype("<f2").tobytes() for n in (1, 9)]
fields = [(256, 4, 1, 4), (257, 4, 1, 4), (258, 3, 1, 16), (259, 3, 1, 1), (262, 3, 1, 1), (273, 4, 2, 44), (277, 3, 1, 1), (278, 4, 1, 2),
          (279, 4, 2, 52), (339, 3, 1, 3)]
body = strips[0] + b"\0\0\0\0" + strips[1]
table = struct.pack("<4I", 8, 28, 16, 16)
directory = struct.pack("<H", len(fields)) + b"".join(struct.pack("<HHII", *field) for field in fields) + b"\0\0\0\0"
with open(f"{folder}/half.tif", "wb") as out:
    out.write(b"II*\0" + struct.pack("<I", 8 + len(body) + len(table)) + body + table + directory)

with h5py.File(f"{folder}/viewer.h5", "w", libver="earliest") as file:
    file.create_dataset("t00000/s00/0/cells", data=ramp.astype("<i2"))
    file.create_dataset("s00/resolutions", data=np.array([[1, 1, 1.0]]))
