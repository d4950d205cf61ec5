"""Speed of `lenscube sensor` and `develop` on the paper's film, as ratios to their bounds; on a machine that does nothing else.

    cargo build --release && python3 scripts/bench/2026-11-22-sensor/measure.py target/release/lenscube PLACE [FILM.zarr] > measured.json

PLACE: an empty directory on the disk that is measured; 12 GB for the film (drawn and computed first, unless one is given), 2 GB for raws and
pictures. Every command runs once, its input out of the page cache. Bound of a command: max(disk, core seconds / cores), disk = bytes
read / read rate + bytes written / write rate, both rates measured here with direct I/O on a file of the film.
"""
import json
import os
import resource
import subprocess
import sys
import time
from pathlib import Path

BINARY, PLACE = sys.argv[1], Path(sys.argv[2])
FILM = Path(sys.argv[3]) if len(sys.argv) > 3 else PLACE / "film.zarr"
CORES = len(os.sched_getaffinity(0))
MPX = 14141 * 14141e-6


def evict(path):
    for file in path.rglob("*") if path.is_dir() else [path]:
        if file.is_file():
            with open(file, "rb") as f:
                os.fsync(f.fileno())
                os.posix_fadvise(f.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)


def size(path):
    return sum(f.stat().st_size for f in path.rglob("*") if f.is_file()) if path.is_dir() else path.stat().st_size


def run(*words, threads=None):
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    words = [*words, "--threads", threads] if threads else words
    done = subprocess.run([BINARY, *map(str, words)], stderr=subprocess.PIPE, text=True)
    wall, after = time.monotonic() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        sys.exit(f"{words}: exit {done.returncode}\n{done.stderr}")
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    last = done.stderr.strip().splitlines()[-1]
    print(f"{wall:7.1f} s wall, {cpu:7.1f} s of cores: {' '.join(map(str, words))}\n    {last}", file=sys.stderr)
    return wall, cpu, last


def dd(*words):
    start = time.monotonic()
    subprocess.run(["dd", "bs=8M", *words], check=True, stderr=subprocess.DEVNULL)
    return time.monotonic() - start


def rates():
    """Read and write rate of the disk, bytes per second."""
    scratch, n = PLACE / "rate", 256
    write = n * 8 * 2**20 / dd("if=/dev/zero", f"of={scratch}", f"count={n}", "oflag=direct", "conv=fsync")
    read = n * 8 * 2**20 / dd(f"if={scratch}", "of=/dev/null", "iflag=direct")
    scratch.unlink()
    return read, write


rows = {}
if not FILM.exists():
    run("run", "gen:composite?size=14141", FILM, "--lens", "double-gauss-28-npz")
read_rate, write_rate = rates()


def measure(name, source, out, *words, read_bytes, threads=None):
    evict(source)
    wall, cpu, last = run(*words, threads=threads)
    disk = read_bytes / read_rate + size(out) / write_rate
    bound = max(disk, cpu / (threads or CORES))
    rows[name] = {"wall_s": wall, "core_s": cpu, "disk_s": disk, "bound_s": bound, "wall_over_bound": wall / bound,
                  "mpx_s": MPX / wall, "mpx_s_core": MPX / cpu, "last_line": last}


raw, again, small = (PLACE / f"{name}.zarr" for name in ("raw", "again", "small"))
sensor = ("--sensor", "example-2um", "--exposure", "40ms", "--overwrite")
measure("film to raw, 1:1", FILM, raw, "sensor", FILM, raw, *sensor, "--keep-signal", read_bytes=size(FILM))
measure("film to raw, 5.5 um", FILM, small, "sensor", FILM, small, "--sensor", "cmv12000-rgb", "--exposure", "40ms", "--overwrite", read_bytes=size(FILM))
measure("film to raw, 1:1, 256 MiB", FILM, again, "sensor", FILM, again, *sensor, "--memory", "256MiB", read_bytes=size(FILM))
measure("another exposure", raw / "signal", again, "sensor", raw, again, "--exposure", "20ms", "--overwrite", read_bytes=size(raw / "signal"))
measure("another exposure, one thread", raw / "signal", again, "sensor", raw, again, "--exposure", "20ms", "--overwrite", read_bytes=size(raw / "signal"), threads=1)
for name, file, flags in [("develop to PNG", "out.png", ()), ("develop to PNG, 256 MiB", "small.png", ("--memory", "256MiB")), ("develop to TIFF", "out.tif", ()), ("develop to TIFF, one thread", "one.tif", ("--threads", 1))]:
    measure(name, again, PLACE / file, "develop", again, PLACE / file, *flags, "--overwrite", read_bytes=size(again / "raw"))
print(json.dumps({"cores": CORES, "read_gb_s": read_rate * 1e-9, "write_gb_s": write_rate * 1e-9, "film_gb": size(FILM) * 1e-9, "rows": rows}, indent=1))
