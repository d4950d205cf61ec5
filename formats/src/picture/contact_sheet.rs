//! A contact sheet: rows of a chart crop and a film crop side by side.
//!
//! Crops are shown at 100 % or enlarged by an integer without interpolation. The background is a neutral dark grey, which
//! does not bias the perception of colours.

use super::PictureError;
use super::figure::{Anchor, FONT, Figure, Text};
use super::image::Image;
use super::style::{Rgb, Style};
use super::text;
use pipeline::geometry::Size;

const BACKGROUND: Rgb = [38; 3];
/// Pixels around and between crops.
const MARGIN: usize = 16;
/// Height of a caption below its crop, and of the title, px.
const CAPTION: usize = 26;
const TITLE: usize = 34;
/// Font size of the title, px.
const TITLE_FONT: f64 = 20.0;

/// An image and its caption.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Crop {
    /// The image.
    pub image: Image,
    /// Text below the image.
    pub caption: String,
}

/// Places pairs (chart left, film right) below each other under a title; one pixel of the sheet is 1 px.
///
/// # Errors
/// There is no pair, or `enlarge` is 0.
pub fn contact_sheet(title: &str, pairs: &[[Crop; 2]], enlarge: usize) -> Result<Image, PictureError> {
    let bad = |setting, problem: &str| Err(PictureError::Setting { setting, problem: problem.into() });
    if pairs.is_empty() {
        return bad("pairs", "a contact sheet needs at least one pair of crops");
    }
    if enlarge == 0 {
        return bad("enlarge", "is 0; it must be at least 1");
    }
    let width_of = |text: &str, size: f64| text::width(text, size).ceil() as usize;
    let cell = |crop: &Crop| {
        let image = crop.image.size();
        Size::new(
            image.height * enlarge + CAPTION,
            (image.width * enlarge).max(width_of(&crop.caption, FONT)),
        )
    };
    let widths =
        [0, 1].map(|side| pairs.iter().map(|pair| cell(&pair[side]).width).max().unwrap_or_default());
    let heights = pairs.iter().map(|pair| cell(&pair[0]).height.max(cell(&pair[1]).height));
    let top = MARGIN + TITLE;
    let size = Size::new(
        top + heights.clone().map(|h| h + MARGIN).sum::<usize>(),
        (widths[0] + widths[1] + 3 * MARGIN).max(width_of(title, TITLE_FONT) + 2 * MARGIN),
    );
    let mut sheet = Figure::new(size, Style::Dark).with_background(BACKGROUND);
    let at = (MARGIN as f64, (MARGIN + TITLE / 2) as f64 - 4.0);
    sheet.text(Text { size: TITLE_FONT, ..Text::new(at, Anchor::Start, title) });
    let mut y = top;
    for (pair, height) in pairs.iter().zip(heights) {
        let mut x = MARGIN;
        for (crop, width) in pair.iter().zip(widths) {
            sheet.picture((x as f64, y as f64), &crop.image, enlarge);
            let below = (y + height - CAPTION / 2 + 2) as f64;
            sheet.text(Text::new((x as f64, below), Anchor::Start, &crop.caption));
            x += width + MARGIN;
        }
        y += height + MARGIN;
    }
    sheet.to_image(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn crop(size: Size, colour: Rgb, caption: &str) -> Crop {
        Crop { image: Image::new(size, colour), caption: caption.into() }
    }

    #[test]
    fn enlarged_pixels_are_squares_of_one_colour() {
        let mut left = crop(Size::new(20, 30), [200, 0, 0], "chart");
        left.image.row_mut(3)[4] = [1, 2, 3];
        let right = crop(Size::new(25, 30), [0, 0, 200], "film, λ = 550 nm: a caption wider than its crop");
        let sheet = contact_sheet("Title", &[[left.clone(), right.clone()], [left, right]], 3).unwrap();
        let count = |c: Rgb| sheet.pixels().iter().filter(|&&p| p == c).count();
        assert_eq!(count([1, 2, 3]), 2 * 9);
        assert_eq!(count([200, 0, 0]), 2 * 9 * (20 * 30 - 1));
        assert_eq!(count([0, 0, 200]), 2 * 9 * 25 * 30);
        let first = MARGIN + TITLE;
        assert_eq!(sheet.size().height, first + 2 * (75 + CAPTION + MARGIN));
        assert_eq!(
            (sheet.pixel(first + 9, 16 + 12), sheet.pixel(first + 11, 16 + 14)),
            ([1, 2, 3], [1, 2, 3])
        );
        let letters = sheet.pixels().iter().filter(|p| p[0] > 150 && p[0] == p[2]).count();
        assert!(letters > 300, "{letters}");
    }

    #[test]
    fn crop_at_100_percent_has_its_own_pixels() {
        let mut noise = crop(Size::new(64, 61), [0; 3], "");
        for y in 0..64 {
            for (x, p) in noise.image.row_mut(y).iter_mut().enumerate() {
                *p = [y * 7919 + x * 104_729, x * 31 + y, x * y].map(|v| (v % 251) as u8);
            }
        }
        let sheet = contact_sheet("", &[[noise.clone(), noise.clone()]], 1).unwrap();
        for y in 0..64 {
            for x in 0..61 {
                assert_eq!(sheet.pixel(MARGIN + TITLE + y, MARGIN + x), noise.image.pixel(y, x), "{y} {x}");
            }
        }
    }

    #[test]
    fn long_title_widens_the_sheet_and_no_pair_or_scale_0_is_an_error() {
        let pair = || [crop(Size::new(1, 1), [0; 3], ""), crop(Size::new(1, 1), [9; 3], "")];
        let sheet = contact_sheet("A title much longer than its crops", &[pair()], 1).unwrap();
        assert!(sheet.size().width > 300);
        assert!((0..sheet.size().height).all(|y| sheet.pixel(y, sheet.size().width - 10) == BACKGROUND));
        assert!(contact_sheet("none", &[], 1).is_err() && contact_sheet("none", &[pair()], 0).is_err());
    }
}
