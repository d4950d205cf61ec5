"""Comparison of films with those of clean runs: an undisturbed run of the job with the same chart and lens pack."""
import hashlib
import json
import math
import re
import shutil
import threading
from dataclasses import dataclass, field
from pathlib import Path

from inputs import CHARTS, digest, files

TEMP, LOCK = ".tmp-", ".lock"


@dataclass(frozen=True)
class Job:
    """Arguments of `run` and `plan` except the paths of chart, lens and film."""

    name: str
    chart: str  # kind of chart, a key of CHARTS
    lens: str  # "built-in", kind of pack: "pack", "zip"; or "built": a design with manufacturing errors
    flags: tuple  # that change the film

    def arguments(self, folder):
        """(path of the chart, flags)."""
        chart, flags = CHARTS[self.chart]
        lens = {"built-in": ["double-gauss-28-npz"], "pack": [folder / "lens/lens.lens.zarr"], "zip": [folder / "lens/lens.zip"],
                "built": [folder / "lens/design.csv", "--tolerances", folder / "lens/tolerances.toml"]}[self.lens]
        window = ["--psf-window", "9", "--memory", "256MiB", "--device", "cpu"]
        return folder / f"chart-{self.chart}" / chart, [*flags, "--lens", *lens, *window, *self.flags]


@dataclass
class CleanFilm:
    """Digests of the files of a clean run by path, of the same film with its pyramid, and exports by format."""

    path: Path
    files: dict
    provenance: dict
    with_pyramid: dict = None
    exports: dict = field(default_factory=dict)


def provenance(film):
    """Job and layout in a film's metadata, or None."""
    try:
        found = json.loads((film / "zarr.json").read_text())["attributes"]["provenance"]
        return {"job": found["job"], "layout": found["layout"]}
    except (OSError, ValueError, KeyError, TypeError):
        return None


def film_files(film):
    """Digests of the film's files except its run records."""
    return {name: film_digest(film / name, name) for name in files(film) if not name.startswith("runs/")}


def film_digest(path, name):
    """Digest of a file of a film; of its metadata without the paths of chart and lens, which may be copies, and the digests over them."""
    if Path(name).name != "zarr.json":
        return digest(path)
    try:
        metadata = json.loads(path.read_text(errors="replace"), object_hook=without_paths)
    except ValueError:
        return digest(path)
    return hashlib.sha256(json.dumps(metadata).encode()).hexdigest()


def without_paths(fields):
    return {key: value for key, value in fields.items() if key not in ("source", "film_stamp", "attributes_digest")}


class CleanFilms:
    """Clean films, one for each job, state of the chart and state of the pack."""

    def __init__(self, folder, blobs, call):
        self.folder, self.blobs, self.call = folder, blobs, call
        self.films, self.lock = {}, threading.Lock()
        self.made = 0

    def get(self, job, chart, lens):
        """The clean film, or the error of a run that does not end with 0."""
        identity = json.dumps([job.chart, job.lens, job.flags, chart, lens if job.lens != "built-in" else None], sort_keys=True)
        key = hashlib.sha256(identity.encode()).hexdigest()[:20]
        with self.lock:
            if key not in self.films:
                self.films[key] = self.make(job, chart, lens, self.folder / key)
            return self.films[key]

    def make(self, job, chart, lens, folder):
        self.made += 1
        self.blobs.place(chart, folder / f"chart-{job.chart}")
        self.blobs.place(lens or {}, folder / "lens")
        source, flags = job.arguments(folder)
        film = folder / "film.zarr"
        try:
            self.call("run", source, film, "--no-fsync", *flags)
        except RuntimeError as e:
            return str(e)
        self.check_finite(film)
        return CleanFilm(film, film_files(film), provenance(film))

    def check_finite(self, film):
        """A clean film must have no NaN and no infinity."""
        out = film.parent / "pixels.npy"
        self.call("export", film, out)
        _, values = npy(out.read_bytes())
        if not all(map(math.isfinite, values)):
            raise RuntimeError(f"a clean run made a film with NaN or infinity: {film}")
        out.unlink()

    def pyramid(self, clean):
        with self.lock:
            if clean.with_pyramid is None:
                copy = clean.path.with_name("pyramid.zarr")
                shutil.copytree(clean.path, copy)
                self.call("pyramid", copy)
                clean.with_pyramid = film_files(copy)
            return clean.with_pyramid

    def export(self, clean, form):
        """The exported file's bytes."""
        with self.lock:
            if form not in clean.exports:
                out = clean.path.with_name(f"export.{form}")
                self.call("export", clean.path, out)
                clean.exports[form] = out.read_bytes()
            return clean.exports[form]


def npy(data):
    """(header, values) of a .npy file of f32 or f16."""
    head = 10 + int.from_bytes(data[8:10], "little")
    kind = {b"<f4": "f", b"<f2": "e"}[re.search(rb"'descr': '(...)'", data[:head])[1]]
    return data[:head], memoryview(data[head:]).cast(kind).tolist()


def same_or_missing(actual, clean):
    """Whether a .npy file has the values of the clean one, or NaN for missing shards."""
    (head, values), (clean_head, clean_values) = npy(actual), npy(clean)
    return head == clean_head and all(a == b or math.isnan(a) for a, b in zip(values, clean_values, strict=True))


def compare(film, clean, pyramid, foreign_files, complete):
    """Files that differ from those of the clean run or are not part of it, and missing ones if the film is reported as complete.
    `pyramid`: digests of the clean film with its pyramid, if there is one. Temporary files and locks are checked by `leftovers`."""
    found = []
    actual = film_files(film)
    skipped = lambda name: name in foreign_files or any(part.startswith(TEMP) for part in name.split("/"))
    for name, sha in actual.items():
        if skipped(name):
            continue
        allowed = [clean.files.get(name)] + ([pyramid.get(name)] if pyramid else [])
        if not any(allowed):
            found.append(f"{name} is not part of the clean film")
        elif sha not in allowed:
            found.append(f"{name} differs from the clean film's")
    if complete:
        found += [f"{name} is missing" for name in clean.files if name not in actual]
    return found


def leftovers(folder, foreign_files):
    """Temporary files and locks."""
    found = []
    for place in [folder, *folder.rglob("*")]:
        name = place.name
        if (name.startswith(TEMP) or name.endswith(LOCK)) and str(place.relative_to(folder)) not in foreign_files:
            found.append(str(place.relative_to(folder)))
    return found
