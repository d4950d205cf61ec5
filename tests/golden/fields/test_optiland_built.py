#!/usr/bin/env python3
"""Tests of optiland_built.py: rays of built lenses by Optiland against the NumPy model of lenses without symmetry, and signs against first order.

    test_optiland_built.py LENSCUBE FIELDS_REFERENCE.py

Two tracers that share nothing but the prescriptions: surfaces, poses, aiming, draws of errors of all kinds, nested ones among them.
Bounds: rays 1e-9 mm; first order 1e-3 of the shift and its sign.
"""
import importlib.util
import sys
import tempfile
from pathlib import Path

import numpy as np

import tolerances
from first_order import element_shift
from optiland_built import Built, Design, Spot, quadrature

RAYS_MM = 1e-9
DATA = Path(__file__).resolve().parents[3] / "formats/data/lenses"
LENSES = {"double-gauss-28": ("double-gauss-28", 0.16), "phone": (DATA / "phone.csv", 0.45), "triplet": (DATA / "triplet.csv", 0.3)}
# All kinds of errors; a group that holds elements, pivots of its own, a gap that is absorbed.
TOLERANCES = {
    "double-gauss-28": """
[[element]]
surfaces = [7, 11]
tilt_arcmin = 2
decentre_um = 30
pivot = 9
pivot_offset_mm = -3.5
[[element]]
surfaces = [7, 9]
decentre_um = 20
tilt_arcmin = 1
wedge_arcmin = 1
shift_um = 20
[[element]]
surfaces = [10, 11]
decentre_um = 20
radial = true
tilt_arcmin = 1
tilt_radial = true
[[element]]
surfaces = [1, 2]
decentre_um = 20
tilt_arcmin = 1
[[surface]]
surface = 3
radius_percent = 0.1
tilt_arcmin = 1
[[surface]]
surface = 9
radius_fringes = 5
irregularity_fringes = 2
[[surface]]
surface = 8
radius_fringes = 3
decentre_um = 10
conic = 0.02
[[surface]]
surface = 5
irregularity_fringes = 2
figure = "mixed"
[[surface]]
surface = 10
figure = "zernike"
zernike = {terms = [4, 11], rms_waves = 0.5}
[[gap]]
after = 2
thickness_um = 20
[[gap]]
after = 4
thickness_um = 20
absorb = 6
[[glass]]
after = 3
index = 5e-4
abbe_percent = 0.8
[[film]]
tilt_arcmin = 5
decentre_um = 50
shift_um = 10
""",
    "phone": """
[[element]]
surfaces = [1, 3]
decentre_um = 4
tilt_arcmin = 1.5
wedge_arcmin = 1
[[element]]
surfaces = [4, 5]
decentre_um = 4
tilt_arcmin = 1.5
[[surface]]
surface = 6
decentre_um = 3
tilt_arcmin = 2
irregularity_fringes = 1
[[gap]]
after = 3
thickness_um = 4
[[film]]
tilt_arcmin = 5
""",
    "triplet": """
[tolerances]
law = "uniform"
[[element]]
surfaces = [1, 2]
decentre_um = 30
tilt_arcmin = 3
[[element]]
surfaces = [3, 4]
decentre_um = 30
tilt_arcmin = 3
wedge_arcmin = 2
[[element]]
surfaces = [5, 6]
decentre_um = 30
tilt_arcmin = 3
[[surface]]
surface = 1
radius_um = 40
""",
}
COMPENSATORS = {"film_shift_mm": 0.013, "film_tilt_rad": [1e-4, -2e-4], "boresight_mm": [0.004, -0.007]}


def load(path):
    spec = importlib.util.spec_from_file_location("fields_reference", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules["fields_reference"] = module
    spec.loader.exec_module(module)
    return module


def draw(ref, path, seed, sample):
    """Record of a lens: the draws of the contract."""
    found, _ = tolerances.targets(path)
    unit = {"radius": {"radius_percent": "percent", "radius_fringes": "fringes", "radius_um": "um"}}
    text = tolerances.tomllib.loads(path.read_text())
    units = {s["surface"]: u for s in text.get("surface", []) for key, u in unit["radius"].items() if key in s}
    rows = []
    for (i, name), identifier in tolerances.identifiers(found).items():
        low, high, law = found[i].limits[name]
        rows.append({"id": identifier, "value": ref.drawn(seed, sample, identifier, low, high, law),
                     "unit": units[found[i].surfaces[0]] if name == "radius" else ""})
    return rows


def reference_lens(ref, lens, errors):
    """The same lens in the NumPy model; its surfaces count from 0."""
    d = lens.design
    gaps = [*(b - a for a, b in zip(d.z, d.z[1:], strict=False)), 0.0]
    surfaces = [ref.Surface(c=1 / d.radius[k - 1] + errors.curvature.get(k, 0.0), k=d.conic[k - 1] + errors.conic.get(k, 0.0), thickness=gaps[k - 1],
                            index=lens.index[k - 1], asphere=tuple(d.asphere[k - 1]),
                            xy=tuple((i, j, c) for (i, j), c in errors.figure.get(k, {}).items())) for k in range(1, len(d.rows) + 1)]
    motions = [(a - 1, b - 1, pivot - 1, z, ref.pose(*decentre, *tilt)) for a, b, pivot, z, decentre, tilt in errors.motions]
    return ref.Lens(surfaces, d.stop - 1, (d.pupil_z, d.pupil_radius), stop_radius=d.stop_radius, focal=d.focal_mm, errors=motions)


def check_rays(ref, lenscube):
    """Chief rays, rays over the pupil, stops: both aimings where the design's stop allows it."""
    failed = 0
    print(f"{'lens':16} {'sample':>6} {'um':>7} {'aiming':9} {'chief, mm':>10} {'rays, mm':>10} {'centroid':>10} {'moved, um':>10}")
    for name, (file, edge) in LENSES.items():
        design = Design.of_program(lenscube, file)
        for sample in range(3):
            with tempfile.TemporaryDirectory() as tmp:
                path = Path(tmp) / "tol.toml"
                path.write_text(TOLERANCES[name])
                errors = tolerances.errors(path, draw(ref, path, 1, sample), design.radius, design.semi_diameters_mm, COMPENSATORS)
            for um, real in ((design.primary_um, True), (design.wavelengths_um[0], False)):
                design.is_real_aiming = real
                lens, nominal = Built(design, um, errors), Built(design, um)
                model = reference_lens(ref, lens, errors)
                p, q, w = quadrature(4, 8)
                worst, moved = np.zeros(3), 0.0
                for t in ((0.0, 0.0), (edge, 0.0), (0.0, -edge), (-0.7 * edge, 0.6 * edge)):
                    x, y = ref.chief(model, t, um, real)
                    at = lens.chief(t)
                    moved = max(moved, 1e3 * np.abs(at - nominal.chief(t)).max())
                    px, py = ref.aim(model, t, p, q, um, real)
                    hit = ref.trace(model, *ref.launch(model, t, px, py)[:2], um)[0]
                    rays = lens.rays(t, p, q)[0]
                    bundle = ref.bundle(model, t, um, 12, 36, real)
                    light = bundle["w"] * bundle["flux"]
                    centroid = (bundle["hit"][:2] * light).sum(1) / light.sum() * [1, -1]
                    worst = np.maximum(worst, [np.abs(at - (x, -y)).max(), np.abs(rays - hit[:2] * [[1], [-1]]).max(),
                                               np.abs(Spot([(lens, 1.0)], t).centroid - centroid).max()])
                bad = worst[0] > RAYS_MM or worst[1] > RAYS_MM or worst[2] > 1e-7 or moved < 1.0
                failed += bad
                print(f"{name:16} {sample:6} {um:7.4f} {'real' if real else 'paraxial':9} {worst[0]:10.1e} {worst[1]:10.1e} {worst[2]:10.1e} {moved:10.1f}"
                      + ("  FAIL" if bad else ""))
    return failed


def check_signs(ref, lenscube):
    """The last element of the lens decentred along +x, +y, tilted about +x, +y: shift of the spot on the film, Y DOWN."""
    failed = 0
    print(f"\n{'lens':16} {'error':16} {'X, um':>9} {'Y, um':>9} {'first order':>18} {'model':>8}")
    d, a = 2e-3, 10 * tolerances.ARCMIN / 60
    for name, (file, _) in LENSES.items():
        design = Design.of_program(lenscube, file)
        last = len(design.rows) - 1
        first = {"double-gauss-28": 10, "phone": 6, "triplet": 5}[name]
        nominal = Built(design, design.primary_um)
        design.is_real_aiming = False
        for what, decentre, tilt in (("decentre +x", (d, 0, 0), (0, 0, 0)), ("decentre +y", (0, d, 0), (0, 0, 0)), ("tilt +x", (0, 0, 0), (a, 0, 0)),
                                     ("tilt +y", (0, 0, 0), (0, a, 0))):
            errors = tolerances.Errors(motions=[(first, last, first, 0.0, decentre, tilt)])
            lens = Built(design, design.primary_um, errors)
            X, Y = lens.chief((0, 0))
            size = element_shift(nominal, first, last, d if any(decentre) else 0.0, a if any(tilt) else 0.0)
            # Film Y = -y: +y of a decentre is up, and a tilt about +x is that about +y with the opposite sign.
            expected = np.array({"decentre +x": (size, 0), "decentre +y": (0, -size), "tilt +x": (0, size), "tilt +y": (size, 0)}[what])
            spot = Spot([(lens, 1.0)], (0.0, 0.0)).centroid
            x, y = ref.chief(reference_lens(ref, lens, errors), (0, 0), design.primary_um, False)
            model = np.abs(np.array([x, -y]) - (X, Y)).max()
            bad = np.abs(np.array([X, Y]) - expected).max() > 1e-3 * abs(size) or (spot @ expected) <= 0 or model > RAYS_MM
            failed += bad
            print(f"{name:16} {what:16} {1e3 * X:9.4f} {1e3 * Y:9.4f} {1e3 * expected[0]:9.4f}{1e3 * expected[1]:9.4f} {model:8.1e}" + ("  FAIL" if bad else ""))
    return failed


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    model = load(sys.argv[2])
    count = check_rays(model, sys.argv[1]) + check_signs(model, sys.argv[1])
    print(f"\n{count} bounds violated")
    sys.exit(int(count > 0))
