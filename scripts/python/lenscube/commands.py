"""Charts, films, pictures and measurements."""

import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from . import _films, _temporary
from ._arguments import arguments
from ._charts import given
from ._picture import Picture
from ._process import execute
from ._progress import Event, Progress

if TYPE_CHECKING:
    from typing import Unpack

    import xarray

    from . import _flags as f

# A path, a store opened by this package, a cube of xarray, NumPy or Dask, or gen:KIND?…
Chart = Any
PathLike = str | os.PathLike[str]


def command(*words: str, **flags: Any) -> str:
    """Any command of the program, e.g. `command("cache", "clear")`; its standard output. Words after the command's name are its operands."""
    from ._program import description

    names, node = [], description()
    rest = list(words)
    while rest and (found := [c for c in node["commands"] if c["name"] == rest[0]]):
        names.append(rest.pop(0))
        node = found[0]
    if not names:
        raise TypeError(f"lenscube has no command {words[0] if words else ''!r}; commands: {', '.join(c['name'] for c in node['commands'])}")
    return execute(arguments(tuple(names), rest, flags))


def run_process(positional: list[Any], flags: dict[str, Any], shown: Progress) -> None:
    """Runs `lenscube run`, whose process ends with this one where the system has this (Linux)."""
    line = arguments(("run",), positional, flags)
    line[1:1] = ["--progress=jsonl", *(["--die-with-parent"] if sys.platform == "linux" else [])]
    execute(line, shown)


def run(
    chart: Chart,
    film: PathLike | None = None,
    *,
    progress: bool | Callable[[Event], None] | None = None,
    temp_dir: PathLike | None = None,
    **flags: "Unpack[f.Run]",
) -> "xarray.Dataset":
    """Simulates the film of a chart: relative illumination, distortion and the spatially variant PSF of a lens.

    chart: a path (Zarr, HDF5, NetCDF-4, .mat, .npy, ENVI, TIFF, pictures), "gen:KIND?…", or a cube in memory: a DataArray with the
        dimensions wavelength, y and x in any order, or an array (wavelength, y, x), other orders with axes="y,x,wavelength". Samples u1, u2,
        u4, i2, i4, f2, f4 or f8. A DataArray gives its wavelengths [nm, or as the attribute `units` says] by its coordinate, and the film pitch by its
        attribute `pitch_um` or evenly spaced coordinates x and y with a unit of length; else `wavelengths` [nm] and `film_pitch_um` do.
        Its attribute `units` is that of the film (`chart_units`); `scale_factor`, `add_offset`, `_FillValue`, `missing_value` and the valid
        range apply as in a store (xarray has applied those of a store that it opened with `decode_cf`).
        A cube in memory is written once to a temporary file, and identified by its content: of a store on disk pass the path.
    film: path of the film, a Zarr v3 group, or s3://BUCKET/PREFIX; None: a temporary folder, removed at the end of this process.
    progress: None: a bar on a terminal and in notebooks; True, False; or a function of the events of `--progress jsonl`.
    temp_dir: folder for the temporary chart, e.g. "/dev/shm" to keep it in memory [default: TMPDIR or /tmp].
    flags: those of `lenscube run`, `lenscube.flags("run")` explains them: lens="double-gauss-28", film_size=(640, 480) [width, height, px],
        bands=slice(450, 650) [nm], roi=(x, y, width, height) [px], stages=["ri", "distortion"], memory="2GiB", overwrite=True …

    Returns the film, lazy: `film` (wavelength [nm], y [mm], x [mm]) f32, in the chart's units times relative illumination unless
    `film_units` says otherwise. The same call resumes an interrupted film, and opens a complete one.

    >>> film = lenscube.run(cube, "film.zarr", lens="double-gauss-28", film_pitch_um=5)
    >>> film.film.sel(wavelength=550, method="nearest").plot()
    """
    if "dry_run" in flags:
        raise TypeError("run() has no keyword 'dry_run'; use forecast()")
    # No Path, which would shorten s3://.
    path = film if film is not None else _temporary.folder_until_exit() / "film.zarr"
    with given(chart, dict(flags), temp_dir, for_film=True) as (name, flags_given), Progress(progress) as shown:
        run_process([name, path], flags_given, shown)
    return _films.open(path)


def forecast(chart: Chart, film: PathLike, *, temp_dir: PathLike | None = None, **flags: "Unpack[f.Run]") -> str:
    """What `run` with the same arguments would read and write: bytes, time, memory, free space; nothing is written but traced lenses."""
    with given(chart, dict(flags), temp_dir, for_film=True) as (name, flags_given):
        return execute(arguments(("run",), [name, film], {**flags_given, "dry_run": True}))


def chart(kind: str, out: PathLike, **flags: "Unpack[f.Chart]") -> "xarray.Dataset":
    """Draws a test chart into a Zarr store: `chart("slanted-edge", "edges.zarr", size=2048, grid=5, pitch_um=2)`.

    kind: uniform, points, slanted-edge, iso12233-esfr, dot-grid, siemens, dead-leaves, oecf, checker, composite or depth-scene. Returns `chart` (wavelength [nm], y, x),
    lazy. `run("gen:slanted-edge?size=2048&grid=5")` draws it while it is read, without a store.
    """
    execute(arguments(("chart",), [kind, out], flags))
    return _films.open(out)


def chart_image(file: PathLike, out: PathLike, **flags: "Unpack[f.ChartImage]") -> "xarray.Dataset":
    """Converts a picture to a chart in a Zarr store: colours become spectra of reflected light. Returns `chart` (wavelength [nm], y, x), lazy."""
    execute(arguments(("chart", "image"), [file, out], flags))
    return _films.open(out)


def export(film: Chart, out: PathLike | None = None, **flags: "Unpack[f.Export]") -> Picture:
    """Exports a film or a chart, also one in memory, as a picture or as data; the format by the extension.

    out: .png (colours, or 16-bit grey with band=550 [nm]), .tif (16-bit colours), .exr, .hdr (ENVI) or .npy (all bands in f32); None: a
        temporary PNG, which a notebook shows.

    >>> lenscube.export(film, crop=(100, 100, 400, 300))      # x, y, width, height [px]
    """
    out = Path(out) if out is not None else _temporary.folder_until_exit() / "picture.png"
    with given(film, dict(flags)) as (name, flags_given):
        execute(arguments(("export",), [name, out], flags_given))
    return Picture(out)


def measure(film: Chart, **flags: "Unpack[f.Measure]") -> "xarray.Dataset":
    """Measures an edge, points or a profile in a film or chart; one of

    edge=(x0, y0, x1, y1): the edge near this line [px]. Returns `esf` (wavelength, distance_px) and `mtf` (wavelength, frequency_cy_px
        [cycles per pixel]), e-SFR of ISO 12233, and figures of each band;
    points=[(x, y), …]: centroids near these positions [px];
    profile=(x0, y0, x1, y1): `profile` (wavelength, distance_px), values along this line.

    Doubtful figures are warnings.

    >>> lenscube.measure(film, edge=(1020, 900, 1034, 1060)).mtf.plot(hue="wavelength")
    """
    from ._measured import dataset

    with given(film, dict(flags)) as (name, flags_given), _temporary.folder() as folder:
        result = folder / "measured.json"
        if "json" in flags_given:
            raise TypeError("measure() returns the figures; write them with Dataset.to_netcdf, to_dataframe, …")
        printed = execute(arguments(("measure",), [name], {**flags_given, "json": result}))
        return dataset(json.loads(result.read_text()), printed, flags_given)


def dataset(recipe: PathLike, out: PathLike, **flags: "Unpack[f.Dataset]") -> list[dict[str, Any]]:
    """Makes the data set of a recipe (TOML, `lenscube help datasets`) in the folder `out`. Returns the lines of its samples: what made each, its labels, its items;
    of one `part` of several none until all parts are made. The same call resumes. Pictures that cannot be read are a CheckError, once the others are made.

    >>> samples = lenscube.dataset("recipe.toml", "train", samples=1000)
    """
    execute(arguments(("dataset",), [recipe, out], {**flags, "json": True}))
    lines = Path(out) / "samples.jsonl"
    return [json.loads(line) for line in lines.read_text().splitlines()] if lines.exists() and not flags.get("dry_run") else []


def status(film: Chart, **flags: "Unpack[f.Status]") -> dict[str, Any]:
    """What is done of a film or raw: `complete`, `shards`, `shards_done`, `missing`, `bands`, the recorded runs and the job."""
    return json.loads(execute(arguments(("status",), [_films.path_of(film, "film")], {**flags, "json": True})))


def depth(scene: PathLike, **flags: "Unpack[f.Depth]") -> dict[str, Any]:
    """What the distances of a chart's pixels mean for a run with `lens`: blur in film pixels, depth nodes, slabs, time, memory, suspicious pixels.

    `scene` as for `lenscube depth`. Distances that `run` would refuse are a CheckError, with the report in `output`.

    >>> lenscube.depth("render.exr//Z", lens="phone", focus_m=1, film_pitch_um=1, plot="depth.png")["blur_px"]["greatest"]
    """
    return json.loads(execute(arguments(("depth",), [scene], {**flags, "json": True})))


def verify(film: Chart, **flags: "Unpack[f.Verify]") -> dict[str, Any]:
    """Reads and checks a film or raw completely; its report. Damaged or missing parts are a CheckError, with the report in `output`."""
    return json.loads(execute(arguments(("verify",), [_films.path_of(film, "film")], {**flags, "json": True})))
