"""The paper's job, store to store, with tables whose PSFs have 51 px: 31 bands, relative illumination, distortion and SVPSF.

    python3 measure.py LENSCUBE FOLDER [--size 14141] [--runs 3] [--memory 1GiB]

Makes the chart once (composite, 1 % noise), then runs it with `double-gauss-28-npz`, in turn with its three stages and without SVPSF, and writes core seconds, wall seconds, peak memory and
bytes to measured-SIZE.json. The paper (doi:10.2352/EI.2025.37.7.ISS-285) prints 27 min 31 s for relative illumination and distortion and 46 min 15 s for SVPSF with
50 x 50 px PSFs of 31 bands of 14141 x 14141 px, on ten RTX A6000 with 2 TB of RAM.
"""

import argparse
import json
import os
import shutil
import statistics
import subprocess
import time
from pathlib import Path

parser = argparse.ArgumentParser()
parser.add_argument("lenscube")
parser.add_argument("folder", type=Path)
parser.add_argument("--size", type=int, default=14141)
parser.add_argument("--runs", type=int, default=3)
parser.add_argument("--memory", default="1GiB")
arguments = parser.parse_args()
chart = arguments.folder / f"chart-{arguments.size}.zarr"
if not chart.exists():
    subprocess.run([arguments.lenscube, "chart", "composite", chart, "--size", str(arguments.size), "--pitch-um", "2",
                    "--wavelengths", "400:700:10", "--noise", "0.01"], check=True)

jobs = {"all stages": [], "relative illumination and distortion": ["--stages", "ri,distortion"]}
found = {name: [] for name in jobs}
for _ in range(arguments.runs):
    for name, flags in jobs.items():
        film = arguments.folder / "film.zarr"
        shutil.rmtree(film, ignore_errors=True)
        load = os.getloadavg()[0]
        start = time.monotonic()
        subprocess.run([arguments.lenscube, "run", chart, film, "--lens", "double-gauss-28-npz", "--memory", arguments.memory, "--quiet", *flags], check=True)
        wall_s = time.monotonic() - start
        record = json.loads(next((film / "runs").glob("*.json")).read_text())
        found[name].append({"wall_s": round(wall_s, 2), "load_before": load, "record": record})
        print(name, f"{wall_s:.1f} s, load {load:.1f}", record.get("core_s"), flush=True)
cores = {name: statistics.median(sum(run["record"]["core_s"].values()) for run in runs) for name, runs in found.items()}
pixels = arguments.size**2 * 31
out = {"size_px": arguments.size, "cpu": next(line.split(":")[1].strip() for line in open("/proc/cpuinfo") if line.startswith("model name")),
       "cores": os.cpu_count(), "median_core_s": cores, "core_s_of_14141_px_by_pixels": {n: s * 14141**2 * 31 / pixels for n, s in cores.items()}, "runs": found}
Path(__file__).with_name(f"measured-{arguments.size}.json").write_text(json.dumps(out, indent=1) + "\n")
print(json.dumps({k: v for k, v in out.items() if k != "runs"}, indent=1))
