"""Scenes of meshes and their films by the program, in a folder."""
import json
import shutil

import numpy as np
import zarr

import lens_pack
from closed_forms import disc_kernel


class View:
    """A lens, film and chart: geometry of `lens camera`, scenes, films."""

    def __init__(self, files, lens, focus_m, size, pitch_um, depths, *more):
        self.files, self.size, self.pitch_um = files, size, pitch_um
        self.flags = ["--lens", lens, "--focus-m", focus_m, "--film-size", f"{size[1]}x{size[0]}", "--film-pitch-um", pitch_um, *more]
        self.depths = ["--depths-m", depths]
        camera = json.loads(self.files.program.run("lens", "camera", lens, "--json", *self.flags[2:], *self.depths))
        self.shape, self.margin = (camera["height_px"], camera["width_px"]), camera["overscan_px"]
        self.focal_px, self.blur_px = camera["focal_length_mm"] / (pitch_um * 1e-3), camera["blur_per_dioptre_um"] / pitch_um

    def place(self, column, row, v):
        """Points of the camera frame at places of the chart and vergences."""
        column, row, v = np.broadcast_arrays(column, row, v)
        h, w = self.shape
        return np.stack([(column - (w - 1) / 2) / self.focal_px, (row - (h - 1) / 2) / self.focal_px, np.ones(v.shape)], -1) / v[..., None]

    def direction(self):
        r, c = np.mgrid[:self.shape[0], :self.shape[1]]
        return (c - (self.shape[1] - 1) / 2) / self.focal_px, (r - (self.shape[0] - 1) / 2) / self.focal_px

    def scene(self, name, mesh, *flags):
        out = self.files.folder / f"{name}.scene.zarr"
        self.files.program.run("scene", mesh, out, *self.flags, *self.depths, "--no-fsync", "--overwrite", *flags)
        return out

    def film(self, name, chart, *flags, pack=None):
        """Bands of the film of a chart or scene, and the bytes of its files; through a lens pack instead of the design."""
        out = self.files.folder / f"{name}.film.zarr"
        lens = self.flags if pack is None else ["--lens", pack, *self.flags[4:8], "--outside", "clamp"]
        self.files.program.run("run", chart, out, *lens, "--stages", "distortion,svpsf", "--device", "cpu", "--no-fsync", "--overwrite", *flags)
        files = {p.relative_to(out): p.read_bytes() for p in sorted(out.glob("film/c/**/*")) if p.is_file()}
        return zarr.open_group(out, mode="r")["film"][:].astype(float), files


class Sheets(list):
    """Sheets of a scene store, from the first: (weights, depth, coverage)."""

    def __init__(self, path):
        self.group = zarr.open_group(path, mode="r")
        levels = [self.group] + [self.group[f"hidden/{q}"] for q in range(1, 9) if f"hidden/{q}" in self.group]
        super().__init__(tuple(g[k][:] for k in ("weights", "depth", "coverage")) for g in levels)


class Files:
    """The folder in which the program's scenes, films and tables are."""

    def __init__(self, program, folder):
        self.program, self.folder = program, folder

    def exported(self, chart, *flags):
        out = self.folder / "exported.npy"
        self.program.run("export", chart, out, "--overwrite", *flags)
        return np.load(out).astype(float)

    def plain_group(self, name, wavelengths, pitch_um, sheets):
        """Group of chart (wavelength, y, x), depth, coverage; hidden/1/chart, …"""
        out = self.folder / f"{name}.zarr"
        root = zarr.open_group(out, mode="w", zarr_format=3, attributes={"pitch_um": pitch_um})
        root.create_array("wavelength", data=np.array(wavelengths, float), dimension_names=["wavelength"]).attrs["units"] = "nm"
        for q, (chart, depth, coverage) in enumerate(sheets):
            g = root if q == 0 else root.create_group(f"hidden/{q}")
            g.create_array("chart", data=np.asarray(chart, np.float32), dimension_names=["wavelength", "y", "x"])
            g.create_array("depth", data=np.asarray(depth), dimension_names=["y", "x"], attributes={"unit": "m", "kind": "planar"})
            g.create_array("coverage", data=np.asarray(coverage, np.float32), dimension_names=["y", "x"], attributes={"light": "straight"})
        return out

    def measured(self, **reflectances):
        """Flags for materials of the same reflectance at every wavelength."""
        flags = []
        for name, value in reflectances.items():
            path = self.folder / f"{name}.csv"
            path.write_text(f"wavelength_nm,reflectance\n380,{float(value)!r}\n780,{float(value)!r}\n")
            flags += ["--material", f"{name}={path}"]
        return flags

    def white(self, nm):
        """Radiance of a white surface in 1000 lx of D65, as drawn charts have it: the brightest of a depth scene is a disc of reflectance 0.9."""
        return self.exported(f"gen:depth-scene?size=100&wavelengths={nm}&near_m=1&far_m=2").max() / 0.9

    def thin_lens(self, view, nm, aperture_m, focus, nodes):
        """Pack of a thin lens of the view's focal length and pixels, in focus at `focus`, with `nodes` in 1/m: blur by discs, no distortion."""
        blur, h = view.focal_px * aperture_m / 2, np.array([0.0, 4.0])
        band = dict(h_real=h, h_ideal=h, ri=np.ones(2), delta_mm=np.zeros(2), ratio=np.ones((len(nodes), 2)), vergence=np.array(nodes),
                    kernels=[np.stack([disc_kernel(blur * abs(v - focus))] * 2).astype(np.float32) for v in nodes])
        lens_pack.write(self.folder / "thin.lens.zip", [band], h, focus, blur, view.pitch_um)
        out = self.folder / "thin.lens.zarr"
        shutil.rmtree(out, ignore_errors=True)
        shutil.unpack_archive(self.folder / "thin.lens.zip", self.folder)
        attributes = zarr.open_group(out, mode="r+").attrs
        attributes.update({k: view.focal_px * view.pitch_um * 1e-3 for k in ("distortion_focal_length_mm", "effective_focal_length_mm")})
        zarr.open_group(out, mode="r+")["wavelength"][:] = nm
        return out
