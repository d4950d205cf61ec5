//! What an address asks for, read with suspicion: every number has its bounds, and what is wrong is said.

use super::door::Refusal;
use super::stack::{Mode, Stack};
use formats::picture::tone::Tone;
use pipeline::colour::Illuminant;
use pipeline::geometry::{Rect, Size};
use std::collections::HashMap;

/// Maximum number of pixels of a crop.
const MAX_CROP_PX: usize = 1 << 24;
/// Maximum number of pixels along one side of a crop.
const MAX_CROP_SIDE_PX: usize = 1 << 14;

/// The part of an address after `?`.
pub struct Query(pub HashMap<String, String>);

impl Query {
    fn word(&self, key: &str) -> Option<&str> {
        self.0.get(key).map(String::as_str)
    }

    /// A whole number below `end`.
    fn below(&self, key: &str, end: usize) -> Result<usize, Refusal> {
        let number = self.word(key).and_then(whole).filter(|n| *n < end);
        number.ok_or_else(|| Refusal::bad(format!("{key}: expected a whole number below {end}")))
    }

    fn within(&self, key: &str, least: f64, most: f64) -> Result<f64, Refusal> {
        let number = self.word(key).and_then(|t| t.parse::<f64>().ok());
        let number = number.filter(|v| (least..=most).contains(v));
        number.ok_or_else(|| Refusal::bad(format!("{key}: expected a number from {least:e} to {most:e}")))
    }

    /// `band=3`, or colours under the light `white=D65`.
    pub fn mode(&self, stack: &Stack) -> Result<Mode, Refusal> {
        if self.word("band").is_some() {
            return Ok(Mode::Band(self.below("band", stack.wavelengths_nm.len())?));
        }
        let light: Result<Illuminant, String> = self.word("white").unwrap_or("D65").parse();
        Ok(Mode::Colour(light.map_err(|e| Refusal::bad(format!("white: {e}")))?))
    }

    /// A band of the film.
    pub fn band(&self, stack: &Stack) -> Result<usize, Refusal> {
        self.below("band", stack.wavelengths_nm.len())
    }

    /// `exposure` and `gamma`.
    pub fn tone(&self) -> Result<Tone, Refusal> {
        Ok(Tone { exposure: self.within("exposure", 1e-30, 1e30)?, gamma: self.within("gamma", 0.2, 5.0)? })
    }

    /// `x` and `y` of a pixel of an image of this size: (row, column).
    pub fn pixel(&self, size: Size) -> Result<(usize, usize), Refusal> {
        Ok((self.below("y", size.height)?, self.below("x", size.width)?))
    }

    /// `x`, `y`, `w`, `h` of a part of an image of this size.
    pub fn crop(&self, size: Size) -> Result<Rect, Refusal> {
        let (y, x) = self.pixel(size)?;
        let (height, width) = (self.below("h", size.height - y + 1)?, self.below("w", size.width - x + 1)?);
        if height * width == 0 || height * width > MAX_CROP_PX || height.max(width) > MAX_CROP_SIDE_PX {
            return Err(Refusal::bad(format!(
                "a crop has 1 to {MAX_CROP_PX} pixels and sides of at most {MAX_CROP_SIDE_PX}, not {height} x {width}; \
                 `lenscube export` makes larger pictures"
            )));
        }
        Ok(Rect::new(y as i64, x as i64, height, width))
    }

    /// Whether `key` is set.
    pub fn set(&self, key: &str) -> bool {
        self.word(key).is_some_and(|w| w == "1")
    }
}

/// `3_5.png`: tile row 3, column 5.
pub fn tile(level: &str, name: &str, stack: &Stack) -> Result<(usize, (usize, usize)), Refusal> {
    let none = || Refusal::missing("no such tile");
    let (row, column) = name.strip_suffix(".png").and_then(|n| n.split_once('_')).ok_or_else(none)?;
    let parsed = (whole(level), whole(row), whole(column));
    let (Some(level), Some(row), Some(column)) = parsed else { return Err(none()) };
    stack.tile_rect(level, (row, column)).map(|_| (level, (row, column))).ok_or_else(none)
}

/// Digits and nothing else, not too many.
fn whole(text: &str) -> Option<usize> {
    let digits = (1..=9).contains(&text.len()) && text.bytes().all(|b| b.is_ascii_digit());
    digits.then(|| text.parse().ok()).flatten()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_digits() {
        assert_eq!((whole("0"), whole("123456789")), (Some(0), Some(123_456_789)));
        for bad in ["", "-1", "+1", " 1", "1e3", "1234567890", "0x1", "٣"] {
            assert_eq!(whole(bad), None, "{bad}");
        }
    }

    #[test]
    fn absurd_wishes_are_refused() {
        let query = |text: &str| {
            let pairs = text.split('&').filter_map(|p| p.split_once('='));
            Query(pairs.map(|(k, v)| (k.to_owned(), v.to_owned())).collect())
        };
        let size = Size::new(20_000, 20_000);
        for bad in [
            "",
            "x=0&y=0&w=20001&h=1",
            "x=0&y=0&w=0&h=5",
            "x=1&y=1&w=20000&h=1",
            "x=0&y=0&w=20000&h=20000",
            "x=0&y=0&w=17000&h=1",
        ] {
            assert!(query(bad).crop(size).is_err(), "{bad}");
        }
        assert_eq!(query("x=1&y=2&w=4096&h=4096").crop(size).unwrap(), Rect::new(2, 1, 4096, 4096));
        for bad in [
            "exposure=nan&gamma=1",
            "exposure=-1&gamma=1",
            "exposure=inf&gamma=1",
            "exposure=1&gamma=0",
            "gamma=1",
        ] {
            assert!(query(bad).tone().is_err(), "{bad}");
        }
        assert_eq!(query("exposure=2&gamma=1.5").tone().unwrap(), Tone { exposure: 2.0, gamma: 1.5 });
    }
}
