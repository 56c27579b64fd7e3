"""A BTF plug-in for Mitsuba 3 in Python: the k nearest photographs, blended by NumPy between the wavefronts.

Usage: python btf_plugin.py RAW.toml [--spp N] [--repeat N] [--nearest K] [-o PICTURE.exr]. RAW.toml is a raw array (`loden
convert`) of 8-bit values. Renders the ball of `render.py` with a direction set on both sides and prints one line of JSON: samples
per second of the fastest run, and peak memory. It is written from the documentation of public plug-ins of this kind and shares no
code with them.

A pair of directions is a point in six dimensions, light and view. A k-d tree of all measured pairs gives the nearest ones; the
texel of each photograph at the coordinate is read, converted to linear light by a table, and weighted by the inverse distance.
Directions are sampled in proportion to the cosine.
"""

import argparse
import json
import os
import pathlib
import resource
import tempfile
import time
import tomllib

import drjit as dr
import mitsuba as mi
import numpy as np
from scipy.spatial import cKDTree

mi.set_variant("llvm_ad_rgb")

import render as ball  # noqa: E402  the ball of the diffuse race

RINGS = {"bonn81": [(0, 1), (15, 6), (30, 12), (45, 18), (60, 20), (75, 24)]}
UV_SCALE = 4


def vectors(named):
    """Unit vectors of a direction set, by name or as a list of (polar angle, azimuth) in degrees."""
    degrees = [(t, 360 * k / n) for t, n in RINGS[named] for k in range(n)] if isinstance(named, str) else named
    t, p = np.radians(np.array(degrees, float)).T
    return np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], -1)


def to_linear(encoding):
    """A table of linear light for the 256 values of a photograph."""
    x = np.arange(256) / 255
    if encoding == "srgb":
        x = np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4)
    elif encoding.startswith("gamma"):
        x = x ** float(encoding.removeprefix("gamma"))
    return x.astype(np.float32)


class Photographs:
    """All images in memory, (view, light, row, column, rgb), and a tree of their directions."""

    def __init__(self, path, nearest):
        stated = tomllib.loads(path.read_text())
        if stated["type"] != "u8" or stated["cosine"] != "included":
            raise SystemExit(f"{path}: found type {stated['type']}, cosine {stated['cosine']}, expected u8 and included")
        self.shape, self.nearest = stated["shape"], nearest
        data = np.fromfile(path.with_name(stated["data"]), np.uint8)
        self.texels = data.reshape(self.shape[0] * self.shape[1], -1, 3)
        views, lights = vectors(stated["views"]), vectors(stated["lights"])
        pairs = np.concatenate([np.repeat(views, len(lights), 0), np.tile(lights, (len(views), 1))], 1)
        self.tree, self.linear = cKDTree(pairs), to_linear(stated["encoding"])

    def apparent(self, uv, light, view):
        """pi L / E at (N, 2) coordinates for (N, 3) directions: (N, 3)."""
        rows, columns = self.shape[2:4]
        x = np.minimum((uv[:, 0] % 1 * columns).astype(np.int64), columns - 1)
        y = np.minimum(((1 - uv[:, 1] % 1) * rows).astype(np.int64), rows - 1)
        distance, pair = self.tree.query(np.concatenate([view, light], 1), self.nearest, workers=-1)
        distance, pair = (array.reshape(len(uv), self.nearest) for array in (distance, pair))
        weight = 1 / np.maximum(distance, 1e-6)
        weight /= weight.sum(1, keepdims=True)
        values = self.linear[self.texels[pair, (y * columns + x)[:, None]]]
        return np.einsum("nk,nkc->nc", weight.astype(np.float32), values)


class MeasuredBtf(mi.BSDF):
    """A BSDF evaluated by NumPy while Mitsuba waits; needs loops and calls that are not recorded."""

    photographs = None

    def __init__(self, props):
        super().__init__(props)
        self.m_flags = mi.BSDFFlags.DiffuseReflection | mi.BSDFFlags.FrontSide
        self.m_components = [self.m_flags]

    def value(self, si, wo, active):
        """Mitsuba's `wi` points to the viewer and `wo` to the light; its values contain the cosine, as ours do."""
        lit = np.array(active & (si.wi.z > 0) & (wo.z > 0))
        out = np.zeros((3, len(lit)), np.float32)
        if lit.any():
            uv, view, light = (np.array(v).T[lit] for v in (UV_SCALE * si.uv, si.wi, wo))
            out[:, lit] = self.photographs.apparent(uv, light, view).T
        return mi.Color3f(out) / dr.pi

    def density(self, si, wo):
        both = (si.wi.z > 0) & (wo.z > 0)
        return dr.select(both, mi.warp.square_to_cosine_hemisphere_pdf(wo), 0)

    def eval(self, ctx, si, wo, active=True):
        return self.value(si, wo, mi.Bool(active) & dr.full(mi.Bool, True, dr.width(wo)))

    def pdf(self, ctx, si, wo, active=True):
        return dr.select(active, self.density(si, wo), 0)

    def eval_pdf(self, ctx, si, wo, active=True):
        return self.eval(ctx, si, wo, active), self.pdf(ctx, si, wo, active)

    def sample(self, ctx, si, sample1, sample2, active=True):
        found = mi.BSDFSample3f()
        found.wo = mi.warp.square_to_cosine_hemisphere(sample2)
        found.pdf = self.density(si, found.wo)
        found.eta = 1
        found.sampled_type = mi.UInt32(+mi.BSDFFlags.DiffuseReflection)
        found.sampled_component = 0
        active &= found.pdf > 0
        value = self.eval(ctx, si, found.wo, active) / dr.maximum(found.pdf, 1e-9)
        return found, dr.select(active, value, 0)

    def to_string(self):
        return "MeasuredBtf"


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("raw", type=pathlib.Path)
    parser.add_argument("--spp", type=int, default=4)
    parser.add_argument("--repeat", type=int, default=2)
    parser.add_argument("--nearest", type=int, default=4)
    parser.add_argument("-o", "--output")
    arguments = parser.parse_args()
    for flag in (dr.JitFlag.SymbolicCalls, dr.JitFlag.SymbolicLoops, dr.JitFlag.SymbolicConditionals):
        dr.set_flag(flag, False)
    MeasuredBtf.photographs = Photographs(arguments.raw, arguments.nearest)
    mi.register_bsdf("photographs", MeasuredBtf)
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "ball.obj")
        ball.write_ball(path)
        loaded = ball.scene(path, {"type": "photographs"}, arguments.spp)
        rates = []
        for repeat in range(arguments.repeat):
            start = time.perf_counter()
            picture = mi.render(loaded, seed=repeat)
            mean = float(np.array(picture).mean())
            rates.append(512 * 512 * arguments.spp / (time.perf_counter() - start))
    if arguments.output:
        mi.util.write_bitmap(arguments.output, picture)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    print(json.dumps({"work": "btf plugin", "samples_per_s": max(rates), "peak_rss_bytes": peak, "mean": mean}))


if __name__ == "__main__":
    main()
