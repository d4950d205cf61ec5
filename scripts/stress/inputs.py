"""Charts and lens packs in two versions each, changes to them while they are read, and digests of folders.

A state of a folder is {path: (SHA-256, modification time in ns)}; contents are stored by digest, so that every state that occurred
in a round can be restored for a clean run.
"""
import array
import hashlib
import json
import os
import re
import shutil
import time
import zipfile
from pathlib import Path

SIZE = (104, 480)  # of the film: two tiles a band, and enough for one pyramid level
WAVELENGTHS = "450,500,550"
PITCH_UM = "10"
# Charts: the file for `run`, and the flags that it needs.
FLAT = ["--film-pitch-um", PITCH_UM]
CHARTS = {
    "zarr": ("chart.zarr", []),
    "zstd": ("chart.zarr", []),
    "chunks": ("chart.zarr", [*FLAT, "--wavelengths", WAVELENGTHS]),
    "npy": ("chart.npy", [*FLAT, "--wavelengths", WAVELENGTHS]),
    "bsq": ("chart.hdr", FLAT),
    "bip": ("chart.hdr", FLAT),
    "exr": ("chart.exr", FLAT),
}
CHUNK = 80
ROOT = Path(__file__).resolve().parents[2]
# Of the triplet's last element: its lenses are traced in 2 s (optimised) to 4 s (debug build) of one core, once.
TOLERANCES = """[[element]]
surfaces = [5, 6]
decentre_um = 20
tilt_arcmin = 2
[[film]]
tilt_arcmin = 3
[criterion]
kind = "rms-spot"
"""


def digest(path):
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


def files(folder):
    """Relative paths of all files below, sorted."""
    found = []
    for place, _, names in os.walk(folder):
        found += [os.path.relpath(os.path.join(place, name), folder) for name in names]
    return sorted(found)


class Blobs:
    """Content store of the files of all states."""

    def __init__(self, folder):
        self.folder = folder
        folder.mkdir(parents=True)

    def state(self, folder):
        found = {}
        for name in files(folder):
            path = Path(folder) / name
            key = digest(path)
            found[name] = (key, path.stat().st_mtime_ns)
            kept = self.folder / key
            if not kept.exists():
                temp = self.folder / f"{key}.{os.getpid()}.{time.monotonic_ns()}"
                shutil.copyfile(path, temp)
                temp.rename(kept)
        return found

    def place(self, state, folder):
        """Writes the files of a state into the folder."""
        for name, (key, mtime) in state.items():
            self.put(key, mtime, Path(folder) / name)

    def put(self, key, mtime, path, how="rename"):
        """Writes content and modification time of `path`; `how`: by rename, or in place."""
        path.parent.mkdir(parents=True, exist_ok=True)
        if how == "rename":
            temp = path.with_name(f"{path.name}.new")
            shutil.copyfile(self.folder / key, temp)
            os.utime(temp, ns=(mtime, mtime))
            temp.rename(path)
        else:
            data = (self.folder / key).read_bytes()
            half = len(data) // 2 if how == "first half" else len(data)
            with open(path, "wb" if how == "truncate" else "r+b") as f:
                f.write(data[:half])
                if half == len(data):
                    f.truncate()


class Inputs:
    """charts[kind][n] and lenses[kind][n] are the states of version n, with modification times in the past."""

    def __init__(self, folder, call):
        self.blobs = Blobs(folder / "blobs")
        self.charts, self.lenses = {}, {}
        work = folder / "made"
        size = "x".join(map(str, SIZE))
        for n, more in enumerate([["--noise", "0.02"], ["--noise", "0.2"]]):
            drawn = ["--size", size, "--wavelengths", WAVELENGTHS, "--pitch-um", PITCH_UM, "--overscan", "8", *more]
            for kind, codec in [("zarr", "none"), ("zstd", "zstd")]:
                call("chart", "composite", work / f"{kind}{n}/chart.zarr", "--codec", codec, *drawn)
            source = work / f"zarr{n}/chart.zarr"
            for kind, name in [("npy", "chart.npy"), ("bsq", "chart.hdr"), ("exr", "chart.exr")]:
                (work / f"{kind}{n}").mkdir()
                call("export", source, work / f"{kind}{n}" / name)
            self.bip(work / f"bsq{n}", work / f"bip{n}")
            self.chunks(work / f"npy{n}/chart.npy", work / f"chunks{n}/chart.zarr")
            for kind in CHARTS:
                self.charts.setdefault(kind, []).append(self.keep(work / f"{kind}{n}", n))
        builtin = ROOT / "formats/data/double-gauss-28.lens.zip"
        for n in range(2):
            self.packs(builtin, work / f"pack{n}", work / f"zip{n}", n)
            for kind in ("pack", "zip"):
                self.lenses.setdefault(kind, []).append(self.keep(work / f"{kind}{n}", n))
        (work / "built").mkdir()
        shutil.copyfile(ROOT / "formats/data/lenses/triplet.csv", work / "built/design.csv")
        (work / "built/tolerances.toml").write_text(TOLERANCES)
        self.lenses["built"] = [self.keep(work / "built", 0)]
        shutil.rmtree(work)

    def keep(self, folder, n):
        past = 1_600_000_000_000_000_000 + n * 3_600_000_000_000
        for k, name in enumerate(files(folder)):
            os.utime(folder / name, ns=(past + k, past + k))
        return self.blobs.state(folder)

    @staticmethod
    def bip(bsq, to):
        to.mkdir()
        header = (bsq / "chart.hdr").read_text()
        bands = int(re.search(r"^bands\s*=\s*(\d+)", header, re.M)[1])
        (to / "chart.hdr").write_text(re.sub(r"(?mi)^(interleave\s*=\s*)bsq", r"\1bip", header))
        (data,) = [p for p in bsq.iterdir() if p.suffix != ".hdr"]
        flat = array.array("f", data.read_bytes())
        interleaved = array.array("f", bytes(len(flat) * 4))
        for band in range(bands):
            interleaved[band::bands] = flat[band * (len(flat) // bands) : (band + 1) * (len(flat) // bands)]
        (to / data.name).write_bytes(interleaved.tobytes())

    @staticmethod
    def chunks(npy, to):
        """A Zarr array of small raw chunks, each with all bands."""
        data = npy.read_bytes()
        head = 10 + int.from_bytes(data[8:10], "little")
        bands, rows, columns = map(int, re.search(rb"'shape': \((\d+), (\d+), (\d+),?\)", data[:head]).groups())
        pixels = memoryview(data[head:]).cast("f", (bands, rows, columns)).tolist()
        to.mkdir(parents=True)
        grid = {"name": "regular", "configuration": {"chunk_shape": [bands, CHUNK, CHUNK]}}
        keys = {"name": "default", "configuration": {"separator": "/"}}
        codecs = [{"name": "bytes", "configuration": {"endian": "little"}}]
        meta = {"zarr_format": 3, "node_type": "array", "shape": [bands, rows, columns], "data_type": "float32", "chunk_grid": grid}
        meta |= {"chunk_key_encoding": keys, "fill_value": 0.0, "codecs": codecs, "attributes": {}}
        (to / "zarr.json").write_text(json.dumps(meta))
        for i in range(0, rows, CHUNK):
            for j in range(0, columns, CHUNK):
                chunk = array.array("f")
                for band in range(bands):
                    for y in range(i, i + CHUNK):
                        row = pixels[band][y][j : j + CHUNK] if y < rows else []
                        chunk.extend(row + [0.0] * (CHUNK - len(row)))
                path = to / f"c/0/{i // CHUNK}/{j // CHUNK}"
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(chunk.tobytes())

    @staticmethod
    def packs(builtin, folder, zipped, n):
        """The built-in pack as a directory and as a .zip; in version 1 the PSFs of neighbouring bands are swapped."""
        folder, zipped = folder / "lens.lens.zarr", zipped / "lens.zip"
        with zipfile.ZipFile(builtin) as z:
            members = {name: z.read(name) for name in z.namelist() if not name.endswith("/")}
        shards = [f"psf/{k}/c/0/0/0" for k in range(31)]
        if n:
            old = dict(members)
            for k in range(0, 30, 2):
                members[shards[k]], members[shards[k + 1]] = old[shards[k + 1]], old[shards[k]]
        zipped.parent.mkdir(parents=True)
        with zipfile.ZipFile(zipped, "w") as z:
            for name, data in members.items():
                z.writestr(name, data)
                path = folder / name
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(data)
