//! The classes: a lens, and its film at one place.

use crate::work::{abandonable, cancellable, failure};
use lenscube::{ArrayFilm, ArrayLens, Size};
use numpy::{PyReadonlyArray4, PyReadwriteArray4};
use pyo3::prelude::*;
use std::sync::Arc;

/// A lens for arrays in memory.
#[pyclass(frozen, module = "lenscube._native")]
pub struct NativeLens(Arc<ArrayLens>);

#[pymethods]
impl NativeLens {
    /// The lens that `flags` of `lenscube run` describe, at `wavelengths_nm`.
    #[new]
    fn new(py: Python<'_>, flags: Vec<String>, wavelengths_nm: Option<Vec<f64>>) -> PyResult<Self> {
        let lens = py.detach(|| ArrayLens::open(&flags, wavelengths_nm));
        Ok(Self(Arc::new(lens.map_err(|error| failure(&error))?)))
    }

    /// Wavelengths of the bands, nm.
    #[getter]
    fn wavelengths_nm(&self) -> Vec<f64> {
        self.0.wavelengths_nm().to_vec()
    }

    /// Where on the film points (x, y) of the chart land at `nm`, mm.
    fn film_of_chart(&self, py: Python<'_>, points: Vec<[f64; 2]>, nm: f64) -> PyResult<Vec<[f64; 2]>> {
        let lens = Arc::clone(&self.0);
        abandonable(py, move || lens.film_of_chart(&points, nm))
    }

    /// The points (x, y) of the chart that the film shows at `points`, mm.
    fn chart_of_film(&self, py: Python<'_>, points: Vec<[f64; 2]>, nm: f64) -> PyResult<Vec<[f64; 2]>> {
        let lens = Arc::clone(&self.0);
        abandonable(py, move || lens.chart_of_film(&points, nm))
    }

    /// Relative illumination at points (x, y) of the film, mm.
    fn relative_illumination(&self, py: Python<'_>, points: Vec<[f64; 2]>, nm: f64) -> PyResult<Vec<f64>> {
        let lens = Arc::clone(&self.0);
        abandonable(py, move || lens.relative_illumination(&points, nm))
    }

    /// The film of arrays of `rows` and `columns`, with further flags.
    fn film(&self, py: Python<'_>, rows: usize, columns: usize, flags: Vec<String>) -> PyResult<NativeFilm> {
        let lens = Arc::clone(&self.0);
        let size = Size::new(rows, columns);
        // No thread for a film that is known.
        match lens.known_film(size, &flags) {
            Some(film) => Ok(NativeFilm(film)),
            None => Ok(NativeFilm(abandonable(py, move || lens.film(size, &flags))?)),
        }
    }
}

/// A film of arrays, ready to be computed.
#[pyclass(frozen, module = "lenscube._native")]
pub struct NativeFilm(Arc<ArrayFilm>);

#[pymethods]
impl NativeFilm {
    /// (bands, rows, columns) of a film.
    #[getter]
    fn shape(&self) -> (usize, usize, usize) {
        self.0.shape().into()
    }

    /// Side of the PSF windows of a band, film pixels.
    fn window_px(&self, band: usize) -> usize {
        self.0.window_px(band)
    }

    /// Notes on the job.
    #[getter]
    fn notes(&self) -> Vec<String> {
        self.0.notes().to_vec()
    }

    /// Computes the films of `arrays` (n, band, y, x) into `films` (n, band, y, x).
    fn compute(
        &self,
        py: Python<'_>,
        arrays: PyReadonlyArray4<'_, f32>,
        mut films: PyReadwriteArray4<'_, f32>,
    ) -> PyResult<()> {
        let (arrays, films) = (arrays.as_slice()?, films.as_slice_mut()?);
        cancellable(py, |cancel| self.0.compute(arrays, films, cancel))
    }

    /// The transpose of `compute`: from `films` to `arrays`.
    fn adjoint(
        &self,
        py: Python<'_>,
        films: PyReadonlyArray4<'_, f32>,
        mut arrays: PyReadwriteArray4<'_, f32>,
    ) -> PyResult<()> {
        let (films, arrays) = (films.as_slice()?, arrays.as_slice_mut()?);
        cancellable(py, |cancel| self.0.adjoint(films, arrays, cancel))
    }
}
