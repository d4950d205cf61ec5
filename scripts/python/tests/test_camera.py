"""Raws, pictures, comparison, lenses, measurement."""

import numpy
import pytest

import lenscube
from conftest import FLAGS


@pytest.fixture(scope="module")
def raws(tmp_path_factory):
    place = tmp_path_factory.mktemp("raws")
    film = lenscube.run("gen:checker?size=256&wavelengths=400:700:50&pitch_um=2", place / "film.zarr", lens=FLAGS["lens"], interpolate_psf=True)
    flags = {"sensor": "example-2um", "exposure": "auto", "keep_signal": True}
    first = lenscube.sensor(film, place / "a.zarr", **flags)
    return first, lenscube.sensor(first, place / "b.zarr", exposure="auto", seed=2)


def test_raw_is_lazy_and_develops_to_a_picture(raws, tmp_path):
    raw = raws[0]
    assert raw.raw.dims == ("frame", "y", "x") and raw.raw.dtype == "u2" and raw.exposure_s.values[0] > 0
    picture = lenscube.develop(raw, tmp_path / "p.tif", depth=16).to_xarray()
    assert picture.dims == ("y", "x", "channel") and picture.dtype == "u2" and picture.channel.values.tolist() == ["red", "green", "blue"]
    shown = lenscube.develop(raw)
    assert shown._repr_png_().startswith(b"\x89PNG") and repr(shown).startswith("Picture(")
    assert isinstance(lenscube.sensor(raw, tmp_path / "n.dng", exposure="auto"), lenscube.Picture)
    with pytest.raises(TypeError, match="only .tif and .npy"):
        shown.to_xarray()


def test_raws_are_compared(raws, tmp_path):
    assert (raws[0].raw.values != raws[1].raw.values).any()
    figures = lenscube.compare(*raws, tmp_path / "compared")
    assert figures and (tmp_path / "compared/report.html").exists()


def test_chart_becomes_a_picture_in_one_call(tmp_path):
    picture = lenscube.shoot("gen:checker?size=128&wavelengths=500:600:50&pitch_um=2", tmp_path / "p.png", lens="triplet", sensor="example-2um")
    assert picture.path.stat().st_size > 100
    cube = numpy.full((3, 64, 64), 0.5, "f4")
    flags = {"lens": "triplet", "sensor": "example-2um", "film_pitch_um": 2, "wavelengths": [500, 550, 600]}
    first, second = (lenscube.shoot(a, tmp_path / f"{i}.png", axes=axes, **flags) for i, (a, axes) in enumerate([(cube, None), (cube.transpose(1, 2, 0), "y,x,wavelength")]))
    assert first.path.read_bytes() == second.path.read_bytes()


def test_edges_points_and_profiles_are_datasets(tmp_path):
    edge = numpy.zeros((2, 128, 128), "f4")
    edge[:] = (numpy.arange(128) > 60 + 0.1 * numpy.arange(128)[:, None]) * 0.8 + 0.1
    flags = {"wavelengths": [450, 550], "half_px": 16}
    measured = lenscube.measure(edge, edge=(62.5, 20, 70.5, 100), **flags)
    assert measured.mtf.dims == ("wavelength", "frequency_cy_px") and (measured.mtf.sel(frequency_cy_px=0) == 1).all()
    assert measured.esf.dims == measured.distance_px.dims == ("wavelength", "sample")
    assert float(measured.normal_deg[0]) == pytest.approx(-5.71, abs=0.1) or float(measured.normal_deg[0]) == pytest.approx(5.71, abs=0.1)
    points = numpy.zeros((2, 64, 64), "f4")
    points[:, 30:33, 40] = 1
    found = lenscube.measure(points, points=[(40, 31), (41, 30)], **flags)
    assert found.x.dims == ("wavelength", "point") and numpy.allclose(found.x, 40) and numpy.allclose(found.y, 31)
    profile = lenscube.measure(edge, profile=(0, 64, 127, 64), **flags)
    assert profile.profile.shape == (2, 128) and profile.profile.values[0] == pytest.approx(edge[0, 64])
    with pytest.raises(TypeError, match="json|figures"):
        lenscube.measure(edge, edge=(62.5, 20, 70.5, 100), json="x.json", **flags)


def test_lenses_are_dictionaries(tmp_path):
    shown = lenscube.lens("triplet", wavelengths=[550])
    assert shown and any("focal" in key for key in str(shown).split("'"))
    names = {lens["name"] for lens in lenscube.lens_list()}
    assert {"double-gauss-28", "triplet"} <= names
    pack = lenscube.lens_trace("triplet", tmp_path / "t.lens.zarr", wavelengths=550, max_height_mm=2, heights=[0, 1, 2])
    assert pack.is_dir()
    assert lenscube.lens_diff(pack, "triplet", wavelengths=550)
    camera = lenscube.lens_camera("triplet", film_size="300x200", film_pitch_um=5, focus_m=2)
    assert camera == lenscube.lens_camera("triplet", film="300x200", pitch_um=5, focus_m=2), "the former names"
    assert camera["width_px"] - camera["height_px"] == 100


def test_distances_are_looked_at_before_a_run(tmp_path):
    distances = numpy.full((40, 60), 2, "f4")
    distances[10:20, 5:9] = 1.5
    numpy.save(tmp_path / "depth.npy", distances)
    flags = {"lens": "triplet", "focus_m": 2, "film_pitch_um": 5}
    found = lenscube.depth(tmp_path / "depth.npy", plot=tmp_path / "depth.png", **flags)
    assert found["blur_px"]["least"] == 0 and found["nearest_m"] == pytest.approx(1.5)
    assert (tmp_path / "depth.png").exists() and found["problems"] == []
    distances[3, 4] = 0
    numpy.save(tmp_path / "depth.npy", distances)
    with pytest.raises(lenscube.CheckError) as error:
        lenscube.depth(tmp_path / "depth.npy", **flags)
    assert '"zero"' in error.value.output


def test_charts_are_drawn_and_converted(tmp_path):
    drawn = lenscube.chart("uniform", tmp_path / "u.zarr", size=32, wavelengths=[500, 600], pitch_um=2)
    assert drawn.chart.dims == ("wavelength", "y", "x") and drawn.wavelength.values.tolist() == [500, 600]
    film = lenscube.run(drawn, tmp_path / "f.zarr", lens=FLAGS["lens"], interpolate_psf=True)
    picture = lenscube.export(film, tmp_path / "p.png")
    assert lenscube.chart_image(picture, tmp_path / "i.zarr", pitch_um=2).chart.ndim == 3


def test_forecast_writes_nothing(cube, tmp_path):
    text = lenscube.forecast(cube, tmp_path / "f.zarr", **FLAGS)
    assert "memory" in text and not (tmp_path / "f.zarr").exists()
    with pytest.raises(TypeError, match="forecast"):
        lenscube.run(cube, tmp_path / "f.zarr", dry_run=True)
