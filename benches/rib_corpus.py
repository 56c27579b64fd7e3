#!/usr/bin/env python3
"""Renders every whole RIB scene below a folder and counts what became of them.

usage: rib_corpus.py FOLDER [--loden PROGRAM] [--limit SECONDS] [--list] [--keep FOLDER]

A whole scene is a .rib or .rib.gz file with a WorldBegin; equal files count once. Each is rendered at 64 x 48 pixels with
4 samples. The outcomes are
  picture    at least two displayed values, and at least one pixel in 500 brighter than 1 %
  black      drawn, but hardly any pixel is brighter than that
  no shape   nothing to draw
  refused    the program stopped with an error
  timed out  not finished within the limit
Below them are the warnings and errors by number of scenes, and the scenes that are no picture and say nothing about it.
"""
import argparse
import collections
import gzip
import hashlib
import pathlib
import re
import struct
import subprocess
import sys
import tempfile
import zlib

ROOT = pathlib.Path(__file__).resolve().parent.parent
SIZE = (64, 48)
# the outcomes that need a reason
FAILED = ("black", "no shape", "refused", "timed out")


def scenes(folder):
    """The files that have a world, each content once."""
    seen = set()
    for path in sorted(folder.rglob("*")):
        if not path.is_file() or not path.name.lower().endswith((".rib", ".rib.gz")):
            continue
        data = path.read_bytes()
        if data[:2] == b"\x1f\x8b":
            try:
                data = gzip.decompress(data)
            except (EOFError, OSError, zlib.error):
                pass
        code = re.sub(rb"(?m)^\s*#.*$", b"", data)
        digest = hashlib.sha256(data).digest()
        if b"WorldBegin" in code and digest not in seen:
            seen.add(digest)
            yield path


def pixels(path):
    """The rows of an 8-bit PNG picture without interlacing, three or four numbers a pixel."""
    data, at, packed = path.read_bytes(), 8, b""
    while at < len(data):
        length, kind = struct.unpack(">I4s", data[at : at + 8])
        body = data[at + 8 : at + 8 + length]
        if kind == b"IHDR":
            width, height, depth, color = struct.unpack(">IIBB", body[:10])
            assert depth == 8, f"{depth} bits"
            step = {0: 1, 2: 3, 6: 4}[color]
        packed += body if kind == b"IDAT" else b""
        at += length + 12
    raw, stride, above = zlib.decompress(packed), width * step, bytearray(width * step)
    for y in range(height):
        method, row = raw[y * (stride + 1)], bytearray(raw[y * (stride + 1) + 1 : (y + 1) * (stride + 1)])
        for x in range(stride):
            left = row[x - step] if x >= step else 0
            corner = above[x - step] if x >= step else 0
            estimate = left + above[x] - corner
            paeth = min((left, above[x], corner), key=lambda value: abs(estimate - value))
            row[x] = row[x] + (0, left, above[x], (left + above[x]) // 2, paeth)[method] & 255
        yield [tuple(row[x : x + step]) for x in range(0, stride, step)]
        above = row


def outcome(program, scene, limit, picture):
    """What became of a scene, and what the program said."""
    size = f"{SIZE[0]}x{SIZE[1]}"
    command = [program, "render", "--scene", scene, "--size", size, "--spp", "4", "-o", picture]
    picture.unlink(missing_ok=True)
    try:
        done = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, timeout=limit)
    except subprocess.TimeoutExpired as late:
        return "timed out", (late.stderr or b"").decode(errors="replace")
    said = done.stderr.decode(errors="replace")
    if done.returncode != 0:
        return "refused", f"exit status {done.returncode}\n{said}"
    if "the scene has no shapes" in said:
        return "no shape", said
    shown = [pixel for row in pixels(picture) for pixel in row]
    # 25 of 255 is 1 % of the light
    bright = sum(max(pixel[:3]) >= 25 for pixel in shown)
    if bright * 500 < len(shown) or len(set(shown)) == 1:
        return "black", said
    return "picture", said


def reasons(said):
    """Messages without file names, lines, counts and quoted names of their own."""
    found = set()
    for line in said.splitlines():
        line = re.sub(r"^(warning|error): ", "", line.strip())
        line = re.sub(r"^\S*\.(rib|gz)\S*: ", "", line)
        line = re.sub(r"^line \d+: ", "", line)
        line = re.sub(r" ?\(\d+ times\)", "", line)
        line = re.sub(r"/\S+", "FILE", line)
        line = re.sub(r"-?\d+(\.\d+)?(e-?\d+)?", "N", line)
        if line and not line.startswith("exit status"):
            found.add(line[:110])
    return found


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--loden", default=ROOT / "target" / "release" / "loden", type=pathlib.Path)
    parser.add_argument("--limit", default=60.0, type=float, metavar="SECONDS")
    parser.add_argument("--list", action="store_true", help="print the outcome of every scene")
    parser.add_argument("--keep", type=pathlib.Path, help="keep the pictures and messages in this folder")
    parser.add_argument("--top", default=40, type=int, metavar="N", help="number of messages to print (40)")
    arguments = parser.parse_args()
    counts, spoken, silent = collections.Counter(), collections.defaultdict(collections.Counter), []
    with tempfile.TemporaryDirectory() as folder:
        for number, scene in enumerate(scenes(arguments.folder)):
            picture = pathlib.Path(folder) / "picture.png"
            result, said = outcome(arguments.loden, scene, arguments.limit, picture)
            counts[result] += 1
            name = scene.relative_to(arguments.folder)
            if result in FAILED and result != "timed out" and not reasons(said):
                silent.append(f"{result}: {name}")
            spoken[result].update(reasons(said))
            if arguments.list:
                print(f"{result:10} {name}", flush=True)
            if arguments.keep:
                arguments.keep.mkdir(parents=True, exist_ok=True)
                base = arguments.keep / f"{number:04}-{result.replace(' ', '-')}-{scene.stem[:40]}"
                base.with_suffix(".txt").write_text(f"{scene}\n{said}")
                if picture.exists():
                    base.with_suffix(".png").write_bytes(picture.read_bytes())
    total = sum(counts.values())
    print(f"\n{total} scenes")
    for kind in ("picture", *FAILED):
        print(f"{counts[kind]:6} {kind} ({100 * counts[kind] / max(total, 1):.0f} %)")
    for kind in (*FAILED, "picture"):
        if spoken[kind]:
            print(f"\n{kind}: messages by number of scenes")
            for message, count in spoken[kind].most_common(arguments.top):
                print(f"{count:6} {message}")
    print(f"\nsilent: {len(silent)}")
    for line in silent:
        print("  ", line)


if __name__ == "__main__":
    sys.exit(main())
