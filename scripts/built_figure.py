#!/usr/bin/env python3
"""The picture of lenses as built in README: one place of a chart through a lens as designed, the median lens and the 10th percentile of 200; and their yield.

    python3 scripts/built_figure.py LENSCUBE [scripts/readme/built-lenses.png]

Double Gauss 28 degrees, film of 28 mm, pixels of 2 um at 200 %, 16.1 mm from the axis. Elements decentred by up to 40 um and tilted by up to 2', gaps by up to 40 um, the film tilted by
up to 5' (normal, limits at 2 sigma); each lens is focused for the MTF at 50 lp/mm over the film, boresight removed. Below: the share of lenses with at least a mean MTF. Needs NumPy and
Pillow; two minutes on two cores.
"""

import csv
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

LENSES, FILM, STARS, STAR, PX, ZOOM, GAP, PLOT = 200, 14141, 88, 8, 160, 2, 8, 200
ELEMENTS, GAPS = ((1, 2), (3, 5), (7, 9), (10, 11)), (2, 5, 9)
BANDS = "460,540,620"
SETTINGS = '[compensate]\nboresight = "remove"\n[criterion]\nkind = "mtf"\nfrequency_per_mm = 50\n'


def tolerances(share):
    """The description with limits that are `share` of the full ones."""
    of = lambda limit: f"[{-share * limit}, {share * limit}]"  # noqa: E731
    text = "".join(f"[[element]]\nsurfaces = [{a}, {b}]\ndecentre_um = {of(40)}\ntilt_arcmin = {of(2)}\n" for a, b in ELEMENTS)
    text += "".join(f"[[gap]]\nafter = {a}\nthickness_um = {of(40)}\n" for a in GAPS)
    return text + f"[[film]]\ntilt_arcmin = {of(5)}\n" + SETTINGS


def main():
    program, out = Path(sys.argv[1]).resolve(), Path(sys.argv[2] if len(sys.argv) > 2 else "scripts/readme/built-lenses.png")
    corner = round((STAR + 0.5) * FILM / STARS) - PX // 2
    with tempfile.TemporaryDirectory() as folder:
        here = Path(folder)
        run = lambda *words: subprocess.run([program, *map(str, words), "--quiet"], cwd=folder, check=True)  # noqa: E731
        (here / "tol.toml").write_text(tolerances(1))
        (here / "none.toml").write_text(tolerances(0))
        run("lens", "tolerance", "double-gauss-28", "tol.toml", "--samples", LENSES, "--out", "built", "--max-height-mm", 20)
        run("lens", "tolerance", "double-gauss-28", "none.toml", "--samples", 1, "--out", "none", "--max-height-mm", 20)
        read = lambda name: list(csv.DictReader((here / name / "lenses.csv").open()))  # noqa: E731
        rows = sorted(read("built"), key=lambda row: float(row["criterion"]))
        shown = [("as designed", "none.toml", read("none")[0]), (f"median of {LENSES}", "tol.toml", rows[LENSES // 2]),
                 ("10th percentile", "tol.toml", rows[LENSES // 10])]
        films = []
        for k, (_, file, row) in enumerate(shown):
            chart = f"gen:siemens?size={FILM}&grid={STARS}&spokes=18&wavelengths={BANDS}&pitch_um=2"
            run("run", chart, f"{k}.zarr", "--lens", "double-gauss-28", "--tolerances", file, "--lens-sample", row["sample"], "--film-pitch-um", 2,
                "--film-size", FILM, "--roi", f"{corner},{corner},{PX},{PX}")
            run("export", f"{k}.zarr//roi_0", f"{k}.npy")
            films.append(np.load(here / f"{k}.npy").reshape(3, PX, PX)[::-1].transpose(1, 2, 0))
    font, side = ImageFont.load_default(14), PX * ZOOM
    picture = Image.new("RGB", (3 * side + 2 * GAP, side + 28 + PLOT), "white")
    draw, peak = ImageDraw.Draw(picture), max(film.max() for film in films)
    for k, (film, (name, _, row)) in enumerate(zip(films, shown)):
        pixels = np.round(255 * np.clip(film / peak, 0, 1) ** (1 / 2.2)).astype(np.uint8)
        left = k * (side + GAP)
        picture.paste(Image.fromarray(pixels).resize((side, side), Image.NEAREST), (left, 0))
        draw.text((left + 2, side + 4), f"{name}: mean MTF {float(row['criterion']):.3f}", fill="black", font=font)
    # Share of lenses with at least a mean MTF.
    values = np.array([float(row["criterion"]) for row in rows])
    low, high = 0.02 * np.floor(values[0] / 0.02), 0.02 * np.ceil(float(shown[0][2]["criterion"]) / 0.02)
    x = lambda mtf: 60 + (mtf - low) / (high - low) * (picture.width - 90)  # noqa: E731
    y = lambda share: side + 36 + (1 - share) * (PLOT - 70)  # noqa: E731
    for share in (0, 0.5, 1):
        draw.line([(60, y(share)), (picture.width - 30, y(share))], fill="#cccccc")
        draw.text((12, y(share) - 8), f"{share:.0%}", fill="black", font=font)
    for mtf in np.arange(low, high + 0.01, 0.02):
        draw.text((x(mtf) - 14, y(0) + 6), f"{mtf:.2f}", fill="black", font=font)
    draw.text((60, y(0) + 24), f"share of {LENSES} lenses whose mean MTF at 50 lp/mm, of 17 places of the film and three wavelengths, is at least this", fill="black", font=font)
    steps = [(x(value), y(1 - k / LENSES)) for k, value in enumerate(values)]
    draw.line([(x(low), y(1)), *steps, (x(values[-1]), y(0))], fill="#1f4e9c", width=2)
    for (_, _, row), colour in zip(shown, ("#2a8a2a", "#1f4e9c", "#c0392b")):
        at = x(float(row["criterion"]))
        draw.line([(at, y(1)), (at, y(0))], fill=colour, width=2)
    picture.save(out, optimize=True)


if __name__ == "__main__":
    main()
