//! White gains and colour matrix of a development.

use super::frame::Frame;
use crate::args::DevelopStyle;
use crate::failure::usage;
use anyhow::{Context, Result};
use formats::durable::read_file_at_most;
use formats::parallel;
use pipeline::colour::Illuminant;
use pipeline::develop::{ColourMatrix, Demosaic, Recipe};
use pipeline::geometry::Rect;
use pipeline::sensor::Sensor;
use std::path::Path;
use std::sync::Mutex;

/// Rows that are summed together.
const ROWS: usize = 512;
/// Size of a matrix file, at most.
const MAX_MATRIX_BYTES: u64 = 1 << 16;

/// A recipe and its description.
pub struct Named {
    /// The recipe.
    pub recipe: Recipe,
    /// Its white, matrix and demosaicing.
    pub description: String,
}

/// The recipe of `style` for a frame.
pub fn resolve(frame: &Frame, style: &DevelopStyle, threads: usize) -> Result<Named> {
    let sensor = &frame.sensor;
    let planes = sensor.planes().len();
    let plane_of = sensor.plane_of_channels();
    let light = light_of(frame, style)?;
    let (gains, white) = gains(frame, style, light, &plane_of, threads)?;
    let (matrix, name) = matrix(frame, style, light, planes)?;
    let demosaic = match style.demosaic {
        Some(given) => given,
        None if is_bayer(frame, &plane_of, style.bin == 2) => Demosaic::Malvar,
        None => Demosaic::Bilinear,
    };
    let by_name: Vec<String> =
        std::iter::zip(&sensor.channels, &gains).map(|(c, g)| format!("{} {g:.4}", c.name)).collect();
    let description = format!(
        "white {white} (gains {}), demosaic {}, bin {}, {name}",
        by_name.join(", "),
        format!("{demosaic:?}").to_lowercase(),
        style.bin
    );
    let recipe = Recipe {
        size: frame.rect.size(),
        pattern: sensor.pattern.clone(),
        plane_of,
        black_white_dn: frame.black_white_dn(),
        limit: frame.range(),
        gains,
        bin: style.bin == 2,
        demosaic,
        matrix,
        exposure: pipeline::real::pow(2.0, style.exposure),
    };
    Ok(Named { recipe, description })
}

/// Light of the white and of the matrix.
fn light_of(frame: &Frame, style: &DevelopStyle) -> Result<Illuminant> {
    Ok(check_white(style.white.as_deref(), &frame.sensor)?.or(frame.light()).unwrap_or_default())
}

/// The light that `--white` names; `None` for that of the chart, or for gains.
///
/// # Errors
/// Usage: neither a light nor gains of the sensor's planes.
pub fn check_white(white: Option<&str>, sensor: &Sensor) -> Result<Option<Illuminant>> {
    match white {
        None | Some("auto") => Ok(None),
        Some(text) if text.contains(',') => given_gains(text, sensor).map(|_| None),
        Some(name) => name.parse().map(Some).map_err(|_| {
            usage(format!(
                "--white {name}: expected D65, A, E, auto, or gains of the planes such as 1.9,1,1.6"
            ))
        }),
    }
}

/// Gains of the planes in the text of `--white`.
fn given_gains(text: &str, sensor: &Sensor) -> Result<Vec<f64>> {
    let planes = sensor.planes();
    let given: Option<Vec<f64>> = text.split(',').map(|v| v.trim().parse().ok()).collect();
    let given = given.filter(|g| g.len() == planes.len() && g.iter().all(|v| v.is_finite() && *v > 0.0));
    given.ok_or_else(|| {
        usage(format!(
            "--white {text}: expected {} gains above 0, of the planes {}",
            planes.len(),
            planes.join(", ")
        ))
    })
}

/// `gains` over the least of them.
pub fn least_one(gains: Vec<f64>) -> Vec<f64> {
    let least = gains.iter().copied().fold(f64::INFINITY, f64::min);
    gains.into_iter().map(|g| g / least).collect()
}

/// White gains of the filters, the least 1, and their name.
fn gains(
    frame: &Frame,
    style: &DevelopStyle,
    light: Illuminant,
    plane_of: &[usize],
    threads: usize,
) -> Result<(Vec<f64>, String)> {
    match style.white.as_deref() {
        Some("auto") => Ok((least_one(grey_world(frame, threads)?), "auto".into())),
        Some(text) if text.contains(',') => {
            let given = given_gains(text, &frame.sensor)?;
            Ok((least_one(plane_of.iter().map(|p| given[*p]).collect()), text.into()))
        }
        _ => {
            let gains = frame.sensor.white_gains(light);
            match gains.iter().all(|g| g.is_finite()) {
                true => Ok((least_one(gains), light.name().into())),
                false => Err(usage(format!(
                    "--white {}: a filter of sensor {} does not respond to it between 380 and 780 nm; give gains of the planes",
                    light.name(),
                    frame.sensor.name
                ))),
            }
        }
    }
}

/// Reciprocal means of the unclipped pixels of each filter, from integer sums, so that they do not depend on an order.
fn grey_world(frame: &Frame, threads: usize) -> Result<Vec<f64>> {
    let (black, white) = frame.black_white_dn();
    let filters = frame.sensor.channels.len();
    let size = frame.rect.size();
    let total = Mutex::new(vec![(0u64, 0u64); filters]);
    let add_strip = |k: usize| -> Result<()> {
        let rect = Rect::new((k * ROWS) as i64, 0, ROWS.min(size.height - k * ROWS), size.width);
        let pixels = frame.read(rect)?;
        let mut sums = vec![(0, 0); filters];
        for (y, line) in pixels.chunks(size.width).enumerate() {
            for (x, dn) in line.iter().enumerate().filter(|(_, v)| f64::from(**v) < white) {
                let row = frame.rect.y as usize + k * ROWS + y;
                let of = &mut sums[frame.sensor.pattern.channel(row, frame.rect.x as usize + x)];
                *of = (of.0 + *dn as u64, of.1 + 1);
            }
        }
        let mut total = total.lock().expect("no panic while held");
        std::iter::zip(total.iter_mut(), sums).for_each(|(t, s)| *t = (t.0 + s.0, t.1 + s.1));
        Ok(())
    };
    let strips = size.height.div_ceil(ROWS);
    parallel::for_each(threads.min(strips), strips, &|_, _| (), add_strip)?;
    let sums = total.into_inner().expect("no panic while held");
    let mean = |(c, (sum, n)): (usize, &(u64, u64))| {
        let mean = *sum as f64 / (*n).max(1) as f64 - black;
        match mean > 0.0 {
            true => Ok(1.0 / mean),
            false => Err(usage(format!(
                "--white auto: the unclipped pixels behind {} are dark on average; name a light",
                frame.sensor.channels[c].name
            ))),
        }
    };
    sums.iter().enumerate().map(mean).collect()
}

type Rows = Vec<Vec<f64>>;

/// Rows of the matrix, and its name.
fn matrix(frame: &Frame, style: &DevelopStyle, light: Illuminant, planes: usize) -> Result<(Rows, String)> {
    if planes == 1 {
        return Ok((vec![vec![1.0]], "monochrome".into()));
    }
    match style.matrix.as_str() {
        "fitted" => {
            let fitted = ColourMatrix::fitted(&frame.sensor, light)
                .map_err(|e| usage(format!("{e}; give --matrix none or a file, or another --white")))?;
            let name = format!(
                "matrix fitted under {}: ΔE2000 of the ColorChecker mean {:.2}, largest {:.2}",
                light.name(),
                fitted.mean_delta_e(),
                fitted.max_delta_e()
            );
            Ok((fitted.rows, name))
        }
        "none" if planes == 3 => {
            let unit = |i: usize| (0..3).map(|j| if i == j { 1.0 } else { 0.0 }).collect();
            Ok(((0..3).map(unit).collect(), "no matrix".into()))
        }
        "none" => Err(usage(format!(
            "--matrix none: sensor {} has {planes} planes, a picture 3; use --matrix fitted or a file of 3 x {planes} numbers",
            frame.sensor.name
        ))),
        file => Ok((read_matrix(Path::new(file), planes)?, format!("matrix of {file}"))),
    }
}

/// Three rows of numbers, separated by blanks, commas or semicolons; `#` begins a comment.
fn read_matrix(path: &Path, planes: usize) -> Result<Rows> {
    let shown = path.display();
    let bytes = read_file_at_most(path, MAX_MATRIX_BYTES).with_context(|| format!("--matrix {shown}"))?;
    let bytes = bytes.ok_or_else(|| {
        usage(format!(
            "--matrix {shown}: expected three rows of {planes} numbers, found more than {MAX_MATRIX_BYTES} bytes"
        ))
    })?;
    let text = String::from_utf8(bytes).with_context(|| format!("--matrix {shown}"))?;
    let mut rows = Vec::new();
    for (k, line) in text.lines().enumerate() {
        let line = line.split('#').next().unwrap_or_default();
        let words = line.split(|c: char| c.is_whitespace() || c == ',' || c == ';').filter(|w| !w.is_empty());
        let row: Option<Vec<f64>> = words.map(|w| w.parse().ok().filter(|v: &f64| v.is_finite())).collect();
        match row {
            Some(row) if row.is_empty() => {}
            Some(row) if row.len() == planes => rows.push(row),
            _ => {
                return Err(usage(format!(
                    "--matrix {shown}, line {}: expected {planes} numbers, found `{}`",
                    k + 1,
                    line.trim()
                )));
            }
        }
    }
    match rows.len() {
        3 => Ok(rows),
        n => Err(usage(format!("--matrix {shown}: expected three rows of {planes} numbers, found {n} rows"))),
    }
}

/// Whether the frame, binned or not, has a Bayer pattern, or one plane.
fn is_bayer(frame: &Frame, plane_of: &[usize], binned: bool) -> bool {
    let p = &frame.sensor.pattern;
    let period = if binned { 4 } else { 2 };
    let step = if binned { 2 } else { 1 };
    if plane_of.iter().all(|p| *p == 0) {
        return true;
    }
    let planes = (0..4).map(|k| plane_of[p.channel(step * (k / 2), step * (k % 2))]).collect();
    let first =
        pipeline::develop::PlanePattern { rows: 2, columns: 2, planes, count: frame.sensor.planes().len() };
    (p.rows, p.columns) == (period, period) && first.is_bayer()
}
