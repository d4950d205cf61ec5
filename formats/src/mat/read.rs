//! Reader: the arrays of a file and where their samples are. Numbers up to [`MAX_VALUES`] and short texts are read, others are left where they are.
//!
//! Sizes that elements declare are compared with those that hold them before memory is allocated. A compressed variable is read as a stream, which holds at most
//! 1032 times its bytes.

use std::fs::File;
use std::io::{self, BufReader, ErrorKind, Read, Seek, SeekFrom, Take};

use flate2::read::ZlibDecoder;

use super::{HEADER, INT8, INT32, MATRIX, STRUCT_CLASS, UINT32};

const COMPRESSED: u32 = 15;
/// Classes of numbers: double to unsigned integers of 64 bits.
const NUMBERS: std::ops::RangeInclusive<u32> = 6..=15;
/// Flag of complex numbers.
const COMPLEX: u32 = 0x800;
/// Numbers of an array that are read when the file is opened.
pub(crate) const MAX_VALUES: usize = 1 << 16;
const MAX_DIMENSIONS: usize = 8;
const MAX_NAME: usize = 256;
const MAX_FIELDS: usize = 1000;
const MAX_ARRAYS: usize = 1000;
const MAX_DEPTH: usize = 6;

/// Numbers as they are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Number {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
    I64,
    U64,
}

impl Number {
    fn of(kind: u32) -> Option<Self> {
        Some(match kind {
            1 => Self::I8,
            2 => Self::U8,
            3 => Self::I16,
            4 => Self::U16,
            5 => Self::I32,
            6 => Self::U32,
            7 => Self::F32,
            9 => Self::F64,
            12 => Self::I64,
            13 => Self::U64,
            _ => return None,
        })
    }

    pub(crate) fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 | Self::I64 | Self::U64 => 8,
        }
    }

    /// Number `k` of `bytes`.
    pub(crate) fn read(self, bytes: &[u8], k: usize, is_big_endian: bool) -> f64 {
        let mut own = [0; 8];
        let n = self.bytes();
        own[..n].copy_from_slice(&bytes[k * n..][..n]);
        if is_big_endian {
            own[..n].reverse();
        }
        let (low, half, word) = (own[0], [own[0], own[1]], [own[0], own[1], own[2], own[3]]);
        match self {
            Self::I8 => f64::from(low.cast_signed()),
            Self::U8 => f64::from(low),
            Self::I16 => f64::from(i16::from_le_bytes(half)),
            Self::U16 => f64::from(u16::from_le_bytes(half)),
            Self::I32 => f64::from(i32::from_le_bytes(word)),
            Self::U32 => f64::from(u32::from_le_bytes(word)),
            Self::F32 => f64::from(f32::from_le_bytes(word)),
            Self::F64 => f64::from_le_bytes(own),
            Self::I64 => i64::from_le_bytes(own) as f64,
            Self::U64 => u64::from_le_bytes(own) as f64,
        }
    }
}

/// A variable: the place of its element in the file.
#[derive(Clone, Copy, Debug)]
struct Variable {
    at: u64,
    bytes: u64,
    is_compressed: bool,
}

/// An array of numbers.
#[derive(Clone, Debug)]
pub(crate) struct MatArray {
    /// Names of the structs that hold it and its own, as `basis/wave`.
    pub(crate) path: String,
    /// Two or more; the first is the fastest.
    pub(crate) shape: Vec<usize>,
    pub(crate) number: Number,
    /// Its numbers, if there are few.
    pub(crate) values: Option<Vec<f64>>,
    variable: Variable,
    /// Place of its samples in the stream of the variable.
    at: u64,
}

/// A file whose arrays are known.
#[derive(Debug)]
pub(crate) struct MatFile {
    pub(crate) is_big_endian: bool,
    pub(crate) arrays: Vec<MatArray>,
}

/// What is wrong with a file, or an error of reading it.
#[derive(Debug)]
pub(crate) enum MatError {
    Io(io::Error),
    Invalid(String),
}

impl From<io::Error> for MatError {
    fn from(error: io::Error) -> Self {
        match error.kind() {
            ErrorKind::UnexpectedEof => {
                Self::Invalid("it ends before its last element; is the copy complete?".into())
            }
            // Those of the decoder.
            ErrorKind::InvalidInput | ErrorKind::InvalidData => {
                Self::Invalid(format!("a damaged zlib stream: {error}"))
            }
            _ => Self::Io(error),
        }
    }
}

fn invalid(problem: impl Into<String>) -> MatError {
    MatError::Invalid(problem.into())
}

impl Variable {
    /// The stream of its array, of which the first element is its tag.
    fn stream(self, file: &File) -> io::Result<Stream<'_>> {
        let mut file = file;
        file.seek(SeekFrom::Start(self.at))?;
        let bytes = BufReader::with_capacity(1 << 16, file).take(self.bytes);
        let of =
            if self.is_compressed { Source::Zlib(ZlibDecoder::new(bytes)) } else { Source::Plain(bytes) };
        Ok(Stream { of, position: 0 })
    }
}

enum Source<'a> {
    Plain(Take<BufReader<&'a File>>),
    Zlib(ZlibDecoder<Take<BufReader<&'a File>>>),
}

/// A variable as it is read.
pub(crate) struct Stream<'a> {
    of: Source<'a>,
    position: u64,
}

impl Read for Stream<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let n = match &mut self.of {
            Source::Plain(reader) => reader.read(buffer),
            Source::Zlib(reader) => reader.read(buffer),
        }?;
        self.position += n as u64;
        Ok(n)
    }
}

impl Stream<'_> {
    /// Skips `bytes`.
    pub(crate) fn skip(&mut self, bytes: u64) -> io::Result<()> {
        match io::copy(&mut self.by_ref().take(bytes), &mut io::sink())? == bytes {
            true => Ok(()),
            false => Err(ErrorKind::UnexpectedEof.into()),
        }
    }
}

/// An element: its kind, the bytes of its data, and those with padding.
#[derive(Clone, Copy)]
struct Element {
    kind: u32,
    bytes: u64,
    padded: u64,
}

/// Elements of a variable.
struct Walk<'a, 'b> {
    stream: &'b mut Stream<'a>,
    variable: Variable,
    is_big_endian: bool,
    arrays: &'b mut Vec<MatArray>,
}

impl Walk<'_, '_> {
    fn word(&self, bytes: [u8; 4]) -> u32 {
        if self.is_big_endian { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) }
    }

    /// The next element, which ends within `end`; of a small one the data follow as of any other.
    fn element(&mut self, end: u64) -> Result<Element, MatError> {
        let mut tag = [0; 4];
        self.stream.read_exact(&mut tag)?;
        let first = self.word(tag);
        let element = match (first & 0xffff, first >> 16) {
            (kind, 0) => {
                self.stream.read_exact(&mut tag)?;
                let bytes = u64::from(self.word(tag));
                Element { kind, bytes, padded: bytes.next_multiple_of(8) }
            }
            (kind, bytes @ 1..=4) => Element { kind, bytes: u64::from(bytes), padded: 4 },
            (kind, bytes) => {
                return Err(invalid(format!("a small element of type {kind} has {bytes} bytes")));
            }
        };
        match self.stream.position.saturating_add(element.bytes) <= end {
            true => Ok(element),
            false => {
                Err(invalid(format!("an element of {} bytes is larger than what holds it", element.bytes)))
            }
        }
    }

    /// The data of an element of `kind` with at most `max` bytes.
    fn data(&mut self, end: u64, kind: u32, max: usize) -> Result<Vec<u8>, MatError> {
        let element = self.element(end)?;
        if element.kind != kind || element.bytes > max as u64 {
            return Err(invalid(format!(
                "an element of type {} and {} bytes, expected type {kind} and at most {max}",
                element.kind, element.bytes
            )));
        }
        let mut data = vec![0; element.bytes as usize];
        self.stream.read_exact(&mut data)?;
        self.skip_to(self.stream.position - element.bytes + element.padded, end)?;
        Ok(data)
    }

    /// Skips up to `position`, or `end` if that is before.
    fn skip_to(&mut self, position: u64, end: u64) -> Result<(), MatError> {
        Ok(self.stream.skip(position.min(end).saturating_sub(self.stream.position))?)
    }

    /// An array of `bytes` from here, in the struct `outer` as its field `field`.
    fn array(&mut self, bytes: u64, outer: &str, field: Option<&str>, depth: usize) -> Result<(), MatError> {
        let end = self.stream.position.saturating_add(bytes);
        // A field without a value.
        if bytes == 0 {
            return Ok(());
        }
        let flags = self.data(end, UINT32, 8)?;
        let flags = self.word(*flags.first_chunk().ok_or_else(|| invalid("flags of no array"))?);
        let class = flags & 0xff;
        let shape = self.data(end, INT32, 4 * MAX_DIMENSIONS)?;
        let shape: Vec<usize> = shape.as_chunks::<4>().0.iter().map(|b| self.word(*b) as usize).collect();
        let count = shape.iter().try_fold(1usize, |product, n| product.checked_mul(*n));
        let count =
            count.filter(|_| shape.len() >= 2).ok_or_else(|| invalid(format!("dimensions {shape:?}")))?;
        let name = self.data(end, INT8, MAX_NAME)?;
        let name = field.map_or_else(|| String::from_utf8_lossy(&name).into_owned(), str::to_owned);
        let path = if outer.is_empty() { name } else { format!("{outer}/{name}") };
        match class {
            STRUCT_CLASS if count == 1 && depth < MAX_DEPTH => self.fields(end, &path, depth)?,
            class if NUMBERS.contains(&class) && flags & COMPLEX == 0 => {
                self.numbers(end, path, shape, count)?
            }
            // Texts, cells, sparse and complex numbers, objects.
            _ => (),
        }
        // What is large is not skipped where nothing is behind it.
        if depth == 0 { Ok(()) } else { self.skip_to(end, end) }
    }

    fn fields(&mut self, end: u64, path: &str, depth: usize) -> Result<(), MatError> {
        let length = self.data(end, INT32, 4)?;
        let length = length.first_chunk().map_or(0, |b| self.word(*b)) as usize;
        if !(1..=MAX_NAME).contains(&length) {
            return Err(invalid(format!("names of fields of {length} bytes")));
        }
        let names = self.data(end, INT8, MAX_FIELDS * length)?;
        for name in names.chunks_exact(length) {
            let name = name.split(|b| *b == 0).next().unwrap_or_default();
            let element = self.element(end)?;
            if element.kind != MATRIX {
                return Err(invalid(format!("a field that is an element of type {}", element.kind)));
            }
            self.array(element.bytes, path, Some(&String::from_utf8_lossy(name)), depth + 1)?;
        }
        Ok(())
    }

    fn numbers(&mut self, end: u64, path: String, shape: Vec<usize>, count: usize) -> Result<(), MatError> {
        if self.arrays.len() == MAX_ARRAYS {
            return Err(invalid(format!("more than {MAX_ARRAYS} arrays")));
        }
        let element = self.element(end)?;
        let number =
            Number::of(element.kind).ok_or_else(|| invalid(format!("numbers of type {}", element.kind)))?;
        let expected = (count as u64).checked_mul(number.bytes() as u64);
        if expected != Some(element.bytes) {
            return Err(invalid(format!("array {path} {shape:?} has {} bytes of {number:?}", element.bytes)));
        }
        let at = self.stream.position;
        let values = match count <= MAX_VALUES {
            false => None,
            true => {
                let mut data = vec![0; element.bytes as usize];
                self.stream.read_exact(&mut data)?;
                Some((0..count).map(|k| number.read(&data, k, self.is_big_endian)).collect())
            }
        };
        self.arrays.push(MatArray { path, shape, number, values, variable: self.variable, at });
        Ok(())
    }
}

impl MatFile {
    /// Reads the arrays of `file`, of `length` bytes.
    ///
    /// # Errors
    /// It is no MAT-file of level 5, or a damaged one.
    pub(crate) fn open(file: &File, length: u64) -> Result<Self, MatError> {
        let mut head = [0; HEADER];
        let mut reader = file;
        reader.seek(SeekFrom::Start(0))?;
        reader.read_exact(&mut head)?;
        let is_big_endian = match &head[126..] {
            b"IM" => false,
            b"MI" => true,
            _ => return Err(invalid("no order of bytes (IM or MI) in its header")),
        };
        let word = |b: [u8; 4]| if is_big_endian { u32::from_be_bytes(b) } else { u32::from_le_bytes(b) };
        let (mut at, mut arrays) = (HEADER as u64, Vec::new());
        while at < length {
            let mut tag = [0; 8];
            reader.seek(SeekFrom::Start(at))?;
            reader.read_exact(&mut tag)?;
            let [kind, bytes] = [0, 4].map(|k| word([tag[k], tag[k + 1], tag[k + 2], tag[k + 3]]));
            let own = Variable { at: at + 8, bytes: u64::from(bytes), is_compressed: kind == COMPRESSED };
            if own.at + own.bytes > length {
                return Err(invalid(format!(
                    "a variable of {bytes} bytes ends beyond the file; is the copy complete?"
                )));
            }
            if kind == MATRIX || own.is_compressed {
                let mut stream = own.stream(file)?;
                let mut walk =
                    Walk { stream: &mut stream, variable: own, is_big_endian, arrays: &mut arrays };
                let bytes = match own.is_compressed {
                    false => own.bytes,
                    true => {
                        let inner = walk.element(u64::MAX)?;
                        if inner.kind != MATRIX {
                            return Err(invalid(format!("a compressed element of type {}", inner.kind)));
                        }
                        inner.bytes
                    }
                };
                walk.array(bytes, "", None, 0)?;
            }
            at = own.at + if own.is_compressed { own.bytes } else { own.bytes.next_multiple_of(8) };
        }
        Ok(Self { is_big_endian, arrays })
    }

    /// The array at `path`.
    pub(crate) fn array(&self, path: &str) -> Option<&MatArray> {
        self.arrays.iter().find(|array| array.path == path)
    }
}

impl MatArray {
    /// Its samples as they are stored, from the first one on.
    ///
    /// # Errors
    /// They cannot be read.
    pub(crate) fn samples<'a>(&self, file: &'a File) -> Result<Stream<'a>, MatError> {
        let mut stream = self.variable.stream(file)?;
        stream.skip(self.at)?;
        Ok(stream)
    }
}
