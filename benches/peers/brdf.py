"""Mitsuba 3's `measured` (llvm) on random pairs of directions: python brdf.py FILE.bsdf. Prints one JSON line.

As in `benches/brdf.rs`, both directions of a pair are uniform over the hemisphere. Pairs are in memory before the clock
starts, values when it stops; compilation is not counted.
"""

import glob
import json
import os
import sys
import time

if "DRJIT_LIBLLVM_PATH" not in os.environ:
    found = sorted(glob.glob("/usr/lib/*/libLLVM*.so*") + glob.glob("/usr/lib/llvm-*/lib/libLLVM*.so*"))
    if found:
        os.environ["DRJIT_LIBLLVM_PATH"] = found[-1]

import drjit as dr
import mitsuba as mi
import numpy as np

mi.set_variant("llvm_ad_rgb")

COUNT, RUNS = 1 << 20, 15


def directions(random):
    z, phi = random.uniform(0, 1, COUNT), random.uniform(0, 2 * np.pi, COUNT)
    r = np.sqrt(1 - z * z)
    return mi.Vector3f(*(v.astype(np.float32) for v in (r * np.cos(phi), r * np.sin(phi), z)))


def main():
    dr.set_thread_count(2)
    bsdf = mi.load_dict({"type": "measured", "filename": sys.argv[1]})
    random = np.random.default_rng(1)
    pairs = directions(random), directions(random)
    dr.eval(*pairs)
    dr.sync_thread()

    def evaluate():
        si = dr.zeros(mi.SurfaceInteraction3f, COUNT)
        si.wi = pairs[0]
        value = bsdf.eval(mi.BSDFContext(), si, pairs[1])
        dr.eval(value)
        dr.sync_thread()
        return value

    value, seconds = evaluate(), []
    for _ in range(RUNS):
        start = time.perf_counter()
        evaluate()
        seconds.append(time.perf_counter() - start)
    print(json.dumps({"bench": "brdf", "table": "rgl", "evaluations_per_second": COUNT / min(seconds),
                      "mean": float(dr.mean(dr.mean(value))[0])}))


main()
