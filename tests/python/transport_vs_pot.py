#!/usr/bin/env python3
"""Checks exact transport plans against POT's network simplex.

usage: python tests/python/transport_vs_pot.py [COUNT ...]

Costs equal those of ot.emd within 1e-9 relative: many random points, few and many rows, whole masses with ties, costs that
differ by orders of magnitude. COUNT rows against as many are timed beside ot.emd; 256 by default. Seconds of the processor are those of the whole
program, which also reads the costs; POT's are of the plan alone.

Exits with 1 if a check fails.
"""
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import time

import numpy as np
import ot

PROGRAM = "target/release/examples/dump_transport"


def ours(folder, a, b, costs):
    file = folder / "problem"
    np.concatenate([[len(a), len(b)], a, b, costs.ravel()]).astype("<f8").tofile(file)
    child = subprocess.Popen([PROGRAM, file], stdout=subprocess.PIPE)
    found = json.loads(child.stdout.read())
    _, _, usage = os.wait4(child.pid, 0)
    return found | {"processor_seconds": usage.ru_utime + usage.ru_stime}


def theirs(a, b, costs):
    start, processor = time.perf_counter(), time.process_time()
    plan = ot.emd(a / a.sum(), b / b.sum(), costs, numItermax=100_000_000)
    return float((plan * costs).sum()), time.perf_counter() - start, time.process_time() - processor


def check(folder, name, a, b, costs):
    found, (expected, seconds, processor) = ours(folder, a, b, costs), theirs(a, b, costs)
    off = abs(found["cost"] - expected) / max(abs(expected), 1e-300)
    row = {"problem": name, "cost": found["cost"], "relative_difference": off, "seconds": found["seconds"],
           "processor_seconds": found["processor_seconds"], "pot_seconds": seconds, "pot_processor_seconds": processor, "peak_bytes": found["peak_bytes"], "holds": off < 1e-9 or abs(found["cost"]) + abs(expected) < 1e-15}
    print(json.dumps(row), flush=True)
    return row["holds"]


def main():
    rng = np.random.default_rng(1)
    counts = [int(count) for count in sys.argv[1:]] or [256]
    holds = []
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        for n, m in [(5, 7), (64, 64), (300, 20), (20, 300), (1, 50)]:
            x, y = rng.random((n, 5)), rng.random((m, 5)) + 0.2
            holds.append(check(folder, f"{n} x {m} points", rng.random(n), rng.random(m), ot.dist(x, y)))
        whole = rng.integers(0, 6, (100, 80)).astype(float)
        holds.append(check(folder, "whole costs with ties", np.ones(100), np.full(80, 2.0), whole))
        wide = 10.0 ** rng.uniform(-6, 3, (90, 110))
        holds.append(check(folder, "costs over nine decades", rng.random(90), rng.random(110), wide))
        for count in counts:
            x, y = rng.standard_normal((count, 16)), 1.2 * rng.standard_normal((count, 16)) + 0.3
            a, b = rng.integers(1, 500, (2, count)).astype(float)
            holds.append(check(folder, f"{count} x {count} descriptors", a, b, ot.dist(x, y)))
    sys.exit(not all(holds))


main()
