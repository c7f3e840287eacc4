#!/usr/bin/env python3
"""Holds the rates, errors and speeds of our codecs against zstd, lz4, blosc2, zfp and SZ3, brick by brick.

    rates.py measure BRICKS_FOLDER FIGURES.csv [NAME ...]
    rates.py table FIGURES.csv
    rates.py chart FIGURES.csv CHART.svg

`cargo bench -p supervol-benches --bench rates -- --bricks BRICKS_FOLDER A.svol ...` writes the folder: bricks as they are stored,
the same moved within an error, and our figures. The packages are those of tools/rates.txt.

What is fair, as far as it goes:

- Layers of apron that repeat the voxels before them (at the faces of a volume) are not coded by our wavelets; they are taken off before
  anything else codes a brick, and bits and bytes are those of voxels that are left, for all. Sections are coded with two axes.
- zstd, lz4 and blosc2 lose nothing: where an error is allowed, they code the voxels that `build --max-error` would store.
- zfp and SZ3 code the exact voxels, integers as 32-bit floats, which hold them exactly, and what they decode is rounded to whole numbers: an
  error of n is asked for as n + 0.499, which is n after rounding. So are floats that are all multiples of one power
  of two. zfp's reversible mode is tried on integers (32 bits, unscaled) and on floats; the smallest of what is exact counts.
- zfp keeps well below a tolerance, and knows powers of two only. `zfp asked` is what it makes of the error that was asked for;
  `zfp equal` the greatest tolerance whose greatest error over all bricks is still within ours, found by bisection on voxels scaled so
  that every tolerance can be met. SZ3 meets its bound; `SZ3 equal` asks for the error that ours has, in whichever of
  its two predictors (its default of interpolation and Lorenzo, or Lorenzo and regression) takes less. `SZ3 of moved voxels` tells predictors
  and entropy coders apart from when voxels are rounded: it codes what ours codes, and loses nothing more.
- Masks of two values are coded as they are: `--max-error` does not move labels. Holes are no errors. Floats that are
  not finite are 0 for zfp and SZ3, which do not know them.

Speeds are bytes of voxels, as the volume stores them, per second of processor time of one thread, the best of ROUNDS over all bricks.
Conversions between integers and floats are not counted: they are ours, not the codecs'.
"""

import csv
import json
import math
import sys
import time
from pathlib import Path

import numpy as np

ROUNDS = 3
BISECTIONS = 8
TYPES = {"u8": "u1", "i8": "i1", "u16": "<u2", "i16": "<i2", "u32": "<u4", "i32": "<i4", "f32": "<f4", "f64": "<f8"}
COLUMNS = ["data", "type", "share", "codec", "bits", "asked", "found", "psnr", "encode_mb_s", "decode_mb_s", "call_share", "bricks"]
# Most of what rounding adds to an error of whole numbers.
ALMOST_HALF = 0.499
SZ3_PREDICTORS = ("INTERP_LORENZO", "LORENZO_REG")


def without_repeats(brick):
    """Where what is left begins and ends, along z, y, x, without layers of apron that repeat the voxels before them."""
    cut = []
    for axis in range(3):
        layers, n = np.moveaxis(brick, axis, 0), brick.shape[axis]
        low = 2 if n > 4 and all(np.array_equal(layers[2], layers[i], equal_nan=brick.dtype.kind == "f") for i in (0, 1)) else 0
        high = 2 if n > 4 and all(np.array_equal(layers[n - 3], layers[n - i], equal_nan=brick.dtype.kind == "f") for i in (1, 2)) else 0
        cut.append(slice(low, n - high))
    return tuple(cut)


def read_bricks(folder, about, file):
    data, at, bricks = np.fromfile(folder / file, TYPES[about["type"]]), 0, []
    for x, y, z in about["extents"]:
        bricks.append(data[at : at + x * y * z].reshape(z, y, x))
        at += x * y * z
    return bricks


def best(of_all, rounds):
    """What `of_all` gives, and the least processor time it takes."""
    least, result = math.inf, None
    for _ in range(rounds):
        begun = time.thread_time()
        result = of_all()
        least = min(least, time.thread_time() - begun)
    return result, least


def lossless_codecs(itemsize):
    """What codes and decodes bytes, by name."""
    import blosc2
    import lz4.frame
    import zstandard

    blosc2.set_nthreads(1)
    zstd, unzstd = zstandard.ZstdCompressor(level=3), zstandard.ZstdDecompressor()

    def blosc(codec):
        one = {"codec": codec, "clevel": 5, "typesize": itemsize, "filters": [blosc2.Filter.SHUFFLE], "nthreads": 1}
        return lambda b: blosc2.compress2(b, **one), lambda b: blosc2.decompress2(b, nthreads=1)

    return {
        "zstd": (zstd.compress, unzstd.decompress),
        "lz4": (lz4.frame.compress, lz4.frame.decompress),
        "blosc2 zstd": blosc(blosc2.Codec.ZSTD),
        "blosc2 lz4": blosc(blosc2.Codec.LZ4),
    }


def zfp(tolerance):
    """zfp's fixed accuracy; none is its reversible mode."""
    import zfpy

    if tolerance is None:
        return zfpy.compress_numpy, zfpy.decompress_numpy
    return lambda b: zfpy.compress_numpy(b, tolerance=tolerance), zfpy.decompress_numpy


def sz3(error, algorithm):
    import pysz

    def encode(brick):
        config = pysz.szConfig(brick.shape)
        config.absErrorBound, config.cmprAlgo = error, getattr(pysz.szAlgorithm, algorithm)
        return brick.dtype, brick.shape, pysz.sz.compress(brick, config)[0]

    return encode, lambda coded: pysz.sz.decompress(coded[2], coded[0], coded[1])[0]


def length(coded):
    return coded[2].nbytes if isinstance(coded, tuple) else len(coded)


class Volume:
    """The bricks of a volume, and what is measured of them."""

    def __init__(self, folder, name):
        self.folder, self.about = folder, json.loads((folder / f"{name}.json").read_text())
        stored = read_bricks(folder, self.about, self.about["errors"][0]["file"])
        self.cuts = [without_repeats(brick) for brick in stored]
        self.exact = self.cut(stored)
        self.voxels = sum(brick.size for brick in self.exact)
        self.stored_voxels = sum(brick.size for brick in stored)
        self.itemsize = stored[0].itemsize
        self.is_whole = stored[0].dtype.kind != "f"
        self.quantum = 1.0 if self.is_whole else self.common_quantum()
        as_float = [np.nan_to_num(b.astype("f4"), nan=0, posinf=0, neginf=0) for b in self.exact]
        self.floats = [np.ascontiguousarray(b) for b in as_float]
        self.rows = []

    def cut(self, bricks):
        """Bricks without what repeats; a section has two axes, since zfp fills axes up to a multiple of four."""
        return [np.ascontiguousarray(np.squeeze(brick[cut])) for brick, cut in zip(bricks, self.cuts)]

    def common_quantum(self):
        """The greatest power of two that all floats are multiples of, where these multiples are below 2^22."""
        most = max(float(np.abs(brick[np.isfinite(brick)]).max(initial=0)) for brick in self.exact)
        quantum = 2.0 ** (math.ceil(math.log2(most)) - 22) if most else 1.0
        finite = [brick[np.isfinite(brick)].astype("f8") for brick in self.exact]
        if any(np.any(values / quantum != np.rint(values / quantum)) for values in finite):
            return None
        while all(np.all(values / (2 * quantum) == np.rint(values / (2 * quantum))) for values in finite) and quantum < most:
            quantum *= 2
        return quantum

    def distortion(self, decoded):
        """Greatest error and PSNR of decoded bricks."""
        greatest, squares, count = 0.0, 0.0, 0
        for exact, other in zip(self.exact, decoded):
            present = np.isfinite(exact) if exact.dtype.kind == "f" else np.ones(exact.shape, bool)
            if self.about["nodata"] is not None:
                present &= exact != self.about["nodata"]
            error = exact[present].astype("f8") - other[present].astype("f8")
            greatest, squares, count = max(greatest, float(np.abs(error).max(initial=0))), squares + float(error @ error), count + error.size
        width = self.about["range"][1] - self.about["range"][0]
        return greatest, (10 * math.log10(width * width * count / squares) if squares else None)

    def record(self, share, codec, asked, found, psnr, size, encode_s, decode_s, call_share=None):
        megabytes = self.voxels * self.itemsize / 1e6
        speeds = [round(megabytes / s, 1) if s else None for s in (encode_s, decode_s)]
        self.rows.append([self.about["name"], self.about["type"], share, codec, round(size * 8 / self.voxels, 4), asked, found,
                          psnr and round(psnr, 2), *speeds, call_share and round(call_share, 4), len(self.exact)])

    def rounded(self, decoded, to):
        return [np.rint(b.astype("f8") / to) * to for b in decoded] if to else decoded

    def once(self, codec, bricks):
        """Bytes and decoded bricks, not timed."""
        encode, decode = codec
        coded = [encode(brick) for brick in bricks]
        return sum(map(length, coded)), [decode(c) for c in coded]

    def timed(self, codec, bricks):
        """Bytes, decoded bricks, seconds of both ways, and the share of decoding that is calling: that of a brick of one voxel."""
        encode, decode = codec
        coded, encode_s = best(lambda: [encode(brick) for brick in bricks], ROUNDS)
        decoded, decode_s = best(lambda: [decode(c) for c in coded], ROUNDS)
        first = bricks[0]
        one = encode(first[: self.itemsize] if isinstance(first, bytes) else first[(slice(0, 1),) * first.ndim].copy())
        _, call_s = best(lambda: [decode(one) for _ in bricks], ROUNDS)
        return sum(map(length, coded)), decoded, encode_s, decode_s, call_s / decode_s

    def ours(self, error):
        for codec in error["codecs"]:
            # All stored voxels are decoded; only those without repetition count.
            seconds = [self.stored_voxels * self.itemsize / 1e6 / codec[f"{way}_mb_s"] for way in ("encode", "decode")]
            self.record(error["share"], f"ours {codec['codec']}", error["asked"], error["found"], error["psnr"], codec["bytes"], *seconds)

    def lossless(self, error):
        bricks = [b.tobytes() for b in self.cut(read_bricks(self.folder, self.about, error["file"]))]
        for name, codec in lossless_codecs(self.itemsize).items():
            size, decoded, encode_s, decode_s, call = self.timed(codec, bricks)
            if any(bytes(a) != b for a, b in zip(decoded, bricks)):
                raise AssertionError(f"{name}: not what was encoded")
            self.record(error["share"], name, error["asked"], error["found"], error["psnr"], size, encode_s, decode_s, call)

    def lossy(self, share, name, codec, bricks, scale, to, asked):
        size, decoded, encode_s, decode_s, call = self.timed(codec, bricks)
        found, psnr = self.distortion(self.rounded([d / scale for d in decoded] if scale != 1 else decoded, to))
        self.record(share, name, asked, found, psnr, size, encode_s, decode_s, call)
        return found

    def nothing_lost(self):
        """What zfp and SZ3 make of bricks whose voxels are to come back as they are."""
        ways = {"zfp reversible": (zfp(None), self.floats)}
        if self.is_whole:
            ways["zfp reversible, integers"] = (zfp(None), [b.astype("i4") for b in self.exact])
        if self.quantum:
            tolerance = ALMOST_HALF * self.quantum
            ways["zfp rounded"] = (zfp(tolerance), self.floats)
            ways |= {f"SZ3 {a}": (sz3(tolerance, a), self.floats) for a in SZ3_PREDICTORS}
        sizes = {}
        for way, (codec, bricks) in ways.items():
            size, decoded = self.once(codec, bricks)
            if self.distortion(self.rounded(decoded, self.quantum))[0] == 0:
                sizes[way] = size
            else:
                print(f"  {way}: not exact", file=sys.stderr)
        for family in ("zfp", "SZ3"):
            of_family = [way for way in sizes if way.startswith(family)]
            if of_family:
                way = min(of_family, key=sizes.get)
                self.lossy(0.0, f"{family} equal", *ways[way], 1, self.quantum, 0.0)

    def bound(self, error):
        """What to ask for where `error` is allowed: before rounding, nearly half a quantum more."""
        return (math.floor(error / self.quantum + 1e-9) + ALMOST_HALF) * self.quantum if self.quantum else error

    def sz3_at(self, share, name, asked, found):
        to, bound = self.quantum, self.bound(found)
        smallest = min(SZ3_PREDICTORS, key=lambda a: self.once(sz3(bound, a), self.floats)[0])
        self.lossy(share, name, sz3(bound, smallest), self.floats, 1, to, asked)

    def zfp_at(self, share, asked, ours):
        to = self.quantum
        self.lossy(share, "zfp asked", zfp(self.bound(asked)), self.floats, 1, to, asked)

        def scaled(tolerance):
            # A tolerance that is a power of two, and voxels multiplied so that it means the one wanted.
            scale = 2.0 ** math.ceil(math.log2(tolerance)) / tolerance
            return scale, zfp(tolerance * scale), [b * np.float32(scale) for b in self.floats]

        low, high = 0.0, 5.0
        for _ in range(BISECTIONS):
            middle = (low + high) / 2
            scale, codec, bricks = scaled(ours * 2**middle)
            found, _ = self.distortion(self.rounded([d / scale for d in self.once(codec, bricks)[1]], to))
            low, high = (middle, high) if found <= ours else (low, middle)
        scale, codec, bricks = scaled(ours * 2**low)
        self.lossy(share, "zfp equal", codec, bricks, scale, to, asked)

    def sz3_of_moved(self, error):
        """What SZ3's predictors and entropy coder make of moved voxels, losing nothing more."""
        bricks = self.cut(read_bricks(self.folder, self.about, error["file"]))
        moved = [np.nan_to_num(brick / error["step"], nan=0, posinf=0, neginf=0).astype("f4") for brick in bricks]
        sizes = []
        for algorithm in SZ3_PREDICTORS:
            size, decoded = self.once(sz3(ALMOST_HALF, algorithm), moved)
            if all(np.array_equal(np.rint(a), np.rint(b)) for a, b in zip(decoded, moved)):
                sizes.append(size)
        if sizes:
            self.record(error["share"], "SZ3 of moved voxels", error["asked"], error["found"], error["psnr"], min(sizes), None, None)

    def measure(self):
        for error in self.about["errors"]:
            if error["share"] > 0 and error["found"] == 0:
                continue  # Nothing is moved: two values that are multiples of the step.
            self.ours(error)
            self.lossless(error)
            if error["share"] == 0:
                self.nothing_lost()
            else:
                self.zfp_at(error["share"], error["asked"], error["found"])
                self.sz3_at(error["share"], "SZ3 asked", error["asked"], error["asked"])
                self.sz3_at(error["share"], "SZ3 equal", error["asked"], error["found"])
                self.sz3_of_moved(error)
        return self.rows


def measure(folder, output, names):
    folder, output = Path(folder), Path(output)
    names = names or sorted(path.stem for path in folder.glob("*.json"))
    with output.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for name in names:
            begun = time.time()
            writer.writerows(Volume(folder, name).measure())
            file.flush()
            print(f"{name}: {time.time() - begun:.0f} s", file=sys.stderr)


def read_figures(path):
    """Rows by volume, share and codec; numbers as numbers."""
    figures = {}
    with open(path, newline="") as file:
        for row in csv.DictReader(file):
            for column in COLUMNS[4:]:
                row[column] = float(row[column]) if row[column] else None
            figures.setdefault(f"{row['data']}, {row['type']}", {}).setdefault(float(row["share"]), {})[row["codec"]] = row
    return figures


def bits_at(codecs_by_share, codec, psnr):
    """Bits of a codec at this PSNR, between the two errors whose PSNR is next to it; none beyond them."""
    points = sorted((codecs[codec]["psnr"], codecs[codec]["bits"]) for codecs in codecs_by_share if codec in codecs and codecs[codec]["psnr"])
    for (low, few), (high, many) in zip(points, points[1:]):
        if low <= psnr <= high:
            return few + (many - few) * (psnr - low) / (high - low)
    return None


def table(path):
    """A line for each volume and error; then how often ours takes fewer bits, and decodes faster."""
    print("| data | error | found, PSNR | ours: bit; MB/s | zfp, equal error: bit; MB/s; dB | zfp as asked: bit; error | "
          "SZ3, equal error: bit; MB/s; dB | zstd, blosc2, lz4: bit | our bits as a share of zfp's, of SZ3's | our speed over SZ3's |")
    print("|---" * 10 + "|")
    figures, ratios = read_figures(path), {"zfp": [], "SZ3": [], "speed": [], "zfp, equal PSNR": []}

    def psnr(row, before=""):
        return f"{before}{row['psnr']:.1f}" if row["psnr"] else ""

    def cell(row):
        return f"{row['bits']:.2f}; {row['decode_mb_s']:.0f}{psnr(row, '; ')}" if row else "-"

    def ratio(kind, label, a, b, key):
        if b is None:
            return "-"
        ratios[kind].append((a[key] / b[key], label))
        return f"{a[key] / b[key]:.2f}"

    for name, shares in figures.items():
        for share, codecs in shares.items():
            label = f"{name} {share:g}"
            own, zfp_, sz, asked = (codecs.get(c) for c in ("ours auto", "zfp equal", "SZ3 equal", "zfp asked"))
            as_asked = f"{asked['bits']:.2f}; {asked['found']:.3g}" if asked else "-"
            others = ", ".join(f"{codecs[c]['bits']:.2f}" for c in ("zstd", "blosc2 zstd", "lz4"))
            print(f"| {name} | {share:g} | {own['found']:.4g}{psnr(own, '; ')} | {own['bits']:.2f}; {own['decode_mb_s']:.0f} | {cell(zfp_)} | {as_asked} | "
                  f"{cell(sz)} | {others} | {ratio('zfp', label, own, zfp_, 'bits')}, {ratio('SZ3', label, own, sz, 'bits')} | "
                  f"{ratio('speed', label, own, sz, 'decode_mb_s')} |")
            own_bits = zfp_["psnr"] and bits_at(shares.values(), "ours auto", zfp_["psnr"])
            if own_bits:
                ratios["zfp, equal PSNR"].append((own_bits / zfp_["bits"], label))
    for kind, found in ratios.items():
        (least, of_least), (greatest, of_greatest) = min(found), max(found)
        counts = ", ".join(f"below {limit} in {sum(value < limit for value, _ in found)}" for limit in (1, 3))
        print(f"\n{kind}: {counts} of {len(found)}; {least:.2f} ({of_least}) to {greatest:.2f} ({of_greatest})")


# Name, colour and dashes of a line of the chart.
LINES = {
    "lz4": ("lz4", "#b0b0b0", "2 2"),
    "zstd": ("zstd 3", "#8c564b", "2 2"),
    "blosc2 zstd": ("blosc2, shuffle and zstd", "#9467bd", "5 2"),
    "zfp asked": ("zfp, tolerance as asked", "#8fce8f", "5 2"),
    "zfp equal": ("zfp, equal error", "#2ca02c", "none"),
    "SZ3 equal": ("SZ3, equal error", "#1f77b4", "none"),
    "ours auto": ("ours, auto", "#d62728", "none"),
}
# Position of an error of 0 on a logarithmic axis.
NO_ERROR = 1e-5
COLUMNS_OF_CHART, PANEL, GAP, ROW = 3, (104, 92), 34, 140


class Axis:
    """Where values lie between two places; those beyond its ends lie at its ends."""

    def __init__(self, ticks, first, last, start, end, is_log=True):
        self.ticks, self.start, self.end = ticks, start, end
        self.of = math.log10 if is_log else float
        self.first, self.last = self.of(first), self.of(last)

    def place(self, value):
        share = (self.of(value) - self.first) / (self.last - self.first)
        return round(self.start + min(max(share, 0), 1) * (self.end - self.start), 1)


def panel(left, top, x, y, lines):
    """One plot: its frame, numbers along both axes, and a line for each codec."""
    width, height = PANEL
    out = [f'<rect x="{left}" y="{top}" width="{width}" height="{height}" fill="none" stroke="#888"/>']
    for value, text in x.ticks:
        at = x.place(value)
        out.append(f'<path d="M{at} {top}v{height}" stroke="#ddd"/><text x="{at}" y="{top + height + 9}" class="m">{text}</text>')
    for value, text in y.ticks:
        at = y.place(value)
        out.append(f'<path d="M{left} {at}h{width}" stroke="#ddd"/><text x="{left - 3}" y="{at + 2.5}" class="e">{text}</text>')
    for codec, points in lines:
        _, colour, dashes = LINES[codec]
        places = [(x.place(a), y.place(b)) for a, b in points]
        path = "L".join(f"{a} {b}" for a, b in places)
        out.append(f'<path d="M{path}" fill="none" stroke="{colour}" stroke-width="1.4" stroke-dasharray="{dashes}"/>')
        out += [f'<circle cx="{a}" cy="{b}" r="1.7" fill="{colour}"/>' for a, b in places]
    return out


def plain(values):
    return [(value, f"{value:.2g}" if value < 10 else f"{value:g}") for value in values]


def points_of(shares, codec, across, up):
    rows = [(shares[share]["ours auto"], share, codecs[codec]) for share, codecs in sorted(shares.items()) if codec in codecs]
    if across == "psnr":
        return [(row["psnr"], row[up]) for _, _, row in rows if row["psnr"]]
    # Errors that were found, as shares of the range.
    return [(max(row["found"] * share / own["asked"], NO_ERROR) if share else NO_ERROR, row[up]) for own, share, row in rows]


def charts_of(name, shares, left, top):
    """Three plots of a volume: bits against the greatest error, against PSNR, and the speed of decoding."""
    width, height = PANEL
    errors = [(NO_ERROR, "0"), (1e-4, "10⁻⁴"), (1e-3, "10⁻³"), (1e-2, "10⁻²")]
    bits = [row["bits"] for codecs in shares.values() for codec, row in codecs.items() if codec in LINES]
    ends = [2.0 ** math.floor(math.log2(min(bits))), 2.0 ** math.ceil(math.log2(max(bits)))]
    powers = [2.0**k for k in range(-8, 7) if ends[0] <= 2.0**k <= ends[1]]
    out = [f'<text x="{left}" y="{top - 6}" class="t">{name}</text>']
    for number, (across, up) in enumerate([("error", "bits"), ("psnr", "bits"), ("error", "decode_mb_s")]):
        at = left + number * (width + GAP)
        if across == "psnr":
            x = Axis(plain([40, 60, 80]), 38, 98, at, at + width, False)
        else:
            x = Axis(errors, NO_ERROR / 1.6, 2e-2, at, at + width)
        if up == "bits":
            y = Axis(plain(powers[:: 1 + len(powers) // 6]), *ends, top + height, top)
        else:
            y = Axis(plain([100, 300, 1000, 3000]), 80, 8000, top + height, top)
        lines = [(codec, points_of(shares, codec, across, up)) for codec in LINES]
        out += panel(at, top, x, y, [(codec, points) for codec, points in lines if points])
    return out


def chart(path, output):
    """Writes the plots of all volumes as one SVG."""
    figures = read_figures(path)
    width = COLUMNS_OF_CHART * (3 * (PANEL[0] + GAP) + 14) + 20
    height = 84 + ROW * math.ceil(len(figures) / COLUMNS_OF_CHART)
    style = "text{font:8px sans-serif;fill:#222}.m{text-anchor:middle}.e{text-anchor:end}.t{font-weight:bold;font-size:10px}.l{font-size:10px}"
    out = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}"><style>{style}</style>',
           f'<rect width="{width}" height="{height}" fill="#fff"/>']
    for number, (label, colour, dashes) in enumerate(LINES.values()):
        x = 30 + number * 165
        out.append(f'<path d="M{x} 16h24" stroke="{colour}" stroke-width="2" stroke-dasharray="{dashes}"/><text x="{x + 29}" y="19" class="l">{label}</text>')
    out.append('<text x="30" y="38" class="l">Of each volume: bits per voxel against the greatest error, as a share of the range (logarithmic); '
               "bits per voxel against PSNR, dB; decoding, MB/s of voxels, against the greatest error. Beyond the edge: at the edge.</text>")
    for number, (name, shares) in enumerate(figures.items()):
        row, column = divmod(number, COLUMNS_OF_CHART)
        out += charts_of(name, shares, 30 + column * (3 * (PANEL[0] + GAP) + 14), 68 + row * ROW)
    Path(output).write_text("\n".join([*out, "</svg>", ""]))


def main():
    commands = {"measure": lambda folder, output, *names: measure(folder, output, names), "table": table, "chart": chart}
    if len(sys.argv) < 3 or sys.argv[1] not in commands:
        sys.exit(__doc__)
    commands[sys.argv[1]](*sys.argv[2:])


if __name__ == "__main__":
    main()
