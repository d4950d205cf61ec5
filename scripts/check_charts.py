"""Charts as other programs write them: the film of each is that of the same samples in a Zarr store, bit for bit after scaling. Run by
check-interop. Three cubes have the shape of public data sets: CAVE (a folder of 16-bit PNG), ICVL (MATLAB 7.3), KAIST (OpenEXR).
Also: CSV files of the program in pandas."""
import json
import re
import subprocess
import tempfile
import warnings
from pathlib import Path

import h5py
import hdf5storage
import numpy as np
import OpenEXR
import pandas
import rasterio
import scipy.io
import tifffile
import xarray
import zarr
from PIL import Image

import interop
from interop import LENSCUBE, check, identity_pack, lenscube

warnings.simplefilter("ignore")
NM = np.arange(400.0, 705.0, 10.0)
ROWS, COLUMNS = 48, 64


class Films:
    """Films of charts of ROWS x COLUMNS px behind an identity lens."""

    def __init__(self, scratch):
        self.scratch, self.pack = scratch, scratch / "identity.lens.zarr"
        identity_pack(self.pack, NM)

    def of(self, chart, *flags):
        out = self.scratch / "film.zarr"
        lenscube("run", chart, out, "--lens", self.pack, "--film-pitch-um", 2, "--no-fsync", "--codec", "none", "--overwrite", "-q", *flags)
        return zarr.open_group(out, mode="r")["film"][:]

    def of_zarr(self, cube, *flags, **attributes):
        """The film of samples (wavelength, y, x) in a Zarr store."""
        path = self.scratch / "twin.zarr"
        group = zarr.open_group(path, mode="w", zarr_format=3)
        group.create_array("chart", data=np.ascontiguousarray(cube), attributes=attributes)
        return self.of(path, "--wavelengths", ",".join(map(str, NM[: len(cube)])), *flags)

    def same(self, name, film, expected):
        equal = film.shape == expected.shape and np.array_equal(film.view("u4"), expected.view("u4"))
        check(equal, f"{name}: another film than that of its Zarr twin")


def pictures(films, cube, scratch):
    counts = (cube * 65535).astype("u2")
    expected = films.of_zarr(counts)
    cave = scratch / "balloons_ms"
    cave.mkdir()
    for k, band in enumerate(counts):
        Image.fromarray(band).save(cave / f"balloons_ms_{k + 1:02d}.png")
    films.same("CAVE, folder", films.of(cave, "--wavelengths", "400:700:10"), expected)
    films.same("CAVE, pattern", films.of(f"{cave}/*.png", "--wavelengths", "400:700:10"), expected)
    named = scratch / "named"
    named.mkdir()
    for nm, band in zip(NM, counts):
        tifffile.imwrite(named / f"scene_{nm:.0f}nm.tif", band, photometric="minisblack", compression="zlib")
    films.same("TIFF pictures with wavelengths in their names", films.of(named), expected)
    Image.fromarray(counts[0][:, :-1]).save(cave / "balloons_ms_07.png")
    failed = subprocess.run([LENSCUBE, "run", cave, scratch / "no.zarr", "--wavelengths", "400:700:10"], capture_output=True, text=True)
    check(failed.returncode == 1 and "balloons_ms_07.png" in failed.stderr, f"a smaller picture: {failed.stderr}")


def matlab_and_hdf5(films, cube, scratch):
    last = np.ascontiguousarray(np.moveaxis(cube, 0, 2))
    expected = films.of_zarr(cube)
    icvl = scratch / "icvl.mat"
    hdf5storage.write({"rad": last, "bands": NM, "rgb": last[:, :, :3]}, filename=str(icvl), matlab_compatible=True, compress_size_threshold=0)
    films.same("ICVL", films.of(f"{icvl}//rad"), expected)
    with h5py.File(scratch / "h5py.h5", "w") as f:
        f.create_dataset("cube", data=last, chunks=(16, 64, 8), compression="gzip", shuffle=True)
        f["wavelengths"] = NM
    films.same("h5py", films.of(scratch / "h5py.h5", "--var", "cube", "--axes", "y,x,wavelength"), expected)
    scipy.io.savemat(scratch / "old.mat", {"rad": last})
    films.same(".mat of version 5", films.of(scratch / "old.mat", "--wavelengths", "400:700:10"), expected)


def xarray_files(films, cube, scratch):
    last = xarray.Dataset({"reflectance": (("y", "x", "wavelength"), np.moveaxis(cube, 0, 2))}, {"wavelength": ("wavelength", NM, {"units": "nm"})})
    packing = {"dtype": "u2", "scale_factor": 1e-4, "add_offset": -0.25, "_FillValue": 65535}
    last.to_netcdf(scratch / "raw.nc", engine="h5netcdf", encoding={"reflectance": packing})
    with h5py.File(scratch / "raw.nc") as file:
        packed = np.moveaxis(file["reflectance"][:], 2, 0)
    expected = {False: films.of_zarr(cube), True: films.of_zarr(packed, scale_factor=1e-4, add_offset=-0.25)}
    for dims in [("wavelength", "y", "x"), ("y", "x", "wavelength"), ("x", "wavelength", "y")]:
        for is_packed in (False, True):
            encoding = {"reflectance": packing if is_packed else {}}
            name = f"{''.join(d[0] for d in dims)}-{is_packed}"
            ordered = last.transpose(*dims)
            ordered.to_netcdf(scratch / f"{name}.nc", engine="h5netcdf", encoding=encoding)
            films.same(f"{name}.nc", films.of(scratch / f"{name}.nc"), expected[is_packed])
            ordered.to_zarr(scratch / f"{name}.zarr", consolidated=False, encoding=encoding)
            films.same(f"{name}.zarr", films.of(f"{scratch / name}.zarr//reflectance"), expected[is_packed])


def rasters(films, cube, scratch):
    """GeoTIFF and ENVI of GDAL: planar and chunky, tiled and stripped, with wavelengths and scale."""
    few, nm = cube[:5], NM[:5]
    for dtype, scale in [("float32", None), ("uint16", 1e-4), ("uint8", 1 / 256)]:
        data = few if scale is None else (few / scale).astype(dtype)
        attributes = {} if scale is None else {"scale_factor": scale}
        expected = films.of_zarr(data, **attributes)
        for interleave in ("band", "pixel"):
            for tiled, predictor in [(False, 1), (True, 1), (True, 2), (True, 3)]:
                if predictor == (3 if scale else 2):
                    continue  # of integers; of floats
                file = scratch / f"{dtype}-{interleave}-{tiled}-{predictor}.tif"
                blocks = {"tiled": True, "blockxsize": 32, "blockysize": 16, "predictor": predictor} if tiled else {}
                with rasterio.open(file, "w", driver="GTiff", width=COLUMNS, height=ROWS, count=5, dtype=dtype, interleave=interleave,
                                   photometric="minisblack", compress="deflate", **blocks) as out:
                    out.write(data)
                    for band, wavelength in enumerate(nm, 1):
                        out.update_tags(band, WAVELENGTH=f"{wavelength}", WAVELENGTH_UNITS="Nanometers")
                    if scale:
                        out.scales = (scale,) * 5
                films.same(file.name, films.of(file), expected)
    file = scratch / "gdal.bsq"
    with rasterio.open(file, "w", driver="ENVI", width=COLUMNS, height=ROWS, count=5, dtype="float32") as out:
        out.write(few)
    films.same("ENVI of GDAL", films.of(file.with_suffix(".hdr"), "--wavelengths", "400:440:10"), films.of_zarr(few))


def flat(films, cube, scratch):
    expected = films.of_zarr(cube)
    last = np.ascontiguousarray(np.moveaxis(cube, 0, 2))
    for name, array, axes in [("c", cube, "wavelength,y,x"), ("fortran", np.asfortranarray(cube), "wavelength,y,x"), ("last", last, "y,x,wavelength")]:
        np.save(scratch / f"{name}.npy", array)
        films.same(f"{name}.npy", films.of(scratch / f"{name}.npy", "--axes", axes, "--wavelengths", "400:700:10"), expected)
    kaist = scratch / "kaist.exr"
    with OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}, {f"w{nm:.0f}nm": b for nm, b in zip(NM, cube)}) as exr:
        exr.write(str(kaist))
    films.same("KAIST", films.of(kaist), expected)
    counts = (cube * 1e4).astype("u2")
    np.save(scratch / "counts.npy", counts)
    scaled = films.of(scratch / "counts.npy", "--wavelengths", "400:700:10", "--chart-scale", "1e-4")
    films.same("counts with --chart-scale", scaled, films.of_zarr(counts, scale_factor=1e-4))


def colour_pictures(scratch):
    """PNG with an opaque alpha, lossless WebP and JPEG of Pillow become the same chart as the PNG of their pixels."""
    rgb = np.random.default_rng(3).integers(0, 256, (20, 30, 3), np.uint8)
    rgb = np.asarray(Image.fromarray(rgb).resize((120, 80), Image.Resampling.BICUBIC))

    def chart(file):
        out = file.with_suffix(file.suffix + ".zarr")
        lenscube("chart", "image", file, out, "--wavelengths", "400:700:20", "-q")
        return zarr.open_group(out, mode="r")["chart"][:]

    Image.fromarray(rgb).save(scratch / "plain.png")
    expected = chart(scratch / "plain.png")
    Image.fromarray(rgb).convert("RGBA").save(scratch / "opaque.png")
    Image.fromarray(rgb).save(scratch / "lossless.webp", lossless=True)
    for name in ("opaque.png", "lossless.webp"):
        check(np.array_equal(chart(scratch / name), expected), f"{name}: another chart than that of the PNG")
    Image.fromarray(rgb).save(scratch / "photo.jpg", quality=92, subsampling=0)
    Image.open(scratch / "photo.jpg").save(scratch / "decoded.png")
    # Decoders of JPEG round the colour conversion differently, by a few codes.
    error = np.abs(chart(scratch / "photo.jpg") - chart(scratch / "decoded.png"))
    check(error.mean() < 0.5 / 255 and error.max() < 10 / 255, f"photo.jpg: differs from its pixels by {error.mean()}, at most {error.max()}")
    half = np.dstack([rgb, np.full(rgb.shape[:2], 128, np.uint8)])
    Image.fromarray(half).save(scratch / "alpha.png")
    failed = subprocess.run([LENSCUBE, "chart", "image", scratch / "alpha.png", scratch / "no.zarr"], capture_output=True, text=True)
    check(failed.returncode == 1 and "alpha" in failed.stderr, f"alpha.png: {failed.stderr}")


def tables(scratch):
    """CSV files of the program: headings and fields are equal in number, and numbers are numbers."""
    lenscube("measure", "gen:slanted-edge?size=301&angle_deg=5&overscan=67&wavelengths=500,600", "--edge", "222,157,212,277", "--csv", scratch / "edge.csv")
    lenscube("measure", "gen:points?size=301&count=3&overscan=10&wavelengths=550", "--points", "161,159;16.5,17", "--half-px", 8, "--csv", scratch / "points.csv")
    lenscube("sensor", "validate", "ideal-mono", "--out", scratch / "emva")
    lenscube("run", "gen:checker?size=300&pitch_um=2", scratch / "checker.zarr", "--lens", "double-gauss-28-npz", "--stages", "ri", "-q")
    for seed in (1, 2):
        lenscube("sensor", scratch / "checker.zarr", scratch / f"raw{seed}.zarr", "--sensor", "example-2um", "--exposure", "auto", "--seed", seed, "-q")
    lenscube("compare", scratch / "raw1.zarr", scratch / "raw2.zarr", "--out", scratch / "compared", "--patch", "20,20,30,30")
    files = [*scratch.glob("*.csv"), *scratch.glob("emva/*.csv"), *scratch.glob("compared/*.csv")]
    check(len(files) >= 6, f"tables: {files}")
    for file in files:
        table = pandas.read_csv(file, index_col=False)
        widths = {line.count(",") for line in re.sub('"[^"]*"', "", file.read_text()).splitlines()}
        check(len(table) and widths == {len(table.columns) - 1}, f"{file.name}: {list(table.columns)}, commas {widths}")
        words = {"name", "figure", "plane", "raw", "edge", "direction"}
        check(all(table[c].dtype.kind in "if" for c in table.columns if c not in words), f"{file.name}: {table.dtypes}")


with tempfile.TemporaryDirectory() as tmp:
    scratch = Path(tmp)
    cube = np.random.default_rng(7).random((len(NM), ROWS, COLUMNS), np.float32)
    films = Films(scratch)
    for part in (pictures, matlab_and_hdf5, xarray_files, rasters, flat):
        (scratch / part.__name__).mkdir()
        part(films, cube, scratch / part.__name__)
    colour_pictures(scratch)
    tables(scratch)
print(f"{interop.done} checks: charts of Pillow, tifffile, SciPy, h5py, hdf5storage, xarray, GDAL {rasterio.__gdal_version__} and OpenEXR are read as their Zarr twins; "
      f"pandas {pandas.__version__} reads the tables")
