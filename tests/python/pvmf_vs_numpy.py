#!/usr/bin/env python3
"""Checks a PVMF file against a per-view PCA by NumPy of the same images.

usage: python tests/python/pvmf_vs_numpy.py FILE.loden RAW.u8

RAW.u8 holds the source's 8-bit texels, shape (view, light, y, x, rgb). The file, in the domain `display`, is decoded
here with nothing but NumPy and safetensors, as docs/format.md describes it. Its mean absolute error must not differ
from that of NumPy's own components by more than 0.0002. Exits with 1 if it does.
"""
import json
import sys

import numpy as np
from safetensors import safe_open

TOLERANCE = 0.0002


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


def main():
    with safe_open(sys.argv[1], "numpy") as file:
        metadata = file.metadata()
        tensors = {name: file.get_tensor(name) for name in file.keys()}
    btf, params = json.loads(metadata["btf"]), json.loads(metadata["params"])
    assert (metadata["method"], params["domain"]) == ("pvmf", "display"), metadata
    views, lights = directions(btf["views"]), directions(btf["lights"])
    raw = np.memmap(sys.argv[2], np.uint8, "r", shape=(views, lights, btf["height"] * btf["width"], 3))
    ours, numpys = [], []
    for view in range(views):
        matrix = raw[view].transpose(1, 0, 2).reshape(-1, 3 * lights).astype(np.float32) / 255
        ours.append(error(matrix, decode(tensors, view)))
        numpys.append(error(matrix, best(matrix, int(params["components"]))))
    difference = abs(np.mean(ours) - np.mean(numpys))
    print(json.dumps({"components": int(params["components"]), "mean_abs_error": np.mean(ours),
                      "numpy_mean_abs_error": np.mean(numpys), "difference": difference}))
    sys.exit(0 if difference <= TOLERANCE else 1)


main()
