#!/usr/bin/env python3
"""numba peer of the evaluation benchmark: single texels at continuous directions from PVMF factors, on one core.

usage: python benches/peers/evaluate.py FILE.loden

The same work as a `FactoredMaterial` at the centres of texels: a table of starting triangles, a walk in the triangulation, weights of
the triangle for light and view, nine products of four components, then linear light (gamma 1.6 by a table).
Coefficients are stored as (texel, view, component), the basis as (view, light, mean and components, rgb), all in single
precision, which is fastest in numba.
"""
import json
import os
import sys
import time

import numba
import numpy as np
from safetensors.numpy import load_file
from scipy.spatial import ConvexHull

GRID, QUERIES = 64, 2_000_000


def directions():
    rings = [(0, 1), (15, 6), (30, 12), (45, 18), (60, 20), (75, 24)]
    degrees = np.array([(t, 360 * k / n) for t, n in rings for k in range(n)])
    t, p = np.radians(degrees.T)
    return np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], 1)


def triangulation(points):
    """Triangles, their neighbours (-1 outside), inverse matrices, and the starting triangle of each grid cell."""
    plane = points[:, :2] / (1 + points[:, 2:])
    from scipy.spatial import Delaunay

    mesh = Delaunay(plane)
    inverse = np.linalg.inv(points[mesh.simplices].transpose(0, 2, 1))
    middles = points[mesh.simplices].sum(1)
    middles /= np.linalg.norm(middles, axis=1, keepdims=True)
    x = (np.arange(GRID) + 0.5) * 2 / GRID - 1
    w = np.stack([*np.meshgrid(x, x)], -1)
    w = np.concatenate([w, np.sqrt(np.maximum(0, 1 - (w**2).sum(-1, keepdims=True)))], -1).reshape(-1, 3)
    start = (w @ middles.T).argmax(1)
    hull = ConvexHull(plane).vertices
    return mesh.simplices, mesh.neighbors, inverse, start, hull


def tables(points):
    """What `stencil` needs of directions, in the types that are fastest."""
    triangles, neighbours, inverse, start, hull = triangulation(points)
    phi = np.arctan2(points[hull, 1], points[hull, 0]) % (2 * np.pi)
    order = np.argsort(phi)
    return (triangles.astype(np.int32), neighbours.astype(np.int32), inverse.astype(np.float32), start.astype(np.int32),
            hull[order].astype(np.int32), phi[order].astype(np.float32), points.astype(np.float32))


@numba.njit(fastmath=True, inline="always")
def stencil(w0, w1, w2, triangles, neighbours, inverse, start, hull, hull_phi, points, index, weight):
    """Fills three indices and weights, returns the fade below the last ring."""
    cx = min(int((w0 + 1) * (GRID / 2)), GRID - 1)
    cy = min(int((w1 + 1) * (GRID / 2)), GRID - 1)
    t = start[cy * GRID + cx]
    while True:
        a = inverse[t, 0, 0] * w0 + inverse[t, 0, 1] * w1 + inverse[t, 0, 2] * w2
        b = inverse[t, 1, 0] * w0 + inverse[t, 1, 1] * w1 + inverse[t, 1, 2] * w2
        c = inverse[t, 2, 0] * w0 + inverse[t, 2, 1] * w1 + inverse[t, 2, 2] * w2
        k, lowest = 0, a
        if b < lowest:
            k, lowest = 1, b
        if c < lowest:
            k, lowest = 2, c
        if lowest >= -1e-6:
            s = 1 / (a + b + c)
            for i in range(3):
                index[i] = triangles[t, i]
            weight[0], weight[1], weight[2] = a * s, b * s, c * s
            return np.float32(1)
        t = neighbours[t, k]
        if t < 0:
            break
    # use the same meridian on the last ring, whose samples are evenly spaced
    phi = np.arctan2(w1, w0)
    if phi < 0:
        phi += np.float32(2 * np.pi)
    n = hull.shape[0]
    x = phi * (n / np.float32(2 * np.pi))
    i = min(int(x), n - 1)
    p, q = hull[i], hull[(i + 1) % n]
    left = points[p, 0] * w1 - points[p, 1] * w0
    right = w0 * points[q, 1] - w1 * points[q, 0]
    f = left / (left + right)
    index[0], index[1], index[2] = p, q, p
    weight[0], weight[1], weight[2] = 1 - f, f, 0
    return w2 / points[p, 2]


@numba.njit(fastmath=True)
def evaluate(texels, wi, wo, coefficients, basis, curve, mesh, out):
    triangles, neighbours, inverse, start, hull, hull_phi, points = mesh
    li, vi = np.empty(3, np.int32), np.empty(3, np.int32)
    lw, vw = np.empty(3, np.float32), np.empty(3, np.float32)
    for q in range(texels.shape[0]):
        fade = stencil(wi[q, 0], wi[q, 1], wi[q, 2], triangles, neighbours, inverse, start, hull, hull_phi, points, li, lw)
        stencil(wo[q, 0], wo[q, 1], wo[q, 2], triangles, neighbours, inverse, start, hull, hull_phi, points, vi, vw)
        r = g = b = np.float32(0)
        for i in range(3):
            a0 = coefficients[texels[q], vi[i], 0]
            a1 = coefficients[texels[q], vi[i], 1]
            a2 = coefficients[texels[q], vi[i], 2]
            a3 = coefficients[texels[q], vi[i], 3]
            for j in range(3):
                m = basis[vi[i], li[j]]
                w = vw[i] * lw[j]
                r += w * (m[0, 0] + a0 * m[1, 0] + a1 * m[2, 0] + a2 * m[3, 0] + a3 * m[4, 0])
                g += w * (m[0, 1] + a0 * m[1, 1] + a1 * m[2, 1] + a2 * m[3, 1] + a3 * m[4, 1])
                b += w * (m[0, 2] + a0 * m[1, 2] + a1 * m[2, 2] + a2 * m[3, 2] + a3 * m[4, 2])
        for c in range(3):
            v = r if c == 0 else g if c == 1 else b
            x = min(max(v, np.float32(0)), np.float32(1)) * np.float32(1024)
            i = min(int(x), 1023)
            out[q, c] = fade * (curve[i] + (x - i) * (curve[i + 1] - curve[i]))


def main():
    stored = load_file(sys.argv[1])
    mean, basis = stored["mean"], stored["basis"].astype(np.float32)
    views, components, lights, _ = basis.shape
    table = np.concatenate([mean[:, None], basis], 1).transpose(0, 2, 1, 3).copy()
    coefficients = stored["coefficients"].astype(np.float32).reshape(views, -1, components).transpose(1, 0, 2).copy()
    mesh = tables(directions())
    random = np.random.default_rng(1)

    def cosine():
        p = random.random((QUERIES, 2))
        r, phi = np.sqrt(p[:, 0]), 2 * np.pi * p[:, 1]
        return np.stack([r * np.cos(phi), r * np.sin(phi), np.sqrt(1 - p[:, 0])], 1).astype(np.float32)

    texels = (np.arange(QUERIES, dtype=np.uint64) * 2654435761 % coefficients.shape[0]).astype(np.int32)
    curve = (np.linspace(0, 1, 1025) ** 1.6).astype(np.float32)
    args = (texels, cosine(), cosine(), coefficients, table, curve, mesh, np.empty((QUERIES, 3), np.float32))
    evaluate(*args)
    repeat = max(3, int(os.environ.get("LODEN_BENCH_REPEAT", "1")))
    seconds, processor = [], []
    for _ in range(repeat):
        start, start_cpu = time.perf_counter(), time.process_time()
        evaluate(*args)
        seconds.append(time.perf_counter() - start)
        processor.append(time.process_time() - start_cpu)
    print(json.dumps({"work": "pvmf evaluate", "precision": "f32",
                      "evaluations_per_second_per_core": QUERIES / min(seconds),
                      "evaluations_per_processor_second": QUERIES / min(processor),
                      "mean": args[-1].mean(0).tolist()}))


if __name__ == "__main__":
    main()
