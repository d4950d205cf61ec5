#!/usr/bin/env python3
"""Wall and core seconds of films that are small beside the lens's field, of a program before and one after, in turn: measured.json.

    measure.py BEFORE AFTER SCRATCH [ROUNDS]

Bands are traced before; each film is new.
"""

import json
import os
import pathlib
import resource
import shutil
import statistics
import subprocess
import sys
import time

JOBS = {
    "256 px, 3 bands": ["gen:composite?size=256", "--bands", "500,550,600"],
    "256 px, 31 bands": ["gen:composite?size=256"],
    "1000 px, 31 bands": ["gen:composite?size=1000"],
}


def main():
    before, after, scratch = sys.argv[1], sys.argv[2], pathlib.Path(sys.argv[3])
    rounds = int(sys.argv[4]) if len(sys.argv) > 4 else 5
    film = scratch / "film.zarr"

    def run(program, chart, *flags):
        shutil.rmtree(film, ignore_errors=True)
        used = lambda: sum(resource.getrusage(resource.RUSAGE_CHILDREN)[:2])
        begin, core = time.monotonic(), used()
        subprocess.run([program, "run", chart, film, *flags], check=True, capture_output=True, env=os.environ | {"XDG_CACHE_HOME": str(scratch / "cache")})
        return round(time.monotonic() - begin, 3), round(used() - core, 3)

    found = {}
    for name, job in JOBS.items():
        run(before, *job)
        runs = {"before": [], "after": []}
        for _ in range(rounds):
            runs["before"].append(run(before, *job))
            runs["after"].append(run(after, *job))
        found[name] = runs
        medians = {k: [statistics.median(v) for v in zip(*r)] for k, r in runs.items()}
        print(name, medians)
    pathlib.Path(__file__).with_name("measured.json").write_text(json.dumps(found, indent=1) + "\n")


main()
