#!/usr/bin/env python3
"""Renders a BTF within a memory budget and with all of it in memory, and prints the rows of a Markdown table.

usage: python benches/out_of_core.py RAW.toml [--size 512] [--spp 16] [--budgets 256M,512M,1G]

Two scenes of one sphere. In `direct` light the three passes of the thesis' scheme (the program `three_passes`) are compared with
`--memory`; `studio` is that of `loden render --object`, with several reflections. Every picture under a budget has
to equal the one in memory bit by bit; that of the three passes has to agree within rounding. Seconds are for the whole
program. Exits with 1 if a picture differs.
"""
import argparse
import hashlib
import json
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent
RELEASE = ROOT / "target" / "release"

SCENE = """
size = [{size}, {size}]
samples = {spp}
depth = 2
background = 0
[camera]
position = [0, 0, 4]
target = [0, 0, 0]
field-of-view = 30
[[light]]
kind = "directional"
direction = [1, 2, 2]
irradiance = 3
[[shape]]
kind = "sphere"
material = "m"
uv-scale = 4
[material.m]
{material}
"""


def run(line):
    """Runs a program: its output, seconds and peak resident size."""
    start = time.time()
    child = subprocess.Popen([str(word) for word in line], stdout=subprocess.PIPE)
    text = child.stdout.read()
    _, status, usage = os.wait4(child.pid, 0)
    if status:
        sys.exit(1)
    return json.loads(text) | {"wall_s": time.time() - start, "peak": usage.ru_maxrss * 1024}


def scene(folder, name, options, material):
    file = folder / name
    file.write_text(SCENE.format(size=options.size, spp=options.spp, material=material))
    return file


def linear(file):
    import mitsuba as mi
    import numpy as np

    mi.set_variant("scalar_rgb")
    return np.array(mi.Bitmap(str(file)).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32))


class Table:
    def __init__(self):
        self.first, self.same = {}, True
        print("| light | memory | seconds | tracing | peak | read | picture |\n|---|---|---|---|---|---|---|")

    def row(self, light, name, found, picture, budget=None):
        digest = hashlib.sha256(picture.read_bytes()).digest()
        base = self.first.setdefault(light, (digest, found["wall_s"], picture))
        if name == "three passes":
            apart = float(abs(linear(picture) - linear(base[2])).max())
            self.same &= apart < 1e-5
            verdict = f"within {apart:.0e}"
        else:
            self.same &= digest == base[0]
            verdict = "the same bits" if digest == base[0] else "DIFFERS"
        read = found.get("read_bytes", sum(p["pages_read"] * p["page"] for p in found.get("paged", [])))
        seconds = f"{found['wall_s']:.1f} ({found['wall_s'] / base[1]:.2f} times)"
        print(f"| {light} | {name} | {seconds} | {found['seconds']:.1f} | {found['peak'] / 2**20:.0f} MiB{' (more than allowed)' if budget and found['peak'] > budget else ''} "
              f"| {read / 1e9:.2f} GB | {verdict} |", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("raw", type=pathlib.Path)
    parser.add_argument("--size", type=int, default=512)
    parser.add_argument("--spp", type=int, default=16)
    parser.add_argument("--budgets", default="256M,512M,1G")
    options = parser.parse_args()
    table, raw = Table(), options.raw.resolve()
    with tempfile.TemporaryDirectory(dir=ROOT / "target") as folder:
        folder = pathlib.Path(folder)
        direct = ["--scene", scene(folder, "direct.toml", options, f'file = "{raw}"')]
        studio = ["--object", "sphere", "--material", raw, "--size", options.size, "--spp", options.spp]
        for light, words in (("direct", direct), ("studio", studio)):
            for budget in [None, *options.budgets.split(",")]:
                picture = folder / f"{light}-{budget}.exr"
                line = [RELEASE / "loden", "render", *words, "-o", picture, "--json", "--quiet", "--force"]
                found = run(line + (["--memory", budget] if budget else []))
                for paged in found.get("paged", []):
                    lights = int(re.search(r"shape = \[\d+, (\d+),", raw.read_text())[1])
                    # pages hold 4 x 4 texels under all lights, a byte a number
                    paged["page"] = 3 * 16 * lights
                limit = budget and int(budget[:-1]) << {"M": 20, "G": 30}[budget[-1]]
                table.row(light, budget or "all of it", found, picture, limit)
            if light == "direct":
                picture = folder / "passes.exr"
                bare = scene(folder, "bare.toml", options, 'model = "lambert"')
                found = run([RELEASE / "examples" / "three_passes", bare, raw, picture])
                table.row(light, "three passes", found, picture)
    sys.exit(0 if table.same else 1)


if __name__ == "__main__":
    main()
