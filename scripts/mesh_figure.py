#!/usr/bin/env python3
"""The picture of a mesh in README: pawns on a board through the Double Gauss, film of 3.8 x 3.0 mm (a small part of its field), in focus on the nearest and on the farthest.

    python3 scripts/mesh_figure.py LENSCUBE [scripts/readme/pawns.png]

The mesh is written here: pawns are surfaces of revolution, closed, so that behind their blurred rims the board is seen. Needs NumPy and Pillow.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

WIDTH, HEIGHT, PITCH_UM = 480, 376, 8
GAP = 8
# Distance from the camera and place to the right, m; material.
PAWNS = [(4.90, -0.045, "dark"), (5.25, 0.05, "ivory"), (5.70, -0.012, "dark"), (6.25, 0.085, "ivory"), (6.90, -0.080, "dark")]
FOCUS_M = [4.89, 6.89]
EYE_M, SIDE_M = 0.30, 0.05
# Radius and height of a pawn's outline, m, from the board up; the head is a ball.
FOOT = [(0.0175, 0.0), (0.0175, 0.005), (0.0154, 0.0077), (0.0154, 0.0105), (0.0105, 0.014), (0.007, 0.0245), (0.0056, 0.033), (0.0098, 0.0357), (0.0098, 0.0378)]
HEAD = (0.0105, 0.0469)
SEGMENTS, HEAD_ROWS = 64, 24
MATERIALS = {"dark": (0.10, 0.035, 0.015), "ivory": (0.72, 0.62, 0.42), "light": (0.62, 0.55, 0.45), "brown": (0.16, 0.09, 0.05), "wall": (0.20, 0.28, 0.36)}


class Obj:
    """A mesh in metres, y up, before a camera that looks along -z."""

    def __init__(self):
        self.lines, self.vertices = ["mtllib pawns.mtl"], 0

    def vertex(self, x, y, z):
        self.lines.append(f"v {x:.6f} {y:.6f} {z:.6f}")
        self.vertices += 1
        return self.vertices

    def object(self, name, material):
        self.lines += [f"o {name}", f"usemtl {material}"]

    def face(self, *corners):
        self.lines.append("f " + " ".join(map(str, corners)))

    def rectangle(self, corners):
        self.face(*[self.vertex(*corner) for corner in corners])

    def pawn(self, number, distance, right, material):
        self.object(f"Pawn{number}", material)
        radius, middle = HEAD
        start = np.arcsin(min(1.0, (middle - FOOT[-1][1]) / radius))
        angles = np.linspace(-start, np.pi / 2, HEAD_ROWS)[1:-1]
        outline = FOOT + [(radius * np.cos(a), middle + radius * np.sin(a)) for a in angles]
        turns = 2 * np.pi * np.arange(SEGMENTS) / SEGMENTS
        rings = [[self.vertex(right + r * np.cos(t), y, -distance - r * np.sin(t)) for t in turns] for r, y in outline]
        bottom, top = self.vertex(right, 0.0, -distance), self.vertex(right, middle + radius, -distance)
        for k in range(SEGMENTS):
            n = (k + 1) % SEGMENTS
            self.face(bottom, rings[0][n], rings[0][k])
            self.face(top, rings[-1][k], rings[-1][n])
            for low, high in zip(rings, rings[1:]):
                self.face(low[k], low[n], high[n], high[k])


def mesh(path):
    obj = Obj()
    for row in range(80, 200):
        for column in range(-8, 8):
            obj.object(f"Square{row}_{column}", ["light", "brown"][(row + column) % 2])
            near, left = -row * SIDE_M, column * SIDE_M
            obj.rectangle([(left, 0, near), (left + SIDE_M, 0, near), (left + SIDE_M, 0, near - SIDE_M), (left, 0, near - SIDE_M)])
    obj.object("Wall", "wall")
    obj.rectangle([(-3, -1, -10), (3, -1, -10), (3, 3, -10), (-3, 3, -10)])
    for number, pawn in enumerate(PAWNS):
        obj.pawn(number, *pawn)
    path.write_text("\n".join(obj.lines) + "\n")
    colours = [f"newmtl {name}\nKd {r} {g} {b}\n" for name, (r, g, b) in MATERIALS.items()]
    (path.parent / "pawns.mtl").write_text("".join(colours))


def main():
    program, out = Path(sys.argv[1]).resolve(), Path(sys.argv[2] if len(sys.argv) > 2 else "scripts/readme/pawns.png")
    with tempfile.TemporaryDirectory() as folder:
        run = lambda *words: subprocess.run([program, *map(str, words), "--quiet"], cwd=folder, check=True)  # noqa: E731
        mesh(Path(folder) / "pawns.obj")
        for k, focus in enumerate(FOCUS_M):
            lens = ["--lens", "double-gauss-28", "--focus-m", focus, "--film-size", f"{WIDTH}x{HEIGHT}", "--film-pitch-um", PITCH_UM]
            view = ["--mesh-unit", "m", "--eye", f"0,{EYE_M},0", "--target", "0,0.026,-5.7", "--sun", "120,40,60000", "--sky", "15000", "--sky-samples", "16"]
            run("run", "pawns.obj", f"{k}.zarr", *lens, *view, "--wavelengths", "400:700:50")
            run("export", f"{k}.zarr", f"{k}.png")
        panels = [np.array(Image.open(Path(folder) / f"{k}.png")) for k in range(len(FOCUS_M))]
    white = np.full((HEIGHT, GAP, 3), 255, np.uint8)
    Image.fromarray(np.concatenate([panels[0], white, panels[1]], 1)).save(out, optimize=True)


main()
