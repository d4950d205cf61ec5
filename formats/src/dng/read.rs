//! A DNG as input: the numbers of its raw, their levels and its colour.
//!
//! ```text
//! v = L(stored) − black(y, x),   black = B(y mod R, x mod C) + H(x) + V(y),   range = white − max black
//! ```
//! L the LinearizationTable (its last entry beyond its end), B the BlackLevel of R × C pixels, H and V its deltas by column and row, all from the first pixel of the ActiveArea on.
//! The picture is the DefaultCrop of the ActiveArea, in stored rows and columns. Source: Adobe, Digital Negative Specification 1.4.0.0 (2012), chapters 4 and 5.
//! Not included, and remarked: opcodes (defective pixels, gain maps, distortion), orientation, pixels that are not square. Not supported: filters other
//! than 2 × 2 of red, green and blue; lossy compression.

use std::path::{Path, PathBuf};

use pipeline::develop::profile::{Calibration, CameraProfile};
use pipeline::geometry::{Rect, Size};

use super::error::DngError;
use super::ifd::{Directory, Tiff};
use super::samples::Layout;

/// A raw of a camera.
#[derive(Clone, Debug)]
pub struct CameraRaw {
    path: PathBuf,
    /// Stored numbers of the whole raw.
    stored: Vec<u16>,
    stride: usize,
    /// Samples of a pixel: 1, or 3 of a linear raw.
    pub samples: usize,
    /// The picture within the whole raw.
    pub area: Rect,
    /// Its first pixel within the active area.
    origin: (usize, usize),
    /// Colours of 2 × 2 pixels from the first of the picture on: 0 red, 1 green, 2 blue; none: monochrome or a linear raw.
    pub pattern: Option<[usize; 4]>,
    table: Vec<u16>,
    black: Black,
    /// Linear numbers of saturation, by sample.
    white: Vec<f64>,
    /// Colour; none: its channels stay the camera's own.
    pub profile: Option<CameraProfile>,
    /// Camera, exposure and levels, in words.
    pub description: String,
    /// Remarks for the user.
    pub notes: Vec<String>,
}

#[derive(Clone, Debug)]
struct Black {
    rows: usize,
    columns: usize,
    /// By row, column, sample.
    levels: Vec<f64>,
    of_columns: Vec<f64>,
    of_rows: Vec<f64>,
}

/// Whether a file is a DNG, by its content: a classic TIFF whose first directory has a DNGVersion.
pub fn is_dng(path: &Path) -> bool {
    let first = || -> Result<bool, DngError> {
        let Some(tiff) = Tiff::open(path)? else { return Ok(false) };
        Ok(tiff.first()?.has(50706))
    };
    first().unwrap_or(false)
}

impl CameraRaw {
    /// Reads and decodes a file.
    ///
    /// # Errors
    /// [`DngError`].
    pub fn open(path: &Path) -> Result<Self, DngError> {
        let unsupported = |what, expected: &str, found: String| DngError::Unsupported {
            path: path.into(),
            what,
            expected: expected.into(),
            found,
        };
        let tiff = Tiff::open(path)?
            .ok_or_else(|| unsupported("format", "a classic TIFF file", "another file".into()))?;
        let all = tiff.directories()?;
        let (first, raw) = (&all[0], raw_directory(&tiff, &all)?);
        let layout = Layout::read(&tiff, raw)?;
        let (size, samples) = (layout.size, layout.samples);
        let is_mosaic = tiff.number(raw, 262)? == Some(32803.0);
        if is_mosaic && samples != 1 {
            return Err(unsupported("samples of a mosaic's pixel", "1", samples.to_string()));
        }
        let active = active_area(&tiff, raw, size)?;
        let area = crop(&tiff, raw, active)?;
        let origin = ((area.y - active.y) as usize, (area.x - active.x) as usize);
        let pattern = if is_mosaic { Some(pattern(&tiff, raw, origin)?) } else { None };
        let table = tiff.numbers(raw, 50712)?.unwrap_or_default();
        let table: Vec<u16> = table.iter().take(1 << 16).map(|v| v.clamp(0.0, 65535.0) as u16).collect();
        let black = black(&tiff, raw, active.size(), samples)?;
        let default_white = f64::from((1u32 << layout.bits) - 1);
        let white = tiff.numbers(raw, 50717)?.filter(|w| w.len() == samples || w.len() == 1);
        let white = white.unwrap_or(vec![default_white]);
        let white: Vec<f64> = (0..samples).map(|s| white[s.min(white.len() - 1)]).collect();
        let most = black.most(samples);
        if let Some((w, b)) = std::iter::zip(&white, &most).find(|(w, b)| !(w.is_finite() && *w > *b)) {
            let found = format!("white {w}, black {b}");
            return Err(unsupported("levels", "a white level above the black level", found));
        }
        let profile = profile(&tiff, first, is_mosaic || samples == 3)?;
        let mut notes = remarks(&tiff, first, raw)?;
        if profile.is_none() && (is_mosaic || samples == 3) {
            notes.push("it has no ColorMatrix1 or no white (AsShotNeutral): its channels are measured as they are, without white balance".into());
        }
        let description = format!(
            "{}; {size} pixels of {} bits, picture {area}; black {}, white {}",
            labels(&tiff, first)?,
            layout.bits,
            words(&most),
            words(&white)
        );
        let stored = layout.decode(&tiff)?;
        let stride = size.width * samples;
        Ok(Self {
            path: path.into(),
            stored,
            stride,
            samples,
            area,
            origin,
            pattern,
            table,
            black,
            white,
            profile,
            description,
            notes,
        })
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Size of the picture.
    pub fn size(&self) -> Size {
        self.area.size()
    }

    /// Stored numbers of `rect` of the picture, those of a pixel side by side.
    ///
    /// # Panics
    /// If `rect` is not inside the picture.
    pub fn stored(&self, rect: Rect) -> Vec<u16> {
        assert!(self.size().rect().contains(rect));
        let left = (self.area.x + rect.x) as usize * self.samples;
        let row = |y: i64| {
            &self.stored[(self.area.y + y) as usize * self.stride + left..][..rect.width * self.samples]
        };
        (rect.y..rect.bottom()).flat_map(|y| row(y).iter().copied()).collect()
    }

    /// Linear numbers above black of `rect` of the picture, those of a pixel side by side.
    ///
    /// # Panics
    /// If `rect` is not inside the picture.
    pub fn linear(&self, rect: Rect) -> Vec<f32> {
        let width = rect.width * self.samples;
        let stored = self.stored(rect);
        let value = |(i, stored): (usize, &u16)| {
            let (y, x) = (rect.y as usize + i / width, rect.x as usize + i % width / self.samples);
            let linear = match &self.table[..] {
                [] => *stored,
                table => table[usize::from(*stored).min(table.len() - 1)],
            };
            let at = (self.origin.0 + y, self.origin.1 + x);
            (f64::from(linear) - self.black.at(at, i % self.samples, self.samples)) as f32
        };
        stored.iter().enumerate().map(value).collect()
    }

    /// Number above black at which a sample is saturated, by sample.
    pub fn ranges(&self) -> Vec<f64> {
        std::iter::zip(&self.white, self.black.most(self.samples)).map(|(w, b)| w - b).collect()
    }
}

impl Black {
    fn at(&self, (y, x): (usize, usize), sample: usize, samples: usize) -> f64 {
        let level = self.levels[(y % self.rows * self.columns + x % self.columns) * samples + sample];
        level + self.of_columns.get(x).unwrap_or(&0.0) + self.of_rows.get(y).unwrap_or(&0.0)
    }

    /// Greatest level of each sample.
    fn most(&self, samples: usize) -> Vec<f64> {
        let most = |all: &[f64]| all.iter().copied().reduce(f64::max).unwrap_or(0.0);
        let deltas = most(&self.of_columns) + most(&self.of_rows);
        let of = |s: usize| self.levels.iter().skip(s).step_by(samples).copied().fold(f64::MIN, f64::max);
        (0..samples).map(|s| of(s) + deltas).collect()
    }
}

fn words(numbers: &[f64]) -> String {
    numbers.iter().map(f64::to_string).collect::<Vec<_>>().join(", ")
}

/// The directory of the raw: the largest mosaic or linear raw that is no preview.
fn raw_directory<'a>(tiff: &Tiff, all: &'a [Directory]) -> Result<&'a Directory, DngError> {
    let mut best: Option<(f64, &Directory)> = None;
    for one in all {
        let is_raw = matches!(tiff.number(one, 262)?, Some(32803.0 | 34892.0));
        if !is_raw || tiff.number(one, 254)?.unwrap_or(0.0) != 0.0 {
            continue;
        }
        let area = tiff.number(one, 256)?.unwrap_or(0.0) * tiff.number(one, 257)?.unwrap_or(0.0);
        if best.is_none_or(|(most, _)| area > most) {
            best = Some((area, one));
        }
    }
    best.map(|(_, raw)| raw).ok_or_else(|| DngError::Unsupported {
        path: tiff.path().into(),
        what: "contents",
        expected: "a raw (photometric interpretation 32803 or 34892)".into(),
        found: format!("{} directories without one", all.len()),
    })
}

/// The rectangle ActiveArea: top, left, bottom, right.
fn active_area(tiff: &Tiff, raw: &Directory, size: Size) -> Result<Rect, DngError> {
    let Some(found) = tiff.numbers(raw, 50829)? else { return Ok(size.rect()) };
    let wrong = || tiff.damaged(format!("its active area {found:?} is not inside its {size} pixels"));
    let [top, left, bottom, right] = found[..] else { return Err(wrong()) };
    if bottom <= top || right <= left {
        return Err(wrong());
    }
    let rect = Rect::new(top as i64, left as i64, (bottom - top) as usize, (right - left) as usize);
    if size.rect().contains(rect) { Ok(rect) } else { Err(wrong()) }
}

/// The part of the active area that DefaultCropOrigin and DefaultCropSize (across, down) name.
fn crop(tiff: &Tiff, raw: &Directory, active: Rect) -> Result<Rect, DngError> {
    let Some(size) = tiff.numbers(raw, 50720)? else { return Ok(active) };
    let origin = tiff.numbers(raw, 50719)?.unwrap_or(vec![0.0, 0.0]);
    let wrong = || {
        tiff.damaged(format!(
            "its default crop {size:?} at {origin:?} is not inside its active area {active}"
        ))
    };
    let ([width, height], [left, top]) = (&size[..], &origin[..]) else { return Err(wrong()) };
    let all = [width, height, left, top];
    if all.iter().any(|v| !(0.0..=1e6).contains(*v)) || *width < 1.0 || *height < 1.0 {
        return Err(wrong());
    }
    let place = |first: i64, by: &f64| first + by.round() as i64;
    let rect = Rect::new(
        place(active.y, top),
        place(active.x, left),
        height.round() as usize,
        width.round() as usize,
    );
    if active.contains(rect) { Ok(rect) } else { Err(wrong()) }
}

/// Colours of 2 × 2 pixels from `origin` in the active area on.
fn pattern(tiff: &Tiff, raw: &Directory, origin: (usize, usize)) -> Result<[usize; 4], DngError> {
    let dimensions = tiff.numbers(raw, 33421)?.unwrap_or_default();
    let colours = tiff.raw(raw, 33422)?.unwrap_or_default();
    let planes = tiff.numbers(raw, 50710)?.unwrap_or(vec![0.0, 1.0, 2.0]);
    let layout = tiff.number(raw, 50711)?.unwrap_or(1.0);
    let count = [0, 1, 2].map(|colour| colours.iter().filter(|c| **c == colour).count());
    if dimensions[..] != [2.0, 2.0]
        || planes[..] != [0.0, 1.0, 2.0]
        || layout != 1.0
        || (count, colours.len()) != ([1, 2, 1], 4)
    {
        return Err(DngError::Unsupported {
            path: tiff.path().into(),
            what: "pattern of filters",
            expected: "2 x 2 pixels of red, green, green, blue (Bayer) in a rectangular layout; demosaic other sensors elsewhere, to a linear DNG or TIFF of 16 bits".into(),
            found: format!("dimensions {dimensions:?}, pattern {colours:?}, planes {planes:?}, layout {layout}"),
        });
    }
    let at = |k: usize| usize::from(colours[(k / 2 + origin.0) % 2 * 2 + (k % 2 + origin.1) % 2]);
    Ok([at(0), at(1), at(2), at(3)])
}

fn black(tiff: &Tiff, raw: &Directory, active: Size, samples: usize) -> Result<Black, DngError> {
    let repeat = tiff.numbers(raw, 50713)?.unwrap_or(vec![1.0, 1.0]);
    let levels = tiff.numbers(raw, 50714)?.unwrap_or_default();
    let (rows, columns) = match repeat[..] {
        [rows, columns] if (1.0..=64.0).contains(&rows) && (1.0..=64.0).contains(&columns) => {
            (rows as usize, columns as usize)
        }
        _ => return Err(tiff.damaged(format!("its black levels repeat after {repeat:?} pixels"))),
    };
    let count = rows * columns * samples;
    let levels = match levels.len() {
        0 => vec![0.0; count],
        n if n == count => levels,
        1 => vec![levels[0]; count],
        n => return Err(tiff.damaged(format!("it has {n} black levels, expected {count}"))),
    };
    let deltas = |tag, count: usize| -> Result<Vec<f64>, DngError> {
        let found = tiff.numbers(raw, tag)?.unwrap_or_default();
        match found.len() {
            0 => Ok(found),
            n if n == count => Ok(found),
            n => Err(tiff.damaged(format!("it has {n} deltas of the black level, expected {count}"))),
        }
    };
    let black = Black {
        rows,
        columns,
        levels,
        of_columns: deltas(50715, active.width)?,
        of_rows: deltas(50716, active.height)?,
    };
    let is_finite = |all: &[f64]| all.iter().all(|v| v.is_finite());
    match is_finite(&black.levels) && is_finite(&black.of_columns) && is_finite(&black.of_rows) {
        true => Ok(black),
        false => Err(tiff.damaged("a black level is no number")),
    }
}

/// Matrices, illuminants and white; `None` without a matrix or a white.
fn profile(tiff: &Tiff, first: &Directory, is_colour: bool) -> Result<Option<CameraProfile>, DngError> {
    let matrix = |tag| -> Result<Option<[[f64; 3]; 3]>, DngError> {
        let Some(v) = tiff.numbers(first, tag)? else { return Ok(None) };
        match v.len() == 9 && v.iter().all(|v| v.is_finite()) {
            true => Ok(Some(std::array::from_fn(|i| std::array::from_fn(|j| v[3 * i + j])))),
            false => Err(tiff.damaged(format!("tag {tag} is not a matrix of 3 x 3 numbers"))),
        }
    };
    if !is_colour {
        return Ok(None);
    }
    let mut calibrations = Vec::new();
    let same_signature = tiff.text(first, 50931)? == tiff.text(first, 50932)?;
    for (light, colour, camera, forward) in [(50778, 50721, 50723, 50964), (50779, 50722, 50724, 50965)] {
        let Some(xyz_to_camera) = matrix(colour)? else { continue };
        let own = matrix(camera)?.filter(|_| same_signature);
        calibrations.push(Calibration {
            temperature_k: tiff.number(first, light)?.and_then(|code| temperature_k(code as u16)),
            xyz_to_camera,
            camera: own.unwrap_or([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
            forward: matrix(forward)?,
        });
    }
    let three = |tag| -> Result<Option<[f64; 3]>, DngError> {
        let found = tiff.numbers(first, tag)?;
        Ok(found
            .and_then(|v| <[f64; 3]>::try_from(v).ok())
            .filter(|v| v.iter().all(|v| *v > 0.0 && *v < 1e6)))
    };
    let balance = three(50727)?.unwrap_or([1.0; 3]);
    let xy = tiff.numbers(first, 50729)?.and_then(|v| <[f64; 2]>::try_from(v).ok());
    Ok(CameraProfile::new(calibrations, balance, three(50728)?, xy.filter(|xy| xy[1] > 0.0 && xy[0] > 0.0)))
}

/// Correlated colour temperature of a light source of Exif, K.
fn temperature_k(code: u16) -> Option<f64> {
    Some(match code {
        3 | 17 => 2856.0,
        24 => 3200.0,
        15 => 3450.0,
        2 | 14 => 4150.0,
        13 | 23 => 5003.0,
        1 | 4 | 9 | 18 | 20 => 5503.0,
        12 => 6430.0,
        10 | 19 | 21 => 6504.0,
        11 | 22 => 7504.0,
        _ => return None,
    })
}

/// Camera, exposure time, ISO speed and aperture.
fn labels(tiff: &Tiff, first: &Directory) -> Result<String, DngError> {
    let name = match tiff.text(first, 50708)? {
        Some(name) => Some(name),
        None => tiff.text(first, 272)?,
    };
    let mut all = vec![name.unwrap_or("a camera without name".into())];
    let exif = tiff.pointed_to(first, 34665)?;
    let number = |tag| -> Result<Option<f64>, DngError> {
        let of = |d: Option<&Directory>| d.map_or(Ok(None), |d| tiff.number(d, tag));
        let found = of(exif.as_ref())?.or(of(Some(first))?);
        Ok(found.filter(|v| v.is_finite() && *v > 0.0))
    };
    if let Some(seconds) = number(33434)? {
        all.push(if seconds < 0.3 { format!("1/{:.0} s", 1.0 / seconds) } else { format!("{seconds} s") });
    }
    if let Some(f) = number(33437)? {
        all.push(format!("f/{f}"));
    }
    if let Some(iso) = number(34855)? {
        all.push(format!("ISO {iso}"));
    }
    Ok(all.join(", "))
}

fn remarks(tiff: &Tiff, first: &Directory, raw: &Directory) -> Result<Vec<String>, DngError> {
    let mut all = Vec::new();
    if let Some(orientation) = tiff.number(first, 274)?.filter(|o| *o != 1.0 && *o != 0.0) {
        all.push(format!(
            "its orientation ({orientation}) is not applied: rows and columns are as stored, not as a viewer shows them"
        ));
    }
    if tiff.numbers(raw, 50718)?.is_some_and(|s| s.len() == 2 && s[0] != s[1]) {
        all.push(
            "its pixels are not square (DefaultScale): frequencies and places are of stored pixels".into(),
        );
    }
    for (tag, what) in [
        (51008, "OpcodeList1 (defective pixels)"),
        (51009, "OpcodeList2 (gains over the picture)"),
        (51022, "OpcodeList3 (distortion, shading)"),
    ] {
        if raw.has(tag) {
            all.push(format!("its {what} is not applied: the sensor's own numbers are measured"));
        }
    }
    Ok(all)
}

#[cfg(test)]
mod tests;
