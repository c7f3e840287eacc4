#!/usr/bin/env python3
"""Builds containers of files larger than memory, and says what that took; or kills a build many times.

    tools/archives.py target/release/supervol raw 8 --folder /tmp
    tools/archives.py target/release/supervol crossline 8 --folder /tmp
    tools/archives.py target/release/supervol raw 4 --kills 50

KIND is raw (u8, 2048 x 2048 x N), inline or crossline (SEG-Y of IEEE floats, traces of 2,048 samples, sorted so). The
file is made first, GIB large: folded layers with noise. One line of a table is printed: peak resident memory beside --memory, wall
and processor time, megabytes (10^6) of the file per second. Needs NumPy, and a disk with room for two and a half times the file.
"""

import argparse
import os
import random
import subprocess
import sys
import time

import numpy

SIDE = 2048
SAMPLES = 2048
GIB = 1 << 30
TRACE_BYTES = 240 + 4 * SAMPLES


def layers(count, depth, first, noise):
    """`count` traces of `depth` samples: layers whose folds change slowly from trace to trace, in -1 to 1."""
    x = numpy.arange(first, first + count, dtype=numpy.float32)[:, None]
    z = numpy.arange(depth, dtype=numpy.float32)[None, :]
    fold = 40 * numpy.sin(x / 211) + 25 * numpy.sin(x / 67)
    wave = numpy.sin((z + fold) / 9) * numpy.sin((z + 0.5 * fold) / 131)
    return 0.9 * wave + noise.standard_normal(wave.shape, dtype=numpy.float32) * 0.01


def write_raw(path, gib):
    """u8, x fastest; one slice is of one line of traces."""
    slices = gib * GIB // (SIDE * SIDE)
    noise = numpy.random.default_rng(1)
    with open(path, "wb") as out:
        for z in range(slices):
            out.write((128 + 120 * layers(SIDE, SIDE, 13 * z, noise)).clip(0, 255).astype(numpy.uint8).tobytes())
    return ["--dims", f"{SIDE},{SIDE},{slices}", "--dtype", "u8"]


def write_segy(path, gib, is_crossline):
    """SEG-Y revision 1, format 5; inline numbers vary slowest, or crossline numbers do."""
    lines = gib * GIB // TRACE_BYTES // 1024
    noise = numpy.random.default_rng(1)
    binary = bytearray(400)
    for at, value in [(16, 4000), (20, SAMPLES), (24, 5), (300, 0x0100), (302, 1)]:
        binary[at : at + 2] = value.to_bytes(2, "big")
    slow, fast = (1024, lines) if is_crossline else (lines, 1024)
    record = numpy.dtype([("header", "u1", 240), ("samples", ">f4", SAMPLES)])
    with open(path, "wb") as out:
        out.write(b" " * 3200 + binary)
        for line in range(slow):
            traces = numpy.zeros(fast, record)
            pair = (numpy.arange(fast) + 1, numpy.full(fast, line + 1))
            inline, crossline = pair if is_crossline else pair[::-1]
            header = traces["header"]
            for at, numbers in [(188, inline), (192, crossline)]:
                header[:, at : at + 4] = numbers.astype(">u4").view(numpy.uint8).reshape(-1, 4)
            for at, value in [(114, SAMPLES), (116, 4000)]:
                header[:, at : at + 2] = list(value.to_bytes(2, "big"))
            traces["samples"] = 1000 * layers(fast, SAMPLES, 13 * line, noise)
            out.write(traces.tobytes())
    return []


def run(command):
    """Runs it to its end; seconds of wall and processor time, and peak resident bytes."""
    begun = time.monotonic()
    process = subprocess.Popen(command)
    _, status, usage = os.wait4(process.pid, 0)
    if status:
        sys.exit(f"{' '.join(command)}: ended with {os.waitstatus_to_exitcode(status)}")
    return time.monotonic() - begun, usage.ru_utime + usage.ru_stime, usage.ru_maxrss * 1024


def drop_caches():
    """So that the disk is read: of the superuser's rights only."""
    os.sync()
    try:
        with open("/proc/sys/vm/drop_caches", "w", encoding="ascii") as control:
            control.write("3")
    except OSError:
        print("the file may be read from memory: no rights to drop what is kept of it", file=sys.stderr)


def kill_often(command, output, kills, longest):
    """Kills the build at random moments; what is left of it goes on each time."""
    choose = random.Random(1)
    killed = 0
    while killed < kills:
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
        try:
            if process.wait(choose.uniform(0, longest)):
                sys.exit("the build failed")
            break
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            killed += 1
    said = "" if os.path.exists(output) else subprocess.run(command, check=True, capture_output=True, text=True).stdout
    print(f"killed {killed} times; the last run said: {' '.join(said.split())}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("supervol")
    parser.add_argument("kind", choices=["raw", "inline", "crossline"])
    parser.add_argument("gib", type=int, help="size of the file")
    parser.add_argument("--folder", default="/tmp")
    parser.add_argument("--memory", default="1GiB")
    parser.add_argument("--codec", default="auto")
    parser.add_argument("--kills", type=int, default=0)
    parser.add_argument("--longest", type=float, default=3.0, help="seconds until a build is killed, at most")
    given = parser.parse_args()

    name = os.path.join(given.folder, f"archive-{given.kind}-{given.gib}")
    source = f"{name}.raw" if given.kind == "raw" else f"{name}.sgy"
    write = write_raw if given.kind == "raw" else lambda path, gib: write_segy(path, gib, given.kind == "crossline")
    options = write(source, given.gib)
    try:
        build = [given.supervol, "build", source, *options, "--memory", given.memory, "--codec", given.codec]
        output = f"{name}.svol"
        command = [*build, "--force", "-o", output]
        drop_caches()
        wall, cpu, peak = run([*command, "--quiet"])
        size = os.path.getsize(source)
        megabytes = size / 1e6
        print(f"| {given.kind} | {size / GIB:.1f} GiB | {given.codec} | {given.memory} | {peak / 2**20:.0f} MiB | {wall:.0f} s "
              f"| {cpu:.0f} s | {megabytes / wall:.0f} MB/s | {os.path.getsize(output) / GIB:.2f} GiB |", flush=True)
        if given.kills:
            whole = f"{name}-whole.svol"
            os.rename(output, whole)
            kill_often(command, output, given.kills, given.longest)
            same = subprocess.run(["cmp", output, whole], check=False).returncode == 0
            print("the same bytes" if same else "OTHER BYTES")
            os.remove(whole)
            if not same:
                sys.exit(1)
        os.remove(output)
    finally:
        os.remove(source)


if __name__ == "__main__":
    main()
