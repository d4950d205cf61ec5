#!/usr/bin/env python3
"""Statistics of 200 drawn lenses, `lenscube lens tolerance`, against Optiland: `check_statistics.py LENSCUBE [FOLDER]`; FOLDER keeps the outputs.

numpy, optiland. A triplet, RMS radius of the geometric spot about its centroid at two film places (on the axis, at 10 mm), polychromatic (the design's
wavelengths, equal weights), the film refocused by least squares over both, twice:
    dz = -sum w (rho - mean)(s - mean) / sum w |s - mean|^2,  s slopes behind the lens
lens by lens   Optiland with the values that the program drew: both radii and the film shift of each lens
statistics     mean and deviation at both places with the program's draws and with independent ones of the same distributions (numpy's truncated
               normal, by rejection): within 4 deviations of their sampling errors; and the drawn values themselves
The deviation of the error of a mean is s/sqrt(n), that of the error of a deviation sqrt((m4 - s^4)/n)/(2 s), m4 the fourth central moment.
"""
import csv
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

import tolerances
from optiland_built import Built, Design, Spot

DESIGN = Path(__file__).resolve().parents[3] / "formats/data/lenses/triplet.csv"
SAMPLES, SEED, SIGMAS = 200, 1, 4.0
PLACES = ((0.0, 0.0), (10.0, 0.0))
RADIUS, SHIFT_MM = 2e-3, 2e-4                                # of each lens: share of the radius; mm
RINGS, SPOKES = 6, 16                                        # of the focus, as the program's; of radii 12 and 36
TOLERANCES = f"""
[[element]]
surfaces = [1, 2]
decentre_um = 20
tilt_arcmin = 2
[[element]]
surfaces = [3, 4]
decentre_um = 20
tilt_arcmin = 2
wedge_arcmin = 1
[[element]]
surfaces = [5, 6]
decentre_um = 20
radial = true
tilt_arcmin = 2
[[surface]]
surface = 1
radius_percent = 0.1
[[surface]]
surface = 4
radius_percent = {{limits = [-0.1, 0.05], law = "uniform"}}
[[gap]]
after = 2
thickness_um = 30
[[gap]]
after = 4
thickness_um = {{limits = [-30, 30], law = "parabolic"}}
[[film]]
tilt_arcmin = 3
[criterion]
kind = "rms-spot"
fields = {[list(p) for p in PLACES]}
"""
# Columns of lenses.csv; those of drawn values are "ID" or "ID [UNIT]", and an identifier has a slash.
STATUS, CRITERION_UM, FILM_SHIFT_MM = "status", "criterion", "film_shift_mm"
SPOT_UM = [f"rms_spot_{k}_um" for k in range(1, len(PLACES) + 1)]


def read(path):
    """(record, RMS radii in um, criterion in um, film shift in mm) of every lens."""
    with open(path, newline="") as file:
        rows = list(csv.DictReader(file))
    drawn = {h: re.fullmatch(r"(.+?)(?: \[(.+)\])?", h) for h in rows[0] if "/" in h}
    lenses = []
    for row in rows:
        if row[STATUS] != "ok":
            sys.exit(f"a lens failed: {row}")
        record = [{"id": m[1], "unit": m[2] or "1", "value": float(row[h])} for h, m in drawn.items()]
        lenses.append((record, [float(row[h]) for h in SPOT_UM], float(row[CRITERION_UM]), float(row[FILM_SHIFT_MM])))
    return lenses


def independent(path, count, rng):
    """Records of `count` lenses by numpy's own generator."""
    found, _ = tolerances.targets(path)
    limits = {identifier: found[i].limits[name] for (i, name), identifier in tolerances.identifiers(found).items()}

    def one(low, high, law):
        mid, half = (low + high) / 2, (high - low) / 2
        if law == "normal":
            s = rng.normal(0, 0.5)
            while abs(s) > 1:
                s = rng.normal(0, 0.5)
        else:
            s = {"uniform": lambda: rng.uniform(-1, 1), "two-point": lambda: rng.choice([-1.0, 1.0]),
                 "parabolic": lambda: np.cbrt(rng.uniform(-1, 1))}[law]()
        return mid + half * s

    units = {i: "percent" for i in limits if i.endswith("/radius")}
    return [[{"id": i, "unit": units.get(i, ""), "value": one(*limit)} for i, limit in limits.items()] for _ in range(count)]


def built(design, path, record, shift_mm):
    moved = {"film_shift_mm": shift_mm}
    errors = tolerances.errors(path, record, design.radius, design.semi_diameters_mm, moved)
    return [(Built(design, um, errors), 1 / len(design.wavelengths_um)) for um in design.wavelengths_um]


def spots(design, lights, rings, spokes):
    """Spots at the places, whose fields are those of the primary wavelength."""
    primary = lights[design.wavelengths_um.index(design.primary_um)][0]
    return [Spot(lights, primary.field_of(place), rings, spokes) for place in PLACES]


def figures(design, path, record):
    """(RMS radii in um, film shift in mm) of a lens, refocused."""
    shift = 0.0
    for _ in range(2):
        sums = np.array([s.focus_sums() for s in spots(design, built(design, path, record, shift), RINGS, SPOKES)]).sum(0)
        shift -= sums[0] / sums[1]
    return [1e3 * s.rms for s in spots(design, built(design, path, record, shift), 12, 36)], shift


def moments(values):
    """Mean and deviation with the deviations of their errors."""
    v = np.asarray(values, float)
    n, mean, s = len(v), v.mean(0), v.std(0, ddof=1)
    fourth = ((v - mean) ** 4).mean(0)
    return (mean, s / np.sqrt(n)), (s, np.sqrt(np.maximum(fourth - s ** 4, 1e-30) / n) / (2 * s))


def main(lenscube, folder):
    failed = 0
    path, out = folder / "triplet.toml", folder / "triplet"
    path.write_text(TOLERANCES)
    if not (out / "lenses.csv").exists():
        words = [lenscube, "lens", "tolerance", DESIGN, path, "--samples", SAMPLES, "--seed", SEED, "--out", out]
        done = subprocess.run([*map(str, words)], capture_output=True, text=True)
        if done.returncode:
            sys.exit(f"{' '.join(map(str, words))}: exit {done.returncode}: {done.stderr}")
    design = Design.of_program(lenscube, DESIGN)
    lenses = read(out / "lenses.csv")
    assert len(lenses) == SAMPLES
    own = [figures(design, path, record) for record, *_ in lenses]
    radii, given = (np.array([row[i] for row in rows]) for rows, i in ((own, 0), (lenses, 1)))
    apart, moved = np.abs(radii / given - 1).max(), max(abs(shift - row[3]) for (_, shift), row in zip(own, lenses, strict=True))
    mean = max(abs(np.mean(row[1]) / row[2] - 1) for row in lenses)
    bad = apart > RADIUS or moved > SHIFT_MM or mean > 1e-9
    failed += bad
    print(f"lens by lens, {SAMPLES}: RMS radii within {apart:.1e} of Optiland's (bound {RADIUS}), film shift within {moved:.1e} mm ({SHIFT_MM}), criterion = "
          f"their mean within {mean:.1e}" + ("  FAIL" if bad else ""), flush=True)

    others = independent(path, SAMPLES, np.random.default_rng(2026))
    free = [figures(design, path, record) for record in others]
    rows = [(f"RMS radius at {place} mm, um", [radii[i] for radii, _ in own], [radii[i] for radii, _ in free]) for i, place in enumerate(PLACES)]
    rows.append(("film shift, mm", [shift for _, shift in own], [shift for _, shift in free]))
    value = lambda record: {r["id"]: r["value"] for r in record}
    drawn, drawn_free = [value(record) for record, *_ in lenses], [value(record) for record in others]
    rows += [(name, [v[name] for v in drawn], [v[name] for v in drawn_free]) for name in drawn[0]]
    print(f"\n{'':32} {'mean: program, free':>24} {'sigmas':>7} {'deviation: program, free':>26} {'sigmas':>7}")
    for name, a, b in rows:
        (m1, e1), (s1, f1) = moments(a)
        (m2, e2), (s2, f2) = moments(b)
        z = abs(m1 - m2) / np.hypot(e1, e2), abs(s1 - s2) / np.hypot(f1, f2)
        bad = max(z) > SIGMAS
        failed += bad
        print(f"{name:32} {m1:12.5f}{m2:12.5f} {z[0]:7.2f} {s1:14.5f}{s2:12.5f} {z[1]:7.2f}" + ("  FAIL" if bad else ""))
    print(f"\n{failed} bounds violated")
    return int(failed > 0)


if __name__ == "__main__":
    if len(sys.argv) not in (2, 3):
        sys.exit(__doc__)
    with tempfile.TemporaryDirectory() as scratch:
        place = Path(sys.argv[2] if len(sys.argv) == 3 else scratch).resolve()
        place.mkdir(parents=True, exist_ok=True)
        sys.exit(main(sys.argv[1], place))
