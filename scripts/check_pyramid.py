"""Opens pyramids of the program given with the OME-Zarr models and readers from PyPI; check-interop runs it.

What must hold: the metadata are valid OME-Zarr 0.5; ome-zarr-py's reader and napari's plugin find every level; each level is the mean over
2 x 2 of the one before, as numpy sums it; scales and translations put all levels on one place; and xarray, zarr-python and tensorstore see
the film as they did before.
"""
import json
import subprocess
import sys
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

LENSCUBE = Path(sys.argv[1]).resolve()
GOLDEN = Path(__file__).resolve().parent.parent / "tests" / "golden"
checks = 0


def holds(condition, what):
    global checks
    checks += 1
    if not condition:
        sys.exit(f"check-interop: {what}")


def lenscube(*words):
    done = subprocess.run([LENSCUBE, *map(str, words)], capture_output=True, text=True)
    holds(done.returncode == 0, f"lenscube {' '.join(map(str, words))} ended with {done.returncode}: {done.stderr}")


def halved(a):
    """Means over 2 x 2 in float64, of what is there."""
    bands, h, w = a.shape
    grown = np.full((bands, h + h % 2, w + w % 2), np.nan)
    grown[:, :h, :w] = a
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        return np.nanmean(grown.reshape(bands, (h + 1) // 2, 2, (w + 1) // 2, 2), axis=(2, 4)).astype(np.float32)


def same(a, b):
    return a.shape == b.shape and a.dtype == b.dtype and np.array_equal(a, b, equal_nan=True)


def dataset(path):
    with xarray.open_zarr(str(path), consolidated=True) as ds:
        return ds.load()


def levels(path, number, name):
    """Checks one multiscale and returns its arrays."""
    at = f"{path.name}, {name}"
    group = zarr.open_consolidated(str(path))
    ome = group.attrs["ome"]
    holds(ome["version"] == "0.5", f"{at}: version {ome['version']}")
    scale = ome["multiscales"][number]
    holds(scale["name"] == name and scale["datasets"][0]["path"] == name, f"{at}: level 0 is {scale['datasets'][0]['path']}")
    arrays = []
    first, pitch = None, None
    for level, told in enumerate(scale["datasets"]):
        a = group[told["path"]]
        holds(list(a.metadata.dimension_names) == [axis["name"] for axis in scale["axes"]], f"{at}: {told['path']} has dimensions {a.metadata.dimension_names}")
        t = tensorstore.open({"driver": "zarr3", "kvstore": {"driver": "file", "path": f"{path / told['path']}/"}}, read=True, open=True).result()
        pixels = a[:]
        holds(same(t.read().result(), pixels), f"{at}: tensorstore reads level {level} otherwise")
        if arrays:
            holds(same(pixels, halved(arrays[-1])), f"{at}: level {level} is not the mean of the one before")
        arrays.append(pixels)
        (factor, shift) = (told["coordinateTransformations"][0]["scale"], told["coordinateTransformations"][1]["translation"])
        first, pitch = first or shift, pitch or factor
        for axis in (1, 2):
            holds(np.isclose(factor[axis], pitch[axis] * 2**level, rtol=1e-12), f"{at}: scale {factor}")
            # The edges of the first pixels coincide.
            holds(np.isclose(shift[axis] - factor[axis] / 2, first[axis] - pitch[axis] / 2, rtol=1e-9, atol=1e-12), f"{at}: translation {shift}")
    holds(max(arrays[-1].shape[1:]) <= 256, f"{at}: the last level has {arrays[-1].shape}")
    return arrays, first


def readers(path, arrays):
    """What ome-zarr-py and napari's plugin see is the first multiscale, level by level."""
    Image.from_zarr(zarr.open_group(str(path), mode="r"))
    holds(True, "valid")
    nodes = list(ome_zarr.reader.Reader(ome_zarr.io.parse_url(str(path)))())
    holds(len(nodes) >= 1 and [d.shape for d in nodes[0].data] == [a.shape for a in arrays], f"{path.name}: ome-zarr-py sees {[n.data for n in nodes]}")
    for seen, own in zip(nodes[0].data, arrays):
        holds(same(np.asarray(seen), own), f"{path.name}: ome-zarr-py reads other values")
    reader = napari_ome_zarr.napari_get_reader(str(path))
    holds(reader is not None, f"{path.name}: napari's plugin refuses it")
    layers = reader(str(path))
    data, words, kind = layers[0]
    holds(kind == "image" and [d.shape for d in data] == [a.shape for a in arrays], f"{path.name}: napari sees {kind} {words}")
    holds(words["channel_axis"] == 0 and all(same(np.asarray(d), a) for d, a in zip(data, arrays)), f"{path.name}: napari reads other values")
    holds(words["name"] == [c["label"] for c in zarr.open_group(str(path), mode="r").attrs["ome"]["omero"]["channels"]], f"{path.name}: napari's names {words['name']}")


def consolidated(path):
    members = json.loads((path / "zarr.json").read_text())["consolidated_metadata"]["metadata"]
    files = {str(f.parent.relative_to(path)) for f in path.rglob("zarr.json")} - {"."}
    holds(set(members) == files, f"{path.name}: consolidated metadata of {sorted(members)}, there are {sorted(files)}")
    for name, member in members.items():
        holds(member == json.loads((path / name / "zarr.json").read_text()), f"{path.name}: consolidated metadata of {name} differs from its own")


with tempfile.TemporaryDirectory() as tmp:
    lens = GOLDEN / "packs" / "three-bands.lens.zip"
    chart = "gen:composite?size=1031x777&wavelengths=450,500,550&pitch_um=2"
    run = ("run", chart, "--lens", lens, "--outside", "clamp", "--no-fsync", "--shard", 512, "--chunk", 256)
    for name, flags in [("film", ()), ("half", ("--dtype", "f16")), ("roi", ("--roi", "3,5,700,301", "--roi", "100,200,40,30")), ("one", ("--roi", "5,5,1,1"))]:
        path = Path(tmp) / f"{name}.zarr"
        lenscube(*run, path, *flags)
        before = dataset(path)
        lenscube("pyramid", path)
        holds(dataset(path).identical(before.assign_attrs(dataset(path).attrs)), f"{path.name}: xarray sees another film")
        holds({k: v for k, v in dataset(path).attrs.items() if k != "ome"} == before.attrs, f"{path.name}: other attributes")
        consolidated(path)
        for number, array in enumerate([k for k in before.data_vars]):
            if name == "half":
                continue
            arrays, first = levels(path, number, array)
            dims = before[array].dims
            holds(np.allclose(first[1:], [before[d].values[0] for d in dims[1:]], rtol=1e-12, atol=1e-12), f"{path.name}: translation {first}")
            if number == 0:
                readers(path, arrays)
        lenscube("verify", path)
print(f"{checks} checks: ome-zarr-models, ome-zarr-py {ome_zarr.__version__ if hasattr(ome_zarr, '__version__') else ''} and napari-ome-zarr opened pyramids")
