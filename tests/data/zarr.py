"""Makes FOLDER and FOLDER.zip, which is `zarr.zip`: one volume in every way in which zarr-python, numcodecs and tensorstore write it."""
import json, os, shutil, sys, zipfile
import numcodecs, numpy as np, tensorstore, zarr
from zarr.codecs import BloscCodec, BytesCodec, Crc32cCodec, GzipCodec, ShardingCodec, TransposeCodec, ZstdCodec

root = sys.argv[1]
shutil.rmtree(root, ignore_errors=True)
z, y, x = np.mgrid[0:18, 0:20, 0:24]
volume = 3 * x + 5 * y + 7 * z + x * y * z % 11
chunks = (9, 20, 16)

def v2(name, dtype="<u2", chunks=chunks, order="C", data=volume, **options):
    array = zarr.create_array(f"{root}/{name}", shape=data.shape, chunks=chunks, dtype=dtype, zarr_format=2, order=order, **options)
    array[...] = data.astype(dtype)
    return array

for cname in ["blosclz", "lz4", "lz4hc", "zlib", "zstd"]:
    for shuffle in [0, 1, 2]:
        v2(f"v2/{cname}-{shuffle}", compressors=numcodecs.Blosc(cname, 5, shuffle))
v2("v2/blosc-blocks", "<f4", compressors=numcodecs.Blosc("blosclz", 9, 1, blocksize=1024))
v2("v2/blosc-f8", "<f8", compressors=numcodecs.Blosc("lz4", 5, 2, blocksize=2048))
v2("v2/blosc-i8", "<i8", compressors=numcodecs.Blosc("zstd", 5, 2))
v2("v2/blosc-odd", ">i4", chunks=(5, 7, 9), compressors=numcodecs.Blosc("zlib", 5, 2))
v2("v2/gzip", ">u2", compressors=numcodecs.GZip(5))
v2("v2/zlib", "<f4", compressors=numcodecs.Zlib(5))
v2("v2/zstd", "<i2", compressors=numcodecs.Zstd(5), order="F")
v2("v2/lz4", "<i4", compressors=numcodecs.LZ4())
v2("v2/raw", "<u4", compressors=None, chunk_key_encoding={"name": "v2", "separator": "/"})
v2("v2/shuffle-zlib", "<u2", filters=[numcodecs.Shuffle(2)], compressors=numcodecs.Zlib(5))
v2("v2/bool", "|b1", data=volume % 2 == 1, compressors=numcodecs.Zstd(1))
hole = v2("v2/holes", "<i2", fill_value=-7, compressors=numcodecs.Zstd(1))
os.remove(f"{root}/v2/holes/1.0.1")

def v3(name, dtype="uint16", chunks=chunks, data=volume, **options):
    array = zarr.create_array(f"{root}/{name}", shape=data.shape, chunks=chunks, dtype=dtype, zarr_format=3, **options)
    array[...] = data.astype(dtype)

v3("v3/zstd", compressors=ZstdCodec(level=3))
v3("v3/gzip", "float32", compressors=GzipCodec(level=5), serializer=BytesCodec(endian="big"))
v3("v3/blosc", "int32", compressors=BloscCodec(cname="lz4", shuffle="bitshuffle", typesize=4))
v3("v3/checksum", "int16", compressors=[ZstdCodec(level=1), Crc32cCodec()])
v3("v3/transpose", "float64", filters=TransposeCodec(order=(1, 2, 0)), compressors=ZstdCodec(level=1))
v3("v3/sharded", chunks=(4, 8, 8), shards=(16, 16, 16), compressors=BloscCodec(cname="zstd", shuffle="shuffle", typesize=2))
v3("v3/start", chunks=(16, 16, 16), compressors=None, filters=None,
   serializer=ShardingCodec(chunk_shape=(8, 4, 16), codecs=[TransposeCodec(order=(2, 0, 1)), BytesCodec(), GzipCodec(level=1)],
                            index_location="start"))
v3("v3/keys", compressors=None, chunk_key_encoding={"name": "v2", "separator": "."})
v3("v3/five", "uint8", data=np.stack([np.stack([volume % 200 + c + 10 * t for c in range(3)]) for t in range(2)]),
   chunks=(1, 2, 8, 16, 16), compressors=ZstdCodec(level=3), dimension_names=["t", "c", "z", "y", "x"])

def image(name, version):
    group = zarr.create_group(f"{root}/{name}", zarr_format=2 if version == "0.4" else 3)
    levels = [volume, volume[::2, ::2, ::2]]
    datasets = []
    for i, level in enumerate(levels):
        data = np.stack([level, level + 1000])[None]
        group.create_array(str(i), data=data.astype("u2"), chunks=(1, 1, 8, 16, 16))
        f = 2.0**i
        datasets.append({"path": str(i), "coordinateTransformations": [
            {"type": "scale", "scale": [1.0, 1.0, 2.0 * f, 0.5 * f, 0.25 * f]},
            {"type": "translation", "translation": [0.0, 0.0, f - 1.0, 10.0, 20.0]}]})
    axes = [{"name": "t", "type": "time", "unit": "second"}, {"name": "c", "type": "channel"}]
    axes += [{"name": n, "type": "space", "unit": "micrometer"} for n in "zyx"]
    ms = [{"version": version, "name": "ramp", "axes": axes, "datasets": datasets,
           "coordinateTransformations": [{"type": "scale", "scale": [0.1, 1, 1, 1, 1]}]}]
    group.attrs.update({"multiscales": ms} if version == "0.4" else {"ome": {"version": version, "multiscales": ms}})

image("ome-0.4", "0.4")
image("ome-0.5", "0.5")

def n5(name, dtype, compression, block=(16, 16, 8)):
    spec = {"driver": "n5", "kvstore": {"driver": "file", "path": f"{root}/{name}"},
            "metadata": {"compression": compression, "dataType": dtype, "dimensions": [24, 20, 18], "blockSize": list(block)}}
    store = tensorstore.open(spec, create=True, delete_existing=True).result()
    store[...] = volume.transpose(2, 1, 0).astype(dtype)

n5("n5/gzip/s0", "uint16", {"type": "gzip"})
n5("n5/raw", "float32", {"type": "raw"})
n5("n5/zstd", "int16", {"type": "zstd"}) if True else None
n5("n5/blosc", "int32", {"type": "blosc", "cname": "lz4", "clevel": 5, "shuffle": 1}, (9, 7, 5))
json.dump({"downsamplingFactors": [1, 1, 1], "pixelResolution": {"dimensions": [0.25, 0.5, 2.0], "unit": "micrometer"}}, open(f"{root}/n5/gzip/attributes.json", "w"))

with zipfile.ZipFile(f"{root}.zip", "w", zipfile.ZIP_DEFLATED) as archive:
    for folder, _, files in sorted(os.walk(root)):
        for file in sorted(files):
            path = os.path.join(folder, file)
            archive.writestr(zipfile.ZipInfo(os.path.relpath(path, root)), open(path, "rb").read(), zipfile.ZIP_DEFLATED)
