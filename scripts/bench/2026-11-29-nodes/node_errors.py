"""Errors of the kernels of a film at random places, against PSFs traced there.

    node_errors.py LENSCUBE REFERENCE DESIGN NM [PLACES [TRACE OPTION…]]

LENSCUBE traces DESIGN at NM nm and makes films of isolated points with the PSF stage alone: the film around a point is the kernel of its place.
The reference is `lens psf` of the program REFERENCE there, integrated over film pixels. Both have sum 1 in the largest disc of the window, in which the
rotation of a kernel loses no light. Printed are the L1 error, and the largest difference of edges in 16 directions, of white.
Places are uniform over one quadrant of the field (no azimuth of the grid of nodes is special), one and a half windows off its edge.
One JSON line. Needs numpy and zarr.
"""

import json
import pathlib
import subprocess
import sys
import tempfile

import numpy as np
import zarr

PITCH_UM = 2.0


def run(program, *args):
    done = subprocess.run([program, *map(str, args)], capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"{program} {args}: {done.stderr}")
    return done.stderr


def edge_error(difference, half):
    y, x = np.indices(difference.shape) - half
    worst = 0.0
    for azimuth in np.arange(16) * np.pi / 16:
        along = np.round(x * np.cos(azimuth) + y * np.sin(azimuth)).astype(int) + 2 * half
        worst = max(worst, np.abs(np.cumsum(np.bincount(along.ravel(), difference.ravel()))).max())
    return worst


def films_of(points, apart):
    """Points in groups whose kernels do not meet."""
    groups = []
    for p in points:
        meets = lambda q: max(abs(p[0] - q[0]), abs(p[1] - q[1])) <= apart
        free = (group for group in groups if not any(map(meets, group)))
        group = next(free, None)
        if group is None:
            groups.append([p])
        else:
            group.append(p)
    return groups


def main():
    program, reference, design, nm = sys.argv[1:5]
    places = int(sys.argv[5]) if len(sys.argv) > 5 else 200
    folder = pathlib.Path(tempfile.mkdtemp())
    pack = folder / "lens.zarr"
    printed = run(program, "lens", "trace", design, pack, "--wavelengths", nm, "--store", "pupils", "-v", *sys.argv[6:])
    band = [line for line in printed.splitlines() if " nm: window" in line][0]
    tables = zarr.open(str(pack), mode="r")
    reach_mm = float(np.array(tables["psf_height"])[0].max())
    size, sample_um = int(np.array(tables["psf_size"])[0]), float(np.array(tables["psf_pitch"])[0])
    window = int(np.ceil(size * sample_um / PITCH_UM - 1e-9)) | 1
    half = window // 2
    last = reach_mm * 1e3 / PITCH_UM - 1.5 * window
    rng = np.random.default_rng(1)
    points = []
    while len(points) < places:
        y, x = rng.uniform(0, last, 2)
        if np.hypot(y, x) <= last:
            points.append((round(y), round(x)))
    n, axis = int(last) + 2 * window, half + 2
    errors = []
    for group in films_of(points, 2 * window):
        chart, film = folder / "chart.zarr", folder / "film.zarr"
        store = zarr.open_group(str(chart), mode="w")
        shape = {"shape": (1, n, n), "chunks": (1, 512, 512), "dtype": "f4", "fill_value": 0}
        values = store.create_array("chart", dimension_names=["wavelength", "y", "x"], **shape)
        wavelength = store.create_array("wavelength", shape=(1,), dtype="f8", dimension_names=["wavelength"])
        wavelength[:] = float(nm)
        store.attrs["pitch_um"] = PITCH_UM
        for y, x in group:
            values[0, y + axis, x + axis] = 1.0
        centre_mm = ((n - 1) / 2 - axis) * PITCH_UM * 1e-3
        placed = ["--axis", f"{axis},{axis}", "--center", f"{centre_mm},{centre_mm}", "--outside", "clamp"]
        run(program, "run", chart, film, "--lens", pack, "--stages", "svpsf", "--tails", "off", "--film-size", n,
            "--film-pitch-um", PITCH_UM, "--overwrite", *placed)
        data = zarr.open(str(film), mode="r")["film"]
        for y, x in group:
            rows, columns = (slice(c + axis - half, c + axis + half + 1) for c in (y, x))
            kernel = np.array(data[0, rows, columns], dtype=float)
            out = folder / "psf.npy"
            at = f"{x * PITCH_UM * 1e-3},{y * PITCH_UM * 1e-3}"
            run(reference, "lens", "psf", design, out, "--at", at, "--wavelength", nm, "--integrate", "--pitch-um", PITCH_UM,
                "--size", window, "--overwrite")
            traced = np.load(out).astype(float)
            disc = np.hypot(*(np.indices(traced.shape) - half)) <= half - 2
            kernel, traced = (v * disc / (v * disc).sum() for v in (kernel, traced))
            difference = kernel - traced
            errors.append((np.abs(difference).sum(), edge_error(difference, half), np.hypot(y, x) * PITCH_UM * 1e-3))
    l1, edges, at_mm = np.array(errors).T
    percent = lambda v: round(100 * float(v), 3)
    print(json.dumps({
        "design": design, "nm": float(nm), "places": places, "band": band.split(": ", 1)[1],
        "l1_percent": {"median": percent(np.median(l1)), "p95": percent(np.quantile(l1, 0.95)), "worst": percent(l1.max()),
                       "at_mm": round(float(at_mm[l1.argmax()]), 2)},
        "edges_percent": {"median": percent(np.median(edges)), "worst": percent(edges.max())},
    }))
    subprocess.run(["rm", "-rf", folder], check=True)


main()
