#!/usr/bin/env python3
"""Holds what `supervol build` reads, and what `supervol extract` writes, against independent readers.

    readers.py SUPERVOL DATA_FOLDER WORK_FOLDER FORMATS.md

Every file that FORMATS.md says builds is built, extracted as npy, and compared voxel by voxel with what SimpleITK, VTK, pydicom,
tifffile, zarr, tensorstore, nibabel, pynrrd, segyio, h5py or numpy make of it; where they know the place of a voxel in the world, that is
compared, too. Every file that it says is refused must be refused with exit code 1 and a reason. The files of tests/data that these libraries
have written are held against them, too, and N5 of every kind that tensorstore writes, since there is only one such file. Then some volumes are
written in every format that is written, and read by the same libraries.
"""

import json
import subprocess
import sys
import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import h5py
import nibabel
import nrrd
import numpy as np
import pydicom
import segyio
import SimpleITK as sitk
import tensorstore
import tifffile
import vtk
import zarr
from vtk.util.numpy_support import vtk_to_numpy

warnings.filterwarnings("ignore")
sitk.ProcessObject.GlobalWarningDisplayOff()
SUPERVOL, DATA, WORK = sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3])
# Files of this repository that are compared, too; what is refused has a name like these.
ROOT = Path(__file__).resolve().parent.parent
OURS = sorted(path for pattern in ("tiff/*.tif", "analyze/*.hdr", "vtk/*.vt[ik]", "dicom/*.dcm") for path in (ROOT / "tests/data").glob(pattern))
REFUSED = "lzma"

# Options that a file needs.
OPTIONS = {"raw/walnut_128x96x114_u16le.raw": ["--dims", "128,96,114", "--dtype", "u16le"]}
JPEG_TOLERANCE, BY_JPEG = 3, ("/jpeg-", "/baseline.dcm", "/colours-rgb.dcm")
# Points of index space whose places are compared.
POINTS = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (3, 2, 1)]


def run(*arguments):
    return subprocess.run([SUPERVOL, *map(str, arguments)], capture_output=True, text=True)


def check(is_true, message):
    if not is_true:
        raise AssertionError(message)


def of_itk(image):
    place = [image.TransformContinuousIndexToPhysicalPoint([float(i) for i in p[: image.GetDimension()]]) for p in POINTS]
    array = sitk.GetArrayFromImage(image)
    return array, (place if image.GetDimension() == 3 else None), "left-posterior-superior"


def by_itk(path, _):
    return of_itk(sitk.ReadImage(str(path)))


def by_vtk(path, _):
    reader = vtk.vtkXMLImageDataReader() if path.suffix == ".vti" else vtk.vtkStructuredPointsReader()
    reader.SetFileName(str(path))
    reader.Update()
    image = reader.GetOutput()
    x, y, z = image.GetDimensions()
    if image.GetPointData().GetScalars() is None:
        array, shift = vtk_to_numpy(image.GetCellData().GetArray(0)), 0.5
        x, y, z = x - 1, y - 1, z - 1
    else:
        array, shift = vtk_to_numpy(image.GetPointData().GetScalars()), 0
    first = image.GetExtent()[::2]
    place = []
    for point in POINTS:
        found = [0, 0, 0]
        image.TransformContinuousIndexToPhysicalPoint([i + shift + f for i, f in zip(point, first)], found)
        place.append(found)
    return array.reshape(z, y, x), place, None


def by_nibabel(path, _):
    image = nibabel.load(path)
    if image.get_data_dtype().fields:
        raw = np.asarray(image.dataobj)
        # Rec. 601, as TIFF and DICOM colours are read.
        array = np.round(sum(raw[name] * w for name, w in zip("RGB", [0.299, 0.587, 0.114]))).astype("u1")
    else:
        array = np.asanyarray(image.dataobj)
    array = array.reshape(array.shape[:3] + (-1,), order="F")[..., 0] if array.ndim > 3 else array
    place = [(image.affine @ [*p, 1])[:3] for p in POINTS]
    return array.T, place, "right-anterior-superior"


def by_analyze(path, _):
    # nibabel uses a convention of its own for the position in the world.
    return by_nibabel(path, _)[0], None, None


def by_tifffile(path, _):
    array = tifffile.imread(path)
    with tifffile.TiffFile(path) as file:
        axes = file.series[0].axes
        if file.pages[0].photometric == tifffile.PHOTOMETRIC.MINISWHITE:
            # Greater is brighter with us.
            array = ~array
    if "S" in axes:
        array = np.moveaxis(array, axes.index("S"), -1)
        array = np.round(array[..., :3] @ [0.299, 0.587, 0.114]).astype(array.dtype)
    elif "C" in axes:
        array = np.take(array, 0, axis=axes.index("C"))
    return array.astype("u1") if array.dtype == bool else array, None, None


def by_zarr(path, _):
    node = zarr.open(path, mode="r")
    if not isinstance(node, zarr.Array):
        attributes = node.attrs.asdict()
        image = attributes.get("ome", attributes)["multiscales"][0]
        level = image["datasets"][0]
        scale = level["coordinateTransformations"][0]["scale"]
        node, scale = node[level["path"]], scale[::-1] + [1] * (3 - len(scale))
        return node[...], [tuple(i * s for i, s in zip(p, scale)) for p in POINTS], None
    return node[...], None, None


def by_tensorstore(path, _):
    """Zarr 3, and N5, whose axes come from the fastest on; of several levels the finest."""
    is_n5 = (path / "attributes.json").exists()
    level = path / "s0" if is_n5 and (path / "s0").exists() else path
    spec = {"driver": "n5" if is_n5 else "zarr3", "kvstore": {"driver": "file", "path": str(level.resolve())}}
    array = tensorstore.open(spec).result().read().result()
    return array.T if is_n5 else array, None, None


def by_pynrrd(path, _):
    array, header = nrrd.read(str(path))
    directions = header.get("space directions")
    # The first of several volumes; the axis of the volumes has no direction.
    if directions is not None and array.ndim == 4:
        time = next(axis for axis, direction in enumerate(directions) if np.isnan(direction).any())
        array, directions = np.take(array, 0, axis=time), np.delete(directions, time, axis=0)
    if directions is None or len(directions) != 3:
        return array.T, None, None
    return array.T, [header.get("space origin", np.zeros(3)) + directions.T @ point for point in POINTS], header.get("space")


def by_slices(path, _):
    """A NRRD whose slices lie in files named by a pattern, which pynrrd does not know."""
    return np.stack([np.fromfile(path.with_suffix(f".{i}"), "<i2").reshape(64, 64) for i in range(1, 94)]), None, None


def by_h5py(path, name):
    with h5py.File(path) as file:
        return file[name][...], None, None


def by_numpy_segy(path, info):
    """SEG-Y that segyio does not read, unsigned samples and extensions of trace headers, taken apart as revision 2.0 has it."""
    data, order = path.read_bytes(), "<" if "lsb" in path.name.lower() else ">"
    count, code, extensions = (int(np.frombuffer(data, order + "u2", 1, byte - 1)[0]) for byte in (3221, 3225, 3507))
    samples = {1: "u4", 10: "u4", 11: "u2", 16: "u1"}[code]
    more = 240 * extensions
    layout = [("", "V28"), ("kind", order + "u2"), ("", "V158"), ("lines", order + "i4", 2), ("", f"V{44 + more}"), ("samples", order + samples, count)]
    traces = np.frombuffer(data, layout, -1, 3600)
    values = traces["samples"]
    if code == 1:
        # IBM System/360: a sign, a power of 16 above 64, and 24 bits of a fraction.
        power = (values >> 24 & 127).astype("f8") - 64
        values = np.where(values >> 31, -1, 1) * (values & 0xFFFFFF) / 2.0**24 * 16**power
    lines = [info["survey"][name] for name in ("inline", "crossline")]
    array = np.full((*(line["count"] for line in lines), count), info["nodata"] or 0, values.dtype)
    for at, trace, kind in zip(traces["lines"], values, traces["kind"]):
        if kind != 2:
            array[tuple((number - line["first"]) // line["step"] for number, line in zip(at, lines))] = trace
    return array.transpose(2, 0, 1), None, None


def by_segyio(path, info):
    with segyio.open(path, ignore_geometry=True, endian="little" if "lsb" in path.name.lower() else "big") as file:
        if int(file.format) not in (1, 2, 3, 5, 6, 8):
            return by_numpy_segy(path, info)
        lines = info["survey"]
        shape = (lines["inline"]["count"], lines["crossline"]["count"], len(file.samples))
        array = np.full(shape, np.nan) if file.dtype.kind == "f" else np.full(shape, info["nodata"] or 0)
        for trace, header in zip(file.trace, file.header):
            at = [(header[byte] - lines[n]["first"]) // lines[n]["step"] for n, byte in (("inline", 189), ("crossline", 193))]
            if header[29] != 2:
                array[at[0], at[1]] = trace
    return array.transpose(2, 0, 1), None, None


def by_pydicom(path, _):
    files = sorted(path.rglob("*.dcm")) if path.is_dir() else [path]
    if len(files) > 1:
        reader = sitk.ImageSeriesReader()
        reader.SetFileNames(reader.GetGDCMSeriesFileNames(str(path)))
        return of_itk(reader.Execute())
    data = pydicom.dcmread(path)
    array = data.pixel_array
    if data.SamplesPerPixel == 3:
        array = np.round(array @ [0.299, 0.587, 0.114]).astype(array.dtype)
    # The value of a voxel is the scaled number.
    slope, offset = float(data.get("RescaleSlope", 1)), float(data.get("RescaleIntercept", 0))
    if "DoseGridScaling" in data:
        slope = float(data.DoseGridScaling)
    return (array * slope + offset if (slope, offset) != (1, 0) else array), None, None


def by_numpy(path, _):
    if path.suffix == ".npz":
        with np.load(path) as archive:
            return archive[archive.files[0]], None, None
    return np.load(path), None, None


def by_raw(path, _):
    return np.fromfile(path, "<u2").reshape(114, 96, 128), None, None


def by_pictures(path, _):
    files = sorted(path.iterdir(), key=lambda f: (len(f.name), f.name))
    if files[0].suffix in (".tif", ".tiff"):
        return np.stack([tifffile.imread(f) for f in files]), None, None
    return np.stack([sitk.GetArrayFromImage(sitk.ReadImage(str(f))) for f in files]), None, None


READERS = [
    # Files that SimpleITK and zarr-python cannot read: one axis, four axes in a space of three, spacings beside a space, an old
    # spelling of a transposition.
    ("nrrd/odd/test1d_ascii", by_pynrrd), ("nrrd/odd/test_simple4d_raw", by_pynrrd), ("raw/headsq_64x64x93_i16le/quarter", by_slices),
    ("zarr/v3/3d.chunked.mixed.i2.F", by_tensorstore), ("n5/", by_tensorstore),
    ("segy/odd/rotated-small-rev2", by_numpy_segy), ("segy/odd/trace-header-extension1", by_numpy_segy),
    ("segy/", by_segyio), ("nrrd/", by_itk), ("metaimage/", by_itk), ("raw/headsq", by_itk), ("raw/", by_raw), ("vti/", by_vtk),
    ("vtk-legacy/", by_vtk), ("nifti/", by_nibabel), ("npy/", by_numpy), ("npz/", by_numpy), ("dicom/", by_pydicom),
    ("tests/data/tiff/", by_tifffile), ("tests/data/analyze/", by_analyze), ("tests/data/vtk/", by_vtk),
    ("tests/data/dicom/", by_pydicom),
    ("tiff/odd/ome-multifile", by_pictures), ("tiff/", by_tifffile), ("png-slices/", by_pictures), ("zarr/", by_zarr),
]


def same(found, expected, tolerance=0):
    """What is wrong with voxels: floats must be equal to the last digits of what was scaled."""
    expected = np.asarray(expected)
    expected = expected.reshape(expected.shape[-3:] if expected.ndim > 3 else (1,) * (3 - expected.ndim) + expected.shape)
    if found.shape != expected.shape:
        return f"{found.shape} voxels, where {expected.shape} were expected"
    if tolerance:
        is_same = np.abs(found.astype("i4") - expected.astype("i4")).max() <= tolerance
    elif found.dtype.kind == "f":
        is_same = np.allclose(found, expected.astype("f8"), rtol=2e-7, atol=1e-30, equal_nan=True)
    else:
        is_same = np.array_equal(found, expected)
    return None if is_same else f"{np.count_nonzero(found != expected)} voxels differ"


def world(info, point):
    direction = np.reshape(info["direction"], (3, 3))
    return np.array(info["origin"]) + direction @ (np.array(info["spacing"]) * point)


def places(info, expected, space):
    """Whether points lie where another reader has them; patients may be seen from the other side."""
    if expected is None:
        return None
    turn = [-1, -1, 1] if info["space"] and space and info["space"] != space else [1, 1, 1]
    for point, place in zip(POINTS, expected):
        distance = np.linalg.norm(world(info, point) * turn - np.array(place))
        if distance > 1e-4 * max(1, np.linalg.norm(place)):
            return f"{point} lies at {world(info, point) * turn}, not at {np.array(place)}"
    return None


def compare(name, fate, work):
    """What became of a file: `equal` or `refused`."""
    container, output = work / "v.svol", work / "v.npy"
    path = (ROOT if name.startswith("tests/") else DATA) / name
    built = run("build", path, "-o", container, "--force", *OPTIONS.get(name, []))
    if fate == "refused":
        check(built.returncode == 1 and len(built.stderr) > len(str(path)) + 20, f"expected a refusal, found: {built.stderr}")
        return "refused"
    check(built.returncode == 0, built.stderr)
    extracted = run("extract", container, "-o", output, "--force")
    check(extracted.returncode == 0, extracted.stderr)
    info = json.loads(run("info", container, "--json").stdout)
    reader = next(reader for prefix, reader in READERS if name.startswith(prefix))
    array, place, space = reader(path, info)
    found = np.load(output)
    # Luminances are rounded; decoders of JPEG differ in their last digits, and in what they make of chroma between pixels.
    tolerance = JPEG_TOLERANCE if any(word in name for word in BY_JPEG) else 1 if "colours: their luminance" in built.stdout + built.stderr else 0
    problem = same(found, array, tolerance) or places(info, place, space)
    check(problem is None, f"{reader.__name__[3:]}: {problem}")
    return "equal"


def made_n5(name, work):
    """Builds N5 as tensorstore writes it: blocks that end with the volume, and one that is missing."""
    kind, codec = name.split(" by ")[0].split(", ")[1:]
    options = {"blosc": {"cname": "lz4", "clevel": 5, "shuffle": 1}}.get(codec, {})
    values = np.random.default_rng(1).normal(90, 30, (21, 17, 11)).clip(0, 120).astype(kind)
    values[:8, :8, :8] = 0
    path = work / "v.n5"
    spec = {"driver": "n5", "kvstore": {"driver": "file", "path": str(path)},
            "metadata": {"dimensions": values.shape, "blockSize": [8, 8, 8], "dataType": np.dtype(kind).name, "compression": {"type": codec, **options}}}
    tensorstore.open(spec, create=True).result().write(values).result()
    built = run("build", path, "-o", work / "v.svol")
    check(built.returncode == 0, built.stderr)
    run("extract", work / "v.svol", "-o", work / "v.npy")
    problem = same(np.load(work / "v.npy"), by_tensorstore(path, None)[0]) or same(np.load(work / "v.npy"), values.T)
    check(problem is None, problem)
    return "equal"


N5_KINDS = [(kind, codec) for kind in ["u1", "i1", "u2", "i2", "u4", "i4", "f4", "f8"] for codec in ["raw", "gzip"]]
N5_KINDS += [("u2", "blosc"), ("f4", "blosc"), ("u8", "gzip"), ("i8", "gzip"), ("i2", "zstd")]


def written(name, work):
    """Writes a volume in every format, and reads it by other libraries."""
    container = work / "v.svol"
    built = run("build", DATA / name, "-o", container, "--force")
    check(built.returncode == 0, built.stderr)
    info = json.loads(run("info", container, "--json").stdout)
    ends = {"npy": by_numpy, "nrrd": by_itk, "nii": by_nibabel, "nii.gz": by_nibabel, "mha": by_itk, "vti": by_vtk,
            "tif": by_tifffile, "zarr": by_zarr, "sgy": by_segyio}
    arrays = {}
    for end, reader in ends.items():
        output = work / f"v.{end}"
        extracted = run("extract", container, "-o", output, "--force")
        check(extracted.returncode == 0, f"{end}: {extracted.stderr}")
        if end == "sgy":
            again = work / "again.svol"
            run("build", output, "-o", again, "--force")
            info_of = json.loads(run("info", again, "--json").stdout)
        else:
            info_of = info
        array, place, space = reader(output, info_of)
        arrays[end] = array
        problem = same(np.load(work / "v.npy"), array)
        check(problem is None, f"{end}: {problem}")
        if end in ("nrrd", "nii", "nii.gz", "mha", "vti"):
            # ITK takes every world for a patient's; what is none stays as it is.
            known = dict(info, space=info["space"] or (space if end != "mha" else ""))
            problem = places(known, place, space)
            check(problem is None, f"{end}: {problem}")
    return f"equal in {', '.join(arrays)}"


def main():
    rows = [line.split(" | ") for line in Path(sys.argv[4]).read_text().splitlines() if " | builds | " in line or " | refused | " in line]
    jobs = [(row[0].lstrip("| "), row[1], compare) for row in rows]
    jobs += [(str(path.relative_to(ROOT)), "refused" if REFUSED in path.name else "builds", compare) for path in OURS]
    jobs += [("hdf5/aneurysm_sense40.h5:/volume_1", "builds", None)]
    jobs += [(f"n5, {kind}, {codec} by tensorstore", "", made_n5) for kind, codec in N5_KINDS]
    jobs += [(name, "", written) for name in
             ["metaimage/HeadMRVolume.mhd", "nifti/odd/big.nii.gz", "segy/f3-formats/Format3lsb.sgy", "dicom/brain_pd_19slices", "zarr/ome_zarr_0.6_scale.zarr"]]
    counts, failures = {"equal": 0, "refused": 0}, []

    def one(numbered):
        number, (name, fate, check_one) = numbered
        work = WORK / str(number)
        work.mkdir(parents=True)
        try:
            if check_one is None:
                file, dataset = name.split(":/")
                READERS.insert(0, (name, lambda *_: by_h5py(DATA / file, dataset)))
                return name, compare(name, fate, work)
            return name, check_one(name, fate, work) if check_one is compare else check_one(name, work)
        except Exception as error:
            return name, error
        finally:
            subprocess.run(["rm", "-rf", work], check=True)

    with ThreadPoolExecutor(2) as pool:
        for name, outcome in pool.map(one, enumerate(jobs)):
            if isinstance(outcome, Exception):
                failures.append(f"{name}: {type(outcome).__name__}: {outcome}")
            else:
                counts[outcome.split(" in ")[0]] += 1
    print(f"readers: {counts['equal']} equal, {counts['refused']} refused")
    for line in failures:
        print(f"FAILED: {line}")
    sys.exit(1 if failures else 0)


main()
