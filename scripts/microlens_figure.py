#!/usr/bin/env python3
"""Draws what microlenses that are not shifted for a lens do to its picture, beside those that are.

    python3 -m venv V && V/bin/pip install pillow
    V/bin/python scripts/microlens_figure.py LENSCUBE scripts/readme/microlenses.png

The composite chart, 1600 x 1200 px of 2 um, behind the phone lens (chief rays of 27 degrees in the corners), on the built-in sensor example-2um with a response over the angle of incidence: half at 22, 25 and 28
degrees for red, green and blue. Left: microlenses centred; right: shifted for the lens. Without noise, no shading undone.
"""
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

ANGLE = ["stack_index=1.5", "acceptance_deg=25", "filters.R.acceptance_deg=22", "filters.B.acceptance_deg=28"]
SIDES, GAP = (560, 420), 8


def main(program, out):
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        run = lambda *words: subprocess.run([program, *map(str, words), "--quiet"], check=True)
        run("run", "gen:composite?size=1600x1200&pitch_um=2&wavelengths=400:700:20", place / "film.zarr", "--lens", "phone")
        sheet = Image.new("RGB", (2 * SIDES[0] + GAP, SIDES[1]), "white")
        for k, microlenses in enumerate(("centred", "lens")):
            fields = [word for field in [*ANGLE, f"microlenses={microlenses}"] for word in ("--set", f"angle.{field}")]
            raw, picture = place / f"{k}.zarr", place / f"{k}.png"
            run("sensor", place / "film.zarr", raw, "--sensor", "example-2um", "--noise", "none", "--exposure", "auto:0.8", *fields)
            run("develop", raw, picture)
            sheet.paste(Image.open(picture).convert("RGB").resize(SIDES, Image.LANCZOS), (k * (SIDES[0] + GAP), 0))
    sheet.quantize(256, dither=Image.Dither.NONE).save(out, optimize=True)


main(*sys.argv[1:])
