"""Checks the dependencies that are compiled into the program, by `cargo metadata`: licences, sources, the oldest Rust, duplicates.

    python3 scripts/check_dependencies.py

Of every package for the targets of scripts/deny.toml: its licence is allowed there; it comes from crates.io; it requires no newer Rust than
Cargo.toml's rust-version; it is in the lock file in one version, unless it is named there. Advisories are checked by
`scripts/check --full` (cargo-deny, with the same file).
"""
import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parent.parent
DENY = tomllib.loads((ROOT / "scripts/deny.toml").read_text())
LICENCES = set(DENY["licenses"]["allow"])
# Packages in several versions.
DUPLICATES = {s["crate"] for s in DENY["bans"]["skip"]}
CRATES_IO = "registry+https://github.com/rust-lang/crates.io-index"


def metadata(target):
    command = ["cargo", "metadata", "--format-version", "1", "--locked", "--all-features", "--filter-platform", target]
    return json.loads(subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE).stdout)


def compiled(meta):
    """Identifiers of the packages that the program is made of: normal and build dependencies, from the workspace's members on."""
    nodes = {n["id"]: n for n in meta["resolve"]["nodes"]}
    found, new = set(), list(meta["workspace_members"])
    while new:
        package = new.pop()
        if package not in found:
            found.add(package)
            new += [d["pkg"] for d in nodes[package]["deps"] if any(k["kind"] != "dev" for k in d["dep_kinds"])]
    return found


def packages():
    """The packages of all targets but the workspace's own, by identifier."""
    found = {}
    for target in DENY["graph"]["targets"]:
        meta = metadata(target)
        ids = compiled(meta) - set(meta["workspace_members"])
        found |= {p["id"]: p for p in meta["packages"] if p["id"] in ids}
    return found


def allowed(expression, licences=LICENCES):
    """Whether an SPDX expression is satisfied by `licences`: one side of every OR, both sides of every AND."""
    expression = expression.replace("/", " OR ")
    tokens = re.findall(r"\(|\)|\bAND\b|\bOR\b|[\w.+-]+(?: WITH [\w.-]+)?", expression)

    def either():
        value = both()
        while tokens and tokens[0] == "OR":
            tokens.pop(0)
            value |= both()
        return value

    def both():
        value = one()
        while tokens and tokens[0] == "AND":
            tokens.pop(0)
            value &= one()
        return value

    def one():
        token = tokens.pop(0)
        if token == "(":
            value = either()
            tokens.pop(0)
            return value
        return token in licences

    return bool(tokens) and either()


def version(text):
    return tuple(map(int, (text + ".0.0").split("-")[0].split(".")[:3]))


def errors(found, own_rust):
    """What is wrong with the packages, one line each."""
    names = {}
    for p in found.values():
        name = f"{p['name']} {p['version']}"
        names.setdefault(p["name"], []).append(p["version"])
        if not allowed(p["license"] or ""):
            yield f"{name}: licence {p['license']}, expected one of scripts/deny.toml"
        if p["source"] != CRATES_IO:
            yield f"{name}: from {p['source']}, expected crates.io"
        if p["rust_version"] and version(p["rust_version"]) > version(own_rust):
            yield f"{name}: requires Rust {p['rust_version']}, Cargo.toml promises {own_rust}"
    for name, versions in sorted(names.items()):
        if len(versions) > 1 and name not in DUPLICATES:
            yield f"{name}: in the versions {', '.join(sorted(versions))}; use one, or name it in scripts/deny.toml"
    for name in sorted(n for n in DUPLICATES if len(names.get(n, [])) < 2):
        yield f"{name}: in one version now; remove it from scripts/deny.toml"


def main():
    assert allowed("(MIT OR GPL-3.0) AND Zlib") and allowed("MIT/Apache-2.0")
    assert not allowed("MIT AND GPL-3.0") and not allowed("") and not allowed("Apache-2.0 WITH Other")
    found = packages()
    own = next(p for p in metadata(DENY["graph"]["targets"][0])["packages"] if p["name"] == "lenscube")["rust_version"]
    wrong = list(errors(found, own))
    print("\n".join(wrong) or f"{len(found)} packages: licences, sources, Rust {own}, duplicates as expected")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
