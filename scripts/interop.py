"""Checks of the program given as the first argument; used by check_interop.py, check_charts.py and check_pyramid.py."""
import subprocess
import sys
from pathlib import Path

import numpy as np
import zarr

LENSCUBE = Path(sys.argv[1]).resolve()
GOLDEN = Path(__file__).resolve().parent.parent / "tests" / "golden"
done = 0  # number of checks


def check(condition, message):
    """Ends with exit code 1 and the message unless the condition is true."""
    global done
    done += 1
    if not condition:
        sys.exit(f"check-interop: {message}")


def lenscube(*arguments):
    """Runs the program, which must end with 0."""
    arguments = list(map(str, arguments))
    process = subprocess.run([LENSCUBE, *arguments], capture_output=True, text=True)
    check(process.returncode == 0, f"lenscube {' '.join(arguments)} ended with {process.returncode}: {process.stderr}")


def identity_pack(path, wavelengths):
    """An identity lens up to 100 mm, with PSFs of one sample."""
    bands, heights = len(wavelengths), np.linspace(0, 100, 5)
    g = zarr.open_group(path, mode="w", zarr_format=3, attributes={
        "schema": "lenscube/lens-pack/1", "name": "identity", "distortion_focal_length_mm": 50.0, "effective_focal_length_mm": 50.0,
        "f_number": 2.0, "primary_wavelength_nm": 550.0, "psf_sample": "integrated",
    })
    per_band = lambda row: np.tile(np.asarray(row), (bands, 1))
    g.create_array("wavelength", data=np.array(wavelengths))
    for name in ("ideal_height", "image_height"):
        g.create_array(name, data=per_band(heights))
    g.create_array("relative_illumination", data=per_band(np.ones(5)))
    g.create_array("psf_height", data=per_band([0.0, 100.0]))
    g.create_array("azimuth_count", data=per_band(np.array([1, 4], np.int32)))
    g.create_array("psf_energy", data=per_band([1.0, 1.0]))
    g.create_array("psf_pitch", data=np.full(bands, 2.0))
    for b in range(bands):
        g.create_array(f"psf/{b}", data=np.ones((2, 1, 1), np.float32))
