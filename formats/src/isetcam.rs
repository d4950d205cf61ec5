//! Optics of ISETCam's ray-trace model as a MAT-file, which `oiCreate('ray trace', FILE)` loads: the struct `optics`.
//!
//! | field of `optics` | |
//! |---|---|
//! | `type`, `name`, `model` | `optics`, name of the lens, `raytrace` |
//! | `fNumber`, `focalLength` | focal length in m |
//! | `offaxis`, `vignetting` | `skip`, 0: relative illumination is that of the table |
//! | `transmittance.wave`, `.scale` | nm; 1 |
//! | `rayTrace.name`, `.program`, `.lensFile` | name of the lens, `lenscube`, name of the lens |
//! | `rayTrace.referenceWavelength`, `.objectDistance`, `.mag` | nm; mm, 10¹⁰ for infinity; −\|magnification\| |
//! | `rayTrace.fNumber`, `.effectiveFocalLength`, `.effectiveFNumber` | mm; 0.5/NA |
//! | `rayTrace.maxfov`, `.fov` | half the field of the diagonal, degrees |
//! | `rayTrace.geometry.function` | REAL image heights, mm, heights × wavelengths |
//! | `rayTrace.relIllum.function` | relative illumination, heights × wavelengths |
//! | `rayTrace.psf.function` | N × N × heights × wavelengths, N even, each of sum 1 |
//! | `rayTrace.psf.sampleSpacing` | mm, of x and y |
//! | `.fieldHeight`, `.wavelength` of all three | IDEAL heights, mm, from 0 in equal steps; nm |
//!
//! PSFs are those of a field point on +x (to the right), rows down, as ISETCam rotates them; the chief ray is on sample N/2 (from 1), where its
//! support is 0. A sample is the light in the square of one spacing about it.
//! Source: fields as ISETCam's `rtImportData`, `opticsGet`, `rtPrecomputePSF` and `rtPrecomputePSFApply` read them.

use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use crate::durable::{AtomicFile, DurableError};
use crate::mat::{MatValue, file};

/// Object distance of an object at infinity, mm.
const INFINITE_MM: f64 = 1e10;

/// Optics for the ray-trace model. Tables are heights after heights, of one wavelength after another.
#[derive(Debug)]
pub struct RayTraceOptics {
    /// Name of the lens.
    pub name: String,
    /// Primary wavelength, nm.
    pub reference_nm: f64,
    /// Object distance, mm; none: infinity.
    pub object_distance_mm: Option<f64>,
    /// Magnification.
    pub magnification: f64,
    /// Image-space F-number.
    pub f_number: f64,
    /// 0.5/NA.
    pub effective_f_number: f64,
    /// Effective focal length, mm.
    pub focal_length_mm: f64,
    /// Half the field, degrees.
    pub half_field_deg: f64,
    /// IDEAL heights, mm.
    pub field_height_mm: Vec<f64>,
    /// Wavelengths, nm.
    pub wavelengths_nm: Vec<f64>,
    /// REAL heights, mm.
    pub image_height_mm: Vec<f64>,
    /// Relative illumination.
    pub relative_illumination: Vec<f64>,
    /// Samples a side of a PSF, even.
    pub psf_side: usize,
    /// Spacing of the samples, mm.
    pub spacing_mm: f64,
    /// PSFs, rows fastest.
    pub psfs: Vec<f32>,
}

/// Optics could not be written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum IsetError {
    /// Storage.
    #[error(transparent)]
    Storage(#[from] DurableError),
    /// What was read again is not what was written.
    #[error("{path}: the bytes read again differ from those written; the disk or its driver is faulty, and nothing was kept", path = path.display())]
    Differs {
        /// The file.
        path: PathBuf,
    },
}

fn texts(text: &str) -> MatValue {
    MatValue::Text(text.to_owned())
}

impl RayTraceOptics {
    fn table(&self, values: Vec<f64>) -> MatValue {
        MatValue::Numbers { shape: vec![self.field_height_mm.len(), self.wavelengths_nm.len()], values }
    }

    /// `function`, what else belongs to it, and the axes.
    fn of_heights(&self, function: MatValue, more: Vec<(&'static str, MatValue)>) -> MatValue {
        let axes = [
            ("fieldHeight", MatValue::column(&self.field_height_mm)),
            ("wavelength", MatValue::column(&self.wavelengths_nm)),
        ];
        MatValue::Struct([("function", function)].into_iter().chain(axes).chain(more).collect())
    }

    /// The struct `optics`.
    fn into_value(mut self) -> MatValue {
        let number = MatValue::number;
        let spacing = MatValue::Numbers { shape: vec![1, 2], values: vec![self.spacing_mm; 2] };
        let (heights, bands) = (self.field_height_mm.len(), self.wavelengths_nm.len());
        let psfs = MatValue::Floats {
            shape: vec![self.psf_side, self.psf_side, heights, bands],
            values: std::mem::take(&mut self.psfs),
        };
        let distance_mm = self.object_distance_mm.unwrap_or(INFINITE_MM);
        let magnification = match self.object_distance_mm {
            Some(_) => self.magnification.abs(),
            None => self.focal_length_mm / INFINITE_MM,
        };
        let ray_trace = MatValue::Struct(vec![
            ("name", texts(&self.name)),
            ("program", texts("lenscube")),
            ("lensFile", texts(&self.name)),
            ("referenceWavelength", number(self.reference_nm)),
            ("objectDistance", number(distance_mm)),
            ("mag", number(-magnification)),
            ("fNumber", number(self.f_number)),
            ("effectiveFocalLength", number(self.focal_length_mm)),
            ("effectiveFNumber", number(self.effective_f_number)),
            ("maxfov", number(self.half_field_deg)),
            ("fov", number(self.half_field_deg)),
            ("geometry", self.of_heights(self.table(self.image_height_mm.clone()), Vec::new())),
            ("relIllum", self.of_heights(self.table(self.relative_illumination.clone()), Vec::new())),
            ("psf", self.of_heights(psfs, vec![("sampleSpacing", spacing)])),
        ]);
        let transmittance = MatValue::Struct(vec![
            ("wave", MatValue::column(&self.wavelengths_nm)),
            ("scale", MatValue::column(&vec![1.0; bands])),
        ]);
        MatValue::Struct(vec![
            ("type", texts("optics")),
            ("name", texts(&self.name)),
            ("model", texts("raytrace")),
            ("fNumber", number(self.f_number)),
            ("focalLength", number(1e-3 * self.focal_length_mm)),
            ("offaxis", texts("skip")),
            ("vignetting", number(0.0)),
            ("transmittance", transmittance),
            ("rayTrace", ray_trace),
        ])
    }

    /// Writes the file `path`, which gets its name when it has been read again.
    ///
    /// # Errors
    /// [`IsetError`].
    pub fn write(self, path: &Path) -> Result<(), IsetError> {
        let value = self.into_value();
        let out = AtomicFile::create(path)?;
        let failed = |e| DurableError::io("write", path, 0, e);
        let digest = {
            let mut written = Hashed { out: BufWriter::new(out.writer()), digest: blake3::Hasher::new() };
            file(&mut written, "optics", &value).and_then(|()| written.flush()).map_err(failed)?;
            written.digest.finalize()
        };
        match out.reads_as(digest)? {
            true => Ok(out.finish()?),
            false => Err(IsetError::Differs { path: path.into() }),
        }
    }
}

/// A writer and the digest of what it wrote.
struct Hashed<W> {
    out: W,
    digest: blake3::Hasher,
}

impl<W: Write> Write for Hashed<W> {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.out.write_all(bytes)?;
        self.digest.update(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.out.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn optics_have_the_fields_of_the_ray_trace_model() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("optics.mat");
        let optics = RayTraceOptics {
            name: "Lens µ".into(),
            reference_nm: 550.0,
            object_distance_mm: None,
            magnification: 0.0,
            f_number: 2.8,
            effective_f_number: 2.9,
            focal_length_mm: 5.0,
            half_field_deg: 20.0,
            field_height_mm: vec![0.0, 1.0, 2.0],
            wavelengths_nm: vec![500.0, 600.0],
            image_height_mm: vec![0.0, 0.99, 1.95, 0.0, 0.98, 1.94],
            relative_illumination: vec![1.0, 0.9, 0.8, 1.0, 0.89, 0.79],
            psf_side: 4,
            spacing_mm: 2.5e-4,
            psfs: vec![1.0 / 16.0; 96],
        };
        optics.write(&path).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        for field in
            ["optics", "rayTrace", "sampleSpacing", "effectiveFNumber", "maxfov", "relIllum", "fieldHeight"]
        {
            assert!(bytes.windows(field.len()).any(|w| w == field.as_bytes()), "{field}");
        }
        let size = u32::from_le_bytes(*bytes[132..].first_chunk().unwrap()) as usize;
        assert_eq!(size + 136, bytes.len());
    }
}
