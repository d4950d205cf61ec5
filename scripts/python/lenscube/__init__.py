"""lenscube: the sensor-plane image (film) that a lens forms of a multispectral chart, from Python.

    >>> import lenscube
    >>> film = lenscube.run(cube, lens="double-gauss-28", film_pitch_um=5)    # cube: DataArray (wavelength [nm], y, x)
    >>> film.film                                                             # lazy: (wavelength [nm], y [mm], x [mm])

The work is done by the program `lenscube`, which the package contains: films are Zarr stores on disk, computed in bounded memory and
opened here as lazy xarray objects. Every flag of a command is a keyword of the same name with `_` for `-`; `lenscube.flags("run")` lists
them with their help. Values: numbers, texts and paths; a slice for a range (`bands=slice(450, 650)`), a sequence for a list
(`wavelengths=np.arange(400, 701, 10)`, `roi=(x, y, width, height)`), True for a switch.

    Lens                                 a lens in this process: films of arrays in memory, points, PSFs
    run, forecast, plan, Plan            chart to film; its cost; a job in units, for many processes
    chart, chart_image                   test charts; a picture as a chart
    sensor, develop, shoot, compare      film to raw, raw to picture, chart to picture, two raws
    export, measure                      pictures and data files; edges (MTF), points and profiles
    lens, lens_list, lens_trace, lens_diff    figures of lenses
    lens_camera                               the pinhole camera of a scene
    status, verify, open                 films and raws on disk
    command, flags                       any other command of the program, and the flags of all

A failure is an exception, one class for each exit code of the program (`lenscube.errors`). Ctrl-C, or the interrupt of a notebook, ends the
program in order and raises `lenscube.Interrupted`; the same call resumes. Notes of the program are warnings of the class
`lenscube.LenscubeWarning`; its other lines are logged by `logging.getLogger("lenscube")` at the level INFO.
"""

from ._arguments import flags
from ._films import open
from ._lens import Lens
from ._picture import Picture
from ._plan import Plan, plan
from ._program import path as program
from ._signatures import describe
from .camera import compare, develop, sensor, shoot
from .commands import chart, chart_image, command, dataset, depth, export, forecast, measure, run, status, verify
from .errors import (
    CheckError,
    FailedError,
    Interrupted,
    KilledError,
    LenscubeError,
    LenscubeWarning,
    OtherJobError,
    TemporaryError,
    UsageError,
)
from .lenses import lens, lens_camera, lens_diff, lens_list, lens_trace

describe(
    {
        ("run",): run,
        ("plan",): plan,
        ("dataset",): dataset,
        ("depth",): depth,
        ("chart",): chart,
        ("chart", "image"): chart_image,
        ("export",): export,
        ("measure",): measure,
        ("status",): status,
        ("verify",): verify,
        ("sensor",): sensor,
        ("develop",): develop,
        ("shoot",): shoot,
        ("compare",): compare,
        ("lens", "show"): lens,
        ("lens", "trace"): lens_trace,
        ("lens", "camera"): lens_camera,
        ("lens", "diff"): lens_diff,
    }
)

__all__ = [
    "CheckError",
    "FailedError",
    "Interrupted",
    "KilledError",
    "LenscubeError",
    "LenscubeWarning",
    "Lens",
    "OtherJobError",
    "Picture",
    "Plan",
    "TemporaryError",
    "UsageError",
    "chart",
    "chart_image",
    "command",
    "compare",
    "dataset",
    "depth",
    "develop",
    "export",
    "flags",
    "forecast",
    "lens",
    "lens_camera",
    "lens_diff",
    "lens_list",
    "lens_trace",
    "measure",
    "open",
    "plan",
    "program",
    "run",
    "sensor",
    "shoot",
    "status",
    "verify",
]
