#!/usr/bin/env python3
"""Single rays along ghost paths of the lenses of pipeline/tests/data/lens_suite.txt: writes pipeline/tests/data/ghosts.txt.

    python3 scripts/lens_suite/ghosts.py

Independent of the program in its method (see transmission.py): rays in one frame, by Newton's method on the surfaces, polarisation by 3 x 3 matrices in space.
Surfaces bare, or with a quarter wave of index 1.38 at 0.55 um on boundaries with air; the film reflects 0.1; no clear radii; lenses without mirrors.
Rays: from the field point at the tangent `tan` through (x, y) in the plane of the first vertex. Surfaces count from 0, the film is the last. Lines:
    ghost LENS FIRST SECOND TAN X Y LANDING_X LANDING_Y BARE QUARTER_WAVE
"""

import numpy as np
from transmission import DATA, UM, amplitudes, lenses, meet

FILM_REFLECTANCE = 0.1
STARTS = [(0.25, 0.15), (-0.4, 0.3)]  # of the radius of the pupil
FILM = (0.0, 0.0, 1.0, 0.0, 0.0)


def paths(lens, index):
    """Pairs of the first two, the middle two and the last two surfaces that reflect, and those of the film with the last and with the first."""
    film = len(lens["surfaces"])
    there = [k for k in range(film) if index[k] != index[k + 1]]
    middle = len(there) // 2
    found = {(there[1], there[0]), (there[middle], there[middle - 1]), (there[-1], there[-2]), (there[-1], there[0])}
    return sorted(found | {(film, there[-1]), (film, there[0])})


def follow(lens, index, path, tan, start, film):
    """Landing and share of the light of a ray, or none."""
    first, second = path
    last = len(lens["surfaces"])
    surfaces = [*lens["surfaces"], FILM]
    vertex = np.concatenate([[0], np.cumsum([s[1] for s in surfaces[:-1]])])
    point = np.array([*start, 0.0])
    if np.isinf(lens["object"]):
        d = np.array([lens["sign"] * tan, 0, 1.0])
    else:
        d = point - np.array([-lens["sign"] * tan * (lens["object"] + lens["pupil"]), 0, -lens["object"]])
    d = d / np.linalg.norm(d)
    begin, total, since = d, np.eye(3, dtype=complex), np.inf
    order = [*range(first + 1), *range(first - 1, second - 1, -1), *range(second + 1, last + 1)]
    reflects = {first, first + (first - second)}  # places in the order
    for place, k in enumerate(order):
        before = point
        forward = d[2] > 0
        point, m = meet(surfaces[k], vertex[k], point, d)
        since += (point - before) @ d
        n1, n2 = (index[k], index[k + 1]) if forward else (index[k + 1], index[k])
        if place == len(order) - 1:
            break
        if n1 == n2 and k != last:
            continue
        if since < 0 or not np.isfinite(since + point.sum()) and place:
            return None
        since = 0.0
        m = m * np.sign(d @ m)
        cos1 = d @ m
        side = np.cross(d, m)
        side = side / np.linalg.norm(side) if np.linalg.norm(side) > 1e-12 else np.array([0, 1.0, 0])
        if k == last:
            (rs, rp), (ts, tp) = [np.sqrt(FILM_REFLECTANCE)] * 2, (0, 0)
            rp = -rp  # a mirror turns p
        else:
            with_air = 1.0 in (n1, n2)
            (rs, ts), (rp, tp) = amplitudes(n1, n2, cos1, film if with_air else None)
        if place in reflects:
            # Its p field points along d x s behind, against that of the amplitude for a surface met head on.
            new, factors = d - 2 * cos1 * m, (rs, rp)
        else:
            root = 1 - (n1 / n2) ** 2 * (1 - cos1**2)
            if root < 0:
                return None
            new, factors = n1 / n2 * d + (np.sqrt(root) - n1 / n2 * cos1) * m, (ts, tp)
        into = np.stack([side, np.cross(d, side), d])
        out = np.stack([side, np.cross(new, side), new])
        total = out.T @ np.diag([*factors, 1]) @ into @ total
        d = new
        if (d[2] > 0) != (forward != (place in reflects)):
            return None
    if since + 0 < 0 or not np.all(np.isfinite(point)):
        return None
    u = np.cross(begin, [0, 1.0, 0])
    u = u / np.linalg.norm(u)
    share = sum(np.linalg.norm(total @ e) ** 2 for e in (u, np.cross(begin, u))) / 2
    return point[0], point[1], share


def main():
    text = ["# made by scripts/lens_suite/ghosts.py: ghost LENS FIRST SECOND TAN X Y LANDING_X LANDING_Y BARE QUARTER_WAVE"]
    for lens in lenses():
        if any(s[2] == 0 for s in lens["surfaces"]):
            continue
        lens["sign"] = 1.0
        index = [1.0] + [np.sqrt(s[2] + s[3] / UM**2) for s in lens["surfaces"]] + [1.0]
        for path in paths(lens, index):
            for tan in lens["tans"][:2]:
                for x, y in STARTS:
                    start = (x * lens["radius"], y * lens["radius"])
                    both = [follow(lens, index, path, tan, start, film) for film in (None, (1.38, 0.55 / 4 / 1.38))]
                    if None in both or np.hypot(*both[0][:2]) > 1e3:
                        continue
                    (lx, ly, bare), (_, _, coated) = both
                    name = lens["name"].replace(" ", "_")
                    text.append(f"ghost {name} {path[0]} {path[1]} {tan!r} {start[0]!r} {start[1]!r} {lx:.10f} {ly:.10f} {bare:.12e} {coated:.12e}")
    (DATA / "ghosts.txt").write_text("\n".join(text) + "\n")


np.seterr(all="ignore")
main()
