//! Writer of FITS images (FITS Standard 4.0, 2018): a header of cards and an array of 32-bit floats.
//!
//! A card is 80 characters of ASCII: a key of up to 8, `= `, the value, ` / ` and a comment (4.1, 4.2). Cards up to END and data are padded to blocks of
//! 2880 bytes, the header with spaces, data with zeros (3.3). Data are big-endian (5.3), NAXIS1 fastest.

const BLOCK: usize = 2880;
const CARD: usize = 80;
/// Characters of a text value.
const MAX_TEXT: usize = 68;

/// Cards of the header of the only unit of a file, without END.
#[derive(Debug)]
pub(crate) struct Cards(String);

impl Cards {
    /// The mandatory cards of an array of f32 of `axes`, the fastest first.
    pub(crate) fn of_f32(axes: &[usize]) -> Self {
        let mut cards = Self(String::new());
        cards.value("SIMPLE", "T", "FITS 4.0");
        cards.integer("BITPIX", -32, "32-bit floats");
        cards.integer("NAXIS", axes.len() as i64, "");
        for (i, n) in axes.iter().enumerate() {
            cards.integer(&format!("NAXIS{}", i + 1), *n as i64, "");
        }
        cards
    }

    /// A value as it is written, right-justified as in fixed format (4.2).
    fn value(&mut self, key: &str, value: &str, comment: &str) {
        debug_assert!(key.len() <= 8, "{key}");
        self.card(&format!("{key:<8}= {value:>20}"), comment);
    }

    pub(crate) fn integer(&mut self, key: &str, value: i64, comment: &str) {
        self.value(key, &value.to_string(), comment);
    }

    pub(crate) fn real(&mut self, key: &str, value: f64, comment: &str) {
        // The form with a point and, if any, an exponent behind E.
        let text = format!("{value:?}").to_uppercase();
        let text = match text.split_once('E') {
            Some((mantissa, power)) if !mantissa.contains('.') => format!("{mantissa}.0E{power}"),
            _ => text,
        };
        self.value(key, &text, comment);
    }

    /// A text; characters that are not ASCII become `?`, and its end is cut if it has more characters than a card.
    pub(crate) fn text(&mut self, key: &str, value: &str, comment: &str) {
        let mut quoted = String::new();
        for c in value.chars() {
            let c = if c == ' ' || c.is_ascii_graphic() { c } else { '?' };
            let c = if c == '\'' { "''".to_owned() } else { c.to_string() };
            if quoted.len() + c.len() > MAX_TEXT {
                break;
            }
            quoted += &c;
        }
        self.card(&format!("{key:<8}= '{quoted:<8}'"), comment);
    }

    pub(crate) fn comment(&mut self, text: &str) {
        self.card(&format!("COMMENT {text}"), "");
    }

    /// Adds a card, and as much of the comment as it holds.
    fn card(&mut self, content: &str, comment: &str) {
        let comment = if comment.is_empty() { String::new() } else { format!(" / {comment}") };
        debug_assert!(content.is_ascii() && comment.is_ascii() && content.len() <= CARD, "{content}");
        let card: String = content.chars().chain(comment.chars()).take(CARD).collect();
        self.0 += &format!("{card:<CARD$}");
    }

    /// The header with END and its padding.
    pub(crate) fn end(mut self) -> Vec<u8> {
        self.card("END", "");
        let length = self.0.len().next_multiple_of(BLOCK);
        format!("{:<length$}", self.0).into_bytes()
    }
}

/// Big-endian samples.
pub(crate) fn samples(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_be_bytes()).collect()
}

/// Zeros behind `bytes` bytes of data up to a whole block.
pub(crate) fn padding(bytes: usize) -> Vec<u8> {
    vec![0; bytes.next_multiple_of(BLOCK) - bytes]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cards_have_the_fixed_format_of_the_standard() {
        let mut cards = Cards::of_f32(&[5, 4]);
        cards.real("PITCH", 2.0, "um");
        cards.real("SMALL", 5.5e-7, "m");
        cards.real("BIG", 1e20, "");
        cards.text("LENS", "o'clock µ", "name");
        cards.text("LONG", &"x".repeat(100), "cut");
        cards.comment("light");
        let header = cards.end();
        assert_eq!(header.len(), BLOCK);
        let text = String::from_utf8(header).unwrap();
        let card = |i: usize| text[CARD * i..][..CARD].trim_end();
        assert_eq!(card(0), "SIMPLE  =                    T / FITS 4.0");
        assert_eq!(card(1), "BITPIX  =                  -32 / 32-bit floats");
        assert_eq!(card(3), "NAXIS1  =                    5");
        assert_eq!(card(5), "PITCH   =                  2.0 / um");
        assert_eq!(card(6), "SMALL   =               5.5E-7 / m");
        assert_eq!(card(7), "BIG     =               1.0E20");
        assert_eq!(card(8), "LENS    = 'o''clock ?' / name");
        assert_eq!(card(9), format!("LONG    = '{}'", "x".repeat(68)));
        assert_eq!((card(10), card(11)), ("COMMENT light", "END"));
    }

    #[test]
    fn data_are_padded_to_whole_blocks() {
        assert_eq!(samples(&[1.0, -2.0]), [0x3f, 0x80, 0, 0, 0xc0, 0, 0, 0]);
        assert_eq!([0, 1, 2880, 2881].map(|n| padding(n).len()), [0, 2879, 0, 2879]);
    }
}
