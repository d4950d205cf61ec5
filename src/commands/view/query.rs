//! Query parameters of a request; every number is checked against its bounds.

use super::error::HttpError;
use super::image_pyramid::{ImagePyramid, Mode};
use axum::extract::rejection::QueryRejection;
use axum::extract::{self, FromRequestParts};
use axum::http::request::Parts;
use formats::picture::tone::Tone;
use pipeline::colour::Illuminant;
use pipeline::geometry::{Rect, Size};
use std::collections::HashMap;

/// Maximum number of pixels of a crop.
const MAX_CROP_PX: usize = 1 << 24;
/// Maximum number of pixels along one side of a crop.
const MAX_CROP_SIDE_PX: usize = 1 << 14;

/// Parameters after the `?` of an address.
pub struct Query(HashMap<String, String>);

impl<S: Send + Sync> FromRequestParts<S> for Query {
    type Rejection = QueryRejection;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, QueryRejection> {
        Ok(Self(extract::Query::from_request_parts(parts, state).await?.0))
    }
}

impl Query {
    fn value(&self, key: &str) -> Option<&str> {
        self.0.get(key).map(String::as_str)
    }

    /// Integer from 0 to `end` - 1.
    fn below(&self, key: &str, end: usize) -> Result<usize, HttpError> {
        let number = self.value(key).and_then(parse_digits).filter(|n| *n < end);
        let message = || format!("{key}: expected an integer from 0 to {}", end.saturating_sub(1));
        number.ok_or_else(|| HttpError::bad_request(message()))
    }

    fn within(&self, key: &str, min: f64, max: f64) -> Result<f64, HttpError> {
        let number = self.value(key).and_then(|t| t.parse::<f64>().ok());
        let number = number.filter(|v| (min..=max).contains(v));
        number.ok_or_else(|| {
            HttpError::bad_request(format!("{key}: expected a number from {min:e} to {max:e}"))
        })
    }

    /// `image`, `film` by default.
    pub fn image(&self) -> &str {
        self.value("image").unwrap_or("film")
    }

    /// `band=3`, or all bands as colours with the white `white=D65`. Of a raw: `frame=0`, and `mosaic=1` or the white of its development.
    pub fn mode(&self, pyramid: &ImagePyramid) -> Result<Mode, HttpError> {
        let frame = match pyramid.mosaic {
            None => None,
            Some(_) => Some(self.below("frame", pyramid.wavelengths_nm.len())?),
        };
        if let (Some(frame), true) = (frame, self.is_set("mosaic")) {
            return Ok(Mode::Band(frame));
        }
        if frame.is_none() && self.value("band").is_some() {
            return Ok(Mode::Band(self.band(pyramid)?));
        }
        if pyramid.mosaic.as_ref().is_some_and(|mosaic| !mosaic.is_developable()) {
            return Err(HttpError::not_found("the raw cannot be developed; add mosaic=1"));
        }
        let light: Result<Illuminant, String> = self.value("white").unwrap_or("D65").parse();
        let light = light.map_err(|e| HttpError::bad_request(format!("white: {e}")))?;
        Ok(frame.map_or(Mode::Colour(light), |frame| Mode::Developed(frame, light)))
    }

    /// `band`.
    pub fn band(&self, pyramid: &ImagePyramid) -> Result<usize, HttpError> {
        self.below("band", pyramid.wavelengths_nm.len())
    }

    /// `exposure` and `gamma`.
    pub fn tone(&self) -> Result<Tone, HttpError> {
        Ok(Tone { exposure: self.within("exposure", 1e-30, 1e30)?, gamma: self.within("gamma", 0.2, 5.0)? })
    }

    /// `y` and `x`: (row, column) of a pixel of an image of this size.
    pub fn pixel(&self, size: Size) -> Result<(usize, usize), HttpError> {
        Ok((self.below("y", size.height)?, self.below("x", size.width)?))
    }

    /// `x`, `y`, `w`, `h`: rectangle in an image of this size.
    pub fn crop(&self, size: Size) -> Result<Rect, HttpError> {
        let (y, x) = self.pixel(size)?;
        let (height, width) = (self.below("h", size.height - y + 1)?, self.below("w", size.width - x + 1)?);
        if height * width == 0 || height * width > MAX_CROP_PX || height.max(width) > MAX_CROP_SIDE_PX {
            return Err(HttpError::bad_request(format!(
                "a crop must have 1 to {MAX_CROP_PX} pixels and sides of at most {MAX_CROP_SIDE_PX} px, not {width} x {height}; use \
                 `lenscube export` for larger pictures"
            )));
        }
        Ok(Rect::new(y as i64, x as i64, height, width))
    }

    /// Whether `key` is `1`.
    pub fn is_set(&self, key: &str) -> bool {
        self.value(key).is_some_and(|v| v == "1")
    }
}

/// Level and (row, column) of a tile `ROW_COLUMN.png`.
pub fn tile(level: &str, name: &str, pyramid: &ImagePyramid) -> Result<(usize, (usize, usize)), HttpError> {
    let none = || HttpError::not_found("no such tile");
    let (row, column) = name.strip_suffix(".png").and_then(|n| n.split_once('_')).ok_or_else(none)?;
    let parsed = (parse_digits(level), parse_digits(row), parse_digits(column));
    let (Some(level), Some(row), Some(column)) = parsed else { return Err(none()) };
    pyramid.tile_rect(level, (row, column)).map(|_| (level, (row, column))).ok_or_else(none)
}

/// Number of 1 to 9 decimal digits.
fn parse_digits(text: &str) -> Option<usize> {
    let valid = (1..=9).contains(&text.len()) && text.bytes().all(|b| b.is_ascii_digit());
    valid.then(|| text.parse().ok()).flatten()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_1_to_9_decimal_parse_digits() {
        assert_eq!((parse_digits("0"), parse_digits("123456789")), (Some(0), Some(123_456_789)));
        for bad in ["", "-1", "+1", " 1", "1e3", "1234567890", "0x1", "٣"] {
            assert_eq!(parse_digits(bad), None, "{bad}");
        }
    }

    #[test]
    fn crop_and_tone_out_of_bounds_are_rejected() {
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
