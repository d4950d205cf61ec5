"""Charts in pictures, TIFF and NumPy files written by other software, for the tests of formats/src/chart and tests/formats.

    python make_pictures.py      (Pillow 13.0.0, tifffile 2026.3.3, imagecodecs, numpy 2.4.6)
    python make_pictures.py gdal (rasterio 1.4.3 with GDAL 3.9.3)

Every sample of a chart is (31 band + 7 row + 3 column) mod 251, as in make_charts.py, so each file has the Zarr chart `v3-sharded` as
its twin. Wavelengths are 400, 410 and 420.5 nm. Pictures for `chart image`: 9 x 12 px.
"""

import pathlib
import shutil
import sys

import numpy as np

HERE = pathlib.Path(__file__).parent / "pictures"
B, H, W = 3, 37, 41
b, y, x = np.indices((B, H, W))
N = (31 * b + 7 * y + 3 * x) % 251
NM = [400, 410, 420.5]


def folder(name):
    shutil.rmtree(HERE / name, ignore_errors=True)
    (HERE / name).mkdir(parents=True)
    return HERE / name


def by_gdal():
    import rasterio

    to = folder("gdal")

    u16 = N.astype("u2")
    with rasterio.open(to / "descriptions.tif", "w", driver="GTiff", count=B, height=H, width=W, dtype="uint16", tiled=True,
                       blockxsize=16, blockysize=32, compress="zstd", interleave="band", photometric="minisblack") as f:
        f.write(u16)
        for k, nm in enumerate(NM, 1):
            f.set_band_description(k, f"band {k} ({nm} nm)")
    with rasterio.open(to / "scaled.tif", "w", driver="GTiff", count=B, height=H, width=W, dtype="uint16", compress="deflate",
                       predictor=2, interleave="pixel", photometric="minisblack", nodata=65535) as f:
        f.write((N * 4 + 8).astype("u2"))
        f.scales, f.offsets = [0.25] * B, [-2.0] * B
        for k, nm in enumerate(NM, 1):
            f.update_tags(k, wavelength=str(nm / 1000), wavelength_units="Micrometers")
    with rasterio.open(to / "bigtiff-overviews.tif", "w", driver="GTiff", count=1, height=H, width=W, dtype="float32",
                       BIGTIFF="YES", compress="deflate", tiled=True, blockxsize=16, blockysize=16) as f:
        f.write(N[:1].astype("f4"))
        f.build_overviews([2])
        f.update_tags(1, WAVELENGTH="400 nm")
    for name, dtype, predictor, interleave in [("chunky-f32", "float32", 3, "pixel"), ("planar-u16", "uint16", 2, "band"), ("chunky-u8", "uint8", 2, "pixel")]:
        with rasterio.open(to / f"tiled-big-endian-predictor-{name}.tif", "w", driver="GTiff", count=B, height=H, width=W, dtype=dtype,
                           compress="deflate", predictor=predictor, interleave=interleave, tiled=True, blockxsize=16, blockysize=32,
                           photometric="minisblack", ENDIANNESS="BIG") as f:
            f.write(N.astype(dtype))
            for k, nm in enumerate(NM, 1):
                f.update_tags(k, WAVELENGTH=f"{nm} nm")


def by_pillow_and_tifffile():
    import tifffile
    from PIL import Image

    to = folder("png16")
    for values, nm in zip(N, NM):
        Image.fromarray(values.astype("u2")).save(to / f"scene_{nm}nm.png")
    (to / "Thumbs.db").write_bytes(b"not a picture")
    to = folder("numbered-tif")
    for values, k in zip(N, [2, 10, 100]):
        tifffile.imwrite(to / f"band_{k}.tif", values.astype("u1"), compression="lzw")
    xml = "".join(f'<Item name="WAVELENGTH" sample="{k}">{nm}</Item>' for k, nm in enumerate(NM))
    tags = [(42112, "s", 0, f"<GDALMetadata>{xml}</GDALMetadata>", True)]
    to = folder("tiff")
    how = {"photometric": "minisblack", "extratags": tags}
    chunky = np.moveaxis(N, 0, 2)
    tifffile.imwrite(to / "planar-deflate-f32.tif", N.astype("f4"), planarconfig="separate", compression="zlib",
                     predictor=3, rowsperstrip=5, **how)
    tifffile.imwrite(to / "chunky-tiled-big-endian-bigtiff.tif", chunky.astype(">u2"), planarconfig="contig", tile=(16, 32),
                     byteorder=">", bigtiff=True, **how)
    tifffile.imwrite(to / "chunky-lzw-u8.tif", chunky.astype("u1"), planarconfig="contig", compression="lzw", rowsperstrip=7,
                     **how)
    tifffile.imwrite(to / "planar-one-strip-u16.tif", N.astype("u2"), planarconfig="separate", **how)
    tifffile.imwrite(to / "pages-f64.tif", N.astype("f8"), photometric="minisblack")
    np.save(HERE / "fortran-y-x-wavelength.npy", np.asfortranarray(chunky.astype("f4")))
    np.save(HERE / "y-x-wavelength.npy", chunky.astype(">u2"))
    colour = np.stack([(k * 60 + 5 * y[0, :9, :12] + 3 * x[0, :9, :12]) % 251 for k in range(4)], 2).astype("u1")
    rgb, opaque = Image.fromarray(colour[..., :3]), colour.copy()
    opaque[..., 3] = 255
    to = folder("colour")
    rgb.save(to / "rgb.png")
    Image.fromarray(opaque).save(to / "opaque-alpha.png")
    Image.fromarray(colour).save(to / "alpha.png")
    rgb.save(to / "lossless.webp", lossless=True)
    Image.fromarray(opaque).save(to / "opaque-alpha.webp", lossless=True)
    Image.fromarray(colour).save(to / "alpha.webp", lossless=True, exact=True)
    rgb.save(to / "baseline.jpg", quality=95, subsampling=0)
    rgb.save(to / "progressive.jpg", quality=95, subsampling=0, progressive=True)
    Image.fromarray(colour[..., 0]).save(to / "grey.jpg", quality=95)
    rgb.convert("CMYK").save(to / "cmyk.jpg")
    np.save(to / "baseline.jpg.npy", np.asarray(Image.open(to / "baseline.jpg")))


by_gdal() if "gdal" in sys.argv else by_pillow_and_tifffile()
