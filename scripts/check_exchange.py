"""Compares camera models of `lens export` with the programs they are for; run by check-long.

Three lenses, on films up to the corner of their fields. Expected positions are those of the lens: the table of `lens export --as lut`, whose
rows are traced chief rays, and a film of `lenscube run` whose chart has as its values its own columns or rows, so that each film pixel holds its ideal
point. OpenCV, COLMAP and lensfun must put the same field points at the same REAL positions, within the residual that `lens export` prints.
"""
import csv
import io
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import cv2
import lensfunpy
import numpy as np
import pycolmap

LENSCUBE = Path(sys.argv[1]).resolve()
# Rounding of f32 films and coordinates, px.
ROUNDING = 2e-3
done = 0  # number of checks
exports = tempfile.TemporaryDirectory()


def check(condition, message):
    """Ends with exit code 1 and the message unless the condition is true."""
    global done
    done += 1
    if not condition:
        sys.exit(f"check-exchange: {message}")


def lenscube(*arguments):
    """What the program prints, which must end with 0."""
    arguments = list(map(str, arguments))
    process = subprocess.run([LENSCUBE, *arguments], capture_output=True, text=True)
    check(process.returncode == 0, f"lenscube {' '.join(arguments)} ended with {process.returncode}: {process.stderr}")
    return process.stdout


class Lens:
    """A lens on a film, and its field points over the area of the film."""

    def __init__(self, name, width, height, pitch_um):
        self.name, self.width, self.height, self.pitch_um = name, width, height, pitch_um
        self.film = ["--film-size", f"{width}x{height}", "--film-pitch-um", pitch_um]
        rows = list(csv.DictReader(io.StringIO(lenscube("lens", "export", name, "--as", "lut", *self.film, "-q"))))
        column = lambda key: np.array([float(row[key]) for row in rows])
        angle, self.ideal_mm, self.real_mm = column("field_angle_deg"), column("ideal_height_mm"), column("image_height_mm")
        self.illumination = column("relative_illumination")
        tan = np.tan(np.radians(angle))
        azimuth = np.radians(np.arange(0, 360, 7.5))[:, None]
        at = lambda radius: np.stack([(radius * np.cos(azimuth)), (radius * np.sin(azimuth))], -1)
        # Directions, and film positions in pixels from the axis.
        self.direction, self.offset = at(tan), at(self.real_mm / (1e-3 * pitch_um))
        half = (np.array([width, height]) - 1) / 2
        inside = (np.abs(self.offset) <= half).all(-1)
        self.direction, self.offset = self.direction[inside], self.offset[inside]
        self.radius = self.real_mm / (1e-3 * pitch_um)
        self.tan, self.angle = tan, np.radians(angle)

    def export(self, *arguments):
        """The report, and the file, of an export."""
        file = Path(exports.name) / f"{self.name}-{done}"
        report = json.loads(lenscube("lens", "export", self.name, file, *arguments, *self.film, "--json"))
        return report, file

    def compare(self, what, position, centre, report, residual="distortion"):
        """Positions of the field points by another program, in pixels."""
        error = np.linalg.norm(position - centre - self.offset, axis=-1).max()
        allowed = report["residuals"][residual]["max_px"]
        print(f"{self.name}, {what}: {error:.5f} px from the lens, residual {allowed:.5f} px")
        check(error <= allowed + ROUNDING, f"{what} of {self.name}: {error} px from the lens, the residual is {allowed} px")
        # A test that passes for any model is no test: the model must be as far off as it says, but for the places between the points.
        check(error >= 0.5 * allowed - ROUNDING, f"{what} of {self.name}: {error} px from the lens, the residual is {allowed} px")

    def back(self, what, normalised, report):
        """Directions of the film positions by another program, whose iterations have an error of their own."""
        tan = np.linalg.norm(normalised, axis=-1)
        expected = np.linalg.norm(self.direction, axis=-1)
        # As film pixels: by the lens, whose table is dense.
        real = lambda t: np.interp(np.arctan(t), self.angle, self.radius)
        error = np.abs(real(tan) - real(expected))[tan < self.tan[-1]].max()
        allowed = report["residuals"]["distortion"]["max_px"]
        print(f"{self.name}, {what}: {error:.5f} px from the lens, residual {allowed:.5f} px")
        check(error <= 1.2 * allowed + 10 * ROUNDING, f"{what} of {self.name}: {error} px from the lens")


def calibration(file):
    """Camera matrix and coefficients of a YAML."""
    storage = cv2.FileStorage(str(file), cv2.FILE_STORAGE_READ)
    matrix, k = storage.getNode("camera_matrix").mat(), storage.getNode("distortion_coefficients").mat()
    check(matrix.shape == (3, 3) and k.shape[0] == 1, f"{file}: {matrix}, {k}")
    return matrix, k


def opencv(lens, terms):
    """cv2.projectPoints and cv2.undistortPoints."""
    report, file = lens.export("--as", "opencv", "--terms", terms)
    matrix, k = calibration(file)
    points = np.concatenate([lens.direction, np.ones((len(lens.direction), 1))], -1)
    projected, _ = cv2.projectPoints(points[:, None], np.zeros(3), np.zeros(3), matrix, k)
    centre = matrix[:2, 2]
    check((centre == [(lens.width - 1) / 2, (lens.height - 1) / 2]).all(), f"principal point {centre}")
    lens.compare(f"cv2.projectPoints with {terms} terms", projected[:, 0], centre, report)
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 200, 1e-12)
    undistorted = cv2.undistortPoints((lens.offset + centre)[:, None], matrix, k, criteria=criteria)
    lens.back(f"cv2.undistortPoints with {terms} terms", undistorted[:, 0], report)
    return matrix, k, report


def opencv_fisheye(lens):
    """cv2.fisheye."""
    report, file = lens.export("--as", "opencv-fisheye")
    matrix, k = calibration(file)
    centre = matrix[:2, 2]
    distorted = cv2.fisheye.distortPoints(lens.direction[:, None], matrix, k.ravel())
    lens.compare("cv2.fisheye.distortPoints", distorted[:, 0], centre, report)
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 200, 1e-12)
    undistorted = cv2.fisheye.undistortPoints((lens.offset + centre)[:, None], matrix, k.ravel(), criteria=criteria)
    lens.back("cv2.fisheye.undistortPoints", undistorted[:, 0], report)


def colmap(lens, model):
    """pycolmap's cameras."""
    report, file = lens.export("--as", "colmap", "--colmap-model", model)
    line = [line for line in file.read_text().splitlines() if not line.startswith("#")][0].split()
    camera = pycolmap.Camera(camera_id=int(line[0]), model=line[1], width=int(line[2]), height=int(line[3]), params=[float(v) for v in line[4:]])
    check(camera.verify_params() and line[1] == model, f"camera {line}")
    points = np.concatenate([lens.direction, np.ones((len(lens.direction), 1))], -1)
    centre = np.array([lens.width, lens.height]) / 2
    lens.compare(f"pycolmap {model}", camera.img_from_cam(points), centre, report)
    normalised = camera.cam_from_img(lens.offset + centre)
    valid = np.isfinite(normalised).all(-1)
    check(valid.mean() > 0.9, f"{model} of {lens.name}: no ray of {1 - valid.mean():.0%} of the film positions")


def ftheta(lens):
    """Both polynomials of the rig, by NumPy."""
    report, file = lens.export("--as", "ftheta")
    properties = json.loads(file.read_text())["rig"]["sensors"][0]["properties"]
    forward, inverse = ([float(v) for v in properties[key].split()] for key in ("polynomial", "bw-poly"))
    check(float(properties["cx"]) == lens.width / 2 and len(forward) == len(inverse) == 6, f"rig {properties}")
    tan = np.linalg.norm(lens.direction, axis=-1)
    radius = np.polynomial.polynomial.polyval(np.arctan(tan), forward)
    lens.compare("f-theta", lens.direction * (radius / np.maximum(tan, 1e-300))[:, None], 0, report)
    angle = np.polynomial.polynomial.polyval(lens.radius, inverse)
    error = np.abs(np.interp(angle, lens.angle, lens.radius) - lens.radius)[angle < lens.angle[-1]].max()
    check(error <= 1.2 * report["residuals"]["inverse"]["max_px"] + ROUNDING, f"inverse of f-theta of {lens.name}: {error} px")


def lensfun(lens, projection):
    """Corrected pixels in lensfun: where it reads them in the film."""
    report, file = lens.export("--as", "lensfun")
    database = lensfunpy.Database(xml=file.read_text(), load_common=False, load_bundled=False)
    check(len(database.lenses) == 1, f"{len(database.lenses)} lenses")
    found, coefficients = database.lenses[0], report["coefficients"]
    check(found.type == projection, f"projection {found.type}")
    focal = coefficients["focal"]
    modifier = lensfunpy.Modifier(found, coefficients["cropfactor"], lens.width, lens.height)
    aperture = found.min_aperture
    modifier.initialize(focal, aperture, scale=1.0, targeom=found.type, pixel_format=np.float64, flags=lensfunpy.ModifyFlags.ALL)
    centre = np.array([lens.width - 1, lens.height - 1]) / 2
    # One pixel at a time: of four or more coordinates lensfun takes square roots and reciprocals of 12 bits by SSE.
    columns, rows = np.meshgrid(np.linspace(0, lens.width - 1, 41).astype(int), np.linspace(0, lens.height - 1, 41).astype(int))
    pixel = np.stack([columns.ravel(), rows.ravel()], -1) - centre
    source = np.array([modifier.apply_subpixel_geometry_distortion(x, y, 1, 1)[0, 0] for x, y in zip(columns.ravel(), rows.ravel())])
    radius = np.linalg.norm(pixel, axis=-1)
    # This version measures the film between the centres of its outermost pixels, the file between their outer edges: its positions times `zoom` are those of
    # the file's pixels.
    sides = sorted((lens.width, lens.height))
    aspect = [np.hypot(1, long / short) for short, long in (sides, [n - 1 for n in sides])]
    zoom = sides[0] / (sides[0] - 1) * aspect[0] / aspect[1]
    # The corrected picture has the focal length f/(1 - a - b - c).
    u = zoom * radius * 1e-3 * lens.pitch_um / focal
    rectilinear = projection == lensfunpy.LensType.RECTILINEAR
    tan = u if rectilinear else np.tan(np.minimum(u, 1.57))
    within = (tan < lens.tan[-1]) & (radius > 0)
    wavelengths = report["wavelengths_nm"]
    for channel, name in enumerate(("red", "distortion", "blue")):
        rows = lenscube("lens", "export", lens.name, "--as", "lut", "--band", wavelengths[channel], *lens.film, "-q")
        rows = list(csv.DictReader(io.StringIO(rows)))
        angle = np.radians([float(row["field_angle_deg"]) for row in rows])
        real = np.array([float(row["image_height_mm"]) for row in rows]) / (1e-3 * lens.pitch_um)
        expected = np.interp(np.arctan(tan), angle, real)
        at = zoom * np.linalg.norm(source[:, channel] - centre, axis=-1)
        on_film = within & (expected < real[-1] - 1) & (np.abs(pixel * (expected / np.maximum(radius, 1e-9))[..., None]) <= centre).all(-1)
        error = np.abs(at - expected)[on_film].max()
        residuals = report["residuals"]
        allowed = residuals["distortion"]["max_px"] + (residuals[name]["max_px"] if name != "distortion" else 0)
        print(f"{lens.name}, lensfun {name}: {error:.5f} px from the lens, residual {allowed:.5f} px")
        check(error <= allowed + 0.01, f"lensfun {name} of {lens.name}: {error} px from the lens")
    image = np.ones((lens.height, lens.width, 3))
    check(modifier.apply_color_modification(image), "no relative illumination")
    # The picture is divided by the model: a uniform one shows its reciprocal.
    y, x = np.mgrid[0:lens.height, 0:lens.width]
    radius = np.hypot(x - centre[0], y - centre[1])
    expected = np.interp(radius, lens.radius, lens.illumination)
    inner = radius < lens.radius[-1]
    error = np.abs(1 / image[..., 1] - expected)[inner].max()
    allowed = report["relative_illumination_error"]
    print(f"{lens.name}, lensfun relative illumination: {error:.5f} from the lens, residual {allowed:.5f}")
    check(error <= 1.1 * allowed + 2e-3, f"relative illumination of {lens.name} in lensfun: {error} from the lens")


def film(lens, matrix, k, report, nm):
    """cv2.projectPoints of the ideal points that the pixels of a film of `lenscube run` hold."""
    margin = 100
    height, width = lens.height + 2 * margin, lens.width + 2 * margin
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    ideal = []
    with tempfile.TemporaryDirectory() as directory:
        directory = Path(directory)
        for axis, values in (("x", x), ("y", y)):
            # Values are above 0.
            np.save(directory / f"{axis}.npy", values[None] + 1)
            lenscube("run", directory / f"{axis}.npy", directory / f"{axis}.zarr", "--lens", lens.name, "--wavelengths", nm, *lens.film, "--stages", "distortion")
            lenscube("export", directory / f"{axis}.zarr", directory / f"{axis}-film.npy")
            ideal.append(np.load(directory / f"{axis}-film.npy")[0].astype(float) - 1)
    centre = (np.array([width, height]) - 1) / 2
    directions = (np.stack(ideal, -1) - centre) / report["focal_length_px"]
    flat = np.concatenate([directions.reshape(-1, 2), np.ones((directions[..., 0].size, 1))], -1)
    projected, _ = cv2.projectPoints(flat[:, None], np.zeros(3), np.zeros(3), matrix, k)
    y, x = np.mgrid[0:lens.height, 0:lens.width]
    error = np.linalg.norm(projected[:, 0] - np.stack([x, y], -1).reshape(-1, 2), axis=-1).max()
    allowed = report["residuals"]["distortion"]["max_px"]
    print(f"{lens.name}, film: cv2.projectPoints {error:.5f} px from the pixels, residual {allowed:.5f} px")
    check(error <= allowed + ROUNDING, f"film of {lens.name}: cv2.projectPoints {error} px from the pixels")


phone = Lens("phone", 1200, 900, 3)
gauss = Lens("double-gauss-28", 1500, 1000, 24)
fisheye = Lens("fisheye-170", 1001, 1001, 12)
for lens in (phone, gauss):
    for terms in (8, 5):
        matrix, k, report = opencv(lens, terms)
    film(lens, matrix, k, report, report["wavelengths_nm"][0])
    for model in ("OPENCV", "FULL_OPENCV", "RADIAL", "OPENCV_FISHEYE"):
        colmap(lens, model)
    lensfun(lens, lensfunpy.LensType.RECTILINEAR)
for lens in (phone, gauss, fisheye):
    opencv_fisheye(lens)
    ftheta(lens)
colmap(fisheye, "OPENCV_FISHEYE")
lensfun(fisheye, lensfunpy.LensType.FISHEYE)
exports.cleanup()
print(f"check-exchange: {done} checks, OpenCV {cv2.__version__}, lensfun {'.'.join(map(str, lensfunpy.lensfun_version[:3]))}, pycolmap {pycolmap.__version__}")
