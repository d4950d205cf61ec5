#!/usr/bin/env python3
"""Reads every lens file of a folder with `lenscube lens show`, and with --trace traces one band of it, and prints what was read and what was not.

    scripts/lens_corpus/measure.py FOLDER [--trace] [--program target/release/lenscube] [--limit N]

The files are not part of the project: clone the repositories of repositories.txt next to each other and give their folder. A file that is not
centred (tilts, other surface types, non-sequential, macros) is refused by design and counted apart. Checked: no panic; a refusal is one line
on stderr and takes at most 2 s; `show` takes at most 0.5 s; a trace ends within 60 s. Times of `show` are of the processor, so that other work on
the machine does not count. Exit code 1 if any of these fails.
"""

import argparse
import collections
import re
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

SUFFIXES = {".zmx", ".seq", ".len", ".zar", ".zos", ".csv", ".json"}
# Refusals that say what lenscube is not for.
BY_DESIGN = re.compile(r"rotationally symmetric|surface type|only sequential|macro|binary|\.zos are not read|is it a sequential|"
                       r"is it an Optiland|Optiland|is it a lens table|extra data")


def processor_seconds():
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def run(command, seconds):
    """Exit code (None: stopped), stderr, seconds of the processor."""
    start = processor_seconds()
    try:
        done = subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=seconds)
        return done.returncode, done.stderr, processor_seconds() - start
    except subprocess.TimeoutExpired:
        return None, "", processor_seconds() - start


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--trace", action="store_true")
    parser.add_argument("--program", default="target/release/lenscube")
    parser.add_argument("--limit", type=int, default=10**9)
    given = parser.parse_args()
    files = sorted(p for p in given.folder.rglob("*") if p.suffix.lower() in SUFFIXES and p.is_file())[: given.limit]
    counts, faults, refusals, slowest, traced = collections.Counter(), [], [], (0.0, ""), collections.Counter()
    for path in files:
        code, stderr, seconds = run([given.program, "lens", "show", str(path)], 20)
        lines = [line for line in stderr.splitlines() if line.strip()]
        slowest = max(slowest, (seconds, path.name))
        if code is None or "panicked" in stderr or code not in (0, 1, 2):
            faults.append(f"{path}: exit code {code}, {seconds:.1f} s: {stderr[-200:]}")
            continue
        if code == 0:
            counts["read"] += 1
            if seconds > 0.5:
                faults.append(f"{path}: show took {seconds:.2f} s")
        else:
            errors = [line for line in lines if line.startswith("lenscube: ")]
            if len(errors) != 1 or seconds > 2:
                faults.append(f"{path}: {len(errors)} error lines, {seconds:.2f} s: {stderr[-300:]}")
            kind = "not centred" if BY_DESIGN.search(stderr) else "refused"
            counts[kind] += 1
            refusals.append((kind, path.name, (errors or lines or [""])[0]))
            continue
        if given.trace:
            with tempfile.TemporaryDirectory() as folder:
                out = str(Path(folder) / "lens.zarr")
                trace = [given.program, "lens", "trace", str(path), out, "--wavelengths", "550"]
                code, stderr, seconds = run(trace, 60)
            if code is None or "panicked" in stderr or code not in (0, 1, 2):
                faults.append(f"{path}: trace: exit code {code}, {seconds:.1f} s: {stderr[-200:]}")
            traced["traced" if code == 0 else "not traced"] += 1
            if code not in (0, None):
                refusals.append(("trace", path.name, stderr.strip().splitlines()[-1] if stderr.strip() else ""))
    for kind, name, line in refusals:
        print(f"{kind}: {name}: {line}")
    centred = counts["read"] + counts["refused"]
    print(f"{len(files)} files: {counts['read']} of {centred} centred ones read ({100 * counts['read'] / max(centred, 1):.1f} %), "
          f"{counts['not centred']} not centred; slowest show {slowest[0]:.2f} s ({slowest[1]})")
    if given.trace:
        print(f"traced {traced['traced']}, not traced {traced['not traced']}")
    for fault in faults:
        print("FAULT", fault)
    sys.exit(bool(faults))


if __name__ == "__main__":
    main()
