//! Pupil functions of a band: a table of their segments and one of their values, a chunk each.

use super::LensPackWriter;
use crate::lens::error::LensPackError;
use pipeline::design::pupil_stack::{PupilStack, VALUE_ROWS};
use pipeline::lens::PsfSample;

impl LensPackWriter {
    /// Writes one band's pupil functions in place of its PSFs.
    ///
    /// # Errors
    /// The band was written before, or others have PSFs, or whole pupils where this one has half pupils; an error of the disk.
    pub fn pupils(&mut self, band: usize, stack: &PupilStack) -> Result<(), LensPackError> {
        let name = format!("pupil/{band}");
        if self.has_pupils && stack.is_whole() != self.has_whole_pupils {
            return Err(self.invalid(format!("{name}: some bands have whole pupils, others half ones")));
        }
        if !self.has_pupils && !self.written.is_empty() {
            return Err(self.invalid(format!("{name} after PSFs of other bands")));
        }
        (self.has_pupils, self.has_whole_pupils) = (true, stack.is_whole());
        self.record(
            &name,
            (band, None),
            (stack.size(), stack.pitch_um(), stack.heights(), PsfSample::Point),
        )?;
        match stack.is_whole() {
            false => self.pupil_parts(band, stack.parts()),
            true => self.pupil_parts(band, stack.whole_parts()),
        }
    }

    /// Writes the `N` numbers of every segment, and the values of all.
    fn pupil_parts<const N: usize>(
        &mut self,
        band: usize,
        (numbers, values): (Vec<[f64; N]>, Vec<f64>),
    ) -> Result<(), LensPackError> {
        let (name, segments) = (format!("pupil/{band}"), format!("pupil_segment/{band}"));
        let count = numbers.len();
        let shape = [count, N];
        let bytes: Vec<u8> = numbers.iter().flatten().flat_map(|v| v.to_ne_bytes()).collect();
        self.chunked_array((&segments, "float64"), (&shape, &shape), ("1", &["segment", "number"]), &bytes)?;
        let shape = [count, VALUE_ROWS, values.len() / (VALUE_ROWS * count)];
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_ne_bytes()).collect();
        let axes = ["segment", "quantity", "point"];
        self.chunked_array((&name, "float64"), (&shape, &shape), ("row 0: um", &axes), &bytes)
    }
}
