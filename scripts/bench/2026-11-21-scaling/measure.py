#!/usr/bin/env python3
"""Measures units of the paper's job with a built lenscube and writes measured.json for model.py.

    measure.py target/release/lenscube SCRATCH [BANDS]

A chart of three bands with 1 % noise is drawn into SCRATCH (1.8 GB); each band is a unit, as the default cut of the whole job has
it. Core seconds, bytes and start-up come from the workers' own records. Then eight workers start together, each at a
band of its own.
"""

import json
import os
import pathlib
import shutil
import statistics
import subprocess
import sys
import time

HERE = pathlib.Path(__file__).parent
CODEC = ["read", "encode", "write"]


def run(program, *words, **more):
    return subprocess.run([program, *words], check=True, capture_output=True, text=True, **more)


def records(film):
    return [json.loads(p.read_text()) for p in sorted((film / "runs").glob("*.json"))]


def main():
    program, scratch = sys.argv[1], pathlib.Path(sys.argv[2])
    bands = sys.argv[3] if len(sys.argv) > 3 else "420,550,700"
    size = os.environ.get("SIZE", "14141")
    chart, film, job = scratch / "chart.zarr", scratch / "film.zarr", scratch / "job.json"
    for old in (film, job):
        shutil.rmtree(old, ignore_errors=True) if old.is_dir() else old.unlink(missing_ok=True)
    if not chart.exists():
        run(program, "chart", "composite", chart, "--size", size, "--wavelengths", bands, "--pitch-um", "2", "--noise", "0.01")

    again = {}
    for rows in ("7", "4", "2", "1"):
        other = scratch / f"rows-{rows}.json"
        run(program, "plan", chart, film, "-o", other, "--unit-rows", rows)
        totals = json.loads(other.read_text())["totals"]
        again[rows] = round(totals["tiles_again"] / (totals["tiles"] - totals["tiles_again"]), 4)
        other.unlink()

    told = run(program, "plan", chart, film, "-o", job, "--unit-rows", "7")
    units = len(json.loads(job.read_text())["units"])
    for unit in range(units):
        run(program, "run", "--plan", job, "--unit", str(unit))
    alone = records(film)

    # As many workers at once as the contract names, of one thread each, on one more film.
    at_once = 8
    crowd_film, crowd_job = scratch / "crowd.zarr", scratch / "crowd.json"
    shutil.rmtree(crowd_film, ignore_errors=True)
    crowd_job.unlink(missing_ok=True)
    run(program, "plan", "gen:composite?size=" + size, crowd_film, "-o", crowd_job, "--bands", "8:16", "--unit-rows", "7")
    start = time.monotonic()
    crowd = [
        subprocess.Popen(
            [program, "run", "--plan", crowd_job, "--unit", str(u), "--threads", "1", "--memory", "1GiB"],
            stderr=subprocess.DEVNULL,
        )
        for u in range(at_once)
    ]
    assert [w.wait() for w in crowd] == [0] * at_once
    crowd_s = time.monotonic() - start
    shares = []
    for r in records(crowd_film):
        start_up = r["startup_s"] + r["thread_s"]["prepare"]
        shares.append(start_up / (r["startup_s"] + r["wall_s"]))

    mean = lambda of: round(statistics.mean(of(r) for r in alone), 4)
    measured = {
        "what": told.stderr.splitlines(),
        "units": f"{units} bands ({bands} nm) of {size} px, chart with 1 % noise from a store",
        "unit": {
            "core_s": mean(lambda r: sum(r["core_s"].values())),
            "codec_core_s": mean(lambda r: sum(r["core_s"][k] for k in CODEC)),
            "startup_s": mean(lambda r: r["startup_s"] + r["core_s"]["prepare"]),
            "read_gb": mean(lambda r: (r["bytes_read"] or 0) * 1e-9),
            "written_gb": mean(lambda r: r["bytes_written"] * 1e-9),
            "wall_s": mean(lambda r: r["wall_s"]),
        },
        "tiles_again_by_rows": again,
        "workers_at_once": {
            "workers": at_once,
            "threads_each": 1,
            "cores": os.cpu_count(),
            "load_before": os.getloadavg()[0],
            "wall_s": round(crowd_s, 2),
            "startup_share_of_unit": [round(s, 4) for s in shares],
        },
        "records": alone,
    }
    (HERE / "measured.json").write_text(json.dumps(measured, indent=1) + "\n")
    print(json.dumps({k: v for k, v in measured.items() if k != "records"}, indent=1))


if __name__ == "__main__":
    main()
