"""Cost of scatter, glare and ghosts on bands of the paper's film.

    python3 measure.py LENSCUBE FOLDER [--bands 500,600] [--rounds 3] [--size 14141]

Films of double-gauss-28 drawn, and store to store, without these lights, with them for the first time (the reduced chart is not in the cache) and again (it is). Prints, per case, the median
core seconds (user and system time of the process), wall seconds and peak resident memory, and their ratios and difference to the case without. FOLDER needs about 3 GB for two bands; films are
removed. The cache is FOLDER/cache: bands are traced before anything is timed. Ghosts are traced in each run.
"""

import argparse
import os
import shutil
import statistics
import subprocess
import time
from pathlib import Path

LIGHT = ["--scatter", "0.3%", "--veiling-glare", "1%"]
GHOSTS = ["--ghosts", "on", "--sensor-reflectance", "5%"]
COATED = ["--coatings", "mgf2"]


def run(words, environment):
    """Core seconds, wall seconds and peak bytes of a process."""
    start = time.monotonic()
    process = subprocess.Popen(words, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)
    if status != 0:
        raise SystemExit(f"{' '.join(words)}: status {status}")
    return used.ru_utime + used.ru_stime, time.monotonic() - start, used.ru_maxrss * 1024


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("program")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--bands", default="500,600")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--size", type=int, default=14141)
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    cache, film, chart = (given.folder / name for name in ("cache", "film.zarr", "chart.zarr"))
    environment = os.environ | {"XDG_CACHE_HOME": str(cache.resolve())}
    drawn = f"gen:composite?size={given.size}&wavelengths={given.bands}"
    if not chart.exists():
        size = ["--film-size", str(given.size), "--wavelengths", given.bands, "--noise", "0.01"]
        run([given.program, "chart", "composite", str(chart), *size], environment)

    def measured(source, flags, keeps_reduced):
        shutil.rmtree(film, ignore_errors=True)
        if not keeps_reduced:
            for entry in cache.glob("lenscube/lenses/*.reduced"):
                entry.unlink()
        found = run([given.program, "run", str(source), str(film), "--memory", "1GiB", "--no-fsync", *flags], environment)
        shutil.rmtree(film)
        return found

    # Case, chart, flags, whether the reduced chart is in the cache, and the case that it is compared with.
    cases = [
        ("drawn", drawn, [], True, None),
        ("drawn, scatter and glare", drawn, LIGHT, False, "drawn"),
        ("drawn, coated", drawn, COATED, True, None),
        ("drawn, coated, scatter, glare and ghosts", drawn, COATED + LIGHT + GHOSTS, False, "drawn, coated"),
        ("store", chart, [], True, None),
        ("store, scatter and glare, first time", chart, LIGHT, False, "store"),
        ("store, scatter and glare, reduced chart in the cache", chart, LIGHT, True, "store"),
    ]
    for flags in ([], COATED):
        measured(drawn, flags + ["--roi", "0,0,256,256"], True)
    found = {name: [] for name, *_ in cases}
    for _ in range(given.rounds):
        for name, source, flags, keeps_reduced, _ in cases:
            found[name].append(measured(source, flags, keeps_reduced))
    median = {name: [statistics.median(one) for one in zip(*runs)] for name, runs in found.items()}
    print(f"bands {given.bands} nm of {given.size} x {given.size} px, medians of {given.rounds}")
    print(f"{'case':56} core s  wall s  peak MiB   over the case without")
    for name, _, _, _, base in cases:
        core, wall, peak = median[name]
        line = f"{name:56} {core:6.1f}  {wall:6.1f}  {peak / 2**20:8.0f}"
        if base:
            of = median[base]
            line += f"   core {core / of[0]:.3f} x, wall {wall / of[1]:.3f} x, {(peak - of[2]) / 2**20:+.0f} MiB"
        print(line)


main()
