//! Summary of a lens pack, printed by `lens show` as text (`Display`) or JSON (serde).
//!
//! ```text
//! distortion = (real - ideal)/ideal of the last field point, ideal = f·tan(field) with the DISTORTION focal length f
//! lateral colour = real height minus that of the band nearest the primary wavelength, at the last ideal height common to both
//! boresight = film place whose ideal point is the centre; shift beyond it = largest distance of (film − ideal) from it
//! Nyquist pitch = λ·N/2, N = the F-number: the OTF of a lens ends at 1/(λ·N) (autocorrelation of the pupil, 2·NA/λ)
//! ```

mod planar;

use super::pack::LensPack;
use super::read::PackGhosts;
use pipeline::lens::depth::LensDepth;
use pipeline::lens::{LensBand, PsfSample};
pub use planar::{PlanarBandSummary, PlanarSummary, PsfFieldSummary};
use serde::Serialize;
use std::fmt;

/// Number of bands listed by default.
const LISTED_BANDS: usize = 5;

/// Summary of a lens.
#[derive(Clone, Debug, Serialize)]
pub struct LensSummary {
    /// Name.
    pub name: String,
    /// Path of the pack.
    pub path: String,
    /// Distortion focal length, mm.
    pub distortion_focal_length_mm: f64,
    /// Effective focal length, mm.
    pub effective_focal_length_mm: f64,
    /// F-number.
    pub f_number: f64,
    /// Primary wavelength, nm.
    pub primary_wavelength_nm: f64,
    /// Object distance, mm; null = infinity.
    pub object_distance_mm: Option<f64>,
    /// Magnification.
    pub magnification: f64,
    /// Definition of the image plane.
    pub image_plane: Option<String>,
    /// Image plane minus paraxial focus, mm.
    pub defocus_mm: Option<f64>,
    /// Number of bands in the pack.
    pub bands: usize,
    /// First and last wavelength, nm.
    pub wavelength_nm: [f64; 2],
    /// Half field common to all bands, mm of ideal height; `None` for a lens without rotational symmetry.
    pub ideal_field_mm: Option<f64>,
    /// Half field common to all bands, mm of real height; `None` for a lens without rotational symmetry.
    pub image_field_mm: Option<f64>,
    /// The same in degrees; `None` unless the object is at infinity.
    pub field_deg: Option<f64>,
    /// "point" or "integrated".
    pub psf_sample: &'static str,
    /// Consequences of sample kind and pitch.
    pub sampling: String,
    /// "PSFs", or "pupil functions" that PSFs are computed from.
    pub stored: &'static str,
    /// Whether its maker sealed it.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub sealed: bool,
    /// Rings of its ghosts, and the reflectance of the film that they contain.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ghosts: Option<String>,
    /// Depth nodes and focus.
    pub depth: Option<String>,
    /// Defaults used for missing arrays and attributes.
    pub notes: Vec<String>,
    /// The listed bands of a lens with rotational symmetry.
    pub table: Vec<BandSummary>,
    /// Of a lens without rotational symmetry.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub planar: Option<PlanarSummary>,
}

/// Summary of one band; "edge" is the last field point or height.
#[derive(Clone, Debug, Serialize)]
pub struct BandSummary {
    /// Wavelength, nm.
    pub wavelength_nm: f64,
    /// Real height of the last field point, mm.
    pub edge_height_mm: f64,
    /// Relative illumination there.
    pub edge_illumination: f64,
    /// Distortion there, per cent.
    pub edge_distortion_percent: f64,
    /// Lateral colour against the primary wavelength, µm.
    pub lateral_colour_um: f64,
    /// Side of the PSF window, samples.
    pub psf_size: usize,
    /// Side of the PSF window, µm.
    pub psf_window_um: f64,
    /// Sample pitch, µm.
    pub psf_pitch_um: f64,
    /// λ·N/2, µm.
    pub nyquist_pitch_um: f64,
    /// Share of the energy inside the window: on axis, at the edge, and the minimum of all heights.
    pub energy: [f64; 3],
    /// Number of heights.
    pub heights: usize,
    /// Real height of the last PSF, mm.
    pub last_psf_height_mm: f64,
    /// Minimum and maximum number of azimuths off axis.
    pub azimuths: [usize; 2],
    /// Number of nodes of the PSF field.
    pub nodes: usize,
}

/// Summary of an open pack, with all bands or about five. `rotation_error`: estimated L1 error (a ratio) of the rotation of an integrated
/// pack's kernels by other angles than multiples of 90°, if known.
pub fn summary(pack: &LensPack, all_bands: bool, rotation_error: Option<f64>) -> LensSummary {
    let lens = pack.lens();
    let bands = &lens.bands;
    let distance = |b: &&LensBand| (b.wavelength_nm - lens.primary_wavelength_nm).abs();
    let primary = bands.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)));
    let is_listed = |&b: &usize| {
        (0..LISTED_BANDS).any(|i| b == (i * (bands.len() - 1) + (LISTED_BANDS - 1) / 2) / (LISTED_BANDS - 1))
    };
    let listed = (0..bands.len()).filter(|b| all_bands || is_listed(b)).map(|b| &bands[b]);
    let minimum = |value: fn(&LensBand) -> f64| bands.iter().map(value).fold(f64::INFINITY, f64::min);
    let other = pack.attributes();
    let (table, planar) = match pack.is_symmetric() {
        true => (listed.map(|b| band_summary(b, primary.unwrap_or(b), lens.f_number)).collect(), None),
        false => (Vec::new(), Some(planar::summary(listed, lens, other))),
    };
    let of_heights = |value: fn(&LensBand) -> f64| pack.is_symmetric().then(|| minimum(value));
    let ideal_field_mm = of_heights(|b| last(&b.ideal_height_mm));
    LensSummary {
        name: lens.name.clone(),
        path: pack.path().display().to_string(),
        distortion_focal_length_mm: lens.distortion_focal_length_mm,
        effective_focal_length_mm: lens.effective_focal_length_mm,
        f_number: lens.f_number,
        primary_wavelength_nm: lens.primary_wavelength_nm,
        object_distance_mm: lens.object_distance_mm,
        magnification: lens.magnification,
        image_plane: other.image_plane.clone(),
        defocus_mm: other.defocus_mm,
        bands: bands.len(),
        wavelength_nm: [minimum(|b| b.wavelength_nm), -minimum(|b| -b.wavelength_nm)],
        ideal_field_mm,
        image_field_mm: of_heights(|b| last(&b.image_height_mm)),
        field_deg: match lens.object_distance_mm {
            None => ideal_field_mm.map(|mm| (mm / lens.distortion_focal_length_mm).atan().to_degrees()),
            Some(_) => None,
        },
        psf_sample: match lens.psf_sample {
            PsfSample::Point => "point",
            PsfSample::Integrated => "integrated",
        },
        sampling: match lens.psf_sample {
            PsfSample::Point => point_sampling(bands, lens.f_number),
            PsfSample::Integrated => integrated_sampling(rotation_error),
        },
        sealed: other.sealed,
        stored: if pack.has_pupils() { "pupil functions" } else { "PSFs" },
        ghosts: pack.ghosts().map(ghosts_summary),
        depth: lens.depth.as_ref().map(depth_summary),
        notes: pack.notes().to_vec(),
        table,
        planar,
    }
}

fn ghosts_summary(ghosts: &PackGhosts) -> String {
    let of = |r: f64| format!("{}", (1e4 * r).round() / 1e2);
    let least = ghosts.film_reflectance.iter().copied().fold(f64::INFINITY, f64::min);
    let most = ghosts.film_reflectance.iter().copied().fold(0.0, f64::max);
    let share = if least == most { of(most) } else { format!("{} to {}", of(least), of(most)) };
    let (rings, corner) = (ghosts.sizes.rings, ghosts.sizes.corner_mm());
    format!("{rings} rings to {corner:.4} mm; the film reflects {share} %")
}

fn band_summary(band: &LensBand, primary: &LensBand, f_number: f64) -> BandSummary {
    let (ideal, real) = (last(&band.ideal_height_mm), last(&band.image_height_mm));
    let common = ideal.min(last(&primary.ideal_height_mm));
    let off_axis = &band.azimuth_count[1..];
    BandSummary {
        wavelength_nm: band.wavelength_nm,
        edge_height_mm: real,
        edge_illumination: last(&band.relative_illumination),
        edge_distortion_percent: 100.0 * (real - ideal) / ideal,
        lateral_colour_um: 1000.0 * (image_height(band, common) - image_height(primary, common)),
        psf_size: band.psf_size,
        psf_window_um: band.psf_size as f64 * band.psf_pitch_um,
        psf_pitch_um: band.psf_pitch_um,
        nyquist_pitch_um: nyquist_pitch_um(band, f_number),
        energy: [
            band.psf_energy[0],
            last(&band.psf_energy),
            band.psf_energy.iter().copied().fold(f64::INFINITY, f64::min),
        ],
        heights: band.psf_height_mm.len(),
        last_psf_height_mm: last(&band.psf_height_mm),
        azimuths: [off_axis.iter().copied().min().unwrap_or(1), off_axis.iter().copied().max().unwrap_or(1)],
        nodes: band.azimuth_count.iter().sum(),
    }
}

fn nyquist_pitch_um(band: &LensBand, f_number: f64) -> f64 {
    band.wavelength_nm * 1e-3 * f_number / 2.0
}

/// Last number of a table; every valid table has at least two.
fn last(table: &[f64]) -> f64 {
    table[table.len() - 1]
}

/// Real height at an ideal height inside the table, linear between field points.
fn image_height(band: &LensBand, ideal: f64) -> f64 {
    let (x, y) = (&band.ideal_height_mm, &band.image_height_mm);
    let i = x.partition_point(|&v| v < ideal).clamp(1, x.len() - 1);
    y[i - 1] + (y[i] - y[i - 1]) * (ideal - x[i - 1]) / (x[i] - x[i - 1])
}

fn depth_summary(depth: &LensDepth) -> String {
    let nodes = depth.bands.iter().map(|b| b.nodes.len());
    let ends = depth.bands.iter().filter_map(|b| b.vergence.first().copied().zip(b.vergence.last().copied()));
    let (first, last) =
        ends.fold((f64::INFINITY, 0.0f64), |(a, z), (first, last)| (a.min(first), z.max(last)));
    format!(
        "{} to {} nodes a band at {:.4} to {:.4} m, in focus {:.4} m; the blur radius grows by {:.1} µm per dioptre; tables below: the node nearest to focus",
        nodes.clone().min().unwrap_or(0),
        nodes.max().unwrap_or(0),
        1.0 / last,
        1.0 / first,
        depth.focus_distance_m,
        depth.blur_per_dioptre_um
    )
}

fn integrated_sampling(rotation_error: Option<f64>) -> String {
    let elsewhere = match rotation_error {
        Some(e) => format!("rotated by cubic interpolation elsewhere: estimated L1 error {:.1} %", 100.0 * e),
        None => "rotated by cubic interpolation elsewhere, with unknown error".into(),
    };
    format!(
        "samples already integrated over the psf pitch: exact at multiples of 90° on film of that pitch, {elsewhere}"
    )
}

fn point_sampling(bands: &[LensBand], f_number: f64) -> String {
    let coarse: Vec<String> = bands
        .iter()
        .filter(|b| b.psf_pitch_um > nyquist_pitch_um(b, f_number))
        .map(|b| {
            let (nm, limit) = (b.wavelength_nm, nyquist_pitch_um(b, f_number));
            format!("{nm} nm ({:.3} > {limit:.3} µm)", b.psf_pitch_um)
        })
        .collect();
    if coarse.is_empty() {
        "point samples finer than Nyquist (λ·N/2) in every band: rotated by interpolation, then integrated over the film pixel".into()
    } else {
        format!(
            "point samples COARSER than Nyquist (λ·N/2), so their rotation aliases, at {}",
            coarse.join(", ")
        )
    }
}

impl fmt::Display for LensSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}  ({})", self.name, self.path)?;
        writeln!(
            f,
            "focal length   {:.6} mm for distortion, {:.6} mm effective, at {} nm; f/{:.3}",
            self.distortion_focal_length_mm,
            self.effective_focal_length_mm,
            self.primary_wavelength_nm,
            self.f_number
        )?;
        match self.object_distance_mm {
            None => write!(f, "object         at infinity")?,
            Some(d) => write!(f, "object         at {d} mm, magnification {}", self.magnification)?,
        }
        match (&self.image_plane, self.defocus_mm) {
            (Some(text), _) => writeln!(f, "; image plane {text}")?,
            (None, Some(mm)) => writeln!(f, "; image plane {mm} mm from the paraxial focus")?,
            (None, None) => writeln!(f)?,
        }
        let [first, last] = self.wavelength_nm;
        writeln!(f, "bands          {}, {first}..{last} nm", self.bands)?;
        if let Some((ideal_mm, image_mm)) = self.ideal_field_mm.zip(self.image_field_mm) {
            write!(f, "half field     {ideal_mm:.4} mm ideal, {image_mm:.4} mm real")?;
            match self.field_deg {
                Some(deg) => writeln!(f, ", {deg:.3}°")?,
                None => writeln!(f)?,
            }
        }
        writeln!(f, "sampling       {}; stored as {}", self.sampling, self.stored)?;
        if self.sealed {
            writeln!(
                f,
                "sealed         by its maker: without design, coatings, drawn errors and names of files"
            )?;
        }
        if let Some(planar) = &self.planar {
            planar.write_head(f)?;
        }
        if let Some(depth) = &self.depth {
            writeln!(f, "depth          {depth}")?;
        }
        if let Some(ghosts) = &self.ghosts {
            writeln!(f, "ghosts         {ghosts}")?;
        }
        for note in &self.notes {
            writeln!(f, "note           {note}")?;
        }
        writeln!(f)?;
        let listed = match &self.planar {
            Some(planar) => {
                planar.write_table(f)?;
                planar.table.len()
            }
            None => {
                self.write_table(f)?;
                self.table.len()
            }
        };
        if listed < self.bands {
            writeln!(f, "({listed} of {} bands)", self.bands)?;
        }
        Ok(())
    }
}

impl LensSummary {
    /// The bands of a lens with rotational symmetry.
    fn write_table(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "     nm  edge mm  edge RI  distortion %  lateral µm  window px (µm)  pitch µm  Nyquist  energy axis/edge/min   heights to mm  azimuths   nodes"
        )?;
        for b in &self.table {
            let window = format!("{} ({:.1})", b.psf_size, b.psf_window_um);
            let energy = b.energy.map(|e| format!("{e:.4}")).join("/");
            let heights = format!("{} to {:.3}", b.heights, b.last_psf_height_mm);
            let azimuths = match b.azimuths {
                [a, z] if a == z => a.to_string(),
                [a, z] => format!("{a}..{z}"),
            };
            writeln!(
                f,
                "{:7.2}  {:7.4}  {:7.5}  {:12.4}  {:10.3}  {window:>14}  {:8.3}  {:7.3}  {energy:>21}  {heights:>13}  {azimuths:>8}  {:6}",
                b.wavelength_nm,
                b.edge_height_mm,
                b.edge_illumination,
                b.edge_distortion_percent,
                b.lateral_colour_um,
                b.psf_pitch_um,
                b.nyquist_pitch_um,
                b.nodes
            )?;
        }
        Ok(())
    }
}
