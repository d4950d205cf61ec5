"""Data sets: by the package, read by xarray and tarfile."""

import io
import tarfile

import lenscube
import numpy
import pytest
import xarray

RECIPE = """
schema = "lenscube/dataset/1"
samples = 3
pictures = {{ files = "cubes" }}
lens = {{ name = "double-gauss-28-npz", flags = {{ interpolate_psf = true }} }}
film = {{ pitch_um = 5, center_mm = [[0, 0], [2, 1]] }}
output = {{ as = "{layout}", film = "npy", unit = 2 }}
"""


@pytest.fixture
def recipe(tmp_path):
    (tmp_path / "cubes").mkdir()
    for k in range(2):
        lenscube.chart("checker", tmp_path / f"cubes/{k}.zarr", size=40 + 20 * k, overscan=0, wavelengths=[500, 600], pitch_um=5)

    def write(layout, text=RECIPE):
        path = tmp_path / "recipe.toml"
        path.write_text(text.format(layout=layout))
        return path

    return write


def test_lines_films_and_shards_are_those_of_the_command(recipe, tmp_path):
    samples = lenscube.dataset(recipe("tar"), tmp_path / "out")
    assert [sample["sample"] for sample in samples] == [0, 1, 2]
    found = {}
    for k in range(2):
        with tarfile.open(tmp_path / f"out/{k:06}.tar") as shard:
            found |= {member.name: shard.extractfile(member).read() for member in shard}
    assert sorted(found) == sorted(f"{s['key']}.{end}" for s in samples for end in ("film.npy", "json"))
    for sample in samples:
        data = found[f"{sample['key']}.film.npy"]
        values = numpy.lib.format.read_array(io.BytesIO(data))
        flags = dict(word.removeprefix("--").split("=", 1) for word in sample["run"] if "=" in word)
        lens = flags.pop("lens")
        words = {name.replace("-", "_"): value for name, value in flags.items()}
        film = lenscube.run(tmp_path / sample["picture"], tmp_path / "film.zarr", lens=lens, interpolate_psf=True, overwrite=True, **words)
        numpy.testing.assert_array_equal(values, film.film.values)


def test_arrays_open_in_xarray(recipe, tmp_path):
    text = RECIPE.replace('files = "cubes"', 'files = "cubes", size = [32, 24]')
    samples = lenscube.dataset(recipe("zarr", text), tmp_path / "out", samples=5)
    data = xarray.open_zarr(tmp_path / "out/data.zarr", consolidated=False)
    assert data.film.dims == ("sample", "wavelength", "y", "x") and data.film.shape == (5, 2, 24, 32)
    for k, sample in enumerate(samples):
        values = data.film[k].values
        assert numpy.isfinite(values).all() and values.std() > 0 and values.nbytes == sample["items"]["film.array"]["bytes"]
