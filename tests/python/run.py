#!/usr/bin/env python3
"""Runs every comparison of this folder (files named *_vs_*.py), two at a time, and counts them. Exit status 1 if one fails.

A script prints "skipped: WHAT" for anything it leaves out; such lines are counted, too. With --data, only those scripts run
that use the reference measurements.
"""
import concurrent.futures
import pathlib
import subprocess
import sys
import time

here = pathlib.Path(__file__).resolve().parent
# the slow ones first, so that none is left alone at the end
SLOW = ["shaders_vs_loden.py"]


def output_of(script):
    """What a script prints, errors too, its exit status and its seconds."""
    command = [sys.executable, "-u", script]
    start = time.monotonic()
    done = subprocess.run(command, cwd=here.parent.parent, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    return done.stdout, done.returncode, time.monotonic() - start


scripts = [script for script in here.glob("*_vs_*.py") if "--data" not in sys.argv[1:] or "LODEN_DATA" in script.read_text()]
scripts.sort(key=lambda script: (script.name not in SLOW, script.name))
failed, skipped = [], []
with concurrent.futures.ThreadPoolExecutor(2) as pool:
    running = {pool.submit(output_of, script): script.name for script in scripts}
    for done in concurrent.futures.as_completed(running):
        name, (text, status, seconds) = running[done], done.result()
        print(f"-- {name}, {seconds:.0f} s\n{text}", end="", flush=True)
        skipped += [f"{name}: {line[9:].strip()}" for line in text.splitlines() if line.startswith("skipped: ")]
        failed += [name] if status else []
print(f"{len(scripts) - len(failed)} passed, {len(failed)} failed, {len(skipped)} skipped")
for name in failed:
    print(f"  failed: {name}")
for what in skipped:
    print(f"  skipped: {what}")
sys.exit(bool(failed) or not scripts)
