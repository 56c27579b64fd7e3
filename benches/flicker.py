#!/usr/bin/env python3
"""Measures whether the seams of a synthesised BTF flicker under a moving light, and prints the rows of a Markdown table.

usage: python benches/flicker.py [--side 512] [--frames 20] [--samples twill,leather] [--sheet FILE.jpg]

Samples of 96 x 96 texels are simulated, compressed by `klt` and synthesised at four times their size, by the default method and as
random blocks. Both results are worn by the teapot and the cloth while a light circles. A seam is a texel that was not beside its
neighbour in the sample; a picture of the seams, put on the same object, says how much of a pixel they cover. What changes from one
frame to the next, less its mean over 9 x 9 pixels, is compared: its root mean square at the seams, over that at the same seams moved
to elsewhere on the object. A seam that flickers changes otherwise than the material around it, so it raises this ratio; a seam that
cannot be seen leaves it at 1. Exits with 1 if the default method exceeds 1.1, or random blocks do not exceed it. Frames go to target/bench/flicker.
"""
import argparse
import pathlib
import subprocess
import sys

import mitsuba as mi
import numpy as np
from PIL import Image
from scipy.ndimage import uniform_filter

ROOT = pathlib.Path(__file__).resolve().parent.parent
LODEN = ROOT / "target" / "release" / "loden"
FOLDER = ROOT / "target" / "bench" / "flicker"
SIZE, TIMES = 96, 4
METHODS = {"optimise": [], "random blocks": ["--method", "quilting", "--strategy", "random"]}
RAW = """loden_raw = 1
data = "{name}.u8"
type = "u8"
shape = [1, 1, {side}, {side}, 3]
encoding = "linear"
cosine = "excluded"
views = [[0, 0]]
lights = [[0, 0]]
"""


def loden(*words):
    line = [str(word) for word in (LODEN, *words)]
    subprocess.run(line, check=True, stdout=subprocess.DEVNULL)


def read(file):
    return np.array(mi.Bitmap(str(file)))[..., :3]


def seams(file):
    """Which texels of a map have a neighbour that was not their neighbour in the sample."""
    map_ = read(file)[..., :2].astype(int)
    found = np.zeros(map_.shape[:2], bool)
    for axis, step in ((1, (1, 0)), (0, (0, 1))):
        broken = (np.diff(map_, axis=axis) != step).any(axis=-1)
        along = [(0, 0), (0, 0)]
        for along[axis] in ((0, 1), (1, 0)):
            found |= np.pad(broken, along)
    return found


def picture_of(mask, name):
    """A material that shows a mask."""
    grey = np.repeat(mask[..., None], 3, axis=-1).astype(np.uint8) * 255
    (FOLDER / f"{name}.u8").write_bytes(grey.tobytes())
    (FOLDER / f"{name}.toml").write_text(RAW.format(name=name, side=len(mask)))
    return FOLDER / f"{name}.toml"


def frame(material, thing, azimuth, side, spp=16):
    file = FOLDER / "frame.exr"
    loden("render", "--object", thing, "--material", material, "--uv-scale", 1, "--size", f"{side}x{side}", "--spp", spp,
          "--depth", 2, "--light", f"60,{azimuth}", "-o", file, "--force")
    return read(file).astype(np.float32)


def cover(mask, name, thing, side):
    """How much of each pixel a mask covers; nothing where the object is not."""
    white = frame(picture_of(np.ones_like(mask), "white"), thing, 140, side).mean(-1)
    black = frame(picture_of(np.zeros_like(mask), "black"), thing, 140, side).mean(-1)
    shown = frame(picture_of(mask, name), thing, 140, side).mean(-1)
    lit = white - black
    return np.where(lit > 0.02, (shown - black) / np.maximum(lit, 0.02), 0), lit > 0.02


def ratio(frames, mask, thing, side):
    """The change at seams relative to that at the same seams moved elsewhere."""
    changes = np.diff(np.stack(frames), axis=0).mean(-1)
    fine = changes - uniform_filter(changes, (0, 9, 9))
    energy = (fine**2).mean(0)

    def at(mask, name):
        share, on = cover(mask, name, thing, side)
        inside = uniform_filter(on.astype(float), 9) > 0.999
        weight = np.clip(share, 0, 1) * inside
        return (weight * energy).sum() / weight.sum()

    moves = [(131, 57), (59, 211), (201, 149), (311, 97)]
    elsewhere = np.mean([at(np.roll(mask, move, (0, 1)), "moved") for move in moves])
    return float(np.sqrt(at(mask, "seams") / elsewhere))


def sheet(file, rows):
    """A few frames of each row, one below the other."""
    tile, gap = 256, 4
    picture = Image.new("RGB", (5 * (tile + gap) - gap, len(rows) * (tile + gap) - gap), "white")
    for y, frames in enumerate(rows):
        for x, linear in enumerate(frames[:: max(1, len(frames) // 5)][:5]):
            display = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-6) ** (1 / 2.4) - 0.055)
            image = Image.fromarray((np.clip(display, 0, 1) * 255 + 0.5).astype(np.uint8))
            picture.paste(image.resize((tile, tile), Image.Resampling.LANCZOS), (x * (tile + gap), y * (tile + gap)))
    picture.save(file, quality=88)


def made(name):
    """The sample, compressed."""
    archive, file = FOLDER / f"{name}.zip", FOLDER / f"{name}.loden"
    if not file.exists():
        loden("acquire", name, "--size", SIZE, "--spp", 8, "-o", archive, "--force")
        loden("compress", archive, "-o", file, "--no-error")
    return file


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--side", type=int, default=512)
    parser.add_argument("--frames", type=int, default=20)
    parser.add_argument("--samples", default="twill,leather")
    parser.add_argument("--sheet", type=pathlib.Path, help="write frames of the default method as one picture")
    options = parser.parse_args()
    FOLDER.mkdir(parents=True, exist_ok=True)
    mi.set_variant("scalar_rgb")
    good, rows = True, []
    print("| sample | object | method | change at seams / elsewhere |\n|---|---|---|---|")
    for name in options.samples.split(","):
        sample = made(name)
        for method, words in METHODS.items():
            large, file = FOLDER / "large.loden", FOLDER / "map.png"
            loden("synthesize", sample, "--size", SIZE * TIMES, "--seed", 1, *words, "--map", file, "-o", large, "--force")
            mask = seams(file)
            for thing in ("teapot", "cloth"):
                frames = [frame(large, thing, azimuth, options.side) for azimuth in np.linspace(60, 250, options.frames)]
                found = ratio(frames, mask, thing, options.side)
                good &= (found <= 1.1) == (method == "optimise")
                print(f"| {name} | {thing} | {method} | {found:.2f} |", flush=True)
                rows += [frames] if method == "optimise" else []
    if options.sheet:
        sheet(options.sheet, rows)
    sys.exit(0 if good else 1)


if __name__ == "__main__":
    main()
