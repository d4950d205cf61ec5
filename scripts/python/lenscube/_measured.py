"""The figures of `lenscube measure` as a Dataset."""

from typing import TYPE_CHECKING, Any

from ._process import warn

if TYPE_CHECKING:
    import xarray


def dataset(measured: dict[str, Any], printed: str, flags: dict[str, Any]) -> "xarray.Dataset":
    """`measured`: the file of --json; `printed`: standard output, which has the remarks on doubtful figures."""
    import xarray

    bands = measured["bands"]
    for line in printed.splitlines():
        if ": DOUBTFUL: " in line:
            warn(line.replace("DOUBTFUL: ", "doubtful: "))
    nm = ("wavelength", [b["wavelength_nm"] for b in bands], {"units": "nm"})
    if flags.get("points") is not None:
        return _points(bands, nm)
    result = _figures(bands, nm)
    if flags.get("edge") is None:
        distance = [x for x, _ in bands[0]["curve"]]
        result["profile"] = (("wavelength", "distance_px"), [[y for _, y in b["curve"]] for b in bands])
        return result.assign_coords(distance_px=("distance_px", distance, {"units": "px", "long_name": "distance along the line"}))
    longest = max(len(b["curve"]) for b in bands)

    def padded(part: int) -> list[list[float]]:
        return [[p[part] for p in b["curve"]] + [float("nan")] * (longest - len(b["curve"])) for b in bands]

    result["esf"] = (("wavelength", "sample"), padded(1), {"long_name": "edge spread function"})
    result["mtf"] = (("wavelength", "frequency_cy_px"), [[m for _, m in b["mtf"]] for b in bands], {"long_name": "MTF"})
    frequency = xarray.Variable("frequency_cy_px", [f for f, _ in bands[0]["mtf"]], {"units": "cycles/px", "long_name": "spatial frequency"})
    result = result.assign_coords(
        distance_px=(("wavelength", "sample"), padded(0), {"units": "px", "long_name": "distance from the edge"}), frequency_cy_px=frequency
    )
    both = result["mtf50_lp_mm"] / result["mtf50_cy_px"]
    if both.notnull().any():
        per_mm = float(both.mean())
        result = result.assign_coords(frequency_lp_mm=("frequency_cy_px", frequency.values * per_mm, {"units": "lp/mm", "long_name": "spatial frequency"}))
    return result


def _figures(bands: list[dict[str, Any]], nm: Any) -> "xarray.Dataset":
    """Each figure by wavelength; one that a band does not have is NaN."""
    import xarray

    names = [name for name in bands[0]["figures"] if name != "remarks"]
    values = {n: ("wavelength", [float("nan") if b["figures"][n] is None else b["figures"][n] for b in bands]) for n in names}
    return xarray.Dataset(values, {"wavelength": nm})


def _points(bands: list[dict[str, Any]], nm: Any) -> "xarray.Dataset":
    """`x` and `y` (wavelength, point): column and row of the centroids, px."""
    import xarray

    def of(name: str) -> Any:
        return (("wavelength", "point"), [[p[name] for p in b["figures"]] for b in bands], {"units": "px"})

    return xarray.Dataset({"x": of("column"), "y": of("row")}, {"wavelength": nm})
