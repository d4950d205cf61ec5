"""Stores on disk as xarray objects."""

import os
import warnings
import weakref
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import xarray

# Path of each Dataset that `open` has returned, with its variables: whether it was changed since.
_OPENED: dict[int, tuple["weakref.ref[Any]", str, dict[Any, tuple[int, str | None]]]] = {}


def open(path: str | os.PathLike[str]) -> "xarray.Dataset":
    """Opens a film, raw or chart lazily.

    A film has `film` (wavelength [nm], y [mm], x [mm]), or `roi_0`, `roi_1`, … for regions of it; a raw has `raw` (frame, y [mm], x [mm]) in
    digital numbers, with the coordinate `exposure_s`; a chart has `chart` (wavelength, y, x). Positions are those of pixel centres from the
    optical axis, y down and x right. With Dask the arrays are chunked as on disk. Parts that have not been computed are NaN.

    The Dataset is accepted in place of the path by all functions of this package, as long as it is not changed. Values that were loaded
    into memory are compared with the stored ones then.
    """
    # No abspath of a URL, which would shorten s3://. The current folder may change later.
    name = os.fspath(path) if "://" in os.fspath(path) else os.path.abspath(path)
    dataset = _opened(name)
    key = id(dataset)
    reference = weakref.ref(dataset, lambda _: _OPENED.pop(key, None))
    _OPENED[key] = (reference, name, _variables(dataset))
    return dataset


def _opened(name: str) -> "xarray.Dataset":
    import xarray

    with warnings.catch_warnings():
        # zarr-python remarks the records of runs beside the arrays, and consolidated metadata.
        warnings.simplefilter("ignore")
        return xarray.open_zarr(name)


def _variables(dataset: Any) -> dict[Any, tuple[int, str | None]]:
    """Identity of each variable, and the name of its Dask array, which an assignment to a part of it changes."""
    return {name: (id(variable), _dask_name(variable)) for name, variable in dataset.variables.items()}


def _dask_name(variable: Any) -> str | None:
    return variable.data.name if variable.chunks is not None else None


def _is_unchanged(dataset: Any, path: str, recorded: dict[Any, tuple[int, str | None]]) -> bool:
    import numpy

    loaded = []
    for name, variable in dataset.variables.items():
        identity, dask_name = recorded.get(name, (None, None))
        if identity != id(variable) or (variable.chunks is not None and _dask_name(variable) != dask_name):
            return False
        data = variable._data
        # Through the adapters of xarray to what holds the values.
        while hasattr(data, "array"):
            data = data.array
        if isinstance(data, numpy.ndarray) and name in dataset.data_vars:
            loaded.append(name)
    if len(dataset.variables) != len(recorded):
        return False
    # Loaded values may have been changed in place: band by band, for all of the stored ones may not fit in memory as well.
    stored = _opened(path).variables if loaded else {}
    same = (dataset.variables[n].shape == stored[n].shape for n in loaded)
    return all(same) and all(dataset.variables[n][i].equals(stored[n][i]) for n in loaded for i in range(stored[n].shape[0]))


def registered(value: Any) -> str | None:
    """The path of a path, or of an unchanged Dataset of `open`."""
    if isinstance(value, (str, os.PathLike)):
        return os.fspath(value)
    reference, path, variables = _OPENED.get(id(value), (None, "", {}))
    return path if reference is not None and reference() is value and _is_unchanged(value, path, variables) else None


def path_of(value: Any, what: str) -> str:
    """The path of a film or raw that must be on disk."""
    if path := registered(value):
        return path
    raise TypeError(f"a {what} is a path, or the Dataset that this package returned, unchanged; found {type(value).__name__}")
