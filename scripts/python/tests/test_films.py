"""Films: the same as those of the program, resumed, lazy; errors, progress, interruption."""

import os
import signal
import subprocess
import sys
import time

import numpy
import pytest
import xarray

import lenscube
from conftest import FLAGS, NM


def test_film_is_that_of_the_program(cube, film, tmp_path):
    numpy.save(tmp_path / "cube.npy", cube.values)
    words = ["run", tmp_path / "cube.npy", tmp_path / "film.zarr", "--lens=double-gauss-28-npz", "--interpolate-psf", "--film-size=64"]
    subprocess.run([lenscube.program(), *words, "--wavelengths=450:550:50", "--film-pitch-um=5"], check=True, capture_output=True)
    expected = lenscube.open(tmp_path / "film.zarr")
    assert film.film.dims == ("wavelength", "y", "x") and film.wavelength.values.tolist() == NM
    assert (film.film.values == expected.film.values).all() and numpy.isfinite(film.film.values).all()
    assert film.x.attrs["units"] == "mm" and float(film.x[1] - film.x[0]) == pytest.approx(5e-3)


def test_unit_of_the_array_is_that_of_the_film(cube):
    assert lenscube.run(cube, **FLAGS).film.attrs["units"] == "relative"
    radiance = cube.assign_attrs(units="W m-2 sr-1 nm-1")
    assert lenscube.run(radiance, **FLAGS).film.attrs["units"] == "W m-2 sr-1 nm-1"
    assert lenscube.run(radiance, **FLAGS, chart_units="counts").film.attrs["units"] == "counts"


def test_film_without_a_path_lasts_as_long_as_the_process(cube):
    flags = ", ".join(f"{k}={v!r}" for k, v in FLAGS.items())
    script = f"import lenscube; f = lenscube.run('gen:points?size=64&wavelengths=550', {flags}); print(float(f.film.mean()), f.encoding['source'])"
    printed = subprocess.run([sys.executable, "-W", "ignore", "-c", script], check=True, capture_output=True, text=True).stdout.split()
    assert float(printed[0]) > 0 and not os.path.exists(printed[1].removeprefix("file://"))


def test_same_array_resumes_and_another_is_another_job(cube, film):
    events = []
    again = lenscube.run(cube.copy(), film.encoding["source"], progress=events.append, **FLAGS)
    assert events[-1]["event"] == "done" and events[-1]["tiles"] == 0, events
    assert (again.film == film.film).all()
    with pytest.raises(lenscube.OtherJobError, match="chart") as caught:
        lenscube.run(cube * 2, film.encoding["source"], **FLAGS)
    assert caught.value.code == 3 and caught.value.command[1] == "run"


def test_opened_films_stand_for_their_paths(film, tmp_path):
    assert lenscube.status(film)["complete"]
    assert lenscube.verify(film)["sound"]
    changed = film.assign(film=film.film * 2)
    with pytest.raises(TypeError, match="unchanged"):
        lenscube.status(changed)
    picture = lenscube.export(film, tmp_path / "film.npy")
    assert (picture.to_xarray().values == film.film.values).all()
    doubled = lenscube.export(changed.film, tmp_path / "twice.npy")
    assert (doubled.to_xarray().values == 2 * film.film.values).all()
    assert lenscube.export(film)._repr_png_().startswith(b"\x89PNG")
    film_tif = lenscube.export(film, tmp_path / "film.tif").to_xarray()
    assert film_tif.dims == ("y", "x", "channel") and film_tif.dtype == "u2"


def test_an_opened_film_is_its_path_after_a_change_of_folder(cube, tmp_path, monkeypatch):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
    monkeypatch.chdir(tmp_path / "a")
    first = lenscube.run(cube, "film.zarr", **FLAGS)
    monkeypatch.chdir(tmp_path / "b")
    lenscube.run(2 * cube, "film.zarr", **FLAGS)
    line = {"profile": (0, 30, 63, 30)}
    assert lenscube.measure(first, **line).equals(lenscube.measure(tmp_path / "a/film.zarr", **line))


@pytest.mark.parametrize("chunks", ["auto", None])
def test_a_film_that_was_loaded_stands_for_its_path_until_its_values_change(film, monkeypatch, chunks):
    opened = xarray.open_zarr
    monkeypatch.setattr(xarray, "open_zarr", lambda path: opened(path, chunks=chunks))
    path = film.encoding["source"]
    loaded = lenscube.open(path).load()
    assert lenscube.status(loaded)["complete"]
    loaded.film[1, 2, 3] += 1
    with pytest.raises(TypeError, match="unchanged"):
        lenscube.status(loaded)
    assigned = lenscube.open(path)
    float(assigned.film.mean())
    assert lenscube.status(assigned)["complete"]
    assigned.film[0] = 0
    with pytest.raises(TypeError, match="unchanged"):
        lenscube.status(assigned)
    assert (lenscube.measure(assigned, profile=(0, 30, 63, 30)).profile.values[0] == 0).all()


def test_errors_are_exceptions_of_their_exit_codes(cube, film, tmp_path):
    with pytest.raises(lenscube.UsageError, match="film-size") as caught:
        lenscube.run(cube, tmp_path / "f.zarr", **{**FLAGS, "film_size": "many"})
    assert caught.value.code == 2
    with pytest.raises(lenscube.FailedError, match="nothing.zarr"):
        lenscube.run(tmp_path / "nothing.zarr", tmp_path / "f.zarr", **FLAGS)
    with pytest.raises(lenscube.FailedError, match="NaN"):
        lenscube.run(cube.where(cube > 0.5), tmp_path / "f2.zarr", **FLAGS)
    assert not list(tmp_path.parent.glob("lenscube-*"))


def test_damage_is_a_check_error_with_the_report(cube, tmp_path):
    lenscube.run(cube, tmp_path / "f.zarr", **FLAGS)
    shard = next(p for p in (tmp_path / "f.zarr/film/c").rglob("*") if p.is_file())
    shard.write_bytes(b"\0" * shard.stat().st_size)
    with pytest.raises(lenscube.CheckError) as caught:
        lenscube.verify(tmp_path / "f.zarr")
    assert caught.value.code == 4 and '"' in caught.value.output


def test_notes_are_warnings_where_the_function_is_called(cube, tmp_path):
    counts = (cube * 1000).astype("u2")
    with pytest.warns(lenscube.LenscubeWarning) as caught:
        lenscube.run(counts, tmp_path / "f.zarr", **FLAGS)
    assert {w.filename for w in caught if w.category is lenscube.LenscubeWarning} == {__file__}


def test_bar_shows_tracing_and_film(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    lenscube.run("gen:points?size=64&wavelengths=550", tmp_path / "f.zarr", lens="triplet", progress=True)
    shown = capsys.readouterr().err
    assert "lens: 100%" in shown and "film: 100%" in shown


INTERRUPTED = """
import lenscube, signal, sys
# Jobs that a shell starts in the background ignore SIGINT.
signal.signal(signal.SIGINT, signal.default_int_handler)
def show(event):
    if event["event"] == "progress":
        print("running", flush=True)
try:
    lenscube.run("gen:composite?size=6000&wavelengths=450:550:10", sys.argv[1], lens="double-gauss-28-npz", interpolate_psf=True, threads=1, progress=show)
except Exception:
    print("swallowed")
except KeyboardInterrupt as e:
    print(type(e).__name__, e.code, e)
"""


def test_ctrl_c_ends_the_program_in_order_and_the_film_resumes(tmp_path):
    film = tmp_path / "film.zarr"
    process = subprocess.Popen([sys.executable, "-W", "ignore", "-c", INTERRUPTED, str(film)], stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "running\n"
    process.send_signal(signal.SIGINT)
    rest = process.communicate(timeout=120)[0].splitlines()
    assert rest[-1] == "Interrupted 130 interrupted; the same call resumes"
    state = lenscube.status(film)
    assert not state["complete"] and state["locks"] == [] and state["runs"]["interrupted"] == 1


def test_the_program_ends_with_the_process_that_started_it(tmp_path):
    film = tmp_path / "film.zarr"
    process = subprocess.Popen([sys.executable, "-W", "ignore", "-c", INTERRUPTED, str(film)], stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "running\n"
    process.kill()
    process.wait()
    end = time.monotonic() + 30
    while running := subprocess.run(["pgrep", "-f", str(film)], capture_output=True).stdout:
        assert time.monotonic() < end, running
        time.sleep(0.1)


def test_plan_is_computed_in_units(tmp_path):
    chart = "gen:points?size=64&wavelengths=450,550"
    plan = lenscube.plan(chart, tmp_path / "film.zarr", tmp_path / "job.json", lens="double-gauss-28-npz", interpolate_psf=True, shard=64, chunk=64, unit_rows=1)
    assert plan.units == 2 and plan.missing() == "0-1"
    part = plan.run(unit=1)
    assert plan.missing() == "0"
    assert numpy.isnan(part.film[0].values).all() and numpy.isfinite(part.film[1].values).all()
    done = plan.run()
    assert plan.missing() == "" and numpy.isfinite(done.film.values).all()
    with pytest.raises(TypeError, match="chart of a plan is a path"):
        lenscube.plan(xarray.DataArray(numpy.zeros((1, 8, 8), "f4")), tmp_path / "g.zarr")
