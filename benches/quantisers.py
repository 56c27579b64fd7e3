#!/usr/bin/env python3
"""Compares the quantisers of texels on built-in samples: splits, spaces, numbers compared. Prints the rows of a Markdown table.

usage: python benches/quantisers.py [--size 48] [--clusters 64] [--loden FILE]

Each sample is measured once, by the virtual goniometer, into target/bench/quantisers. The error is the mean over all texels and pairs,
FLIP that of a cloth which wears the material, beside one that wears the images (`loden render --sheet`); seconds are those of the processor,
without the measurement of the error.
"""
import argparse
import json
import os
import pathlib
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[1]
FOLDER = ROOT / "target" / "bench" / "quantisers"

SAMPLES = {"twill": ["twill", "--yarns", "8"], "leather": ["leather", "--cells", "5"], "gravel": ["gravel", "--pebbles", "5"]}

SETTINGS = [
    "median-cut --split balanced", "median-cut --split longest-edge", "median-cut --split population", "median-cut --split variance",
    "median-cut --split balanced --space pca", "median-cut --split population --space pca",
    "median-cut --split variance --space pca", "tsvq", "tsvq --dimensions 128", "kmeans --dimensions 8", "kmeans", "kmeans --dimensions 128",
    "kmeans --domain linear",
]


def run(program, *words):
    """The answer of the program, and the seconds of the processor that it took."""
    line = [str(word) for word in (program, *words, "--json", "--quiet", "--force")]
    child = subprocess.Popen(line, cwd=FOLDER, stdout=subprocess.PIPE, text=True)
    answer = child.stdout.read()
    _, status, usage = os.wait4(child.pid, 0)
    child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode:
        sys.exit(f"{' '.join(line)}: exit status {child.returncode}")
    return json.loads(answer), usage.ru_utime + usage.ru_stime


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", type=int, default=48)
    parser.add_argument("--clusters", type=int, default=64)
    parser.add_argument("--loden", type=pathlib.Path, default=ROOT / "target" / "release" / "loden")
    options = parser.parse_args()
    FOLDER.mkdir(parents=True, exist_ok=True)
    program = options.loden.resolve()
    for name, words in SAMPLES.items():
        if not (FOLDER / f"{name}-{options.size}.toml").exists():
            run(program, "acquire", *words, "--size", options.size, "--spp", 16, "-o", f"{name}-{options.size}.toml")
    cells = [[f"`{setting}`"] for setting in SETTINGS]
    for name in SAMPLES:
        source, made = f"{name}-{options.size}.toml", [f"{name}-{k}.loden" for k in range(len(SETTINGS))]
        seconds = []
        for setting, file in zip(SETTINGS, made):
            method = ["--method", *setting.split(), "--clusters", options.clusters, "--precision", "f16"]
            seconds.append(run(program, "compress", source, *method, "--no-error", "-o", file)[1])
        errors, _ = run(program, "compare", source, *made)
        look = ["--object", "cloth", "--uv-scale", 3, "--size", "128x120", "--spp", 32]
        shown, _ = run(program, "render", "--sheet", source, *made, *look, "-o", "sheet.png")
        for row, error, picture, time in zip(cells, errors, shown, seconds, strict=True):
            row += [f"{error['mean_abs_error']:.4f}", f"{picture['flip']:.3f}", f"{time:.1f}"]
    print("| setting | " + " | ".join(f"{name}: error | FLIP | seconds" for name in SAMPLES) + " |")
    print("|" + "---|" * (1 + 3 * len(SAMPLES)))
    print("\n".join("| " + " | ".join(row) + " |" for row in cells))


if __name__ == "__main__":
    main()
