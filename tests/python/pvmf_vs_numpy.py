#!/usr/bin/env python3
"""Checks a PVMF file against a per-view PCA by NumPy of the same images.

usage: python tests/python/pvmf_vs_numpy.py [FILE.loden RAW.u8]

RAW.u8 holds the source's 8-bit texels, shape (view, light, y, x, rgb). The file, in the domain `display`, is decoded
here with nothing but NumPy and safetensors, as docs/format.md describes it. Its mean absolute error must not differ
from that of NumPy's own components by more than 0.0002. Exits with 1 if it does. Without arguments the built program makes
such files from the reference measurements (LODEN_DATA), or from a simulated sample.
"""
import json
import os
import pathlib
import subprocess
import sys
import tempfile

import numpy as np
from safetensors import safe_open

TOLERANCE = 0.0002
LODEN = "target/release/loden"


def directions(stored):
    return {"bonn81": 81, "ubo2014": 151}[stored] if isinstance(stored, str) else len(stored)


def decode(tensors, view):
    """All images of a view as a matrix texels x (light, rgb)."""
    coefficients = tensors["coefficients"][view].astype(np.float32)
    coefficients = coefficients.reshape(-1, coefficients.shape[-1])
    if "coefficients_range" in tensors:
        offset, scale = tensors["coefficients_range"][view].T
        coefficients = offset + scale * coefficients
    basis = tensors["basis"][view].astype(np.float32)
    return tensors["mean"][view].reshape(1, -1) + coefficients @ basis.reshape(basis.shape[0], -1)


def best(matrix, components):
    """The best approximation of this rank around the mean."""
    mean = matrix.mean(0)
    centred = (matrix - mean).astype(np.float64)
    _, vectors = np.linalg.eigh(centred.T @ centred)
    basis = vectors[:, ::-1][:, :components]
    return mean + (centred @ basis) @ basis.T


def error(matrix, decoded):
    return float(np.abs(np.clip(decoded, 0, 1) - matrix).mean(dtype=np.float64))


def check(loden_file, raw_file, reported=None):
    """Prints both errors of a file; whether they, and the one that loden reports, agree."""
    with safe_open(loden_file, "numpy") as file:
        metadata = file.metadata()
        tensors = {name: file.get_tensor(name) for name in file.keys()}
    btf, params = json.loads(metadata["btf"]), json.loads(metadata["params"])
    assert (metadata["method"], params["domain"]) == ("pvmf", "display"), metadata
    views, lights = directions(btf["views"]), directions(btf["lights"])
    raw = np.memmap(raw_file, np.uint8, "r", shape=(views, lights, btf["height"] * btf["width"], 3))
    ours, numpys = [], []
    for view in range(views):
        matrix = raw[view].transpose(1, 0, 2).reshape(-1, 3 * lights).astype(np.float32) / 255
        ours.append(error(matrix, decode(tensors, view)))
        numpys.append(error(matrix, best(matrix, int(params["components"]))))
    found, expected = np.mean(ours), np.mean(numpys)
    print(json.dumps({"file": str(loden_file), "mean_abs_error": found, "numpy": expected, "reported": reported}), flush=True)
    return abs(found - expected) <= TOLERANCE and (reported is None or abs(reported - expected) <= TOLERANCE)


def loden(*arguments):
    done = subprocess.run([LODEN, *map(str, arguments), "--json", "--force"], check=True, stdout=subprocess.PIPE)
    return json.loads(done.stdout)


def check_sources(folder):
    """Checks c = 4 and 9 for the reference measurements, or for a simulated sample without them."""
    data = os.environ.get("LODEN_DATA")
    if data:
        sources = [pathlib.Path(data, "btf", name) for name in ("twill.zip", "pebble.zip")]
    else:
        sources = [folder / "gravel.zip"]
        loden("acquire", "gravel", "--size", "24", "--spp", "2", "-o", sources[0])
    for source in sources:
        raw = folder / f"{source.stem}.toml"
        loden("convert", source, raw)
        for components, precision in ((4, "f32"), (9, "f16"), (9, "u8")):
            file = folder / f"{source.stem}-{components}-{precision}.loden"
            loden("compress", source, "--method", "pvmf", "--components", components, "--precision", precision, "-o", file)
            row = loden("compare", source, file)[0]
            yield check(file, raw.with_suffix(".u8"), row["mean_abs_error"])


def main():
    if len(sys.argv) == 3:
        sys.exit(0 if check(sys.argv[1], sys.argv[2]) else 1)
    with tempfile.TemporaryDirectory() as folder:
        sys.exit(0 if all(list(check_sources(pathlib.Path(folder)))) else 1)


main()
