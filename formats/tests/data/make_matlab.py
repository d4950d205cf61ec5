"""Makes the MAT-files of level 5 in `matlab/`, with scipy 1.17.1: `python3 make_matlab.py`.

Values of (row r, column c, band b): 1000 r + 10 c + b + 1, of 4 x 5 pixels and 3 bands at 450, 550 and 650 nm.
"""
from pathlib import Path

import numpy as np
import scipy.io

out = Path(__file__).parent / "matlab"
out.mkdir(exist_ok=True)
nm = np.array([450.0, 550.0, 650.0])
r, c, b = np.meshgrid(np.arange(4), np.arange(5), np.arange(3), indexing="ij")
cube = (1000.0 * r + 10 * c + b + 1).astype("f8")

# ISETCam: photons without a linear model, compressed; the illuminant is not read.
scipy.io.savemat(
    out / "photons.mat",
    {"comment": "Photons", "illuminant": {"data": np.ones(3), "wavelength": nm}, "photons": cube.astype("f4"), "wave": nm[:, None]},
    do_compression=True,
)
# ISETCam: coefficients and a basis, of which the photons are `cube`, without compression: cube = 1 x mean-free parts + mean.
basis = np.array([[1.0, 0.0], [1.0, 1.0], [1.0, 2.0]])
coefficients = np.stack([cube[..., 0] - 5.0, np.ones((4, 5))], -1)
scipy.io.savemat(
    out / "model.mat",
    {"mcCOEF": coefficients, "basis": {"basis": basis, "wave": nm[None]}, "imgMean": np.full((3, 1), 5.0), "comment": "x", "fov": 10.0},
)
# ISETCam: a scene, and an array of integers of another name beside it.
scene = {"type": "scene", "data": {"photons": cube}, "spectrum": {"wave": nm}, "name": "s"}
scipy.io.savemat(out / "scene.mat", {"scene": scene, "counts": cube[..., :2].astype("u2")}, do_compression=True)
# Any array, of two axes, and what cannot be read.
cells = np.empty(2, object)
cells[:] = [1, "a"]
scipy.io.savemat(out / "other.mat", {"plane": cube[..., 0], "complex": cube + 1j, "cells": cells, "text": "abc"}, do_compression=True)
