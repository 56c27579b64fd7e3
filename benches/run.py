#!/usr/bin/env python3
"""Measures our programs and their peers in turn, in one run, and prints a Markdown table.

usage: run.py [--btf RAW.toml] [--zip ARCHIVE.zip] [--only NAME,...]

Without arguments, a 256 x 256 x 6561 sample is simulated first (kept in target/bench). The peers run with two threads,
since all figures are for two processors; NumPy chooses its own kernels.
"""
import argparse
import json
import os
import pathlib
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
FOLDER = ROOT / "target" / "bench"
LODEN = ROOT / "target" / "release" / "loden"


def run(command, **environment):
    """The JSON, or JSON lines, that a command prints."""
    env = {**os.environ, "OPENBLAS_NUM_THREADS": "2", "RAYON_NUM_THREADS": "2", **environment}
    # settings for old processors slow down a current NumPy
    for name in ("OPENBLAS_CORETYPE", "OPENBLAS_L2_SIZE"):
        env.pop(name, None)
    print("$", " ".join(map(str, command)), file=sys.stderr, flush=True)
    done = subprocess.run(command, cwd=ROOT, env=env, stdout=subprocess.PIPE, text=True, check=True)
    if command[0] == LODEN:
        rows = [json.loads(done.stdout)]
    else:
        rows = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
    for row in rows:
        print("   ", {key: value for key, value in row.items() if key != "rows"}, file=sys.stderr, flush=True)
    return rows


def bench(name, *arguments, **environment):
    return run(["cargo", "bench", "--workspace", "--bench", name, "--", *arguments], **environment)


def peer(name, *arguments, **environment):
    return run([sys.executable, f"benches/peers/{name}.py", *map(str, arguments)], **environment)


def samples(arguments):
    """A raw array and an archive; simulated if none is given."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    archive = arguments.zip or FOLDER / "twill256.zip"
    if not archive.exists():
        run([LODEN, "acquire", "twill", "--size", "256", "--spp", "1", "--yarns", "48", "-o", archive, "--json", "--force"])
    raw = arguments.btf or FOLDER / "twill256.toml"
    if not raw.exists():
        run([LODEN, "convert", archive, raw, "--json", "--force"])
    return raw.with_suffix(".u8"), archive


def best(rows, key="seconds", **wanted):
    found = [row for row in rows if all(row.get(k) == v for k, v in wanted.items())]
    return min(found, key=lambda row: row[key])


def pvmf(raw, archive):
    ours = bench("pvmf", "f32", "encode", "decode", LODEN_BENCH_BTF=str(raw), LODEN_BENCH_REPEAT="3")
    numpy = peer("pvmf", raw, LODEN_BENCH_REPEAT="3")
    a, b = best(ours, work="pvmf encode", precision="f32"), best(numpy, work="pvmf encode")
    yield ["PVMF c = 4 from a raw array", f"{a['seconds']:.2f} s, {a['peak_rss_bytes'] / 2**20:.0f} MiB",
           f"NumPy {b['seconds']:.2f} s, {b['peak_rss_bytes'] / 2**20:.0f} MiB", f"{b['seconds'] / a['seconds']:.1f} times as fast", "4"]
    key = "gtexel_per_second"
    a, b = (max(row[key] for row in rows if key in row) for rows in (ours, numpy))
    yield ["decoding a view, c = 4", f"{a:.2f} Gtexel/s", f"NumPy {b:.2f} Gtexel/s", f"{a / b:.1f} times as fast", "2"]


def evaluate(raw, archive):
    key = "evaluations_per_second_per_core"
    for precision in ["f16", "f32"]:
        # numba computes in single precision, the only format it has fast arithmetic for
        file, a, b = FOLDER / f"{precision}.loden", 0, 0
        run([LODEN, "compress", raw.with_suffix(".toml"), "--method", "pvmf", "--components", "4", "--precision", precision, "-o", file, "--json", "--force"])
        for _ in range(3):
            ours = bench("pvmf", precision, "evaluate", LODEN_BENCH_BTF=str(raw), LODEN_BENCH_REPEAT="15", LODEN_BENCH_OUT=str(FOLDER))
            a = max([a] + [row[key] for row in ours if key in row])
            b = max([b] + [row[key] for row in peer("evaluate", file, LODEN_BENCH_REPEAT="15") if key in row])
        yield [f"single texels at continuous directions, c = 4 {precision}, one core", f"{a / 1e6:.1f} M/s",
               f"numba {b / 1e6:.1f} M/s", f"{a / b:.1f} times as fast", "5"]


def archive_(raw, archive):
    decode = min(row["seconds"] for row in peer("import", archive))
    ours = min(row["seconds"] for row in bench("import", LODEN_BENCH_ZIP=str(archive)))
    yield ["decoding 6561 JPEGs of an archive", f"{ours:.2f} s", f"libjpeg-turbo {decode:.2f} s", f"{ours / decode:.2f} of its time", ""]
    file = FOLDER / "archive.loden"
    seconds = [run([LODEN, "compress", archive, "--method", "pvmf", "--components", "4", "-o", file, "--json", "--force"])[0]["encode_s"] for _ in range(3)]
    yield ["PVMF c = 4 from that archive", f"{min(seconds):.2f} s", f"libjpeg-turbo, decoding alone {decode:.2f} s",
           f"{min(seconds) / decode:.2f} of its time", "at most 3"]


def goniometer(raw, archive):
    folder = FOLDER / "field"
    ours, theirs = bench("goniometer", LODEN_BENCH_FIELD=str(folder)), peer("goniometer", folder)
    for finish in dict.fromkeys(row["finish"] for row in ours):
        a, b = (max(row["paths_per_s"] for row in rows if row["finish"] == finish) for rows in (ours, theirs))
        yield [f"virtual goniometer, 512 x 512 field, depth 4, {finish}", f"{a / 1e6:.1f} M paths/s",
               f"Mitsuba 3 {b / 1e6:.2f} M paths/s", f"{a / b:.1f} times as fast", "2"]


def brdf(raw, archive):
    if data := os.environ.get("LODEN_DATA"):
        file = pathlib.Path(data) / "rgl_epfl" / "satin_rosaline_rgb.bsdf"
        key, a, b = "evaluations_per_second", 0, 0
        for _ in range(3):
            a = max([a] + [row[key] for row in bench("brdf", LODEN_BENCH_BSDF=str(file))])
            b = max([b] + [row[key] for row in peer("brdf", file)])
        yield ["random pairs of a .bsdf file, two threads", f"{a / 1e6:.1f} M/s", f"Mitsuba 3 {b / 1e6:.1f} M/s",
               f"{a / b:.1f} times as fast", "2"]
    rates = {}
    for row in bench("brdf"):
        rates.setdefault((row["kind"], row["name"]), {}).update(row)
    for (kind, name), row in rates.items():
        many = f", {row['per_second_many'] / 1e6:.2f} M/s many at a call" if "per_second_many" in row else ""
        yield [f"{kind} {name}, one thread", f"{row['per_second'] / 1e6:.2f} M/s{many}", "", "", ""]


def quantise(raw, archive):
    ours = {row["work"]: row for row in bench("quantise", LODEN_BENCH_BTF=str(raw.with_suffix(".toml")), LODEN_BENCH_REPEAT="3")}
    theirs = {row["work"]: row for work in ("median-cut", "minibatch", "kmeans") for row in peer("quantise", raw, work)}
    pairs = [("median-cut balanced", "median-cut balanced", "NumPy", "2"), ("median-cut longest-edge", "median-cut longest-edge", "NumPy", "2"),
             ("median-cut population", "median-cut population", "NumPy", "2"), ("kmeans", "kmeans", "faiss", "6 s, 600 MiB"),
             ("kmeans", "kmeans in batches", "scikit-learn in batches", ""), ("tsvq", None, "", ""), ("pcmf", None, "", "60 s, 1024 MiB")]
    for work, other, name, wanted in pairs:
        def figures(row, error):
            return f"{row['seconds']:.2f} s, {row['peak_rss_bytes'] / 2**20:.0f} MiB, error {row[error]:.4f}"
        a, b = ours[work], theirs.get(other)
        yield [f"{work}, from a raw array", figures(a, "mean_abs_error"),
               f"{name} {figures(b, 'mean_abs_error_of_some')}" if b else "",
               f"{b['seconds'] / a['seconds']:.1f} times as fast" if b else "", wanted]


def pca(raw, archive):
    file = FOLDER / "pca.loden"
    line = [LODEN, "compress", raw.with_suffix(".toml"), "--method", "pca", "--components", "16", "--no-error", "-o", file, "--json", "--force"]
    ours = [run(line)[0] for _ in range(3)]
    theirs = [peer("pca", raw, 16)[0] for _ in range(3)]
    a, b = (min(row[key] for row in rows) for rows, key in ((ours, "encode_s"), (theirs, "seconds")))
    yield ["components of all views, c = 16, from a raw array", f"{a:.2f} s, {ours[0]['peak_rss_bytes'] / 2**20:.0f} MiB", f"NumPy {b:.2f} s, {theirs[0]['peak_rss_bytes'] / 2**20:.0f} MiB",
           f"{b / a:.1f} times as fast", "3"]


def render(raw, archive):
    photographs = raw.with_suffix(".toml")
    methods = {"PVMF c = 4": ["--method", "pvmf", "--components", "4"], "klt": ["--method", "klt", "--components", "64", "--step", "1.3"]}
    files = [FOLDER / "ball-pvmf.loden", FOLDER / "ball-klt.loden"]
    for file, words in zip(files, methods.values()):
        if not file.exists():
            run([LODEN, "compress", photographs, *words, "--no-error", "-o", file, "--json", "--force"])
    rows = peer("render_materials", LODEN, "--spp", 32, "--btf", *files, "--photographs", photographs)
    diffuse = rows[0]["samples_per_s"]
    for row in rows:
        a, b = row["samples_per_s"], row["peer_samples_per_s"]
        named = dict(zip((f"BTF, {file.name}" for file in files), methods)).get(row["material"])
        here = f"{a / 1e6:.1f} M/s" + (f", {row['peak_rss_bytes'] / 2**20:.0f} MiB, {a / diffuse:.2f} of diffuse" if named else "")
        there = f"plug-in {b / 1e6:.2f} M/s, {row['peer_peak_rss_bytes'] / 2**20:.0f} MiB" if named else f"Mitsuba 3 {b / 1e6:.1f} M/s"
        measured = row["material"].startswith("measured")
        yield [f"ball of 100 000 triangles, {'BTF, ' + named if named else row['material']}", here, there,
               f"{a / b:.1f} times as fast", "20" if named else "1.5" if measured else "1"]


def demo(raw, archive):
    out = FOLDER / "demo"
    row = run([LODEN, "demo", "-o", out, "--json", "--force"])
    yield ["`loden demo`", f"{row[0]['seconds']:.0f} s, {row[0]['peak_rss_bytes'] / 2**20:.0f} MiB", "", "", "120 s, 2048 MiB"]


PARTS = {"pvmf": pvmf, "evaluate": evaluate, "archive": archive_, "goniometer": goniometer, "brdf": brdf, "quantise": quantise, "pca": pca, "render": render, "demo": demo}


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--btf", type=pathlib.Path)
    parser.add_argument("--zip", type=pathlib.Path)
    parser.add_argument("--only", default=",".join(PARTS))
    arguments = parser.parse_args()
    names = arguments.only.split(",")
    # BRDFs need no sample
    raw, archive = samples(arguments) if names != ["brdf"] else (None, None)
    print("| work | loden | peer | ratio | to reach |\n|---|---|---|---|---|", flush=True)
    failed = []
    for name in names:
        # a part that fails does not take the others with it
        try:
            for row in PARTS[name](raw, archive):
                print("| " + " | ".join(row) + " |", flush=True)
        except Exception as error:
            print(f"{name} failed: {error!r}", file=sys.stderr, flush=True)
            failed.append(name)
    if failed:
        sys.exit(f"{len(failed)} of {len(names)} parts failed: {', '.join(failed)}")


if __name__ == "__main__":
    main()
