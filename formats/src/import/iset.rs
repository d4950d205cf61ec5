//! A folder written by the ISET macros for Zemax (2005 to 2017) or Code V.
//!
//! | file | content |
//! |---|---|
//! | `ISETPARMS.TXT`, Code V: `BASE_ISETPARMS.TXT` | wavelengths (nm), heights (mm), focal length, F-numbers: [`super::isetparms`] |
//! | `BASE_DI_.dat` | REAL chief-ray heights, mm, heights × wavelengths: a row a height (2005, 2008), or a number a line (2013, 2017) |
//! | `BASE_RI_.dat` | relative illumination, in the same layout |
//! | `BASE_PSF_H_W.dat` (2005, 2008, Code V) or `BASE_2D_PSF_FldH_WaveW.dat` (2013, 2017) | PSF of height H, wavelength W, from 1 |
//! | `BASE_GridDistortion_W.dat` | if there: compared with the DI table |
//!
//! Heights are equal steps of IDEAL height from 0 to `imgHeightMax` (Code V: the range `imgHeight`). With the half field `fov`
//! in degrees the distortion focal length is imgHeightMax / tan(fov): EFL for an object at infinity and film at the paraxial
//! focus. An object beyond 1e9 mm is at infinity. The Zemax macros put the PSFs' field point on −y, their listings say so
//! themselves ([`super::psf_listing`]); Code V's PSFs are bare numbers in `psfSpacing` mm with the chief ray on sample N/2 + 1
//! from 1, and their side has to be told. RI and DI stand for +y; a lens that images it on −y has heights below 0 there.

use super::dense::{Parity, Spline};
use super::isetparms::{Parameters, Value};
use super::matrix::Matrix;
use super::window::{Outward, Window};
use super::write::{Fetch, Given, GivenBand, Imported, Windows, row_order, told};
use super::{ImportError, ImportOptions, distortion_listing, psf_listing, text};
use pipeline::lens::PsfSample;
use serde_json::{Map, json};
use std::f64::consts::PI;
use std::path::{Path, PathBuf};

/// Chief rays of a listing and of the DI table may differ by this, mm.
const SAME_RAY_MM: f64 = 1e-3;
/// An object farther than this is at infinity, mm.
const INFINITE_MM: f64 = 1e9;

/// Reads a folder.
///
/// # Errors
/// [`ImportError`].
pub fn open(folder: &Path, options: &ImportOptions) -> Result<Imported, ImportError> {
    let names = text::names(folder)?;
    let mut parameter_files = names.iter().filter(|n| n.to_ascii_uppercase().ends_with("ISETPARMS.TXT"));
    let parms = match (parameter_files.next(), parameter_files.next()) {
        (Some(one), None) => folder.join(one),
        (None, _) => return Err(ImportError::file(folder, "holds no ISETPARMS.TXT")),
        (Some(a), Some(b)) => {
            return Err(ImportError::file(folder, format!("holds both {a} and {b}; keep one")));
        }
    };
    let p = Parameters::parse(&parms, &text::read(&parms)?)?;
    let base = base_name(&p, &parms)?;
    let (line, wavelengths) = p.list("wave")?;
    if wavelengths.windows(2).any(|w| w[1] <= w[0])
        || wavelengths.iter().any(|w| !(50.0..=100_000.0).contains(w))
    {
        return Err(ImportError::line(&parms, line, "`wave` is no list of ascending wavelengths in nm"));
    }
    let (ideal, reach) = ideal_heights(&p, &parms)?;
    let shape = (ideal.len(), wavelengths.len());
    let chosen = options.chosen(wavelengths.len())?;
    let file = |name: &str| {
        text::find(folder, &names, name).ok_or_else(|| {
            ImportError::file(folder, format!("holds no file `{name}`, which {} asks for", parms.display()))
        })
    };
    let (di_path, ri_path) = (file(&format!("{base}_DI_.dat"))?, file(&format!("{base}_RI_.dat"))?);
    let (di, ri) = (table(&di_path, shape)?, table(&ri_path, shape)?);

    let efl = told(
        &parms,
        options.effective_focal_length_mm,
        p.number("efl").ok(),
        "the focal length",
        "--efl-mm",
    )?;
    let object = p.number("objDist")?;
    let finite = object.abs() < INFINITE_MM;
    let magnification = if finite { p.number("mag")? } else { 0.0 };
    let focal = focal_length(&p, &parms, options, (efl, magnification, reach))?;
    let (f_number, told_angle) = options.aperture(&parms, efl, p.number("fnumber").ok())?;
    let effective = p.number("fnumber_eff").ok().filter(|n| *n > 0.0).map(|n| PI / (4.0 * n * n));
    let primary = told(
        &parms,
        options.primary_wavelength_nm,
        p.number("refWave").ok(),
        "the primary wavelength",
        "--primary-nm",
    )?;

    let mut notes = Vec::new();
    let heights = psf_heights(options, ideal.len())?;
    let mut bands = Vec::new();
    for &w in &chosen {
        let column =
            |t: &Table| (0..ideal.len()).map(|h| t.values[h * wavelengths.len() + w]).collect::<Vec<_>>();
        let image = ascending(&di_path, &di, (w, wavelengths.len()), column(&di))?;
        let psf_height_mm = heights.iter().map(|h| image[h - 1]).collect();
        if let Some(path) = text::find(folder, &names, &format!("{base}_GridDistortion_{}.dat", w + 1)) {
            notes.push(compare_grid(&path, (&ideal, &image), focal, wavelengths[w])?);
        }
        bands.push(GivenBand {
            wavelength_nm: wavelengths[w],
            distortion: (ideal.clone(), image),
            illumination: (ideal.clone(), column(&ri)),
            psf_height_mm,
            psf_energy: Vec::new(),
        });
    }
    let mut files = Vec::new();
    for (&w, band) in chosen.iter().zip(&bands).filter(|_| !options.without_psf) {
        let mut row = Vec::new();
        for (&h, &height) in heights.iter().zip(&band.psf_height_mm) {
            let (old, new) =
                (format!("{base}_PSF_{h}_{}.dat", w + 1), format!("{base}_2D_PSF_Fld{h}_Wave{}.dat", w + 1));
            let found = text::find(folder, &names, &old).or_else(|| text::find(folder, &names, &new));
            let path = found.ok_or_else(|| {
                ImportError::file(
                    folder,
                    format!("holds neither `{old}` nor `{new}`; `--psf-heights` takes fewer heights, `--without-psf` none"),
                )
            })?;
            row.push((path, height));
        }
        files.push((band.wavelength_nm, row));
    }
    let mut source = Map::new();
    source.insert("format".into(), json!("ISET macros"));
    source.insert("lens_file".into(), json!(p.text("lensFile")));
    source.insert("base_name".into(), json!(base));
    source.insert("psf_rows".into(), json!(row_order(options)));
    let given = Given {
        path: folder.into(),
        name: base,
        distortion_focal_length_mm: focal,
        effective_focal_length_mm: efl,
        f_number,
        solid_angle_sr: told_angle.or(effective),
        primary_wavelength_nm: primary,
        object_distance_mm: finite.then_some(object),
        magnification,
        sample: options.sample.unwrap_or(PsfSample::Point),
        bands,
        source,
        notes,
    };
    let bare_pitch_um = p.number("psfSpacing").ok().map(|mm| mm * 1e3);
    Imported::new(given, options, fetch(files, options.clone(), bare_pitch_um))
}

/// Last part of `baseLensFileName`, or `lensFile` without its ending: never a path.
fn base_name(p: &Parameters, parms: &Path) -> Result<String, ImportError> {
    let last = |t: &str| t.rsplit(['/', '\\']).next().unwrap_or("").trim().to_string();
    let base = p.text("baseLensFileName").map(last);
    let lens =
        p.text("lensFile").map(last).map(|t| t.rsplit_once('.').map_or(t.clone(), |(stem, _)| stem.into()));
    let base = base.filter(|b| !b.is_empty()).or(lens).filter(|b| !b.is_empty());
    base.ok_or_else(|| ImportError::file(parms, "has no text `baseLensFileName='…'`"))
}

/// Ideal heights from 0, and the last.
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

/// imgHeightMax / tan(fov), believed if it is near EFL·(1 − magnification).
fn focal_length(
    p: &Parameters,
    parms: &Path,
    options: &ImportOptions,
    (efl, magnification, reach): (f64, f64, f64),
) -> Result<f64, ImportError> {
    if let Some(f) = options.distortion_focal_length_mm {
        return Ok(f);
    }
    let fov = p.number("fov")?;
    let focal = reach / fov.to_radians().tan();
    let expected = efl * (1.0 + magnification.abs());
    if (0.0..89.0).contains(&fov) && (focal / expected - 1.0).abs() < 0.05 {
        return Ok(focal);
    }
    let (line, _) = p.list("fov")?;
    Err(ImportError::line(
        parms,
        line,
        format!(
            "{reach} mm at a half field of {fov}° means a distortion focal length of {focal:.4} mm, not near the {expected:.4} mm of the focal length; say it by `--distortion-focal-mm`"
        ),
    ))
}

/// Numbers from 1 of the heights that have PSFs.
fn psf_heights(options: &ImportOptions, count: usize) -> Result<Vec<usize>, ImportError> {
    let Some(asked) = &options.psf_heights else { return Ok((1..=count).collect()) };
    let fits = asked.len() >= 2 && asked[0] == 1 && asked.windows(2).all(|w| w[1] > w[0]);
    match asked.last() {
        Some(&last) if fits && last <= count => Ok(asked.clone()),
        _ => Err(ImportError::Option {
            option: "--psf-heights",
            problem: format!("{asked:?}: expected two or more numbers that ascend from 1 to at most {count}"),
        }),
    }
}

/// A DI or RI table: heights × wavelengths.
struct Table {
    values: Vec<f64>,
    /// Line of every number.
    lines: Vec<usize>,
}

fn table(path: &Path, (heights, wavelengths): (usize, usize)) -> Result<Table, ImportError> {
    let text = text::read(path)?;
    let m = Matrix::read(path, text.lines().enumerate().map(|(i, l)| (i + 1, l)))?;
    if m.rows > 0 && m.columns != 1 && m.columns != wavelengths {
        let problem =
            format!("{} numbers, expected one a line or {wavelengths}, one a wavelength", m.columns);
        return Err(ImportError::line(path, m.lines[0], problem));
    }
    if m.values.len() != heights * wavelengths {
        return Err(ImportError::line(
            path,
            m.lines.last().copied().unwrap_or(1),
            format!(
                "the table ends after {} numbers, expected {} ({heights} heights × {wavelengths} wavelengths)",
                m.values.len(),
                heights * wavelengths
            ),
        ));
    }
    let lines = m.lines.iter().flat_map(|&line| std::iter::repeat_n(line, m.columns)).collect();
    Ok(Table { values: m.values, lines })
}

/// Image heights of one wavelength, turned positive and checked to ascend from 0.
fn ascending(
    path: &Path,
    t: &Table,
    (w, waves): (usize, usize),
    heights: Vec<f64>,
) -> Result<Vec<f64>, ImportError> {
    let sign = if heights.iter().all(|h| *h <= 0.0) { -1.0 } else { 1.0 };
    let heights: Vec<f64> = heights.iter().map(|h| sign * h + 0.0).collect();
    let bad = |h: usize, problem: String| {
        Err(ImportError::line(path, t.lines[h * waves + w], format!("wavelength {}: {problem}", w + 1)))
    };
    if heights[0].abs() > 1e-6 {
        return bad(0, format!("the first height is {} mm, expected 0", heights[0]));
    }
    match heights.windows(2).position(|pair| pair[1] <= pair[0]) {
        Some(h) => bad(h + 1, format!("height {} mm does not ascend from {} mm", heights[h + 1], heights[h])),
        None => Ok(std::iter::once(0.0).chain(heights[1..].iter().copied()).collect()),
    }
}

/// The grid listing against the spline through the DI table, by predicted radius.
fn compare_grid(
    path: &Path,
    (ideal, image): (&[f64], &[f64]),
    focal: f64,
    nm: f64,
) -> Result<String, ImportError> {
    let grid = distortion_listing::grid(path, &text::read(path)?)?;
    let found = grid.distortion.wavelength_nm;
    if (found - nm).abs() > 0.5 {
        return Err(ImportError::file(path, format!("is of {found} nm, expected {nm} nm")));
    }
    let spline = Spline::mirrored(ideal, image, Parity::Odd);
    let last = ideal[ideal.len() - 1] * (1.0 + 1e-4);
    // The listing's own f may be another wavelength's; field angles are what both share.
    let scale = grid.distortion.focal_length_mm.map_or(1.0, |f| focal / f);
    let inside = grid.radii_mm.iter().map(|(p, r)| (p * scale, *r)).filter(|(p, _)| *p <= last);
    let worst = inside.map(|(p, r)| (spline.at(p) - r).abs()).fold(0.0, f64::max);
    match worst < SAME_RAY_MM {
        true => Ok(format!("{}: agrees with the DI table within {worst:.1e} mm", path.display())),
        false => Err(ImportError::file(path, format!("differs from the DI table by up to {worst:.2e} mm"))),
    }
}

/// Reads the PSF files of a band when it is asked for.
fn fetch(
    files: Vec<(f64, Vec<(PathBuf, f64)>)>,
    options: ImportOptions,
    bare_pitch_um: Option<f64>,
) -> Fetch {
    Box::new(move |b| {
        let (nm, row) = &files[b];
        let mut windows = Windows::default();
        for (path, height) in row {
            let text = text::read(path)?;
            match psf_listing::is_psf(&text) {
                true => {
                    let listing = psf_listing::parse(path, &text)?;
                    check(path, &listing, *nm, *height)?;
                    let told = listing.outward().map_err(|e| ImportError::file(path, e))?;
                    // On the axis nothing tells, and nothing matters but to turn it as the others.
                    let outward = options.outward.or(told).unwrap_or(Outward::Down);
                    windows.push(path, listing.window, listing.pitch_um, options.layout(outward))?;
                }
                false => {
                    let layout = options.layout(options.told_outward(path)?);
                    let m = Matrix::read(path, text.lines().enumerate().map(|(i, l)| (i + 1, l)))?;
                    let pitch = bare_pitch_um
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

/// Is this the listing of that wavelength and height?
fn check(path: &Path, listing: &psf_listing::PsfListing, nm: f64, height_mm: f64) -> Result<(), ImportError> {
    if (listing.wavelength_nm - nm).abs() > 0.5 {
        return Err(ImportError::file(path, format!("is of {} nm, expected {nm} nm", listing.wavelength_nm)));
    }
    let radius = listing.chief_ray_mm.map(|(x, y)| x.hypot(y));
    match radius.filter(|r| (r - height_mm).abs() > SAME_RAY_MM) {
        Some(r) => Err(ImportError::file(
            path,
            format!("has its chief ray at {r} mm, the DI table at {height_mm} mm"),
        )),
        None => Ok(()),
    }
}
