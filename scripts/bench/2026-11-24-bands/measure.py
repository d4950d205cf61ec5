"""Films of one wavelength for a band against means over its width.

    python3 measure.py LENSCUBE FOLDER                      # measured.json
    python3 measure.py LENSCUBE FOLDER --band-samples       # integrated.json: films of --band-samples 2, 3 and 4 against the same means

The band of width w nm about λ is the mean of the films of λ - w/2 ... λ + w/2 in steps of 1 nm, the two ends with half weight: light of equal
power per nm through a band-pass filter. The other film has the whole band at λ, as `lenscube run` computes it. Discs of 18 px, one every 40 to 110 px,
256 x 256 film pixels of 2 um, on the axis and at 0.7 of the design's field along the diagonal.
Prints, per lens, place and wavelength: the largest and the RMS difference of white, the same after the best common shift of the picture is
taken out (what remains is width), and that shift in pixels.
"""

import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import zarr

# Focal length mm, half field degrees, side of the film px.
LENSES = {"double-gauss-28": (99.50, 14.0, 14000), "phone": (3.91, 22.0, 1400), "triplet": (50.0, 20.0, 12000)}
SIZE, PITCH_UM = 256, 2.0


def films(program, folder, lens, side, wavelength, corner, flags=()):
    path = folder / f"{lens}-{wavelength}-{corner}{''.join(flags)}.zarr"
    if not path.exists():
        chart = f"gen:dot-grid?size={side}&count={min(128, side // 40)}&width_px=18&wavelengths={wavelength - 10}:{wavelength + 10}:1"
        subprocess.run([program, "run", chart, path, "--lens", lens, "--film-pitch-um", str(PITCH_UM), "--roi", f"{corner},{corner},{SIZE},{SIZE}",
                        "--quiet", "--no-fsync", *flags], check=True)
    stack = np.asarray(zarr.open(path)["roi_0"], dtype=float)
    return stack / stack.max(axis=(1, 2), keepdims=True)  # the chart has the spectrum of daylight: here equal power at all wavelengths


def shifted(image, dy, dx):
    spectrum = np.fft.fft2(image)
    ky, kx = np.fft.fftfreq(image.shape[0])[:, None], np.fft.fftfreq(image.shape[1])[None]
    return np.fft.ifft2(spectrum * np.exp(-2j * np.pi * (ky * dy + kx * dx))).real


def best_shift(wanted, image):
    """Least squares in the gradients: shifts here are parts of a pixel."""
    total = np.zeros(2)
    moved = image
    for _ in range(4):
        gy, gx = np.gradient(moved)
        inner = np.s_[8:-8, 8:-8]
        a = np.stack([gy[inner].ravel(), gx[inner].ravel()], axis=1)
        step = np.linalg.lstsq(a, (moved - wanted)[inner].ravel(), rcond=None)[0]
        total += step
        moved = shifted(image, *total)
    return total, moved


def integrated(program, folder):
    """Largest differences, share of white, of bands of 10 and 20 nm at 410 nm: one wavelength, and several."""
    rows = []
    for lens, (focal_mm, field_deg, side) in LENSES.items():
        height_px = 0.7 * focal_mm * math.tan(math.radians(field_deg)) * 1000 / PITCH_UM
        middle = (side - SIZE) // 2
        for place, corner in {"axis": middle, "0.7 field": middle - round(height_px / math.sqrt(2))}.items():
            stack = films(program, folder, lens, side, 410, corner)
            for width in (10, 20):
                weights = np.zeros(21)
                weights[10 - width // 2 : 10 + width // 2 + 1] = 1
                weights[[10 - width // 2, 10 + width // 2]] = 0.5
                mean = np.tensordot(weights / weights.sum(), stack, 1)
                row = dict(lens=lens, place=place, wavelength_nm=410, width_nm=width, one=float(abs(stack[10] - mean).max()))
                for samples in (2, 3, 4):
                    flags = ("--bands", "410", "--band-samples", f"{samples},width={width}")
                    film = films(program, folder, lens, side, 410, corner, flags)[0]
                    row[f"samples_{samples}"] = float(abs(film - mean).max())
                rows.append(row)
                print(row, flush=True)
    Path(__file__).with_name("integrated.json").write_text(json.dumps(rows, indent=1) + "\n")


def main():
    program, folder = sys.argv[1], Path(sys.argv[2])
    if "--band-samples" in sys.argv:
        return integrated(program, folder)
    rows = []
    for lens, (focal_mm, field_deg, side) in LENSES.items():
        height_px = 0.7 * focal_mm * math.tan(math.radians(field_deg)) * 1000 / PITCH_UM
        middle = (side - SIZE) // 2
        for place, corner in {"axis": middle, "0.7 field": middle - round(height_px / math.sqrt(2))}.items():
            for wavelength in (410, 550, 690):
                stack = films(program, folder, lens, side, wavelength, corner)
                for width in (5, 10, 20):
                    if width % 2:  # ends between samples: the mean of the two neighbouring sums
                        weights = np.zeros(21)
                        weights[10 - 2 : 10 + 3] = 1
                    else:
                        weights = np.zeros(21)
                        weights[10 - width // 2 : 10 + width // 2 + 1] = 1
                        weights[[10 - width // 2, 10 + width // 2]] = 0.5
                    mean = np.tensordot(weights / weights.sum(), stack, 1)
                    one = stack[10]
                    difference = one - mean
                    shift, moved = best_shift(mean, one)
                    rest = (moved - mean)[8:-8, 8:-8]
                    row = dict(lens=lens, place=place, wavelength_nm=wavelength, width_nm=width, largest=float(abs(difference).max()),
                               rms=float(np.sqrt((difference**2).mean())), shift_px=float(np.hypot(*shift)), largest_without_shift=float(abs(rest).max()))
                    rows.append(row)
                    print(f"{lens:16} {place:9} {wavelength} nm, {width:2} nm wide: largest {row['largest']:.4f}  rms {row['rms']:.5f}  "
                          f"shift {row['shift_px']:.4f} px  largest without it {row['largest_without_shift']:.4f}", flush=True)
    Path(__file__).with_name("measured.json").write_text(json.dumps(rows, indent=1) + "\n")


main()
