//! Two films of other pixels, both at the pixels of the coarser one that lie on both: means over these, as a sensor of such pixels has them ([`pipeline::sensor::pixels`]).

use crate::args::CompareArgs;
use crate::camera::frame::array_index;
use crate::failure::usage;
use crate::film::plane::FilmPlane;
use crate::job::light_units::{self, Quantity};
use crate::open::Chart;
use crate::progress::{log_line, number};
use anyhow::Result;
use formats::film::FilmStore;
use formats::group::GroupError;
use pipeline::flow::{ChartSource, SourceSinkError};
use pipeline::geometry::{Rect, Size};
use pipeline::sensor::pixels::{Axis, Resample, Taps};
use serde_json::{Value, json};

/// Share of a pixel of the finer film that counts as none.
const SAME_EDGE: f64 = 1e-9;
/// Pixels within which two optical axes are one.
const SAME_AXIS_PX: f64 = 1e-6;

/// A film at the common pixels.
pub struct View {
    rows: Taps,
    columns: Taps,
}

/// The common pixels of two films.
pub struct CommonPixels {
    /// How many there are.
    pub size: Size,
    /// Their pitch, µm.
    pub pitch_um: f64,
    /// Place of the optical axis on them (row, column), px.
    pub axis_px: (f64, f64),
    /// The films at them.
    pub views: [View; 2],
}

impl CommonPixels {
    /// Those of the films at `planes`; none if no pixel of the coarser one is on both.
    pub fn new(planes: &[FilmPlane; 2]) -> Option<Self> {
        let coarser = if planes[1].pitch_um > planes[0].pitch_um { &planes[1] } else { &planes[0] };
        let pitch_um = coarser.pitch_um;
        let slack = SAME_EDGE * planes[0].pitch_um.min(planes[1].pitch_um) / pitch_um;
        // Of each film along an axis, pixels and the optical axis from its middle.
        let along = |of: &dyn Fn(&FilmPlane) -> (usize, f64)| {
            let ends = |plane: &FilmPlane| {
                let (n, axis_um) = of(plane);
                let half = 0.5 * n as f64 * plane.pitch_um;
                [-half - axis_um, half - axis_um]
            };
            let [a, b] = planes.each_ref().map(ends);
            let first = ends(coarser)[0];
            let pixel = |um: f64| (um - first) / pitch_um;
            let from = (pixel(a[0].max(b[0])) - slack).ceil();
            let to = (pixel(a[1].min(b[1])) + slack).floor();
            let count = (to > from).then_some((to - from) as usize)?;
            let middle_um = first + 0.5 * (from + to) * pitch_um;
            let taps = |plane: &FilmPlane| {
                let (film_px, axis_um) = of(plane);
                let axis = Axis {
                    film_px,
                    film_pitch_um: plane.pitch_um,
                    sensor_px: count,
                    pitch_um,
                    aperture_um: pitch_um,
                    centre_um: middle_um + axis_um,
                };
                axis.taps(0..count, Resample::Cubic).ok()
            };
            let [a, b] = planes.each_ref().map(taps);
            Some((count, -first / pitch_um - from - 0.5, [a?, b?]))
        };
        let (height, axis_row, [rows_a, rows_b]) = along(&|plane| (plane.size.height, plane.axis_um.0))?;
        let (width, axis_column, [columns_a, columns_b]) =
            along(&|plane| (plane.size.width, plane.axis_um.1))?;
        let views = [View { rows: rows_a, columns: columns_a }, View { rows: rows_b, columns: columns_b }];
        Some(Self { size: Size::new(height, width), pitch_um, axis_px: (axis_row, axis_column), views })
    }

    /// As they are reported.
    pub fn json(&self) -> Value {
        let Self { size, pitch_um, axis_px: (y, x), .. } = self;
        json!({ "width": size.width, "height": size.height, "pitch_um": pitch_um, "axis_px": { "x": x, "y": y } })
    }
}

impl View {
    /// The common pixels `rect` of a band of the film `source`, row by row.
    ///
    /// # Errors
    /// The film cannot be read.
    pub fn read(
        &self,
        source: &dyn ChartSource,
        band: usize,
        rect: Rect,
    ) -> Result<Vec<f32>, SourceSinkError> {
        let range = |first: i64, n: usize| first as usize..first as usize + n;
        let (rows, columns) = (range(rect.y, rect.height), range(rect.x, rect.width));
        let (down, across) = (self.rows.span(rows.clone()), self.columns.span(columns.clone()));
        let of_film = Rect::new(down.start as i64, across.start as i64, down.len(), across.len());
        let mut film = vec![0.0f32; of_film.size().pixels()];
        source.read(band, of_film, &mut film)?;
        let mut out = Vec::with_capacity(rect.size().pixels());
        for row in rows {
            let (first, weights) = self.rows.of(row);
            let mut line = vec![0.0; across.len()];
            for (k, weight) in weights.iter().enumerate() {
                let from = &film[(first + k - down.start) * across.len()..][..across.len()];
                line.iter_mut().zip(from).for_each(|(sum, v)| *sum += weight * f64::from(*v));
            }
            out.extend(columns.clone().map(|column| {
                let (first, weights) = self.columns.of(column);
                let part = &line[first - across.start..];
                weights.iter().zip(part).map(|(w, v)| w * v).sum::<f64>() as f32
            }));
        }
        Ok(out)
    }
}

/// The pixels at which films of other pixels are compared, of which a note is printed.
///
/// # Errors
/// Usage: edges; films without a pixel pitch, or that have no pixel in common.
pub fn common_pixels(args: &CompareArgs, names: &[String; 2], charts: &[Chart; 2]) -> Result<CommonPixels> {
    let [a, b] = charts;
    let words = |c: &Chart| {
        let pitch = c.pitch_um().map_or(String::new(), |um| format!(" of {} µm", number(um)));
        format!("{} px{pitch}", c.size())
    };
    let refused = |expected: &str| {
        let [first, second] = names;
        usage(format!("{first} and {second}: expected {expected}, found {} and {}", words(a), words(b)))
    };
    let (Some(pitch_a), Some(pitch_b)) = (a.pitch_um(), b.pitch_um()) else {
        return Err(refused("films of the same pixels, or with a pixel pitch"));
    };
    if !args.edge.is_empty() {
        return Err(refused(
            "films of the same pixels for --edge, which is a place in pixels; `lenscube measure` measures an edge of one film",
        ));
    }
    let per_pixel = |c: &Chart| {
        c.units().and_then(light_units::parse).is_some_and(|(quantity, _)| quantity == Quantity::Photons)
    };
    if per_pixel(a) || per_pixel(b) {
        return Err(refused(
            "films of the same pixels where values are photons of a pixel; make them in W m-2 nm-1 (--film-units)",
        ));
    }
    let of = |name: &String, chart: &Chart, pitch_um: f64| -> Result<FilmPlane> {
        Ok(plane(chart)?.unwrap_or_else(|| {
            if !name.starts_with("gen:") {
                log_line(format!("note: {name} records no optical axis: its middle is taken for it"));
            }
            FilmPlane { size: chart.size(), pitch_um, axis_um: (0.0, 0.0) }
        }))
    };
    let planes = [of(&names[0], a, pitch_a)?, of(&names[1], b, pitch_b)?];
    let common = CommonPixels::new(&planes).ok_or_else(|| {
        refused("films that have a pixel of the film plane in common, about their optical axis")
    })?;
    log_line(format!(
        "note: the films have other pixels ({} and {}): both are compared at the {} px of {} µm of the coarser one that lie on both",
        words(a),
        words(b),
        common.size,
        number(common.pitch_um)
    ));
    Ok(common)
}

/// Prints a note if the films `names`, of the same pixels, record optical axes at other ones.
pub fn note_other_axes(names: &[String; 2], charts: &[Chart; 2]) {
    let (Ok(Some(a)), Ok(Some(b))) = (plane(&charts[0]), plane(&charts[1])) else { return };
    let [y, x] = [a.axis_um.0 - b.axis_um.0, a.axis_um.1 - b.axis_um.1].map(|um| um / a.pitch_um);
    if y.abs().max(x.abs()) > SAME_AXIS_PX {
        log_line(format!(
            "note: the films have their optical axis at other pixels ({} px right, {} px down in {} of where {} has it): they are compared pixel by pixel",
            number(x),
            number(y),
            names[0],
            names[1]
        ));
    }
}

/// Where the pixels of a film are; none of what is no film of this program, and records no axis.
///
/// # Errors
/// A film that cannot be opened; usage: an array that it does not have.
fn plane(chart: &Chart) -> Result<Option<FilmPlane>> {
    let Chart::Store(store) = chart else { return Ok(None) };
    let film = match FilmStore::open(store.path(), true) {
        Ok(film) => film,
        Err(GroupError::NotOfKind { .. }) => return Ok(None),
        Err(e) => return Err(e.into()),
    };
    let (path, array) = (store.path().display().to_string(), store.array_path());
    let array = array.file_name().unwrap_or_default().to_string_lossy();
    let names: Vec<&str> = film.spec().outputs.iter().map(|output| output.name.as_str()).collect();
    Ok(Some(FilmPlane::new(film.spec(), array_index("film", &path, &names, &array)?)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A plane (x + 2 y) µm of places from the axis, the mean of each pixel.
    struct Plane(FilmPlane);

    impl ChartSource for Plane {
        fn size(&self) -> Size {
            self.0.size
        }

        fn read(&self, _band: usize, rect: Rect, out: &mut [f32]) -> Result<(), SourceSinkError> {
            let FilmPlane { size, pitch_um, axis_um } = self.0;
            let um = |at: i64, k: usize, n: usize, axis: f64| {
                ((at as usize + k) as f64 + 0.5 - 0.5 * n as f64) * pitch_um - axis
            };
            for (k, v) in out.iter_mut().enumerate() {
                let y = um(rect.y, k / rect.width, size.height, axis_um.0);
                let x = um(rect.x, k % rect.width, size.width, axis_um.1);
                *v = (x + 2.0 * y) as f32;
            }
            Ok(())
        }
    }

    #[test]
    fn places_of_the_film_plane_have_the_same_values_in_both() {
        let fine = FilmPlane { size: Size::new(60, 90), pitch_um: 2.0, axis_um: (0.0, 10.0) };
        let coarse = FilmPlane { size: Size::new(30, 20), pitch_um: 5.0, axis_um: (-20.0, 0.0) };
        for planes in [[fine, coarse], [coarse, fine]] {
            let common = CommonPixels::new(&planes).unwrap();
            // Rows from −55 to 95 and −60 to 60 µm, columns from −50 to 50 and −100 to 80 µm.
            assert_eq!((common.size, common.pitch_um), (Size::new(23, 20), 5.0));
            // The first of them begins 55 µm above and 50 µm left of the axis.
            assert!((common.axis_px.0 - 10.5).abs() < 1e-9 && (common.axis_px.1 - 9.5).abs() < 1e-9);
            let rect = Rect::new(2, 3, 19, 15);
            let read = |k: usize| common.views[k].read(&Plane(planes[k]), 0, rect).unwrap();
            for (a, b) in read(0).into_iter().zip(read(1)) {
                assert!((a - b).abs() < 1e-4, "{a} {b}");
            }
        }
        // An axis that was rounded takes a pixel at most.
        let rounded = FilmPlane { axis_um: (0.0, 10.0 + 1e-6), ..fine };
        assert!(CommonPixels::new(&[rounded, coarse]).is_some_and(|common| common.size.width >= 19));
        let apart = FilmPlane { axis_um: (500.0, 0.0), ..fine };
        assert!(CommonPixels::new(&[apart, coarse]).is_none());
    }
}
