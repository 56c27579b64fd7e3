#!/usr/bin/env python3
"""Checks values of `neural` against NumPy, which follows docs/format.md from the parts of the file.

usage: python tests/python/neural_vs_numpy.py [PROGRAM]

The simulated sample gravel is compressed, with and without parallax. `loden decompress --parts` writes its planes and tables, and
`loden eval` its values at random points for directions within 70 degrees of the normal. NumPy evaluates the network at the same
points in double precision. The largest difference is at most 2e-5 of linear light; one exchanged angle, one wrong corner or
one weight in the wrong place gives more than that.

Exits with 1 if a check fails.
"""
import json
import pathlib
import subprocess
import sys
import tempfile

import mitsuba as mi
import numpy as np

import exports

mi.set_variant("scalar_rgb")
POINTS, TOLERANCE = 2000, 2e-5


def plane(folder, spec, ranges):
    """The values of a plane: (y, x, number)."""
    stored = np.array(mi.Bitmap(str(folder / f"{spec['name']}.exr")), np.float64)
    stored = stored.reshape(stored.shape[0], stored.shape[1], -1)
    offset, scale = ranges[spec["kind"]["numbers"]["range"]].astype(np.float64).T
    return offset + scale * stored


def bilinear(values, x, y):
    height, width = values.shape[:2]
    x0, y0 = np.floor(x), np.floor(y)
    fx, fy = (x - x0)[:, None], (y - y0)[:, None]
    at = lambda dx, dy: values[(y0 + dy).astype(int) % height, (x0 + dx).astype(int) % width]
    return (at(0, 0) * (1 - fx) + at(1, 0) * fx) * (1 - fy) + (at(0, 1) * (1 - fx) + at(1, 1) * fx) * fy


def unit(theta, phi):
    theta, phi = np.radians(theta.astype(np.float64)), np.radians(phi.astype(np.float64))
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1)


def angles(l, v):
    h = (l + v) / np.linalg.norm(l + v, axis=1, keepdims=True)
    (lx, ly, lz), (vx, vy, vz), (hx, hy, _) = l.T, v.T, h.T
    squares = [lx * lx, lx * ly, ly * ly, vx * vx, vx * vy, vy * vy]
    products = [lx * vx, lx * vy, ly * vx, ly * vy, hx * hx, hx * hy, hy * hy, lz * vz, (l * v).sum(1)]
    return np.column_stack([l, v, h, *squares, *products])


def evaluated(folder, points):
    """Linear light at the points, from the parts in a folder."""
    recipe = json.loads((folder / "recipe.json").read_text())["recipe"]
    tables = [np.load(folder / f"{spec['name']}.npy") for spec in recipe["tables"]]
    planes = [plane(folder, spec, tables) for spec in recipe["planes"]]
    height, width = planes[0].shape[:2]
    l, v = unit(points[:, 0], points[:, 1]), unit(points[:, 2], points[:, 3])
    x, y = points[:, 4].astype(np.float64) % 1 * width - 0.5, (1 - points[:, 5].astype(np.float64)) % 1 * height - 0.5
    value = recipe["value"]
    if "shift" in value:
        shift = value["shift"]
        heights, sign = planes[shift["height"]], 1 if shift.get("mirror") else -1
        sx, sy = v[:, 0] / np.maximum(v[:, 2], 0.1), sign * v[:, 1] / np.maximum(v[:, 2], 0.1)
        h = bilinear(heights, x, y)[:, 0]
        h = bilinear(heights, x + sx * h, y + sy * h)[:, 0]
        x, y, value = x + sx * h, y + sy * h, shift["value"]
    network = value["network"]
    numbers = np.column_stack([bilinear(planes[network["plane"]], x, y), angles(l, v)])
    for place, layer in enumerate(network["layers"]):
        numbers = np.column_stack([numbers, np.ones(len(numbers))]) @ tables[layer].astype(np.float64).T
        if place + 1 < len(network["layers"]):
            numbers = np.maximum(numbers, 0)
    assert recipe["curve"] == "display"
    numbers = np.clip(numbers, 0, network["most"])
    return np.where(numbers <= 0.04045, numbers / 12.92, ((numbers + 0.055) / 1.055) ** 2.4)


def main():
    program = sys.argv[1] if len(sys.argv) > 1 else "target/release/loden"
    run = lambda *words: subprocess.run([program, *words, "-q"], check=True, stdout=subprocess.DEVNULL)
    points = exports.random_points(POINTS, 3)
    points[:, [0, 2]] *= 70 / 90
    holds = True
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        run("acquire", "gravel", "--size", "24", "--spp", "4", "-o", folder / "gravel.zip")
        for name, more in (("parallax", []), ("flat", ["--flat", "yes"])):
            run("compress", folder / "gravel.zip", "--method", "neural", "--samples", "2", *more, "-o", folder / f"{name}.loden")
            run("decompress", folder / f"{name}.loden", "--parts", folder / name)
            values = exports.values_of(program, folder, f"{name}.loden", points)
            error = np.abs(evaluated(folder / name, points) - values)
            print(f"{name}: largest difference {error.max():.1e}, mean {error.mean():.1e}, of values up to {values.max():.2f}")
            holds &= bool(error.max() < TOLERANCE)
    sys.exit(not holds)


main()
