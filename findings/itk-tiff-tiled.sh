#!/usr/bin/env bash
# ITK reads a tiled TIFF of 16 bits as colours of 8 bits.
#
# Versions: SimpleITK 2.5.7 (ITK 5.4.8), tifffile 2026.3.3.
# Expected: tiles are another layout of the same 16-bit voxels, so that the voxels are the same as from strips.
# Seen: the result is an image of 4 components of 8 bits: three times the upper byte, and opacity 255.
#     The lower byte is lost. A tiled volume of 8 bits keeps its values, but has 4 components, too.
#     A warning goes to the standard error stream; no exception is raised. The same voxels in strips are read right.
# Why it matters: large microscopy files are tiled. Intensities of 0 to 255 all become 0.
# Work with it: check the pixel type after reading. Rewrite in strips, or read the tiles by tifffile.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check \
    SimpleITK==2.5.7 tifffile==2026.3.3 numpy==2.4.6
venv/bin/python - <<'EOF'
import sys

import numpy as np
import SimpleITK as sitk
import tifffile


def check(what, seen, noted):
    print(f"{what}: {seen}")
    if seen != noted:
        sys.exit(f"The behaviour changed. Noted was: {noted}")


voxels = (np.arange(32 * 48).reshape(32, 48) * 30).astype("uint16")
tifffile.imwrite("strips.tif", voxels)
tifffile.imwrite("tiles.tif", voxels, tile=(16, 16))

found = sitk.GetArrayFromImage(sitk.ReadImage("strips.tif"))
check("strips", (str(found.dtype), found.shape, bool((found == voxels).all())), ("uint16", (32, 48), True))
found = sitk.GetArrayFromImage(sitk.ReadImage("tiles.tif"))
check("tiles", (str(found.dtype), found.shape), ("uint8", (32, 48, 4)))
check("tiles, upper byte", bool((found[:, :, 0] == voxels >> 8).all()), True)
check("a voxel", (int(voxels[0, 8]), found[0, 8].tolist()), (240, [0, 0, 0, 255]))

tifffile.imwrite("bytes.tif", (voxels % 251).astype("uint8"), tile=(16, 16))
found = sitk.GetArrayFromImage(sitk.ReadImage("bytes.tif"))
check("tiles of 8 bits", found.shape, (32, 48, 4))
check("tiles of 8 bits, values", bool((found[:, :, 0] == voxels % 251).all()), True)
EOF
