"""The files that commands of the documents read: name → maker, and the names that each page needs. They are small."""
import json
import shutil
import struct
import subprocess
from pathlib import Path

import h5py
import numpy as np
import OpenEXR
import tifffile
import xarray
from PIL import Image

ROOT = Path(__file__).resolve().parent.parent
DESIGN = ROOT / "formats/data/lenses/double-gauss-28.zmx"
NM = np.arange(400.0, 701.0, 10.0)
PX = 64


def cube(bands=len(NM), px=PX):
    """Axes (y, x, wavelength), values from 0 to 1."""
    return np.random.default_rng(5).random((px, px, bands), np.float32)


def tilted_film(path):
    """The design with its film tilted by 2 degrees."""
    before, image = DESIGN.read_text().rsplit("SURF ", 1)
    number, rest = image.split("\n", 1)
    Path(path).write_text(f"{before}SURF {number}\n  TYPE COORDBRK\n  PARM 3 2\n  DISZ 0\nSURF {int(number) + 1}\n{rest}")


def few(bands):
    """A cube of `bands` bands from 450 nm in steps of 50 nm, as (wavelength, y, x)."""
    return np.moveaxis(cube(bands), 2, 0), 450 + 50.0 * np.arange(bands)


def cube_zarr(path, lenscube):
    lenscube("chart", "composite", path, "--size", PX, "--wavelengths", "450:650:50", "--pitch-um", 5)


def chart_zarr(path, lenscube):
    """Large enough for a region of interest, with the thirteen units that a plan's example names."""
    lenscube("chart", "composite", path, "--size", 1000, "--wavelengths", "440:680:20", "--pitch-um", 2)


def scene_zarr(path, lenscube):
    lenscube("chart", "depth-scene", path, "--size", PX, "--wavelengths", "550", "--pitch-um", 2)


def scene_side():
    return PX + 2 * 65  # the overscan of a chart of 64 px: 1 % and 64 px


def film_zarr(path, lenscube):
    lenscube("run", f"gen:composite?size={PX}&wavelengths=450:650:50&pitch_um=5", path, "--lens", "double-gauss-28")


def raw(path, lenscube, seed):
    film = path.parent / f"{path.name}.film.zarr"
    film_zarr(film, lenscube)
    lenscube("sensor", film, path, "--sensor", "cmv12000-rgb", "--exposure", "auto", "--seed", seed)


def envi(path, _):
    values, nm = few(3)
    path.with_suffix(".dat").write_bytes(values.tobytes())
    path.write_text(f"ENVI\nsamples = {PX}\nlines = {PX}\nbands = 3\ndata type = 4\ninterleave = bsq\nbyte order = 0\nheader offset = 0\n"
                    f"wavelength units = Nanometers\nwavelength = {{{', '.join(map(str, nm))}}}\n")


def matlab(path, _):
    """MATLAB 7.3: HDF5 with the axes in reverse order and the class of each array."""
    values, nm = few(3)
    with h5py.File(path, "w", userblock_size=512) as f:
        for name, array in (("rad", values.transpose(0, 2, 1).astype("f8")), ("bands", nm)):
            f.create_dataset(name, data=array).attrs["MATLAB_class"] = np.bytes_("double")
    with open(path, "r+b") as f:
        f.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(116) + bytes(8) + b"\x00\x02IM")


def cave(path, _):
    path.mkdir()
    for k, band in enumerate(np.moveaxis(cube(), 2, 0)):
        Image.fromarray((band * 65535).astype("u2")).save(path / f"scene_ms_{k + 1:02d}.png")


def tiff(path, _):
    """As GDAL writes it, with a wavelength for each band."""
    values, nm = few(3)
    items = "".join(f'<Item name="wavelength" sample="{k}">{v}</Item><Item name="wavelength_units" sample="{k}">nm</Item>' for k, v in enumerate(nm))
    metadata = (42112, "s", 0, f"<GDALMetadata>{items}</GDALMetadata>", True)
    tifffile.imwrite(path, (values * 1e4).astype("u2"), photometric="minisblack", planarconfig="separate", extratags=[metadata])


def depth_exr(path, _):
    with OpenEXR.File({"type": OpenEXR.scanlineimage}, {"Z": np.full((scene_side(), scene_side()), 1.05, np.float32)}) as exr:
        exr.write(str(path))


def behind(path, lenscube):
    """The group of a hidden surface: that of a drawn scene."""
    scene = path.parent / "behind-scene.zarr"
    scene_zarr(scene, lenscube)
    shutil.copytree(scene / "hidden/1", path)


def samples(path, _):
    """Raw samples, u16, of a chart of 31 bands of 512 x 512 px."""
    with open(path, "wb") as f:
        f.truncate(31 * 512 * 512 * 2)


def mesh(path, _):
    """glTF: a wall, a square before it, a camera named Cam1."""
    square = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], np.float32)
    corners = np.array([0, 1, 2, 0, 2, 3], np.uint16)
    blob = square.tobytes() + corners.tobytes()
    colours = (0.8, 0.8, 0.7, 1), (0.6, 0.1, 0.1, 1)
    document = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0, 1, 2]}],
        "nodes": [{"name": "Wall", "mesh": 0, "scale": [2, 2, 1], "translation": [0, 0, -2]},
                  {"name": "Card", "mesh": 1, "scale": [0.1, 0.1, 1], "translation": [0.05, 0, -1]}, {"name": "Cam1", "camera": 0}],
        "cameras": [{"type": "perspective", "perspective": {"yfov": 0.5, "znear": 0.01}}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": k}]} for k in range(2)],
        "materials": [{"name": f"paint {k}", "doubleSided": True, "pbrMetallicRoughness": {"baseColorFactor": c}} for k, c in enumerate(colours)],
        "accessors": [{"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": 4, "min": [-1, -1, 0], "max": [1, 1, 0]},
                      {"bufferView": 1, "componentType": 5123, "type": "SCALAR", "count": 6}],
        "bufferViews": [{"buffer": 0, "byteLength": 48}, {"buffer": 0, "byteOffset": 48, "byteLength": 12}],
        "buffers": [{"byteLength": len(blob)}],
    }
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    header = struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(blob))
    path.write_bytes(header + struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(blob), b"BIN\0") + blob)


# Manufacturing errors of double-gauss-28: its rear doublet and the film.
TOLERANCES = """
[[element]]
surfaces = [10, 11]
decentre_um = 20
tilt_arcmin = 1
[[film]]
tilt_arcmin = 3
[criterion]
kind = "rms-spot"
"""

# A sensor that responds to the angle of incidence.
CAMERA = (ROOT / "formats/data/sensors/ideal-mono.toml").read_text() + "\n[angle]\nstack_index = 1.5\nacceptance_deg = 25\n"


def around(path, _):
    """A picture of 360 x 180 degrees: a blue sky, brighter towards the horizon, over a dark ground."""
    rows = np.linspace(1, -1, 64)[:, None, None]
    sky, ground = np.array([90, 140, 220]) + 100 * (1 - rows.clip(0)), np.array([70, 60, 50])
    colours = np.where(rows > 0, sky, ground).clip(0, 255) + np.zeros((64, 128, 3))
    Image.fromarray(colours.astype("u1")).save(path)


def recipe(path, _):
    """The recipe of the page of data sets, with fewer samples, and its pictures with labels and masks."""
    page = (ROOT / "src/manual/guide/datasets.md").read_text()
    table = page[page.index("    schema = "):].split("\n\n")[0]
    path.write_text("\n".join(line[4:] for line in table.splitlines()).replace("samples = 40", "samples = 6"))
    for folder in ("photos", "masks"):
        (path.parent / folder).mkdir()
    rng, images = np.random.default_rng(2), []
    for k in range(3):
        Image.fromarray(rng.integers(0, 256, (90, 120, 3), np.uint8)).save(path.parent / f"photos/{k}.png")
        Image.fromarray(rng.integers(0, 3, (90, 120), np.uint8)).save(path.parent / f"masks/{k}.png")
        images.append({"id": k, "file_name": f"{k}.png", "width": 120, "height": 90})
    annotations = [{"id": k, "image_id": k, "category_id": 1, "bbox": [20, 20, 60, 40]} for k in range(3)]
    labels = {"images": images, "annotations": annotations, "categories": [{"id": 1, "name": "thing"}]}
    (path.parent / "labels.json").write_text(json.dumps(labels))


MAKERS = {
    "recipe.toml": recipe,
    "cube.zarr": cube_zarr,
    "room.glb": mesh,
    "sky.png": around,
    "chart.zarr": chart_zarr,
    "scene.zarr": scene_zarr,
    "film.zarr": film_zarr,
    "raw.zarr": lambda path, lenscube: raw(path, lenscube, 1),
    "lens-a.zarr": film_zarr,
    "lens-b.zarr": film_zarr,
    "lens-a.raw.zarr": lambda path, lenscube: raw(path, lenscube, 1),
    "lens-b.raw.zarr": lambda path, lenscube: raw(path, lenscube, 2),
    "cube.npy": lambda path, _: np.save(path, cube()),
    "cube.hdr": envi,
    "cube.mat": matlab,
    "cave": cave,
    "cube.tif": tiff,
    "cube.raw": samples,
    "photo.png": lambda path, _: Image.fromarray(np.random.default_rng(1).integers(0, 256, (PX, PX, 3), np.uint8)).save(path),
    "depth.npy": lambda path, _: np.save(path, np.full((scene_side(), scene_side()), 1.05, np.float32)),
    "render.exr": depth_exr,
    "behind.zarr": behind,
    "MY.zmx": lambda path, _: shutil.copy(DESIGN, path),
    "SECRET.zmx": lambda path, _: shutil.copy(DESIGN, path),
    "TILTED.zmx": lambda path, _: tilted_film(path),
    "tol.toml": lambda path, _: path.write_text(TOLERANCES),
    "camera.toml": lambda path, _: path.write_text(CAMERA),
    "cra.csv": lambda path, _: path.write_text("height_mm,cra_deg,f_number\n0,0,2.8\n40,40,2.8\n"),
    "motion.csv": lambda path, _: path.write_text("time_s,x_um,y_um,rotation_deg\n0,0,0,0\n0.01,12,5,0.05\n"),
    "tables": lambda path, _: shutil.copytree(ROOT / "formats/data/tables-example", path),
}

# What a block of Python is given: a cube in memory, an edge in its middle.
PYTHON = """
import lenscube, xarray
lenscube.chart("slanted-edge", "edge-cube.zarr", size=512, overscan=0, wavelengths=[450, 550, 650], pitch_um=5, overwrite=True)
cube = xarray.open_zarr("edge-cube.zarr", consolidated=False).chart.load()
"""
# What blocks of Python with a lens in the process use.
PYTHON_LENS = """
import numpy, scipy.sparse.linalg
batch, points_mm = numpy.stack([cube.values, 1 - cube.values]), [[0.1, 0.2], [0.3, -0.4]]
"""
# What such a block uses of the block before it.
PYTHON_FILM = """
lens = lenscube.Lens("phone", wavelengths=[450, 550, 650], focus_m=1)
film = lens.apply(cube, pitch_um=2)
"""


def python(text):
    """A block of Python with what it needs before it."""
    opens, uses = "lenscube.Lens(" in text, "lens." in text
    return PYTHON + PYTHON_LENS * (opens or uses) + PYTHON_FILM * (uses and not opens) + text


# What the commands of a page need before they begin; they make all else themselves.
PAGES = {
    "README.md": ["cube.zarr", "cube.npy", "MY.zmx", "chart.zarr", "tol.toml", "scene.zarr", "room.glb", "recipe.toml"],
    "camera.md": ["chart.zarr", "photo.png", "film.zarr", "lens-a.zarr", "lens-b.zarr", "lens-a.raw.zarr", "lens-b.raw.zarr", "camera.toml", "cra.csv", "motion.csv"],
    "charts.md": ["cube.zarr", "cube.hdr", "cube.mat", "cave", "cube.tif", "cube.npy", "cube.raw", "photo.png", "motion.csv"],
    "clusters.md": ["chart.zarr"],
    "datasets.md": ["recipe.toml"],
    "depth.md": ["scene.zarr", "MY.zmx", "render.exr", "depth.npy", "behind.zarr"],
    "films.md": ["chart.zarr"],
    "lenses.md": ["MY.zmx", "SECRET.zmx", "TILTED.zmx", "chart.zarr", "tables"],
    "light.md": ["chart.zarr"],
    "restoration.md": ["film.zarr", "raw.zarr"],
    "scenes.md": ["room.glb", "sky.png"],
    "tolerances.md": ["chart.zarr", "tol.toml", "MY.zmx"],
}


def make(page, text, place, program, environment):
    """Makes the inputs of `page`, whose commands are `text`."""
    def lenscube(*words):
        subprocess.run([program, *map(str, words), "-q"], cwd=place, env=environment, check=True)

    for name in PAGES.get(page, ()):
        if name not in text:
            raise ValueError(f"{page}: no command has the input {name}, listed in scripts/document_inputs.py")
        MAKERS[name](place / name, lenscube)
