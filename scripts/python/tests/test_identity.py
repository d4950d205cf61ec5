"""What identifies an array: its content, also if it is the map of a file."""

import os

import numpy
import pytest

import lenscube
from conftest import FLAGS, NM
from lenscube import _charts

MAPPED = {**FLAGS, "wavelengths": NM, "film_pitch_um": 5}


def mapped(path, values):
    out = numpy.lib.format.open_memmap(path, "w+", values.dtype, values.shape)
    out[:] = values
    return out


def test_a_map_that_is_changed_between_two_runs_is_another_job(cube, tmp_path):
    chart = mapped(tmp_path / "cube.npy", cube.values)
    first = lenscube.run(chart, tmp_path / "film.zarr", **MAPPED).load()
    chart *= 2
    with pytest.raises(lenscube.OtherJobError, match="content of the chart"):
        lenscube.run(chart, tmp_path / "film.zarr", **MAPPED)
    chart.flush()
    # A page that is written again before the system wrote it changes no time stamp; --trust-input accepts time stamps alone.
    with pytest.raises(lenscube.OtherJobError, match="content of the chart"):
        lenscube.run(chart, tmp_path / "film.zarr", **MAPPED, trust_input=True)
    again = lenscube.run(chart, tmp_path / "film.zarr", **MAPPED, overwrite=True)
    assert numpy.allclose(again.film, 2 * first.film)


def test_a_map_and_its_copy_in_memory_are_one_chart(cube, tmp_path):
    chart = mapped(tmp_path / "cube.npy", cube.values)
    lenscube.run(chart, tmp_path / "film.zarr", **MAPPED)
    os.utime(tmp_path / "cube.npy", ns=(0, 0))
    events = []
    for same in (chart, cube.values.copy()):
        lenscube.run(same, tmp_path / "film.zarr", progress=events.append, **MAPPED)
        assert events[-1]["event"] == "done" and events[-1]["tiles"] == 0, events


def test_a_map_whose_file_was_replaced_is_written_as_it_is(cube, tmp_path):
    numpy.save(tmp_path / "cube.npy", cube.values)
    chart = numpy.load(tmp_path / "cube.npy", mmap_mode="r")
    numpy.save(tmp_path / "other.npy", 3 * cube.values)
    os.replace(tmp_path / "other.npy", tmp_path / "cube.npy")
    with _charts.given(chart, {}) as (path, _):
        assert path != str(tmp_path / "cube.npy") and (numpy.load(path) == cube.values).all()
    for gone in (lambda p: p.write_bytes(b"text"), os.remove):
        gone(tmp_path / "cube.npy")
        with _charts.given(chart, {}) as (path, _):
            assert (numpy.load(path) == cube.values).all()


def test_a_map_is_read_only_while_the_program_reads_its_file(cube, tmp_path):
    chart = mapped(tmp_path / "cube.npy", cube.values)
    with _charts.given(chart, {}) as (path, _):
        assert path == str(tmp_path / "cube.npy") and not chart.flags.writeable
        with pytest.raises(ValueError, match="read-only"):
            chart[0] = 1
    chart[0] = 1
    with pytest.raises(ZeroDivisionError), _charts.given(chart, {}):
        1 / 0
    assert chart.flags.writeable
