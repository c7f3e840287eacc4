#!/usr/bin/env bash
# segyio reads a sample interval above 32767 as 4000, also from a file that it has written itself.
#
# Version: segyio 1.9.14.
# Expected: an interval that `from_array` accepts comes back: 50000 microseconds, or 50 m for a depth volume.
# Seen: the file holds 50000 in 16 bits. segyio reads these bits as a signed number, -15536, and takes it for missing.
#     `segyio.dt` and `f.samples` then use the fallback of 4 ms. Nothing is reported.
#     The number of samples, which has 16 bits as well, is read without a sign: 40000 samples come back as 40000.
# Why it matters: coarse depth volumes, such as velocity models with 50 m between samples, become 12.5 times as thin.
# Work with it: pass `fallback_dt=0` to `segyio.dt`; a result of 0 means that the header must be read.
#     Take `f.bin[segyio.BinField.Interval] % 65536`.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check \
    segyio==1.9.14 numpy==2.4.6
venv/bin/python - <<'EOF'
import sys
from pathlib import Path

import numpy as np
import segyio


def check(what, seen, noted):
    print(f"{what}: {seen}")
    if seen != noted:
        sys.exit(f"The behaviour changed. Noted was: {noted}")


segyio.tools.from_array("volume.sgy", np.zeros((2, 2, 3), "float32"), dt=50000)
header = Path("volume.sgy").read_bytes()
check("interval in the file", int.from_bytes(header[3216:3218], "big"), 50000)
with segyio.open("volume.sgy") as file:
    check("binary header", file.bin[segyio.BinField.Interval], -15536)
    check("segyio.dt", segyio.dt(file), 4000.0)
    check("segyio.dt, fallback_dt=0", segyio.dt(file, fallback_dt=0), 0.0)
    check("samples in ms", file.samples.tolist(), [0.0, 4.0, 8.0])
    check("mended", file.bin[segyio.BinField.Interval] % 65536, 50000)

segyio.tools.from_array("long.sgy", np.zeros((2, 2, 40000), "float32"))
with segyio.open("long.sgy") as file:
    check("number of samples", len(file.samples), 40000)
EOF
