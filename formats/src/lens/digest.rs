//! Digest of a lens: blake3 of every number that affects pixels, in a fixed order, little endian.
//!
//! ```text
//! a line of text, then f64: focal lengths, F-number, primary wavelength, object distance (NaN = infinity), magnification; u64: sample, B
//! per band: f64 wavelength; u64 M, K, n; f64 tables; u64 azimuths; f64 energies, pitch, solid angle, transmission; f32 PSFs
//!   after the transmission, of a band that states a kernel pitch: a line of text, f64
//! ```
//! With depth nodes: of each band its head and tables, then per node vergence, tables and PSFs; of the lens the digests of its bands.
//! Values are hashed as the pipeline uses them (PSFs in f32, normalised), so the digest does not depend on their storage. Pupil functions in place
//! of PSFs are hashed themselves (version of the tracer, segments, values: f64), so they have another digest than the PSFs they give.
//! A band with a tail has a section more: heights, radius and coefficients (f64), and one with a middle part its samples (side, pitch, f32); one with cones another: their distance and directions (f64); one of a pack with ghosts
//! a last one: width of the rings (f64) and the operator (f32).
//!
//! A lens without rotational symmetry has another leading line, and per band:
//! ```text
//! f64 wavelength; u64 nodes of the map in x and y, n; f64 map_x, map_y, map_ideal_x, map_ideal_y, map_relative_illumination
//! a line with `psf_field`; polar: u64 K; f64 heights; u64 J_k, A_k;  grid: u64 columns, rows; f64 psf_x, psf_y
//! f64 energies, pitch, solid angle, transmission; f32 PSFs, or pupil functions
//! ```

use super::attributes::PsfField;
use super::stored::Stored;
use pipeline::design::ghost::rings::RingOperator;
use pipeline::design::pupil_stack::PupilStack;
use pipeline::design::trace::TRACER_VERSION;
use pipeline::lens::cone_field::ConeField;
use pipeline::lens::depth::LensDepth;
use pipeline::lens::planar::{PlanarBand, PsfPlaces};
use pipeline::lens::{Lens, LensBand, PsfSample, PsfStack};

/// Samples converted to bytes at a time.
const BUFFER_SAMPLES: usize = 16384;

/// Digest of all bands; `read` reads one.
pub(super) fn lens_digest<E>(
    lens: &Lens,
    mut read: impl FnMut(usize) -> Result<(Stored, Option<RingOperator>), E>,
) -> Result<String, E> {
    let mut h = hasher_with_head(lens, lens.bands.len());
    for (b, band) in lens.bands.iter().enumerate() {
        let (stored, ghosts) = read(b)?;
        add_stored(&mut h, band, &stored);
        add_ghosts(&mut h, ghosts.as_ref());
    }
    Ok(h.finalize().to_hex().to_string())
}

/// Digest of band `band` alone, stored as `stored`, with its ghosts.
pub(super) fn stored_digest(
    lens: &Lens,
    band: usize,
    (stored, ghosts): (&Stored, Option<&RingOperator>),
) -> String {
    let mut h = hasher_with_head(lens, 1);
    add_stored(&mut h, &lens.bands[band], stored);
    add_ghosts(&mut h, ghosts);
    h.finalize().to_hex().to_string()
}

/// Digest of band `band` alone, with PSFs `stack`: that of [`super::LensPack::band_digest`] of a pack of them.
pub fn band_digest(lens: &Lens, band: usize, stack: &PsfStack) -> String {
    let mut h = hasher_with_head(lens, 1);
    add_band(&mut h, &lens.bands[band], stack);
    h.finalize().to_hex().to_string()
}

/// Digest of band `band` of a lens with depth nodes; `psf` reads the PSFs of a node.
pub(super) fn depth_band_digest<E>(
    lens: &Lens,
    depth: &LensDepth,
    band: usize,
    mut psf: impl FnMut(usize) -> Result<PsfStack, E>,
) -> Result<String, E> {
    let mut h = hasher_with_head(lens, 1);
    let nodes = &depth.bands[band];
    h.update(b"depth nodes\n");
    add_f64(&mut h, &[depth.focus_distance_m, depth.blur_per_dioptre_um]);
    add_counts(&mut h, &[nodes.nodes.len()]);
    add_f64(&mut h, &nodes.pupil_shift_mm);
    for (d, v) in nodes.vergence.iter().enumerate() {
        add_f64(&mut h, &[*v]);
        add_band(&mut h, &nodes.at_node(&lens.bands[band], d), &psf(d)?);
    }
    // Heights at V = 0 and illumination in focus.
    add_tables(&mut h, &lens.bands[band]);
    Ok(h.finalize().to_hex().to_string())
}

/// Digest of a band with depth nodes whose PSFs become known one node after the other, before its tables: other than that of the same band in a pack.
#[derive(Default)]
pub struct DepthBandValues(blake3::Hasher);

impl DepthBandValues {
    /// Adds the PSFs of the next node.
    pub fn add_node(&mut self, stack: &PsfStack) {
        add_samples(&mut self.0, stack);
    }

    /// The digest, with the numbers of `lens`, which has one band.
    pub fn digest(mut self, lens: &Lens) -> String {
        let h = &mut self.0;
        for (b, band) in lens.bands.iter().enumerate() {
            add_tables(h, band);
            add_extras(h, band);
            let Some(depth) = &lens.depth else { continue };
            let nodes = &depth.bands[b];
            h.update(b"depth nodes\n");
            add_f64(h, &[depth.focus_distance_m, depth.blur_per_dioptre_um]);
            add_counts(h, &[nodes.nodes.len()]);
            add_f64(h, &nodes.pupil_shift_mm);
            add_f64(h, &nodes.vergence);
            (0..nodes.nodes.len()).for_each(|node| add_tables(h, &nodes.at_node(band, node)));
        }
        self.0.finalize().to_hex().to_string()
    }
}

/// Digest of a lens with depth nodes from those of its bands.
pub(super) fn depth_digest<E>(
    lens: &Lens,
    depth: &LensDepth,
    bands: impl Iterator<Item = Result<String, E>>,
) -> Result<String, E> {
    let mut h = hasher_with_head(lens, lens.bands.len());
    add_f64(&mut h, &[depth.focus_distance_m, depth.blur_per_dioptre_um]);
    for digest in bands {
        h.update(digest?.as_bytes());
    }
    Ok(h.finalize().to_hex().to_string())
}

fn hasher_with_head(lens: &Lens, bands: usize) -> blake3::Hasher {
    let mut h = blake3::Hasher::new();
    h.update(match lens.bands.iter().all(LensBand::is_symmetric) {
        true => b"lenscube/lens-pack/1 digest\n",
        false => b"lenscube/lens-pack/4 digest\n",
    });
    add_f64(
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
    add_counts(&mut h, &[sample, bands]);
    h
}

fn add_band(h: &mut blake3::Hasher, band: &LensBand, stack: &PsfStack) {
    add_tables(h, band);
    add_samples(h, stack);
    add_extras(h, band);
}

fn add_samples(h: &mut blake3::Hasher, stack: &PsfStack) {
    add_f32(h, &stack.samples);
}

fn add_f32(h: &mut blake3::Hasher, values: &[f32]) {
    for values in values.chunks(BUFFER_SAMPLES) {
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        h.update(&bytes);
    }
}

/// The section of a band's ghosts, only if it has them.
fn add_ghosts(h: &mut blake3::Hasher, ghosts: Option<&RingOperator>) {
    let Some(RingOperator { sizes, values }) = ghosts else { return };
    h.update(b"ghosts\n");
    add_counts(h, &sizes.shape());
    add_f64(h, &[sizes.ring_mm]);
    add_f32(h, values);
}

/// The sections of a band's tail and cones, only if it has them.
fn add_extras(h: &mut blake3::Hasher, band: &LensBand) {
    add_tail(h, band);
    match &band.cones {
        None => {}
        Some(ConeField::Symmetric(table)) => {
            h.update(b"cones\n");
            add_f64(h, &[table.step_mm()]);
            table.directions().for_each(|direction| add_f64(h, &direction));
        }
        Some(ConeField::Planar(grid)) => {
            h.update(b"cones over the film\n");
            let [x_mm, y_mm] = grid.nodes_mm();
            add_counts(h, &[x_mm.len(), y_mm.len()]);
            add_f64(h, x_mm);
            add_f64(h, y_mm);
            grid.cones().iter().for_each(|cone| add_f64(h, cone));
        }
    }
}

fn add_tail(h: &mut blake3::Hasher, band: &LensBand) {
    let Some(tail) = &band.tail else { return };
    h.update(b"tail\n");
    add_counts(h, &[tail.height_mm.len()]);
    add_f64(h, &[tail.inner_mm]);
    add_f64(h, &tail.height_mm);
    tail.coefficients.iter().flatten().for_each(|terms| add_f64(h, terms));
    let Some(middle) = &tail.middle else { return };
    h.update(b"middle\n");
    add_counts(h, &[middle.size]);
    add_f64(h, &[middle.pitch_mm]);
    add_f32(h, &middle.samples);
}

fn add_stored(h: &mut blake3::Hasher, band: &LensBand, stored: &Stored) {
    match stored {
        Stored::Psfs(stack) => add_band(h, band, stack),
        Stored::Pupils(pupils) => add_pupils(h, band, pupils),
    }
}

fn add_pupils(h: &mut blake3::Hasher, band: &LensBand, pupils: &PupilStack) {
    add_tables(h, band);
    h.update(b"pupil functions\n");
    match pupils.is_whole() {
        false => add_parts(h, pupils.parts()),
        true => add_parts(h, pupils.whole_parts()),
    }
    add_extras(h, band);
}

/// Numbers of the segments, and values of all.
fn add_parts<const N: usize>(h: &mut blake3::Hasher, (segments, values): (Vec<[f64; N]>, Vec<f64>)) {
    add_counts(h, &[TRACER_VERSION as usize, segments.len(), values.len()]);
    segments.iter().for_each(|numbers| add_f64(h, numbers));
    add_f64(h, &values);
}

fn add_tables(h: &mut blake3::Hasher, band: &LensBand) {
    add_f64(h, &[band.wavelength_nm]);
    if let Some(planar) = &band.planar {
        return add_planar_tables(h, band, planar);
    }
    add_counts(h, &[band.ideal_height_mm.len(), band.psf_height_mm.len(), band.psf_size]);
    for table in
        [&band.ideal_height_mm, &band.image_height_mm, &band.relative_illumination, &band.psf_height_mm]
    {
        add_f64(h, table);
    }
    add_counts(h, &band.azimuth_count);
    add_f64(h, &band.psf_energy);
    add_f64(h, &[band.psf_pitch_um, band.solid_angle_sr, band.transmission]);
    if let Some(pitch_um) = band.kernel_pitch_um {
        h.update(b"kernel pitch\n");
        add_f64(h, &[pitch_um]);
    }
}

/// The tables of a band without rotational symmetry after its wavelength.
fn add_planar_tables(h: &mut blake3::Hasher, band: &LensBand, planar: &PlanarBand) {
    let map = &planar.map;
    add_counts(h, &[map.x_mm.len(), map.y_mm.len(), band.psf_size]);
    for table in [&map.x_mm, &map.y_mm, &map.ideal_x_mm, &map.ideal_y_mm, &map.relative_illumination] {
        add_f64(h, table);
    }
    let mut add_field = |field: PsfField| {
        h.update(field.name().as_bytes());
        h.update(b"\n");
    };
    match &planar.psfs {
        PsfPlaces::Polar { azimuth_samples } => {
            add_field(PsfField::Polar);
            add_counts(h, &[band.psf_height_mm.len()]);
            add_f64(h, &band.psf_height_mm);
            add_counts(h, &band.azimuth_count);
            add_counts(h, azimuth_samples);
        }
        PsfPlaces::Cartesian { x_mm, y_mm } => {
            add_field(PsfField::Grid);
            add_counts(h, &[x_mm.len(), y_mm.len()]);
            add_f64(h, x_mm);
            add_f64(h, y_mm);
        }
    }
    add_f64(h, &band.psf_energy);
    add_f64(h, &[band.psf_pitch_um, band.solid_angle_sr, band.transmission]);
}

fn add_f64(h: &mut blake3::Hasher, values: &[f64]) {
    values.iter().for_each(|v| {
        h.update(&v.to_le_bytes());
    });
}

fn add_counts(h: &mut blake3::Hasher, values: &[usize]) {
    values.iter().for_each(|&v| {
        h.update(&(v as u64).to_le_bytes());
    });
}
