#!/usr/bin/env python3
"""Scenes of meshes and their films, through the program, against two renderers: `check_renderers.py LENSCUBE [FOLDER [CHECK…]]`, two minutes; FOLDER keeps what the
program writes and PNGs of both films.

NumPy, zarr, embreex (Embree 4), mitsuba (Mitsuba 3). Camera frame: x right, y down, z along
the axis, m. With one sample a pixel a scene has, in each pixel, the surfaces that the ray of its centre meets. A thin lens of aperture A m in focus at V_f, whose
film has pixels of angle 1/f, blurs a point of vergence V into a disc of radius (f A/2) |V - V_f| pixels. Surfaces emit: renderer and scene have no other light.
"""
import sys
import tempfile
from pathlib import Path

import mitsuba as mi
import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from meshes import glb, icosphere, png, quad, wall
from program import Program
from rows import Table
from views import Files, Sheets, View

scratch = tempfile.TemporaryDirectory()
folder = Path(sys.argv[2] if len(sys.argv) > 2 else scratch.name)
folder.mkdir(parents=True, exist_ok=True)
files = Files(Program(sys.argv[1]), folder)
table = Table("scenes of meshes and their films against renderers")
mi.set_variant("scalar_rgb")
mi.set_log_level(mi.LogLevel.Error)


def single(parts):
    """Parts with corners that are numbers of f32, as in a glTF file."""
    return [(m, np.asarray(v, np.float32).astype(float), f) for m, v, f in parts]


def leaves(rng, count):
    """Triangles at random places from 0.9 to 2.5 m, in all directions."""
    for _ in range(count):
        c = rng.uniform((-0.3, -0.25, 0.9), (0.3, 0.25, 2.5))
        yield "leaf", c + rng.uniform(-0.06, 0.06, (3, 3)), [(0, 1, 2)]


def embree_hits(parts, direction, count, gap):
    """Distances along the axis of the first `count` surfaces on rays from 0, each more than `gap` 1/m behind the one before: (count, rays), inf where there is
    none. The triangles are Embree's; the distance is that of the triangle's plane in f64."""
    scene, corners = EmbreeScene(), np.concatenate([v[np.asarray(f)] for _, v, f in parts])
    TriangleMesh(scene, corners.astype(np.float32))
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    height = (normal * corners[:, 0]).sum(-1)
    start, hits = np.zeros(len(direction)), np.full((count, len(direction)), np.inf)
    alive = np.arange(len(direction))
    for q in range(count):
        found = scene.run((start[alive, None] * direction[alive]).astype(np.float32), direction[alive].astype(np.float32), output=True)
        met = found["geomID"] >= 0
        alive, triangle = alive[met], found["primID"][met]
        hits[q, alive] = height[triangle] / (normal[triangle] * direction[alive]).sum(-1)
        start[alive] = 1 / (1 / hits[q, alive] - gap)
    return hits


def surfaces():
    """The three nearest surfaces of every ray."""
    view = View(files, "phone", 1, (480, 640), 2, "0.5:4")
    rng = np.random.default_rng(11)
    parts = single([wall("wall", 3.0, 3.0), icosphere("ball", (0.05, 0.03, 1.1), 0.06, 5), *leaves(rng, 1500)])
    gap_px = 0.01
    scene = Sheets(view.scene("leaves", glb(folder / "leaves.glb", parts), "--samples-per-px", 1, "--solids", "none", "--gap-px", gap_px, "--reach-px", "all"))
    found = np.stack([np.where(c > 0, z.astype(float), np.inf) for _, z, c in scene])
    x, y = view.direction()
    expected = embree_hits(parts, np.stack([x, y, np.ones(x.shape)], -1).reshape(-1, 3), 3, gap_px / view.blur_px).reshape(3, *x.shape)
    both = np.isfinite(found) & np.isfinite(expected)
    with np.errstate(invalid="ignore"):
        error = np.where(both, abs(found / expected - 1), 0)
    other = (np.isfinite(found) != np.isfinite(expected)) | (error > 1e-5)
    table.below(f"Embree: rays of {x.size} whose three nearest surfaces differ (edges in f32)", other.any(0).sum(), 3)
    table.below(f"  distances of {both.sum()} hits, relative", error[~other].max(), 6e-8)
    table.below("  100,000 over the number of second and third surfaces", 1e5 / both[1:].sum(), 1)


def ply(path, corners, triangles):
    text = "".join(f"{x!r} {y!r} {z!r}\n" for x, y, z in corners.tolist()) + "".join("3 {} {} {}\n".format(*t) for t in triangles)
    path.write_text(f"ply\nformat ascii 1.0\nelement vertex {len(corners)}\nproperty float x\nproperty float y\nproperty float z\n"
                    f"element face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header\n{text}")
    return path


def shapes(parts, radiance):
    """Mitsuba's shapes; each triangle emits to the side of the camera."""
    out = {}
    for i, (name, v, f) in enumerate(parts):
        a, b, c = (v[list(corner)] for corner in zip(*f))
        away = (np.cross(b - a, c - a) * a).sum(-1) > 0
        towards = [tuple(t)[::-1] if far else tuple(t) for t, far in zip(f, away)]
        out[f"shape{i}"] = {"type": "ply", "filename": str(ply(folder / f"part{i}.ply", v, towards)), "face_normals": True,
                            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": radiance[name]}}}
    return out


FORWARD = dict(origin=[0, 0, 0], target=[0, 0, 1], up=[0, -1, 0])


def distances():
    """The camera that `lens camera --for mitsuba` prints: distances of rays through pixel centres."""
    view = View(files, "phone", 1, (240, 320), 2, "0.5:4")
    parts = single([wall("wall", 3.0, 3.0), icosphere("ball", (0.05, 0.03, 1.1), 0.06, 5), *leaves(np.random.default_rng(12), 200)])
    _, z, c = Sheets(view.scene("distances", glb(folder / "distances.glb", parts), "--samples-per-px", 1, "--solids", "none"))[0]
    text = files.program.run("lens", "camera", "phone", "--for", "mitsuba", *view.flags[2:], *view.depths)
    look = '<transform name="to_world"><lookat origin="0,0,0" target="0,0,1" up="0,-1,0"/></transform></sensor>'
    sensor = mi.load_string(f'<scene version="3.0.0">{text.replace("</sensor>", look)}</scene>').sensors()[0]
    h, w = view.shape
    size = sensor.film().size()
    table.near("Mitsuba: width of the printed camera", w, int(size[0]), 0)
    table.near("  height", h, int(size[1]), 0)
    world = mi.load_dict({"type": "scene", **shapes(parts, dict.fromkeys(("wall", "ball", "leaf"), [1, 1, 1]))})

    def along_axis(row, column):
        ray, _ = sensor.sample_ray(0, 0.5, mi.Point2f((column + 0.5) / w, (row + 0.5) / h), mi.Point2f(0.5, 0.5))
        return world.ray_intersect(ray).t * ray.d.z + 1e-4                     # rays begin at the near clipping plane of 0.1 mm
    expected = np.array([[along_axis(r, c) for c in range(w)] for r in range(h)])
    other = abs(z / expected - 1) > 1e-5
    table.below(f"  pixels of {h * w} of another surface", other.sum(), 10)
    table.below("  distances, relative", abs(z / expected - 1)[~other].max(), 2e-6)


def thin_lens_film():
    """Wall with a chequered board, ball and post out of focus, panel in focus; 105 mm f/6.5 in focus at 2 m, pixels of 16 um."""
    nm, focus, aperture = 550, 0.5, 16e-3
    view = View(files, "double-gauss-28", 1 / focus, (240, 300), 16, "1.25:4", "--image-plane", "paraxial")
    blur = view.focal_px * aperture / 2
    radiance = dict(white=[0.9] * 3, dark=[0.1] * 3, ball=[0.6] * 3, panel=[0.75] * 3, stripe=[0.05] * 3, post=[0.3] * 3)
    square, parts = 0.02, []
    for i in range(-8, 8):
        for j in range(-8, 8):
            x, y = square * i, square * j
            parts.append(quad("white" if (i + j) % 2 else "dark", (x, y, 4), (x + square, y, 4), (x + square, y + square, 4), (x, y + square, 4)))
    parts.append(icosphere("ball", (-0.0125, -0.004, 1.45), 0.006, 5))
    for i in range(6):
        x = 0.003 + 0.003 * i
        parts.append(quad("stripe" if i % 2 else "panel", (x, -0.011, 2), (x + 0.003, -0.011, 2), (x + 0.003, 0.012, 2), (x, 0.012, 2)))
    parts.append(quad("post", (0.0085, -0.3, 1.6), (0.0105, -0.3, 1.6), (0.0105, 0.3, 1.6), (0.0085, 0.3, 1.6)))
    parts = single(parts)
    flags = files.measured(**{m: r[0] for m, r in radiance.items()})
    scene = view.scene("objects", glb(folder / "objects.glb", parts), "--near-m", 1.2, *flags)
    steps = np.concatenate([np.arange(0, 6, 0.5), np.arange(6, 25)])
    nodes = sorted({focus + s * d / blur for d in steps for s in (-1, 1) if 0.24 < focus + s * d / blur < 0.75})
    pack = files.thin_lens(view, nm, aperture, focus, nodes)
    found = view.film("objects", scene, "--wavelengths", nm, pack=pack)[0][0] / files.white(nm)
    h, w = view.size
    camera = {"type": "thinlens", "aperture_radius": aperture / 2, "focus_distance": 1 / focus, "fov_axis": "x",
              "fov": 2 * np.degrees(np.arctan(w / 2 / view.focal_px)), "near_clip": 0.1, "far_clip": 10.0, "to_world": mi.ScalarTransform4f().look_at(**FORWARD),
              "film": {"type": "hdrfilm", "width": w, "height": h, "pixel_format": "luminance", "component_format": "float32", "rfilter": {"type": "box"}},
              "sampler": {"type": "multijitter", "sample_count": 1024}}
    world = mi.load_dict({"type": "scene", "integrator": {"type": "path", "max_depth": 1}, "camera": camera, **shapes(parts, radiance)})
    total, rounds = 0, 2
    for seed in range(rounds):
        total = total + np.array(mi.render(world, seed=seed))[..., 0].astype(float)
    expected, peak = total / rounds, 0.9
    for name, film in (("program", found), ("mitsuba", expected), ("difference", 0.5 + 5 * (found - expected))):
        grey = np.clip(255 * film, 0, 255)[..., None]
        (folder / f"{name}.png").write_bytes(png(np.concatenate([np.repeat(grey, 3, -1), np.full_like(grey, 255)], -1)))
    psnr = lambda region: 10 * np.log10(peak ** 2 / np.mean((found - expected)[region] ** 2))
    table.below("thin lens, four objects, whole film: 38 dB over PSNR", 38 / psnr(np.s_[:]), 1, psnr(np.s_[:]))
    table.below("  largest difference, % of the peak", 100 * abs(found - expected).max() / peak, 5)


for check in (surfaces, distances, thin_lens_film):
    if not sys.argv[3:] or check.__name__ in sys.argv[3:]:
        check()
table.end()
