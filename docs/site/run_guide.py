#!/usr/bin/env python3
"""Runs every command and snippet of docs/guide, in order, in an empty folder. Exit status 1 if one fails.

usage: run_guide.py FOLDER_OF_THE_PROGRAM

Blocks marked `sh` run with the program's folder in PATH, blocks marked `python` with this interpreter, which needs the package.
"""
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import time

GUIDE = pathlib.Path(__file__).resolve().parents[1] / "guide"
BLOCK = re.compile(r"^```(sh|python)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def main():
    path = pathlib.Path(sys.argv[1]).resolve()
    environment = {**os.environ, "PATH": f"{path}{os.pathsep}{os.environ['PATH']}"}
    count, start = 0, time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        for chapter in sorted(GUIDE.glob("*.md")):
            for kind, text in BLOCK.findall(chapter.read_text()):
                command = ["bash", "-euo", "pipefail", "-c", text] if kind == "sh" else [sys.executable, "-c", text]
                done = subprocess.run(command, cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
                if done.returncode:
                    sys.exit(f"{chapter.name}: this failed:\n{text}\n{done.stdout}")
                count += 1
    if count == 0:
        sys.exit(f"{GUIDE}: no blocks were found")
    print(f"{count} blocks of the guide ran in {time.monotonic() - start:.0f} s")


main()
