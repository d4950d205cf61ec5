#!/usr/bin/env python3
"""Every test that is ignored as long is run by scripts/check-long: its target and name match one of the `cargo test` lines there.

    python3 scripts/check_long_tests.py

Cases that a test binary marks itself (`Case { long: true }`, the emulated GPU) are not seen here.
"""
import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FOLDERS = ["src", "pipeline", "formats", "tests", "scripts"]
IGNORED = re.compile(r'#\[ignore = "long:[^\n]*\n(?:\s*(?:#\[|//)[^\n]*\n)*\s*fn (\w+)')


def lines():
    """(targets, filters) of each line of check-long that runs ignored tests: names of tests or `--lib`; no filter runs all."""
    text = (ROOT / "scripts/check-long").read_text().replace("\\\n", " ")
    for line in text.splitlines():
        if "cargo test" in line and "--ignored" in line:
            before, after = line.split("--ignored")
            yield set(re.findall(r"--lib|(?<=--test )\w+", before)), after.split()


def tests():
    """(target, name, file) of each long test."""
    for path in sorted(path for folder in FOLDERS for path in (ROOT / folder).glob("**/*.rs")):
        place = path.relative_to(ROOT)
        for name in IGNORED.findall(path.read_text()):
            parts = [part.removesuffix(".rs") for part in place.parts]
            if "tests" in parts[:-1] and "src" not in parts:
                target, *modules = parts[parts.index("tests") + 1 :]
            else:
                target, modules = "--lib", parts[parts.index("src") + 1 :]
            yield target, "::".join([m for m in modules if m not in ("main", "mod")] + [name]), place


def main():
    found, commands = list(tests()), list(lines())
    if not found or not commands:
        sys.exit(f"{len(found)} long tests and {len(commands)} lines found: expected some of both")
    is_run = lambda target, name: any(target in of and (not filters or any(f in name for f in filters)) for of, filters in commands)
    missing = [f"{place}: {name} ({target})" for target, name, place in found if not is_run(target, name)]
    if missing:
        sys.exit("long tests that scripts/check-long does not run:\n  " + "\n  ".join(missing))
    print(f"{len(found)} long tests, all run by scripts/check-long")


main()
