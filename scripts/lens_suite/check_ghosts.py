#!/usr/bin/env python3
"""pipeline/tests/data/ghosts.txt, to which the program's ghosts are compared, against Optiland: numpy, optiland.

Each ray is traced along its path by Optiland's own surfaces, materials and coatings: the crossings of the path as a sequence, mirrors at both reflections, reflection
and transmission at each crossing of bare surfaces and of a quarter wave, polarisation by Optiland's matrices. Added to those of Optiland 0.6.3:
transmission is of the field, |E|^2: the light of a ray has the factor n cos(angle) behind a surface over that before it;
bare surfaces turn p of reflected light: without a change of sign s and p come back with other signs at normal incidence, where no direction is distinguished;
a film transmits p of the field along the surface: the field across the ray has the factor cos(angle) before the surface over that behind it.
Printed per lens: rays, largest difference of the landing, mm, and of the light, relative, bare and with the quarter wave. The light of paths with a reflection at the
film is not compared: a film of constant reflectance is no coating of Optiland.

    check_ghosts.py        fails beyond 1e-8 mm or 1e-7 of the light
"""
import sys
import warnings

import numpy as np
from optiland.coatings import FresnelCoating, ThinFilmCoating
from optiland.coordinate_system import CoordinateSystem
from optiland.geometries import EvenAsphere, Plane, StandardGeometry
from optiland.interactions.refractive_reflective_model import RefractiveReflectiveModel
from optiland.materials import IdealMaterial
from optiland.rays import PolarizationState, PolarizedRays
from optiland.surfaces.standard_surface import Surface

from transmission import DATA, UM, lenses

NEWTON_MM = 1e-14
LANDING_MM, LIGHT = 1e-8, 1e-7
QUARTER_WAVE = (1.38, 0.55 / 4 / 1.38)  # index, um


def geometry(surface, z):
    """Of a row of lens_suite.txt: curvature, thickness, A, B, conic, r^4, r^6 ..."""
    place, c, conic, terms = CoordinateSystem(z=z), surface[0], surface[4], surface[5:]
    if any(terms):
        return EvenAsphere(place, 1 / c if c else np.inf, conic, NEWTON_MM, 200, [0.0, *terms])
    return StandardGeometry(place, 1 / c, conic) if c else Plane(place)


def coating_of(n1, n2, film):
    """Between the indices n1 and n2: bare, or with a film of (index, um) on boundaries with air. With the signs and factors of p that the head states."""
    between = IdealMaterial(n1), IdealMaterial(n2)
    is_bare = not film or 1.0 not in (n1, n2)
    coating = FresnelCoating(*between) if is_bare else ThinFilmCoating(*between, [(IdealMaterial(film[0]), 1e3 * film[1], None)])
    calculate = coating.jones.calculate_matrix

    def calculate_matrix(rays, reflect=False, aoi=None):
        jones = calculate(rays, reflect, aoi)
        if is_bare and reflect:
            jones[:, 1, 1] *= -1
        elif not is_bare and not reflect:
            jones[:, 1, 1] *= np.cos(aoi) / np.sqrt(1 - (n1 / n2 * np.sin(aoi)) ** 2)
        return jones

    coating.jones.calculate_matrix = calculate_matrix
    return coating


def sequence(lens, index, path, film_on_glass):
    """Surfaces of Optiland along a path."""
    first, second = path
    film = len(lens["surfaces"])
    z = np.concatenate([[0], np.cumsum([s[1] for s in lens["surfaces"]])])
    order = [*range(first + 1), *range(first - 1, second - 1, -1), *range(second + 1, film + 1)]
    mirrors = {first, first + (first - second)}
    surfaces, before = [], Surface(None, IdealMaterial(1.0), Plane(CoordinateSystem(z=-np.inf)))
    forward = True
    for place, k in enumerate(order):
        is_last, is_mirror = place == len(order) - 1, place in mirrors
        n1, n2 = (index[k], index[k + 1]) if forward else (index[k + 1], index[k])
        behind = n1 if is_mirror or is_last else n2
        shape = Plane(CoordinateSystem(z=z[k])) if k == film else geometry(lens["surfaces"][k], z[k])
        surface = Surface(before, IdealMaterial(behind), shape)
        has_coating = k != film and n1 != n2
        coating = coating_of(n1, n2, film_on_glass) if has_coating else None
        surface.interaction_model = RefractiveReflectiveModel(surface, is_reflective=is_mirror, coating=coating)
        surfaces.append(surface)
        before = surface
        forward ^= is_mirror
    return surfaces


def trace(lens, surfaces, tan, start):
    """Landing and light of a ray from the field point at the tangent `tan` through `start` in the plane of the first vertex."""
    point = np.array([*start, 0.0])
    d = np.array([tan, 0, 1.0])
    if np.isfinite(lens["object"]):
        d = point - np.array([-tan * (lens["object"] + lens["pupil"]), 0, -lens["object"]])
    d = d / np.linalg.norm(d)
    begin = point - d  # before the first surface
    rays = PolarizedRays(*([v] for v in (*begin, *d)), [1.0], [UM])
    factor = 1.0
    for surface in surfaces:
        surface.trace(rays)
        normal = np.ravel(surface.geometry.surface_normal(rays))
        n1, n2 = (float(np.ravel(m.n(UM))[0]) for m in (surface.interaction_model.material_pre, surface.interaction_model.material_post))
        before, behind = (np.ravel(d) @ normal for d in ((rays.L0, rays.M0, rays.N0), (rays.L, rays.M, rays.N)))
        factor *= abs(n2 * behind / (n1 * before))
    rays.update_intensity(PolarizationState(is_polarized=False))
    return float(rays.x[0]), float(rays.y[0]), float(rays.i[0]) * factor


def main():
    warnings.simplefilter("ignore")
    rows = {}
    for line in (DATA / "ghosts.txt").read_text().splitlines():
        kind, name, *numbers = line.split()
        if kind == "ghost":
            rows.setdefault(name, []).append([float(v) for v in numbers])
    failed = False
    for lens in lenses():
        found = rows.pop(lens["name"].replace(" ", "_"), [])
        if not found:
            continue
        index = [1.0] + [np.sqrt(s[2] + s[3] / UM**2) for s in lens["surfaces"]] + [1.0]
        landing = light = 0.0
        for first, second, tan, x, y, at_x, at_y, *lights in found:
            path = (int(first), int(second))
            for film, expected in zip((None, QUARTER_WAVE), lights, strict=True):
                found_x, found_y, found_light = trace(lens, sequence(lens, index, path, film), tan, (x, y))
                landing = max(landing, np.hypot(found_x - at_x, found_y - at_y))
                if path[0] != len(lens["surfaces"]):
                    light = max(light, abs(found_light / expected - 1))
        is_good = landing <= LANDING_MM and light <= LIGHT
        failed |= not is_good
        print(f"{lens['name']:24} {len(found):4} rays  landing {landing:.1e} mm  light {light:.1e}  {'' if is_good else 'FAILED'}")
    if rows:
        sys.exit(f"no lens of the rows {sorted(rows)}")
    sys.exit(failed)


main()
