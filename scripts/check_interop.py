"""Opens charts, films and exports of the program with other programs, and files of those with it; run by check-interop.

Checked: consolidated metadata, dimension names, coordinates and units, NaN as fill value, and values. Values are compared three
times: three readers agree bit for bit; a film equals the golden one; and `run` with an identity lens on the store returns the values
read by Python bit for bit, so the program reads the same numbers.
"""
import json
import tempfile
import warnings
from pathlib import Path

import h5py
import hdf5storage
import imagecodecs
import numpy as np
import OpenEXR
import rasterio
import rasterio.errors
import rawpy
import spectral.io.envi
import tensorstore
import tifffile
import xarray
import zarr

import interop
from interop import GOLDEN, check, identity_pack, lenscube

warnings.simplefilter("error")
# A film has no place on a map.
warnings.simplefilter("ignore", rasterio.errors.NotGeoreferencedWarning)


def same(a, b):
    return a.shape == b.shape and a.dtype == b.dtype and np.array_equal(a.view(f"u{a.itemsize}"), b.view(f"u{b.itemsize}"))


def coordinate_like(found, expected):
    return found.dtype == np.float64 and found.shape == (len(expected),) and np.allclose(found, expected, rtol=1e-14, atol=1e-15)


def read(path, array, dtype, dims, coordinates, units):
    """The pixels, after metadata and values were compared in three readers."""
    at = f"{path.name}/{array}"
    metadata = json.loads((path / "zarr.json").read_text())
    members = metadata.get("consolidated_metadata", {}).get("metadata", {})
    check(set(members) == {array, *coordinates} or "roi_1" in members, f"{at}: consolidated metadata of {sorted(members)}")
    for name, member in members.items():
        check(member == json.loads((path / name / "zarr.json").read_text()), f"{at}: consolidated metadata of {name} differs from its zarr.json")

    a = zarr.open_consolidated(str(path))[array]
    check(a.metadata.dimension_names == dims and a.dtype == dtype, f"{at}: zarr-python reads {a.metadata.dimension_names}, {a.dtype}")
    check(np.isnan(a.fill_value), f"{at}: fill value {a.fill_value}")
    check(a.attrs["units"] == units, f"{at}: units {a.attrs.get('units')}")
    pixels = a[:]

    with xarray.open_zarr(str(path), consolidated=True) as ds:
        x = ds[array]
        check(x.dims == dims and x.attrs["units"] == units, f"{at}: xarray reads {x.dims}, {x.attrs}")
        for name, (values, unit) in coordinates.items():
            c = ds.coords[name] if name in dims else ds[name]
            check(c.dims == (name,) and c.attrs["units"] == unit, f"{at}: coordinate {name} has {c.dims}, {c.attrs}")
            check(coordinate_like(c.values, values), f"{at}: coordinate {name} is {c.values}, expected {values}")
        check(same(x.values, pixels), f"{at}: xarray reads other values than zarr-python")

    t = tensorstore.open({"driver": "zarr3", "kvstore": {"driver": "file", "path": f"{path / array}/"}}, read=True, open=True).result()
    check(t.domain.labels == dims and t.dtype.numpy_dtype == dtype, f"{at}: tensorstore reads {t.domain.labels}, {t.dtype}")
    check(np.isnan(t.fill_value), f"{at}: tensorstore's fill value {t.fill_value}")
    check(same(t.read().result(), pixels), f"{at}: tensorstore reads other values than zarr-python")
    return pixels


def values_in_lenscube(store, array, wavelengths, scratch):
    pack, copy = scratch / "identity.lens.zarr", scratch / f"copy-{store.name}-{array}"
    identity_pack(pack, wavelengths)
    height, width = zarr.open_group(store, mode="r")[array].shape[1:]
    lenscube("run", f"{store}//{array}", copy, "--lens", pack, "--film-size", f"{width}x{height}", "--no-fsync", "--codec", "none")
    return zarr.open_group(copy, mode="r")["film"][:]


def charts(scratch):
    wavelengths = [420.0, 550.0, 600.5]
    for codec in ("none", "lz4", "zstd"):
        path = scratch / f"chart-{codec}.zarr"
        lenscube("chart", "composite", path, "--size", "277x301", "--wavelengths", "420,550,600.5", "--pitch-um", 60, "--overscan", 7, "--codec", codec)
        units = zarr.open_group(path, mode="r").attrs["units"]
        pixels = read(path, "chart", np.float32, ("wavelength", "y", "x"), {"wavelength": (wavelengths, "nm")}, units)
        check(pixels.shape == (3, 315, 291) and pixels.std() > 0, f"{path.name}: {pixels.shape}")
        check(same(values_in_lenscube(path, "chart", wavelengths, scratch), pixels), f"{path.name}: lenscube reads other values than Python")


def films(scratch):
    case = json.loads((GOLDEN / "cases/chain-three-bands/case.json").read_text())
    where = GOLDEN / "cases/chain-three-bands"
    expected = zarr.open_group(where / "expected.zarr", mode="r")["part_0"][:].astype(float)
    bands, height, width = expected.shape
    wavelengths = 450.0 + 50 * np.arange(bands)
    mm = lambda first, n, side: (first + np.arange(n) - (side - 1) / 2) * 2e-3
    run = ("run", where / case["chart"], "--lens", where / case["lens"], *case["flags"], "--no-fsync", "--shard", 64, "--chunk", 32)
    complete = {}
    for dtype, codec in [("f32", "none"), ("f32", "lz4"), ("f32", "zstd"), ("f16", "none"), ("f16", "zstd")]:
        path = scratch / f"film-{dtype}-{codec}.zarr"
        lenscube(*run, path, "--dtype", dtype, "--codec", codec)
        coordinates = {"wavelength": (wavelengths, "nm"), "y": (mm(0, height, height), "mm"), "x": (mm(0, width, width), "mm")}
        pixels = read(path, "film", np.dtype(dtype.replace("f", "float")), ("wavelength", "y", "x"), coordinates, "relative")
        # f32: the accuracy promised. f16: half a unit in the last of 11 bits more.
        error = np.abs(pixels.astype(float) - expected)
        bound = 2e-6 * np.array(case["peak"])[:, None, None] + (0 if dtype == "f32" else 2.0**-11 * np.abs(expected))
        check((error <= bound).all(), f"{path.name}: off by {error.max()}")
        check(same(values_in_lenscube(path, "film", wavelengths, scratch), pixels.astype(np.float32)), f"{path.name}: lenscube reads other values than Python")
        check(dtype not in complete or same(complete[dtype], pixels), f"{path.name}: another codec, other values")
        complete[dtype] = pixels
    for codec in ("none", "lz4", "zstd"):
        path = scratch / f"film-9-bits-{codec}.zarr"
        lenscube(*run, path, "--keep-bits", 9, "--codec", codec)
        pixels = read(path, "film", np.float32, ("wavelength", "y", "x"), coordinates, "relative")
        error = np.abs(pixels.astype(float) - complete["f32"])
        check((error <= 2.0**-10 * np.abs(complete["f32"])).all(), f"{path.name}: off by {error.max()}")
        check(not (pixels.view(np.uint32) & 0x3FFF).any(), f"{path.name}: more than 9 bits")

    path = scratch / "regions.zarr"
    regions = [(3, 5, 64, 70), (100, 116, 17, 5)]
    lenscube(*run, path, *(argument for x, y, w, h in regions for argument in ("--roi", f"{x},{y},{w},{h}")))
    for i, (x, y, w, h) in enumerate(regions):
        names = (f"roi_{i}_y", f"roi_{i}_x")
        coordinates = {"wavelength": (wavelengths, "nm"), names[0]: (mm(y, h, height), "mm"), names[1]: (mm(x, w, width), "mm")}
        pixels = read(path, f"roi_{i}", np.float32, ("wavelength", *names), coordinates, "relative")
        check(same(pixels, np.ascontiguousarray(complete["f32"][:, y:y + h, x:x + w])), f"{path.name}: region {i} is not that part of the film")

    # A missing shard reads as NaN in every program.
    path = scratch / "film-f32-zstd.zarr"
    (path / "film/c/1/0/1").unlink()
    pixels = read(path, "film", np.float32, ("wavelength", "y", "x"), {"wavelength": (wavelengths, "nm"), "y": (mm(0, height, height), "mm"), "x": (mm(0, width, width), "mm")}, "relative")
    missing = np.zeros(pixels.shape, bool)
    missing[1, :64, 64:] = True
    check((np.isnan(pixels) == missing).all(), f"{path.name}: a missing shard is not NaN")


def exports(scratch):
    """Exports of a chart have its bits in NumPy, spectral (ENVI), OpenEXR and tifffile."""
    chart, wavelengths = scratch / "chart-zstd.zarr", [420.0, 550.0, 600.5]
    pixels = zarr.open_group(chart, mode="r")["chart"][:]
    part = np.ascontiguousarray(pixels[1:, 31:231, 17:117])
    crop = ("--crop", "17,31,100,200", "--bands", "#1:")
    for name, expected, flags in [("complete", pixels, ()), ("part", part, crop)]:
        out = lambda extension: scratch / f"{name}.{extension}"
        for extension in ("npy", "hdr", "exr"):
            lenscube("export", chart, out(extension), *flags)
        lenscube("export", chart, out("bands.tif"), "--format", "tiff-bands", *flags)
        check(same(np.load(out("npy")), expected), f"{name}.npy: NumPy reads other values")
        envi = spectral.io.envi.open(out("hdr"))
        check(same(np.ascontiguousarray(envi.open_memmap(interleave="bsq")), expected), f"{name}.hdr: spectral reads other values")
        centers = wavelengths[-len(expected):]
        check(envi.bands.centers == centers and envi.bands.band_unit == "Nanometers", f"{name}.hdr: spectral reads bands at {envi.bands.centers}")
        with tifffile.TiffFile(out("bands.tif")) as file:
            check(file.is_bigtiff and len(file.pages) == 1 and same(file.asarray(), expected), f"{name}.bands.tif: tifffile reads other values")
        with rasterio.open(out("bands.tif")) as raster:
            check(raster.count == len(expected) and not raster.subdatasets, f"{name}.bands.tif: GDAL sees {raster.count} bands, {raster.subdatasets}")
            check(same(raster.read(), expected), f"{name}.bands.tif: GDAL reads other values")
            check([float(raster.tags(b)["wavelength"]) for b in raster.indexes] == centers, f"{name}.bands.tif: GDAL reads {raster.tags(1)}")
            check(raster.units[0] == "W m-2 sr-1 nm-1" and raster.descriptions[-1] == "600.5 nm", f"{name}.bands.tif: {raster.descriptions}, {raster.units}")
        for compression, half in [("zip", False), ("piz", False), ("none", False), ("zip", True)]:
            lenscube("export", chart, out("exr"), *flags, "--compression", compression, "--overwrite", *(["--half"] if half else []))
            with OpenEXR.File(str(out("exr")), separate_channels=True) as exr:
                header, channels = exr.header(), exr.channels()
                check(header["spectralLayoutVersion"] == "1.0" and header["emissiveUnits"] == "W m-2 sr-1 nm-1", f"{name}.exr: {header}")
                names = [f"S0.{nm:.6f}nm".replace(".", ",").replace(",", ".", 1) for nm in centers]
                check(sorted(channels) == names, f"{name}.exr: OpenEXR reads {sorted(channels)}")
                read_back = np.stack([channels[n].pixels for n in names])
                check(same(read_back, expected.astype(np.float16) if half else expected), f"{name}.exr, {compression}: OpenEXR reads other values")
    # The 16-bit preview.
    lenscube("export", chart, scratch / "preview.tif")
    preview = tifffile.imread(scratch / "preview.tif")
    check(preview.shape == (*pixels.shape[1:], 3) and preview.dtype == np.uint16 and preview.max() == 65535, f"preview.tif: {preview.shape}, {preview.dtype}")


def pictures(scratch):
    """Files of other programs become charts of the same values."""
    rng = np.random.default_rng(5)
    linear = lambda v: np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)

    def chart_of(file, *flags):
        out = scratch / f"{file.name}.zarr"
        lenscube("chart", "image", file, out, "--illuminant", "E", "--wavelengths", "400:700:20", *flags)
        return zarr.open_group(out, mode="r")["chart"][:]

    for dtype in (np.uint8, np.uint16):
        white = np.iinfo(dtype).max
        grey, rgb = (rng.integers(0, white, shape, dtype, endpoint=True) for shape in [(150, 131), (150, 131, 3)])
        for kind, options in {
            "strips": {}, "tiles": {"tile": (64, 48)}, "packed": {"compression": "zlib", "predictor": True}, "packed-tiles": {"tile": (32, 32), "compression": "zlib"},
            "big": {"bigtiff": True, "rowsperstrip": 7}, "big-endian": {"byteorder": ">"},
        }.items():
            file = scratch / f"{kind}-{dtype.__name__}.tif"
            tifffile.imwrite(file, grey, photometric="minisblack", **options)
            got = chart_of(file)
            check(np.abs(got - linear(grey / white)).max() < 1e-6, f"{file.name}: a grey picture has other values")
            tifffile.imwrite(file, rgb, photometric="rgb", **options)
            (scratch / "back.tif").unlink(missing_ok=True)
            chart_of(file, "--overwrite")
            lenscube("export", scratch / f"{file.name}.zarr", scratch / "back.tif", "--white", "E", "--exposure", "1")
            error = np.abs(tifffile.imread(scratch / "back.tif") / 65535 - rgb / white).max()
            check(error < 0.2 / 255, f"{file.name}: the preview of its chart differs by {error}")

    cube = rng.random((3, 70, 90), np.float32)
    names = ["S0.420,0nm", "S0.550nm", "S0.0,6005um"]
    for compression in (OpenEXR.ZIP_COMPRESSION, OpenEXR.PIZ_COMPRESSION, OpenEXR.NO_COMPRESSION, OpenEXR.RLE_COMPRESSION):
        file = scratch / f"openexr-{int(compression)}.exr"
        with OpenEXR.File({"compression": compression, "type": OpenEXR.scanlineimage}, dict(zip(names, cube))) as exr:
            exr.write(str(file))
        lenscube("export", file, file.with_suffix(".npy"))
        check(same(np.load(file.with_suffix(".npy")), cube), f"{file.name}: lenscube reads other values than OpenEXR wrote")
        out = scratch / f"{file.name}.zarr"
        lenscube("chart", "image", file, out)
        group = zarr.open_group(out, mode="r")
        check(same(group["chart"][:], cube) and np.allclose(group["wavelength"][:], [420, 550, 600.5]), f"{file.name}: another chart")


def hdf5(scratch):
    """Films of HDF5, NetCDF-4 and MATLAB 7.3 files are those of the Zarr store that xarray writes, bit for bit."""
    nm = np.arange(400.0, 705.0, 10.0)
    cube = np.random.default_rng(2).random((96, 128, len(nm)), np.float32)
    pack = scratch / "hdf5.lens.zarr"
    identity_pack(pack, nm)
    plain = xarray.Dataset({"chart": (("y", "x", "wavelength"), cube)}, {"wavelength": ("wavelength", nm, {"units": "nm"})})
    packing = {"dtype": "u2", "scale_factor": 1e-4, "add_offset": -0.25, "_FillValue": 65535}

    def film(chart, *flags):
        out = scratch / "film-of-hdf5.zarr"
        lenscube("run", chart, out, "--lens", pack, "--film-pitch-um", 2, "--film-size", "128x96", "--no-fsync", "--overwrite", *flags)
        return zarr.open_group(out, mode="r")["film"][:]

    for name, encoding in [("plain", {}), ("packed", packing)]:
        twin = scratch / f"twin-{name}.zarr"
        plain.to_zarr(twin, consolidated=False, encoding={"chart": encoding})
        expected = film(twin)
        check(name == "packed" or same(expected, np.ascontiguousarray(np.moveaxis(cube, 2, 0))), f"{twin.name}: other values")
        for dims in [("y", "x", "wavelength"), ("wavelength", "y", "x")]:
            file = scratch / f"{name}-{dims[0]}.nc"
            sides = {"y": 32, "x": 50, "wavelength": 4}
            encoded = {"zlib": True, "shuffle": True, "chunksizes": tuple(sides[d] for d in dims)}
            plain.transpose(*dims).to_netcdf(file, engine="h5netcdf", encoding={"chart": {**encoding, **encoded}})
            check(same(film(f"{file}//chart"), expected), f"{file.name}: another film than its Zarr twin")
    expected = film(scratch / "twin-plain.zarr")
    for name, options in [("as-matlab", {"compress": True, "compress_size_threshold": 0}), ("not-compressed", {"compress": False})]:
        file = scratch / f"{name}.mat"
        hdf5storage.write({"rad": cube, "bands": nm}, filename=str(file), matlab_compatible=True, **options)
        check(same(film(f"{file}//rad"), expected), f"{file.name}: another film than its Zarr twin")
    file = scratch / "h5py.h5"
    with h5py.File(file, "w") as f:
        f["wavelengths"] = nm
        for name, options in [("lzf", {"compression": "lzf"}), ("deflate", {"compression": "gzip", "shuffle": True, "fletcher32": True})]:
            f.create_dataset(name, data=cube, chunks=(17, 128, 31), **options)
    for name in ("lzf", "deflate"):
        check(same(film(file, "--var", name, "--axes", "y,x,wavelength"), expected), f"h5py.h5, {name}: another film than its Zarr twin")


def lab(rgb):
    """CIE 1976 L*a*b* of linear sRGB."""
    to_xyz = np.array([[0.4123908, 0.3575843, 0.1804808], [0.2126390, 0.7151687, 0.0721923], [0.0193308, 0.1191948, 0.9505322]])
    t = rgb @ to_xyz.T / to_xyz.sum(1)
    f = np.where(t > (6 / 29) ** 3, np.cbrt(t), t / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.stack([116 * f[..., 1] - 16, 500 * (f[..., 0] - f[..., 1]), 200 * (f[..., 1] - f[..., 2])], -1)


def raws(scratch):
    """Raws in zarr-python; DNG in LibRaw: its mosaic, and its development beside that of `lenscube develop`."""
    film = scratch / "checker.film.zarr"
    lenscube("run", "gen:checker?size=600x400&pitch_um=2", film, "--lens", "double-gauss-28-npz", "--stages", "ri")
    for sensor, flags in {"sony-a7r2": [], "example-2um": [], "cmv12000-mono": [], "ideal-xyz": ["--roi", "31,17,300,200"]}.items():
        raw, dng, exr = (scratch / f"{sensor}{ending}" for ending in (".raw.zarr", ".dng", ".exr"))
        for out in (raw, dng):
            lenscube("sensor", film, out, "--sensor", sensor, "--exposure", "20ms", "--die", 7, *flags)
        array = "roi_0" if flags else "raw"
        group = zarr.open_consolidated(str(raw))
        mosaic = group[array][0]
        with rawpy.imread(str(dng)) as found:
            check(np.array_equal(found.raw_image, mosaic), f"{sensor}: LibRaw reads another mosaic")
            black, white = group.attrs["black_dn"], group.attrs["white_dn"]
            check(found.white_level == white and set(found.black_level_per_channel) <= {black}, f"{sensor}: LibRaw reads other levels")
            if sensor == "cmv12000-mono":
                continue
            theirs = found.postprocess(use_camera_wb=True, no_auto_bright=True, gamma=(1, 1), output_bps=16, user_flip=0,
                                       demosaic_algorithm=rawpy.DemosaicAlgorithm.LINEAR, output_color=rawpy.ColorSpace.sRGB)
        lenscube("develop", f"{raw}//{array}", exr, "--demosaic", "bilinear")
        with OpenEXR.File(str(exr)) as file:
            channels = file.channels()
            ours = channels["RGB"].pixels if "RGB" in channels else np.stack([channels[c].pixels for c in "RGB"], -1)
        height, width = (n // 20 for n in ours.shape[:2])
        cells = lambda v: v[:20 * height, :20 * width].reshape(height, 20, width, 20, 3).mean((1, 3))
        ours, theirs = cells(np.clip(ours, 0, 1)), cells(theirs / 65535)
        # LibRaw scales by its own estimate of the maximum.
        theirs = theirs * (ours.sum() / theirs.sum())
        cast = np.abs(theirs.mean((0, 1)) / ours.mean((0, 1)) - 1).max()
        error = np.sqrt(((lab(ours) - lab(theirs)) ** 2).sum(-1)).mean()
        check(cast < 0.01 and error < 2, f"{sensor}: LibRaw's development has a cast of {cast}, mean colour difference {error}")


def camera_raws(scratch):
    """A DNG of lossless JPEG tiles that tifffile and imagecodecs write, with borders and levels that LibRaw reads alike, has the report of the program's own DNG."""
    own, other = scratch / "example-2um.dng", scratch / "tiles.dng"
    with rawpy.imread(str(own)) as found:
        mosaic, black, white = found.raw_image.copy(), found.black_level_per_channel[0], found.white_level
    with tifffile.TiffFile(own) as file:
        tags = {tag.code: tag for page in file.pages for tag in page.tags.values()}
        kept = [(code, int(tags[code].dtype), tags[code].count, tags[code].value, True) for code in (33421, 33422, 50721, 50722, 50728, 50778, 50779)]
    top, left, side = 6, 10, 128
    whole = np.pad(mosaic, ((top, 4), (left, 6)), constant_values=black)
    height, width = whole.shape
    padded = np.pad(whole, ((0, -height % side), (0, -width % side)))
    tiles = (imagecodecs.ljpeg_encode(np.ascontiguousarray(padded[y:y + side, x:x + side]), bitspersample=16) for y in range(0, height, side) for x in range(0, width, side))
    area = (top, left, top + mosaic.shape[0], left + mosaic.shape[1])
    levels = [(50706, 1, 4, bytes([1, 4, 0, 0]), True), (50708, 2, 6, "tiles", True), (50714, 4, 1, black, True), (50717, 4, 1, white, True), (50829, 4, 4, area, True)]
    tifffile.imwrite(other, tiles, shape=whole.shape, dtype=np.uint16, photometric=32803, tile=(side, side), compression="jpeg", metadata=None, extratags=[*levels, *kept])
    with rawpy.imread(str(other)) as found:
        check(np.array_equal(found.raw_image_visible, mosaic), "LibRaw reads another mosaic in tiles of lossless JPEG")
    sections = []
    for dng in (own, other):
        lenscube("report", dng, "--chart", "checker?size=600x400", "--out", scratch / "report", "--overwrite")
        sections.append(json.loads((scratch / "report/report.json").read_text())["cameras"][0]["sections"][0]["values"])
    check(sections[0] == sections[1], f"the report of a DNG in tiles of lossless JPEG differs: mean of {sections[1]['mean_delta_e_2000']}, expected {sections[0]['mean_delta_e_2000']}")


with tempfile.TemporaryDirectory() as tmp:
    charts(Path(tmp))
    films(Path(tmp))
    exports(Path(tmp))
    pictures(Path(tmp))
    hdf5(Path(tmp))
    raws(Path(tmp))
    camera_raws(Path(tmp))
print(f"{interop.done} checks: zarr-python {zarr.__version__}, xarray {xarray.__version__}, tensorstore, OpenEXR {OpenEXR.__version__}, "
      f"tifffile {tifffile.__version__}, h5py {h5py.__version__}, LibRaw {'.'.join(map(str, rawpy.libraw_version))}, spectral and NumPy read files of lenscube, and lenscube reads theirs")
