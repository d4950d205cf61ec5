#!/usr/bin/env python3
"""Makes tests/data/zarr_python_{polar,grid}.lens.zip: small lens packs without rotational symmetry as zarr-python writes them.

    python3 -m venv v && v/bin/pip install numpy==2.4.6 zarr==3.1.6 && v/bin/python make_planar_lens_pack.py

Two bands, the first with fewer nodes and places than the second (NaN at the end of its rows, 7 in the padding of the other tables), several
codecs and types, chunks that divide maps and windows.  The tests know the values by their formulas.
"""
import tempfile
import zipfile
from pathlib import Path

import numpy as np
import zarr
from zarr.codecs import BloscCodec, GzipCodec

nan = float("nan")


def padded(rows):
    """Rows of different lengths, each with NaN to the longest."""
    width = max(map(len, rows))
    return np.array([list(row) + [nan] * (width - len(row)) for row in rows])


def map_table(of):
    """Of 4 x 4 nodes in the first band, 4 x 5 in the second."""
    table = np.full((2, 4, 5), 7.0)
    for band, x in enumerate([np.arange(4) - 1.5, np.arange(5) - 2.0]):
        xs, ys = np.meshgrid(x, np.arange(4) - 1.5)
        table[band, :, :len(x)] = of(xs, ys)
    return table


def windows(rows, n):
    """Of each PSF one sample has the light."""
    stack = np.zeros((rows, n * n), np.float32)
    stack[np.arange(rows), 3 * np.arange(rows) % (n * n)] = 1
    return stack.reshape(rows, n, n)


def make(field):
    attributes = {
        "schema": "lenscube/lens-pack/4", "psf_field": field, "reference_point": "centroid", "name": "zarr-python", "distortion_focal_length_mm": 50.0,
        "effective_focal_length_mm": 50.5, "f_number": 4.0, "primary_wavelength_nm": 550.0, "psf_sample": "point",
    }
    with tempfile.TemporaryDirectory() as tmp:
        g = zarr.open_group(tmp, mode="w", zarr_format=3, attributes=attributes)
        g.create_array("wavelength", data=np.array([500, 600], np.int32))
        g.create_array("map_x", data=padded([np.arange(4) - 1.5, np.arange(5) - 2.0]), chunks=(1, 2))
        g.create_array("map_y", data=padded([np.arange(4) - 1.5] * 2).astype(np.float32))
        g.create_array("map_ideal_x", data=map_table(lambda x, y: x * 1.02 + 0.25), chunks=(2, 3, 2))
        g.create_array("map_ideal_y", data=map_table(lambda x, y: y * 0.98 - 0.125), compressors=BloscCodec(cname="lz4"))
        g.create_array("map_relative_illumination", data=map_table(lambda x, y: 1 - 0.0625 * y).astype(np.float32), compressors=GzipCodec())
        if field == "polar":
            counts = [3, 7]
            g.create_array("psf_height", data=np.array([[0, 1], [0, 2]], np.float32), compressors=None)
            g.create_array("azimuth_count", data=np.array([[1, 8], [1, 12]], np.int64))
            g.create_array("psf_azimuths", data=np.array([[1, 2], [1, 6]], np.uint8))
        else:
            counts = [4, 6]
            g.create_array("psf_x", data=np.array([[-1.0, 1], [-1, 1]]))
            g.create_array("psf_y", data=padded([[-1.5, 1.5], [-1.5, 0, 1.5]]), chunks=(2, 2))
        g.create_array("psf_pitch", data=np.array([0.5, 0.75]))
        g.create_array("psf_energy", data=padded([[0.5] * count for count in counts]).astype(np.float32))
        g.create_array("solid_angle", data=np.array([0.05, 0.05]))
        g.create_array("transmission", data=np.array([1.0, 1.0]))
        g.create_array("psf/0", data=windows(counts[0], 3), chunks=(2, 3, 2))
        g.create_array("psf/1", data=windows(counts[1], 5).astype(np.float64), chunks=(4, 5, 5), compressors=BloscCodec(cname="zstd"))
        out = Path(__file__).with_name(f"zarr_python_{field}.lens.zip")
        with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as z:
            for path in sorted(p for p in Path(tmp).rglob("*") if p.is_file()):
                info = zipfile.ZipInfo(f"zarr_python_{field}.lens.zarr/" + path.relative_to(tmp).as_posix(), (1980, 1, 1, 0, 0, 0))
                z.writestr(info, path.read_bytes(), zipfile.ZIP_DEFLATED)


make("polar")
make("grid")
