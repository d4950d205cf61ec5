"""Charts written by other software, for the tests of formats/src/chart.

    python make_charts.py        (zarr 3.1.6, numcodecs 0.16.6, numpy 2.4.6)

Every sample is (31 band + 7 row + 3 column) mod 251, which all sample types hold exactly.
"""

import pathlib
import shutil

import numpy as np
import zarr
from zarr.codecs import BloscCodec, BytesCodec, Crc32cCodec, GzipCodec, TransposeCodec, ZstdCodec

HERE = pathlib.Path(__file__).parent / "charts"
B, H, W = 3, 37, 41
b, y, x = np.indices((B, H, W))
N = (31 * b + 7 * y + 3 * x) % 251


def new(name):
    shutil.rmtree(HERE / name, ignore_errors=True)
    return HERE / name


def group(name, chart, zarr_format=3, **coordinate):
    """A group whose array `chart` is made by `chart(group)`, with wavelengths."""
    g = zarr.create_group(new(name), zarr_format=zarr_format)
    g.attrs.update({"pitch_um": 2.0, "film_size": [33, 35], "units": "reflectance"})
    c = chart(g)
    c[...] = N.astype(c.dtype)
    values = coordinate.pop("values", [400.0, 410.0, 420.5])
    w = g.create_array("wavelength", shape=(B,), chunks=(2,), dtype="f8", **coordinate)
    w[:] = values
    return g


NAMES = {"dimension_names": ["wavelength", "y", "x"]}
blosc = BloscCodec(cname="zstd", clevel=1, shuffle="shuffle")

group("v3-sharded", lambda g: g.create_array(
    "chart", shape=N.shape, shards=(1, 32, 32), chunks=(1, 16, 16), dtype="f4", fill_value=np.nan,
    compressors=[blosc, Crc32cCodec()], **NAMES), dimension_names=["wavelength"], attributes={"units": "nm"})

group("v2-blosc", lambda g: g.create_array(
    "chart", shape=N.shape, chunks=(1, 16, 16), dtype="u1", attributes={"_ARRAY_DIMENSIONS": ["band", "row", "col"]}),
    zarr_format=2, attributes={"units": "um"}, values=[0.4, 0.41, 0.4205])


def bare(name, values=N, **how):
    a = zarr.create_array(new(name), shape=values.shape, **how)
    a[...] = values.astype(a.dtype)
    return a


bare("v3-big-endian-gzip", dtype="f8", chunks=(1, 16, 16), serializer=BytesCodec(endian="big"),
     compressors=[GzipCodec(level=5)], attributes={"wavelengths_nm": [400, 410, 420]})
bare("v3-bip-zstd", dtype="u2", chunks=(3, 16, 16), compressors=[ZstdCodec(level=1)])
bare("v3-two-dimensional", N[1], dtype="f2", chunks=(16, 16), compressors=None, dimension_names=["y", "x"])
bare("v3-transposed", dtype="f4", chunks=(2, 16, 16), filters=[TransposeCodec(order=(2, 0, 1))], compressors=[blosc])
bare("v3-index-first", dtype="f4", chunks=(1, 16, 16),
     shards={"shape": (3, 32, 32), "index_location": "start"}, compressors=[ZstdCodec(level=1)])
bare("v3-wrong-order", np.moveaxis(N, 0, 2), dtype="u1", chunks=(37, 41, 3), dimension_names=["y", "x", "wavelength"])
bare("v3-int32", dtype="i4", chunks=(3, 37, 41))
bare("v2-big-endian-fortran", dtype=">u2", chunks=(2, 16, 16), order="F", zarr_format=2)
bare("v2-float", dtype="<f4", chunks=(1, 37, 41), zarr_format=2, fill_value=None)

g = zarr.create_group(new("v3-columns-first"))
g.attrs.update({"pitch_um": 2.0, "film_size": [33, 35], "units": "reflectance"})
c = g.create_array("chart", shape=(W, H, B), dtype="u2", chunks=(16, 16, 2), shards=(32, 32, 4), compressors=[blosc],
                   dimension_names=["x", "y", "wavelength"])
c[...] = np.moveaxis(N, [0, 1, 2], [2, 1, 0]).astype("u2")
g.create_array("wavelength", shape=(B,), chunks=(3,), dtype="f8", dimension_names=["wavelength"])[:] = [400.0, 410.0, 420.5]
