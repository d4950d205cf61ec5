"""Random charts: the film depends on their samples, not on the store. Each round writes one cube as .npy and in several stores (Zarr v3 with and
without shards, its axes in any order, chunks of the fill value left out; Zarr v2; HDF5) and runs each with other threads, memory, shards and
chunks of the film, through a lens with a wide PSF. The films must be equal bit for bit. Run by check-interop and, longer, by check-long.

    check_storage.py LENSCUBE [ROUNDS [FIRST]]      a round depends on its number alone: FIRST repeats one
"""
import random
import subprocess
import sys
import tempfile
from pathlib import Path

import h5py
import numpy as np
import zarr
from zarr.codecs import BloscCodec, GzipCodec, ZstdCodec

LENSCUBE = sys.argv[1]
ROUNDS = int(sys.argv[2]) if len(sys.argv) > 2 else 6
FIRST = int(sys.argv[3]) if len(sys.argv) > 3 else 0
NM = [500.0, 520.0, 540.0]
AXES = ["wavelength", "y", "x"]
SIDES = [16, 32, 50, 64, 100, 128, 256, 512]


def run(*arguments):
    return subprocess.run([LENSCUBE, *map(str, arguments)], capture_output=True, text=True)


def make_packs(folder):
    """Lenses with PSF windows of 205 and 61 px, from three heights each."""
    packs = []
    for design, heights in [("fast-fifty", "0,10,21"), ("macro-70", "0,10,20")]:
        packs.append(folder / f"{design}.lens.zarr")
        traced = run("lens", "trace", design, packs[-1], "--wavelengths", "500:540:20", "--heights", heights, "--store", "psfs")
        assert traced.returncode == 0, traced.stderr
    return packs


class Round:
    def __init__(self, number, packs, folder):
        self.rng, self.number, self.folder = random.Random(number), number, folder
        numbers = np.random.default_rng(number)
        rng = self.rng
        short, long = rng.randint(20, 300), rng.randint(200, 1400)
        self.bands, height, width = rng.randint(1, 3), rng.choice([short, min(long, 1200)]), rng.choice([short, long])
        cube = numbers.uniform(0.1, 200, (self.bands, height, width))
        if rng.random() < 0.5:
            for _ in range(3):
                y, x = numbers.integers(0, height), numbers.integers(0, width)
                cube[:, y : y + 300, x : x + 300] = 0  # chunks of it are not stored
        self.cube = cube.astype(rng.choice(["f4", "f4", "f2", "u2", "u1", "f8"]))
        side = lambda n: rng.choice([s for s in SIDES if s <= max(16, 2 * n)])
        self.chunk = [rng.choice([1, 1, self.bands]), side(height), side(width)]
        self.flags = ["--lens", rng.choice(packs), "--film-pitch-um", rng.choice(["2", "3.7", "1.1"]), "--azimuths", "8", "--outside", "clamp",
                      "--surround", rng.choice(["edge", "black", "mirror"]), "--no-fsync"]
        if rng.random() < 0.5:
            self.flags += ["--film-size", f"{rng.randint(16, 900)}x{rng.randint(16, 700)}"]
        if rng.random() < 0.5:
            self.flags += ["--scale", f"{rng.uniform(0.3, 2.5):.3f},{rng.uniform(0.3, 2.5):.3f}"]
        if rng.random() < 0.4:
            self.flags += ["--center", f"{rng.uniform(-2, 2):.3f},{rng.uniform(-2, 2):.3f}"]
        if rng.random() < 0.3:
            self.flags += ["--psf-window", str(rng.choice([3, 11, 31])), "--tails", "off"]
        if rng.random() < 0.2:
            self.flags += ["--interp", "bilinear"]

    def machine(self):
        """Flags that must not change a sample."""
        rng, flags = self.rng, ["--threads", str(self.rng.randint(1, 3))]
        if rng.random() < 0.5:
            chunk = rng.choice([16, 32, 64, 128, 512])
            flags += ["--chunk", str(chunk), "--shard", str(chunk * rng.choice([1, 2, 4]))]
        if rng.random() < 0.3:
            flags += ["--memory", rng.choice(["300MiB", "400MiB", "600MiB"])]
        return flags

    def waves(self):
        return ["--wavelengths", ",".join(map(str, NM[: self.bands]))]

    def zarr(self, name, shards, order, version=3):
        group = zarr.open_group(self.folder / name, mode="w", zarr_format=version)
        samples, chunk = self.cube.transpose(order), [self.chunk[k] for k in order]
        more = {}
        if version == 3:
            codec = self.rng.choice([BloscCodec(cname="lz4"), ZstdCodec(), GzipCodec(), None])
            more = {"dimension_names": [AXES[k] for k in order], "compressors": codec}
        if shards:
            more["shards"] = [c * self.rng.randint(1, 4) for c in chunk]
        array = group.create_array("chart", shape=samples.shape, chunks=chunk, dtype=samples.dtype, fill_value=0, **more)
        array[:] = samples
        if version == 2:
            array.attrs["_ARRAY_DIMENSIONS"] = AXES
        return self.folder / name, self.waves()

    def stores(self):
        np.save(self.folder / "cube.npy", self.cube)
        plain = [0, 1, 2]
        yield "npy", (self.folder / "cube.npy", self.waves())
        yield "zarr", self.zarr("chunks", False, plain)
        yield "shards", self.zarr("shards", True, plain)
        yield "axes", self.zarr("axes", True, self.rng.choice([[1, 2, 0], [1, 0, 2], [0, 2, 1]]))
        yield "zarr v2", self.zarr("v2", False, plain, 2)
        if self.cube.dtype != np.float16:
            chunks = tuple(min(c, n) for c, n in zip(self.chunk, self.cube.shape))
            with h5py.File(self.folder / "cube.h5", "w") as file:
                file.create_dataset("chart", data=self.cube, chunks=chunks, compression=self.rng.choice([None, "gzip"]))
            yield "hdf5", (f"{self.folder}/cube.h5//chart", self.waves())

    def execute(self):
        """Findings, and whether a film was computed."""
        expected, findings = None, []
        for name, (chart, flags) in self.stores():
            machine = self.machine()
            film = self.folder / "film.zarr"
            ended = run("run", chart, film, *self.flags, *flags, *machine, "--overwrite")
            if ended.returncode == 2 and "--memory" in machine:
                continue  # this job needs more
            samples = zarr.open_group(film, mode="r")["film"][:].tobytes() if ended.returncode == 0 else ended.returncode
            if "panicked" in ended.stderr or expected is not None and samples != expected:
                findings.append(f"round {self.number}, {name}: another film than of .npy; {machine}; {ended.stderr.strip()[-300:]}")
            expected = samples if expected is None else expected
        return findings, isinstance(expected, bytes)


def main():
    findings, films = [], 0
    with tempfile.TemporaryDirectory() as scratch:
        packs = make_packs(Path(scratch))
        for number in range(FIRST, FIRST + ROUNDS):
            with tempfile.TemporaryDirectory(dir=scratch) as folder:
                found, is_film = Round(number, packs, Path(folder)).execute()
            findings += found
            films += is_film
    for finding in findings:
        print(finding)
    print(f"{ROUNDS} random charts in five or six stores each, {films} of them with a film: {len(findings)} findings")
    sys.exit(bool(findings) or films < ROUNDS // 2)


main()
