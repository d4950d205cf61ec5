"""Compares the PSFs of `lens export` with the programs they are for, and with `lenscube.Lens.psf`; run by check-long.

FITS cubes are read by astropy, photutils and STPSF, evaluated at the places of their grid, between them and between pixels; NPY and Zarr hold the same
numbers; SciPy reads the optics for ISETCam, whose struct must have the documented fields. Arguments: the program, beside which lies the native module.
"""
import json
import os
import shutil
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path

warnings.simplefilter("ignore")
os.environ.setdefault("STPSF_PATH", tempfile.gettempdir())

import numpy as np
import photutils
import scipy.io
import xarray
from astropy.io import fits
from photutils.psf import GriddedPSFModel
from stpsf.utils import to_griddedpsfmodel

LENSCUBE = Path(sys.argv[1]).resolve()
ROOT = Path(__file__).resolve().parent
here = Path(tempfile.mkdtemp())
done = 0  # number of checks

# The package with the native module of this program.
shutil.copytree(ROOT / "python" / "lenscube", here / "package" / "lenscube")
shutil.copy(LENSCUBE.parent / "liblenscube_native.so", here / "package" / "lenscube" / "_native.abi3.so")
sys.path.insert(0, str(here / "package"))
os.environ["LENSCUBE"] = str(LENSCUBE)
import lenscube


def check(condition, message):
    """Ends with exit code 1 and the message unless the condition is true."""
    global done
    done += 1
    if not condition:
        shutil.rmtree(here)
        sys.exit(f"check-psf-exchange: {message}")


def export(lens, name, *arguments):
    """The report, and the path, of an export."""
    arguments = ["lens", "export", lens, here / name, *arguments, "--json", "-q"]
    process = subprocess.run([LENSCUBE, *map(str, arguments)], capture_output=True, text=True)
    check(process.returncode == 0, f"lenscube {arguments} ended with {process.returncode}: {process.stderr}")
    return json.loads(process.stdout), here / name


def near(what, found, expected, allowed):
    """Largest difference over the largest expected value."""
    error = np.abs(found - expected).max() / np.abs(expected).max()
    print(f"{what}: {error:.2e} of the peak, allowed {allowed:.0e}")
    check(np.isfinite(error) and error <= allowed, f"{what}: {error} of the peak")


def unit(image):
    return image / image.sum()


def cubes(lens, film, pitch_um, nm):
    """FITS in photutils and STPSF against the kernels of films."""
    width, height = film
    given = ["--film-size", f"{width}x{height}", "--film-pitch-um", pitch_um, "--band", nm]
    report, path = export(lens, f"{lens}.fits", "--as", "psf-fits", "--grid", "3x5", *given)
    with fits.open(path) as units:
        units.verify("exception")
        header, data = units[0].header, units[0].data.astype(float)
    side, window, scale = report["side"], report["window_px"], report["oversample"]
    check(data.shape == (15, side, side) and header["NUM_PSFS"] == 15 and scale == 5, f"cube {data.shape}")
    energy = np.array([header[f"ENERGY{i}"] for i in range(15)])
    check(np.allclose(data.sum((1, 2)), energy * scale**2, rtol=1e-5), "sums are not the light in the PSFs")
    x_px, y_px = np.linspace(0, width - 1, 3), np.linspace(0, height - 1, 5)
    places = [(x, y) for y in y_px for x in x_px]
    model = to_griddedpsfmodel(str(path))
    check(np.allclose(model.grid_xypos, places) and (model.oversampling == scale).all(), f"STPSF: places {model.grid_xypos}")
    check((model.data == data).all(), "STPSF: the PSFs are in another order")
    # photutils up to 3.0 takes DET_YX as (x, y), and sorts the PSFs by it.
    other = GriddedPSFModel.read(path)
    swapped = not np.allclose(other.grid_xypos, places)
    check(not swapped or sorted(map(tuple, other.grid_xypos)) == sorted((y, x) for x, y in places), f"photutils: places {other.grid_xypos}")
    for (x, y), psf in zip(other.grid_xypos, other.data):
        i = places.index((y, x) if swapped else (x, y))
        check((psf == data[i]).all(), f"photutils: the PSF at ({x}, {y})")
    print(f"{lens}: photutils {photutils.__version__} reads DET_YX as {'(x, y)' if swapped else '(y, x)'}")

    opened = lenscube.Lens(lens, wavelengths=[nm])
    mm = lambda px, count: (px - (count - 1) / 2) * 1e-3 * pitch_um
    at = np.arange(window) - window // 2
    columns, rows = np.meshgrid(at, at)
    kernel = lambda x, y: opened.psf(mm(x, width), mm(y, height), nm, pitch_um=pitch_um, size=window).values.astype(float)
    for i in (0, 4, 7, 14):
        x, y = places[i]
        # A star in the middle of the pixel of a place: the kernel of films there, whose tails are sampled and interpolated. Films of lenses without tails
        # scale the light beyond the windows into them.
        image = model.evaluate(columns + x, rows + y, 1.0, x, y)
        check(abs(image.sum() / energy[i] - 1) < 2e-3, f"light {image.sum()} in the pixels, {energy[i]} in the PSF")
        near(f"{lens} at ({x:.0f}, {y:.0f}) px", image / image.sum(), unit(kernel(x, y)), 2e-3)
    # Between places PSFs are interpolated: within the change from one to the next.
    x, y = np.round(0.75 * (width - 1)), np.round(0.625 * (height - 1))
    image = model.evaluate(columns + x, rows + y, 1.0, x, y)
    expected = unit(kernel(x, y))
    change = max(np.abs(unit(kernel(*places[i])) - expected).max() for i in (7, 8, 10, 11)) / expected.max()
    near(f"{lens} between places", image / image.sum(), expected, change)
    # Between pixels: by the samples of another oversampling, of which none lies in the middle.
    _, fine = export(lens, f"{lens}-8.fits", "--as", "psf-fits", "--grid", "1", "--oversample", 8, "--psf-window", window, *given)
    (samples,) = fits.getdata(fine).astype(float)
    _, one = export(lens, f"{lens}-1.fits", "--as", "psf-fits", "--grid", "1", "--psf-window", window, *given)
    single = to_griddedpsfmodel(str(one))
    x, y = (width - 1) / 2, (height - 1) / 2
    for phase_x, phase_y in ((1, 6), (4, 3)):
        # Sample i of a PSF lies at (i − (n − 1)/2)/8 px.
        shift = np.array([(4 - 0.5 - phase_x) / 8, (4 - 0.5 - phase_y) / 8])
        image = single.evaluate(columns + x, rows + y, 1.0, x + shift[0], y + shift[1])
        near(f"{lens} shifted by {shift} px", image, samples[phase_y::8, phase_x::8], 1e-2)

    # The same numbers in the other formats.
    _, npy = export(lens, f"{lens}.npy", "--as", "psf-npy", "--grid", "3x5", *given)
    check((np.load(npy)[0].reshape(data.shape) == data).all(), "NPY differs from FITS")
    described = json.loads(npy.with_suffix(".json").read_text())
    check(np.allclose(np.ravel(described["energy"]), energy) and described["axes"][1] == "place_y", f"{npy.with_suffix('.json')}")
    _, store = export(lens, f"{lens}.zarr", "--as", "psf-zarr", "--grid", "3x5", *given)
    with xarray.open_zarr(store) as opened_store:
        psf = opened_store["psf"].load()
        check(psf.dims == ("wavelength", "place_y", "place_x", "y", "x"), f"dimensions {psf.dims}")
        check((psf.values.reshape(data.shape) == data).all(), "Zarr differs from FITS")
        check(np.allclose(opened_store["energy"].values.ravel(), energy), "energy of the Zarr group")
        check(np.allclose(psf.place_y, mm(y_px, height)) and np.allclose(psf.place_x, mm(x_px, width)), "places of the Zarr group")
        check(np.allclose(np.diff(psf.x), pitch_um / scale) and abs(float(psf.x.mean())) < 1e-9 and psf.x.units == "um", "samples of the Zarr group")


# Fields that ISETCam's opticsGet, rtGeometry, rtPrecomputePSF and rtImportData read.
OPTICS = {"type", "name", "model", "fNumber", "focalLength", "offaxis", "vignetting", "transmittance", "rayTrace"}
RAY_TRACE = {
    "name", "program", "lensFile", "referenceWavelength", "objectDistance", "mag", "fNumber", "effectiveFocalLength", "effectiveFNumber",
    "maxfov", "fov", "geometry", "relIllum", "psf",
}  # fmt: skip
TABLE = {"function", "fieldHeight", "wavelength"}


def isetcam(lens, film, pitch_um, nm):
    """The struct of ISETCam's ray-trace model."""
    given = ["--film-size", film, "--film-pitch-um", pitch_um]
    report, path = export(lens, f"{lens}.mat", "--as", "isetcam", *given, "--wavelengths", ",".join(map(str, nm)), "--grid", 15)
    loaded = scipy.io.loadmat(path, squeeze_me=True, struct_as_record=False)
    check([key for key in loaded if not key.startswith("__")] == ["optics"], f"variables {list(loaded)}")
    optics = loaded["optics"]
    rt = optics.rayTrace
    check(set(optics._fieldnames) == OPTICS and set(rt._fieldnames) == RAY_TRACE, f"fields {optics._fieldnames} {rt._fieldnames}")
    for table in (rt.geometry, rt.relIllum, rt.psf):
        extra = {"sampleSpacing"} if table is rt.psf else set()
        check(set(table._fieldnames) == TABLE | extra, f"fields {table._fieldnames}")
        check(table.fieldHeight.shape == (15,) and table.fieldHeight[0] == 0 and (table.wavelength == nm).all(), "axes")
    check((optics.type, optics.model, optics.offaxis, optics.vignetting) == ("optics", "raytrace", "skip", 0), "optics")
    check(abs(optics.focalLength - 1e-3 * rt.effectiveFocalLength) < 1e-12 and rt.mag < 0 < rt.effectiveFNumber, "first-order figures")
    check(0 < rt.maxfov < 90 and rt.fov == rt.maxfov and optics.transmittance.wave.shape == (len(nm),), "field")
    heights, spacing = rt.psf.fieldHeight, rt.psf.sampleSpacing
    side = report["side"]
    check(rt.psf.function.shape == (side, side, 15, len(nm)) and side % 2 == 0, f"PSFs {rt.psf.function.shape}")
    check(np.allclose(rt.psf.function.sum((0, 1)), 1, atol=1e-5), "sums of PSFs")
    check(np.allclose(spacing, 1e-3 * pitch_um / 2), f"spacing {spacing}")
    # Against traced chief rays, and the kernels of films.
    opened = lenscube.Lens(lens, wavelengths=list(map(float, nm)))
    middle = side // 2 - 1
    for band, wavelength in enumerate(nm):
        real = opened.project([(h, 0.0) for h in heights], wavelength)[:, 0]
        near(f"{lens}, ISETCam heights at {wavelength} nm", rt.geometry.function[:, band], real, 1e-5)
        light = opened.relative_illumination(real, wavelength)
        near(f"{lens}, ISETCam relative illumination at {wavelength} nm", rt.relIllum.function[:, band], light, 1e-4)
    for i in (0, 7, 13):
        kernel = opened.psf(float(rt.geometry.function[i, 0]), 0.0, nm[0], pitch_um=1e3 * spacing[0], size=2 * middle - 1).values.astype(float)
        part = rt.psf.function[:, :, i, 0][1 : 2 * middle, 1 : 2 * middle]
        # Light beyond the window is scaled into it here.
        near(f"{lens}, ISETCam PSF at height {i}", part / part.sum(), kernel / kernel.sum(), 5e-3)


cubes("phone", (1001, 801), 3.0, 550.0)
cubes("double-gauss-28", (1001, 801), 4.0, 587.6)
isetcam("phone", "1000x800", 3.0, [450, 550, 650])
shutil.rmtree(here)
print(f"check-psf-exchange: {done} checks, photutils {photutils.__version__}, SciPy {scipy.__version__}, xarray {xarray.__version__}")
