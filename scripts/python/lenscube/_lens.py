"""A lens in this process: films of arrays in memory, without a program, a chart or a film on disk.

Coordinates are (x, y) in mm from the optical axis, y down, as in a film: of the film where a pixel lies (real image height), of the chart on the
ideal image plane.
"""

import logging
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

from . import _charts, errors
from ._arguments import arguments
from ._process import warn

if TYPE_CHECKING:
    import numpy
    import xarray
    from numpy.typing import ArrayLike, NDArray

    from ._native import NativeFilm

LOG = logging.getLogger("lenscube")
# The arguments that place a film and its chart, in the order of `_place`, and their defaults.
PLACE: dict[str, Any] = {
    "pitch_um": None,
    "center_mm": (0.0, 0.0),
    "chart_center_mm": None,
    "film_size": None,
    "scale": 1.0,
    "roi": None,
    "stages": None,
}
T = TypeVar("T")


class Lens:
    """A lens that is opened once and applied to as many arrays as there are.

    `name` and the keywords are those of `run`: a built-in lens, a design or a lens pack; `focus_m`, `gap`, `coatings`, `tails`, `tolerances`, `interp`, `surround`,
    `outside`, `nan`, `threads`, `memory` (1 GiB without it), `engine`, … A design is traced at `wavelengths` [nm] for the first film, and cached as
    for `run`; a lens pack has the wavelengths of its bands without any.

    >>> lens = lenscube.Lens("phone", wavelengths=[450, 550, 650], focus_m=1)
    >>> film = lens.apply(cube, pitch_um=2)             # (band, y, x) float32, the bits of `lenscube run`
    """

    def __init__(self, name: Any, *, wavelengths: "ArrayLike | None" = None, **flags: Any):
        from ._native import NativeLens

        nm = None if wavelengths is None else _numbers(wavelengths)
        self._flags = _words({"lens": name, **flags})
        self._native: NativeLens | None = _called(NativeLens, self._flags, nm)
        self.wavelengths_nm: list[float] = self._native.wavelengths_nm
        self._noted: set[str] = set()

    def __enter__(self) -> "Lens":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Gives back the memory of kernels, spectra and tables. The lens cannot be used any more."""
        self._native = None

    def __repr__(self) -> str:
        return f"lenscube.Lens({' '.join(self._flags)}, wavelengths={self.wavelengths_nm})"

    @property
    def _open(self) -> Any:
        if self._native is None:
            raise ValueError("the lens is closed")
        return self._native

    def apply(
        self,
        chart: Any,
        *,
        pitch_um: float | None = None,
        center_mm: tuple[float, float] = (0.0, 0.0),
        chart_center_mm: tuple[float, float] | None = None,
        film_size: "tuple[int, int] | int | None" = None,
        scale: "float | tuple[float, float]" = 1.0,
        roi: tuple[int, int, int, int] | None = None,
        stages: "str | Sequence[str] | None" = None,
        out: "numpy.ndarray | None" = None,
    ) -> "NDArray[numpy.float32]":
        """The film of a chart (band, y, x), or of several (n, band, y, x), which share kernels and are computed together.

        chart: an array with a band for each wavelength of the lens, or (y, x) where it has one; a DataArray, whose wavelengths must be those of the lens.
        pitch_um: pixel pitch of the film [default: that of a DataArray]. center_mm: where the film's centre lies, (x, y) from the axis. chart_center_mm: where the chart's
        centre lies on the ideal image plane [default: where the film's centre sees it, so that the picture stays in the middle]. film_size: (height, width) in pixels
        [default: that of the chart, times the scale]. scale: film pixels per chart pixel, or (x, y). roi: (x, y, width, height), a part of the film. stages: "ri", "distortion",
        "svpsf" or several. out: array for the result, float32 and contiguous.

        Returns (band, y, x), or (n, band, y, x), float32, relative to the chart's values.
        """
        import numpy

        array, given_um, axes = self._array(chart)
        place = self._place(array.shape[2:], pitch_um or given_um, center_mm, chart_center_mm, film_size, scale, roi, stages)
        film = self._film(array.shape[2:], place)
        shape = (array.shape[0], *film.shape)
        result = numpy.empty(shape, numpy.float32) if out is None else _checked_out(out, _like(shape, axes), array).reshape(shape)
        _called(film.compute, array, result)
        return result.reshape(_like(shape, axes)) if out is None else out

    def adjoint(
        self, film: Any, *, chart_size: tuple[int, int] | None = None, out: "numpy.ndarray | None" = None, **place: Any
    ) -> "NDArray[numpy.float32]":
        """The transpose of `apply`, ⟨apply(x), y⟩ = ⟨x, adjoint(y)⟩: from films (band, y, x), or (n, band, y, x), to charts of `chart_size` (rows, columns)
        [default: the size of the film, or `film_size` over the scale]. `place`: the arguments of `apply`, of which the pitch is needed.
        """
        import numpy

        array, given_um, axes = self._array(film)
        if chart_size is None:
            if place.get("roi") is not None or place.get("scale", 1.0) not in (1, 1.0, (1, 1)):
                raise TypeError("chart_size: expected (rows, columns) of the chart, with a roi or a scale, found none")
            chart_size = array.shape[2:]
        place = {"pitch_um": given_um, **place}
        ready = self._film(chart_size, self._place(chart_size, *(place.pop(name, default) for name, default in PLACE.items())))
        if place:
            raise TypeError(f"adjoint() has no argument {next(iter(place))!r}")
        if array.shape[1:] != ready.shape:
            raise ValueError(f"film: expected the shape (…, {', '.join(map(str, ready.shape))}), found {tuple(array.shape)}")
        shape = (array.shape[0], len(self.wavelengths_nm), *chart_size)
        result = numpy.empty(shape, numpy.float32) if out is None else _checked_out(out, _like(shape, axes), array).reshape(shape)
        _called(ready.adjoint, array, result)
        return result.reshape(_like(shape, axes)) if out is None else out

    def linear_operator(self, shape: tuple[int, ...], **place: Any) -> Any:
        """`apply` to charts of `shape` (band, y, x), or (n, band, y, x), as a `scipy.sparse.linalg.LinearOperator` on their pixels in one vector; its transpose is `adjoint`.

        `place`: the arguments of `apply`. Solvers of SciPy and PyLops take it: `scipy.sparse.linalg.lsqr(lens.linear_operator(film.shape, pitch_um=2), film.ravel())`.
        """
        import numpy
        from scipy.sparse.linalg import LinearOperator  # type: ignore[import-untyped]

        film_shape = (*shape[:-2], *self._film(shape[-2:], self._place(shape[-2:], *({**PLACE, **place}[name] for name in PLACE))).shape[1:])
        size = {**place, "chart_size": tuple(shape[-2:])}

        def matvec(x: Any) -> Any:
            return self.apply(numpy.asarray(x, numpy.float32).reshape(shape), **place).ravel()

        def rmatvec(y: Any) -> Any:
            return self.adjoint(numpy.asarray(y, numpy.float32).reshape(film_shape), **size).ravel()

        sides = (int(numpy.prod(film_shape)), int(numpy.prod(shape)))
        return LinearOperator(sides, matvec=matvec, rmatvec=rmatvec, dtype=numpy.dtype(numpy.float32))

    def placement(
        self,
        shape: tuple[int, int],
        pitch_um: float,
        center_mm: tuple[float, float] = (0.0, 0.0),
        chart_center_mm: tuple[float, float] | None = None,
        film_size: "tuple[int, int] | int | None" = None,
        scale: "float | tuple[float, float]" = 1.0,
    ) -> dict[str, Any]:
        """The keywords of `lenscube.run` for the film that `apply` makes of a chart of `shape` (rows, columns) with these arguments."""
        return self._place(shape, pitch_um, center_mm, chart_center_mm, film_size, scale, None, None)

    def project(self, points_mm: "ArrayLike", wavelength: float | None = None) -> "NDArray[numpy.float64]":
        """Where on the film points of the chart land, mm: (…, 2) to (…, 2). Boxes, keypoints and flow of a picture follow its film by it.

        wavelength in nm, one of a lens pack, any of a design [default: the middle one of the lens].
        """
        return self._mapped(self._open.film_of_chart, points_mm, wavelength)

    def unproject(self, points_mm: "ArrayLike", wavelength: float | None = None) -> "NDArray[numpy.float64]":
        """The points of the chart that the film shows at `points_mm`; the inverse of `project`."""
        return self._mapped(self._open.chart_of_film, points_mm, wavelength)

    def relative_illumination(self, r_mm: "ArrayLike", wavelength: float | None = None) -> "NDArray[numpy.float64]":
        """Irradiance at heights `r_mm` from the axis over that on the axis, for a uniform chart; of a lens without symmetry along +x."""
        import numpy

        r = numpy.asarray(r_mm, float)
        points = [[float(v), 0.0] for v in r.reshape(-1)]
        values = _called(self._open.relative_illumination, points, self._wavelength(wavelength))
        return numpy.array(values).reshape(r.shape)

    def psf(
        self, x_mm: float, y_mm: float, wavelength: float | None = None, *, pitch_um: float, size: int | None = None
    ) -> "xarray.DataArray":
        """The PSF at a place of the film, integrated over the pixels: what one pixel of light becomes, (y, x) in µm from its chief ray.

        size: pixels of a side, odd [default: the PSF window]. Its sum is the share of the light inside; `energy` among the attributes has that number.
        """
        import numpy
        import xarray

        band = self._band(wavelength)
        place: dict[str, Any] = {"pitch_um": pitch_um, "center_mm": (float(x_mm), float(y_mm)), "stages": "svpsf"}
        if size is None:
            size = self._film((3, 3), self._place((3, 3), pitch_um, place["center_mm"], None, None, 1.0, None, "svpsf")).window_px(band)
        if size < 1 or size % 2 == 0:
            raise ValueError(f"size: expected an odd number of pixels, found {size}")
        one = numpy.zeros((len(self.wavelengths_nm), size, size), numpy.float32)
        one[:, size // 2, size // 2] = 1
        values = self.apply(one, **place)[band]
        at = (numpy.arange(size) - size // 2) * pitch_um
        coords = {"y": ("y", at, {"units": "um"}), "x": ("x", at, {"units": "um"})}
        attrs = {"energy": float(values.sum()), "pitch_um": pitch_um, "x_mm": x_mm, "y_mm": y_mm, "wavelength_nm": self.wavelengths_nm[band]}
        return xarray.DataArray(values, coords, ("y", "x"), "psf", attrs)

    def mtf(
        self, x_mm: float, y_mm: float, wavelength: float | None = None, *, frequencies: "ArrayLike | None" = None, pitch_um: float = 0.5
    ) -> "xarray.DataArray":
        """The MTF of the lens at a place of the film, (direction, frequency) with frequencies in cycles/mm [default: 0 to 1/(4 pitch)].

        From the PSF on pixels of `pitch_um`, whose own MTF is divided out. direction "tangential": of lines along the tangent, frequencies along the radius; "sagittal" across.
        Light beyond the PSF window is taken as lost: it counts in the total, so that the first frequencies are right to the share of that light.
        """
        import numpy
        import xarray

        psf = self.psf(x_mm, y_mm, wavelength, pitch_um=pitch_um)
        step_mm = 1e-3 * pitch_um
        frequency = numpy.linspace(0, 0.25 / step_mm, 101) if frequencies is None else numpy.asarray(frequencies, float)
        if frequency.ndim != 1 or (frequency < 0).any() or (frequency > 0.5 / step_mm).any():
            raise ValueError(f"frequencies: expected numbers from 0 to {0.5 / step_mm:g} cycles/mm (half the sampling rate), found {frequencies!r}")
        angle = numpy.arctan2(y_mm, x_mm)
        at = (numpy.arange(psf.sizes["x"]) - psf.sizes["x"] // 2) * step_mm
        values = []
        for direction in (angle, angle + numpy.pi / 2):
            fx, fy = frequency * numpy.cos(direction), frequency * numpy.sin(direction)
            along_x, along_y = (numpy.exp(-2j * numpy.pi * numpy.outer(f, at)) for f in (fx, fy))
            transfer = numpy.abs(numpy.einsum("fy,yx,fx->f", along_y, psf.values.astype(float), along_x, optimize=True))
            values.append(transfer / (numpy.sinc(fx * step_mm) * numpy.sinc(fy * step_mm)))
        mtf = numpy.where(frequency == 0, 1.0, numpy.array(values))
        coords = {"direction": ["tangential", "sagittal"], "frequency": ("frequency", frequency, {"units": "1/mm"})}
        return xarray.DataArray(mtf, coords, ("direction", "frequency"), "mtf", psf.attrs)

    def _array(self, chart: Any) -> tuple["NDArray[numpy.float32]", float | None, int]:
        """(n, band, y, x) of 32-bit floats, contiguous; the pitch that the chart declares; its number of axes."""
        import numpy
        import xarray

        um = None
        if isinstance(chart, xarray.DataArray) and chart.ndim <= 3:
            standard = _charts.standard(chart, None)
            nm, um = _charts.wavelengths_nm(standard), _charts.pitch_um(standard)
            if nm is not None and not numpy.allclose(nm, self.wavelengths_nm, rtol=0, atol=1e-3):
                raise ValueError(f"the chart has the wavelengths {nm} nm, the lens {self.wavelengths_nm} nm")
            missing = [key for key in ("_FillValue", "missing_value", "scale_factor", "add_offset", "valid_range") if key in standard.attrs]
            if missing:
                raise ValueError(f"the chart has the attribute {missing[0]}: decode it (xarray.decode_cf), or pass its values")
            axes, array = 3 if chart.ndim == 3 else 2, standard.to_numpy()
        else:
            array = numpy.asarray(chart)
            axes = array.ndim
        if array.dtype.kind not in "fiu" or axes not in (2, 3, 4):
            raise TypeError(f"chart: expected an array (band, y, x) or (n, band, y, x) of numbers, found {array.dtype} of {array.ndim} axes")
        array = array.reshape((1,) * (4 - array.ndim) + array.shape)
        if array.shape[1] != len(self.wavelengths_nm) or 0 in array.shape:
            raise ValueError(f"chart: expected {len(self.wavelengths_nm)} bands, those of the lens, found the shape {tuple(array.shape)}")
        return numpy.ascontiguousarray(array, numpy.float32), um, axes

    def _place(
        self, shape: Any, pitch_um: Any, center_mm: Any, chart_center_mm: Any, film_size: Any, scale: Any, roi: Any, stages: Any
    ) -> dict[str, Any]:
        if pitch_um is None:
            raise TypeError("pitch_um: expected the pixel pitch of the film in µm, found none")
        sx, sy = (scale, scale) if not isinstance(scale, Sequence) else scale
        height, width = film_size if isinstance(film_size, Sequence) else (film_size, film_size)
        if film_size is None:
            height, width = max(1, round(shape[0] * sy)), max(1, round(shape[1] * sx))
        place: dict[str, Any] = {"film_pitch_um": float(pitch_um), "film_size": f"{int(width)}x{int(height)}"}
        if (sx, sy) != (1, 1):
            place["scale"] = (float(sx), float(sy))
        x, y = map(float, center_mm)
        if (x, y) != (0, 0):
            per_mm = 1e3 / pitch_um
            place["axis"] = ((width - 1) / 2 - x * per_mm, (height - 1) / 2 - y * per_mm)
        if chart_center_mm is None and (x, y) != (0, 0):
            has_distortion = stages is None or "distortion" in (stages if isinstance(stages, str) else list(stages))
            chart_center_mm = tuple(self.unproject((x, y))) if has_distortion else (x, y)
        if chart_center_mm is not None and tuple(chart_center_mm) != (0, 0):
            place["center"] = tuple(map(float, chart_center_mm))
        if roi is not None:
            place["roi"] = tuple(map(int, roi))
        if stages is not None:
            place["stages"] = stages
        return place

    def _film(self, shape: Any, place: Mapping[str, Any]) -> "NativeFilm":
        film: NativeFilm = _called(self._open.film, int(shape[0]), int(shape[1]), _words(place))
        for note in film.notes:
            if note not in self._noted:
                self._noted.add(note)
                warn(note)
        return film

    def _wavelength(self, nm: float | None) -> float:
        return self.wavelengths_nm[len(self.wavelengths_nm) // 2] if nm is None else float(nm)

    def _band(self, nm: float | None) -> int:
        nm = self._wavelength(nm)
        near = [i for i, band in enumerate(self.wavelengths_nm) if abs(band - nm) < 1e-3]
        if not near:
            raise ValueError(f"wavelength: expected one of the lens, {self.wavelengths_nm} nm, found {nm}")
        return near[0]

    def _mapped(self, function: Callable[..., Any], points_mm: "ArrayLike", nm: float | None) -> "NDArray[numpy.float64]":
        import numpy

        points = numpy.asarray(points_mm, float)
        if points.shape[-1:] != (2,):
            raise ValueError(f"points_mm: expected (…, 2), x and y of each point, found the shape {points.shape}")
        mapped = _called(function, points.reshape(-1, 2).tolist(), self._wavelength(nm))
        return numpy.array(mapped, float).reshape(points.shape)


def _words(flags: Mapping[str, Any]) -> list[str]:
    """The flags as words of a command line."""
    words = arguments(("run",), (), flags)
    return words[1:-1]


def _numbers(values: Any) -> list[float]:
    import numpy

    return [float(v) for v in numpy.atleast_1d(numpy.asarray(values, float))]


def _like(shape: tuple[int, ...], axes: int) -> tuple[int, ...]:
    """The shape (n, band, y, x) without the leading axes that the chart did not have."""
    return shape[4 - axes :]


def _checked_out(out: Any, shape: tuple[int, ...], array: Any) -> Any:
    import numpy

    if not isinstance(out, numpy.ndarray) or out.dtype != numpy.float32 or out.shape != shape or not out.flags.c_contiguous or not out.flags.writeable:
        found = f"{getattr(out, 'dtype', type(out).__name__)} {getattr(out, 'shape', '')}"
        raise ValueError(f"out: expected a writeable contiguous array of float32 {shape}, found {found}")
    if numpy.may_share_memory(out, array):
        raise ValueError("out shares memory with the chart")
    return out


def _called(function: Callable[..., T], *values: Any) -> T:
    """Calls a function of the native module: its failures are this package's exceptions, its notes warnings."""
    from . import _native

    try:
        return function(*values)
    except _native.Failure as failure:
        code, message = failure.args
        raise errors.error(code, message, (), "") from None
    finally:
        for line in _native.take_lines():
            if line.startswith("note: "):
                warn(line.removeprefix("note: "))
            else:
                LOG.info("%s", line)
