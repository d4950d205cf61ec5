//! A folder of OpticStudio text listings, recognised by their headers.
//!
//! Required for every wavelength: one listing of distortion (Grid Distortion, or Field Curvature / Distortion), one of Relative
//! Illumination, and PSFs (Huygens or FFT) on the axis and off it. Wavelengths within 0.1 nm are equal, as they are listed with
//! four decimals. Ideal height = f·tan(field) with the f of the distortion listing at the primary wavelength, unless given as an
//! option. The height of a PSF is that of its chief ray, if stated, else that of its field angle. Listings do not state focal
//! length, F-number and primary wavelength: `--efl-mm`, `--f-number`, `--primary-nm`. Fields are angles: the object is at infinity.

use super::dense::{Parity, Spline};
use super::distortion_listing::{Distortion, field_curvature, grid};
use super::illumination_listing::{self, Illumination};
use super::matrix::short;
use super::psf_listing::{self, PsfListing};
use super::window::Outward;
use super::write::{Imported, ReadWindows, SparseBand, SparseLens, Windows};
use super::{ImportError, ImportOptions, text};
use pipeline::lens::PsfSample;
use pipeline::real;
use serde_json::json;
use std::path::{Path, PathBuf};

/// Maximum difference of wavelengths of listings that belong together, nm.
const SAME_NM: f64 = 0.1;

/// Content of the folder; of PSFs only the headers.
#[derive(Default)]
struct Found {
    distortion: Vec<Distortion>,
    illumination: Vec<Illumination>,
    psf: Vec<PsfHeader>,
    notes: Vec<String>,
}

struct PsfHeader {
    path: PathBuf,
    wavelength_nm: f64,
    chief_ray_height_mm: Option<f64>,
    field_deg: Option<f64>,
}

/// Reads a folder.
///
/// # Errors
/// [`ImportError`].
pub fn open(folder: &Path, options: &ImportOptions) -> Result<Imported, ImportError> {
    let found = read(folder, options)?;
    let mut waves: Vec<f64> = found.distortion.iter().map(|d| d.wavelength_nm).collect();
    waves.sort_by(f64::total_cmp);
    if let Some(pair) = waves.windows(2).find(|w| w[1] - w[0] < SAME_NM) {
        let problem = format!("holds two distortion listings at {} nm; keep one", pair[0]);
        return Err(ImportError::file(folder, problem));
    }
    if waves.is_empty() {
        let problem = "holds no listing of grid distortion or field curvature/distortion (nor an ISETPARMS.TXT or lens.csv of other formats)";
        return Err(ImportError::file(folder, problem));
    }
    let primary = options.primary_nm(folder, None)?;
    let near = found.distortion.iter().find(|d| (d.wavelength_nm - primary).abs() < SAME_NM);
    let focal = options.distortion_focal(folder, near.and_then(|d| d.focal_length_mm))?;
    let efl = options.focal_length(folder, None)?;
    let (f_number, solid_angle_sr) = options.aperture(folder, efl, None)?;
    let (mut bands, mut files) = (Vec::new(), Vec::new());
    for w in options.selected_bands(waves.len())? {
        let (band, paths) = found.band(folder, waves[w], focal, options)?;
        bands.push(band);
        files.push(paths);
    }
    let mut notes = found.notes;
    notes.push("fields are angles: the object is assumed at infinity".into());
    let lens = SparseLens {
        path: folder.into(),
        name: folder.file_name().map_or("lens".into(), |n| n.to_string_lossy().into_owned()),
        distortion_focal_length_mm: focal,
        effective_focal_length_mm: efl,
        f_number,
        solid_angle_sr,
        primary_wavelength_nm: primary,
        object_distance_mm: None,
        magnification: 0.0,
        sample: options.sample.unwrap_or(PsfSample::Point),
        bands,
        source: json!({ "format": "OpticStudio listings" }),
        notes,
    };
    Imported::new(lens, options, window_reader(files, options.clone()))
}

impl Found {
    /// Tables and PSF files of one wavelength; `focal` is the distortion focal length, mm.
    fn band(
        &self,
        folder: &Path,
        nm: f64,
        focal: f64,
        options: &ImportOptions,
    ) -> Result<(SparseBand, Vec<PathBuf>), ImportError> {
        let ideal = |deg: &f64| focal * real::tan(deg.to_radians());
        let at = |v: f64| (v - nm).abs() < SAME_NM;
        let bad = |problem: String| ImportError::file(folder, problem);
        let missing = |what: &str| bad(format!("holds no listing of {what} at {nm} nm"));
        let distortion = self.distortion.iter().find(|d| at(d.wavelength_nm));
        let distortion = distortion.ok_or_else(|| missing("distortion"))?;
        let mut illumination = self.illumination.iter().filter(|i| at(i.wavelength_nm));
        let ri = illumination.next().ok_or_else(|| missing("relative illumination"))?;
        if illumination.next().is_some() {
            return Err(bad(format!("holds two listings of relative illumination at {nm} nm")));
        }
        let heights_mm: Vec<f64> = distortion.field_deg.iter().map(ideal).collect();
        let spline = Spline::mirrored(&heights_mm, &distortion.image_height_mm, Parity::Odd);
        let mut psf = Vec::new();
        for p in self.psf.iter().filter(|p| at(p.wavelength_nm)) {
            let of_field = || p.field_deg.map(|deg| spline.at(ideal(&deg)));
            let height_mm = p.chief_ray_height_mm.or_else(of_field).ok_or_else(|| {
                ImportError::file(&p.path, "states neither its chief ray nor its field in degrees")
            })?;
            psf.push((p.path.clone(), if height_mm.abs() < 1e-9 { 0.0 } else { height_mm }));
        }
        psf.sort_by(|a, b| a.1.total_cmp(&b.1));
        if psf.len() < 2 && !options.without_psf {
            return Err(missing("a Huygens or FFT PSF on the axis and one off it"));
        }
        if let Some(pair) = psf.windows(2).find(|p| p[1].1 - p[0].1 < 1e-6) {
            let problem = format!("is of the same height and wavelength as {}", pair[0].0.display());
            return Err(ImportError::file(&pair[1].0, problem));
        }
        let band = SparseBand {
            wavelength_nm: nm,
            distortion: (heights_mm, distortion.image_height_mm.clone()),
            illumination: (ri.field_deg.iter().map(ideal).collect(), ri.relative_illumination.clone()),
            psf_height_mm: psf.iter().map(|p| p.1).collect(),
            psf_energy: Vec::new(),
            cra_deg: Vec::new(),
        };
        Ok((band, psf.into_iter().map(|p| p.0).collect()))
    }
}

fn read(folder: &Path, options: &ImportOptions) -> Result<Found, ImportError> {
    let mut found = Found::default();
    for name in text::file_names(folder)? {
        let path = folder.join(&name);
        let head = text::read_start(&path)?;
        let full_text = || text::read(&path);
        let title = head.lines().take(12).collect::<Vec<_>>().join("\n").to_lowercase();
        if psf_listing::is_psf_listing(&head) {
            if options.without_psf {
                continue;
            }
            let listing = psf_listing::parse(&path, &full_text()?)?;
            found.psf.push(PsfHeader {
                path,
                wavelength_nm: listing.wavelength_nm,
                chief_ray_height_mm: listing.chief_ray_mm.map(|(x, y)| real::hypot(x, y)),
                field_deg: listing.field_deg.map(|(x, y)| real::hypot(x, y)),
            });
        } else if title.contains("grid distortion") {
            found.distortion.push(grid(&path, &full_text()?)?.distortion);
        } else if title.contains("field curvature") {
            found.distortion.extend(field_curvature(&path, &full_text()?)?);
        } else if title.contains("relative illumination") {
            found.illumination.push(illumination_listing::parse(&path, &full_text()?)?);
        } else {
            found.notes.push(format!(
                "{name} is not a listing of a known type (it starts with `{}`): skipped",
                short(head.trim().lines().next().unwrap_or(""))
            ));
        }
    }
    Ok(found)
}

/// Reads the PSF listings of a band a second time, with their samples.
fn window_reader(files: Vec<Vec<PathBuf>>, options: ImportOptions) -> ReadWindows {
    Box::new(move |b| {
        let mut windows = Windows::default();
        let mut listings: Vec<(&PathBuf, PsfListing)> = Vec::new();
        for path in &files[b] {
            listings.push((path, psf_listing::parse(path, &text::read(path)?)?));
        }
        let stated = |l: &PsfListing, path: &Path| l.outward().map_err(|e| ImportError::file(path, e));
        let mut side = None;
        for (path, listing) in &listings {
            side = side.or(stated(listing, path)?);
        }
        for (path, listing) in listings {
            // On the axis no side is stated: rotated like the others.
            let outward = options.outward.or(stated(&listing, path)?).or(side).unwrap_or(Outward::Up);
            windows.push(path, listing.window, listing.pitch_um, options.layout(outward))?;
        }
        Ok(windows)
    })
}
