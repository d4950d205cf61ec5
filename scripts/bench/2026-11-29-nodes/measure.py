"""Trace and film of fast lenses by two programs in turn: wall and core seconds, peak memory.

    measure.py BEFORE AFTER RUNS [CASE…]

CASE is DESIGN,NM,SIDE: the design traced at NM nm (or FROM:TO:STEP) into a pack with pupil functions, then a film of a drawn chart of SIDE x SIDE px within 1 GiB.
Prints medians as JSON lines.
"""

import json
import os
import pathlib
import shutil
import statistics
import subprocess
import sys
import tempfile
import time


def timed(*args):
    begin = time.monotonic()
    process = subprocess.Popen(list(map(str, args)), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    text = process.stderr.read()
    _, status, usage = os.wait4(process.pid, 0)
    if status:
        sys.exit(f"{args}: {text.decode()}")
    return time.monotonic() - begin, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024


def main():
    programs = dict(zip(("before", "after"), sys.argv[1:3]))
    runs = int(sys.argv[3])
    for case in sys.argv[4:]:
        design, nm, side = case.split(",")
        found = {name: {"trace": [], "film": []} for name in programs}
        for _ in range(runs):
            for name, program in programs.items():
                folder = pathlib.Path(tempfile.mkdtemp())
                pack, film = folder / "lens.zarr", folder / "film.zarr"
                found[name]["trace"].append(timed(program, "lens", "trace", design, pack, "--wavelengths", nm, "--store", "pupils"))
                chart = f"gen:composite?size={side}&wavelengths={nm}"
                found[name]["film"].append(timed(program, "run", chart, film, "--lens", pack, "--memory", "1GiB", "--no-fsync"))
                shutil.rmtree(folder)
        for name, steps in found.items():
            for step, values in steps.items():
                wall, core, mib = (statistics.median(v[i] for v in values) for i in range(3))
                print(json.dumps({"case": case, "program": name, "step": step, "wall_s": round(wall, 2), "core_s": round(core, 2), "peak_mib": round(mib)}), flush=True)


main()
