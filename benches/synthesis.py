#!/usr/bin/env python3
"""Times texture synthesis beside the crate texture-synthesis and compares the results, and prints the rows of a Markdown table.

usage: python benches/synthesis.py [PICTURE.png ...] [--side 512] [--runs 3] [--sheet FILE.jpg]

Without pictures, eight procedural textures of 128 x 128 texels are made: bricks and a twill (regular), a weave and scales
(nearly regular), pebbles and leather (irregular), granite and wood (stochastic). The peer
(0.8.2, built in target/bench) gets the same pictures and two threads; the programs take turns, and the fastest run of each
counts. Both give the coordinates of what they copy, and the measures of `synth::measure` are taken from those; smaller is
better except for evenness. Exits with 1 if one and two threads give different results, or if the peer, plain tiling or random
blocks are better where they must lose. Results and the page index.html, which shows them, go to target/bench/synthesis.
"""
import argparse
import json
import os
import pathlib
import subprocess
import sys

import numpy as np
from PIL import Image

ROOT = pathlib.Path(__file__).resolve().parent.parent
FOLDER = ROOT / "target" / "bench" / "synthesis"
OURS = ROOT / "target" / "release" / "examples" / "bench_synthesis"

MANIFEST = """
[package]
name = "peer"
version = "0.1.0"
edition = "2024"
[workspace]
[dependencies]
texture-synthesis = { version = "=0.8.2", default-features = false }
"""

PEER = """
use texture_synthesis as ts;
fn main() -> Result<(), Box<dyn std::error::Error>> {
    let words: Vec<String> = std::env::args().collect();
    let begin = std::time::Instant::now();
    let dims = ts::Dims::square(words[2].parse()?);
    let session = ts::Session::builder().add_example(&words[1]).seed(1).output_size(dims).max_thread_count(2).build()?;
    let made = session.run(None);
    println!("{{\\"seconds\\": {}}}", begin.elapsed().as_secs_f64());
    made.get_coordinate_transform().write(&mut std::fs::File::create(&words[3])?)?;
    Ok(made.save(words[3].replace(".coordinates", ".png"))?)
}
"""


def build():
    """Our program and the peer's; the latter's path."""
    subprocess.run(["cargo", "build", "--release", "-p", "loden", "--example", "bench_synthesis"], cwd=ROOT, check=True)
    crate = FOLDER / "peer"
    (crate / "src").mkdir(parents=True, exist_ok=True)
    (crate / "Cargo.toml").write_text(MANIFEST)
    (crate / "src" / "main.rs").write_text(PEER)
    subprocess.run(["cargo", "build", "--release", "--quiet"], cwd=crate, check=True)
    return crate / "target" / "release" / "peer"


def noise(size, blur, seed):
    """Periodic Gaussian noise of unit variance."""
    white = np.random.default_rng(seed).normal(size=(size, size))
    f = np.fft.fftfreq(size)
    gauss = np.exp(-2 * (np.pi * blur) ** 2 * (f[:, None] ** 2 + f**2))
    smooth = np.fft.ifft2(np.fft.fft2(white) * gauss).real
    return smooth / smooth.std()


def bricks(n, y, x):
    row = np.floor(y / 13.5)
    along = x + row % 2 * 14.2
    column = np.floor(along / 28.4)
    tone = np.sin(row * 12.9898 + column * 78.233) * 43758.5453 % 1
    u, v = along - 28.4 * column, y % 13.5
    brick = np.clip(np.minimum.reduce([u, 28.4 - u, v, 13.5 - v]) - 1, 0, 1)[..., None]
    clay = np.array([0.62, 0.3, 0.22]) * (0.75 + 0.5 * tone[..., None]) + 0.03 * noise(n, 0.6, 1)[..., None]
    return clay * brick + np.array([0.7, 0.68, 0.64]) * (1 - brick)


def weave(n, y, x):
    x, y = (x + 1.1 * noise(n, 9, 2)) / 12.4, (y + 1.1 * noise(n, 9, 3)) / 12.4
    i, j = np.floor(x), np.floor(y)
    u, v, warp = np.sin(np.pi * (x - i)), np.sin(np.pi * (y - j)), (i + j) % 2 == 0
    height = np.where(warp, u * (0.7 + 0.3 * v), v * (0.7 + 0.3 * u)) * 0.8 + 0.1
    return height[..., None] * np.where(warp[..., None], [0.85, 0.75, 0.5], [0.45, 0.55, 0.75])


def pebbles(n, y, x):
    points = np.random.default_rng(5).uniform(-20, n + 20, size=(190, 2))
    distance = np.hypot(x[..., None] - points[:, 0], y[..., None] - points[:, 1])
    tone = np.random.default_rng(6).uniform(0.45, 1, size=190)[np.argmin(distance, axis=-1)]
    nearest = np.sort(distance, axis=-1)
    edge = np.clip((nearest[..., 1] - nearest[..., 0]) / 5, 0, 1)
    return (edge * tone * (0.9 + 0.06 * noise(n, 1, 4)))[..., None] * np.array([0.8, 0.78, 0.7]) + 0.06


def granite(n, y, x):
    grain, spots = noise(n, 1.2, 5) + 0.6 * noise(n, 0.5, 6), noise(n, 2, 7)
    red = 0.1 * (spots > 1.1)[..., None] * np.array([1, 0.3, 0.2])
    return 0.5 + 0.13 * grain[..., None] * np.array([1, 0.95, 0.9]) + red - 0.25 * (spots < -1.2)[..., None]


def twill(n, y, x):
    i, j = np.floor(x / 5.3), np.floor(y / 5.3)
    warp = (i - j) % 4 < 2
    across, along = np.where(warp, x, y) / 5.3 % 1, np.where(warp, (y / 5.3 - i) % 4 - 2, (x / 5.3 + j) % 4 - 2)
    height = np.sin(np.pi * across) ** 0.7 * (0.6 + 0.4 * np.cos(along * np.pi / 4) ** 2) * (1 + 0.1 * noise(n, 0.8, 8))
    return height[..., None] * np.where(warp[..., None], [0.3, 0.35, 0.5], [0.75, 0.72, 0.65])


def scales(n, y, x):
    x, y = x + 0.9 * noise(n, 10, 9), y + 0.9 * noise(n, 10, 10)
    best = np.full((n, n), 1e9)
    tone = np.zeros((n, n))
    for j in range(-2, 22):
        for i in range(-2, 13):
            u, v = x - 12 * (i + 0.5 * (j % 2)), y - 6.5 * j
            depth = np.where((v > -9) & (u**2 / 36 + v**2 / 81 < 1), -j, 1e9)
            light = 0.35 + 0.5 * np.clip(1 - (u**2 / 36 + (v - 2) ** 2 / 81), 0, 1)
            tone = np.where(depth < best, light, tone)
            best = np.minimum(best, depth)
    return (tone * (1 + 0.06 * noise(n, 0.7, 11)))[..., None] * np.array([0.55, 0.75, 0.5])


def leather(n, y, x):
    points = np.random.default_rng(12).uniform(-20, n + 20, size=(420, 2))
    x, y = x + 1.5 * noise(n, 3, 13), y + 1.5 * noise(n, 3, 14)
    nearest = np.sort(np.hypot(x[..., None] - points[:, 0], y[..., None] - points[:, 1]), axis=-1)
    crease = np.clip((nearest[..., 1] - nearest[..., 0]) / 3, 0, 1) ** 0.6
    return (crease * (0.8 + 0.08 * noise(n, 0.8, 15)) + 0.1)[..., None] * np.array([0.5, 0.3, 0.2])


def wood(n, y, x):
    ring = y / 7 + 0.9 * noise(n, 16, 16) + x / 60
    fibre = np.fft.ifft2(np.fft.fft2(noise(n, 0.4, 17)) * np.exp(-((np.fft.fftfreq(n) * 30) ** 2))[None]).real
    tone = 0.6 + 0.25 * (ring % 1) ** 2 + 0.35 * fibre
    return tone[..., None] * np.array([0.8, 0.6, 0.4])


def pictures():
    for texture in (bricks, twill, weave, scales, pebbles, leather, granite, wood):
        y, x = np.mgrid[0:128, 0:128].astype(float)
        file = FOLDER / f"{texture.__name__}.png"
        Image.fromarray((np.clip(texture(128, y, x), 0, 1) * 255 + 0.5).astype(np.uint8)).save(file)
        yield file


def run(*line, threads=2):
    words = [str(word) for word in line]
    done = subprocess.run(words, env={**os.environ, "RAYON_NUM_THREADS": str(threads)}, stdout=subprocess.PIPE, check=True)
    return json.loads(done.stdout)


HEADER = ["picture", "program", "seconds", "seam energy", "patch error", "copy length", "repetition", "evenness",
          "patch distance", "spectrum error"]

# Measures, of which smaller is better, in which each must lose against the default method. Most patches of a tiled texture are
# those of the sample, so patch errors do not tell.
LOSES = {
    "texture-synthesis": ("seam_energy", "patch_error"),
    "plain tiling": ("seam_energy", "copy_length", "repetition"),
    "random blocks": ("seam_energy", "patch_error", "spectrum_error"),
}


def row(name, program, seconds, measures):
    scales = lambda key: ", ".join(f"{distance:.3f}" for distance in measures[key])
    cells = [name, program, seconds, f"{measures['seam_energy']:.3f}", scales("patch_error"), f"{measures['copy_length']:.1f}",
             f"{measures['repetition']:.2f}", f"{measures['evenness']:.3f}", scales("patch_distance"),
             f"{measures['spectrum_error']:.3f}"]
    print("| " + " | ".join(cells) + " |", flush=True)
    return cells


def worse(name, program, ours, theirs):
    """Whether a program loses in all measures in which it must."""
    first = lambda value: value[0] if isinstance(value, list) else value
    wins = [key for key in LOSES[program] if first(theirs[key]) <= first(ours[key])]
    if wins:
        print(f"{name}: {program} is better in {', '.join(wins)}")
    return not wins


def page(shown, rows):
    style = "body{font-family:sans-serif;margin:2em}img{image-rendering:pixelated}td,th{padding:.2em .6em;text-align:right}"
    lines = [f"<!doctype html><meta charset=utf-8><title>Synthesis compared</title><style>{style}</style>"]
    for name, files in shown:
        lines.append(f"<h2>{name}</h2><img src={name}.png>")
        lines += [f"<figure style='display:inline-block'><img src={file}><figcaption>{what}</figcaption></figure>"
                  for what, file in files]
    cells = lambda tag, row: "<tr>" + "".join(f"<{tag}>{cell}</{tag}>" for cell in row) + "</tr>"
    lines += ["<table>", cells("th", HEADER), *(cells("td", row) for row in rows), "</table>"]
    (FOLDER / "index.html").write_text("\n".join(lines))


def sheet(file, shown):
    """Each texture in a row, and the top left corner of each result."""
    side, gap = 220, 6
    columns = 1 + len(shown[0][1])
    picture = Image.new("RGB", (columns * (side + gap) - gap, len(shown) * (side + gap) - gap), "white")
    for row, (name, files) in enumerate(shown):
        for column, of in enumerate([f"{name}.png", *(file for _, file in files)]):
            tile = Image.open(FOLDER / of).convert("RGB")
            picture.paste(tile.crop((0, 0, min(side, tile.width), min(side, tile.height))), (column * (side + gap), row * (side + gap)))
    picture.save(file, quality=85)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("pictures", nargs="*", type=pathlib.Path)
    parser.add_argument("--side", type=int, default=512)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--sheet", type=pathlib.Path, help="write all results as one picture")
    options = parser.parse_args()
    FOLDER.mkdir(parents=True, exist_ok=True)
    peer, good, side = build(), True, options.side
    print("| " + " | ".join(HEADER) + " |\n|" + "---|" * len(HEADER))
    shown, rows = [], []
    for picture in options.pictures or pictures():
        name = picture.stem
        out = lambda program: FOLDER / f"{name}-{program}.png"
        coordinates = FOLDER / f"{name}-peer.coordinates"
        ours, many, theirs = [], [], []
        for _ in range(options.runs):
            ours.append(run(OURS, picture, side, "optimise", 3, out("optimise")))
            many.append(run(OURS, picture, side, "optimise", 16))
            theirs.append(run(peer, picture, side, coordinates))
        if run(OURS, picture, side, "optimise", threads=1)["hash"] != ours[0]["hash"]:
            print(f"{name}: one and two threads give DIFFERENT results")
            good = False
        seconds, of_many, of_peer = (min(r["seconds"] for r in runs) for runs in (ours, many, theirs))
        best = ours[0]["measures"]
        others = {
            "texture-synthesis": run(OURS, picture, side, coordinates, 3, out("peer"))["measures"],
            "plain tiling": run(OURS, picture, side, "tiling", 3, out("tiling"))["measures"],
            "random blocks": run(OURS, picture, side, "quilting:strategy=random", 3, out("blocks"))["measures"],
        }
        rows.append(row(name, "loden, optimise", f"{seconds:.2f}, {of_peer / seconds:.1f} times as fast", best))
        rows.append(row(name, "the same, 16 channels", f"{of_many:.2f}, {of_many / seconds:.2f} of the time", many[0]["measures"]))
        for program, measures in others.items():
            rows.append(row(name, program, f"{of_peer:.2f}" if program == "texture-synthesis" else "", measures))
            good &= worse(name, program, best, measures)
        programs = [("loden, optimise", "optimise"), ("texture-synthesis", "peer"), ("plain tiling", "tiling"), ("random blocks", "blocks")]
        shown.append((name, [(what, out(program).name) for what, program in programs]))
        if picture.parent != FOLDER:
            Image.open(picture).save(FOLDER / f"{name}.png")
    page(shown, rows)
    if options.sheet:
        sheet(options.sheet, shown)
    sys.exit(0 if good else 1)


if __name__ == "__main__":
    main()
