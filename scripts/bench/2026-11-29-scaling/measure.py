#!/usr/bin/env python3
"""Measures, for model.py, what a film of the paper's job takes by stage and what of it one thread does: measured.json.

    measure.py LENSCUBE SCRATCH [SIZE]

Four bands of SIZE (14141) px of the built-in lens, drawn and from a store (a chart with 1 % noise, of this size), with tails of PSFs and without, on
one thread and on two. Bands are traced before, but for the traces, which are timed alone. Needs 6 GB in SCRATCH at 14141 px.
"""

import json
import os
import pathlib
import shutil
import subprocess
import sys
import time

BANDS = "450,550,600,700"


def main():
    program, scratch = os.path.abspath(sys.argv[1]), pathlib.Path(sys.argv[2])
    size = sys.argv[3] if len(sys.argv) > 3 else "14141"
    scratch.mkdir(parents=True, exist_ok=True)
    cache = scratch / "cache"
    film, chart = scratch / "film.zarr", scratch / "chart.zarr"

    def run(*words, before=()):
        begin = time.monotonic()
        done = subprocess.run([*before, program, *words], capture_output=True, text=True, env=os.environ | {"XDG_CACHE_HOME": str(cache)})
        assert done.returncode == 0, done.stderr
        return time.monotonic() - begin

    def filmed(source, threads, tails, *more):
        shutil.rmtree(film, ignore_errors=True)
        flags = ["--bands", BANDS, "--threads", str(threads), "--memory", "2GiB", "--tails", tails, *more]
        wall_s = run("run", source, str(film), *flags)
        record = json.loads(next((film / "runs").glob("*.json")).read_text())
        keys = ["startup_s", "wall_s", "core_s", "thread_s", "bytes_read", "bytes_written", "tiles", "shards", "peak_resident_bytes"]
        return {"source": source.split("/")[-1], "threads": threads, "tails": tails, "process_s": round(wall_s, 3)} | {k: record[k] for k in keys}

    traces = []
    for threads in (1, 2):
        shutil.rmtree(cache, ignore_errors=True)
        pack = scratch / "pack.lens.zarr"
        shutil.rmtree(pack, ignore_errors=True)
        before = ("taskset", "-c", f"0-{threads - 1}")
        wall_s = run("lens", "trace", "double-gauss-28", str(pack), "--wavelengths", BANDS, before=before)
        traces.append({"threads": threads, "wall_s": round(wall_s, 3)})
    drawn = f"gen:composite?size={size}"
    filmed("gen:composite?size=64", 2, "on")
    if not chart.exists():
        run("chart", "composite", str(chart), "--film-size", size, "--film-pitch-um", "2", "--wavelengths", BANDS, "--noise", "0.01")
    films = [filmed(source, threads, tails) for source in (drawn, str(chart)) for tails in ("off", "on") for threads in (1, 2)]
    # Layers of light are those of the film for any region, so that nothing but the preparation runs.
    alone = ("--roi", "0,0,64,64")
    prepared = [filmed(source, threads, tails, *alone) for source in (drawn, str(chart)) for tails in ("off", "on") for threads in (1, 2)]
    found = {"bands": BANDS, "size": int(size), "traces": traces, "films": films, "prepared": prepared}
    out = pathlib.Path(__file__).with_name("measured.json")
    out.write_text(json.dumps(found, indent=1) + "\n")
    for f in films + prepared:
        core = sum(f["core_s"].values())
        print(f"{f['source'][:16]:16} {f['threads']} threads, tails {f['tails']:3}: wall {f['process_s']:.1f} s, core {core:.1f} s, prepare {f['thread_s']['prepare']:.2f} s of its thread")
    print("traces", traces)


main()
