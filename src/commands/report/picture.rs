//! Pictures that are measured: raws and DNGs, developed and pixel by pixel, and files of pictures; linear in light.

use crate::args::{DevelopStyle, ReportArgs};
use crate::camera::Developer;
use crate::camera::dng::{DngPicture, DngPlane};
use crate::camera::frame::{Frame, split_group};
use crate::commands::measure::plane::Plane;
use crate::failure::usage;
use crate::progress::log_line;
use anyhow::{Context, Result};
use formats::chart::image::{ImageFile, Transfer};
use formats::raw::{RawSpec, RawStore};
use pipeline::flow::ChartSource;
use pipeline::geometry::{Rect, Size};
use pipeline::measure::shading::LUMINANCE;
use std::path::Path;

/// Share of white from which on a value counts as clipped.
const CLIPPED: f32 = 0.999;

/// A picture.
pub struct Picture {
    /// Its name.
    pub name: String,
    source: Source,
}

enum Source {
    /// A raw.
    Raw(Box<Developer>),
    /// A raw of another camera.
    Dng(Box<DngPicture>),
    /// Linear channels, white being 1.
    Channels { source: Box<dyn ChartSource>, count: usize, is_float: bool },
}

/// Pixels (row, column, value) of one colour, and how many of them are clipped.
pub struct Colour {
    /// Its name.
    pub name: String,
    /// Its pixels.
    pub pixels: Vec<(f64, f64, f64)>,
    /// Clipped ones among them.
    pub clipped: usize,
}

impl Picture {
    /// Opens a raw, a DNG or a file of a picture.
    ///
    /// # Errors
    /// It is none, or does not decode; a raw that is not complete.
    pub fn open(name: &str, args: &ReportArgs, threads: usize) -> Result<Self> {
        let path = Path::new(split_group(name).0);
        let source = if RawStore::is_one(path).unwrap_or(false) {
            let chunk = RawSpec::chunk_shape();
            let width = Frame::open(name, args.frame, 0)?.rect.width;
            let cache = 2 * 4 * chunk.0 * width.next_multiple_of(chunk.1);
            let frame = Frame::open(name, args.frame, cache)?;
            Source::Raw(Box::new(Developer::new(frame, &DevelopStyle::default(), threads, 0)?))
        } else {
            if path.is_dir() {
                let way_out = "expose a sensor to a film by `lenscube sensor`, or measure the film by `lenscube measure`";
                return Err(usage(format!(
                    "{name}: expected a raw or a file of a picture, found a directory that is no raw; {way_out}"
                )));
            }
            if args.frame != 0 {
                return Err(usage(format!("--frame {}: {name} is not a raw", args.frame)));
            }
            if formats::dng::is_dng(path) {
                let dng = DngPicture::open(path)?;
                log_line(format!("{name}: {}", dng.raw.description));
                dng.raw.notes.iter().for_each(|note| log_line(format!("{name}: {note}")));
                return Ok(Self { name: name.into(), source: Source::Dng(Box::new(dng)) });
            }
            let file = ImageFile::open(path)?;
            if file.spectral().is_some() {
                return Err(usage(format!(
                    "{name}: expected a picture in grey or colour, found bands; measure them by `lenscube measure`"
                )));
            }
            let transfer = if args.linear { Transfer::Linear } else { Transfer::Srgb };
            let (count, is_float) = (if file.is_grey() { 1 } else { 3 }, file.white() == 0);
            let source = file.linear(transfer, &std::env::temp_dir(), threads, &|_, _| {});
            Source::Channels { source: source.with_context(|| name.to_owned())?, count, is_float }
        };
        Ok(Self { name: name.into(), source })
    }

    /// Its size.
    pub fn size(&self) -> Size {
        match &self.source {
            Source::Raw(developer) => developer.rect().size(),
            Source::Dng(dng) => dng.size(),
            Source::Channels { source, .. } => source.size(),
        }
    }

    /// The frame of a raw.
    pub fn frame(&self) -> Option<&Frame> {
        match &self.source {
            Source::Raw(developer) => Some(&developer.frame),
            Source::Dng(_) | Source::Channels { .. } => None,
        }
    }

    /// Unit of [`Picture::colours`].
    pub fn unit(&self) -> &'static str {
        match &self.source {
            Source::Raw(_) => "e-",
            Source::Dng(_) => "DN",
            Source::Channels { .. } => "of white",
        }
    }

    /// The camera and its exposure, if the file names them.
    pub fn camera(&self) -> Option<&str> {
        match &self.source {
            Source::Dng(dng) => Some(&dng.raw.description),
            Source::Raw(_) | Source::Channels { .. } => None,
        }
    }

    /// Its channels in `rect`, one after the other: grey, or linear sRGB.
    ///
    /// # Errors
    /// `rect` is not inside the picture; it cannot be read.
    pub fn channels(&self, rect: Rect) -> Result<Vec<Vec<f32>>> {
        let size = self.size();
        if !size.rect().contains(rect) {
            return Err(outside(&self.name, rect, size));
        }
        match &self.source {
            Source::Raw(developer) => Ok(side_by_side(&developer.linear(rect)?, developer.channels())),
            Source::Dng(dng) => Ok(side_by_side(&dng.linear(rect), dng.channels())),
            Source::Channels { source, count, .. } => {
                let read = |band| {
                    let mut pixels = vec![0.0; rect.size().pixels()];
                    source.read(band, rect, &mut pixels).map_err(anyhow::Error::from_boxed)?;
                    Ok(pixels)
                };
                (0..*count).map(read).collect()
            }
        }
    }

    /// Its luminance in `rect`.
    ///
    /// # Errors
    /// As [`Picture::channels`].
    pub fn luminance(&self, rect: Rect) -> Result<Vec<f32>> {
        let mut channels = self.channels(rect)?;
        Ok(match &channels[..] {
            [r, g, b] => {
                let of = |i: usize| {
                    LUMINANCE[0] * f64::from(r[i])
                        + LUMINANCE[1] * f64::from(g[i])
                        + LUMINANCE[2] * f64::from(b[i])
                };
                (0..r.len()).map(|i| of(i) as f32).collect()
            }
            _ => channels.swap_remove(0),
        })
    }

    /// Its colours in `rect`: planes of a raw in electrons of light, of a DNG in linear DN above black, not demosaiced; channels of a picture as shares of white.
    ///
    /// # Errors
    /// As [`Picture::channels`].
    pub fn colours(&self, rect: Rect) -> Result<Vec<Colour>> {
        let place = |y: i64, x: i64, v: f32| (y as f64, x as f64, f64::from(v));
        if let Some(frame) = self.frame() {
            let of = |(plane, name): (usize, &str)| {
                let pixels = Plane::Raw(frame, plane).read(rect, "the chart")?;
                Ok(Colour {
                    name: name.to_owned(),
                    clipped: pixels.values().filter(|(_, _, v)| pixels.is_saturated(*v)).count(),
                    pixels: pixels.values().map(|(y, x, v)| place(y, x, v)).collect(),
                })
            };
            return frame.sensor.planes().into_iter().enumerate().map(of).collect();
        }
        if let Source::Dng(dng) = &self.source {
            if !dng.size().rect().contains(rect) {
                return Err(outside(&self.name, rect, dng.size()));
            }
            let of = |plane: DngPlane| Colour {
                name: plane.name.to_owned(),
                pixels: plane.pixels,
                clipped: plane.saturated,
            };
            return Ok(dng.planes(rect).into_iter().map(of).collect());
        }
        let Source::Channels { is_float, count, .. } = &self.source else { unreachable!("it is no raw") };
        let names: &[&str] = if *count == 1 { &["grey"] } else { &["R", "G", "B"] };
        let of = |(name, values): (&&str, Vec<f32>)| Colour {
            name: (*name).to_owned(),
            clipped: values.iter().filter(|v| !is_float && **v >= CLIPPED).count(),
            pixels: values
                .iter()
                .enumerate()
                .map(|(i, v)| place(rect.y + (i / rect.width) as i64, rect.x + (i % rect.width) as i64, *v))
                .collect(),
        };
        Ok(names.iter().zip(self.channels(rect)?).map(of).collect())
    }
}

/// Channels one after the other from those of pixels side by side.
fn side_by_side(linear: &[f32], count: usize) -> Vec<Vec<f32>> {
    (0..count).map(|c| linear.iter().skip(c).step_by(count).copied().collect()).collect()
}

fn outside(name: &str, rect: Rect, size: Size) -> anyhow::Error {
    usage(format!("{name}: the chart needs {rect}, which is not inside the picture of {size}"))
}
