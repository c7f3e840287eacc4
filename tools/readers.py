#!/usr/bin/env python3
"""Holds what `supervol build` reads, and what `supervol extract` writes, against independent readers.

    readers.py SUPERVOL DATA_FOLDER WORK_FOLDER FORMATS.md

Every file that FORMATS.md says builds is built, extracted as npy, and compared voxel by voxel with what SimpleITK, VTK, pydicom,
tifffile, zarr, nibabel, segyio, h5py or numpy make of it; where they know the place of a voxel in the world, that is compared, too. Every file that
it says is refused must be refused with exit code 1 and a reason. The files of tests/data that these libraries have written are held against
them, too. Then some volumes are written in every format that is written, and read by the same libraries. What is compared with nothing is named, with the reason.
"""

import json
import subprocess
import sys
import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import h5py
import nibabel
import numpy as np
import pydicom
import segyio
import SimpleITK as sitk
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

# Options that a file needs, and why nothing is compared where that is so.
OPTIONS = {"raw/walnut_128x96x114_u16le.raw": ["--dims", "128,96,114", "--dtype", "u16le"]}
NOT_COMPARED = {
    "segy/odd/rotated-small-rev2.sgy": "segyio does not read trace header extensions",
    "segy/odd/trace-header-extension1.sgy": "segyio does not read trace header extensions",
    "zarr/v3/3d.chunked.mixed.i2.F": "zarr-python refuses the spelling of its transposition",
    "n5/n5_viewer_multiscale_modern": "none of the libraries reads N5",
    "nrrd/odd/test1d_ascii.nrrd": "SimpleITK reads no NRRD of one axis",
    "nrrd/odd/test_simple4d_raw.nrrd": "SimpleITK reads no NRRD of four axes in a space of three",
    "raw/headsq_64x64x93_i16le/quarter.nhdr": "SimpleITK refuses spacings beside a space",
}
JPEG_TOLERANCE, BY_JPEG = 3, ("/jpeg-", "/baseline.dcm", "/colours-rgb.dcm")
# Points of index space whose places are compared.
POINTS = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (3, 2, 1)]


class NotCompared(Exception):
    """Why a file has nothing to be compared with."""


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
    # What nibabel takes for the place in the world is a convention of its own.
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


def by_h5py(path, name):
    with h5py.File(path) as file:
        return file[name][...], None, None


def by_segyio(path, info):
    with segyio.open(path, ignore_geometry=True, endian="little" if "lsb" in path.name.lower() else "big") as file:
        # segyio has no unsigned and no single-byte samples: those are taken as they lie.
        if int(file.format) not in (1, 2, 3, 5, 6, 8):
            raise NotCompared(f"segyio does not read samples of format {int(file.format)}")
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
    # What lies behind a scaling is a voxel's value.
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
    """What became of a file: `equal`, `refused`, or why it was not compared."""
    container, output = work / "v.svol", work / "v.npy"
    path = (ROOT if name.startswith("tests/") else DATA) / name
    built = run("build", path, "-o", container, "--force", *OPTIONS.get(name, []))
    if fate == "refused":
        check(built.returncode == 1 and len(built.stderr) > len(str(path)) + 20, f"expected a refusal, found: {built.stderr}")
        return "refused"
    check(built.returncode == 0, built.stderr)
    if name in NOT_COMPARED:
        return NOT_COMPARED[name]
    extracted = run("extract", container, "-o", output, "--force")
    check(extracted.returncode == 0, extracted.stderr)
    info = json.loads(run("info", container, "--json").stdout)
    reader = next(reader for prefix, reader in READERS if name.startswith(prefix))
    try:
        array, place, space = reader(path, info)
    except NotCompared as why:
        return str(why)
    found = np.load(output)
    # Luminances are rounded; decoders of JPEG differ in their last digits, and in what they make of chroma between pixels.
    tolerance = JPEG_TOLERANCE if any(word in name for word in BY_JPEG) else 1 if "colours: their luminance" in built.stdout + built.stderr else 0
    problem = same(found, array, tolerance) or places(info, place, space)
    check(problem is None, f"{reader.__name__[3:]}: {problem}")
    return "equal"


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
        try:
            array, place, space = reader(output, info_of)
        except NotCompared:
            continue
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
    jobs += [(name, "", written) for name in
             ["metaimage/HeadMRVolume.mhd", "nifti/odd/big.nii.gz", "segy/f3-formats/Format3lsb.sgy", "dicom/brain_pd_19slices", "zarr/ome_zarr_0.6_scale.zarr"]]
    counts, failures, left = {}, [], []

    def one(numbered):
        number, (name, fate, check_one) = numbered
        work = WORK / str(number)
        work.mkdir(parents=True)
        try:
            if check_one is None:
                file, dataset = name.split(":/")
                READERS.insert(0, (name, lambda *_: by_h5py(DATA / file, dataset)))
                return name, compare(name, fate, work)
            return name, check_one(name, work) if check_one is written else check_one(name, fate, work)
        except Exception as error:
            return name, error
        finally:
            subprocess.run(["rm", "-rf", work], check=True)

    with ThreadPoolExecutor(2) as pool:
        for name, outcome in pool.map(one, enumerate(jobs)):
            if isinstance(outcome, Exception):
                failures.append(f"{name}: {type(outcome).__name__}: {outcome}")
            elif outcome in ("equal", "refused") or outcome.startswith("equal in"):
                counts[outcome.split(" in ")[0]] = counts.get(outcome.split(" in ")[0], 0) + 1
            else:
                left.append(f"{name}: {outcome}")
    print(f"readers: {counts.get('equal', 0)} equal, {counts.get('refused', 0)} refused, {len(left)} built and compared with nothing:")
    for line in left:
        print(f"  {line}")
    for line in failures:
        print(f"FAILED: {line}")
    sys.exit(1 if failures else 0)


main()
