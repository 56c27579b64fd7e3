#!/usr/bin/env python3
"""Runs every comparison of this folder (files named *_vs_*.py) and counts them. Exit code 1 if one fails."""
import pathlib
import subprocess
import sys

here = pathlib.Path(__file__).resolve().parent
scripts = sorted(here.glob("*_vs_*.py"))
failed = []
for script in scripts:
    print(f"-- {script.name}", flush=True)
    if subprocess.run([sys.executable, script], cwd=here.parent.parent).returncode:
        failed.append(script.name)
print(f"{len(scripts) - len(failed)} passed, {len(failed)} failed")
sys.exit(bool(failed) or not scripts)
