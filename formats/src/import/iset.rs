//! A folder written by the ISET macros for Zemax (2005 to 2017) or Code V.
//!
//! | file | content |
//! |---|---|
//! | `ISETPARMS.TXT`, Code V: `BASE_ISETPARMS.TXT` | wavelengths (nm), heights (mm), focal length, F-numbers: [`super::isetparms`] |
//! | `BASE_DI_.dat` | REAL chief-ray heights, mm, heights × wavelengths: one row per height (2005, 2008), or one number per line (2013, 2017) |
//! | `BASE_RI_.dat` | relative illumination, in the same layout |
//! | `BASE_PSF_H_W.dat` (2005, 2008, Code V) or `BASE_2D_PSF_FldH_WaveW.dat` (2013, 2017) | PSF of height H, wavelength W, from 1 |
//! | `BASE_GridDistortion_W.dat` | optional: compared with the DI table |
//!
//! Heights are equal steps of IDEAL height from 0 to `imgHeightMax` (Code V: the range `imgHeight`). With the half field `fov`
//! in degrees the distortion focal length is imgHeightMax / tan(fov): EFL for an object at infinity and film at the paraxial
//! focus. An object beyond 1e9 mm is at infinity. The Zemax macros place the PSFs' field point on −y, and their listings state it
//! ([`super::psf_listing`]); Code V's PSFs are numbers only, at a pitch of `psfSpacing` mm, with the chief ray on sample N/2 + 1
//! from 1, and their side is a required option. RI and DI are for +y; heights are negative for a lens that images +y on −y.

use super::iset_tables::{MAX_RAY_DIFFERENCE_MM, Table, compare_grid, image_heights, table};
use super::isetparms::{Parameters, Value};
use super::matrix::Matrix;
use super::window::{Outward, Window};
use super::write::{Imported, ReadWindows, SparseBand, SparseLens, Windows};
use super::{ImportError, ImportOptions, psf_listing, text};
use pipeline::lens::PsfSample;
use pipeline::real;
use serde_json::json;
use std::f64::consts::PI;
use std::path::{Path, PathBuf};

/// Objects farther than this are at infinity, mm.
const INFINITE_MM: f64 = 1e9;

/// Reads a folder.
///
/// # Errors
/// [`ImportError`].
pub fn open(folder: &Path, options: &ImportOptions) -> Result<Imported, ImportError> {
    let names = text::file_names(folder)?;
    let mut parameter_files = names.iter().filter(|n| n.to_ascii_uppercase().ends_with("ISETPARMS.TXT"));
    let parms = match (parameter_files.next(), parameter_files.next()) {
        (Some(one), None) => folder.join(one),
        (None, _) => return Err(ImportError::file(folder, "has no ISETPARMS.TXT")),
        (Some(a), Some(b)) => {
            return Err(ImportError::file(folder, format!("has both {a} and {b}; keep one")));
        }
    };
    let p = Parameters::parse(&parms, &text::read(&parms)?)?;
    let base = base_name(&p, &parms)?;
    let (line, wavelengths) = p.list("wave")?;
    if wavelengths.windows(2).any(|w| w[1] <= w[0])
        || wavelengths.iter().any(|w| !(50.0..=100_000.0).contains(w))
    {
        return Err(ImportError::line(&parms, line, "`wave` must be a list of ascending wavelengths in nm"));
    }
    let (ideal, max_height) = ideal_heights(&p, &parms)?;
    let shape = (ideal.len(), wavelengths.len());
    let selected = options.selected_bands(wavelengths.len())?;
    let file = |name: &str| {
        text::find(folder, &names, name).ok_or_else(|| {
            ImportError::file(folder, format!("holds no file `{name}`, to which {} refers", parms.display()))
        })
    };
    let (di_path, ri_path) = (file(&format!("{base}_DI_.dat"))?, file(&format!("{base}_RI_.dat"))?);
    let (di, ri) = (table(&di_path, shape)?, table(&ri_path, shape)?);

    let efl = options.focal_length(&parms, p.optional_number("efl")?)?;
    let object = p.number("objDist")?;
    let finite = object.abs() < INFINITE_MM;
    let magnification = if finite { p.number("mag")? } else { 0.0 };
    let focal = focal_length(&p, &parms, options, (efl, magnification, max_height))?;
    let (f_number, solid_angle_sr) = options.aperture(&parms, efl, p.optional_number("fnumber")?)?;
    let effective = p.optional_number("fnumber_eff")?.filter(|n| *n > 0.0).map(|n| PI / (4.0 * n * n));
    let primary = options.primary_nm(&parms, p.optional_number("refWave")?)?;

    let mut notes = Vec::new();
    let heights = psf_heights(options, ideal.len())?;
    let mut bands = Vec::new();
    for &w in &selected {
        let column =
            |t: &Table| (0..ideal.len()).map(|h| t.values[h * wavelengths.len() + w]).collect::<Vec<_>>();
        let image = image_heights(&di_path, &di, (w, wavelengths.len()), column(&di))?;
        let psf_height_mm = heights.iter().map(|h| image[h - 1]).collect();
        if let Some(path) = text::find(folder, &names, &format!("{base}_GridDistortion_{}.dat", w + 1)) {
            notes.push(compare_grid(&path, (&ideal, &image), focal, wavelengths[w])?);
        }
        bands.push(SparseBand {
            wavelength_nm: wavelengths[w],
            distortion: (ideal.clone(), image),
            illumination: (ideal.clone(), column(&ri)),
            psf_height_mm,
            psf_energy: Vec::new(),
            cra_deg: Vec::new(),
        });
    }
    let psf_file = |h: usize, w: usize| {
        let old = format!("{base}_PSF_{h}_{}.dat", w + 1);
        let new = format!("{base}_2D_PSF_Fld{h}_Wave{}.dat", w + 1);
        let found = text::find(folder, &names, &old).or_else(|| text::find(folder, &names, &new));
        let advice = "`--psf-heights` takes fewer heights, `--without-psf` none";
        let missing = || ImportError::file(folder, format!("holds neither `{old}` nor `{new}`; {advice}"));
        found.ok_or_else(missing)
    };
    let mut files = Vec::new();
    for (&w, band) in selected.iter().zip(&bands).filter(|_| !options.without_psf) {
        let paths: Result<Vec<_>, _> = heights.iter().map(|&h| psf_file(h, w)).collect();
        let row = std::iter::zip(paths?, band.psf_height_mm.iter().copied()).collect();
        files.push((band.wavelength_nm, row));
    }
    let source = json!({ "format": "ISET macros", "lens_file": p.text("lensFile"), "base_name": base });
    let lens = SparseLens {
        path: folder.into(),
        name: base,
        distortion_focal_length_mm: focal,
        effective_focal_length_mm: efl,
        f_number,
        solid_angle_sr: solid_angle_sr.or(effective),
        primary_wavelength_nm: primary,
        object_distance_mm: finite.then_some(object),
        magnification,
        sample: options.sample.unwrap_or(PsfSample::Point),
        bands,
        source,
        notes,
    };
    let pitch_um = p.optional_number("psfSpacing")?.map(|mm| mm * 1e3);
    Imported::new(lens, options, window_reader(files, options.clone(), pitch_um))
}

/// Last path component of `baseLensFileName`, or of `lensFile` without its extension.
fn base_name(p: &Parameters, parms: &Path) -> Result<String, ImportError> {
    let last = |t: &str| t.rsplit(['/', '\\']).next().unwrap_or("").trim().to_string();
    let base = p.text("baseLensFileName").map(last);
    let lens =
        p.text("lensFile").map(last).map(|t| t.rsplit_once('.').map_or(t.clone(), |(stem, _)| stem.into()));
    let base = base.filter(|b| !b.is_empty()).or(lens).filter(|b| !b.is_empty());
    base.ok_or_else(|| ImportError::file(parms, "has no text `baseLensFileName='…'`"))
}

/// Ideal heights from 0, and the maximum.
fn ideal_heights(p: &Parameters, parms: &Path) -> Result<(Vec<f64>, f64), ImportError> {
    if let Some((line, Value::Numbers(list))) = p.get("imgHeight") {
        let ascends = list.windows(2).all(|w| w[1] > w[0]);
        return match list.last() {
            Some(&last) if list.len() >= 2 && list[0] == 0.0 && ascends => Ok((list.clone(), last)),
            _ => Err(ImportError::line(parms, *line, "`imgHeight` does not ascend from 0")),
        };
    }
    let count = p.count("imgHeightNum", 2)?;
    let last = p.number("imgHeightMax")?;
    match last > 0.0 {
        true => Ok(((0..count).map(|i| last * i as f64 / (count - 1) as f64).collect(), last)),
        false => Err(ImportError::file(
            parms,
            format!("`imgHeightMax` is {last}, expected a height in mm above 0"),
        )),
    }
}

/// imgHeightMax / tan(fov), which must be within 5 % of EFL·(1 − magnification).
fn focal_length(
    p: &Parameters,
    parms: &Path,
    options: &ImportOptions,
    (efl, magnification, max_height): (f64, f64, f64),
) -> Result<f64, ImportError> {
    if let Some(f) = options.distortion_focal_length_mm {
        return Ok(f);
    }
    let fov = p.number("fov")?;
    let focal = max_height / real::tan(fov.to_radians());
    let expected = efl * (1.0 + magnification.abs());
    if (0.0..89.0).contains(&fov) && (focal / expected - 1.0).abs() < 0.05 {
        return Ok(focal);
    }
    let (line, _) = p.list("fov")?;
    Err(ImportError::line(
        parms,
        line,
        format!(
            "{max_height} mm at a half field of {fov}° means a distortion focal length of {focal:.4} mm, not near the {expected:.4} mm of the focal length; give it by `--distortion-focal-mm`"
        ),
    ))
}

/// Numbers from 1 of the heights that have PSFs.
fn psf_heights(options: &ImportOptions, count: usize) -> Result<Vec<usize>, ImportError> {
    let Some(heights) = &options.psf_heights else { return Ok((1..=count).collect()) };
    let ascend_from_1 = heights.len() >= 2 && heights[0] == 1 && heights.windows(2).all(|w| w[1] > w[0]);
    match heights.last() {
        Some(&last) if ascend_from_1 && last <= count => Ok(heights.clone()),
        _ => Err(ImportError::Option {
            option: "--psf-heights",
            problem: format!(
                "{heights:?}: expected two or more numbers that ascend from 1 to at most {count}"
            ),
        }),
    }
}

/// Reads the PSF files of a band; `pitch_um` is for files without a header.
fn window_reader(
    files: Vec<(f64, Vec<(PathBuf, f64)>)>,
    options: ImportOptions,
    pitch_um: Option<f64>,
) -> ReadWindows {
    Box::new(move |b| {
        let (nm, row) = &files[b];
        let mut windows = Windows::default();
        for (path, height) in row {
            let text = text::read(path)?;
            match psf_listing::is_psf_listing(&text) {
                true => {
                    let listing = psf_listing::parse(path, &text)?;
                    check_listing(path, &listing, *nm, *height)?;
                    let stated = listing.outward().map_err(|e| ImportError::file(path, e))?;
                    // On the axis no side is stated: rotated like the others.
                    let outward = options.outward.or(stated).unwrap_or(Outward::Down);
                    windows.push(path, listing.window, listing.pitch_um, options.layout(outward))?;
                }
                false => {
                    let layout = options.layout(options.required_outward(path)?);
                    let m = Matrix::read(path, text::numbered_lines(&text))?;
                    let pitch = pitch_um
                        .ok_or_else(|| ImportError::file(path, "needs `psfSpacing` in ISETPARMS.TXT"))?;
                    let even = m.rows.is_multiple_of(2) && options.even_window.is_none();
                    let centre = even.then_some((m.rows / 2, m.columns / 2));
                    let window = Window { rows: m.rows, columns: m.columns, samples: m.values, centre };
                    windows.push(path, window, pitch, layout)?;
                }
            }
        }
        Ok(windows)
    })
}

/// Checks wavelength and height of a listing.
fn check_listing(
    path: &Path,
    listing: &psf_listing::PsfListing,
    nm: f64,
    height_mm: f64,
) -> Result<(), ImportError> {
    if (listing.wavelength_nm - nm).abs() > 0.5 {
        return Err(ImportError::file(path, format!("is of {} nm, expected {nm} nm", listing.wavelength_nm)));
    }
    let radius = listing.chief_ray_mm.map(|(x, y)| real::hypot(x, y));
    match radius.filter(|r| (r - height_mm).abs() > MAX_RAY_DIFFERENCE_MM) {
        Some(r) => Err(ImportError::file(
            path,
            format!("has its chief ray at {r} mm, the DI table at {height_mm} mm"),
        )),
        None => Ok(()),
    }
}
