#!/usr/bin/env python3
"""Makes charts/, packs/ and cases/: charts, lens packs and the films that the float64 model (reference.py) computes of them.

    python3 -m venv v && v/bin/pip install numpy==2.4.6 zarr==3.1.5 numcodecs==0.16.6
    v/bin/python tests/golden/make_golden.py [FOLDER]       default: beside this file; half a minute

Seeds are fixed: the same versions write the same bytes; `scripts/check-golden` writes them anew and compares.  A case is
case.json (what follows `lenscube run CHART FILM --lens PACK`, and which pixels of the film are compared) and expected.zarr.
Large films are compared on dense strips across tile seams and on a grid with steps that are coprime to every tile side, so
that the tree stays small; large charts repeat one block of noise.
"""
import json
import shutil
import sys
import tempfile
import zipfile
from pathlib import Path

import numpy as np
import zarr
from zarr.codecs import BloscCodec, ZstdCodec

import reference as ref

OUT = Path(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).parent).resolve()
PITCH_UM, PITCH = 2.0, 2e-3
HC = 6.62607015e-34 * 299792458.0
STAGES = {"ri", "distortion", "svpsf"}


# Packs: random kernels (no symmetry that would hide a rotation or a mirror image), uneven heights and field points, J = 4.

def make_pack(name, seed, reach_mm, windows, heights, points, azimuths=4, tilt=0.0):
    """`heights` per band: shares of the reach; `reach_mm` covers the farthest pixel of any case that uses the pack."""
    rng = np.random.default_rng(seed)
    pack = {"wavelength": 450.0 + 50 * np.arange(len(windows)), "bands": []}
    for n, shares in zip(windows, heights):
        h_real = np.concatenate([[0], np.cumsum(rng.uniform(0.3, 1.0, points - 1))])
        h_real *= reach_mm / h_real[-1]
        q = (h_real / reach_mm) ** 2
        bend, dim = rng.uniform(-0.04, 0.04), rng.uniform(0.1, 0.5)
        kernels = rng.uniform(0, 1, (len(shares), n, n)) ** 3
        if tilt:                                        # most of the light well off the chief ray, as in strong coma
            kernels *= np.exp(tilt * np.linspace(-1, 1, n))[None, None, :]
        kernels = (kernels / kernels.sum((1, 2), keepdims=True)).astype(np.float32)
        pack["bands"].append({
            "h_real": h_real, "h_ideal": h_real * (1.004 + bend * q), "ri": 1 - dim * q, "kernels": kernels,
            "r_grid": reach_mm * np.array(shares), "solid_angle": rng.uniform(0.05, 0.3), "transmission": rng.uniform(0.5, 1),
        })
    most = max(len(b["r_grid"]) for b in pack["bands"])
    pad = lambda row: np.concatenate([row, np.full(most - len(row), np.nan)])
    with tempfile.TemporaryDirectory() as tmp:
        g = zarr.open_group(tmp, mode="w", zarr_format=3, attributes={
            "schema": "lenscube/lens-pack/1", "name": name, "distortion_focal_length_mm": 50.0, "effective_focal_length_mm": 50.0,
            "f_number": 2.0, "primary_wavelength_nm": 500.0, "psf_sample": "integrated", "object_distance_mm": None, "magnification": 0.0,
        })
        put = lambda key, data: g.create_array(key, data=np.asarray(data), compressors=BloscCodec(cname="zstd", clevel=9, shuffle="shuffle"))
        put("wavelength", pack["wavelength"])
        for key, name_ in (("h_ideal", "ideal_height"), ("h_real", "image_height"), ("ri", "relative_illumination")):
            put(name_, np.stack([b[key] for b in pack["bands"]]))
        put("psf_height", np.stack([pad(b["r_grid"]) for b in pack["bands"]]))
        counts = [np.where(np.arange(most) == 0, 1, azimuths) * (np.arange(most) < len(b["r_grid"])) for b in pack["bands"]]
        put("azimuth_count", np.array(counts, np.int32))
        put("psf_energy", np.stack([pad(np.ones(len(b["r_grid"]))) for b in pack["bands"]]))
        put("psf_pitch", np.full(len(windows), PITCH_UM))
        for key in ("solid_angle", "transmission"):
            put(key, np.array([b[key] for b in pack["bands"]]))
        for i, b in enumerate(pack["bands"]):
            put(f"psf/{i}", b["kernels"])
        out = OUT / "packs" / f"{name}.lens.zip"
        out.parent.mkdir(exist_ok=True)
        with zipfile.ZipFile(out, "w") as z:
            for path in sorted(p for p in Path(tmp).rglob("*") if p.is_file()):
                info = zipfile.ZipInfo(f"{name}.lens.zarr/" + path.relative_to(tmp).as_posix(), (1980, 1, 1, 0, 0, 0))
                z.writestr(info, path.read_bytes(), zipfile.ZIP_DEFLATED)
    pack["file"] = f"../../packs/{name}.lens.zip"
    return pack


# Charts: noise, in the layouts that charts come in.

def make_chart(name, seed, shape, dtype="float32", chunks=None, block=None, low=0.0, zarr_format=3, bare=False):
    rng = np.random.default_rng(seed)
    small = shape if block is None else (shape[0], *block)
    integer = np.issubdtype(dtype, np.integer)
    noise = rng.integers(0, np.iinfo(dtype).max, small) if integer else rng.uniform(low, 1, small)
    reps = [1, -(-shape[1] // small[1]), -(-shape[2] // small[2])]
    data = np.tile(noise, reps)[:, :shape[1], :shape[2]].astype(dtype)
    path = OUT / "charts" / f"{name}.zarr"
    chunks = chunks or (1, *shape[1:])
    if zarr_format == 2:
        a = zarr.create_array(path, shape=shape, dtype=dtype, chunks=chunks, zarr_format=2, fill_value=0)
        a[:] = data
    else:
        g = zarr.open_group(path, mode="w", zarr_format=3, attributes={} if bare else {"pitch_um": PITCH_UM})
        if not bare:
            g.create_array("wavelength", data=450.0 + 50 * np.arange(shape[0]), dimension_names=["wavelength"]).attrs["units"] = "nm"
        names = None if bare else ["wavelength", "y", "x"]
        a = g.create_array("chart", shape=shape, dtype=dtype, chunks=chunks, dimension_names=names, compressors=ZstdCodec(level=19))
        a[:] = data
    return data.astype(float), f"../../charts/{name}.zarr"


# Cases.

def make_case(name, chart, pack, size, args=(), axis=None, scale=(1, 1), center=(0, 0), stages=STAGES, interp="bicubic",
              surround="edge", outside="error", bands=None, crop=None, units="relative", windows=None, rois=(), declare=()):
    """Sizes are (rows, columns); axis, scale, center are (x, y) as on the command line; a window is (y, x, h, w, step_y, step_x)."""
    data, chart_file = chart
    words = ["--film-size", f"{size[1]}x{size[0]}", "--scale", f"{scale[0]!r},{scale[1]!r}", *declare]
    if axis is not None:
        words += ["--axis", f"{axis[0]!r},{axis[1]!r}"]
    if center != (0, 0):
        words += ["--center", f"{center[0]!r},{center[1]!r}"]
    if stages != STAGES:
        words += ["--stages", ",".join(sorted(stages))]
    for flag, value, default in (("interp", interp, "bicubic"), ("surround", surround, "edge"), ("outside", outside, "error"),
                                 ("psf-window", crop, None), ("film-units", units, "relative")):
        if value != default:
            words += [f"--{flag}", str(value)]
    chosen = list(range(len(data))) if bands is None else bands
    if bands is not None:
        words += ["--bands", ",".join(map(str, bands))]
    for y, x, h, w in rois:
        words += ["--roi", f"{x},{y},{w},{h}"]
    words += args
    films = []
    for b in chosen:
        t = pack["bands"][b]
        h_ideal = t["h_ideal"] if "distortion" in stages else t["h_real"]
        ri = t["ri"] if "ri" in stages else np.ones_like(t["ri"])
        kw = dict(axis=None if axis is None else axis[::-1], scale=scale[::-1], center=center[::-1], method=interp, surround=surround, outside=outside)
        tables = (size, PITCH, h_ideal, t["h_real"], ri)
        if "svpsf" in stages:
            kernels = t["kernels"].astype(float)
            if crop and crop < kernels.shape[-1]:
                cut = (kernels.shape[-1] - crop) // 2
                kernels = kernels[:, cut:-cut, cut:-cut]
                kernels = kernels / kernels.sum((1, 2), keepdims=True)
            f = ref.film(data[b], *tables, t["r_grid"], ref.quarter_rotations(kernels), **kw)
        else:
            f = ref.remap(data[b], *tables, **kw)
        if units != "relative":
            f = f * t["solid_angle"] * t["transmission"]
        if units == "photons":
            f = f * pack["wavelength"][b] * 1e-9 / HC * (PITCH_UM * 1e-6) ** 2
        films.append(f)
    films = np.array(films)
    compared = []
    g = zarr.open_group(OUT / "cases" / name / "expected.zarr", mode="w", zarr_format=3)
    if rois:
        parts = [(f"roi_{i}", (0, 0, h, w, 1, 1), films[:, y:y + h, x:x + w]) for i, (y, x, h, w) in enumerate(rois)]
    else:
        parts = [("film", p, films[:, p[0]:p[0] + p[2]:p[4], p[1]:p[1] + p[3]:p[5]]) for p in windows or [(0, 0, *size, 1, 1)]]
    for i, (array, (y, x, h, w, sy, sx), values) in enumerate(parts):
        codec = BloscCodec(cname="zstd", clevel=9, shuffle="shuffle")
        g.create_array(f"part_{i}", data=values.astype(np.float32), chunks=(1, *values.shape[1:]), compressors=codec)
        compared.append({"array": array, "expected": f"part_{i}", "y": y, "x": x, "height": h, "width": w, "step_y": sy, "step_x": sx})
    peaks = [float(np.abs(f).max()) for f in films]
    case = {"chart": chart_file, "lens": pack["file"], "flags": words, "peak": peaks, "compared": compared}
    (OUT / "cases" / name / "case.json").write_text(json.dumps(case, indent=1) + "\n")
    print(name, films.shape, sum(p.stat().st_size for p in (OUT / "cases" / name).rglob("*") if p.is_file()), flush=True)


for folder in ("charts", "packs", "cases"):
    shutil.rmtree(OUT / folder, ignore_errors=True)

uneven = [0, 0.21, 0.33, 0.71, 1]
three = make_pack("three-bands", 1, 0.42, [9, 21, 5], [uneven, [0, 0.05, 0.1, 0.6, 0.95, 1], [0, 0.5, 1]], 400)
dense = make_pack("dense", 2, 1.9, [15], [[0, 0.08, 0.1, 0.3, 0.35, 0.62, 0.9, 1]], 1000, tilt=1.5)
wide = make_pack("wide", 3, 1.5, [51], [[0, 0.3, 0.37, 1]], 700, azimuths=8)
tiny = make_pack("tiny", 4, 0.25, [31, 1], [[0, 0.4, 1], [0, 1]], 300)

odd = make_chart("odd", 11, (3, 137, 129), chunks=(1, 50, 70))
small = make_chart("small", 12, (3, 61, 53))
signed = make_chart("signed", 13, (1, 160, 151), low=-0.5)
large = make_chart("large", 14, (1, 640, 1130), chunks=(1, 256, 512), block=(31, 29))
counts = make_chart("counts-v2", 15, (3, 70, 81), dtype="uint16", chunks=(2, 33, 40), zarr_format=2)
bare = make_chart("bare-f64", 16, (3, 64, 75), dtype="float64", chunks=(1, 64, 25), bare=True)
high = make_chart("high", 17, (1, 900, 60), chunks=(1, 300, 60), block=(37, 23))

# The whole chain; chart larger and smaller than the film; axis in the middle, on a pixel, between pixels, outside.
make_case("chain-three-bands", odd, three, (121, 117), declare=[])
make_case("chain-chart-smaller", small, three, (93, 110), axis=(37.0, 52.0), scale=(1.3, 1.1), center=(0.011, -0.017), surround="black", bands=[0, 2])
make_case("chain-scale-below-one", signed, dense, (75, 88), axis=(20.25, 61.5), scale=(0.55, 0.7), surround="mirror")
make_case("chain-scale-mixed", small, three, (80, 71), scale=(1.7, 0.85), surround="mirror", interp="bilinear", bands=[1])
make_case("chain-axis-outside", high, dense, (611, 47), axis=(-18.5, 101.0), surround="black", windows=[(0, 0, 611, 47, 3, 2), (490, 0, 40, 47, 1, 1)])
make_case("chain-smaller-than-a-tile", odd, tiny, (5, 3), axis=(1.0, 2.0), bands=[0, 1])
make_case("chain-one-pixel", signed, tiny, (1, 1), bands=[0])
make_case("chain-clamp", odd, tiny, (140, 120), axis=(15.0, 20.0), outside="clamp", bands=[0, 1])
for surround in ("edge", "black", "mirror"):
    for interp in ("bicubic", "bilinear"):
        make_case(f"surround-{surround}-{interp}", small, three, (43, 38), axis=(14.5, 22.0), scale=(1.01, 1.2), center=(-0.06, 0.05),
                  surround=surround, interp=interp, bands=[0])

# Several tiles: every pixel of strips across the seams, and a coprime grid of all the rest.
seams = [(0, 0, 600, 1100, 13, 11), (292, 0, 6, 1100, 1, 1), (440, 0, 8, 1100, 1, 3), (0, 455, 600, 8, 3, 1), (0, 1092, 600, 8, 3, 1)]
make_case("tiles-wide-window", large, wide, (600, 1100), axis=(510.3, 270.9), args=["--azimuths", "4"], windows=seams)
make_case("tiles-regions", large, dense, (600, 1100), axis=(660.0, 320.0), surround="mirror", scale=(1.05, 0.93),
          rois=[(0, 0, 1, 1), (480, 490, 70, 64), (571, 1001, 29, 99), (0, 300, 600, 5)])

# Charts as other programs write them.
make_case("chart-u16-v2", counts, three, (50, 41), declare=["--wavelengths", "450:550:50", "--film-pitch-um", "2"], bands=[0, 2])
make_case("chart-f64-bare", bare, three, (41, 50), declare=["--wavelengths", "450,500,550", "--film-pitch-um", "2"], bands=[1])

# Stages on their own, a cropped window, units.
for stages in ({"ri"}, {"distortion"}, {"ri", "distortion"}, {"svpsf"}, {"ri", "svpsf"}):
    make_case("stages-" + "-".join(sorted(stages)), odd, three, (61, 55), axis=(11.5, 30.0), stages=stages, bands=[0])
make_case("window-cropped", odd, three, (50, 61), crop=7)
make_case("units-irradiance", odd, three, (31, 33), units="irradiance")
make_case("units-photons", odd, three, (31, 33), units="photons", bands=[0, 2])
