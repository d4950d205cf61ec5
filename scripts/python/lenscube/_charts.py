"""Charts in memory: written once into a temporary .npy file, which the program maps; their wavelengths, pitch and unit become flags, their
other attributes a file beside it, which the program reads as those of a stored array.

Arrays of NumPy, and lazy ones of xarray, are written in slabs, those of Dask chunk by chunk: no second copy of the cube is made in memory.
The map of a complete .npy file is passed by its name, read-only meanwhile. An array is identified by its content (`check_input`), so that
the same one resumes a film, also from another session, and a changed one is another job.
"""

import contextlib
import json
import math
import os
import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from . import _temporary
from ._films import registered

if TYPE_CHECKING:
    import numpy
    import xarray

# Samples that the program reads.
DTYPES = ("u1", "u2", "u4", "i2", "i4", "f2", "f4", "f8")
SLAB_BYTES = 64 << 20
SPECTRAL = ("wavelength", "wavelengths", "wavelength_nm", "wave", "wl", "lambda", "band", "bands", "channel", "channels", "spectral")
ROWS = ("y", "row", "rows", "line", "lines", "height")
COLUMNS = ("x", "col", "column", "columns", "sample", "samples", "width")
MICROMETRES = ("um", "µm", "μm", "micrometer", "micrometers", "micrometre", "micron", "microns")
NM = dict.fromkeys(("nm", "nanometer", "nanometers", "nanometre"), 1.0) | dict.fromkeys(MICROMETRES, 1e3)
UM = {"m": 1e6, "cm": 1e4, "mm": 1e3} | dict.fromkeys(MICROMETRES, 1.0)


@contextlib.contextmanager
def given(
    chart: Any, flags: dict[str, Any], temp_dir: str | os.PathLike[str] | None = None, for_film: bool = False
) -> Iterator[tuple[str, dict[str, Any]]]:
    """The program's name of a chart (a path, gen:…, Dataset, DataArray or array), and the flags with what the array adds.

    With `for_film` an array is identified by its content, and its pitch and unit become film_pitch_um and chart_units, where those are
    not given.
    """
    if stored := registered(chart):
        yield stored, flags
        return
    if for_film and flags.get("check_input") is None:
        flags = {**flags, "check_input": True}
    if mapped := _mapped_file(chart):
        with _read_only(chart):
            yield mapped, flags
        return
    array = standard(chart, flags.get("axes"))
    flags = {name: value for name, value in flags.items() if name != "axes"}
    if flags.get("wavelengths") is None and (nm := wavelengths_nm(array)) is not None:
        flags["wavelengths"] = nm
    if for_film and flags.get("film_pitch_um") is None and (um := pitch_um(array)) is not None:
        flags["film_pitch_um"] = um
    if for_film and flags.get("chart_units") is None and str(array.attrs.get("units", "")).strip():
        flags["chart_units"] = str(array.attrs["units"])
    with _temporary.folder(temp_dir) as folder:
        _check_space(folder, array.nbytes)
        path = folder / "chart.npy"
        write(path, array)
        yield str(path), flags


def _mapped_file(chart: Any) -> str | None:
    """The .npy file of which an array is the complete map (`np.load(…, mmap_mode="r")`), unless another file has its name by now.

    A copy-on-write map may differ from its file, and attributes beside the file are not those of the array.
    """
    import numpy

    name = getattr(chart, "filename", None)
    if not isinstance(chart, numpy.memmap) or name is None or not str(name).endswith(".npy") or chart.mode == "c":
        return None
    if _beside(Path(name)).exists():
        return None
    chart.flush()
    try:
        whole = numpy.load(name, mmap_mode="r")
    except (OSError, ValueError):
        return None
    same = [(a.shape, a.dtype, a.strides, a.offset) for a in (chart, whole)]
    return str(name) if same[0] == same[1] and _same_bytes(chart, whole) else None


def _same_bytes(a: "numpy.ndarray", b: "numpy.ndarray") -> bool:
    """Whether two arrays of the same strides without gaps have the same bytes. Two maps of one file share its pages."""
    import numpy

    flat = [m.reshape(-1, order="A").view("u1") for m in (a, b)]
    slabs = (slice(first, first + SLAB_BYTES) for first in range(0, flat[0].size, SLAB_BYTES))
    return all(numpy.array_equal(flat[0][slab], flat[1][slab]) for slab in slabs)


@contextlib.contextmanager
def _read_only(chart: "numpy.ndarray") -> Iterator[None]:
    writeable = chart.flags.writeable
    chart.flags.writeable = False
    try:
        yield
    finally:
        chart.flags.writeable = writeable


def standard(chart: Any, axes: str | None) -> "xarray.DataArray":
    """The chart as (wavelength, y, x), without copying it."""
    import xarray

    if isinstance(chart, xarray.Dataset):
        cubes = [name for name, v in chart.data_vars.items() if v.ndim in (2, 3)]
        if len(cubes) != 1:
            raise TypeError(f"a Dataset with the cubes {cubes}: pass one of them, e.g. dataset[{cubes[0] if cubes else 'name'!r}]")
        chart = chart[cubes[0]]
    if not isinstance(chart, xarray.DataArray):
        ndim = getattr(chart, "ndim", None)
        if ndim not in (2, 3) or not hasattr(chart, "dtype"):
            raise TypeError(f"a chart is a path, gen:KIND, a DataArray or an array of 2 or 3 axes; found {type(chart).__name__} of {ndim} axes")
        names = axes.split(",") if axes else ["wavelength", "y", "x"][3 - ndim :]
        if len(names) != ndim:
            raise TypeError(f"axes: {axes!r} names {len(names)} axes, the array has {ndim}")
        chart = xarray.DataArray(chart, dims=[n.strip() for n in names])
        if axes is None and ndim == 3 and chart.shape[0] >= 4 * chart.shape[2]:
            raise TypeError(f"the array {chart.shape} looks like (y, x, wavelength); give axes='y,x,wavelength', or axes='wavelength,y,x'")
    elif axes:
        chart = chart.rename(dict(zip(chart.dims, (n.strip() for n in axes.split(",")), strict=True)))
    if chart.dtype.str[1:] not in DTYPES:
        raise TypeError(f"samples of type {chart.dtype}: expected {', '.join(DTYPES)}, e.g. chart.astype('float32')")
    if chart.ndim == 2:
        chart = chart.expand_dims("wavelength")
    if chart.ndim != 3:
        raise TypeError(f"a chart has the axes wavelength, y and x; found {chart.dims}")
    order = []
    for what, known in (("wavelength", SPECTRAL), ("y", ROWS), ("x", COLUMNS)):
        found = [d for d in chart.dims if str(d).lower() in known]
        if len(found) != 1:
            raise TypeError(f"no single axis of {chart.dims} is {what}; give axes, e.g. axes='wavelength,y,x', or rename the dimensions")
        order.append(found[0])
    return chart.transpose(*order)


def wavelengths_nm(array: "xarray.DataArray") -> list[float] | None:
    """The wavelengths of the first dimension, nm: of its coordinate, or of another one along it that is called wavelength."""
    band = array.dims[0]
    named = [n for n, c in array.coords.items() if c.dims == (band,) and str(n).lower().startswith("wave")]
    scalar = [n for n, c in array.coords.items() if c.ndim == 0 and str(n).lower().startswith("wave")]
    for name in [*named, *([band] if band in array.coords else []), *(scalar if array.sizes[band] == 1 else [])]:
        coordinate = array.coords[name]
        if coordinate.dtype.kind not in "iuf":
            continue
        unit = str(coordinate.attrs.get("units", "nm")).strip().lower()
        if unit not in NM:
            raise TypeError(f"the coordinate {name} has the unit {unit!r}; give wavelengths in nm")
        values = coordinate.values.reshape(-1)
        # Numbers of bands, not wavelengths.
        if name == band and str(band).lower() not in SPECTRAL[:6] and "units" not in coordinate.attrs:
            continue
        return [float(f"{v * NM[unit]:.12g}") for v in values.astype(float)]
    return None


def pitch_um(array: "xarray.DataArray") -> float | None:
    """The pixel pitch, µm: the attribute pitch_um, or the step of the coordinates x and y if they have a unit of length."""
    import numpy

    if "pitch_um" in array.attrs:
        return float(array.attrs["pitch_um"])
    found = []
    for dim in array.dims[1:]:
        unit = str(array.coords[dim].attrs.get("units", "")).strip().lower() if dim in array.coords else ""
        if unit not in UM or array.sizes[dim] < 2:
            return None
        at = array.coords[dim].values.astype(float) * UM[unit]
        step = abs(at[-1] - at[0]) / (len(at) - 1)
        if numpy.abs(numpy.abs(numpy.diff(at)) - step).max() > 1e-3 * step:
            return None
        found.append(step)
    return float(f"{found[0]:.9g}") if abs(found[0] - found[1]) <= 1e-6 * found[0] else None


def _check_space(folder: Path, nbytes: int) -> None:
    free = shutil.disk_usage(folder).free
    if free < nbytes:
        text = f"{nbytes * 1e-9:.1f} GB of the chart do not fit in {folder.parent} ({free * 1e-9:.1f} GB free)"
        raise OSError(f"{text}: give another temp_dir, or store the chart and pass its path")


def write(path: Path, array: "xarray.DataArray") -> None:
    """Writes (wavelength, y, x) as .npy, and its attributes beside it, from which the program takes scale, offset and missing values."""
    import numpy

    out = numpy.lib.format.open_memmap(path, "w+", array.dtype.newbyteorder("="), array.shape)
    if array.chunks is not None:
        import dask.array

        dask.array.store(array.data, out, lock=False)
    else:
        _write_slabs(array, out)
    out.flush()
    if array.attrs:
        _beside(path).write_text(json.dumps(_plain(array.attrs)))


def _beside(path: Path) -> Path:
    """Where the program looks for the attributes of a .npy file."""
    return path.with_name(f"{path.name}.attributes.json")


def _plain(value: Any) -> Any:
    """An attribute as JSON; numbers that JSON lacks by their names in Zarr, values of other types as text."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        return "NaN" if math.isnan(value) else "Infinity" if value > 0 else "-Infinity"
    return value if value is None or isinstance(value, (bool, int, float, str)) else str(value)


def _write_slabs(array: "xarray.DataArray", out: "numpy.ndarray") -> None:
    """Slabs along the source's slowest axis, so that a lazy array is read in order and never as a whole."""
    strides = getattr(array.variable._data, "strides", None)
    axis = max(range(3), key=lambda a: abs(strides[a])) if strides else 0
    step = max(1, SLAB_BYTES // max(1, array.nbytes // array.shape[axis]))
    for first in range(0, array.shape[axis], step):
        slab = slice(first, first + step)
        part = array.isel({array.dims[axis]: slab})
        where = tuple(slab if a == axis else slice(None) for a in range(3))
        out[where] = part.values
