#!/usr/bin/env python3
"""Checks FLIP of `loden render --sheet` against a transcription with filters in two dimensions, by NumPy and SciPy.

usage: python tests/python/flip_vs_numpy.py

The pictures are those of the sheet, in single precision. Exits with 1 if a value differs by more than 1e-4.
"""
import json
import pathlib
import subprocess
import sys
import tempfile

import mitsuba
import numpy as np
from scipy.ndimage import convolve

LODEN = "target/release/loden"
# the head holds names
WIDTH, HEIGHT, GAP, HEAD = 120, 80, 6, 11
TOLERANCE = 1e-4
PPD = 0.7 * 3840 / 0.7 * np.pi / 180
XYZ = np.array([[0.4123908, 0.3575843, 0.1804808], [0.2126390, 0.7151687, 0.0721923], [0.0193308, 0.1191948, 0.9505322]])
WHITE = XYZ.sum(1)


def loden(*arguments):
    done = subprocess.run([LODEN, *map(str, arguments), "--json", "--force"], check=True, stdout=subprocess.PIPE)
    return json.loads(done.stdout)


def squares(radius):
    y, x = np.mgrid[-radius:radius + 1, -radius:radius + 1].astype(float)
    return x, x ** 2 + y ** 2


def ycxcz(rgb):
    x, y, z = np.moveaxis(rgb @ XYZ.T / WHITE, -1, 0)
    return [116 * y - 16, 500 * (x - y), 200 * (y - z)]


def rgb_of(planes):
    y = (planes[0] + 16) / 116
    xyz = np.stack([y + planes[1] / 500, y, y - planes[2] / 200], -1)
    return np.clip(xyz * WHITE @ np.linalg.inv(XYZ).T, 0, 1)


def hunt(rgb):
    t = rgb @ XYZ.T / WHITE
    f = np.where(t > (6 / 29) ** 3, np.cbrt(t), t / (3 * (6 / 29) ** 2) + 4 / 29)
    x, y, z = np.moveaxis(f, -1, 0)
    lightness = 116 * y - 16
    return np.stack([lightness, 0.01 * lightness * 500 * (x - y), 0.01 * lightness * 200 * (y - z)], -1)


def hyab(a, b):
    d = a - b
    return np.abs(d[..., 0]) + np.sqrt((d[..., 1:] ** 2).sum(-1))


def blurred(planes):
    radius = int(np.ceil(3 * np.sqrt(0.04 / (2 * np.pi ** 2)) * PPD))
    z = squares(radius)[1] / PPD ** 2
    out = []
    for plane, terms in zip(planes, [[(1, 0.0047)], [(1, 0.0053)], [(34.1, 0.04), (13.5, 0.025)]]):
        kernel = sum(a * np.sqrt(np.pi / b) * np.exp(-np.pi ** 2 * z / b) for a, b in terms)
        out.append(convolve(plane, kernel / kernel.sum(), mode="nearest"))
    return out


def strength(lightness, point):
    sigma = 0.5 * 0.082 * PPD
    x, z = squares(int(np.ceil(3 * sigma)))
    gaussian = np.exp(-z / (2 * sigma ** 2))
    kernel = (x ** 2 / sigma ** 2 - 1) * gaussian if point else -x * gaussian
    kernel = np.where(kernel > 0, kernel / kernel[kernel > 0].sum(), -kernel / kernel[kernel < 0].sum())
    return np.hypot(*(convolve(lightness, k, mode="nearest") for k in (kernel, kernel.T)))


def flip(reference, test):
    planes = [ycxcz(np.clip(rgb.astype(np.float64), 0, 1)) for rgb in (reference, test)]
    a, b = (hunt(rgb_of(blurred(p))) for p in planes)
    most = hyab(hunt(np.array([0.0, 1, 0])), hunt(np.array([0.0, 0, 1]))) ** 0.7
    colour = hyab(a, b) ** 0.7
    colour = np.where(colour < 0.4 * most, 0.95 / (0.4 * most) * colour,
                      0.95 + (colour - 0.4 * most) / (0.6 * most) * 0.05)
    feature = [np.abs(np.subtract(*(strength((p[0] + 16) / 116, point) for p in planes))) for point in (False, True)]
    return float((colour ** (1 - (np.maximum(*feature) / np.sqrt(2)) ** 0.5)).mean())


def main():
    mitsuba.set_variant("scalar_rgb")
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        source = folder / "lacquer.zip"
        loden("acquire", "lacquer", "--size", 16, "--spp", 1, "-o", source)
        files = [folder / f"{c}.loden" for c in (1, 6)]
        for c, file in zip((1, 6), files):
            loden("compress", source, "--method", "pvmf", "--components", c, "-o", file, "--no-error")
        rows = loden("render", "--sheet", source, *files, "--object", "teapot", "--size", f"{WIDTH}x{HEIGHT}",
                     "--spp", 16, "-o", folder / "sheet.exr")
        sheet = np.array(mitsuba.Bitmap(str(folder / "sheet.exr")))[..., :3]
        pictures = [sheet[HEAD:HEAD + HEIGHT, k * (WIDTH + GAP):][:, :WIDTH] for k in range(3)]
        if len(sys.argv) > 1:
            np.save(sys.argv[1], np.stack(pictures))
        holds = []
        for row, picture in zip(rows, pictures[1:]):
            numpys = flip(pictures[0], picture)
            holds.append(abs(row["flip"] - numpys) <= TOLERANCE and numpys > 10 * TOLERANCE)
            print(json.dumps({"flip": row["flip"], "numpy": numpys, "holds": holds[-1]}), flush=True)
    sys.exit(0 if all(holds) else 1)


main()
