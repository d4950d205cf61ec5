"""Arrays as charts: order of axes, coordinates, temporary files."""

import os
import subprocess
import sys

import dask.array
import numpy
import pytest
import xarray

import lenscube
from conftest import FLAGS, NM
from lenscube import _charts


def written(tmp_path, array):
    _charts.write(tmp_path / "chart.npy", array)
    return numpy.load(tmp_path / "chart.npy"), (tmp_path / "chart.npy").read_bytes()


def test_every_order_and_kind_of_array_is_written_as_the_same_file(cube, tmp_path, monkeypatch):
    monkeypatch.setattr(_charts, "SLAB_BYTES", 5000)
    expected, stored = written(tmp_path, _charts.standard(cube, None))
    assert (expected == cube.values).all()
    kinds = [
        cube.transpose("y", "x", "wavelength"),
        cube.transpose("x", "wavelength", "y").copy(),
        cube.chunk(wavelength=1, y=30, x=17),
        xarray.DataArray(numpy.asfortranarray(cube.values), cube.coords, cube.dims),
        cube.astype(">f4"),
        cube.rename(wavelength="band", y="rows", x="columns"),
    ]
    for array in kinds:
        found, same = written(tmp_path, _charts.standard(array, None))
        assert found.tobytes() == expected.tobytes() and same == stored, array.dims
    _, other = written(tmp_path, _charts.standard(cube + 1e-6, None))
    assert other != stored


@pytest.mark.parametrize("dtype", ["u1", "u2", "u4", "i2", "i4"])
def test_integers_are_read_as_those_of_a_file(cube, tmp_path, dtype):
    integers = (100 * cube).astype(dtype)
    numpy.save(tmp_path / "cube.npy", integers.values)
    made = lenscube.run(integers, **FLAGS)
    stored = lenscube.run(tmp_path / "cube.npy", wavelengths=NM, film_pitch_um=5, **FLAGS)
    assert (made.film.values == stored.film.values).all() and made.film.values.max() > 10


def test_axes_name_those_of_an_array(cube):
    moved = numpy.moveaxis(cube.values, 0, 2)
    assert (_charts.standard(moved, "y,x,wavelength").values == cube.values).all()
    with pytest.raises(TypeError, match="axes='y,x,wavelength'"):
        _charts.standard(moved, None)
    with pytest.raises(TypeError, match="names 2 axes, the array has 3"):
        _charts.standard(moved, "y,x")


def test_lazy_arrays_are_read_in_slabs(cube, tmp_path, monkeypatch):
    cube.to_dataset(name="chart").to_zarr(tmp_path / "cube.zarr", consolidated=False)
    lazy = xarray.open_zarr(tmp_path / "cube.zarr", chunks=None, consolidated=False).chart
    monkeypatch.setattr(_charts, "SLAB_BYTES", 64 * 64 * 4)
    sizes, asked = [], xarray.DataArray.values.fget
    monkeypatch.setattr(xarray.DataArray, "values", property(lambda a: sizes.append(a.shape) or asked(a)))
    found, _ = written(tmp_path, _charts.standard(lazy, None))
    assert (found == cube.data).all()
    assert sizes and all(shape == (1, 64, 64) for shape in sizes)
    assert not lazy.variable._in_memory


def test_wavelengths_and_pitch_come_from_coordinates(cube):
    array = _charts.standard(cube, None)
    assert _charts.wavelengths_nm(array) == NM
    assert _charts.pitch_um(array) == 5.0
    micrometres = cube.assign_coords(wavelength=("wavelength", [0.45, 0.5, 0.55], {"units": "µm"}))
    assert _charts.wavelengths_nm(_charts.standard(micrometres, None)) == NM
    numbered = cube.rename(wavelength="band").assign_coords(band=[0, 1, 2])
    assert _charts.wavelengths_nm(_charts.standard(numbered, None)) is None
    beside = numbered.assign_coords(wavelength=("band", NM))
    assert _charts.wavelengths_nm(_charts.standard(beside, None)) == NM
    one = _charts.standard(cube.sel(wavelength=500), None)
    assert one.shape == (1, 64, 64) and _charts.wavelengths_nm(one) == [500.0]
    stretched = cube.assign_coords(x=("x", cube.x.values**3, {"units": "mm"}))
    assert _charts.pitch_um(_charts.standard(stretched, None)) is None
    assert _charts.pitch_um(_charts.standard(stretched.assign_attrs(pitch_um=3), None)) == 3.0
    with pytest.raises(TypeError, match="'cm-1'"):
        _charts.wavelengths_nm(cube.assign_coords(wavelength=("wavelength", NM, {"units": "cm-1"})))


def test_what_is_no_chart_is_a_type_error(cube):
    for wrong, text in [
        (cube.astype("i8"), "u4, i2, i4, f2, .*astype"),
        (cube.rename(x="z"), "is x"),
        (cube.values[0, 0], "1 axes"),
        ([[1, 2], [3, 4]], "list"),
        (xarray.Dataset({"a": cube, "b": cube}), r"dataset\['a'\]"),
    ]:
        with pytest.raises(TypeError, match=text):
            lenscube.run(wrong, "never.zarr", **FLAGS)


def test_mapped_files_are_passed_by_name(cube, tmp_path):
    numpy.save(tmp_path / "cube.npy", cube.values)
    mapped = numpy.load(tmp_path / "cube.npy", mmap_mode="r")
    with _charts.given(mapped, {}) as (path, _):
        assert path == str(tmp_path / "cube.npy")
    for part in (mapped[:2], mapped[::-1], mapped[:, ::2]):
        with _charts.given(part, {}) as (path, _):
            assert path != str(tmp_path / "cube.npy") and (numpy.load(path) == part).all()
        assert not os.path.exists(path)


def test_a_changed_copy_on_write_map_is_written_with_its_changes(cube, tmp_path):
    numpy.save(tmp_path / "cube.npy", cube.values)
    mapped = numpy.load(tmp_path / "cube.npy", mmap_mode="c")
    mapped *= 5
    with _charts.given(mapped, {}) as (path, _):
        assert path != str(tmp_path / "cube.npy") and (numpy.load(path) == 5 * cube.values).all()


def test_a_full_folder_is_an_error_before_anything_is_written():
    huge = xarray.DataArray(dask.array.zeros((31, 1 << 20, 1 << 20), "f4", chunks=(1, 4096, 4096)), dims=("wavelength", "y", "x"))
    with pytest.raises(OSError, match="temp_dir"), _charts.given(huge, {}):
        pass


MEMORY = """
import re, resource, sys, threading
from pathlib import Path
import dask.array, numpy, xarray
from lenscube import _charts

dask.config.set(scheduler="synchronous")
cube = xarray.DataArray(dask.array.ones((32, 1024, 2048), "f4", chunks=(1, 512, 2048)), dims=("wavelength", "y", "x"))
_charts.write(Path(sys.argv[1]), cube[:1])
data = 1024 * int(re.search(r"VmData:\\s+(\\d+)", open("/proc/self/status").read())[1])
resource.setrlimit(resource.RLIMIT_DATA, (data + (64 << 20),) * 2)
_charts.write(Path(sys.argv[1]), cube)
try:
    cube.compute()
except MemoryError:
    print("the cube does not fit")
"""


def test_a_cube_is_written_with_less_memory_than_it_has(tmp_path):
    path = tmp_path / "chart.npy"
    done = subprocess.run([sys.executable, "-c", MEMORY, str(path)], capture_output=True, text=True)
    assert done.stdout == "the cube does not fit\n", done.stderr
    assert numpy.load(path, mmap_mode="r").shape == (32, 1024, 2048)
