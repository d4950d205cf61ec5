"""Lenses: figures, tracing, comparison."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ._arguments import arguments
from ._process import execute
from .commands import PathLike

if TYPE_CHECKING:
    from typing import Unpack

    from . import _flags as f


def lens(name: PathLike, **flags: "Unpack[f.LensShow]") -> dict[str, Any]:
    """Figures of a lens: a built-in name, a design (.zmx, .seq, .len, .csv, .zar, .json) or a lens pack.

    Focal lengths and positions in mm, wavelengths in nm, angles in degrees, relative illumination from 0 to 1, as the names of the fields say.
    plot="folder" writes figures: relative illumination, distortion, lateral colour, MTF, PSFs, spots, fans.

    >>> lenscube.lens("double-gauss-28", wavelengths=[450, 550, 650])
    """
    return json.loads(execute(arguments(("lens", "show"), [name], {**flags, "json": True})))


def lens_list() -> list[dict[str, Any]]:
    """The built-in lenses, with focal length [mm], f-number, half field [degrees] and source."""
    return json.loads(execute(arguments(("lens", "list"), [], {"json": True})))["designs"]


def lens_trace(design: PathLike, out: PathLike, **flags: "Unpack[f.LensTrace]") -> Path:
    """Traces a design into a lens pack (`out`: a directory or .zip), which `run(lens=…)` takes on any machine; its path."""
    execute(arguments(("lens", "trace"), [design, out], flags))
    return Path(out)


def lens_diff(a: PathLike, b: PathLike, **flags: "Unpack[f.LensDiff]") -> dict[str, Any]:
    """Two lenses side by side: heights, relative illumination and kernels by wavelength and real image height [mm]."""
    return json.loads(execute(arguments(("lens", "diff"), [a, b], {**flags, "json": True})))


def lens_camera(design: PathLike, **flags: "Unpack[f.LensCamera]") -> dict[str, Any]:
    """The pinhole camera whose picture and depth are the chart of a film of `film` pixels (N or "WxH"): place, focal length, field of view.

    Lengths in mm, angles in degrees. `command("lens", "camera", …)` prints it in the words of a renderer.

    >>> lenscube.lens_camera("phone", film_size="900x600", focus_m=0.5)["horizontal_fov_deg"]
    """
    return json.loads(execute(arguments(("lens", "camera"), [design], {**flags, "json": True})))
