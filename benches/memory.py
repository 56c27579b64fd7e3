#!/usr/bin/env python3
"""Compresses a BTF much larger than memory within a budget, and prints peak memory and time.

usage: python benches/memory.py FOLDER [--side 1024] [--directions 64] [--memory 2G] [--methods klt,pvmf,pca] [--threads N]

FOLDER receives the raw array, side^2 x directions^2 x 3 bytes (12.9 GB), and the compressed files; an existing array of
the same size is used again. NumPy generates the material: a bumpy, spotted, shiny surface with noise. The peak is the
largest resident size of the process, including pages of the mapped array. Exits with 1 if a peak exceeds the budget.
"""
import argparse
import json
import os
import pathlib
import re
import subprocess
import sys
import time

import numpy as np

LODEN = "target/release/loden"


def angles(count):
    """A spiral of directions up to 75 degrees from the normal, as (polar angle, azimuth)."""
    k = np.arange(count)
    return np.stack([75 * np.sqrt((k + 0.5) / count), (k * 137.50776) % 360], 1)


def vectors(degrees):
    t, p = np.radians(degrees).T
    return np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], 1).astype(np.float32)


def surface(side, random):
    """Normals, colours and exponents of texels: sums of waves of all sizes, periodic at the borders."""
    y, x = np.mgrid[:side, :side] * np.float32(2 * np.pi / side)
    slopes = np.zeros((2, side, side), np.float32)
    spots = np.zeros((side, side), np.float32)
    for _ in range(48):
        f = np.round(random.uniform(-1, 1, 2) * random.choice([8, 32, 96])).astype(np.float32)
        phase = f[0] * x + f[1] * y + np.float32(random.uniform(0, 6.28))
        slopes += f[:, None, None] / (1 + np.abs(f).sum()) * np.cos(phase)
        spots += np.sin(phase + 1.3) / np.sqrt(1 + np.abs(f).sum())
    normals = np.stack([-0.12 * slopes[0], -0.12 * slopes[1], np.ones_like(spots)])
    normals /= np.linalg.norm(normals, axis=0)
    share = 1 / (1 + np.exp(-4 * spots))[..., None]
    colours = share * np.float32([0.5, 0.2, 0.1]) + (1 - share) * np.float32([0.1, 0.25, 0.4])
    return normals.reshape(3, -1), colours.reshape(-1, 3), (share * 60 + 8).ravel()


def generate(data, side, degrees):
    random = np.random.default_rng(1)
    normals, colours, exponents = surface(side, random)
    directions = vectors(degrees)
    grain = random.integers(-2, 3, (side * side + 4096, 3), np.int16)
    with open(data, "wb") as file:
        for v in directions:
            for light in directions:
                half = (v + light) / np.linalg.norm(v + light)
                diffuse = np.maximum(light @ normals, 0)
                shine = 0.3 * np.exp(exponents * (np.maximum(half @ normals, 1e-3) - 1)) * (diffuse > 0)
                linear = np.clip(colours * diffuse[:, None] + shine[:, None], 0, 1)
                shift = random.integers(4096)
                noisy = (255 * np.sqrt(linear)).astype(np.int16) + grain[shift:shift + side * side]
                file.write(np.clip(noisy, 0, 255).astype(np.uint8))


def source(folder, side, count):
    degrees = angles(count)
    toml, data = folder / "large.toml", folder / "large.u8"
    size = side * side * count * count * 3
    if not data.exists() or data.stat().st_size != size:
        start = time.time()
        generate(data, side, degrees)
        print(json.dumps({"generated_bytes": size, "seconds": round(time.time() - start, 1)}), flush=True)
    rows = [[round(float(a), 4) for a in row] for row in degrees]
    toml.write_text(f'loden_raw = 1\ndata = "large.u8"\ntype = "u8"\nshape = [{count}, {count}, {side}, {side}, 3]\n'
                    f'views = {rows}\nlights = {rows}\nencoding = "gamma2"\ncosine = "included"\n')
    return toml


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--side", type=int, default=1024)
    parser.add_argument("--directions", type=int, default=64)
    parser.add_argument("--memory", default="2G")
    parser.add_argument("--methods", default="klt,pvmf,pca")
    parser.add_argument("--threads")
    options = parser.parse_args()
    file = source(options.folder, options.side, options.directions)
    number, unit = re.fullmatch(r"(\d+)([KMG]?)", options.memory).groups()
    budget = int(number) << {"": 0, "K": 10, "M": 20, "G": 30}[unit]
    holds = []
    for method in options.methods.split(","):
        output = options.folder / f"{method}.loden"
        command = [LODEN, "compress", file, "--method", method, "-o", output, "--memory", options.memory, "--json", "--quiet", "--force"]
        command += ["--threads", options.threads] if options.threads else []
        start = time.time()
        child = subprocess.Popen([str(word) for word in command], stdout=subprocess.PIPE)
        text = child.stdout.read()
        _, status, usage = os.wait4(child.pid, 0)
        if status:
            sys.exit(1)
        row, peak = json.loads(text), usage.ru_maxrss * 1024
        holds.append(peak <= budget)
        print(json.dumps({"method": method, "raw_bytes": file.with_suffix(".u8").stat().st_size, "bytes": row["bytes"],
                          "mean_error": row["error"]["mean_abs_error"], "encode_s": round(row["encode_s"], 1),
                          "all_s": round(time.time() - start, 1),
                          "processor_s": round(usage.ru_utime + usage.ru_stime, 1), "peak_mib": round(peak / 2**20), "budget_mib": budget >> 20,
                          "holds": holds[-1]}), flush=True)
    sys.exit(0 if all(holds) else 1)


main()
