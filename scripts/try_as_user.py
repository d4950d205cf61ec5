"""The tasks of a user's first day beyond the documents' commands; run by scripts/try-as-user, which names the program as the first argument."""
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import urllib.request
import warnings
from pathlib import Path

import h5py
import hdf5storage
import numpy as np
import scipy.io
import OpenEXR
import tifffile
import xarray
from PIL import Image

# zarr-python remarks the records of runs beside the arrays.
warnings.simplefilter("ignore")

LENSCUBE = Path(sys.argv[1]).resolve()
DESIGN = Path(__file__).resolve().parent.parent / "formats/data/lenses/double-gauss-28.zmx"
NM = np.arange(450.0, 655.0, 50.0)
GIVEN = ["--wavelengths", "450:650:50"]
# A traced lens would take seconds a band; these tables need no tracing.
LENS = ["--lens", "double-gauss-28-npz", "--film-pitch-um", "5", "--film-size", "64x64", "--interpolate-psf"]
failed = []


def start(words, place, **options):
    environment = {**os.environ, "XDG_CACHE_HOME": str(place / "cache")}
    return subprocess.Popen([LENSCUBE, *map(str, words)], cwd=place, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, **options)


def task(name, words, place, code=0, out=(), err=()):
    """Runs `lenscube WORDS`; `out` and `err` are expected on standard output and error."""
    process = start(words, place)
    stdout, stderr = process.communicate(timeout=300)
    text = {"out": stdout.decode(errors="replace"), "err": stderr.decode(errors="replace")}
    missing = [w for stream, words in (("out", out), ("err", err)) for w in words if w not in text[stream]]
    good = code in (process.returncode, None) and not missing and "panicked" not in text["err"]
    print(f"{'ok    ' if good else 'FAILED'}  {name}", flush=True)
    if not good:
        failed.append(name)
        print(f"        lenscube {' '.join(map(str, words))}\n        exit code {process.returncode}, expected {code}; missing {missing}\n{text['err']}")
    return stdout


def stopped_in_film(words, place):
    """A run of film.zarr, 18 shards, stopped by SIGSTOP after its first shard and before its last. A run that was faster is begun again."""
    shards = lambda: len(list(place.glob("film.zarr/film/c/*/*/[0-9]*")))
    while True:
        shutil.rmtree(place / "film.zarr", ignore_errors=True)
        process = start(words, place)
        while not shards() and process.poll() is None:
            time.sleep(0.02)
        process.send_signal(signal.SIGSTOP)
        while process.poll() is None and states(process.pid) != {"T"}:
            time.sleep(0.02)
        if process.poll() is None and 0 < shards() < 18:
            return process
        process.kill()
        _, stderr = process.communicate()
        if process.returncode not in (0, -signal.SIGKILL):
            sys.exit(f"the run to be stopped ended with {process.returncode}: {stderr.decode()}")


def states(pid):
    """The states of the threads of a process."""
    found = set()
    for stat in Path(f"/proc/{pid}/task").glob("*/stat"):
        try:
            found.add(stat.read_text().rpartition(")")[2].split()[0])
        except OSError:
            pass  # a thread that has ended
    return found


def require(name, condition):
    print(f"{'ok    ' if condition else 'FAILED'}  {name}", flush=True)
    if not condition:
        failed.append(name)


def write_charts(place):
    cube = np.random.default_rng(5).random((64, 64, len(NM)), np.float32)
    np.save(place / "cube.npy", cube)
    hdf5storage.write({"rad": cube.astype("f8"), "bands": NM}, filename=str(place / "icvl.mat"), matlab_compatible=True, compress_size_threshold=0)
    scipy.io.savemat(place / "old.mat", {"rad": cube})
    with h5py.File(place / "two.h5", "w") as f:
        f["a"], f["b"] = cube, cube
    ds = xarray.Dataset({"radiance": (("y", "x", "wavelength"), cube)}, {"wavelength": ("wavelength", NM, {"units": "nm"})})
    ds.to_netcdf(place / "cube.nc", engine="h5netcdf", encoding={"radiance": {"zlib": True, "dtype": "u2", "scale_factor": 1e-4, "_FillValue": 65535}})
    ds.to_zarr(place / "cube.zarr", consolidated=False)
    ds.to_netcdf(place / "classic.nc", engine="scipy")
    (place / "cave").mkdir()
    for k, nm in enumerate(NM):
        tifffile.imwrite(place / f"cave/scene_{nm:.0f}nm.tif", (cube[:, :, k] * 65535).astype("u2"), photometric="minisblack")
    (place / "cave-png").mkdir()
    for k in range(len(NM)):
        Image.fromarray((cube[:, :, k] * 65535).astype("u2")).save(place / f"cave-png/scene_ms_{k + 1:02d}.png")
    with OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}, {f"w{nm:.0f}nm": np.ascontiguousarray(cube[:, :, k]) for k, nm in enumerate(NM)}) as exr:
        exr.write(str(place / "kaist.exr"))
    rgb = {f"ViewLayer.Combined.{c}": np.ones((64, 64), np.float32) for c in "RGBA"}
    with OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}, rgb) as exr:
        exr.write(str(place / "blender.exr"))
    rgba = np.random.default_rng(1).integers(0, 256, (64, 64, 4), np.uint8)
    rgba[..., 3] = 255
    Image.fromarray(rgba).save(place / "photo.png")
    Image.fromarray(rgba[..., :3]).save(place / "photo.jpg")
    rgba[..., 3] = 100
    Image.fromarray(rgba).save(place / "transparent.png")
    tifffile.imwrite(place / "bands.tif", np.moveaxis((cube * 1e4).astype("u2"), 2, 0), photometric="minisblack", planarconfig="separate")
    rgb = (255 * cube[..., :3]).astype("u1")
    with h5py.File(place / "icvl-rgb.mat", "w") as f:
        f["rad"], f["rgb"], f["bands"] = cube.transpose(2, 1, 0), rgb.transpose(2, 1, 0), NM
    cube[3, 4, 1] = np.nan
    np.save(place / "nan.npy", cube)
    np.save(place / "nan-1.npy", cube[:, :, 1])
    rgba[..., 3] = 255
    tifffile.imwrite(place / "opaque.tif", rgba, photometric="rgb", extrasamples=["unassalpha"])
    (place / "notes.xyz").write_text("1 2 3")


def inputs(place):
    axes = ["--axes", "y,x,wavelength", *GIVEN]
    run = lambda name, chart, *flags, **expected: task(name, ["run", chart, f"{name.replace(' ', '-')}.zarr", *LENS, *flags], place, **expected)
    run("npy with axes", "cube.npy", *axes, err=["chart of 64x64 px", "shards in"])
    run("npy without axes", "cube.npy", *GIVEN, code=1, err=["--axes y,x,wavelength"])
    run("mat of version 7.3", "icvl.mat//rad", err=["rad [64, 64, 5] as MATLAB shows it"])
    run("mat of version 5 without wavelengths", "old.mat", code=2, err=["has no wavelengths", "--wavelengths 400:700:10"])
    run("several arrays", "two.h5", code=1, err=["several have three axes", "--var"])
    run("one of several arrays", "two.h5", "--var", "b", *axes)
    run("NetCDF 4", "cube.nc", err=["scale_factor"])
    run("NetCDF 3", "classic.nc", code=1, err=["NetCDF-3", "xarray"])
    run("Zarr of xarray", "cube.zarr//radiance")
    run("folder of pictures", "cave", err=["integers", "scene_450nm.tif (450 nm)"])
    run("pattern of pictures", "cave/*.tif")
    run("folder of PNG", "cave-png", *GIVEN, err=["in this order: scene_ms_01.png", "integers"])
    run("folder of PNG without wavelengths", "cave-png", code=2, err=["--wavelengths"])
    run("OpenEXR", "kaist.exr")
    for dtype in ("i2", "i4", "u4"):
        np.save(place / f"{dtype}.npy", (1000 * np.random.default_rng(2).random((len(NM), 64, 64))).astype(dtype))
        run(f"npy of {dtype}", f"{dtype}.npy", *GIVEN, "--axes", "wavelength,y,x", err=["integers"])
    task("chart of an OpenEXR of a renderer", ["chart", "image", "blender.exr", "blender.zarr", "--film-pitch-um", "2"], place, err=["layer ViewLayer.Combined"])
    for picture in ("photo.png", "photo.jpg", "opaque.tif"):
        task(f"chart of {picture}", ["chart", "image", picture, f"{picture}.zarr", "--pitch-um", "2"], place)
    task("transparent picture", ["chart", "image", "transparent.png", "no.zarr"], place, code=1, err=["alpha"])
    few = ["chart", "image", "photo.png", "few.zarr", "--film-pitch-um", "2", "--wavelengths", "450,550,610"]
    task("picture in three bands", few, place, code=2, err=["--max-colour-error"])
    task("picture in three bands, nearest colours", [*few, "--max-colour-error", "25%"], place, err=["colours in error by up to"])
    run("TIFF of bands", "bands.tif", *GIVEN, "--chart-scale", "1e-4", err=["multiplied by 0.0001"])
    run("unknown format", "notes.xyz", code=1, err=["unsupported format .xyz; supported:"])
    run("missing file", "nowhere.npy", code=1, err=["nowhere.npy", "not found"])
    run("NaN", "nan.npy", *axes, code=1, err=["row 3, column 4", "--nan zero"])
    run("NaN as zero", "nan.npy", *axes, "--nan", "zero", err=["1 NaN"])
    one = ["run", "nan-1.npy", "nan-1.zarr", *LENS, "--wavelengths", "500"]
    task("NaN in one band", one, place, code=1, err=["--nan zero"])
    task("the same film with NaN as zero", [*one, "--nan", "zero"], place, err=["has no shard yet: it begins again"])
    run("radiance beside a preview", "icvl-rgb.mat", *GIVEN, err=["rad"])
    task("pitch in mm", ["run", "cube.zarr//radiance", "mm.zarr", "--lens", "double-gauss-28-npz", "--interpolate-psf", "--film-pitch-um", "0.005"], place, code=2, err=["--film-pitch-um 5"])
    films = [xarray.open_zarr(place / f"{name}.zarr", consolidated=False).film.values for name in ("mat-of-version-7.3", "npy-with-axes", "Zarr-of-xarray")]
    require("equal films of .mat, .npy and Zarr", all(np.array_equal(films[0], f) for f in films[1:]))


def lenses(place):
    """A design file, a table of a patent, a near object, lenses side by side; quick tables instead of PSFs."""
    shutil.copy(DESIGN, place / "MY.zmx")
    chart = "gen:composite?size=64&pitch_um=5&wavelengths=550"
    quick = ["--stages", "ri,distortion"]
    task("lens show", ["lens", "show", "MY.zmx"], place, out=["effective focal length", "Strehl"])
    task("run with a .zmx", ["run", chart, "zmx.zarr", "--lens", "MY.zmx", *quick], place, err=["1 shard in"])
    task("run with a .zmx and flags of its trace", ["run", chart, "rms.zarr", "--lens", "MY.zmx", "--image-plane", "rms", "--energy", "0.95", *quick], place, err=["1 shard in"])
    task("design to a table", ["lens", "convert", "MY.zmx", "MY.csv"], place)
    task("run with a table", ["run", chart, "table.zarr", "--lens", "MY.csv", *quick], place)
    task("lens pack", ["lens", "trace", "MY.zmx", "MY.lens.zarr", "--wavelengths", "550", "--max-height-mm", "2", "--heights", "0,1,2"], place, err=["use it with"])
    task("pack beside its design", ["lens", "diff", "MY.zmx", "MY.lens.zarr"], place, out=["psf_l1 0.00"])
    task("template of tables", ["lens", "import", "--template", "my-lens"], place, err=["README.md"])
    task("import of the template", ["lens", "import", "my-lens", "my-lens.lens.zarr"], place, err=["2 bands"])
    near = ["lens", "trace", "macro-100", "NEAR.lens.zarr", "--object-distance-mm", "400", "--image-plane", "paraxial", "--wavelengths", "550", "--max-height-mm", "2", "--heights", "0,1,2"]
    task("lens pack of a near object", near, place)
    task("near object", ["run", chart, "near.zarr", "--lens", "NEAR.lens.zarr", "--chart-pitch-mm", "0.02", *quick], place)
    task("near object without a distance", ["run", chart, "no.zarr", "--lens", "macro-100", "--chart-pitch-mm", "0.02"], place, code=2, err=["--object-distance-mm"])
    task("film beyond the field", ["run", "gen:uniform?size=1000&wavelengths=550", "beyond.zarr", "--lens", "phone", "--film-pitch-um", "8", *quick, "--dry-run"], place, code=None, err=["beyond the outermost field point"])
    task("pitch in mm", ["run", chart, "no.zarr", "--lens", "phone", "--film-pitch-um", "0.005"], place, code=2, err=["in mm? Then give `--film-pitch-um 5`"])
    task("wavelengths in µm", ["run", "cube.npy", "no.zarr", "--axes", "y,x,wavelength", "--wavelengths", "0.45:0.65:0.05"], place, code=2, err=["in µm? Then it is 450 nm"])
    task("film of another job of a design", ["run", chart, "zmx.zarr", "--lens", "MY.zmx", "--film-pitch-um", "4", *quick], place, code=3, err=["--film-pitch-um (film 5.0, requested 4.0)"])
    task("lens that does not exist", ["run", chart, "no.zarr", "--lens", "double-gaus-28"], place, code=2, err=["double-gaus-28"])


def tools(place):
    """View, validate, pipes, completions and manual."""
    view = start(["view", "film.zarr", "--port", "0"], place)
    # The address; nothing if the server did not start.
    address = view.stdout.readline().decode().strip()
    page = urllib.request.urlopen(address, timeout=30).read() if address else b""
    require("view serves a page", b"<html" in page)
    view.send_signal(signal.SIGINT)
    view.communicate(timeout=30)
    task("validate", ["validate", "--lens", "double-gauss-28-npz", "--wavelengths", "550", "--size", "4096", "--out", "report"], place, err=["worst of 1 band:", "report.html"])
    require("validation of another film is not compared with the paper", "98.7 %" not in (place / "report/report.html").read_text())
    task("help names the limits of --size", ["validate", "--help"], place, out=["4096 to 100000"])
    piped = subprocess.run(f"{LENSCUBE} export film.zarr - --format npy -q | {sys.executable} -c 'import sys, io, numpy; print(numpy.load(io.BytesIO(sys.stdin.buffer.read())).shape)'",
                           shell=True, cwd=place, capture_output=True, text=True)
    require("NPY through a pipe", piped.stdout.startswith("(2,"))
    task("bands of a GDAL raster", ["export", "film.zarr", "bands-out.tif", "--format", "tiff-bands"], place)
    task("completions", ["completions", "bash"], place, out=["double-gauss-28", "noise.prnu="])
    task("manual", ["man", "man1"], place)
    require("manual pages have exit codes, environment, files, examples", all(f".SH {s}" in (place / "man1/lenscube-run.1").read_text() for s in ('EXAMPLES', '"EXIT STATUS"', '"ENVIRONMENT"', '"FILES"')))


def camera(place):
    """Films, raws and pictures of them; what does not fit is said before work."""
    pack = ["--lens", "double-gauss-28-npz"]
    shoot = ["shoot", "photo.jpg", "shot.png", *pack, "--sensor", "example-2um", "--film-pitch-um", "2"]
    task("picture of a photograph", shoot, place, err=["4/4  picture"])
    require("its size", Image.open(place / "shot.png").size == (64, 64))
    task("picture again", shoot, place, code=3, err=["--overwrite"])
    task("no exposure", [*shoot, "--overwrite", "--exposure", "0"], place, code=2, err=["--exposure 0"])
    task("pixels of the film larger than the sensor's", [*shoot[:-1], "5", "--overwrite"], place, code=2, err=["--film-pitch-um 2"])
    require("nothing was left behind", not list(place.glob("shot.png.*")))
    chart = "gen:checker?size=96&pitch_um=2&wavelengths=450,550,650&illuminant=A"
    task("film of a chart under A", ["run", chart, "lit.zarr", *pack, "--interpolate-psf"], place)
    sensor = lambda out, *more: ["sensor", "lit.zarr", out, "--sensor", "example-2um", "--exposure", "auto", *more]
    task("raw", sensor("lit.raw.zarr"), place)
    task("digital numbers as a picture", sensor("dn.tif"), place, err=["--keep-dn"])
    task("digital numbers as they are", sensor("kept.tif", "--keep-dn"), place)
    require("12 bits", tifffile.imread(place / "kept.tif").max() <= 4095 < tifffile.imread(place / "dn.tif").max())
    task("negative of another light", sensor("lit.dng", "--white", "D65"), place)
    task("raw of another sensor", ["sensor", "lit.zarr", "mono.raw.zarr", "--sensor", "ideal-mono", "--exposure", "auto"], place)
    task("two sensors side by side", ["compare", "lit.raw.zarr", "mono.raw.zarr", "--out", "sensors"], place)
    task("film with another grid of PSFs", ["run", chart, "lit-4.zarr", *pack, "--interpolate-psf", "--azimuths", "4"], place)
    task("two films band by band", ["compare", "lit.zarr", "lit-4.zarr", "--out", "films"], place)
    for out in ("a.exr", "b.exr"):
        task(f"export {out}", ["export", "lit.zarr", out], place)
    require("the same bytes", (place / "a.exr").read_bytes() == (place / "b.exr").read_bytes())
    task("a figure that is no picture", ["measure", "lit.zarr", "--points", "48,48", "--plot", "x.pdf"], place, code=2, err=[".svg"])
    task("former names of size and pitch", ["chart", "uniform", "old.zarr", "--size", "32", "--pitch-um", "2"], place)
    plan = ["plan", chart, "units.zarr", *pack, "--interpolate-psf", "-o", "units.json"]
    task("plan of a unit for each band", plan, place)
    require("three units", len(json.loads((place / "units.json").read_text())["units"]) == 3)
    task("its units", ["run", "--plan", "units.json", "--unit", "0-2"], place)
    done = task("none is missing", ["status", "--plan", "units.json", "--missing"], place).decode().strip()
    task("no unit", ["run", "--plan", "units.json", "--unit", done], place, err=["nothing to do"])
    np.save(place / "three.npy", np.ones((96, 96, 3), np.float32))
    view = start(["view", "lit.zarr", "--chart", "three.npy", "--axes", "y,x,wavelength", "--port", "0"], place)
    require("view of a film beside an array, whose wavelengths are the film's", view.stdout.readline().startswith(b"http"))
    view.send_signal(signal.SIGINT)
    view.communicate(timeout=30)


def full_disk(place):
    """A film larger than the disk is refused before it is created."""
    huge = ["run", "gen:uniform?size=300000&wavelengths=450,550", "huge.zarr", "--lens", "double-gauss-28-npz", "--stages", "ri", "--outside", "clamp", "--codec", "none", "--interpolate-psf", "--shard", "512"]
    task("film larger than the disk", huge, place, code=75, err=["--force"])
    require("nothing was created", not (place / "huge.zarr").exists())


def every_day(place):
    film = ["run", "gen:composite?size=1500&wavelengths=450,550", "film.zarr", "--lens", "double-gauss-28-npz", "--film-pitch-um", "2", "--shard", "512", "--interpolate-psf", "--device", "cpu"]
    task("dry run", [*film, "--dry-run"], place, out=["writes  film.zarr: 18 of 18 shards", "memory  "])
    process = stopped_in_film(film, place)
    task("second run of the same film", film, place, code=75)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    task("status of a killed run", ["status", "film.zarr"], place, out=["incomplete", "source  chart gen:composite"])
    task("the same command resumes", film, place, err=["resuming"])
    task("complete film", film, place, err=["nothing to do"])
    task("film of another job", [*film, "--scale", "2"], place, code=3, err=["--scale", "--overwrite"])
    task("verify", ["verify", "film.zarr"], place)
    task("status", ["status", "film.zarr", "--json"], place, out=['"complete": true'])
    task("export", ["export", "film.zarr", "film.exr"], place)
    task("export opened as a chart", ["export", "film.exr", "again.npy"], place)
    require("the same samples again", np.array_equal(np.load(place / "again.npy"), xarray.open_zarr(place / "film.zarr", consolidated=False).film.values))
    png = task("export to a pipe", ["export", "film.zarr", "-", "-q"], place)
    require("the pipe holds a PNG", png.startswith(b"\x89PNG"))
    task("export of a band", ["export", "film.zarr", "band.npy", "--band", "550"], place)
    task("export without overwriting", ["export", "film.zarr", "film.exr"], place, code=3, err=["--overwrite"])
    edge = "gen:slanted-edge?size=301&angle_deg=5&overscan=67&wavelengths=500"
    task("measure an edge", ["measure", edge, "--edge", "222,157,212,277", "--csv", "edge.csv"], place, out=["MTF50", "lp/mm"])
    rows = [line.count(",") for line in (place / "edge.csv").read_text().splitlines()]
    require("columns of the CSV", len(set(rows)) == 1)
    task("measure not on the edge", ["measure", edge, "--edge", "238,157,228,277"], place, code=2, err=["not on the edge"])
    task("bands by wavelength", [*film[:2], "one.zarr", *film[3:], "--bands", "500:600"], place, err=["1 band,"])
    task("bands by index, as before", [*film[:2], "two.zarr", *film[3:], "--bands", "0"], place, err=["'#0'"])
    task("plan", ["plan", *film[1:2], "planned.zarr", *film[3:-2], "-o", "job.json"], place)
    task("units of the plan", ["run", "--plan", "job.json"], place)
    task("missing units", ["status", "--plan", "job.json", "--missing"], place)
    process = start([*film[:2], "quiet.zarr", *film[3:], "-q"], place)
    stdout, stderr = process.communicate()
    require("quiet run", (process.returncode, stdout, stderr) == (0, b"", b""))
    process = start([*film[:2], "stopped.zarr", *film[3:]], place)
    # The film is created after the handler of signals is installed.
    while not (place / "stopped.zarr").exists() and process.poll() is None:
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    process.communicate()
    require("Ctrl-C", process.returncode in (0, 130))
    task("lenses", ["lens", "show", "double-gauss-28-npz"], place, out=["focal length"])
    task("cache", ["cache"], place, out=["traced band"])
    lines = start([*film[:2], "lines.zarr", *film[3:], "--progress", "jsonl"], place).communicate()[0].splitlines()
    require("progress for programs", [json.loads(line)["event"] for line in (lines[0], lines[-1])] == ["start", "done"])


with tempfile.TemporaryDirectory() as tmp:
    place = Path(tmp)
    write_charts(place)
    for part in (inputs, lenses, every_day, tools, camera, full_disk):
        part(place)
print(f"{len(failed)} tasks failed" + "".join(f"\n  {name}" for name in failed))
sys.exit(bool(failed))
