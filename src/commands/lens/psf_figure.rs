//! Figure of the PSFs of a lens by field height and wavelength.

use super::psf_sheet::{Labels, PsfSheet, Samples};
use crate::job::lens::samples::{LensSamples, evenly_spaced};
use crate::progress::short_number;
use formats::picture::figure::Figure;
use formats::picture::style::Style;

/// Maximum number of wavelengths and heights.
const MAX_ROWS: usize = 6;
const MAX_COLUMNS: usize = 5;

/// PSFs by field height (columns) and wavelength (rows), all at one scale, with a colour bar.
pub fn psf_figure(samples: &LensSamples, name: &str, style: Style) -> Figure {
    let bands = evenly_spaced(samples.fields.len(), MAX_ROWS);
    let heights = evenly_spaced(samples.fields[0].len(), MAX_COLUMNS);
    let psf = |b: usize, k: usize| {
        let psf = &samples.fields[b][k].psf;
        Samples { size: psf.size, pitch_um: psf.pitch_um, values: &psf.samples }
    };
    let height = |k: &usize| format!("{:.2}", samples.fields[0][*k].height_mm);
    let nm = |b: &usize| short_number(samples.lens.bands[*b].wavelength_nm);
    let sheet = PsfSheet {
        title: format!("{name}: PSF"),
        columns: Labels { name: "real image height (mm)", numbers: heights.iter().map(height).collect() },
        rows: Labels { name: "wavelength (nm)", numbers: bands.iter().map(nm).collect() },
        psfs: bands.iter().flat_map(|&b| heights.iter().map(move |&k| psf(b, k))).collect(),
        note: ["about the chief ray,", "the direction away from the axis to the right"],
    };
    sheet.figure(style)
}
