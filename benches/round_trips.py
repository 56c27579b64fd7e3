#!/usr/bin/env python3
"""Converts every shared measurement to every format that can hold it and prints the round-trip errors as a table.

Usage: LODEN_DATA=... python3 benches/round_trips.py [LODEN]
"""
import json
import os
import pathlib
import subprocess
import sys
import tempfile

BRDF = [("x.bsdf", "rgl"), ("x.binary", "merl"), ("x.astm", "astm")]
BTF = [("x.zip", "ubo2003", "--png"), ("x.toml", "raw"), ("x.btf", "dfmf"), ("x.btf", "fmf"), ("x.btf", "bdi")]


def main():
    data = pathlib.Path(os.environ["LODEN_DATA"])
    root = pathlib.Path(__file__).resolve().parents[1]
    loden = sys.argv[1] if len(sys.argv) > 1 else root / "target/release/loden"
    sources = []
    for pattern in ("rgl_epfl/*.bsdf", "cornell_pbrt_v2/*.brdf", "cornell_astm/*.astm", "curet/abrdf.dat"):
        sources += [(path, BRDF) for path in sorted(data.glob(pattern))]
    for pattern in ("rti_loewenkopf/*.lp", "oracle/*.zip", "oracle/*.btf", "btf/*.zip"):
        sources += [(path, BTF) for path in sorted(data.glob(pattern))]
    print("| file | to | error | largest |\n|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for path, formats in sources:
            for name, to, *flags in formats:
                out = pathlib.Path(folder) / name
                command = [loden, "convert", path, out, "--to", to, "--json", "--quiet", "--force", *flags]
                done = subprocess.run(command, capture_output=True, text=True)
                short = path.relative_to(data)
                if done.returncode:
                    print(f"| `{short}` | {to} | not possible: {done.stderr.strip().replace(str(out), name)} | |")
                    continue
                result = json.loads(done.stdout)
                error = result.get("relative_error", result.get("mean_error"))
                largest = result.get("largest_error")
                if error is None:
                    print(f"| `{short}` | {to} | not compared | |", flush=True)
                else:
                    print(f"| `{short}` | {to} | {error:.6f} | {largest:.5f} |", flush=True)
                if to == "merl" and path.suffix == ".bsdf":
                    again = pathlib.Path(folder) / "again.bsdf"
                    subprocess.run([loden, "convert", out, again, "--no-check", "--quiet", "--force"], check=True, stdout=subprocess.DEVNULL)
                    done = subprocess.run([loden, "compare", path, again, "--json", "--quiet"], check=True, capture_output=True)
                    row = json.loads(done.stdout)[0]
                    print(f"| `{short}` | merl, then rgl | {row['relative_error']:.6f} | {row['largest_error']:.5f} |", flush=True)


if __name__ == "__main__":
    main()