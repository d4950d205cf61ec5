"""The program as a film of sheets: charts with distances written, `lenscube run`, the film read."""
import subprocess
import tempfile
from pathlib import Path

import numpy as np
import zarr


class Program:
    def __init__(self, binary):
        self.binary = Path(binary).resolve()

    def run(self, *words):
        """Output of a command, which must succeed."""
        done = subprocess.run([self.binary, *map(str, words)], capture_output=True, text=True)
        assert done.returncode == 0, f"{' '.join(map(str, words))}: exit {done.returncode}: {done.stderr}"
        return done.stdout

    def film(self, lens, nm, sheets, pitch_um, shape, *flags, stages="distortion,svpsf", roi=None, invented=False):
        """Film (H, W), or its region `roi` (y, x, h, w), of sheets (chart, vergence[, coverage]); the first one is visible, the others hidden behind it."""
        with tempfile.TemporaryDirectory() as tmp:
            for i, sheet in enumerate(sheets):
                write(Path(tmp) / f"{i}.zarr", nm, *sheet)
            hidden = [w for i in range(1, len(sheets)) for w in ("--hidden", f"{tmp}/{i}.zarr")] or ([] if invented else ["--hidden", "none"])
            region = [] if roi is None else ["--roi", f"{roi[1]},{roi[0]},{roi[3]},{roi[2]}"]
            self.run("run", f"{tmp}/0.zarr", f"{tmp}/film", "--lens", lens, "--depth", f"{tmp}/0.zarr//depth", *hidden, "--film-size", f"{shape[1]}x{shape[0]}",
                     "--film-pitch-um", pitch_um, "--outside", "clamp", "--stages", stages, "--no-fsync", *region, *flags)
            return zarr.open_group(f"{tmp}/film", mode="r")["film" if roi is None else "roi_0"][0].astype(float)


def write(path, nm, chart, vergence, coverage=None):
    """Chart store of one band with distances 1/vergence [m] in f64, and coverage."""
    g = zarr.open_group(path, mode="w", zarr_format=3)
    g.create_array("chart", data=np.asarray(chart, np.float32)[None], dimension_names=["wavelength", "y", "x"])
    g.create_array("wavelength", data=np.array([nm]), dimension_names=["wavelength"]).attrs["units"] = "nm"
    distance = np.divide(1, vergence, out=np.full(np.shape(vergence), np.inf), where=np.asarray(vergence) > 0)
    g.create_array("depth", data=distance, dimension_names=["y", "x"], attributes={"unit": "m", "kind": "planar"})
    if coverage is not None:
        g.create_array("coverage", data=np.asarray(coverage, np.float32), dimension_names=["y", "x"])
