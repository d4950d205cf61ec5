"""Fixtures: a small cube, and flags of a lens that needs no tracing."""

import numpy
import pytest
import xarray

import lenscube

NM = [450.0, 500.0, 550.0]
FLAGS = {"lens": "double-gauss-28-npz", "interpolate_psf": True, "film_size": 64}


@pytest.fixture(scope="session")
def cube() -> xarray.DataArray:
    """(wavelength, y, x), with wavelengths in nm and positions in mm at a pitch of 5 µm."""
    samples = numpy.random.default_rng(5).random((3, 64, 64), numpy.float32)
    at = (numpy.arange(64) - 31.5) * 5e-3
    coords = {"wavelength": ("wavelength", NM, {"units": "nm"}), "y": ("y", at, {"units": "mm"}), "x": ("x", at, {"units": "mm"})}
    return xarray.DataArray(samples, coords, ("wavelength", "y", "x"))


@pytest.fixture(scope="session")
def film(cube, tmp_path_factory) -> xarray.Dataset:
    return lenscube.run(cube, tmp_path_factory.mktemp("film") / "film.zarr", **FLAGS)
