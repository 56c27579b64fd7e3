#!/usr/bin/env python3
"""Packs the program, its manual pages and completions, and all licences into target/dist, with checksums: `make dist`.

usage: dist.py PROGRAM

The archive depends on nothing but its content: files are sorted, their times are those of the last commit (SOURCE_DATE_EPOCH if it is
set), owners are nobody. The same program gives the same bytes, which is checked by packing twice.
"""
import gzip
import hashlib
import io
import json
import os
import pathlib
import platform
import subprocess
import sys
import tarfile
import tempfile

ROOT = pathlib.Path(__file__).resolve().parent.parent
SHELLS = {"bash": "loden.bash", "zsh": "_loden", "fish": "loden.fish", "powershell": "loden.ps1"}
LICENCES = ("LICENSE", "LICENCE", "COPYING", "NOTICE", "UNLICENSE")


def output(*command):
    return subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout


def third_party():
    """The licence files of every crate that the program is built from."""
    tree = output("cargo", "tree", "--locked", "-p", "loden-cli", "-e", "normal", "--prefix", "none", "-f", "{p}")
    wanted = {tuple(line.split(" ")[:2]) for line in tree.splitlines() if line}
    packages = json.loads(output("cargo", "metadata", "--format-version", "1", "--locked"))["packages"]
    parts, silent = [], []
    for package in sorted(packages, key=lambda package: (package["name"], package["version"])):
        if package["source"] is None or (package["name"], f"v{package['version']}") not in wanted:
            continue
        folder = pathlib.Path(package["manifest_path"]).parent
        files = sorted(file for file in folder.iterdir() if file.is_file() and file.name.upper().startswith(LICENCES))
        name = f"{package['name']} {package['version']} ({package['license']})"
        if not files:
            silent.append(name)
        for file in files:
            text = file.read_text(encoding="utf-8", errors="replace").strip()
            parts.append(f"{name}, {file.name}\n\n{text}\n")
    page = (ROOT / "crates" / "loden-studio" / "page" / "dist" / "three.js").read_text(encoding="utf-8")
    parts.append("The page of the studio: " + page.split("/*! ")[1].split("*/")[0])
    head = "Licences of the crates that loden is built from. Those without a licence file of their own state one by name:\n\n"
    return head + "\n".join(silent) + "\n\n" + ("\n" + "=" * 80 + "\n").join(parts)


def contents(program):
    """(name, bytes, mode) of every file, below the folder of the archive."""
    yield "bin/loden", program.read_bytes(), 0o755
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([program, "man", "-o", folder, "--quiet"], check=True, stdout=subprocess.DEVNULL)
        for page in sorted(pathlib.Path(folder).iterdir()):
            yield f"share/man/man1/{page.name}", page.read_bytes(), 0o644
    for shell, name in SHELLS.items():
        yield f"share/completions/{name}", output(program, "completions", shell).encode(), 0o644
    for name in ("README.md", "CHANGELOG.md", "LICENSE-APACHE", "LICENSE-MIT"):
        yield name, (ROOT / name).read_bytes(), 0o644
    yield "THIRD-PARTY-LICENCES.txt", third_party().encode(), 0o644


def packed(folder, files, time):
    data = io.BytesIO()
    with tarfile.open(fileobj=data, mode="w", format=tarfile.PAX_FORMAT) as archive:
        for name, content, mode in sorted(files):
            entry = tarfile.TarInfo(f"{folder}/{name}")
            entry.size, entry.mode, entry.mtime = len(content), mode, time
            archive.addfile(entry, io.BytesIO(content))
    return gzip.compress(data.getvalue(), 9, mtime=time)


def main():
    built = pathlib.Path(sys.argv[1]).resolve()
    target = ROOT / "target" / "dist"
    target.mkdir(parents=True, exist_ok=True)
    time = int(os.environ.get("SOURCE_DATE_EPOCH") or output("git", "log", "-1", "--format=%ct"))
    version = output(built, "--version").split()[1]
    folder = f"loden-{version}-{platform.machine()}-{platform.system().lower()}"
    with tempfile.TemporaryDirectory() as scratch:
        # lines of the source are for panics of a debugger, and as large as the rest
        program = pathlib.Path(scratch) / "loden"
        subprocess.run(["strip", "--strip-debug", "-o", program, built], check=True)
        archive = packed(folder, contents(program), time)
        if packed(folder, contents(program), time) != archive:
            sys.exit("packing twice gives different bytes")
    path = target / f"{folder}.tar.gz"
    path.write_bytes(archive)
    sums = f"{hashlib.sha256(archive).hexdigest()}  {path.name}\n"
    (target / "SHA256SUMS").write_text(sums)
    print(f"{path}: {len(archive) / 1e6:.1f} MB\n{sums}", end="")


main()
