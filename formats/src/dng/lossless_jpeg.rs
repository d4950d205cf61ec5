//! Lossless JPEG: Huffman-coded differences to a prediction from neighbours of the same component.
//!
//! ```text
//! x = P(a, b, c) + d mod 2^16,   a left, b above, c above left
//! P: 1 a, 2 b, 3 c, 4 a + b − c, 5 a + (b − c)/2, 6 b + (a − c)/2, 7 (a + b)/2
//! ```
//! In the first row P is a, in the first column b, for the first sample (and after a restart) 2^(precision − 1 − point transform). A difference is a
//! Huffman code of its number of bits n ≤ 16, then n bits; those below 2^(n−1) stand for negative numbers; n = 16 has no bits and is 32768.
//! Source: ITU-T T.81 (1992) | ISO/IEC 10918-1, annex H; for raws, Digital Negative Specification 1.4, chapter 3.
//! Not included: components of different sampling, several scans, arithmetic coding.

/// Components that are coded together, at most.
const MAX_COMPONENTS: usize = 4;

/// What a stream declares of its samples.
#[derive(Clone, Debug, Default)]
struct Frame {
    rows: usize,
    columns: usize,
    precision: u32,
    /// Names of the components.
    names: Vec<u8>,
}

/// A Huffman table: (bits of the code, bits of the difference) by the next 16 bits; 0 bits: no code.
type Codes = Vec<(u8, u8)>;

/// Decodes a stream of `count` samples, components side by side.
///
/// # Errors
/// What is wrong with the stream, or why it is no lossless one.
pub(super) fn decode(data: &[u8], count: usize) -> Result<Vec<u16>, Problem> {
    let mut frame = Frame::default();
    let mut tables: [Option<Codes>; 4] = Default::default();
    let mut restart = 0;
    if !data.starts_with(&[0xFF, 0xD8]) {
        return Err(Problem::damaged("it does not begin as a JPEG"));
    }
    let mut at = 2;
    loop {
        // A marker may follow any number of fill bytes.
        let marker = loop {
            match data.get(at..at + 2) {
                Some([0xFF, 0xFF]) => at += 1,
                Some([0xFF, marker]) => break *marker,
                _ => return Err(Problem::damaged("a marker is missing")),
            }
        };
        let segment = data.get(at + 2..at + 4).map(|b| usize::from(b[0]) << 8 | usize::from(b[1]));
        let segment = segment.and_then(|bytes| data.get(at + 4..at + 2 + bytes.max(2)));
        let segment = segment.ok_or(Problem::damaged("a segment is cut off"))?;
        at += 4 + segment.len();
        match marker {
            0xC3 => frame = start_of_frame(segment, count)?,
            0xC0..=0xC2 | 0xC5..=0xC7 | 0xC9..=0xCB | 0xCD..=0xCF => return Err(Problem::Lossy),
            0xC4 => huffman(segment, &mut tables)?,
            0xDD => match segment {
                [high, low] => restart = usize::from(*high) << 8 | usize::from(*low),
                _ => return Err(Problem::damaged("its restart interval")),
            },
            0xDA => return scan(&data[at..], segment, &frame, &tables, restart),
            0xD9 => return Err(Problem::damaged("it has no scan")),
            _ => {}
        }
    }
}

/// Why a stream does not decode.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Problem {
    /// It is another JPEG.
    Lossy,
    /// It is damaged.
    Damaged(&'static str),
}

impl Problem {
    const fn damaged(what: &'static str) -> Self {
        Self::Damaged(what)
    }
}

fn start_of_frame(segment: &[u8], count: usize) -> Result<Frame, Problem> {
    let wrong = Problem::damaged("its frame header");
    let [precision, y0, y1, x0, x1, n, components @ ..] = segment else { return Err(wrong) };
    let (rows, columns) =
        (usize::from(*y0) << 8 | usize::from(*y1), usize::from(*x0) << 8 | usize::from(*x1));
    let n = usize::from(*n);
    if !(2..=16).contains(precision) || !(1..=MAX_COMPONENTS).contains(&n) || components.len() != 3 * n {
        return Err(wrong);
    }
    if rows * columns * n != count {
        return Err(Problem::damaged("it has another size than its strip or tile"));
    }
    let names: Vec<u8> = components.chunks_exact(3).map(|c| c[0]).collect();
    if components.chunks_exact(3).any(|c| c[1] != 0x11) {
        return Err(Problem::damaged("its components have different sizes"));
    }
    Ok(Frame { rows, columns, precision: u32::from(*precision), names })
}

/// Reads tables of codes: the numbers of codes of 1 to 16 bits, then their values in order.
fn huffman(mut segment: &[u8], tables: &mut [Option<Codes>; 4]) -> Result<(), Problem> {
    let wrong = Problem::damaged("its Huffman table");
    while let [head, rest @ ..] = segment {
        let (lengths, rest) = rest.split_at_checked(16).ok_or(wrong)?;
        let values = lengths.iter().map(|n| usize::from(*n)).sum::<usize>();
        let (values, rest) = rest.split_at_checked(values).ok_or(wrong)?;
        let table = tables.get_mut(usize::from(*head)).ok_or(wrong)?;
        let mut codes: Codes = Vec::with_capacity(1 << 16);
        let mut values = values.iter();
        for (bits, n) in std::iter::zip(1u8.., lengths) {
            for value in values.by_ref().take(usize::from(*n)) {
                if *value > 16 || codes.len() + (1 << (16 - bits)) > 1 << 16 {
                    return Err(wrong);
                }
                codes.extend(std::iter::repeat_n((bits, *value), 1 << (16 - bits)));
            }
        }
        codes.resize(1 << 16, (0, 0));
        *table = Some(codes);
        segment = rest;
    }
    Ok(())
}

/// Bits of a scan, without the zero bytes after those of all ones.
struct Bits<'a> {
    data: &'a [u8],
    at: usize,
    held: u64,
    count: u32,
    /// Bits beyond the end, read as 0.
    beyond: u32,
}

impl Bits<'_> {
    fn fill(&mut self) {
        while self.count <= 48 {
            let byte = match self.data.get(self.at..) {
                Some([0xFF, 0, ..]) => {
                    self.at += 2;
                    0xFF
                }
                // A marker ends the bits.
                Some([0xFF, ..] | []) | None => {
                    self.beyond += 8;
                    0
                }
                Some([byte, ..]) => {
                    self.at += 1;
                    *byte
                }
            };
            self.held = self.held << 8 | u64::from(byte);
            self.count += 8;
        }
    }

    /// A difference.
    fn difference(&mut self, codes: &Codes) -> Result<i32, Problem> {
        self.fill();
        let (length, bits) = codes[(self.held >> (self.count - 16)) as usize & 0xFFFF];
        if length == 0 {
            return Err(Problem::damaged("a code that its Huffman table does not have"));
        }
        self.count -= u32::from(length);
        let difference = match bits {
            0 => 0,
            16 => 32768,
            n => {
                let n = u32::from(n);
                self.count -= n;
                let value = (self.held >> self.count) as i32 & ((1 << n) - 1);
                if value < 1 << (n - 1) { value - (1 << n) + 1 } else { value }
            }
        };
        match self.count < self.beyond {
            true => Err(Problem::damaged("its samples are cut off")),
            false => Ok(difference),
        }
    }

    /// Continues behind the next restart marker.
    fn restart(&mut self) -> Result<(), Problem> {
        match self.data.get(self.at..) {
            Some([0xFF, 0xD0..=0xD7, ..]) => {
                *self = Bits { data: self.data, at: self.at + 2, held: 0, count: 0, beyond: 0 };
                Ok(())
            }
            _ => Err(Problem::damaged("a restart marker is missing")),
        }
    }
}

fn scan(
    data: &[u8],
    header: &[u8],
    frame: &Frame,
    tables: &[Option<Codes>; 4],
    restart: usize,
) -> Result<Vec<u16>, Problem> {
    let n = frame.names.len();
    let wrong = Problem::damaged("its scan header");
    let [count, rest @ ..] = header else { return Err(wrong) };
    if n == 0 || usize::from(*count) != n || rest.len() != 2 * n + 3 {
        return Err(wrong);
    }
    let (components, [predictor, _, transform]) = rest.split_at(2 * n) else { return Err(wrong) };
    let transform = u32::from(transform & 15);
    if !(1..=7).contains(predictor) || transform >= frame.precision {
        return Err(wrong);
    }
    let mut codes = Vec::new();
    for (component, name) in std::iter::zip(components.chunks_exact(2), &frame.names) {
        let table = tables.get(usize::from(component[1] >> 4)).and_then(Option::as_ref);
        codes.push(table.filter(|_| component[0] == *name).ok_or(wrong)?);
    }
    if !restart.is_multiple_of(frame.columns.max(1)) {
        return Err(Problem::damaged("its restarts are inside rows"));
    }
    let restart_rows = restart / frame.columns.max(1);
    let width = frame.columns * n;
    // A sample has a bit at least.
    if frame.rows * width > 8 * data.len() {
        return Err(Problem::damaged("its samples are cut off"));
    }
    let middle = 1i32 << (frame.precision - 1 - transform);
    let mut out = vec![0u16; frame.rows * width];
    let mut bits = Bits { data, at: 0, held: 0, count: 0, beyond: 0 };
    for y in 0..frame.rows {
        let is_first = y == 0 || restart_rows > 0 && y % restart_rows == 0;
        if is_first && y > 0 {
            bits.restart()?;
        }
        let (above, row) = out.split_at_mut(y * width);
        let above = if is_first { &[][..] } else { &above[(y - 1) * width..] };
        for i in 0..width {
            let predicted = match (i < n, above) {
                (true, []) => middle,
                (true, above) => i32::from(above[i]),
                (false, []) => i32::from(row[i - n]),
                (false, above) => {
                    let (a, b, c) = (i32::from(row[i - n]), i32::from(above[i]), i32::from(above[i - n]));
                    match predictor {
                        1 => a,
                        2 => b,
                        3 => c,
                        4 => a + b - c,
                        5 => a + ((b - c) >> 1),
                        6 => b + ((a - c) >> 1),
                        _ => (a + b) >> 1,
                    }
                }
            };
            row[i] = (predicted + bits.difference(codes[i % n])?) as u16;
        }
    }
    if transform > 0 {
        out.iter_mut().for_each(|v| *v <<= transform);
    }
    Ok(out)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// Writes samples as lossless JPEG: a code of 5 bits for each number of bits, which any decoder reads.
    pub(crate) fn encoded(
        samples: &[u16],
        (rows, columns, n): (usize, usize, usize),
        precision: u32,
        predictor: u8,
        restart_rows: usize,
    ) -> Vec<u8> {
        let short = |v: usize| [(v >> 8) as u8, v as u8];
        let mut out = vec![0xFF, 0xD8, 0xFF, 0xC4, 0, 19 + 17, 0, 0, 0, 0, 0, 17];
        out.extend([0; 11]);
        out.extend(0..17u8);
        out.extend([0xFF, 0xC3]);
        out.extend(short(8 + 3 * n));
        out.push(precision as u8);
        out.extend(short(rows));
        out.extend(short(columns));
        out.push(n as u8);
        (0..n as u8).for_each(|c| out.extend([c, 0x11, 0]));
        if restart_rows > 0 {
            out.extend([0xFF, 0xDD, 0, 4]);
            out.extend(short(restart_rows * columns));
        }
        out.extend([0xFF, 0xDA]);
        out.extend(short(6 + 2 * n));
        out.push(n as u8);
        (0..n as u8).for_each(|c| out.extend([c, 0]));
        out.extend([predictor, 0, 0]);
        let width = columns * n;
        let at = |y: usize, i: usize| i32::from(samples[y * width + i]);
        let mut bits: Vec<bool> = Vec::new();
        let flush = |bits: &mut Vec<bool>, out: &mut Vec<u8>| {
            while !bits.len().is_multiple_of(8) {
                bits.push(true);
            }
            for byte in bits.chunks(8) {
                let byte = byte.iter().fold(0u8, |v, b| v << 1 | u8::from(*b));
                out.push(byte);
                if byte == 0xFF {
                    out.push(0);
                }
            }
            bits.clear();
        };
        for y in 0..rows {
            let is_first = y == 0 || restart_rows > 0 && y % restart_rows == 0;
            if is_first && y > 0 {
                flush(&mut bits, &mut out);
                out.extend([0xFF, 0xD0 + ((y / restart_rows - 1) % 8) as u8]);
            }
            for i in 0..width {
                let p = match (i < n, is_first) {
                    (true, true) => 1 << (precision - 1),
                    (true, false) => at(y - 1, i),
                    (false, true) => at(y, i - n),
                    (false, false) => {
                        let (a, b, c) = (at(y, i - n), at(y - 1, i), at(y - 1, i - n));
                        [a, b, c, a + b - c, a + ((b - c) >> 1), b + ((a - c) >> 1), (a + b) >> 1]
                            [usize::from(predictor) - 1]
                    }
                };
                let d = (at(y, i) - p) as u16 as i16;
                let n_bits = if d == i16::MIN { 16 } else { 32 - i32::from(d).abs().leading_zeros() };
                let push = |bits: &mut Vec<bool>, v: i32, n: u32| {
                    (0..n).rev().for_each(|k| bits.push(v >> k & 1 == 1));
                };
                push(&mut bits, n_bits as i32, 5);
                if n_bits < 16 {
                    let d = i32::from(d);
                    push(&mut bits, if d < 0 { d - 1 } else { d }, n_bits);
                }
            }
        }
        flush(&mut bits, &mut out);
        out.extend([0xFF, 0xD9]);
        out
    }

    /// Samples of all differences.
    pub(crate) fn noise(count: usize, precision: u32) -> Vec<u16> {
        let mut state = 12345u64;
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as u16
        };
        (0..count).map(|_| (u32::from(next()) & ((1 << precision) - 1)) as u16).collect()
    }

    #[test]
    fn every_predictor_precision_number_of_components_and_restart_is_decoded() {
        for predictor in 1..=7 {
            for (precision, n, restart) in [(16, 1, 0), (14, 2, 0), (12, 2, 3), (8, 3, 1), (10, 4, 4)] {
                let (rows, columns) = (11, 13);
                let samples = noise(rows * columns * n, precision);
                let data = encoded(&samples, (rows, columns, n), precision, predictor, restart);
                assert_eq!(decode(&data, samples.len()), Ok(samples), "{predictor} {precision} {n}");
            }
        }
    }

    #[test]
    fn largest_difference_has_no_bits() {
        let samples = [0, 32768, 0, 65535, 32767];
        assert_eq!(decode(&encoded(&samples, (1, 5, 1), 16, 1, 0), 5), Ok(samples.to_vec()));
    }

    #[test]
    fn another_size_a_lossy_stream_and_missing_bits_are_errors() {
        let samples = noise(64, 12);
        let data = encoded(&samples, (8, 8, 1), 12, 1, 0);
        assert!(matches!(decode(&data, 63), Err(Problem::Damaged(_))));
        assert!(matches!(decode(&data[..data.len() - 20], 64), Err(Problem::Damaged(_))));
        let mut lossy = data;
        let at = lossy.windows(2).position(|w| w == [0xFF, 0xC3]).unwrap();
        lossy[at + 1] = 0xC0;
        assert_eq!(decode(&lossy, 64), Err(Problem::Lossy));
    }

    #[test]
    fn damaged_streams_never_panic() {
        let samples = noise(16 * 12 * 2, 14);
        let data = encoded(&samples, (16, 12, 2), 14, 6, 4);
        let mut refused = 0;
        for at in 0..data.len() {
            refused += usize::from(decode(&data[..at], samples.len()).is_err());
            for bit in [0x01, 0x10, 0x80, 0xFF] {
                let mut other = data.clone();
                other[at] ^= bit;
                if let Ok(found) = decode(&other, samples.len()) {
                    assert_eq!(found.len(), samples.len());
                }
            }
        }
        // Without the last marker or padding it is still whole.
        assert!(refused >= data.len() - 4, "{refused} of {}", data.len());
    }
}
