#!/usr/bin/env python3
"""Makes charts/, packs/ and cases/ of this folder: lenses without rotational symmetry and the films that the NumPy model computes of them, in float64.

    python3 -m venv v && v/bin/pip install numpy==2.4.6 zarr==3.1.5 numcodecs==0.16.6
    v/bin/python tests/golden/fields/make_fields_golden.py FIELDS_REFERENCE.py [FOLDER]      default: beside this file; half a minute

FIELDS_REFERENCE.py is the model of maps over the film and of PSF fields: its Map, PolarField, GridField and spread are used as they are. The chart is
read at the ideal points as in ../reference.py (scale, centre, surround, interpolation).
A case is case.json and expected.zarr as in ../make_golden.py. Packs have the schema "lenscube/lens-pack/4". Maps bend, turn and shear the picture and
have a relative illumination without symmetry; kernels are random, so that no symmetry hides a rotation, a mirror image or an exchanged axis.
J_k = 4: kernels are turned by quarter turns, which are exact; A_k is 1, odd, and even but no multiple of 4, so that PSFs between azimuths count.
"""
import importlib.util
import json
import shutil
import sys
import tempfile
import zipfile
from pathlib import Path

import numpy as np
import zarr
from zarr.codecs import BloscCodec, ZstdCodec

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
import reference as flat  # noqa: E402

PITCH_UM, PITCH = 2.0, 2e-3
CODEC = BloscCodec(cname="zstd", clevel=9, shuffle="shuffle")
BANDS_NM = (500.0, 550.0)


def load(path):
    spec = importlib.util.spec_from_file_location("fields_reference", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules["fields_reference"] = module
    spec.loader.exec_module(module)
    return module


def make_map(rng, x_mm, y_mm, nodes):
    """Ideal points and relative illumination over [x0, x1] x [y0, y1]: a turn by 1 degree, boresight, keystone, distortion; no symmetry."""
    x, y = np.linspace(*x_mm, nodes[0]), np.linspace(*y_mm, nodes[1])
    X, Y = np.meshgrid(x, y)
    r = max(np.abs([*x_mm, *y_mm]))
    a, s, t = rng.uniform(-1, 1, 4), X / r, Y / r
    ix = 1.003 * X - 0.018 * Y + 0.0023 + r * (0.012 * a[0] * s * s + 0.015 * s * t + 0.02 * s * (s * s + t * t) + 0.004 * a[1] * t ** 3)
    iy = 0.017 * X + 0.996 * Y - 0.0017 + r * (0.014 * t * t - 0.01 * a[2] * s * t + 0.02 * t * (s * s + t * t) + 0.005 * a[3] * s ** 3)
    return ref.Map(x, y, ix, iy, 1 - 0.15 * (s * s + t * t) + 0.06 * s - 0.03 * t)


def kernels(rng, count, n):
    """Random, mostly on one side of the chief ray."""
    k = rng.uniform(0, 1, (count, n, n)) ** 3 * np.exp(0.8 * np.linspace(-1, 1, n))[None, None, :]
    return (k / k.sum((1, 2), keepdims=True)).astype(np.float32)


def make_pack(name, seed, x_mm, y_mm, windows, map_nodes, heights=None, samples=None, places=None):
    """One row of `windows`, `map_nodes` and of `heights` (mm) with `samples` (A_k), or of `places` (x, y), per band."""
    rng = np.random.default_rng(seed)
    bands = []
    for b, n in enumerate(windows):
        band = {"map": make_map(rng, x_mm, y_mm, map_nodes[b]), "n": n}
        if places is None:
            band |= {"height": np.array(heights[b]), "samples": samples[b], "count": [1] + [4] * (len(heights[b]) - 1)}
            band["psf"] = kernels(rng, sum(samples[b]), n)
            rows = np.split(band["psf"].astype(float), np.cumsum(samples[b])[:-1])
            band["field"] = ref.PolarField(band["height"], band["count"], rows)
        else:
            x, y = (np.linspace(*axis) for axis in places[b])
            band |= {"x": x, "y": y, "psf": kernels(rng, len(x) * len(y), n)}
            band["field"] = ref.GridField(x, y, band["psf"].astype(float).reshape(len(y), len(x), n, n))
        bands.append(band)
    write_pack(OUT / "packs" / f"{name}.lens.zip", name, bands)
    return bands, f"../../packs/{name}.lens.zip"


def write_pack(out, name, bands):
    """Rows of bands with fewer nodes end with NaN, counts with 0."""
    def padded(tables, dtype=float):
        shape = np.max([np.shape(t) for t in tables], axis=0)
        full = np.full((len(tables), *shape), np.nan if dtype is float else 0, dtype)
        for row, t in zip(full, tables, strict=True):
            row[tuple(slice(s) for s in np.shape(t))] = t
        return full

    is_polar = "height" in bands[0]
    with tempfile.TemporaryDirectory() as tmp:
        g = zarr.open_group(tmp, mode="w", zarr_format=3, attributes={
            "schema": "lenscube/lens-pack/4", "psf_field": "polar" if is_polar else "grid", "reference_point": "as given", "name": name,
            "distortion_focal_length_mm": 50.0, "effective_focal_length_mm": 50.0, "f_number": 2.0, "primary_wavelength_nm": 500.0,
            "psf_sample": "integrated", "object_distance_mm": None, "magnification": 0.0})
        put = lambda key, data: g.create_array(key, data=np.asarray(data), compressors=CODEC, config={"write_empty_chunks": True})
        put("wavelength", np.array(BANDS_NM[:len(bands)]))
        put("map_x", padded([b["map"].x for b in bands]))
        put("map_y", padded([b["map"].y for b in bands]))
        for key in ("ideal_x", "ideal_y", "relative_illumination"):
            put(f"map_{key}", padded([getattr(b["map"], key) for b in bands]))
        if is_polar:
            put("psf_height", padded([b["height"] for b in bands]))
            put("azimuth_count", padded([b["count"] for b in bands], np.int32))
            put("psf_azimuths", padded([b["samples"] for b in bands], np.int32))
        else:
            put("psf_x", padded([b["x"] for b in bands]))
            put("psf_y", padded([b["y"] for b in bands]))
        put("psf_energy", padded([np.ones(len(b["psf"])) for b in bands]))
        put("psf_pitch", np.full(len(bands), PITCH_UM))
        put("solid_angle", np.full(len(bands), 0.2))
        put("transmission", np.ones(len(bands)))
        for i, b in enumerate(bands):
            put(f"psf/{i}", b["psf"])
        out.parent.mkdir(parents=True, exist_ok=True)
        with zipfile.ZipFile(out, "w") as z:
            for path in sorted(p for p in Path(tmp).rglob("*") if p.is_file()):
                info = zipfile.ZipInfo(f"{name}.lens.zarr/" + path.relative_to(tmp).as_posix(), (1980, 1, 1, 0, 0, 0))
                z.writestr(info, path.read_bytes(), zipfile.ZIP_DEFLATED)


def make_chart(name, seed, shape):
    data = np.random.default_rng(seed).uniform(0, 1, shape).astype(np.float32)
    g = zarr.open_group(OUT / "charts" / f"{name}.zarr", mode="w", zarr_format=3, attributes={"pitch_um": PITCH_UM})
    g.create_array("wavelength", data=np.array(BANDS_NM[:shape[0]]), dimension_names=["wavelength"]).attrs["units"] = "nm"
    g.create_array("chart", data=data, chunks=(1, *shape[1:]), dimension_names=["wavelength", "y", "x"], compressors=ZstdCodec(level=19))
    return data.astype(float), f"../../charts/{name}.zarr"


def film_of(chart, band, size, axis, scale, center, surround, interp):
    """remapped[y, x] = R(X, Y) chart(I(X, Y)) on the film grown by half the window, then the PSF field. Pairs are (y, x)."""
    grown = band["n"] // 2
    Y, X = np.meshgrid((np.arange(-grown, size[0] + grown) - axis[0]) * PITCH, (np.arange(-grown, size[1] + grown) - axis[1]) * PITCH, indexing="ij")
    ix, iy, light, det = band["map"].at(X, Y)
    assert det.min() > 0, "the map folds"
    row = (chart.shape[0] - 1) / 2 + (iy - center[0]) / (PITCH * scale[0])
    column = (chart.shape[1] - 1) / 2 + (ix - center[1]) / (PITCH * scale[1])
    if min(scale) < 1:
        read = flat.box_mean(chart, row, column, max(1 / scale[0], 1), max(1 / scale[1], 1), surround)
    else:
        read = flat.sample(chart, row, column, interp, surround)
    return ref.spread(light * read, band["field"], PITCH, size, grown, axis)


def make_case(name, chart, pack, size, axis=None, scale=(1, 1), center=(0.0, 0.0), surround="edge", interp="bicubic", rois=()):
    """`size` is (rows, columns); axis, scale and center are (x, y) as on the command line; a region is (y, x, h, w)."""
    (data, chart_file), (bands, pack_file) = chart, pack
    axis = ((size[1] - 1) / 2, (size[0] - 1) / 2) if axis is None else axis
    flags = ["--film-size", f"{size[1]}x{size[0]}", "--scale", f"{scale[0]!r},{scale[1]!r}", "--axis", f"{axis[0]!r},{axis[1]!r}",
             "--center", f"{center[0]!r},{center[1]!r}", "--surround", surround, "--interp", interp]
    for y, x, h, w in rois:
        flags += ["--roi", f"{x},{y},{w},{h}"]
    films = np.array([film_of(c, b, size, axis[::-1], scale[::-1], center[::-1], surround, interp) for c, b in zip(data, bands, strict=True)])
    parts = [(f"roi_{i}", (0, 0, h, w), films[:, y:y + h, x:x + w]) for i, (y, x, h, w) in enumerate(rois)] or [("film", (0, 0, *size), films)]
    g, compared = zarr.open_group(OUT / "cases" / name / "expected.zarr", mode="w", zarr_format=3), []
    for i, (array, (y, x, h, w), values) in enumerate(parts):
        g.create_array(f"part_{i}", data=values, chunks=(1, *values.shape[1:]), compressors=CODEC)
        compared.append({"array": array, "expected": f"part_{i}", "y": y, "x": x, "height": h, "width": w, "step_y": 1, "step_x": 1})
    case = {"chart": chart_file, "lens": pack_file, "flags": flags, "peak": [float(np.abs(f).max()) for f in films], "compared": compared}
    (OUT / "cases" / name / "case.json").write_text(json.dumps(case, indent=1) + "\n")
    print(f"{name}: {films.shape}, {films.min():.3f} to {films.max():.3f}, {sum(p.stat().st_size for p in (OUT / 'cases' / name).rglob('*') if p.is_file())} bytes",
          flush=True)


if __name__ == "__main__":
    if len(sys.argv) not in (2, 3):
        sys.exit(__doc__)
    ref = load(sys.argv[1])
    OUT = Path(sys.argv[2]).resolve() if len(sys.argv) == 3 else HERE
    for folder in ("charts", "packs", "cases"):
        shutil.rmtree(OUT / folder, ignore_errors=True)

    chart = make_chart("noise", 41, (2, 40, 48))
    # The range of the maps holds the film, wherever its axis, and half a window.
    x_mm, y_mm = (-0.085, 0.1), (-0.09, 0.08)
    polar = make_pack("polar", 42, x_mm, y_mm, [9, 5], [(9, 7), (6, 8)], [[0, 0.021, 0.05, 0.14], [0, 0.04, 0.14]], [[1, 6, 5, 10], [1, 1, 14]])
    grid = make_pack("grid", 43, x_mm, y_mm, [7, 9], [(5, 6), (9, 4)],
                     places=[((-0.05, 0.06, 4), (-0.04, 0.05, 3)), ((-0.03, 0.03, 2), (-0.045, 0.045, 4))])

    size = (36, 40)
    make_case("polar-centred", chart, polar, size)
    make_case("polar-off-axis", chart, polar, size, axis=(12.3, 24.6), center=(0.011, -0.007), scale=(1.12, 1.07), surround="black")
    make_case("polar-scale-below-one", chart, polar, size, axis=(23.0, 14.0), scale=(0.8, 0.7), surround="mirror")
    make_case("polar-regions", chart, polar, size, axis=(27.4, 11.9), scale=(1.3, 1.0), center=(-0.006, 0.004), interp="bilinear",
              rois=[(3, 5, 17, 22), (30, 0, 6, 40), (20, 39, 1, 1)])
    make_case("grid-centred", chart, grid, size)
    make_case("grid-off-axis", chart, grid, size, axis=(25.7, 12.2), center=(-0.012, 0.009), scale=(1.05, 1.2), surround="black", interp="bilinear")
    make_case("grid-regions", chart, grid, size, axis=(14.5, 22.1), scale=(0.9, 1.1), surround="edge", rois=[(0, 0, 36, 13), (11, 20, 20, 20)])
