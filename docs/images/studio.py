#!/usr/bin/env python3
"""Takes the pictures of docs/studio.md: python docs/images/studio.py [LODEN] [--keep FOLDER] [--only FILTER]

Samples are simulated and compressed, a studio is started on them, and Chromium shows every panel in windows of 1440 x 900, 1024 x 768
and 390 x 844 pixels, light and dark. The pictures of a panel become one, studio-PANEL.jpg beside this file. --keep leaves them at full
size in a folder. Needs NumPy, Pillow, a Chromium and the page's node_modules. `make screenshots` builds the program first.
"""

import argparse
import json
import pathlib
import subprocess
import tempfile

import numpy as np
from PIL import Image

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parent.parent
SHOTS = ROOT / "crates" / "loden-studio" / "page" / "test" / "shots.mjs"

SIZES = [(1440, 900), (1024, 768), (390, 844)]
# pixels of a window in the documentation, as a share of those on the screen
SCALE = 0.42
GAP = 8

COMMANDS = [
    ["acquire", "twill", "--size", "64", "--spp", "8", "-o", "twill.zip"],
    ["acquire", "leather", "--size", "64", "--spp", "8", "-o", "hidden/leather.zip"],
    ["acquire", "lacquer", "--size", "64", "--spp", "8", "-o", "hidden/lacquer.zip"],
    ["convert", "twill.zip", "twill-mean.bsdf"],
    ["convert", "hidden/leather.zip", "leather-mean.bsdf"],
    ["compress", "twill.zip", "--method", "pvmf", "--components", "4", "-o", "twill-pvmf.loden"],
    ["compress", "twill.zip", "--method", "pvmf", "--components", "12", "-o", "twill-pvmf-12.loden"],
    ["compress", "twill.zip", "--method", "klt", "--components", "32", "-o", "twill-klt.loden"],
    ["compress", "twill.zip", "--method", "pca", "--components", "16", "-o", "twill-pca.loden"],
    ["compress", "twill.zip", "--method", "kmeans", "--clusters", "48", "-o", "twill-kmeans.loden"],
    ["compress", "hidden/leather.zip", "--method", "kmeans", "--clusters", "48", "-o", "leather.loden"],
    ["compress", "hidden/lacquer.zip", "--method", "kmeans", "--clusters", "32", "-o", "lacquer.loden"],
    ["synthesize", "twill-kmeans.loden", "--size", "256x256", "-o", "twill-large.loden"],
]


def evening():
    """Sky that is warm on one side, ground, and a bright window, as a Radiance picture."""
    height, width = 256, 512
    up = np.cos(np.pi * (np.arange(height) + 0.5) / height)[:, None, None]
    side = 0.5 + 0.5 * np.cos(2 * np.pi * (np.arange(width) + 0.5) / width)[None, :, None]
    sky = np.array([0.35, 0.55, 0.9]) * (1 - 0.5 * side) + np.array([2.5, 1.3, 0.6]) * side * np.exp(-4 * np.abs(up))
    values = np.where(up > 0, sky, np.array([0.2, 0.18, 0.16]))
    values[50:100, 300:370] = [14, 12, 9]
    exponent = np.ceil(np.log2(values.max(-1, keepdims=True)))
    pixels = np.concatenate([values * 256 / 2**exponent, exponent + 128], -1).clip(0, 255).astype(np.uint8)
    return f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n".encode() + pixels.tobytes()


def knot():
    """A trefoil knot as a tube."""
    along, around, thick = 240, 40, 0.42
    t = 2 * np.pi * np.arange(along + 1) / along
    line = np.stack([np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t), -np.sin(3 * t)], 1)
    tangent = np.gradient(line, axis=0)
    tangent[0] = tangent[-1] = line[1] - line[-2]
    tangent /= np.linalg.norm(tangent, axis=1)[:, None]
    side = np.cross(tangent, line * [1, 1, 0])
    side /= np.linalg.norm(side, axis=1)[:, None]
    other = np.cross(tangent, side)
    a = 2 * np.pi * np.arange(around + 1) / around
    normals = np.cos(a)[None, :, None] * side[:, None] + np.sin(a)[None, :, None] * other[:, None]
    points = line[:, None] + thick * normals
    lines = [f"v {x:.5f} {y:.5f} {z:.5f}" for x, y, z in points.reshape(-1, 3)]
    lines += [f"vn {x:.5f} {y:.5f} {z:.5f}" for x, y, z in normals.reshape(-1, 3)]
    lines += [f"vt {3 * k / along:.5f} {0.5 * j / around:.5f}" for k in range(along + 1) for j in range(around + 1)]
    for k in range(along):
        for j in range(around):
            corners = [k * (around + 1) + j, (k + 1) * (around + 1) + j, (k + 1) * (around + 1) + j + 1, k * (around + 1) + j + 1]
            lines.append("f " + " ".join(f"{c + 1}/{c + 1}/{c + 1}" for c in corners))
    return "\n".join(lines)


def prepared(program, folder):
    (folder / "hidden").mkdir()
    data = folder / "data"
    data.mkdir()
    for command in COMMANDS:
        words = [str(folder / word) if word.startswith("hidden/") else word for word in command]
        print("loden", *command, flush=True)
        subprocess.run([program, *words, "-q"], check=True, cwd=data, stdout=subprocess.DEVNULL)
    (data / "evening.hdr").write_bytes(evening())
    (data / "knot.obj").write_text(knot())
    (data / "damaged.zip").write_bytes(b"PK\x03\x04 and nothing else")
    return data


def taken(program, data, folder, only):
    with subprocess.Popen([program, "studio", data, "--no-open", "--json"], stdout=subprocess.PIPE, text=True) as studio:
        text = ""
        while not text.rstrip().endswith("}"):
            text += studio.stdout.readline()
        try:
            subprocess.run(["node", SHOTS, json.loads(text)["address"], folder, only], check=True)
        finally:
            studio.terminate()


def joined(pictures):
    """The windows of a panel beside each other, light above dark."""
    rows = []
    for theme in ("light", "dark"):
        windows = [Image.open(pictures[width, theme]).convert("RGB") for width, _ in SIZES]
        windows = [window.resize([round(SCALE * side) for side in window.size], Image.Resampling.LANCZOS) for window in windows]
        rows.append(windows)
    width = sum(window.width for window in rows[0]) + GAP * (len(rows[0]) - 1)
    height = max(window.height for window in rows[0])
    sheet = Image.new("RGB", (width, 2 * height + GAP), (128, 128, 124))
    for y, windows in enumerate(rows):
        x = 0
        for window in windows:
            sheet.paste(window, (x, y * (height + GAP)))
            x += window.width + GAP
    return sheet


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("program", nargs="?", default=ROOT / "target" / "release" / "loden", type=pathlib.Path)
    parser.add_argument("--keep", type=pathlib.Path)
    parser.add_argument("--only", default="")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = given.keep or pathlib.Path(name)
        folder.mkdir(parents=True, exist_ok=True)
        program = given.program.absolute()
        data = folder / "data" if (folder / "data").exists() else prepared(program, folder)
        taken(program, data, folder, given.only)
        panels = sorted({path.name.rsplit("-", 2)[0] for path in folder.glob("*-*-*.png")})
        for panel in panels:
            pictures = {(width, theme): folder / f"{panel}-{width}-{theme}.png" for width, _ in SIZES for theme in ("light", "dark")}
            if all(path.exists() for path in pictures.values()):
                joined(pictures).save(HERE / f"studio-{panel}.jpg", quality=80, optimize=True)
        print(f"{len(panels)} panels, {sum(path.stat().st_size for path in HERE.glob('studio-*.jpg')) / 1e6:.2f} MB")


main()
