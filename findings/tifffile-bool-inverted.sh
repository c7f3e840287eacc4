#!/usr/bin/env bash
# tifffile writes a mask of truth values that other programs show inverted.
#
# Versions: tifffile 2026.3.3, Pillow 13.0.0, imageio 2.38.1.
# Expected: a voxel that is True is read back as True, by every reader.
# Seen: tifffile stores True as bit 1 and sets PhotometricInterpretation to 0, which means that 0 is white.
#     A reader that applies the tag inverts the mask. Pillow reads 23 of 24 pixels as True; one was True.
#     imageio reads 23 by its plugin `pillow` and 1 by its plugin `tifffile`. tifffile itself ignores the tag.
# Why it matters: segmentation masks are often stacks of bits. The inverted mask selects the background.
# Work with it: write with `photometric="minisblack"`, or write `mask.astype("uint8")`.
#     For a file of bits whose `Software` is tifffile, take the bits as stored.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check \
    tifffile==2026.3.3 pillow==13.0.0 imageio==2.38.1 numpy==2.4.6
venv/bin/python - <<'EOF'
import sys

import imageio.v3 as imageio
import numpy as np
import tifffile
from PIL import Image


def check(what, seen, noted):
    print(f"{what}: {seen}")
    if seen != noted:
        sys.exit(f"The behaviour changed. Noted was: {noted}")


mask = np.zeros((4, 6), bool)
mask[1, 2] = True
tifffile.imwrite("mask.tif", mask)
with tifffile.TiffFile("mask.tif") as file:
    page = file.pages[0]
    check("photometric interpretation", int(page.photometric), 0)
    check("bits per sample", page.bitspersample, 1)
    file.filehandle.seek(page.dataoffsets[0])
    check("bits of the rows", file.filehandle.read(4).hex(), "00200000")
check("True by tifffile", int(tifffile.imread("mask.tif").sum()), 1)
check("True by Pillow", int(np.array(Image.open("mask.tif")).sum()), 23)
for plugin, count in [("pillow", 23), ("tifffile", 1)]:
    check(f"True by imageio, {plugin}", int(imageio.imread("mask.tif", plugin=plugin).sum()), count)

tifffile.imwrite("right.tif", mask, photometric="minisblack")
check("True by Pillow, minisblack", int(np.array(Image.open("right.tif")).sum()), 1)
EOF
