"""Extracts the ray-traced tables of the built-in Double Gauss from its lens pack: `python unpack_tables.py OUT.npz`.

The pack (formats/data/double-gauss-28.lens.zip) was made from an archive of 31 wavelengths and 22 heights, described in
formats/data/SOURCES.md. It contains the original tables in its attribute `source`, with all digits of their type, and the PSFs in
another orientation (field point on +x; in the archive on +y). The output is the part of the archive that is read by
scripts/make-builtin-lens, formats/tests/data/make_import_data.py and pipeline/tests/data/make_double_gauss_subset.py. Needs numpy
and zarr 3.
"""
import sys
from pathlib import Path

import numpy as np
import zarr

PACK = Path(__file__).resolve().parent.parent / "formats/data/double-gauss-28.lens.zip"

pack = zarr.open_group(zarr.storage.ZipStore(PACK, mode="r"), mode="r")
given = pack.attrs["source"]["given_points"]
bands = len(pack["wavelength"][...])
psf = np.rot90(np.stack([pack[f"psf/{band}"][...] for band in range(bands)]), -1, axes=(-2, -1))
rows = (np.arange(psf.shape[-2]) - (psf.shape[-2] - 1) / 2) * pack["psf_pitch"][0]
np.savez(
    sys.argv[1],
    wavelength_um=(pack["wavelength"][...] / 1000).astype(np.float32),
    ideal_height_mm=np.array(given["ideal_height_mm"], np.float32),
    real_height_mm=np.array(given["image_height_mm"], np.float64),
    ri=np.array(given["relative_illumination"], np.float32),
    psf=psf,
    energy_in_window=pack["psf_energy"][...].astype(np.float32),
    centroid_y_um=(psf.sum(-1, dtype=np.float64) * rows).sum(-1).astype(np.float32),
    efl_mm=given["effective_focal_length_mm"],
    pixel_um=pack["psf_pitch"][0],
)
