#!/usr/bin/env python3
"""The picture of ghosts in README: a lamp in a dark scene through the Double Gauss, film of 36 x 24 mm, logarithmic over eight decades.

    python3 scripts/ghost_figure.py LENSCUBE [scripts/readme/ghosts.png]

Left to right: bare surfaces; a quarter wave of MgF2; MgF2 and a film that reflects 10 %. Needs NumPy. White is the image of the lamp, black 10^-8 of it.
"""

import struct
import subprocess
import sys
import tempfile
import zlib
from pathlib import Path

import numpy as np

HEIGHT, WIDTH, PITCH_UM = 320, 480, 75
DECADES = 8
LAMP = (-46, 92, 6)  # rows and columns from the middle, radius, px
SHOTS = [["--coatings", "none"], ["--coatings", "mgf2"], ["--coatings", "mgf2", "--sensor-reflectance", "10%"]]
GAP = 8
# Black, dark blue, orange, white: place and colour.
COLOURS = np.array([[0, 0, 0, 0], [0.3, 40, 50, 150], [0.65, 235, 130, 40], [1, 255, 255, 255]], float)


def png(pixels):
    """An RGB image as PNG."""
    rows = b"".join(b"\0" + row.tobytes() for row in pixels)
    chunk = lambda name, data: struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))  # noqa: E731
    head = struct.pack(">IIBBBBB", pixels.shape[1], pixels.shape[0], 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows, 9)) + chunk(b"IEND", b"")


def main():
    program, out = sys.argv[1], Path(sys.argv[2] if len(sys.argv) > 2 else "scripts/readme/ghosts.png")
    y, x = np.indices((HEIGHT, WIDTH)) + 0.5
    lit = np.hypot(y - HEIGHT / 2 - LAMP[0], x - WIDTH / 2 - LAMP[1]) <= LAMP[2]
    panels = []
    with tempfile.TemporaryDirectory() as folder:
        run = lambda *words: subprocess.run([program, *words, "--quiet"], cwd=folder, check=True)  # noqa: E731
        np.save(Path(folder) / "lamp.npy", lit[None].astype(np.float32))
        for k, flags in enumerate(SHOTS):
            lens = ["--lens", "double-gauss-28", "--film-pitch-um", str(PITCH_UM), "--wavelengths", "550"]
            run("run", "lamp.npy", f"{k}.zarr", *lens, "--stages", "ri,distortion", "--ghosts", "on", *flags)
            run("export", f"{k}.zarr", f"{k}.npy")
            film = np.load(Path(folder) / f"{k}.npy").reshape(HEIGHT, WIDTH)
            level = 1 + np.log10(np.maximum(film, 1e-30) / film.max()) / DECADES
            colour = [np.interp(level, COLOURS[:, 0], COLOURS[:, c]) for c in (1, 2, 3)]
            panels += [np.stack(colour, -1), np.full((HEIGHT, GAP, 3), 255.0)]
    out.write_bytes(png(np.round(np.concatenate(panels[:-1], 1)).astype(np.uint8)))


main()
