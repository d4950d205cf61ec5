"""Opens pyramids of the program with OME-Zarr models and readers from PyPI; run by check-interop.

Checked: the metadata are valid OME-Zarr 0.5; ome-zarr-py's reader and napari's plugin find every level; each level is the mean over
2 x 2 pixels of the one before, as computed by numpy, of a raw over pixels of one filter; scales and translations align all levels; and xarray, zarr-python and tensorstore
read the same film with and without a pyramid.
"""
import json
import tempfile
import warnings
from pathlib import Path

import napari_ome_zarr
import numpy as np
import ome_zarr.io
import ome_zarr.reader
import tensorstore
import xarray
import zarr
from ome_zarr_models.v05 import Image

import interop
from interop import GOLDEN, check, lenscube


def halved(a):
    """Means over 2 x 2 pixels in float64, of the samples that are not NaN."""
    bands, h, w = a.shape
    padded = np.full((bands, h + h % 2, w + w % 2), np.nan)
    padded[:, :h, :w] = a
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        return np.nanmean(padded.reshape(bands, (h + 1) // 2, 2, (w + 1) // 2, 2), axis=(2, 4)).astype(np.float32)


def same(a, b):
    return a.shape == b.shape and a.dtype == b.dtype and np.array_equal(a, b, equal_nan=True)


def dataset(path):
    with xarray.open_zarr(str(path), consolidated=True) as ds:
        return ds.load()


def halved_mosaic(a, period=2):
    """Means over pixels of one filter in 2 x 2 periods, rounded to even; pixels without a partner by themselves."""
    def pairs(n):
        first = np.arange(-(-n // 2)) // period * 2 * period + np.arange(-(-n // 2)) % period
        return first, np.where(first + period < n, first + period, first)
    (top, bottom), (left, right) = pairs(a.shape[1]), pairs(a.shape[2])
    f = a.astype(np.float64)
    means = sum(f[:, rows][:, :, columns] for rows in (top, bottom) for columns in (left, right)) / 4
    return np.rint(means).astype(a.dtype)


def levels(path, number, name, halved=halved):
    """Checks one multiscale and returns its arrays."""
    at = f"{path.name}, {name}"
    group = zarr.open_consolidated(str(path))
    ome = group.attrs["ome"]
    check(ome["version"] == "0.5", f"{at}: version {ome['version']}")
    scale = ome["multiscales"][number]
    check(scale["name"] == name and scale["datasets"][0]["path"] == name, f"{at}: level 0 is {scale['datasets'][0]['path']}")
    arrays = []
    first, pitch = None, None
    for level, entry in enumerate(scale["datasets"]):
        a = group[entry["path"]]
        check(list(a.metadata.dimension_names) == [axis["name"] for axis in scale["axes"]], f"{at}: {entry['path']} has dimensions {a.metadata.dimension_names}")
        t = tensorstore.open({"driver": "zarr3", "kvstore": {"driver": "file", "path": f"{path / entry['path']}/"}}, read=True, open=True).result()
        pixels = a[:]
        check(same(t.read().result(), pixels), f"{at}: tensorstore reads other values of level {level}")
        if arrays:
            check(same(pixels, halved(arrays[-1])), f"{at}: level {level} is not the mean of the one before")
        arrays.append(pixels)
        (factor, shift) = (entry["coordinateTransformations"][0]["scale"], entry["coordinateTransformations"][1]["translation"])
        first, pitch = first or shift, pitch or factor
        for axis in (1, 2):
            check(np.isclose(factor[axis], pitch[axis] * 2**level, rtol=1e-12), f"{at}: scale {factor}")
            # The edges of the first pixels coincide.
            check(np.isclose(shift[axis] - factor[axis] / 2, first[axis] - pitch[axis] / 2, rtol=1e-9, atol=1e-12), f"{at}: translation {shift}")
    check(max(arrays[-1].shape[1:]) <= 256, f"{at}: the last level has {arrays[-1].shape}")
    return arrays, first


def readers(path, arrays):
    """Checks that ome-zarr-py and napari's plugin read the levels of the first multiscale."""
    Image.from_zarr(zarr.open_group(str(path), mode="r"))
    check(True, "valid")
    nodes = list(ome_zarr.reader.Reader(ome_zarr.io.parse_url(str(path)))())
    check(len(nodes) >= 1 and [d.shape for d in nodes[0].data] == [a.shape for a in arrays], f"{path.name}: ome-zarr-py reads {[n.data for n in nodes]}")
    for found, expected in zip(nodes[0].data, arrays):
        check(same(np.asarray(found), expected), f"{path.name}: ome-zarr-py reads other values")
    reader = napari_ome_zarr.napari_get_reader(str(path))
    check(reader is not None, f"{path.name}: napari's plugin does not accept it")
    layers = reader(str(path))
    data, options, kind = layers[0]
    check(kind == "image" and [d.shape for d in data] == [a.shape for a in arrays], f"{path.name}: napari reads {kind} {options}")
    check(options["channel_axis"] == 0 and all(same(np.asarray(d), a) for d, a in zip(data, arrays)), f"{path.name}: napari reads other values")
    check([name.split(": ")[-1] for name in options["name"]] == [c["label"] for c in zarr.open_group(str(path), mode="r").attrs["ome"]["omero"]["channels"]], f"{path.name}: napari's names {options['name']}")


def consolidated(path):
    members = json.loads((path / "zarr.json").read_text())["consolidated_metadata"]["metadata"]
    files = {str(f.parent.relative_to(path)) for f in path.rglob("zarr.json")} - {"."}
    check(set(members) == files, f"{path.name}: consolidated metadata of {sorted(members)}, there are {sorted(files)}")
    for name, member in members.items():
        check(member == json.loads((path / name / "zarr.json").read_text()), f"{path.name}: consolidated metadata of {name} differs from its zarr.json")


with tempfile.TemporaryDirectory() as tmp:
    lens = GOLDEN / "packs" / "three-bands.lens.zip"
    chart = "gen:composite?size=777x1031&wavelengths=450,500,550&pitch_um=2"
    run = ("run", chart, "--lens", lens, "--outside", "clamp", "--no-fsync", "--shard", 512, "--chunk", 256)
    for name, flags in [("film", ()), ("half", ("--dtype", "f16")), ("roi", ("--roi", "3,5,700,301", "--roi", "100,200,40,30")), ("one", ("--roi", "5,5,1,1"))]:
        path = Path(tmp) / f"{name}.zarr"
        lenscube(*run, path, *flags)
        before = dataset(path)
        lenscube("pyramid", path)
        check(dataset(path).identical(before.assign_attrs(dataset(path).attrs)), f"{path.name}: xarray reads another film")
        check({k: v for k, v in dataset(path).attrs.items() if k != "ome"} == before.attrs, f"{path.name}: other attributes")
        consolidated(path)
        for number, array in enumerate([k for k in before.data_vars]):
            if name == "half":
                continue
            arrays, first = levels(path, number, array)
            dims = before[array].dims
            check(np.allclose(first[1:], [before[d].values[0] for d in dims[1:]], rtol=1e-12, atol=1e-12), f"{path.name}: translation {first}")
            if number == 0:
                readers(path, arrays)
        lenscube("verify", path)
    # Raws: mosaics of mosaics, in 16 bits.
    for name, flags in [("raw", ("--keep-signal",)), ("windows", ("--roi", "3,5,600,301", "--roi", "100,200,40,30"))]:
        path = Path(tmp) / f"{name}.raw.zarr"
        lenscube("sensor", Path(tmp) / "film.zarr", path, "--sensor", "example-2um", "--exposure", "5ms,20ms", "--no-fsync", *flags)
        before = dataset(path)
        lenscube("pyramid", path)
        check(dataset(path).identical(before.assign_attrs(dataset(path).attrs)), f"{path.name}: xarray reads another raw")
        check({k: v for k, v in dataset(path).attrs.items() if k != "ome"} == before.attrs, f"{path.name}: other attributes")
        consolidated(path)
        for number, array in enumerate(k for k in before.data_vars if k.startswith(("raw", "roi"))):
            arrays, first = levels(path, number, array, halved_mosaic)
            dims = before[array].dims
            check(np.allclose(first[1:], [before[d].values[0] for d in dims[1:]], rtol=1e-12, atol=1e-12), f"{path.name}: translation {first}")
            if number == 0:
                readers(path, arrays)
        lenscube("verify", path)
print(f"{interop.done} checks: ome-zarr-models, ome-zarr-py {ome_zarr.__version__ if hasattr(ome_zarr, '__version__') else ''} and napari-ome-zarr opened pyramids")
