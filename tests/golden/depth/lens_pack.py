"""Lens packs with depth nodes, schema "lenscube/lens-pack/2": written from kernels, and put together from packs of the program."""
import shutil
import tempfile
import zipfile
from pathlib import Path

import numpy as np
import zarr
from zarr.codecs import BloscCodec

CODEC = BloscCodec(cname="zstd", clevel=9, shuffle="shuffle")
# Arrays that do not depend on the depth node, and those with an axis of nodes.
OF_BAND = ("wavelength", "ideal_height", "image_height", "relative_illumination", "solid_angle", "transmission", "pupil_shift")
OF_NODE = ("vergence", "psf_height", "azimuth_count", "psf_energy", "psf_pitch", "etendue_ratio")


def putter(group):
    """Writes an array with all its chunks, which a pack must have."""
    return lambda key, data: group.create_array(key, data=np.asarray(data), compressors=CODEC, config={"write_empty_chunks": True})


def write(out, lenses, heights, focus, blur_px, pitch_um):
    """Pack `out` (.lens.zip) of bands `lenses`: dictionaries of h_real, h_ideal [mm], ri, delta_mm (M), ratio (D, M), vergence (D) and kernels: D
    arrays (K, n, n).

    `heights` (K) of the kernels [mm], `focus` [1/m], `blur_px` per dioptre; kernels are sampled and integrated at `pitch_um`.
    """
    name = out.name.removesuffix(".lens.zip")
    most, bands = max(len(b["vergence"]) for b in lenses), len(lenses)
    padded = lambda rows: np.stack([np.concatenate([r, np.full((most - len(r), *np.shape(r)[1:]), np.nan)]) for r in rows])
    nodes = lambda value: padded([np.broadcast_to(value, (len(b["vergence"]), *np.shape(value))) for b in lenses])
    with tempfile.TemporaryDirectory() as tmp:
        g = zarr.open_group(tmp, mode="w", zarr_format=3, attributes={
            "schema": "lenscube/lens-pack/2", "name": name, "distortion_focal_length_mm": 50.0, "effective_focal_length_mm": 50.0,
            "f_number": 2.0, "primary_wavelength_nm": 500.0, "psf_sample": "integrated", "object_distance_mm": 1000 / focus,
            "magnification": 0.0, "focus_distance_m": 1 / focus,
            "entrance_pupil_mm": 0.0, "entrance_pupil_diameter_mm": 25.0, "blur_per_dioptre_um": blur_px * pitch_um,
            "depth_tolerance": 0.02, "gaps_mm": {},
        })
        put = putter(g)
        put("wavelength", 500.0 + 50 * np.arange(bands))
        for key, array in (("h_ideal", "ideal_height"), ("h_real", "image_height"), ("ri", "relative_illumination"), ("delta_mm", "pupil_shift")):
            put(array, np.stack([b[key] for b in lenses]))
        put("vergence", padded([b["vergence"] for b in lenses]))
        put("vergence_count", np.array([len(b["vergence"]) for b in lenses], np.int32))
        put("psf_height", nodes(heights))
        put("azimuth_count", np.nan_to_num(nodes(np.where(heights > 0, 4, 1).astype(float))).astype(np.int32))
        put("psf_energy", nodes(np.ones(len(heights))))
        put("psf_pitch", nodes(np.array(pitch_um)))
        put("etendue_ratio", padded([b["ratio"] for b in lenses]))
        put("solid_angle", np.full(bands, 0.2))
        put("transmission", np.ones(bands))
        for i, b in enumerate(lenses):
            for d, kernels in enumerate(b["kernels"]):
                put(f"psf/{i}/{d}", kernels)
        out.parent.mkdir(parents=True, exist_ok=True)
        with zipfile.ZipFile(out, "w") as z:
            for path in sorted(p for p in Path(tmp).rglob("*") if p.is_file()):
                info = zipfile.ZipInfo(f"{name}.lens.zarr/" + path.relative_to(tmp).as_posix(), (1980, 1, 1, 0, 0, 0))
                z.writestr(info, path.read_bytes(), zipfile.ZIP_DEFLATED)


def join(out, parts):
    """Pack `out` of one band with the nodes of all `parts`: packs of that band in order of vergence. Returns the vergences."""
    stores, parts = parts, [zarr.open_group(p, mode="r") for p in parts]
    g = zarr.open_group(out, mode="w", zarr_format=3, attributes=dict(parts[0].attrs))
    put = putter(g)
    for key in OF_BAND:
        assert all(abs(p[key][:] - parts[0][key][:]).max() < 1e-12 for p in parts), f"{key} of the parts"
        put(key, parts[0][key][:])
    for key in OF_NODE:
        put(key, np.concatenate([p[key][0] for p in parts])[None])
    stacks = [store / "psf" / "0" / str(d) for store, p in zip(stores, parts) for d in range(int(p["vergence_count"][0]))]
    put("vergence_count", np.array([len(stacks)], np.int32))
    g.create_group("psf/0")
    for d, stack in enumerate(stacks):
        shutil.copytree(stack, out / "psf" / "0" / str(d))
    return g["vergence"][0]
