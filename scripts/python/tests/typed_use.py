"""Typical calls, for mypy: the keywords and results have types."""

import numpy
import xarray

import lenscube


def picture(cube: xarray.DataArray) -> bytes | None:
    film: xarray.Dataset = lenscube.run(cube, "film.zarr", lens="double-gauss-28", film_size=(480, 640), bands=slice(450, 650), stages=["ri"])
    lenscube.run(numpy.zeros((1, 8, 8)), wavelengths=[550], interp="bilinear", roi=[(0, 0, 8, 8)], overwrite=True)
    lenscube.run(cube, lense="triplet")  # type: ignore[call-arg]
    lenscube.run(cube, interp="cubic")  # type: ignore[arg-type]
    return lenscube.export(film, "film.png")._repr_png_()
