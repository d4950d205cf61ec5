#!/usr/bin/env python3
"""Makes tests/data/zarr_python.lens.zip: a small lens pack as zarr-python writes it, not as this program does.

    python3 -m venv v && v/bin/pip install numpy==2.4.6 zarr==3.1.6 && v/bin/python make_lens_pack.py

float32 and float64 tables, int64 azimuths, several codecs, chunks that divide a window, one band shorter than the other
(NaN at the end of its rows), `solid_angle` and `transmission` left out.  The tests know the values by their formulas.
"""
import tempfile
import zipfile
from pathlib import Path

import numpy as np
import zarr
from zarr.codecs import BloscCodec, GzipCodec

attributes = {
    "schema": "lenscube/lens-pack/1", "name": "zarr-python", "distortion_focal_length_mm": 50.0,
    "effective_focal_length_mm": 50.5, "f_number": 4.0, "primary_wavelength_nm": 550.0, "psf_sample": "point",
    "object_distance_mm": -1000.0, "magnification": -0.05, "image_plane": "best focus", "defocus_mm": 0.125, "source": {"program": "zarr-python"},
}
nan = float("nan")
ideal = np.arange(5) * 2.0
real = np.stack([ideal * (1 - 1e-3 * ideal), ideal * (1 - 2e-3 * ideal)])


def window(k, n):
    """Sum 1; heavier at the centre, leaning to +x with k."""
    y, x = np.mgrid[:n, :n] - (n - 1) / 2
    p = np.exp(-(x * x + y * y) / (1 + k)) * (1 + 0.1 * k * x / n)
    return p / p.sum()


with tempfile.TemporaryDirectory() as tmp:
    g = zarr.open_group(tmp, mode="w", zarr_format=3, attributes=attributes)
    g.create_array("wavelength", data=np.array([500, 600], np.int32))
    g.create_array("ideal_height", data=np.tile(ideal, (2, 1)).astype(np.float32), chunks=(1, 2))
    g.create_array("image_height", data=real, compressors=BloscCodec(cname="lz4"))
    g.create_array("relative_illumination", data=np.tile(1 - 0.01 * ideal, (2, 1)).astype(np.float32), compressors=GzipCodec())
    g.create_array("psf_height", data=np.array([[0, 4, 7.5], [0, 7, nan]], np.float32), compressors=None)
    g.create_array("azimuth_count", data=np.array([[1, 8, 16], [1, 12, 0]], np.int64))
    g.create_array("psf_pitch", data=np.array([0.5, 0.75]))
    g.create_array("psf_energy", data=np.array([[0.99, 0.98, 0.97], [0.96, 0.95, nan]], np.float32))
    g.create_array("psf/0", data=np.stack([window(k, 5) for k in range(3)]).astype(np.float32), chunks=(2, 3, 3))
    g.create_array("psf/1", data=np.stack([window(k, 7) for k in range(2)]), compressors=BloscCodec(cname="zstd"))
    out = Path(__file__).with_name("zarr_python.lens.zip")
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as z:
        for path in sorted(p for p in Path(tmp).rglob("*") if p.is_file()):
            info = zipfile.ZipInfo("zarr_python.lens.zarr/" + path.relative_to(tmp).as_posix(), (1980, 1, 1, 0, 0, 0))
            z.writestr(info, path.read_bytes(), zipfile.ZIP_DEFLATED)
