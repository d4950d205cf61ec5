//! A folder of OpticStudio text listings, told apart by what they say of themselves.
//!
//! Needed for every wavelength: one that tells distortion (Grid Distortion, or Field Curvature / Distortion), one of Relative
//! Illumination, and PSFs (Huygens or FFT) on the axis and off it. Wavelengths are the same within 0.1 nm, as they are listed
//! with four digits. Ideal height = f·tan(field) with the f of the primary wavelength's distortion listing, unless told. A PSF's
//! height is the radius of the chief ray it names, else that of its field angle. Listings do not tell focal length, F-number and
//! primary wavelength: `--efl-mm`, `--f-number`, `--primary-nm`. Fields are angles, so the object is at infinity.

use super::dense::{Parity, Spline};
use super::distortion_listing::{Distortion, field_curvature, grid, start};
use super::illumination_listing::{self, Illumination};
use super::psf_listing::{self, PsfListing};
use super::window::Outward;
use super::write::{Fetch, Given, GivenBand, Imported, Windows, row_order, told};
use super::{ImportError, ImportOptions, text};
use pipeline::lens::PsfSample;
use serde_json::{Map, json};
use std::path::{Path, PathBuf};

/// Two listings are of one wavelength if they are this near, nm.
const SAME_NM: f64 = 0.1;

/// What the folder holds. Of PSFs only what the head tells is kept.
#[derive(Default)]
struct Found {
    distortion: Vec<(PathBuf, Distortion)>,
    illumination: Vec<(PathBuf, Illumination)>,
    psf: Vec<(PathBuf, f64, Option<f64>, Option<f64>)>,
    notes: Vec<String>,
}

/// Reads a folder.
///
/// # Errors
/// [`ImportError`].
pub fn open(folder: &Path, options: &ImportOptions) -> Result<Imported, ImportError> {
    let found = read(folder, options)?;
    let mut waves: Vec<f64> = found.distortion.iter().map(|(_, d)| d.wavelength_nm).collect();
    waves.sort_by(f64::total_cmp);
    if let Some(pair) = waves.windows(2).find(|w| w[1] - w[0] < SAME_NM) {
        return Err(ImportError::file(
            folder,
            format!("holds two distortion listings at {} nm; keep one", pair[0]),
        ));
    }
    if waves.is_empty() {
        return Err(ImportError::file(
            folder,
            "holds no listing of grid distortion or field curvature/distortion (nor an ISETPARMS.TXT or lens.csv of other formats)",
        ));
    }
    let primary =
        told(folder, options.primary_wavelength_nm, None, "the primary wavelength", "--primary-nm")?;
    let near = found.distortion.iter().find(|(_, d)| (d.wavelength_nm - primary).abs() < SAME_NM);
    let focal = told(
        folder,
        options.distortion_focal_length_mm,
        near.and_then(|(_, d)| d.focal_length_mm),
        "the distortion focal length at the primary wavelength",
        "--distortion-focal-mm",
    )?;
    let efl = told(folder, options.effective_focal_length_mm, None, "the focal length", "--efl-mm")?;
    let (f_number, solid_angle_sr) = options.aperture(folder, efl, None)?;
    let ideal = |degrees: &[f64]| degrees.iter().map(|d| focal * d.to_radians().tan()).collect::<Vec<f64>>();
    let (mut bands, mut files) = (Vec::new(), Vec::new());
    for w in options.chosen(waves.len())? {
        let nm = waves[w];
        let missing =
            |what: &str| ImportError::file(folder, format!("holds no listing of {what} at {nm} nm"));
        let at = |v: f64| (v - nm).abs() < SAME_NM;
        let (_, d) = found
            .distortion
            .iter()
            .find(|(_, d)| at(d.wavelength_nm))
            .ok_or_else(|| missing("distortion"))?;
        let illumination = found.illumination.iter().filter(|(_, i)| at(i.wavelength_nm)).collect::<Vec<_>>();
        let [(_, ri)] = illumination[..] else {
            return Err(match illumination.is_empty() {
                true => missing("relative illumination"),
                false => ImportError::file(
                    folder,
                    format!("holds two listings of relative illumination at {nm} nm"),
                ),
            });
        };
        let heights = ideal(&d.field_deg);
        let spline = Spline::mirrored(&heights, &d.image_height_mm, Parity::Odd);
        let mut psf = Vec::new();
        for (path, _, radius, field) in found.psf.iter().filter(|p| at(p.1)) {
            let radius = radius.or(field.map(|deg| spline.at(focal * deg.to_radians().tan())));
            let height = radius.ok_or_else(|| {
                ImportError::file(path, "tells neither its chief ray nor its field in degrees")
            })?;
            psf.push((path.clone(), if height.abs() < 1e-9 { 0.0 } else { height }));
        }
        psf.sort_by(|a, b| a.1.total_cmp(&b.1));
        if psf.len() < 2 && !options.without_psf {
            return Err(missing("a Huygens or FFT PSF on the axis and one off it"));
        }
        if let Some(pair) = psf.windows(2).find(|p| p[1].1 - p[0].1 < 1e-6) {
            let problem = format!("is of the same height and wavelength as {}", pair[0].0.display());
            return Err(ImportError::file(&pair[1].0, problem));
        }
        bands.push(GivenBand {
            wavelength_nm: nm,
            distortion: (heights, d.image_height_mm.clone()),
            illumination: (ideal(&ri.field_deg), ri.relative_illumination.clone()),
            psf_height_mm: psf.iter().map(|p| p.1).collect(),
            psf_energy: Vec::new(),
        });
        files.push(psf.into_iter().map(|p| p.0).collect::<Vec<_>>());
    }
    let mut source = Map::new();
    source.insert("format".into(), json!("OpticStudio listings"));
    source.insert("psf_rows".into(), json!(row_order(options)));
    let mut notes = found.notes;
    notes.push("fields are angles: an object at infinity was taken".into());
    let given = Given {
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
        source,
        notes,
    };
    Imported::new(given, options, fetch(files, options.clone()))
}

fn read(folder: &Path, options: &ImportOptions) -> Result<Found, ImportError> {
    let mut found = Found::default();
    for name in text::names(folder)? {
        let path = folder.join(&name);
        let head = text::start(&path)?;
        let whole = || text::read(&path);
        let title = head.lines().take(12).collect::<Vec<_>>().join("\n").to_lowercase();
        if psf_listing::is_psf(&head) {
            if options.without_psf {
                continue;
            }
            let listing = psf_listing::parse(&path, &whole()?)?;
            let radius = listing.chief_ray_mm.map(|(x, y)| x.hypot(y));
            let field = listing.field_deg.map(|(x, y)| x.hypot(y));
            found.psf.push((path, listing.wavelength_nm, radius, field));
        } else if title.contains("grid distortion") {
            found.distortion.push((path.clone(), grid(&path, &whole()?)?.distortion));
        } else if title.contains("field curvature") {
            let tables = field_curvature(&path, &whole()?)?;
            found.distortion.extend(tables.into_iter().map(|d| (path.clone(), d)));
        } else if title.contains("relative illumination") {
            found.illumination.push((path.clone(), illumination_listing::parse(&path, &whole()?)?));
        } else {
            found.notes.push(format!(
                "{name} is no listing that is known (it starts with `{}`): left out",
                start(&head)
            ));
        }
    }
    Ok(found)
}

/// Reads a band's PSF listings again when it is asked for.
fn fetch(files: Vec<Vec<PathBuf>>, options: ImportOptions) -> Fetch {
    Box::new(move |b| {
        let mut windows = Windows::default();
        let mut listings: Vec<(&PathBuf, PsfListing)> = Vec::new();
        for path in &files[b] {
            listings.push((path, psf_listing::parse(path, &text::read(path)?)?));
        }
        let told = |l: &PsfListing, path: &Path| l.outward().map_err(|e| ImportError::file(path, e));
        let mut side = None;
        for (path, listing) in &listings {
            side = side.or(told(listing, path)?);
        }
        for (path, listing) in listings {
            // On the axis nothing tells, and nothing matters but to turn it as the others.
            let outward = options.outward.or(told(&listing, path)?).or(side).unwrap_or(Outward::Up);
            windows.push(path, listing.window, listing.pitch_um, options.layout(outward))?;
        }
        Ok(windows)
    })
}
