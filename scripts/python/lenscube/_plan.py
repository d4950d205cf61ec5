"""A job in units, for many processes or machines; the units are computed in any order and more than once, with the same bytes."""

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from . import _films
from ._arguments import arguments
from ._process import execute
from ._progress import Event, Progress
from .commands import PathLike, run_process

if TYPE_CHECKING:
    from typing import Unpack

    import xarray

    from . import _flags as f


class Plan(os.PathLike[str]):
    """A plan that `lenscube plan` has written. `path`: its file; `film`: path of the film; `units`: number of units; `job`: all it holds."""

    def __init__(self, path: PathLike):
        self.path = Path(path)
        self.job: dict[str, Any] = json.loads(self.path.read_text())
        self.film: str = self.job["command"]["film"]
        self.units = len(self.job["units"])

    def __fspath__(self) -> str:
        return str(self.path)

    def __repr__(self) -> str:
        return f"Plan({str(self.path)!r}: {self.units} units of {self.film})"

    def missing(self) -> str:
        """The units to compute, as `3,7-9`; empty if the film is complete."""
        return execute(arguments(("status",), [], {"plan": self.path, "missing": True})).strip()

    def run(
        self, unit: str | int | None = None, *, progress: bool | Callable[[Event], None] | None = None, **flags: "Unpack[f.Run]"
    ) -> "xarray.Dataset":
        """Computes units, e.g. 7 or "3,7-9" [default: all that are missing]; the film, in which other units may be missing (NaN)."""
        with Progress(progress) as shown:
            run_process([], {**flags, "plan": self.path, "unit": unit}, shown)
        return self.open()

    def open(self) -> "xarray.Dataset":
        """The film, lazy, as of `lenscube.open`."""
        return _films.open(self.film)


def plan(chart: PathLike, film: PathLike, output: PathLike = ".", **flags: "Unpack[f.Plan]") -> Plan:
    """Divides a job into units and writes the plan (`output`: its file, or a folder).

    chart, film: paths, since other processes read them; flags: those of `run`, unit_rows and lens_pack.

    >>> plan = lenscube.plan("chart.zarr", "film.zarr", "job.json", lens="double-gauss-28")
    >>> plan.run(unit=0); plan.missing()
    """
    name = _films.path_of(chart, "chart of a plan")
    return Plan(execute(arguments(("plan",), [name, film], {**flags, "output": output})).strip())
