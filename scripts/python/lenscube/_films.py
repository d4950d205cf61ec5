"""Stores on disk as xarray objects."""

import atexit
import os
import shutil
import tempfile
import warnings
import weakref
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import xarray

# Path of each Dataset that `open` has returned, with its variables: whether it was changed since.
_OPENED: dict[int, tuple["weakref.ref[Any]", str, dict[Any, int]]] = {}


def open(path: str | os.PathLike[str]) -> "xarray.Dataset":
    """Opens a film, raw or chart lazily.

    A film has `film` (wavelength [nm], y [mm], x [mm]), or `roi_0`, `roi_1`, … for regions of it; a raw has `raw` (frame, y [mm], x [mm]) in
    digital numbers, with the coordinate `exposure_s`; a chart has `chart` (wavelength, y, x). Positions are those of pixel centres from the
    optical axis, y down and x right. With Dask the arrays are chunked as on disk. Parts that have not been computed are NaN.

    The Dataset is accepted in place of the path by all functions of this package, as long as it is not changed.
    """
    import xarray

    with warnings.catch_warnings():
        # zarr-python remarks the records of runs beside the arrays, and consolidated metadata.
        warnings.simplefilter("ignore")
        dataset = xarray.open_zarr(os.fspath(path))
    key = id(dataset)
    reference = weakref.ref(dataset, lambda _: _OPENED.pop(key, None))
    _OPENED[key] = (reference, os.fspath(path), _variables(dataset))
    return dataset


def _variables(dataset: Any) -> dict[Any, int]:
    return {name: id(variable) for name, variable in dataset.variables.items()}


def registered(value: Any) -> str | None:
    """The path of a path, or of an unchanged Dataset of `open`."""
    if isinstance(value, (str, os.PathLike)):
        return os.fspath(value)
    reference, path, variables = _OPENED.get(id(value), (None, "", {}))
    return path if reference is not None and reference() is value and variables == _variables(value) else None


def path_of(value: Any, what: str) -> str:
    """The path of a film or raw that must be on disk."""
    if path := registered(value):
        return path
    raise TypeError(f"a {what} is a path, or the Dataset that this package returned, unchanged; found {type(value).__name__}")


def temporary_folder() -> Path:
    """A folder for results without a path, removed at the end of this process."""
    folder = Path(tempfile.mkdtemp(prefix="lenscube-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder
