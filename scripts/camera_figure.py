"""Lays out what three sensors record of one corner of a film; run by scripts/camera-figure.

Film: the composite chart on the default film (14141 px of 2 µm), behind the built-in Double Gauss; a field of 1 mm, 17 mm from the axis.
Every sensor lies on that field. Above: the time at which 99.9 % of its pixels stay below 0.9 of saturation. Below: a quarter of it, developed with
+2 EV. The same field in all panels; a sensor's pixel is a square of one colour.
"""
import io
import math
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
from PIL import Image  # noqa: E402

LENSCUBE = os.environ["LENSCUBE"]
SENSORS = [("example-2um", 2.0), ("sony-a7r2", 4.51), ("cmv12000-rgb", 5.5)]
FIELD_MM, PITCH_MM, FILM_PX = 1.0, 2e-3, 14141
# Film region (x, y) in pixels, with a margin of 50 µm around the field; its middle in mm from the axis.
FIRST_PX, SIDE_PX = (12720, 13080), 550
CENTRE_MM = tuple((first + SIDE_PX / 2 - FILM_PX / 2) * PITCH_MM for first in FIRST_PX)


def lenscube(*words):
    done = subprocess.run([LENSCUBE, *map(str, words)], capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"lenscube {' '.join(map(str, words))}\n{done.stderr}")
    return done.stderr


def panels(place):
    film = place / "film.zarr"
    roi = f"{FIRST_PX[0]},{FIRST_PX[1]},{SIDE_PX},{SIDE_PX}"
    lenscube("run", f"gen:composite?size={FILM_PX}", film, "--lens", "double-gauss-28-npz", "--roi", roi, "--no-fsync")
    for name, pitch_um in SENSORS:
        side = round(FIELD_MM / (pitch_um * 1e-3))
        here = ["--sensor", name, "--center", f"{CENTRE_MM[0]},{CENTRE_MM[1]}", "--size", f"{side}x{side}", "--no-fsync"]
        said = lenscube("sensor", f"{film}//roi_0", place / f"{name}-auto.zarr", *here, "--exposure", "auto")
        seconds = float(re.search(r"^exposure ([0-9.e+-]+) s", said, re.M)[1])
        raw = place / f"{name}.zarr"
        lenscube("sensor", f"{film}//roi_0", raw, *here, "--exposure", f"{seconds!r},{seconds / 4!r}")
        pictures = []
        for frame, ev in ((0, 0), (1, 2)):
            picture = place / f"{name}-{frame}.png"
            lenscube("develop", raw, picture, "--frame", frame, "--exposure", ev)
            pictures.append(plt.imread(picture))
        yield name, pitch_um, seconds, pictures


def main(out):
    with tempfile.TemporaryDirectory() as place:
        columns = list(panels(Path(place)))
    plt.rcParams.update({"font.family": "DejaVu Sans", "font.size": 8})
    figure, axes = plt.subplots(2, len(columns), figsize=(7.1, 5.0), layout="constrained")
    for (name, pitch_um, seconds, pictures), column in zip(columns, axes.T):
        for stop, (axis, picture) in enumerate(zip(column, pictures)):
            axis.imshow(picture, interpolation="nearest", extent=(0, FIELD_MM * 1e3, FIELD_MM * 1e3, 0))
            time = seconds / 4**stop
            axis.set_title(f"{name}, {pitch_um:g} µm, {time * 1e3:.3g} ms" + (", +2 EV" if stop else ""), fontsize=8)
            axis.set_xticks([0, 250, 500, 750, 1000] if stop else [])
            axis.set_yticks([0, 250, 500, 750, 1000] if column is axes.T[0] else [])
            if stop:
                axis.set_xlabel("µm")
        column[0].label_outer()
    axes[0][0].set_ylabel("base ISO, exposed for 0.9 of saturation\nµm")
    axes[1][0].set_ylabel("two stops under\nµm")
    drawn = io.BytesIO()
    figure.savefig(drawn, dpi=150)
    # 256 colours: a third of the bytes.
    Image.open(drawn).convert("RGB").quantize(256, dither=Image.Dither.NONE).save(out, optimize=True)
    print(f"{out}: {Path(out).stat().st_size / 1e3:.0f} kB, middle of the field {math.hypot(*CENTRE_MM):.2f} mm from the axis")


main(sys.argv[1])
