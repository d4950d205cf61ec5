//! A lens's identity: blake3 over every number that changes pixels, in a fixed order, little endian.
//!
//! ```text
//! line, then f64: focal lengths, F-number, primary wavelength, object distance (NaN = infinity), magnification; u64: sample, B
//! per band: f64 wavelength; u64 M, K, n; f64 tables; u64 azimuths; f64 energies, pitch, solid angle, transmission; f32 PSFs
//! ```
//! Values are hashed as the pipeline sees them (PSFs in f32, normalised), so how they are stored does not matter.

use pipeline::lens::{Lens, LensBand, PsfSample, PsfStack};

/// Samples turned to bytes at a time.
const PIECE: usize = 16384;

/// Of all bands; `psf` reads the PSFs of one.
pub(super) fn of<E>(lens: &Lens, mut psf: impl FnMut(usize) -> Result<PsfStack, E>) -> Result<String, E> {
    let mut h = head(lens, lens.bands.len());
    for (b, band) in lens.bands.iter().enumerate() {
        add(&mut h, band, &psf(b)?);
    }
    Ok(h.finalize().to_hex().to_string())
}

/// The same of band `band` alone, whose PSFs are `stack`.
pub(super) fn of_band(lens: &Lens, band: usize, stack: &PsfStack) -> String {
    let mut h = head(lens, 1);
    add(&mut h, &lens.bands[band], stack);
    h.finalize().to_hex().to_string()
}

fn head(lens: &Lens, bands: usize) -> blake3::Hasher {
    let mut h = blake3::Hasher::new();
    h.update(b"lenscube/lens-pack/1 digest\n");
    reals(
        &mut h,
        &[
            lens.distortion_focal_length_mm,
            lens.effective_focal_length_mm,
            lens.f_number,
            lens.primary_wavelength_nm,
            lens.object_distance_mm.unwrap_or(f64::NAN),
            lens.magnification,
        ],
    );
    let sample = match lens.psf_sample {
        PsfSample::Point => 0,
        PsfSample::Integrated => 1,
    };
    counts(&mut h, &[sample, bands]);
    h
}

fn add(h: &mut blake3::Hasher, band: &LensBand, stack: &PsfStack) {
    tables(h, band);
    for piece in stack.samples.chunks(PIECE) {
        let bytes: Vec<u8> = piece.iter().flat_map(|v| v.to_le_bytes()).collect();
        h.update(&bytes);
    }
}

fn tables(h: &mut blake3::Hasher, band: &LensBand) {
    reals(h, &[band.wavelength_nm]);
    counts(h, &[band.ideal_height_mm.len(), band.psf_height_mm.len(), band.psf_size]);
    for table in
        [&band.ideal_height_mm, &band.image_height_mm, &band.relative_illumination, &band.psf_height_mm]
    {
        reals(h, table);
    }
    counts(h, &band.azimuth_count);
    reals(h, &band.psf_energy);
    reals(h, &[band.psf_pitch_um, band.solid_angle_sr, band.transmission]);
}

fn reals(h: &mut blake3::Hasher, values: &[f64]) {
    values.iter().for_each(|v| {
        h.update(&v.to_le_bytes());
    });
}

fn counts(h: &mut blake3::Hasher, values: &[usize]) {
    values.iter().for_each(|&v| {
        h.update(&(v as u64).to_le_bytes());
    });
}
