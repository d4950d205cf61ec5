#!/usr/bin/env python3
"""Table of restored pictures: six pictures through three lenses with noise, restored by `lenscube restore` and by two common filters.

    python3 -m venv V && V/bin/pip install numpy scipy scikit-image zarr pillow
    V/bin/python scripts/restore_table.py LENSCUBE OUT [LENS…]      # one or more of LENSES

PSNR in dB of white = 1, of linear light, over the chart pixels that the film shows 16 px or more from its border. All are compared with the chart: distortion and relative illumination of the film and of what
the filters of scikit-image make of it are undone first, by cubic interpolation at the places that films of ramps give. The filters have the parameters that are best for each picture, found with
the chart: Wiener with the PSF of the film's center, and unsharp mask. `lenscube restore` has the RMS of the noise (`--noise`), or nothing. OUT: table.md, table.json, figure.png.
"""
import json
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import zarr
from PIL import Image
from scipy.ndimage import map_coordinates
from skimage import data, filters, restoration

SIDE, PITCH_UM, NM, BORDER = 256, 2.0, 550, 16
NOISES = [0.002, 0.01]
# Name, and the place of the film's center, (x, y) in mm from the axis.
LENSES = [("double-gauss-28", (6.0, 4.5)), ("phone", (1.2, 0.9)), ("tessar", (6.0, 4.5))]
PICTURES = ["camera", "astronaut", "coins", "page", "chelsea", "coffee"]
METHODS = ["film", "unsharp mask", "Wiener", "Richardson-Lucy", "Tikhonov", "total variation", "Tikhonov, noise estimated"]


def picture(name):
    """Linear light from 0 to 1, from the middle of the picture; pages are repeated at the bottom."""
    values = np.asarray(getattr(data, name)(), float) / 255
    values = values[..., 1] if values.ndim == 3 else values
    values = np.pad(values, [(0, max(0, SIDE - n)) for n in values.shape], mode="symmetric")
    y, x = ((n - SIDE) // 2 for n in values.shape)
    values = values[y : y + SIDE, x : x + SIDE]
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4).astype("f4")


def read(store, array):
    return np.asarray(zarr.open_array(f"{store}/{array}", mode="r")[0])


class Places:
    """Where the film shows the pixels of the chart, and its relative illumination."""

    def __init__(self, lens):
        pixels = np.mgrid[:SIDE, :SIDE].astype("f4")
        # What each film pixel shows; ramps end at the chart's border, beyond which the film repeats it.
        shown = [lens.film(ramp, "ramp.zarr", "--stages=distortion").astype(float) for ramp in pixels]
        self.places = pixels.astype(float)
        for _ in range(20):
            at = [map_coordinates(s, self.places, order=1, mode="nearest") for s in shown]
            self.places += pixels - at
            self.places = np.clip(self.places, 0, SIDE - 1)
        self.illumination = lens.film(np.ones((SIDE, SIDE), "f4"), "ones.zarr", "--stages=ri").astype(float)
        error = max(np.abs(map_coordinates(s, self.places, order=1, mode="nearest") - p).max(initial=0, where=self.inside()) for s, p in zip(shown, pixels))
        assert error < 0.01, f"places differ by {error} px"

    def inside(self):
        y, x = self.places
        return (y >= BORDER) & (y <= SIDE - 1 - BORDER) & (x >= BORDER) & (x <= SIDE - 1 - BORDER)

    def undone(self, film):
        return map_coordinates(film / self.illumination, self.places, order=3, mode="nearest")

    def psnr(self, a, b):
        return float(-10 * np.log10(np.mean((a - b)[self.inside()].astype(float) ** 2)))


class Lens:
    def __init__(self, program, name, center_mm, folder):
        self.program, self.name, self.folder = program, name, folder
        axis = [round((SIDE - 1) / 2 - mm * 1e3 / PITCH_UM) for mm in center_mm]
        center = [((SIDE - 1) / 2 - a) * PITCH_UM * 1e-3 for a in axis]
        self.flags = ["--lens", name, "--wavelengths", NM, "--film-pitch-um", PITCH_UM, f"--axis={axis[0]},{axis[1]}",
                      f"--center={center[0]},{center[1]}"]

    def run(self, *words):
        done = subprocess.run([self.program, *map(str, words)], capture_output=True, text=True)
        if done.returncode:
            raise SystemExit(f"{words}: {done.stderr}")
        return done.stdout

    def film(self, chart, name, *flags):
        np.save(self.folder / "chart.npy", chart[None])
        self.run("run", self.folder / "chart.npy", self.folder / name, "--overwrite", *self.flags, *flags)
        return read(self.folder / name, "film")

    def add_noise(self, name, sigma):
        film = zarr.open_array(f"{self.folder / name}/film", mode="r+")
        film[:] = film[:] + np.random.default_rng(1).normal(0, sigma, film.shape).astype("f4")
        return np.asarray(film[0])

    def restore(self, film, *flags):
        out, start = self.folder / "restored.zarr", time.time()
        report = json.loads(self.run("restore", self.folder / film, out, "--overwrite", "--json", *flags))
        return read(out, "chart"), report, time.time() - start


def filtered(film, psf, chart, places):
    """The best of each filter."""
    wiener = (restoration.wiener(film, psf, balance, clip=False) for balance in np.geomspace(1e-4, 10, 16))
    masks = (filters.unsharp_mask(film, radius, amount, preserve_range=True)
             for radius in (1, 2, 3, 5, 8) for amount in (0.25, 0.5, 1, 2, 3, 5, 8))
    best = lambda images: max(map(places.undone, images), key=lambda image: places.psnr(image, chart))
    return best(wiener), best(masks)


def main():
    program, out = sys.argv[1], Path(sys.argv[2])
    out.mkdir(parents=True, exist_ok=True)
    rows, strips, chosen = [], [], sys.argv[3:]
    with tempfile.TemporaryDirectory() as temporary:
        for name, center_mm in (lens for lens in LENSES if not chosen or lens[0] in chosen):
            lens = Lens(program, name, center_mm, Path(temporary))
            point = np.zeros((SIDE, SIDE), "f4")
            point[SIDE // 2, SIDE // 2] = 1
            response = lens.film(point, "point.zarr", "--tails=off")
            places = Places(lens)
            # About the chief ray, between pixels: the PSF may be brightest, or have its centroid, elsewhere.
            y, x = places.places[:, SIDE // 2, SIDE // 2]
            half = int(min(45, y, x, SIDE - 1 - y, SIDE - 1 - x)) - 1
            grid = np.mgrid[-half : half + 1, -half : half + 1] + np.reshape([y, x], (2, 1, 1))
            psf = np.clip(map_coordinates(response.astype(float), grid, order=3), 0, None)
            psf /= psf.sum()
            for chart_name in PICTURES:
                chart = picture(chart_name)
                for sigma in NOISES:
                    lens.film(chart, "film.zarr")
                    film = lens.add_noise("film.zarr", sigma)
                    wiener, unsharp = filtered(film.astype(float), psf, chart, places)
                    film = places.undone(film.astype(float))
                    given, report, seconds = lens.restore("film.zarr", "--noise", sigma)
                    plateaus, _, plateaus_seconds = lens.restore("film.zarr", "--noise", sigma, "--method", "total-variation")
                    estimated, guess, _ = lens.restore("film.zarr")
                    steps, steps_report, steps_seconds = lens.restore("film.zarr", "--noise", sigma, "--method", "richardson-lucy")
                    figures = [places.psnr(image, chart) for image in (film, unsharp, wiener, steps, given, plateaus, estimated)]
                    rows.append({"lens": name, "picture": chart_name, "noise": sigma, **dict(zip(METHODS, figures)), "seconds": seconds,
                                 "richardson_lucy_seconds": steps_seconds, "total_variation_seconds": plateaus_seconds, "noise_estimated": guess["bands"][0]["noise"],
                                 "report": report["bands"][0], "iterations": steps_report["bands"][0]["iterations"]})
                    print(name, chart_name, sigma, [round(v, 2) for v in figures], f"{seconds:.1f} s", flush=True)
                    if chart_name == "astronaut" and sigma == NOISES[0]:
                        parts = [film, unsharp, wiener, steps, given, plateaus, chart]
                        strips.append(np.hstack([part[40:168, 60:188] for part in parts]))
    shade = lambda linear: np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.clip(linear, 1e-9, 1) ** (1 / 2.4) - 0.055)
    figure = Image.fromarray((255 * shade(np.clip(np.vstack(strips), 0, 1))).round().astype("u1"))
    figure.save(out / "figure.png", optimize=True)
    (out / "table.json").write_text(json.dumps(rows, indent=1) + "\n")
    lines = ["| lens | picture | noise | " + " | ".join(METHODS) + " |", "|---" * (len(METHODS) + 3) + "|"]
    for row in rows:
        lines.append(f"| {row['lens']} | {row['picture']} | {row['noise']} | " + " | ".join(f"{row[m]:.2f}" for m in METHODS) + " |")
    (out / "table.md").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
