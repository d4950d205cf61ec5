"""Cameras: raws, their development and comparison."""

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from . import _films, _temporary
from ._arguments import arguments
from ._charts import given
from ._picture import Picture
from ._process import execute
from .commands import Chart, PathLike

if TYPE_CHECKING:
    from typing import Unpack

    import xarray

    from . import _flags as f


def sensor(film: Chart, raw: PathLike | None = None, **flags: "Unpack[f.Sensor]") -> "xarray.Dataset | Picture":
    """Exposes a camera's sensor to a film: the raw mosaic with noise.

    film: a film, or a raw that kept its signal: the Dataset of `run` or `open`, or a path.
    raw: path of the raw, a Zarr group; None: a temporary folder; or one frame as .dng, .tif or .png.
    flags: sensor="cmv12000-rgb", exposure="auto" or "10ms", seed=1, noise="none" …; `lenscube.flags("sensor")`.

    Returns `raw` (frame, y [mm], x [mm]) u16 in digital numbers, lazy, with the coordinate `exposure_s`; a Picture of a file.
    """
    path = os.fspath(raw if raw is not None else _temporary.folder_until_exit() / "raw.zarr")
    execute(arguments(("sensor",), [_films.path_of(film, "film"), path], flags))
    return Picture(path) if path.lower().endswith((".dng", ".tif", ".tiff", ".png")) else _films.open(path)


def develop(raw: Any, out: PathLike | None = None, **flags: "Unpack[f.Develop]") -> Picture:
    """Develops a raw to a picture: white balance, demosaicing, colour matrix.

    raw: the Dataset of `sensor` or `open`, or a path; out: .png, .tif (depth=16) or .exr (linear light); None: a temporary PNG, which a notebook
    shows. `develop(raw, "p.tif", depth=16).to_xarray()` has the samples (y, x, channel).
    """
    out = Path(out) if out is not None else _temporary.folder_until_exit() / "picture.png"
    execute(arguments(("develop",), [_films.path_of(raw, "raw"), out], flags))
    return Picture(out)


def shoot(chart: Chart, out: PathLike | None = None, *, temp_dir: PathLike | None = None, **flags: "Unpack[f.Shoot]") -> Picture:
    """Chart to picture in one call: run, sensor, develop.

    chart, temp_dir: as of `run`; out: .png, .tif, .exr or .dng; None: a temporary PNG, which a notebook shows.

    >>> lenscube.shoot(cube, lens="double-gauss-28", sensor="sony-a7r2", film_pitch_um=4.5)
    """
    out = Path(out) if out is not None else _temporary.folder_until_exit() / "picture.png"
    with given(chart, dict(flags), temp_dir, for_film=True) as (name, flags_given):
        execute(arguments(("shoot",), [name, out], flags_given))
    return Picture(out)


def compare(first: Any, second: Any, out: PathLike, **flags: "Unpack[f.Compare]") -> dict[str, Any]:
    """Compares two raws, e.g. of two lenses under one seed: difference, SNR, MTF, colours; or two films: difference and MTF of each band. Writes
    report.html, figures and tables into the folder `out`; returns its figures."""
    execute(arguments(("compare",), [_films.path_of(first, "raw or film"), _films.path_of(second, "raw or film")], {**flags, "out": out}))
    return json.loads((Path(out) / "compare.json").read_text())
