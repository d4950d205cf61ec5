//! The noises: their switches, and one row for the figure of each, from which descriptions are read and checked, raws identified, variances
//! added up and sensors shown.

use serde::{Deserialize, Serialize};
use std::str::FromStr;

/// Noises that are switched on; a quantity of one that is off is at its mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NoiseSet(u16);

/// Names of the noises, in the order of their bits.
pub const NOISES: &[&str] = &["shot", "dark", "read", "reset", "adc", "dsnu", "prnu", "column", "row"];

#[allow(missing_docs, reason = "the names of the noises")]
impl NoiseSet {
    pub const ALL: Self = Self((1 << NOISES.len()) - 1);
    pub const NONE: Self = Self(0);
    pub const SHOT: Self = Self(1);
    pub const DARK: Self = Self(1 << 1);
    pub const READ: Self = Self(1 << 2);
    pub const RESET: Self = Self(1 << 3);
    pub const ADC: Self = Self(1 << 4);
    pub const DSNU: Self = Self(1 << 5);
    pub const PRNU: Self = Self(1 << 6);
    pub const COLUMN: Self = Self(1 << 7);
    pub const ROW: Self = Self(1 << 8);

    pub const fn has(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    pub const fn without(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }

    /// `sigma` where the noise is on, else 0.
    pub fn on(self, noise: Self, sigma: f64) -> f64 {
        if self.has(noise) { sigma } else { 0.0 }
    }
}

impl FromStr for NoiseSet {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "all" => Ok(Self::ALL),
            "none" => Ok(Self::NONE),
            list => list.split(',').try_fold(Self::NONE, |set, word| {
                match NOISES.iter().position(|name| *name == word.trim()) {
                    Some(bit) => Ok(Self(set.0 | 1 << bit)),
                    None => Err(format!(
                        "unknown noise source `{word}`; expected all, none or some of {}",
                        NOISES.join(",")
                    )),
                }
            }),
        }
    }
}

impl std::fmt::Display for NoiseSet {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match *self {
            Self::ALL => f.write_str("all"),
            Self::NONE => f.write_str("none"),
            Self(bits) => {
                let on = NOISES.iter().enumerate().filter(|(bit, _)| bits >> bit & 1 == 1);
                f.write_str(&on.map(|(_, name)| *name).collect::<Vec<_>>().join(","))
            }
        }
    }
}

/// What a figure is the standard deviation of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// The charge, e-.
    Charge,
    /// The digital number after the gain, DN.
    Number,
    /// The charge of light, as a share of it.
    LightShare,
    /// The dark charge, as a share of it.
    DarkShare,
    /// All charge, as a share of it.
    ChargeShare,
}

/// What a noise differs over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Over {
    /// Frames: it is new in each.
    Frames,
    /// The pixels of a die: it is the same in every frame.
    Die,
}

/// A row of [`NoiseFigures::TABLE`].
#[derive(Debug)]
pub struct NoiseFigure {
    /// Field of the description.
    pub field: &'static str,
    /// Name in texts.
    pub label: &'static str,
    /// Its switch.
    pub noise: NoiseSet,
    /// What it is the standard deviation of.
    pub quantity: Quantity,
    /// What it differs over.
    pub over: Over,
    /// Greatest value of a description.
    pub max: f64,
    value: fn(&mut NoiseFigures) -> &mut f64,
}

/// Fields of [`NoiseFigures`] with their rows.
macro_rules! noise_figures {
    ($($(#[$doc:meta])* $field:ident: $label:literal, $noise:ident, $quantity:ident, $over:ident, $max:literal;)*) => {
        /// Standard deviations of the noises, 0 where a description states none.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize, Serialize)]
        #[serde(deny_unknown_fields, default)]
        pub struct NoiseFigures {
            $($(#[$doc])* pub $field: f64,)*
        }

        impl NoiseFigures {
            /// All figures.
            pub const TABLE: &[NoiseFigure] = &[$(NoiseFigure {
                field: stringify!($field),
                label: $label,
                noise: NoiseSet::$noise,
                quantity: Quantity::$quantity,
                over: Over::$over,
                max: $max,
                value: |figures| &mut figures.$field,
            },)*];
        }
    };
}

// New figures stand last: the identity of a raw has them in this order.
noise_figures! {
    /// Read noise before the gain, e-.
    read_noise_e: "read", READ, Charge, Frames, 1e6;
    /// Reset noise, e-; 0 where the pixel has correlated double sampling.
    reset_noise_e: "reset", RESET, Charge, Frames, 1e6;
    /// Noise of the converter after the gain, rounding not included, DN.
    adc_noise_dn: "converter", ADC, Number, Frames, 1e6;
    /// Dark signal non-uniformity over pixels, e-.
    dsnu_e: "DSNU", DSNU, Charge, Die, 1e6;
    /// Photo response non-uniformity over pixels, a ratio.
    prnu: "PRNU", PRNU, LightShare, Die, 0.2;
    /// Non-uniformity of the dark current over pixels, a ratio.
    dark_nonuniformity: "dark current", DARK, DarkShare, Die, 10.0;
    /// Fixed offset of columns, e-.
    column_offset_e: "column offset", COLUMN, Charge, Die, 1e6;
    /// Fixed relative gain of columns.
    column_gain: "column gain", COLUMN, ChargeShare, Die, 0.2;
    /// Offset of rows, new in every frame, e-.
    row_noise_e: "rows", ROW, Charge, Frames, 1e6;
}

impl NoiseFigures {
    /// Every row with its value.
    pub fn rows(mut self) -> impl Iterator<Item = (&'static NoiseFigure, f64)> {
        Self::TABLE.iter().map(move |row| (row, *(row.value)(&mut self)))
    }

    /// The figures of the noises that are `on`, 0 for the others.
    pub fn switched(mut self, on: NoiseSet) -> Self {
        for row in Self::TABLE.iter().filter(|row| !on.has(row.noise)) {
            *(row.value)(&mut self) = 0.0;
        }
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noises_are_parsed_and_printed() {
        for text in ["all", "none", "shot,read", "dark"] {
            assert_eq!(text.parse::<NoiseSet>().unwrap().to_string(), text);
        }
        assert!("shot,rad".parse::<NoiseSet>().unwrap_err().contains("unknown noise source `rad`"));
        assert_eq!(NOISES.join(",").parse::<NoiseSet>(), Ok(NoiseSet::ALL));
    }

    #[test]
    fn a_figure_is_switched_by_its_noise_alone() {
        let mut all = NoiseFigures::default();
        NoiseFigures::TABLE.iter().for_each(|row| *(row.value)(&mut all) = 2.0);
        assert_eq!(all.switched(NoiseSet::ALL), all);
        assert_eq!(all.switched(NoiseSet::NONE), NoiseFigures::default());
        for (row, value) in all.switched(NoiseSet::COLUMN).rows() {
            assert_eq!(value, if row.field.starts_with("column") { 2.0 } else { 0.0 }, "{}", row.field);
        }
    }
}
