#!/usr/bin/env python3
"""How much fits look like the original, for each choice of directions and error. Prints the rows of a Markdown table.

usage: python benches/fit_metrics.py [--loden FILE] BRDF...

Each number is the mean absolute difference of the display values of two rendered spheres, 64 x 64 pixels with 128 paths each on the default
background: one of the measured BRDF, one of a model fitted to it. It is the mean over four models.
"""
import argparse
import json
import pathlib
import subprocess
import tempfile

import numpy
from PIL import Image

ROOT = pathlib.Path(__file__).resolve().parents[1]
MODELS = ["ggx", "ward", "lafortune", "ashikhmin-shirley"]
CHOICES = [(at, metric) for at in ("nodes", "even") for metric in ("cosine", "log", "cube-root")]


def run(*words):
    done = subprocess.run([str(word) for word in words] + ["--json", "--quiet"], check=True, stdout=subprocess.PIPE, text=True)
    return json.loads(done.stdout)


def sphere(program, material, folder):
    """The display values of a rendered sphere, from 0 to 1."""
    path = folder / "sphere.png"
    run(program, "render", "--object", "sphere", "--material", material, "--size", "64x64", "--spp", 128, "--force", "-o", path)
    return numpy.asarray(Image.open(path).convert("RGB")) / 255


def specification(fit):
    """A fitted model as a material on the command line."""
    words = lambda value: ",".join(map(repr, value)) if isinstance(value, list) else str(value)
    return ":".join([fit["model"], *(f"{name}={words(value)}" for name, value in fit["params"].items())])


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--loden", default=ROOT / "target" / "release" / "loden")
    parser.add_argument("brdfs", nargs="+", metavar="BRDF")
    options = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for brdf in options.brdfs:
            original = sphere(options.loden, brdf, pathlib.Path(folder))
            row = []
            for at, metric in CHOICES:
                differences = []
                for model in MODELS:
                    fit = run(options.loden, "fit", brdf, "--model", model, "--at", at, "--metric", metric)["fits"][0]
                    fitted = sphere(options.loden, specification(fit), pathlib.Path(folder))
                    differences.append(abs(fitted - original).mean())
                row.append(numpy.mean(differences))
            rows.append(row)
            print(f"| {pathlib.Path(brdf).stem} | {' | '.join(f'{value:.4f}' for value in row)} |", flush=True)
    print(f"| mean | {' | '.join(f'{value:.4f}' for value in numpy.mean(rows, axis=0))} |")


if __name__ == "__main__":
    main()
