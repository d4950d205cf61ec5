"""Attributes of a DataArray that define its values: those of the CF conventions, as of a stored array."""

import numpy
import pytest
import xarray

import lenscube
from conftest import FLAGS


@pytest.mark.parametrize(
    "attributes",
    [
        {"_FillValue": numpy.float32(-9999)},
        {"missing_value": numpy.array([-9999.0, -1])},
        {"valid_range": [0.0, 1.0]},
        {"valid_min": numpy.float64(0)},
    ],
)
def test_what_attributes_declare_as_no_data_is_none(cube, tmp_path, attributes):
    chart = cube.copy()
    chart[1, 30, 31] = -9999
    chart.attrs.update(attributes)
    with pytest.raises(lenscube.FailedError, match="band 1.* -9999"):
        lenscube.run(chart, tmp_path / "film.zarr", **FLAGS)
    film = lenscube.run(chart, tmp_path / "film0.zarr", **FLAGS, nan="zero")
    assert (film.film == lenscube.run(chart.where(chart > 0, 0).assign_attrs(units="relative"), **FLAGS).film).all()


def test_attributes_scale_the_values_as_those_of_a_stored_chart(cube, tmp_path):
    packed = (cube * 10000).astype("u2").assign_attrs(scale_factor=numpy.float64(1e-4), add_offset=0.5, long_name=b"x", note={"a": numpy.nan})
    packed.attrs["_FillValue"] = numpy.uint16(65535)
    film = lenscube.run(packed, tmp_path / "film.zarr", **FLAGS)
    stored = packed.drop_attrs(deep=False)
    stored.encoding = {}
    stored.attrs = {"scale_factor": 1e-4, "add_offset": 0.5}
    stored.to_dataset(name="chart").to_zarr(tmp_path / "chart.zarr", consolidated=False)
    expected = lenscube.run(tmp_path / "chart.zarr", tmp_path / "expected.zarr", film_pitch_um=5, **FLAGS)
    assert (film.film == expected.film).all() and float(film.film.mean()) > 0.5
    exported = lenscube.export(packed, tmp_path / "chart.npy").to_xarray()
    assert numpy.allclose(exported.values, packed.values * 1e-4 + 0.5, rtol=1e-6)
    # xarray has applied these already, and keeps them as `encoding`.
    decoded = xarray.open_zarr(tmp_path / "chart.zarr", consolidated=False).chart
    assert "scale_factor" not in decoded.attrs
    assert numpy.allclose(lenscube.run(decoded, film_pitch_um=5, **FLAGS).film, film.film, rtol=1e-5)
    for wrong, text in [({"scale_factor": "a tenth"}, "scale_factor"), ({"_FillValue": object()}, "_FillValue")]:
        with pytest.raises(lenscube.FailedError, match=text):
            lenscube.run(packed.assign_attrs(wrong), tmp_path / "wrong.zarr", **FLAGS)
