#!/usr/bin/env python3
"""Traces built-in lenses or design files band by band and prints one line each: exit code, CPU seconds, estimate, error that was told or message.

    scripts/bench/2026-11-22-trace/trace_designs.py PROGRAM WAVELENGTHS (NAME | FILE)...

A design without a field point off the axis is traced up to 1 mm. CPU seconds are those of the user mode of the program, reading and writing included.
"""

import re
import resource
import subprocess
import sys
import tempfile
from pathlib import Path


def user_seconds():
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime


def trace(program, design, wavelengths, extra):
    with tempfile.TemporaryDirectory() as folder:
        out = str(Path(folder) / "lens.zarr")
        start = user_seconds()
        command = [program, "lens", "trace", design, out, "--wavelengths", wavelengths, "-v", *extra]
        done = subprocess.run(command, capture_output=True, text=True, errors="replace")
        return done.returncode, done.stderr, user_seconds() - start


def main():
    program, wavelengths, *designs = sys.argv[1:]
    print("design\texit code\tuser s\testimate\terror lines\tresult")
    for design in designs:
        code, stderr, seconds = trace(program, design, wavelengths, [])
        if "has no field point off the axis" in stderr:
            code, stderr, seconds = trace(program, design, wavelengths, ["--max-height-mm", "1"])
        errors = [line for line in stderr.splitlines() if line.startswith("lenscube: ")]
        estimate = re.search(r"about (\d+ s);", stderr)
        bands = re.findall(r"nm: window (\d+) px.*?(\d+) heights, (\d+) nodes, kernel error ([\d.]+ %)", stderr)
        told = "; ".join(f"{window} px, {heights} heights, {nodes} nodes, {error}" for window, heights, nodes, error in bands)
        result = "PANIC" if "panicked" in stderr else told if code == 0 else " | ".join(errors)[-300:]
        print(f"{Path(design).name}\t{code}\t{seconds:.2f}\t{estimate[1] if estimate else ''}\t{len(errors)}\t{result}", flush=True)


if __name__ == "__main__":
    main()
