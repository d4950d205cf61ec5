"""A sensor of set figures measured by the program of the EMVA 1288 committee; run by scripts/emva1288.

The exposure time is varied under constant light, as EMVA 1288 allows: 50 times from 2.1 % to 105 % of saturation, two frames each in
the light and in the dark, and 100 frames each at half saturation and in the dark for the spatial figures. Light: a uniform film of
540 to 560 nm. The sensor has a constant quantum efficiency, so photons follow from the film's irradiance alone:

    photons of a pixel = E · t · p² · ∫ λ/(hc) dλ,   535 to 565 nm (half a band's spacing beyond the outer bands)
"""
import logging
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import zarr

np.int, np.float = int, float  # names that the program uses and NumPy has removed
from emva1288.process import Data1288, LoadImageData, ParseEmvaDescriptorFile, Results1288  # noqa: E402

LENSCUBE = os.environ["LENSCUBE"]
SIDE, PITCH_UM = 512, 5.5
K, QE, READ_E, DSNU_E, PRNU, WELL_E, BITS, BLACK = 0.11, 0.5, 13.0, 9.1, 0.0127, 9009.0, 10, 32.0
EXPOSURES, SPATIAL = 50, 100
HC = 6.62607015e-34 * 299792458.0
SENSOR = f"""
schema = "lenscube/sensor/1"
name = "set-figures"
description = "figures that an evaluation has to find again"
[pixel]
pitch_um = {PITCH_UM}
full_well_e = {WELL_E}
[noise]
read_noise_e = {READ_E}
dsnu_e = {DSNU_E}
prnu = {PRNU}
[adc]
bits = {BITS}
gain_dn_per_e = {K}
black_dn = {BLACK}
[spectral]
constant = {QE}
[cfa]
pattern = [["Y"]]
Y = {{}}
[source]
"*" = "set here"
"""


def lenscube(*words):
    done = subprocess.run([LENSCUBE, *map(str, words)], stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    if done.returncode:
        sys.exit(f"lenscube {' '.join(map(str, words))}\n{done.stderr}")


def film(path, value):
    """A uniform film; its irradiance in W m-2 nm-1."""
    chart = f"gen:uniform?size={SIDE}&pitch_um={PITCH_UM}&wavelengths=540,550,560&value={value}"
    lenscube("run", chart, path, "--lens", "double-gauss-28-npz", "--stages", "distortion", "--film-units", "irradiance", "--no-fsync")
    pixels = zarr.open_array(str(path / "film"), mode="r")[:].astype(np.float64)
    means = pixels.mean(axis=(1, 2))
    if value:
        assert np.ptp(pixels / means[:, None, None]) < 1e-5, "the film is not uniform"
    return means


def frames(place, name, light, seconds, count, seed):
    """Writes frames as .npy and returns their names, exposure by exposure."""
    raw = place / f"{name}.zarr"
    times = ",".join(repr(float(t)) for t in seconds)
    lenscube("sensor", light, raw, "--sensor", place / "sensor.toml", "--exposure", times, "--frames", count, "--seed", seed, "--no-fsync")
    stack = zarr.open_array(str(raw / "raw"), mode="r")
    names = []
    for k in range(stack.shape[0]):
        file = f"{name}-{k}.npy"
        np.save(place / file, stack[k])
        names.append(file)
    return [names[k * count:(k + 1) * count] for k in range(len(seconds))]


def measure(place):
    (place / "sensor.toml").write_text(SENSOR)
    bright, dark = place / "bright.film", place / "dark.film"
    irradiance = film(bright, 1.0)
    film(dark, 0.0)
    # Linear between bands, constant half a spacing beyond: with equal bands the integral over 535 to 565 nm.
    per_nm = ((565e-9) ** 2 - (535e-9) ** 2) / 2 / HC * 1e9
    photons_per_s = irradiance.mean() * per_nm * (PITCH_UM * 1e-6) ** 2
    full_s = WELL_E / QE / photons_per_s
    seconds = full_s * 1.05 * np.arange(1, EXPOSURES + 1) / EXPOSURES
    half_s = full_s / 2
    lines = ["v 4.0", f"n {BITS} {SIDE} {SIDE}"]

    def series(head, names):
        lines.append(head)
        lines.extend(f"i {name}" for name in names)

    for t, lit, unlit in zip(seconds, frames(place, "bright", bright, seconds, 2, 1), frames(place, "dark", dark, seconds, 2, 2)):
        series(f"b {float(t)!r} {float(t * photons_per_s)!r}", lit)
        series(f"d {float(t)!r}", unlit)
    series(f"b {float(half_s)!r} {float(half_s * photons_per_s)!r}", frames(place, "bright-spatial", bright, [half_s], SPATIAL, 3)[0])
    series(f"d {float(half_s)!r}", frames(place, "dark-spatial", dark, [half_s], SPATIAL, 4)[0])
    descriptor = place / "descriptor.txt"
    descriptor.write_text("\n".join(lines) + "\n")
    info = ParseEmvaDescriptorFile(str(descriptor), loglevel=logging.ERROR)
    data = Data1288(LoadImageData(info.images, fload=np.load, loglevel=logging.ERROR).data, loglevel=logging.ERROR)
    found = Results1288(data.data, loglevel=logging.ERROR)
    value = lambda name: (lambda v: float(v() if callable(v) else v))(getattr(found, name))  # noqa: E731
    # The variance is greatest at the last exposure whose distribution over the pixels the well does not cut: within a step, and three
    # standard deviations of shot noise and PRNU.
    saturation = (1.05 / EXPOSURES + 3 * (1 / WELL_E + PRNU**2) ** 0.5) * WELL_E / QE
    return [
        ("K (DN/e⁻)", K, value("K"), 0.005 * K),
        ("quantum efficiency (%)", 100 * QE, value("QE"), 0.5),
        ("temporal dark noise (e⁻)", READ_E, value("sigma_d"), 0.01 * READ_E),
        ("saturation (photons)", WELL_E / QE, value("u_p_sat"), saturation),
        ("DSNU (e⁻)", DSNU_E, value("DSNU1288"), 0.03 * DSNU_E),
        ("PRNU (%)", 100 * PRNU, value("PRNU1288"), 0.01 * 100 * PRNU),
    ]


with tempfile.TemporaryDirectory() as place:
    rows = measure(Path(place))
lines = ["| figure | set | found | allowed difference |", "|---|---|---|---|"]
lines += [f"| {name} | {wanted:.6g} | {got:.6g} | {allowed:.3g} |" for name, wanted, got, allowed in rows]
print("\n".join(lines))
if len(sys.argv) > 1:
    Path(sys.argv[1]).write_text("\n".join(lines) + "\n")
outside = [name for name, wanted, got, allowed in rows if not abs(got - wanted) <= allowed]
sys.exit(f"outside: {', '.join(outside)}" if outside else 0)
