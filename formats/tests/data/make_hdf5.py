"""Charts in HDF5, NetCDF-4 and MATLAB 7.3 files written by other software, for the tests of formats/src/chart/hdf5 and tests/formats.

    python make_hdf5.py (h5py 3.16.0, xarray 2026.9.0, netCDF4 1.7.5.1, h5netcdf 1.8.2, hdf5storage 0.2.2, scipy 1.17.1, numpy 2.4.6)

Every sample of a chart is (31 band + 7 row + 3 column) mod 251, as in make_charts.py, so each file has the Zarr chart `v3-sharded` as
its twin. Wavelengths are 400, 410 and 420.5 nm.
"""

import pathlib
import shutil

import h5py
import hdf5storage
import numpy as np
import scipy.io
import xarray

HERE = pathlib.Path(__file__).parent / "hdf5"
B, H, W = 3, 37, 41
b, y, x = np.indices((B, H, W))
N = (31 * b + 7 * y + 3 * x) % 251
NM = np.array([400, 410, 420.5])


def main():
    shutil.rmtree(HERE, ignore_errors=True)
    HERE.mkdir()
    # MATLAB: (y, x, wavelength), which the file holds reversed; compressed as MATLAB's `save -v7.3` does, and contiguous.
    by_matlab = {"rad": np.moveaxis(N, 0, 2).astype("f8"), "bands": NM[None], "rgb": np.zeros((4, 5), "f4")}
    for name, options in [("matlab.mat", {"compress": True}), ("matlab-contiguous.mat", {"compress": False})]:
        hdf5storage.write(by_matlab, filename=str(HERE / name), matlab_compatible=True, compress_size_threshold=0, **options)
    scipy.io.savemat(HERE / "matlab-v5.mat", {"rad": np.zeros((2, 2, 2))})

    with h5py.File(HERE / "filters.h5", "w") as f:
        g = f.create_group("scene")
        g["wavelengths"] = NM
        every = dict(chunks=(2, 16, 11), shuffle=True)
        g.create_dataset("deflate", data=N.astype("u2"), compression="gzip", fletcher32=True, **every)
        g.create_dataset("lzf", data=N.astype(">f8"), compression="lzf", **every)
        g.create_dataset("none", data=np.moveaxis(N, 0, 2).astype("i2"), chunks=(8, 41, 3))
        g["none"].dims[0].label, g["none"].dims[1].label, g["none"].dims[2].label = "row", "col", "band"
        g.create_dataset("half", data=N.astype("f2"))
        g.create_dataset("big-endian", data=N.astype(">u2"))
        g.create_dataset("complex", data=N.astype("c8"))
        g.create_dataset("wide", data=N.astype("i4"))
        # Only the first chunk is stored.
        sparse = g.create_dataset("sparse", shape=(B, H, W), dtype="f4", chunks=(1, 16, 16), fillvalue=7)
        sparse[0, :16, :16] = N[0, :16, :16]
        # Sizes that are declared, without any data.
        for name, chunk in [("chunks", (1, 1 << 14, 1 << 14)), ("count", (1, 16, 16)), ("space", (1, 4096, 4096))]:
            f.create_dataset(f"huge/{name}", shape=(3, 1 << 16, 1 << 16), dtype="f4", chunks=chunk)
    with h5py.File(HERE / "depth.h5", "w") as f:
        # Distances in m: a near square before a far wall.
        depth = np.full((96, 96), 4.0, "f4")
        depth[30:70, 20:60] = 0.55
        f.create_dataset("scene/depth", data=depth, chunks=(32, 40), compression="gzip", shuffle=True)
    with h5py.File(HERE / "latest.h5", "w", libver=("v110", "v110")) as f:
        f.create_dataset("fixed", data=N.astype("u1"), chunks=(1, 16, 16), compression="gzip")
        f.create_dataset("extensible", data=N.astype("u1"), chunks=(1, 16, 16), maxshape=(None, H, W))
        f.create_dataset("single", data=N.astype("u1"), chunks=(B, H, W), compression="gzip")
        f.create_dataset("tree", data=N.astype("u1"), chunks=(1, 16, 16), maxshape=(None, None, W))
        f["wavelength"] = NM

    ds = xarray.Dataset(
        {"radiance": (("y", "x", "wl"), np.moveaxis(N, 0, 2).astype("f4"), {"units": "W m-2 sr-1 nm-1"})},
        coords={"wl": ("wl", NM / 1e3, {"units": "um"}), "y": np.arange(H), "x": np.arange(W)},
    )
    ds.to_netcdf(HERE / "netcdf4.nc", engine="netcdf4", encoding={"radiance": {"zlib": True, "chunksizes": (10, 41, 2)}})
    packed = {"dtype": "u2", "scale_factor": 0.5, "add_offset": -3.0, "_FillValue": 65535}
    ds.to_netcdf(HERE / "packed.nc", engine="h5netcdf", encoding={"radiance": packed})
    ds.transpose("wl", "y", "x").to_netcdf(HERE / "unlimited.nc", engine="netcdf4", unlimited_dims=["wl", "y"])
    ds.drop_vars(["wl", "y", "x"]).to_netcdf(HERE / "netcdf3.nc", engine="scipy", format="NETCDF3_64BIT")


main()
