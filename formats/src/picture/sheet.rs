//! A contact sheet: rows of chart and film side by side, pixel for pixel, for the eye to compare.
//!
//! Crops stand at 100 % or enlarged a whole number of times, each pixel a square: nothing is interpolated, so what is seen is
//! what is there. The paper is dark and neutral, so that it takes no part in judging colours. What a caption
//! says in letters beyond ASCII is left blank.

use super::PictureError;
use super::image::{Image, Rgb, text_size};
use pipeline::geometry::Size;

const PAPER: Rgb = [38; 3];
const LETTERS: Rgb = [224; 3];
/// Pixels around and between crops.
const MARGIN: usize = 16;
/// Pixels between a crop and its caption.
const GAP: usize = 6;
/// Pixels a dot of captions and of the title.
const DOTS: (usize, usize) = (2, 3);

/// A picture and what to say about it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Crop {
    /// The picture.
    pub image: Image,
    /// A line under it.
    pub caption: String,
}

/// Lays pairs (chart on the left, film on the right) out under a title.
///
/// # Errors
/// If there is nothing to show, or `enlarge` is 0.
pub fn contact_sheet(title: &str, pairs: &[[Crop; 2]], enlarge: usize) -> Result<Image, PictureError> {
    let bad = |setting, problem: &str| Err(PictureError::Setting { setting, problem: problem.into() });
    if pairs.is_empty() {
        return bad("pairs", "a contact sheet needs at least one pair of crops");
    }
    if enlarge == 0 {
        return bad("enlarge", "is 0; take 1 for every pixel as it is");
    }
    let caption_height = text_size("", DOTS.0).height;
    let widths = [0, 1]
        .map(|side| pairs.iter().map(|pair| cell(&pair[side], enlarge).width).max().unwrap_or_default());
    let heights = pairs.iter().map(|pair| cell(&pair[0], enlarge).height.max(cell(&pair[1], enlarge).height));
    let top = 2 * MARGIN + text_size(title, DOTS.1).height;
    let size = Size::new(
        top + heights.clone().map(|h| h + MARGIN).sum::<usize>(),
        (widths[0] + widths[1] + 3 * MARGIN).max(text_size(title, DOTS.1).width + 2 * MARGIN),
    );
    let mut sheet = Image::new(size, PAPER);
    sheet.text((MARGIN as i64, MARGIN as i64), title, DOTS.1, LETTERS);
    let mut y = top;
    for (pair, height) in pairs.iter().zip(heights) {
        let mut x = MARGIN;
        for (crop, width) in pair.iter().zip(widths) {
            sheet.lay((y, x), &crop.image, enlarge);
            let below = (y + height - caption_height) as i64;
            sheet.text((below, x as i64), &crop.caption, DOTS.0, LETTERS);
            x += width + MARGIN;
        }
        y += height + MARGIN;
    }
    Ok(sheet)
}

/// Room that a crop takes with its caption.
fn cell(crop: &Crop, enlarge: usize) -> Size {
    let (image, caption) = (crop.image.size(), text_size(&crop.caption, DOTS.0));
    Size::new(image.height * enlarge + GAP + caption.height, (image.width * enlarge).max(caption.width))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn crop(size: Size, colour: Rgb, caption: &str) -> Crop {
        Crop { image: Image::new(size, colour), caption: caption.into() }
    }

    #[test]
    fn every_pixel_becomes_a_square() {
        let mut left = crop(Size::new(20, 30), [200, 0, 0], "chart");
        left.image.row_mut(3)[4] = [1, 2, 3];
        let right = crop(Size::new(25, 30), [0, 0, 200], "film, 0.0 mm: a caption wider than its crop");
        let sheet = contact_sheet("Title", &[[left.clone(), right.clone()], [left, right]], 3).unwrap();
        let count = |c: Rgb| sheet.pixels().iter().filter(|&&p| p == c).count();
        assert_eq!(count([1, 2, 3]), 2 * 9);
        assert_eq!(count([200, 0, 0]), 2 * 9 * (20 * 30 - 1));
        assert_eq!(count([0, 0, 200]), 2 * 9 * 25 * 30);
        assert!(count(LETTERS) > 1000);
        // Title 21 high, then two rows of 75 + 6 + 14, every one with a margin below.
        assert_eq!(sheet.size().height, 2 * 16 + 21 + 2 * (75 + 6 + 14 + 16));
        let first = 2 * 16 + 21;
        assert_eq!(
            (sheet.pixel(first + 9, 16 + 12), sheet.pixel(first + 11, 16 + 14)),
            ([1, 2, 3], [1, 2, 3])
        );
        let caption = text_size("film, 0.0 mm: a caption wider than its crop", 2).width;
        assert_eq!(sheet.size().width, 3 * 16 + 90 + caption);
    }

    #[test]
    fn a_long_title_fits() {
        let pair = [crop(Size::new(1, 1), [0; 3], ""), crop(Size::new(1, 1), [9; 3], "")];
        let sheet = contact_sheet("A title much longer than its crops", &[pair], 1).unwrap();
        assert_eq!(sheet.size().width, text_size("A title much longer than its crops", 3).width + 32);
        assert!(contact_sheet("none", &[], 1).is_err());
        assert!(
            contact_sheet("none", &[[crop(Size::new(1, 1), PAPER, ""), crop(Size::new(1, 1), PAPER, "")]], 0)
                .is_err()
        );
    }
}
