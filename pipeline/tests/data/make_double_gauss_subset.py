"""Writes a subset of tables.npz (see SOURCES.md; made by `scripts/unpack_tables.py tables.npz`) to the flat file that
tests/lens_design/tables.rs reads.

    python make_double_gauss_subset.py tables.npz double-gauss-28-subset.bin            # bands 400, 440, 550, 700 nm; 4 heights
    python make_double_gauss_subset.py tables.npz /tmp/full.bin --full                  # all 31 x 22, for the ignored test

Layout, little endian: u32 bands, heights, size; f64 wavelength_um[B], ideal_mm[K]; f64 efl_mm; f64 real_mm[B,K], ri[B,K], energy[B,K];
f32 psf[B,K,size,size] with the field point on +y, as in the source.
"""

import struct
import sys

import numpy as np

t = np.load(sys.argv[1])
full = "--full" in sys.argv
bands = range(31) if full else [0, 4, 15, 30]
heights = range(22) if full else [0, 8, 15, 21]
pick = np.ix_(list(bands), list(heights))
um = np.round(t["wavelength_um"].astype(float), 6)[list(bands)]
ideal = np.round(t["ideal_height_mm"].astype(float), 6)[list(heights)]
psf = t["psf"][pick].astype("<f4")
with open(sys.argv[2], "wb") as out:
    out.write(struct.pack("<3I", len(um), len(ideal), psf.shape[-1]))
    for a in (um, ideal, t["efl_mm"], t["real_height_mm"][pick], t["ri"][pick], t["energy_in_window"][pick]):
        out.write(np.asarray(a, dtype="<f8").tobytes())
    out.write(psf.tobytes())
