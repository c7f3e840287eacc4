#!/usr/bin/env bash
# segyio rounds the caller's own array when it writes IBM floats.
#
# Version: segyio 1.9.14.
# Expected: writing a volume leaves the array in memory as it is.
# Seen: for format 1 (IBM float, which `from_array` uses by itself), segyio converts in the caller's memory, writes,
#     and converts back. IBM floats keep 21 to 24 bits, so that the array comes back rounded. Nothing is reported.
#     `f.trace[i] = array` does the same. Format 5 (IEEE float) leaves the array as it was.
#     A comparison of the file with the array then says that the format loses nothing.
# Why it matters: results that are computed after the export differ from those before it.
#     A thread that reads the array meanwhile can meet converted bytes.
# Work with it: pass a copy, or write format 5. An array that is marked as read-only is not changed.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check \
    segyio==1.9.14 numpy==2.4.6
venv/bin/python - <<'EOF'
import sys

import numpy as np
import segyio


def check(what, seen, noted):
    print(f"{what}: {seen}")
    if seen != noted:
        sys.exit(f"The behaviour changed. Noted was: {noted}")


original = np.array([0.1, 1 / 3, 0.001, 1.1, 123456.7], "float32")
for number, changed in [(1, True), (5, False)]:
    volume = np.tile(original, (2, 2, 1))
    segyio.tools.from_array("volume.sgy", volume, format=segyio.SegySampleFormat(number))
    check(f"format {number}, volume changed", bool((volume != original).any()), changed)
    with segyio.open("volume.sgy", "r+") as file:
        difference = bool((segyio.tools.cube(file) != volume).any())
        check(f"format {number}, file differs from the volume", difference, False)
        trace = original.copy()
        file.trace[0] = trace
    check(f"format {number}, trace changed", bool((trace != original).any()), changed)
    print("    by", np.abs(trace - original).tolist())

for name, writeable in [("no format named", True), ("no format named, read-only", False)]:
    volume = np.tile(original, (2, 2, 1))
    volume.setflags(write=writeable)
    segyio.tools.from_array("volume.sgy", volume)
    check(f"{name}, volume changed", bool((volume != original).any()), writeable)
EOF
