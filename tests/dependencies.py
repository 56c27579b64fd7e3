#!/usr/bin/env python3
"""Checks the dependencies against deny.toml and the stated Rust version, by what `cargo metadata` says of them.

Licences must be allowed, sources must be the registry, and no dependency may need a newer compiler than ours claims.
Advisories need a database from the network: `cargo deny check`.
"""
import json
import pathlib
import re
import subprocess
import sys
import tomllib

ROOT = pathlib.Path(__file__).resolve().parent.parent
REGISTRY = "registry+https://github.com/rust-lang/crates.io-index"


def allowed(expression, known):
    """Whether an SPDX expression is satisfied by known licences; the old form `MIT/Apache-2.0` means OR."""
    tokens = re.findall(r"\(|\)|[^\s()]+", expression.replace("/", " OR ").replace(" WITH ", "-WITH-"))
    words = {"OR": " or ", "AND": " and ", "(": "(", ")": ")"}
    return eval("".join(words.get(token) or str(token.replace("-WITH-", " WITH ") in known) for token in tokens))


def version(text):
    return tuple(map(int, (text.split(".") + ["0"])[:2]))


def main():
    rules = tomllib.loads((ROOT / "deny.toml").read_text())["licenses"]
    exceptions = {rule["crate"]: rule["allow"] for rule in rules["exceptions"]}
    ours = tomllib.loads((ROOT / "Cargo.toml").read_text())["workspace"]["package"]["rust-version"]
    command = ["cargo", "metadata", "--format-version", "1", "--locked", "--all-features"]
    packages = json.loads(subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE).stdout)["packages"]
    problems = []
    for package in packages:
        name = f"{package['name']} {package['version']}"
        known = [*rules["allow"], *exceptions.pop(package["name"], [])]
        if not allowed(package["license"] or "unknown", known):
            problems.append(f"{name}: the licence {package['license']} is not allowed by deny.toml")
        if package["source"] not in (None, REGISTRY):
            problems.append(f"{name}: comes from {package['source']}")
        if version(package["rust_version"] or "1.0") > version(ours):
            problems.append(f"{name}: needs Rust {package['rust_version']}, we claim {ours}")
    problems += [f"{name}: an exception of deny.toml for what is no dependency" for name in exceptions]
    print("\n".join(problems) or f"{len(packages)} packages: licences, sources and Rust versions are as stated")
    return bool(problems)


if __name__ == "__main__":
    sys.exit(main())
