//! Pupil functions of a band: a table of their segments and one of their values, a chunk each.

use super::LensPackWriter;
use crate::lens::error::LensPackError;
use pipeline::design::pupil_stack::{PupilStack, SEGMENT_NUMBERS, VALUE_ROWS};
use pipeline::lens::PsfSample;

impl LensPackWriter {
    /// Writes one band's pupil functions in place of its PSFs.
    ///
    /// # Errors
    /// The band was written before, or others have PSFs; an error of the disk.
    pub fn pupils(&mut self, band: usize, stack: &PupilStack) -> Result<(), LensPackError> {
        let (name, segments) = (format!("pupil/{band}"), format!("pupil_segment/{band}"));
        if !self.has_pupils && !self.written.is_empty() {
            return Err(self.invalid(format!("{name} after PSFs of other bands")));
        }
        self.has_pupils = true;
        self.record(
            &name,
            (band, None),
            (stack.size(), stack.pitch_um(), stack.heights(), PsfSample::Point),
        )?;
        let (numbers, values) = stack.parts();
        let count = numbers.len();
        let shape = [count, SEGMENT_NUMBERS];
        let bytes: Vec<u8> = numbers.iter().flatten().flat_map(|v| v.to_ne_bytes()).collect();
        self.chunked_array((&segments, "float64"), (&shape, &shape), ("1", &["segment", "number"]), &bytes)?;
        let shape = [count, VALUE_ROWS, values.len() / (VALUE_ROWS * count)];
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_ne_bytes()).collect();
        let axes = ["segment", "quantity", "point"];
        self.chunked_array((&name, "float64"), (&shape, &shape), ("row 0: um", &axes), &bytes)
    }
}
