"""Drawn errors of a built lens as motions of its surfaces and changes of their shapes, from the description (TOML) and the record of a pack.

A record is a list of {id, value, unit} ("element 7-9/decentre_x", "um"). It has no pivots, no absorbing gaps, no figure and no test wavelength: these
are of the description. Surfaces count from 1 here, the film is the last.
Order: elements, the one of most surfaces first, then surfaces, gaps, glasses, the film: from the outermost motion inwards. A wedge is a tilt of the
element's last surface about its vertex, inside the element's motion.

    motion     (first, last, pivot surface, offset behind its nominal vertex [mm], decentre [mm] (3), tilt about x, y, z [rad] (3))
    shape      added curvature [1/mm], added conic constant, {(i, j): c} of added sag c x^i y^j
    glass      added index, factor of the Abbe number
Fringes N at wavelength w on the semi-diameter S: power dc = N w/S^2; astigmatism sag (N w/4) rho^2 cos 2(phi - phi0), rho = r/S; "mixed"
(N w/4) (rho^4 + rho^2 cos^2(phi - phi0)). Zernike: standard terms, RMS 1, waves of w.
"""
import math
import re
import tomllib
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

ARCMIN = math.pi / 180 / 60
FRINGE_NM = 546.1


@dataclass
class Target:
    """What has errors; `names` of its quantities."""
    kind: str
    surfaces: tuple
    pivot: int = 0
    offset_mm: float = 0.0
    absorb: int = 0
    figure: str = "astigmatism"
    limits: dict = field(default_factory=dict)      # name -> (low, high, law)

    @property
    def name(self):
        if self.kind == "film":
            return "film"
        a, *b = self.surfaces
        return f"{self.kind} {a}" + (f"-{b[0]}" if b and b[0] != a else "")

    @property
    def rank(self):
        order = ("element", "surface", "gap", "glass", "film").index(self.kind)
        a, *b = (*self.surfaces, 0) if self.kind == "film" else self.surfaces
        return (order, -(b[0] - a), a, self.pivot, self.offset_mm) if self.kind == "element" else (order, a, self.absorb)


AXES = (("decentre", "um", "radial"), ("tilt", "arcmin", "tilt_radial"), ("wedge", "arcmin", "wedge_radial"))
PLAIN = {"shift_um": "shift", "radius_percent": "radius", "radius_fringes": "radius", "radius_um": "radius", "irregularity_fringes": "irregularity",
         "conic": "conic", "thickness_um": "thickness", "index": "index", "abbe_percent": "abbe"}


def targets(path):
    """(targets from the outermost inwards, test wavelength in nm) of a description."""
    text = tomllib.loads(Path(path).read_text())
    defaults = text.get("tolerances", {})
    law = defaults.get("law", "normal")
    found = {}

    def limits(value):
        if isinstance(value, dict):
            low, high = value["limits"] if isinstance(value["limits"], list) else (-value["limits"], value["limits"])
            return low, high, value.get("law", law)
        low, high = value if isinstance(value, list) else (-value, value)
        return low, high, law

    def add(target, entry):
        target = found.setdefault(target.rank, target)
        if "irregularity_fringes" in entry:
            target.figure = entry.get("figure", "astigmatism")
        for what, unit, radial in AXES:
            both = entry.get(f"{what}_{unit}")
            if both is not None and entry.get(radial, False):
                target.limits[what] = limits(both)
                target.limits[f"{what}_angle"] = (0.0, 2 * math.pi, "uniform")
            elif both is not None:
                target.limits |= {f"{what}_x": limits(both), f"{what}_y": limits(both)}
            for axis in "xy":
                if f"{what}_{axis}_{unit}" in entry:
                    target.limits[f"{what}_{axis}"] = limits(entry[f"{what}_{axis}_{unit}"])
        for key, name in PLAIN.items():
            if key in entry:
                target.limits[name] = limits(entry[key])
                if name == "irregularity":
                    target.limits["irregularity_angle"] = (0.0, math.pi, "uniform")
        if "zernike" in entry:
            first, last = entry["zernike"]["terms"]
            low, high, kind = limits(entry["zernike"]["rms_waves"])
            each = high / math.sqrt(last - first + 1)
            target.limits |= {f"zernike_{j}": (-each, each, kind) for j in range(first, last + 1)}

    for e in text.get("element", []):
        first, last = e["surfaces"]
        add(Target("element", (first, last), e.get("pivot", first), e.get("pivot_offset_mm", 0.0)), e)
    for e in text.get("surface", []):
        add(Target("surface", (e["surface"],)), e)
    for e in text.get("gap", []):
        add(Target("gap", (e["after"],), absorb=e.get("absorb", 0)), e)
    for e in text.get("glass", []):
        add(Target("glass", (e["after"],)), e)
    for e in text.get("film", []):
        add(Target("film", ()), e)
    return [found[rank] for rank in sorted(found)], defaults.get("fringe_nm", FRINGE_NM)


def identifiers(found):
    """{(index of the target, name): id}: a second equal identifier gets #2."""
    seen, ids = {}, {}
    for i, target in enumerate(found):
        for name in target.limits:
            base = f"{target.name}/{name}"
            seen[base] = seen.get(base, 0) + 1
            ids[i, name] = base + (f"#{seen[base]}" if seen[base] > 1 else "")
    return ids


@dataclass
class Errors:
    motions: list = field(default_factory=list)     # outermost first
    curvature: dict = field(default_factory=dict)   # surface -> 1/mm
    conic: dict = field(default_factory=dict)
    figure: dict = field(default_factory=dict)      # surface -> {(i, j): mm^(1 - i - j)}
    glass: dict = field(default_factory=dict)       # surface -> (index, relative change of the Abbe number)


def noll(j):
    """Radial and azimuthal order of a standard Zernike term; a negative azimuthal order is a sine."""
    n = 0
    while (n + 1) * (n + 2) // 2 < j:
        n += 1
    place = j - n * (n + 1) // 2 - 1
    m = 2 * -(-place // 2) if n % 2 == 0 else 1 + 2 * (place // 2)
    return n, (m if j % 2 == 0 else -m)


def zernike_xy(n, m, sag_mm, radius_mm):
    """{(i, j): c} of a standard Zernike term: products of polynomials in x and y."""
    mu, out = abs(m), np.zeros((n + 1, n + 1))
    angular = np.zeros((mu + 1, mu + 1))
    for k in range(mu + 1):                                   # (x + iy)^mu, real or imaginary part
        value = (1j ** k) * math.comb(mu, k)
        angular[mu - k, k] = value.real if m >= 0 else value.imag
    for s in range((n - mu) // 2 + 1):
        c = (-1) ** s * math.factorial(n - s) / (math.factorial(s) * math.factorial((n + mu) // 2 - s) * math.factorial((n - mu) // 2 - s))
        p = (n - mu) // 2 - s
        for q in range(p + 1):                                # (x^2 + y^2)^p
            a, b = 2 * (p - q), 2 * q
            out[a:a + mu + 1, b:b + mu + 1] += c * math.comb(p, q) * angular
    scale = sag_mm * math.sqrt((n + 1) * (1 if m == 0 else 2))
    return {(i, j): scale * out[i, j] / radius_mm ** (i + j) for i, j in zip(*np.nonzero(out), strict=True)}


def errors(path, record, radii_mm, semi_diameters_mm, compensators=None):
    """`Errors` of a record. `radii_mm[k - 1]` of the nominal surface k (inf = plane), `semi_diameters_mm` alike; the film is the last surface."""
    found, fringe_nm = targets(path)
    values = {row["id"]: float(row["value"]) for row in record}
    units = {row["id"]: row["unit"] for row in record}
    ids, film, out = identifiers(found), len(radii_mm), Errors()
    missing = set(values) ^ set(ids.values())
    if missing:
        raise ValueError(f"record and description differ in {sorted(missing)[:5]}")
    fringe = fringe_nm * 1e-6

    def add_figure(surface, terms):
        figure = out.figure.setdefault(surface, {})
        for key, c in terms.items():
            figure[key] = figure.get(key, 0.0) + c

    for index, target in enumerate(found):
        value = {name: values[ids[index, name]] for name in target.limits}

        def along(what, unit):
            x, y = value.get(f"{what}_x", 0.0), value.get(f"{what}_y", 0.0)
            size, angle = value.get(what, 0.0), value.get(f"{what}_angle", 0.0)
            return (x + size * math.cos(angle)) * unit, (y + size * math.sin(angle)) * unit

        decentre, tilt, wedge = along("decentre", 1e-3), along("tilt", ARCMIN), along("wedge", ARCMIN)
        shift = value.get("shift", 0.0) * 1e-3
        if target.kind == "element":
            first, last = target.surfaces
            out.motions.append((first, last, target.pivot, target.offset_mm, (*decentre, shift), (*tilt, 0.0)))
            out.motions.append((last, last, last, 0.0, (0.0, 0.0, 0.0), (*wedge, 0.0)))
        elif target.kind == "film":
            out.motions.append((film, film, film, 0.0, (*decentre, shift), (*tilt, 0.0)))
        elif target.kind == "gap":
            after = target.surfaces[0]
            dz = value["thickness"] * 1e-3
            out.motions.append((after + 1, target.absorb or film, after, 0.0, (0.0, 0.0, dz), (0.0, 0.0, 0.0)))
        elif target.kind == "glass":
            out.glass[target.surfaces[0]] = value.get("index", 0.0), value.get("abbe", 0.0) / 100
        else:
            k = target.surfaces[0]
            out.motions.append((k, k, k, 0.0, (*decentre, 0.0), (*tilt, 0.0)))
            radius, half = radii_mm[k - 1], semi_diameters_mm[k - 1]
            if "radius" in value:
                v, unit = value["radius"], units[ids[index, "radius"]]
                out.curvature[k] = {"percent": lambda: 1 / (radius * (1 + v / 100)) - 1 / radius, "um": lambda: 1 / (radius + v * 1e-3) - 1 / radius,
                                    "fringes": lambda: v * fringe / half ** 2}[unit]()
            out.conic[k] = value.get("conic", 0.0)
            if "irregularity" in value:
                a, phi = value["irregularity"] * fringe / 4, value["irregularity_angle"]
                if target.figure == "mixed":
                    add_figure(k, {(4, 0): a / half ** 4, (2, 2): 2 * a / half ** 4, (0, 4): a / half ** 4, (2, 0): a * math.cos(phi) ** 2 / half ** 2,
                                   (1, 1): a * math.sin(2 * phi) / half ** 2, (0, 2): a * math.sin(phi) ** 2 / half ** 2})
                else:
                    cos, sin = math.cos(2 * phi), math.sin(2 * phi)
                    add_figure(k, {(2, 0): a * cos / half ** 2, (1, 1): 2 * a * sin / half ** 2, (0, 2): -a * cos / half ** 2})
            for name, v in value.items():
                if found_term := re.fullmatch(r"zernike_(\d+)", name):
                    add_figure(k, zernike_xy(*noll(int(found_term[1])), v * fringe, half))
    if compensators:
        # Inside the errors of the film: along its own axes, Y of the film frame down.
        x, y = compensators.get("boresight_mm", (0.0, 0.0))
        ax, ay = compensators.get("film_tilt_rad", (0.0, 0.0))
        out.motions.append((film, film, film, 0.0, (0.0, 0.0, compensators.get("film_shift_mm", 0.0)), (ax, ay, 0.0)))
        out.motions.append((film, film, film, 0.0, (x, -y, 0.0), (0.0, 0.0, 0.0)))
    out.motions = [m for m in out.motions if any(m[4]) or any(m[5])]
    return out
