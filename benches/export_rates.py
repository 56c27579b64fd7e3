"""Samples a second of exported materials in Mitsuba 3, beside its own `roughconductor`, in one run.

Usage: python benches/export_rates.py VARIANT FOLDER..., folders that `loden export --to mitsuba` wrote. Prints a JSON line for each.

A ball under a constant environment, direct light, 64 samples a pixel; the fastest of five renderings, without the first, which compiles.
LODEN_BENCH_SIZE is the side of the picture in pixels, 1024 by default.
"""

import json
import os
import sys
import time

import drjit as dr
import mitsuba as mi

SIZE, SPP, RUNS = int(os.environ.get("LODEN_BENCH_SIZE", 1024)), 64, 6


def scene(bsdf):
    return mi.load_dict({
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 2},
        "sensor": {
            "type": "perspective",
            "fov": 28,
            "to_world": mi.ScalarTransform4f().look_at(origin=[0, -5, 2], target=[0, 0, 0], up=[0, 0, 1]),
            "film": {"type": "hdrfilm", "width": SIZE, "height": SIZE},
            "sampler": {"type": "independent", "sample_count": SPP},
        },
        "environment": {"type": "constant", "radiance": 1.0},
        "ball": {"type": "sphere", "bsdf": bsdf},
    })


def seconds(bsdf):
    built, times = scene(bsdf), []
    for seed in range(RUNS):
        start = time.perf_counter()
        dr.eval(mi.render(built, seed=seed))
        dr.sync_thread()
        times.append(time.perf_counter() - start)
    return min(times[1:])


def main():
    variant, *folders = sys.argv[1:]
    mi.set_variant(variant)
    sys.path.insert(0, folders[0])
    import loden_btf  # noqa: F401, registers the BSDF

    peer = seconds({"type": "roughconductor", "alpha": 0.2})
    for name in ["roughconductor", *folders]:
        found = peer if name == "roughconductor" else seconds({"type": "loden_btf", "folder": name})
        rate = SIZE * SIZE * SPP / found
        print(json.dumps({"bsdf": name, "variant": variant, "samples_per_second": rate, "of_roughconductor": peer / found}), flush=True)


main()
