//! A cube of PSFs as FITS, with the cards that `photutils.psf.GriddedPSFModel.read` and `stpsf.utils.to_griddedpsfmodel` read.
//!
//! ```text
//! data       (place, y, x), 32-bit floats; places along x fastest
//! OVERSAMP   samples a film pixel            DET_YXi  '(y, x)' of place i, film pixels from 0           NUM_PSFS  places
//! ENERGYi    share of all light in PSF i     PITCH_UM film pitch     AXIS_X, AXIS_Y  the lens's axis    WAVELEN   m
//! ```
//! `GriddedPSFModel(flux=F, x_0, y_0)` is then the light in the film pixels of a point of F in all. STPSF takes the values of DET_YXi as their names say;
//! photutils up to 3.0 as (x, y).

use std::path::Path;

use super::{BandPsfs, PsfGrid, PsfGridError, verify, write};
use crate::durable::AtomicFile;
use crate::fits::{Cards, padding, samples};

/// Maximum of places: their keys have two digits.
pub const MAX_PLACES: usize = 100;

/// The file of the PSFs `band` of `grid` at its wavelength `index`, complete and read again, but for its name.
///
/// # Errors
/// [`PsfGridError`].
///
/// # Panics
/// There are more than [`MAX_PLACES`].
pub fn file(path: &Path, grid: &PsfGrid, index: usize, band: &BandPsfs) -> Result<AtomicFile, PsfGridError> {
    let file = AtomicFile::create(path)?;
    let (mut out, mut digest) = (file.writer(), blake3::Hasher::new());
    let mut put = |bytes: &[u8]| write(&mut out, &mut digest, path, bytes);
    put(&header(grid, index, band))?;
    let psf = grid.side() * grid.side();
    band.samples.chunks(psf).try_for_each(|psf| put(&samples(psf)))?;
    put(&padding(4 * band.samples.len()))?;
    verify(&file, path, &digest)?;
    Ok(file)
}

fn header(grid: &PsfGrid, index: usize, band: &BandPsfs) -> Vec<u8> {
    assert!(grid.places() <= MAX_PLACES, "keys of two digits");
    let (n, nm) = (grid.side(), grid.wavelengths_nm[index]);
    let mut cards = Cards::of_f32(&[n, n, grid.places()]);
    cards.text("INSTRUME", "lenscube", "program");
    cards.text("DETECTOR", &format!("{} px of {} um", grid.film, grid.pitch_um), "film, width x height");
    cards.text("FILTER", &format!("{nm} nm"), "wavelength");
    cards.text("LENS", &grid.lens, "");
    cards.real("FNUMBER", grid.f_number, "image-space F-number");
    cards.real("WAVELEN", nm / 1e9, "wavelength, m");
    cards.integer("FOVPIXEL", grid.window_px as i64, "side of a PSF in film pixels");
    cards.integer("OVERSAMP", grid.oversample as i64, "samples a film pixel");
    cards.integer("DET_SAMP", grid.oversample as i64, "samples a film pixel");
    cards.real("PITCH_UM", grid.pitch_um, "film pixel pitch, um");
    cards.real("AXIS_X", (grid.film.width - 1) as f64 / 2.0, "axis of the lens, film pixels from 0");
    cards.real("AXIS_Y", (grid.film.height - 1) as f64 / 2.0, "axis of the lens, film pixels from 0");
    let places = grid.y_px.iter().flat_map(|y| grid.x_px.iter().map(move |x| (*y, *x)));
    for (i, (y, x)) in places.enumerate() {
        cards.text(&format!("DET_YX{i}"), &format!("({y:?}, {x:?})"), "place (y, x), film pixels from 0");
    }
    cards.integer("NUM_PSFS", grid.places() as i64, "number of places");
    for (i, energy) in band.energy.iter().enumerate() {
        cards.real(&format!("ENERGY{i}"), *energy, "share of all light in this PSF");
    }
    cards.text("NORMALIZ", "all light of the point", "sum of PSF i = OVERSAMP^2 * ENERGYi");
    cards.text("VERSION", concat!("lenscube ", env!("CARGO_PKG_VERSION")), "");
    for line in [
        "Effective PSFs: a sample is the light in the film pixel about it, over",
        "all light of the point. Rows run down the film, columns to the right;",
        "the chief ray is in the middle. ENERGYi: share of all light in PSF i.",
    ] {
        cards.comment(line);
    }
    cards.end()
}
