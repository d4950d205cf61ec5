#!/usr/bin/env python3
"""Light that is left of single rays through the lenses of pipeline/tests/data/lens_suite.txt: writes pipeline/tests/data/transmission.txt.

    python3 scripts/lens_suite/transmission.py

Independent of the program in its method: rays by Newton's method on the surface, polarisation by 3 x 3 matrices (R. A. Chipman, Polarization
ray tracing, Opt. Eng. 34, 1636, 1995), films by Fresnel's coefficients summed over all reflections from the substrate up. Unpolarised light;
surfaces bare, or with a quarter wave of index 1.38 at 0.55 um on boundaries with air; mirrors reflect everything; no absorption.
Rays: from the field point at the tangent `tan` through (p, q) x radius of the paraxial entrance pupil plane. Lines:
    ray LENS TAN P Q BARE QUARTER_WAVE
"""

from pathlib import Path

import numpy as np

DATA = Path(__file__).resolve().parents[2] / "pipeline/tests/data"
UM = 0.5876
RAYS = [(0.0, 0.0), (0.5, 0.3), (-0.6, 0.4), (0.1, -0.8)]


def lenses():
    lens = None
    for line in (DATA / "lens_suite.txt").read_text().splitlines():
        key, _, rest = line.partition(" ")
        if key == "lens":
            if lens:
                yield lens
            lens = dict(name=rest, surfaces=[], tans=[0.0], object=np.inf)
        elif key == "surface":
            lens["surfaces"].append([float(v) for v in rest.split()])
        elif key == "diameter":
            lens["radius"] = float(rest) / 2
        elif key == "object":
            lens["object"] = float(rest)
        elif key == "paraxial":
            lens["pupil"] = float(rest.split()[3])
        elif key == "field":
            lens["tans"].append(float(rest.split()[0]))
    yield lens


def sag(s, r2):
    c, k = s[0], s[4]
    z = c * r2 / (1 + np.sqrt(1 - (1 + k) * c * c * r2))
    slope = c / np.sqrt(1 - (1 + k) * c * c * r2)  # (1/r) dz/dr
    for i, a in enumerate(s[5:]):
        z, slope = z + a * r2 ** (i + 2), slope + 2 * (i + 2) * a * r2 ** (i + 1)
    return z, slope


def meet(s, vertex, p, d):
    t = (vertex - p[2]) / d[2]
    for _ in range(100):
        q = p + t * d
        z, slope = sag(s, q[0] ** 2 + q[1] ** 2)
        step = (vertex + z - q[2]) / (d[2] - slope * (q[0] * d[0] + q[1] * d[1]))
        t += step
        if abs(step) < 1e-13:
            break
    q = p + t * d
    _, slope = sag(s, q[0] ** 2 + q[1] ** 2)
    m = np.array([-slope * q[0], -slope * q[1], 1.0])
    return q, m / np.linalg.norm(m)


def amplitudes(n1, n2, cos1, film):
    """Amplitudes (reflected, transmitted) of s and of p, |t|^2 a share of power: Airy's sum of one film (index, thickness) on Fresnel's coefficients.

    p fields point along d x s before and behind, so that the two reflectances differ in sign along the normal."""
    cosine = lambda n: np.sqrt(1 - (n1 / n) ** 2 * (1 - cos1**2) + 0j)  # noqa: E731

    def fresnel(a, b, pol):
        ca, cb = cosine(a), cosine(b)
        if pol == "s":
            bottom = a * ca + b * cb
            return (a * ca - b * cb) / bottom, 2 * a * ca / bottom
        bottom = b * ca + a * cb
        return (b * ca - a * cb) / bottom, 2 * a * ca / bottom

    power = np.sqrt((n2 * cosine(n2)).real / (n1 * cos1))
    out = []
    for pol in "sp":
        if film is None:
            r, t = fresnel(n1, n2, pol)
            out.append((r, t * power))
            continue
        n, thickness = film
        (r12, t12), (r23, t23) = fresnel(n1, n, pol), fresnel(n, n2, pol)
        phase = np.exp(2j * np.pi * n * thickness * cosine(n) / UM)
        airy = 1 + r12 * r23 * phase**2
        out.append(((r12 + r23 * phase**2) / airy, t12 * t23 * phase / airy * power))
    return out


def transmitted(n1, n2, cos1, film):
    """Transmitted amplitudes of s and p."""
    return [t for _, t in amplitudes(n1, n2, cos1, film)]


def share(lens, tan, p, q, film):
    z = lens["pupil"]
    at = np.array([p, q, 0]) * lens["radius"] + [0, 0, z]
    sign = lens["sign"]
    if np.isinf(lens["object"]):
        d = np.array([sign * tan, 0, 1.0])
    else:
        d = at - np.array([-sign * tan * (lens["object"] + z), 0, -lens["object"]])
    d, point = d / np.linalg.norm(d), at
    index, vertex, total, forward = 1.0, 0.0, np.eye(3, dtype=complex), 1
    for s in lens["surfaces"]:
        point, m = meet(s, vertex, point, d)
        m = m * np.sign(d @ m)
        cos1 = d @ m
        side = np.cross(d, m)
        side = side / np.linalg.norm(side) if np.linalg.norm(side) > 1e-12 else np.array([0, 1.0, 0])
        if s[2] == 0:
            new, behind, factors = d - 2 * cos1 * m, index, (-1, 1)
        else:
            behind = np.sqrt(s[2] + s[3] / UM**2)
            root = 1 - (index / behind) ** 2 * (1 - cos1**2)
            new = index / behind * d + (np.sqrt(root) - index / behind * cos1) * m
            with_air = index == 1 or behind == 1
            factors = transmitted(index, behind, cos1, film if with_air else None) if index != behind else (1, 1)
        into = np.stack([side, np.cross(d, side), d])
        out = np.stack([side, np.cross(new, side), new])
        total = out.T @ np.diag([*factors, 1]) @ into @ total
        d, index, vertex = new, behind, vertex + s[1]
    # Unpolarised: the mean over two fields at right angles to the first direction.
    start = np.array([sign * tan, 0, 1.0]) if np.isinf(lens["object"]) else at - np.array([-sign * tan * (lens["object"] + z), 0, -lens["object"]])
    start = start / np.linalg.norm(start)
    u = np.cross(start, [0, 1.0, 0])
    u = u / np.linalg.norm(u)
    return sum(np.linalg.norm(total @ e) ** 2 for e in (u, np.cross(start, u))) / 2


def main():
    text = ["# made by scripts/lens_suite/transmission.py: ray LENS TAN P Q BARE QUARTER_WAVE"]
    for lens in lenses():
        lens["sign"] = 1.0
        for tan in [lens["tans"][0], lens["tans"][1], lens["tans"][min(3, len(lens["tans"]) - 1)]]:
            for p, q in RAYS:
                values = [share(lens, tan, p, q, film) for film in (None, (1.38, 0.55 / 4 / 1.38))]
                if np.all(np.isfinite(values)):
                    text.append(f"ray {lens['name'].replace(' ', '_')} {tan!r} {p} {q} {values[0]:.12f} {values[1]:.12f}")
    (DATA / "transmission.txt").write_text("\n".join(text) + "\n")


if __name__ == "__main__":
    np.seterr(all="ignore")
    main()
