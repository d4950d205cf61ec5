"""Memory that jobs ask for against what they use.

    python3 measure.py LENSCUBE FOLDER [JOB ...]

Each job runs three times: under --memory 1MiB, for the least limit that it asks for; under that limit; under 1 GiB. From the records of the films: the planned and the used
memory (largest resident size). Writes measured.json beside this file and prints a table. Designs are traced before, by a run with 1 GiB.
"""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

program, folder, chosen = sys.argv[1], Path(sys.argv[2]), sys.argv[3:]
folder.mkdir(exist_ok=True)


def made(name, *words):
    path = folder / name
    if not path.exists():
        subprocess.run([program, *words[:2], path, *words[2:]], check=True, capture_output=True)
    return path


def chart(size, nm, *flags):
    return made(f"chart-{size}-{nm.replace(':', '-')}{''.join(flags)}.zarr", "chart", "composite", "--size", str(size), "--pitch-um", "2", "--wavelengths", nm, *flags)


small = chart(1500, "500:600:50")
bands = chart(1000, "400:700:10")
large = chart(4000, "550")
noise = chart(1500, "500:600:50", "--noise", "0.01")
phone = "gen:depth-scene?size=2000x1500&pitch_um=0.8&near_m=0.5&far_m=inf&wavelengths=550"
JOBS = {
    "flat, tables of 51 px, 3 bands of 1500²": ("run", small, "--lens", "double-gauss-28-npz"),
    "flat, tables of 51 px, 31 bands of 1000²": ("run", bands, "--lens", "double-gauss-28-npz"),
    "flat, traced, 3 bands of 1500²": ("run", small),
    "flat, traced, 31 bands of 1000²": ("run", bands),
    "flat, traced, a band of 4000²": ("run", large),
    "flat, traced, a band of 4000² in shards of 512²": ("run", large, "--shard", "512"),
    "flat, 400 nm, 1500² (wide windows)": ("run", bands, "--bands", "400", "--film-size", "1000"),
    "fast-fifty, a band of 1500² (377 px)": ("run", small, "--lens", "fast-fifty", "--bands", "550"),
    "flat, no PSF, 3 bands of 1500²": ("run", noise, "--stages", "ri,distortion"),
    "a region of 300 x 200 px": ("run", large, "--roi", "1800,1800,300,200"),
    "veil, a band of 4000²": ("run", large, "--scatter", "1%"),
    "depth, phone, 2000 x 1500": ("run", phone, "--lens", "phone", "--focus-m", "1", "--film-pitch-um", "0.8"),
    "sensor, film of 1500², 3 bands": ("sensor", "flat, traced, 3 bands of 1500²"),
}


def run(kind, words, name, memory):
    out = folder / f"{name.replace('/', '-')}.{kind}.zarr"
    shutil.rmtree(out, ignore_errors=True)
    first = words[0] if kind == "run" else folder / f"{words[0].replace('/', '-')}.run.zarr"
    flags = words[1:] if kind == "run" else ["--sensor", "example-2um", "--exposure", "auto"]
    done = subprocess.run([program, kind, first, out, *flags, "--memory", memory, "--quiet", "--no-fsync"], capture_output=True, text=True)
    records = sorted((out / "runs").glob("*.json"))
    return done, json.loads(records[0].read_text()) if records and done.returncode == 0 else None


rows = []
for name, (kind, *words) in JOBS.items():
    if chosen and not any(c in name for c in chosen):
        continue
    done, wide = run(kind, words, name, "1GiB")
    if wide is None:
        print(name, done.stderr.strip().splitlines()[-1:], flush=True)
        continue
    rejected, _ = run(kind, words, name, "1MiB")
    asked = re.search(r"(?:at least|requires?) (\d+)MiB", rejected.stderr)
    row = {"job": name, "planned_1gib": wide.get("memory_planned_bytes"), "used_1gib": wide["peak_resident_bytes"]}
    if asked is None:
        print(name, rejected.stderr.strip().splitlines()[-1:], flush=True)
    else:
        row["asked"] = int(asked[1]) << 20
        _, least = run(kind, words, name, f"{asked[1]}MiB")
        row["used"] = least and least["peak_resident_bytes"]
        run(kind, words, name, "1GiB")
    rows.append(row)
    mib = lambda key: f"{row[key] / 2**20:6.0f}" if row.get(key) else "     -"
    over = f"{row['asked'] / row['used']:.2f}" if row.get("used") else "-"
    print(f"{name:52} asked {mib('asked')} used {mib('used')} ({over})   1GiB: planned {mib('planned_1gib')} used {mib('used_1gib')} MiB", flush=True)
Path(__file__).with_name("measured.json").write_text(json.dumps(rows, indent=1) + "\n")
