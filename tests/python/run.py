#!/usr/bin/env python3
"""Runs every comparison of this folder (files named *_vs_*.py) and counts them. Exit status 1 if one fails.

A script prints "skipped: WHAT" for anything it leaves out; such lines are counted, too.
"""
import pathlib
import subprocess
import sys

here = pathlib.Path(__file__).resolve().parent
scripts = sorted(here.glob("*_vs_*.py"))
failed, skipped = [], []
for script in scripts:
    print(f"-- {script.name}", flush=True)
    command = [sys.executable, "-u", script]
    with subprocess.Popen(command, cwd=here.parent.parent, stdout=subprocess.PIPE, text=True) as process:
        for line in process.stdout:
            print(line, end="", flush=True)
            if line.startswith("skipped: "):
                skipped.append(f"{script.name}: {line[9:].strip()}")
    if process.returncode:
        failed.append(script.name)
print(f"{len(scripts) - len(failed)} passed, {len(failed)} failed, {len(skipped)} skipped")
for name in failed:
    print(f"  failed: {name}")
for what in skipped:
    print(f"  skipped: {what}")
sys.exit(bool(failed) or not scripts)
