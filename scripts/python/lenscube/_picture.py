"""A picture or data file that the program has written."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import xarray


class Picture(os.PathLike[str]):
    """A file written by the program; a notebook shows a PNG. `path`: where it is; `to_xarray()`: TIFF and NPY as an array."""

    def __init__(self, path: str | os.PathLike[str]):
        self.path = Path(path)

    def __fspath__(self) -> str:
        return str(self.path)

    def __repr__(self) -> str:
        return f"Picture({str(self.path)!r})"

    def _repr_png_(self) -> bytes | None:
        return self.path.read_bytes() if self.path.suffix.lower() == ".png" else None

    def to_xarray(self) -> "xarray.DataArray":
        """The samples: (y, x, channel) of a colour picture, red first; (band, y, x) or (y, x) otherwise. `.plot.imshow()` shows colours of 8 bits,
        or after a division by 65535 those of 16 bits."""
        import numpy
        import xarray

        suffix = self.path.suffix.lower()
        if suffix == ".npy":
            samples: Any = numpy.load(self.path, mmap_mode="r")
        elif suffix in (".tif", ".tiff", ".btf"):
            import tifffile

            samples = tifffile.imread(self.path)
        else:
            raise TypeError(f"{self.path}: only .tif and .npy files are read; give the output such a name")
        colour = samples.ndim == 3 and samples.shape[-1] == 3 and suffix != ".npy"
        dims = ("y", "x", "channel") if colour else ("band", "y", "x")[3 - samples.ndim :]
        return xarray.DataArray(samples, dims=dims, coords={"channel": ["red", "green", "blue"]} if colour else None)
