//! The film that a camera model is fitted on.

use super::opened::Opened;
use crate::args::LensExportArgs;
use crate::failure::usage;
use crate::progress::log_line;
use anyhow::Result;
use pipeline::bounds::FILM_SIDE_PX;
use pipeline::camera_model::field_map::FieldSource;
use pipeline::camera_model::target::FilmArea;
use pipeline::geometry::Size;

/// Height of the film's corner over that of the outermost field point, from which a note is printed.
const BEYOND_FIELD: f64 = 1.05;
/// Share of the field that several wavelengths have in common: their last chief rays differ.
const WITHIN_FIELD: f64 = 0.999;

/// A film with its middle on the axis.
pub struct Film {
    pub size: Size,
    pub pitch_mm: f64,
    /// Where the model is fitted.
    pub area: FilmArea,
}

impl Film {
    /// The film of `args`, within the field of `sources`.
    ///
    /// # Errors
    /// Usage: no field off the axis and no `--film-size`.
    pub fn new(args: &LensExportArgs, opened: &Opened, sources: &[FieldSource<'_>]) -> Result<Self> {
        let pitch_mm = args.film_pitch_um * 1e-3;
        let last_mm = sources.iter().map(FieldSource::last_mm).fold(f64::INFINITY, f64::min);
        let last_mm = if sources.len() == 1 { last_mm } else { WITHIN_FIELD * last_mm };
        let reach_mm = opened.reach_mm()?;
        let Some(size) = args.film_size else {
            let reach_mm = reach_mm.min(last_mm);
            let side = (2.0 * reach_mm / pitch_mm).ceil() + 1.0;
            return match reach_mm > 0.0 && FILM_SIDE_PX.contains(side) {
                true => Ok(Self {
                    size: Size::new(side as usize, side as usize),
                    pitch_mm,
                    area: FilmArea::circle(reach_mm),
                }),
                false => Err(usage(format!(
                    "{}: the field points of the lens give no film of up to {} px a side; give --film-size",
                    args.lens, FILM_SIDE_PX.max
                ))),
            };
        };
        let corner_mm = FilmArea::film(size, pitch_mm, f64::INFINITY).last_mm();
        if corner_mm > last_mm {
            log_line(format!(
                "note: the film's corner at {corner_mm:.3} mm from the axis lies beyond the field of the lens, which ends at {last_mm:.3} mm; the fit covers the \
                 circle of this radius"
            ));
        } else if reach_mm > 0.0 && corner_mm > BEYOND_FIELD * reach_mm {
            log_line(format!(
                "note: the film's corner at {corner_mm:.3} mm from the axis lies beyond the outermost field point of {} at {reach_mm:.3} mm",
                args.lens
            ));
        }
        Ok(Self { size, pitch_mm, area: FilmArea::film(size, pitch_mm, last_mm) })
    }
}
