#!/usr/bin/env python3
"""Compares two builds of the program: the same containers and pictures, byte for byte.

    tools/same.py BEFORE AFTER [DATA_FOLDER] [--keep FOLDER]

BEFORE and AFTER are two executables of `supervol`. Both build the volumes of VOLUMES (lossless, and within an error) and
draw the scenes of SCENES by the CPU, and by the GPU backend where SAME_GPU=1 is set. Prints each difference, and exits
with 1 if there is one. Volumes that the data folder lacks are named and make the comparison fail.
"""

import hashlib
import os
import subprocess
import sys
import tempfile
from pathlib import Path

VOLUMES = [  # name, file below the data folder, options of `build`
    ("carp", "nifti/carp_ct.nii.gz", []),
    ("mni", "nifti/mni152_t1_1mm.nii.gz", []),
    ("bonsai", "vti/bonsai.vti", []),
    ("aneurism", "vti/aneurism.vti", []),
    ("hydrogen", "vti/hydrogen_f32.vti", []),
    ("frog", "vti/frog_tissues_labels.vti", []),
    ("channels", "vti/channels_celldata_i64.vti", []),
    ("iron", "vtk-legacy/ironProt.vtk", []),
    ("stent", "npz/stent.npz", []),
    ("headmr", "metaimage/HeadMRVolume.mhd", []),
    ("neghip", "metaimage/neghip.mha", []),
    ("f3", "segy/real/f3_int16_be.sgy", []),
    ("penobscot", "segy/real/penobscot_xl1155.sgy", []),
    ("volve", "segy/real/volve_migvel_depth_sub3d.sgy", []),
    ("missing", "segy/odd/missing_traces_75x71x26.segy", []),
    ("brain", "dicom/brain_pd_19slices", []),
    ("fibsem", "png-slices/fibsem-medulla-250", []),
    ("beads", "tiff/beads_imagej_41x150x150_u8.tif", []),
    ("walnut", "raw/walnut_128x96x114_u16le.raw", ["--dims", "128,96,114", "--dtype", "u16le"]),
    ("avf", "nrrd/avf_f32.nrrd", []),
    ("prostate", "nrrd/prostate_phantom_u16.nrrd", []),
    ("aneurysm5", "hdf5/aneurysm_sense40.h5:/volume_1", []),
    ("carp-bounded", "nifti/carp_ct.nii.gz", ["--max-error", "0.5%"]),
    ("volve-bounded", "segy/real/volve_migvel_depth_sub3d.sgy", ["--max-error", "0.1%"]),
    ("mni-zstd", "nifti/mni152_t1_1mm.nii.gz", ["--codec", "zstd", "--brick", "32"]),
]
SMALL = ["--size", "320x240"]
SCENES = [  # volume, options of `render`
    *[(name, []) for name, _, _ in VOLUMES],
    ("carp", ["--mode", "mip"]),
    ("carp", ["--mode", "iso", "--iso", "80"]),
    ("carp", ["--level", "0", "--camera", "30,60"]),
    ("mni", ["--slice", "axial=middle"]),
    ("mni", ["--mode", "mean"]),
    ("bonsai", ["--mode", "minip"]),
    ("bonsai", ["--clip", "outside-sphere:120,120,120,60", "--level", "0"]),
    ("aneurism", ["--max-error", "8/255"]),
    ("f3", ["--slice", "inline=middle"]),
    ("volve", ["--backend", "reference", "--size", "64x48"]),
    ("volve", ["--colormap", "viridis"]),
    ("iron", ["--surface", "100:white", "--opacity", "0.3"]),
    ("neghip", ["--host-memory", "64MiB", "--level", "0"]),
]


def run(program, arguments, folder):
    """Runs the program; the exit code and all it printed."""
    done = subprocess.run([program, *arguments], cwd=folder, capture_output=True, text=True, timeout=900)
    return done.returncode, done.stdout + done.stderr


def digest(path):
    """Digest of a file, or 'none'."""
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16] if path.exists() else "none"


def results(program, data, folder):
    """(what, result) of every build and picture by one program."""
    for name, file, options in VOLUMES:
        code, said = run(program, ["build", str(data / file), "-o", f"{name}.svol", *options], folder)
        yield f"build {name}", (code, digest(folder / f"{name}.svol")), said
    backends = ["cpu"] + (["gpu"] if os.environ.get("SAME_GPU") == "1" else [])
    for number, (name, options) in enumerate(SCENES):
        for backend in backends:
            own = [] if "--backend" in options else ["--backend", backend]
            size = [] if "--size" in options else SMALL
            picture = f"{number}-{backend}.npy"
            code, said = run(program, ["render", f"{name}.svol", "-o", picture, *size, *own, *options], folder)
            yield f"render {name} {' '.join(own + options)}", (code, digest(folder / picture)), said


def main():
    """Compares."""
    arguments = sys.argv[1:]
    if len(arguments) < 2:
        sys.exit(__doc__)
    before, after = (str(Path(program).resolve()) for program in arguments[:2])
    data = Path(arguments[2] if len(arguments) > 2 else "../shared/data").resolve()
    differences = failures = 0
    with tempfile.TemporaryDirectory() as one, tempfile.TemporaryDirectory() as other:
        pairs = zip(results(before, data, Path(one)), results(after, data, Path(other)))
        for (what, was, said), (_, now, said_now) in pairs:
            if was != now:
                differences += 1
                print(f"DIFFERENT {what}: {was} {now}\n{said}\n{said_now}")
            elif was[0] != 0:
                failures += 1
                print(f"FAILED by both: {what}: {said}")
            else:
                print(f"same {what} {was[1]}")
    print(f"{len(VOLUMES)} volumes, {len(SCENES)} scenes: {differences} differences, {failures} failed by both")
    sys.exit(1 if differences or failures else 0)


main()
