#!/usr/bin/env python3
"""Makes charts/, packs/ and cases/ of this folder: charts with depth, lens packs with depth nodes, and the films that depth_reference.py computes.

    python3 -m venv v && v/bin/pip install numpy==2.4.6 zarr==3.1.5 numcodecs==0.16.6
    v/bin/python tests/golden/depth/make_depth_golden.py [FOLDER]       default: beside this file; half a minute

A case is case.json and expected.zarr as in ../make_golden.py, and
    hidden            "given": the sheets of the chart's store; "invented": sheet 0 and surfaces extrapolated behind its edges; "none": sheet 0 alone
    part_I_compared   1 where a pixel is compared. Elsewhere T/U of a slab is above MAX_GAIN: little is known there and rounding is amplified
    invented_I        film block of 64 x 64 px: share of its light that is invented
A chart holds `chart` (wavelength, y, x), `depth` [m] (y, x), `coverage`, and `hidden/N/...` of the same arrays; vergence is 1/depth in f64, 0
for infinity. A pixel whose nearest depth sample would be another one 1e-5 px away, with another depth, is not allowed in a case (`ties`):
other arithmetic could choose it.
Packs have the schema "lenscube/lens-pack/2"; their kernels are discs times noise, so that no symmetry hides a rotation.
"""
import json
import shutil
import sys
from pathlib import Path

import numpy as np
import zarr

import depth_reference as depth
import lens_pack
from closed_forms import disc_area
from depth_reference import ref
from lens_pack import CODEC

OUT = Path(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).parent).resolve()
PITCH_UM, PITCH = 2.0, 2e-3
MAX_GAIN = 2.0


def make_pack(name, seed, vergence, focus, blur_px, reach_mm, shares, bands=1, points=100, moving=True):
    """`vergence`: nodes of every band; `shares`: PSF heights as shares of `reach_mm`; `moving`: pupil shift and etendue ratio that vary."""
    rng = np.random.default_rng(seed)
    lenses, focus = [], 1 / (1 / focus)                     # as read from the pack's focus distance
    for band in range(bands):
        h_real = np.concatenate([[0], np.cumsum(rng.uniform(0.3, 1.0, points - 1))])
        h_real *= reach_mm / h_real[-1]
        q = (h_real / reach_mm) ** 2
        h_ideal, ri = h_real * (1.004 + rng.uniform(-0.03, 0.03) * q), 1 - rng.uniform(0.1, 0.4) * q
        grid = []
        for v in vergence[band]:
            radius = 1.2 + abs(v - focus) * blur_px
            n = 2 * int(np.ceil(radius)) + 1
            y, x = np.mgrid[:n, :n] - n // 2
            kernels = np.array([disc_area(radius, y, x - 0.3 * k) for k in range(len(shares))]) * rng.uniform(0.5, 1.5, (len(shares), n, n))
            grid.append((kernels / kernels.sum((1, 2), keepdims=True)).astype(np.float32))
        delta_mm = 0.9 * q if moving else 0 * q
        ratio = 1 + (rng.uniform(-0.05, 0.05, (len(vergence[band]), 1)) if moving else np.zeros((len(vergence[band]), 1))) * q
        lenses.append(dict(h_real=h_real, h_ideal=h_ideal, ri=ri, vergence=np.asarray(vergence[band], float), kernels=grid,
                           delta_mm=delta_mm, ratio=ratio))
    lens_pack.write(OUT / "packs" / f"{name}.lens.zip", lenses, reach_mm * np.array(shares), focus, blur_px, PITCH_UM)
    for lens in lenses:
        # h(r, V) = h(r, 0) + f_D tan(theta) delta V/1000, f_D tan(theta) = h_ideal
        heights = [reach_mm * np.array(shares)] * len(lens["kernels"])
        grid = [ref.quarter_rotations(k.astype(float)) for k in lens["kernels"]]
        lens["model"] = depth.Lens(lens["h_ideal"], lens["h_real"], lens["ri"], lens["vergence"], heights, grid, blur_px, focus,
                                   lens["h_ideal"] * lens["delta_mm"] * 1e-3, lens["ratio"])
    return lenses, f"../../packs/{name}.lens.zip"


def make_chart(name, seed, shape, sheets, noise=(31, 29), side=1):
    """`sheets(y, x)`: list of (vergence [1/m], coverage or None), the nearest first; charts are repeated noise in squares of `side` pixels."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:shape[1], :shape[2]]
    out = []
    for q, (vergence, coverage) in enumerate(sheets(y, x)):
        block = np.kron(rng.uniform(0, 1, (shape[0], *noise)), np.ones((1, side, side)))
        chart = np.tile(block, (1, -(-shape[1] // block.shape[1]), -(-shape[2] // block.shape[2])))[:, :shape[1], :shape[2]].astype(np.float32)
        distance = np.divide(1, vergence, out=np.full(vergence.shape, np.inf), where=vergence > 0).astype(np.float32)
        path = OUT / "charts" / f"{name}.zarr"
        g = zarr.open_group(path, mode="w", zarr_format=3, attributes={"pitch_um": PITCH_UM}) if q == 0 else zarr.open_group(path, mode="a")
        if q == 0:
            g.create_array("wavelength", data=500.0 + 50 * np.arange(shape[0]), dimension_names=["wavelength"]).attrs["units"] = "nm"
        else:
            g = g.create_group(f"hidden/{q}")
        g.create_array("chart", data=chart, chunks=(1, *shape[1:]), dimension_names=["wavelength", "y", "x"], compressors=CODEC)
        g.create_array("depth", data=distance, dimension_names=["y", "x"], compressors=CODEC, attributes={"unit": "m", "kind": "planar"})
        if coverage is not None:
            g.create_array("coverage", data=coverage.astype(np.float32), dimension_names=["y", "x"], compressors=CODEC)
        exact = np.divide(1, distance.astype(float), out=np.zeros(distance.shape), where=np.isfinite(distance))
        out.append((chart.astype(float), exact, None if coverage is None else coverage.astype(np.float32).astype(float)))
    return out, f"../../charts/{name}.zarr"


def ties(sheets, lens, size, axis, margin, scale, center, surround):
    """Number of film pixels whose nearest depth or coverage would differ 1e-5 chart px away."""
    count = 0
    for s, (low, high) in enumerate(lens.slabs()):
        h = lens.h_ideal + lens.shift * (lens.vergence[low] + lens.vergence[high]) / 2
        cy, cx, _ = ref.places(sheets[0][1].shape, size, PITCH, h, lens.h_real, axis, margin, scale, center)
        at = lambda v, dy, dx: ref.fetch(v, np.floor(cy + dy + 0.5).astype(int), np.floor(cx + dx + 0.5).astype(int), surround)
        for _, *planes in sheets:
            for v in (p for p in planes if p is not None):
                count += sum((at(v, dy, dx) != at(v, 0, 0)).sum() for dy, dx in ((1e-5, 0), (-1e-5, 0), (0, 1e-5), (0, -1e-5)))
    return count


def make_case(name, chart, pack, size, hidden, windows, axis=None, scale=(1, 1), center=(0.0, 0.0), surround="edge", interp="bicubic"):
    """Sizes are (rows, columns); axis, scale, center are (y, x); a window is (y, x, h, w, step_y, step_x)."""
    (sheets, chart_file), (lenses, pack_file) = chart, pack
    axis = ((size[0] - 1) / 2, (size[1] - 1) / 2) if axis is None else axis
    used = sheets if hidden == "given" else sheets[:1]
    margin = max(lens["model"].window(d) for lens in lenses for d in range(len(lens["kernels"]))) // 2
    if min(scale) >= 1:
        shifts = (k * 1.7e-6 for k in range(100))
        tied = lambda at: sum(ties(used, b["model"], size, axis, margin, scale, at, surround) for b in lenses)
        shift = next(d for d in shifts if tied((center[0] + d, center[1] - d)) == 0)
        center = (round(center[0] + shift, 9), round(center[1] - shift, 9))
    flags = ["--film-size", f"{size[1]}x{size[0]}", "--scale", f"{scale[1]!r},{scale[0]!r}", "--axis", f"{axis[1]!r},{axis[0]!r}",
             "--center", f"{center[1]!r},{center[0]!r}", "--surround", surround, "--interp", interp]
    g = zarr.open_group(OUT / "cases" / name / "expected.zarr", mode="w", zarr_format=3)
    kept = [[] for _ in windows], [[] for _ in windows]
    peaks, shares, excluded = [], [], 0.0
    for b, lens in enumerate(lenses):
        of_band = [depth.Sheet(c[b], v, cover) for c, v, cover in used]
        film = depth.film(of_band, lens["model"], size, PITCH, axis, hidden == "invented", scale=scale, center=center, method=interp,
                          surround=surround)
        compared = np.max([passing / u for _, passing, _, u in film.slabs], axis=0) <= MAX_GAIN
        excluded = max(excluded, 1 - compared.mean())
        peaks.append(float(abs(film.light).max()))
        shares.append(depth.invented_share(film.light, film.invented) if film.invented is not None else None)
        for i, (y, x, h, w, sy, sx) in enumerate(windows):
            kept[0][i].append(film.light[y:y + h:sy, x:x + w:sx])
            kept[1][i].append(compared[y:y + h:sy, x:x + w:sx])
    for i in range(len(windows)):
        for key, values, kind in ((f"part_{i}", kept[0][i], np.float32), (f"part_{i}_compared", kept[1][i], np.uint8)):
            data = np.array(values).astype(kind)
            g.create_array(key, data=data, chunks=(1, *data.shape[1:]), compressors=CODEC)
    for b, share in enumerate(shares):
        if share is not None:
            g.create_array(f"invented_{b}", data=share.astype(np.float32), compressors=CODEC)
    parts = [{"array": "film", "expected": f"part_{i}", "y": y, "x": x, "height": h, "width": w, "step_y": sy, "step_x": sx}
             for i, (y, x, h, w, sy, sx) in enumerate(windows)]
    case = {"chart": chart_file, "lens": pack_file, "flags": flags, "hidden": hidden, "peak": peaks, "compared": parts}
    (OUT / "cases" / name / "case.json").write_text(json.dumps(case, indent=1) + "\n")
    stored = sum(p.stat().st_size for p in (OUT / "cases" / name).rglob("*") if p.is_file())
    print(f"{name}: peak {max(peaks):.3f}, {100 * excluded:.2f} % not compared, invented up to "
          f"{max((s.max() for s in shares if s is not None), default=0):.3f}, {stored} bytes", flush=True)


def three_planes(y, x):
    """A near disc before a middle square before a wall; hidden sheets complete, the disc's rim partly covered."""
    disc, square = np.clip(34.5 - np.hypot(y - 105, x - 110), 0, 1), (abs(y - 150) < 40) & (abs(x - 160) < 45)
    wall, middle = np.full(y.shape, 0.21), np.full(y.shape, 0.83)
    return [(np.full(y.shape, 1.67), disc), (middle, square * 1.0), (wall, None)]


def close_surfaces(y, x):
    """A ball 0.6 to 5.3 px of blur before a wall of 12 px: its front alone is apart from the wall, and seen in some cells of the film only."""
    r = np.hypot(y - 103.2, x - 103.6) / 30
    return [(1.1260 + 0.047 * np.sqrt(np.maximum(0, 1 - r * r)), np.clip((1 - r) * 30 + 0.5, 0, 1)), (np.full(y.shape, 1.12), None)]


def slanted(y, x):
    """A tilted near plane (left part) before a wall that is hidden behind it; the plane runs through three slabs."""
    left = x < 130 + 0.3 * y
    tilt = 1.02 + 0.004 * x
    return [(np.where(left, tilt, 0.05), None), (np.full(y.shape, 0.05), left * 1.0)]


def objects(y, x):
    """Sheet 0 alone: two near objects of different depth before a wall and sky at infinity."""
    v = np.where(y < 70, 0.0, 0.3)
    v = np.where((abs(y - 120) < 35) & (abs(x - 90) < 30), 1.1, v)
    return [(np.where(np.hypot(y - 120, x - 160) < 38, 1.8, v), None)]


for folder in ("charts", "packs", "cases"):
    shutil.rmtree(OUT / folder, ignore_errors=True)
six = make_pack("six-slabs", 21, [[0.0, 0.2, 0.5, 0.93, 1.3, 1.6, 2.0]], 0.5, 5.0, 0.5, [0, 0.35, 0.6, 1])
two_bands = make_pack("two-bands", 22, [[0.0, 0.3, 1.0, 1.4, 1.9], [0.0, 0.4, 0.8, 1.2, 1.5, 2.0]], 1.2, 6.0, 0.5, [0, 0.5, 1], bands=2)
fixed = make_pack("fixed-pupil", 23, [[0.0, 0.25, 0.6, 1.15, 1.9]], 0.3, 8.0, 0.6, [0, 0.4, 1], moving=False)
close = make_pack("close-nodes", 24, [[1.115, 1.13, 1.145, 1.165, 1.175]], 1.0, 100.0, 0.5, [0, 1])
planes = make_chart("three-planes", 31, (1, 230, 240), three_planes)
slope = make_chart("slanted", 32, (2, 230, 240), slanted)
scene = make_chart("objects", 33, (1, 230, 240), objects)
ball = make_chart("close-surfaces", 34, (1, 170, 170), close_surfaces, noise=(5, 7), side=12)
grid, strip = (0, 0, 192, 192, 3, 2), (90, 0, 24, 192, 1, 2)
make_case("hidden-given", planes, six, (192, 192), "given", [grid, strip], axis=(90.3, 101.7), scale=(1.03, 1.01), center=(0.012, -0.008))
make_case("close-surfaces", ball, close, (140, 140), "given", [(41, 41, 96, 96, 1, 2)])
make_case("slanted-two-bands", slope, two_bands, (192, 192), "given", [grid], scale=(1.0, 1.1), surround="mirror", interp="bilinear")
make_case("invented", scene, fixed, (192, 192), "invented", [grid, strip], axis=(95.5, 60.0), surround="black", center=(0.03, 0.0))
make_case("sheet-0-alone", scene, six, (161, 150), "none", [(0, 0, 161, 150, 3, 2)])
make_case("scale-below-one", planes, fixed, (130, 141), "given", [(0, 0, 130, 141, 2, 2)], scale=(0.7, 0.7), surround="black")
make_case("scale-below-one-invented", scene, six, (130, 141), "invented", [(0, 0, 130, 141, 3, 2)], scale=(0.7, 0.62))
