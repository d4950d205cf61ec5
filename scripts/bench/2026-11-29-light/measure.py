"""Cost of tails and of all light on the paper's film: 31 bands of 14141 x 14141 px, drawn, within 1 GiB.

    python3 measure.py LENSCUBE FOLDER [--rounds 4] [--rounds-all 2]

Per round one film each without tails, with them, and in the first rounds with coatings, ghosts, scatter and glare too, in turn; bands are traced and ghosts are in the cache before anything is
timed. Prints core seconds (user and system time of the process), wall seconds and peak resident memory, and ratios to the film without tails, as JSON. FOLDER needs 16 GB.
"""

import argparse
import json
import os
import shutil
import subprocess
import time
from pathlib import Path

ALL = ["--coatings", "mgf2", "--scatter", "0.3%", "--veiling-glare", "1%", "--ghosts", "on", "--sensor-reflectance", "5%"]
FILMS = {"off": ["--tails", "off"], "tails": [], "all": ALL}
BANDS = "400:700:10"


def run(program, folder, flags):
    """Core seconds, wall seconds and peak MB of a film."""
    film = folder / "film.zarr"
    shutil.rmtree(film, ignore_errors=True)
    words = [program, "run", f"gen:composite?size=14141&wavelengths={BANDS}", str(film), "--memory", "1GiB", "--no-fsync", *flags]
    start = time.monotonic()
    process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)
    if status != 0:
        raise SystemExit(f"{' '.join(words)}: status {status}")
    shutil.rmtree(film)
    return [round(used.ru_utime + used.ru_stime, 2), round(time.monotonic() - start, 2), round(used.ru_maxrss / 1024)]


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("program")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--rounds", type=int, default=4)
    parser.add_argument("--rounds-all", type=int, default=2)
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    os.environ["XDG_CACHE_HOME"] = str((given.folder / "cache").resolve())
    for flags in FILMS.values():
        run(given.program, given.folder, flags)
    rounds = []
    for i in range(given.rounds):
        names = [name for name in FILMS if name != "all" or i < given.rounds_all]
        found = {name: run(given.program, given.folder, FILMS[name]) for name in names}
        found["ratios"] = {name: round(found[name][0] / found["off"][0], 3) for name in names if name != "off"}
        rounds.append(found)
        print(json.dumps(found), flush=True)


if __name__ == "__main__":
    main()
