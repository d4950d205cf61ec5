//! Objects of a file by number; the bytes of its buffers, read when they are used first.

use std::cell::OnceCell;

use super::super::context::Context;
use super::super::error::MeshError;
use super::super::source::read_file;
use super::super::uri;
use super::json::{Buffer, Root};
use pipeline::scratch::List;

/// A parsed file.
pub(super) struct Document<'a> {
    pub(super) context: &'a Context<'a>,
    pub(super) json: Root<'a>,
    /// The buffer chunk of a `.glb`.
    binary: Option<&'a [u8]>,
    buffers: Vec<OnceCell<Bytes<'a>>>,
}

/// Bytes of a buffer.
enum Bytes<'a> {
    /// Of the file itself.
    Whole(&'a [u8]),
    /// Of another, or decoded.
    Own(List<u8>),
}

/// Bytes of a buffer view.
pub(super) struct View<'d> {
    pub(super) bytes: &'d [u8],
    /// Distance of the elements, if it is not their size.
    pub(super) stride: Option<u64>,
}

impl<'a> Document<'a> {
    pub(super) fn new(context: &'a Context<'a>, json: Root<'a>, binary: Option<&'a [u8]>) -> Self {
        let buffers = json.buffers.iter().map(|_| OnceCell::new()).collect();
        Self { context, json, binary, buffers }
    }

    /// The object of `list` with a number that `place` states, and the number as an index.
    ///
    /// # Errors
    /// There is none.
    pub(super) fn object<'d, T>(
        &self,
        list: &'d [T],
        number: u64,
        name: &str,
        place: &dyn Fn() -> String,
    ) -> Result<(usize, &'d T), MeshError> {
        let index = usize::try_from(number).ok();
        index.and_then(|index| Some((index, list.get(index)?))).ok_or_else(|| {
            let expected = format!("a number below {} ({name})", list.len());
            self.context.invalid(place(), expected, number.to_string())
        })
    }

    /// Bytes of the buffer view `number`, which `place` states.
    ///
    /// # Errors
    /// It is beyond its buffer, or the buffer cannot be read.
    pub(super) fn view(&self, number: u64, place: &dyn Fn() -> String) -> Result<View<'_>, MeshError> {
        let (index, view) = self.object(&self.json.buffer_views, number, "bufferViews", place)?;
        let here = || format!("bufferViews[{index}]");
        let (buffer, declared) = self.object(&self.json.buffers, view.buffer, "buffers", &here)?;
        let buffer = self.buffer(buffer, declared)?;
        let bytes = slice(buffer, view.byte_offset, view.byte_length).ok_or_else(|| {
            let found = format!(
                "bytes {} to {}",
                view.byte_offset,
                u128::from(view.byte_offset) + u128::from(view.byte_length)
            );
            self.context.invalid(here(), format!("bytes within the {} of its buffer", buffer.len()), found)
        })?;
        Ok(View { bytes, stride: view.byte_stride })
    }

    fn buffer(&self, index: usize, declared: &Buffer<'_>) -> Result<&[u8], MeshError> {
        let cell = &self.buffers[index];
        let bytes = match cell.get() {
            Some(bytes) => bytes,
            None => {
                let bytes = self.load(index)?;
                cell.get_or_init(|| bytes)
            }
        };
        let bytes = match bytes {
            Bytes::Whole(bytes) => bytes,
            Bytes::Own(bytes) => &bytes[..],
        };
        usize::try_from(declared.byte_length).ok().and_then(|length| bytes.get(..length)).ok_or_else(|| {
            let found = format!("{}; is the file truncated?", bytes.len());
            self.context.invalid(
                format!("buffers[{index}]"),
                format!("{} bytes", declared.byte_length),
                found,
            )
        })
    }

    fn load(&self, index: usize) -> Result<Bytes<'a>, MeshError> {
        let place = format!("buffers[{index}]");
        let Some(name) = self.json.buffers[index].uri.as_ref().map(|text| &*text.0) else {
            return match self.binary {
                Some(bytes) if index == 0 => Ok(Bytes::Whole(bytes)),
                _ => Err(self.context.invalid(place, "a uri, or the BIN chunk of a .glb", "none")),
            };
        };
        if uri::is_data(name) {
            return Ok(Bytes::Own(uri::decode_data(self.context, &place, name)?.into()));
        }
        let file = uri::find(self.context, &place, name)?;
        let Some(opened) = file.opened else {
            let way_out = "copy it there, or export the mesh as .glb";
            return Err(MeshError::Missing {
                path: self.context.path.into(),
                place,
                file: file.named,
                way_out,
            });
        };
        read_file(self.context, &file.named, &opened).map(Bytes::Own)
    }
}

/// `length` bytes from `offset` on; `None` beyond the end.
pub(super) fn slice(bytes: &[u8], offset: u64, length: u64) -> Option<&[u8]> {
    let end = usize::try_from(offset.checked_add(length)?).ok()?;
    bytes.get(usize::try_from(offset).ok()?..end)
}
