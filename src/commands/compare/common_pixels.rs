//! Two films of other pixels, both at the pixels of the coarser one that lie on both: means over these, as a sensor of such pixels has them ([`pipeline::sensor::pixels`]).

use crate::film::plane::FilmPlane;
use pipeline::flow::{ChartSource, SourceSinkError};
use pipeline::geometry::{Rect, Size};
use pipeline::sensor::pixels::{Axis, Resample, Taps};

/// Share of a pixel of the finer film that counts as none.
const SAME_EDGE: f64 = 1e-9;

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
