//! Units of light as metadata spell them: `W m-2 sr-1 nm-1`, `W/(m² sr nm)`, `µW cm^-2 sr^-1 nm^-1`, `s-1 nm-1`.
//!
//! A unit is a product of powers; prefixes of W and other units of area and wavelength give a factor to SI with nm.

use std::collections::BTreeMap;

/// A spectral quantity of light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// W m⁻² sr⁻¹ nm⁻¹.
    Radiance,
    /// W m⁻² nm⁻¹.
    Irradiance,
    /// Photons of a pixel, s⁻¹ nm⁻¹.
    Photons,
}

/// Quantity of `units`, and the factor that brings values to the unit named at [`Quantity`]; `None` if it is no spectral quantity of light
/// (`relative`, `counts`, text that is not understood).
pub fn parse(units: &str) -> Option<(Quantity, f64)> {
    let mut powers = BTreeMap::new();
    let mut factor = 1.0;
    for (name, power) in powers_of(units)? {
        let (dimension, size) = base(&name)?;
        factor *= f64::powi(size, power);
        *powers.entry(dimension).or_insert(0) += power;
    }
    powers.retain(|_, power| *power != 0);
    let is = |wanted: &[(&str, i32)]| {
        powers.len() == wanted.len() && wanted.iter().all(|(d, p)| powers.get(d) == Some(p))
    };
    // A unit of wavelength is told from one of area by its size: nm and µm are not units of area here.
    let quantity = match () {
        () if is(&[("W", 1), ("m", -2), ("sr", -1), ("nm", -1)]) => Quantity::Radiance,
        () if is(&[("W", 1), ("m", -2), ("nm", -1)]) => Quantity::Irradiance,
        () if is(&[("nm", -1), ("s", -1)]) => Quantity::Photons,
        () => return None,
    };
    // Powers of ten are decimal: 1e-6 / 1e-4 is not 0.01 to the last bit.
    Some((quantity, format!("{factor:.9e}").parse().expect("a number")))
}

/// Dimension and size of a unit.
fn base(name: &str) -> Option<(&'static str, f64)> {
    Some(match name {
        "W" | "w" | "watt" | "watts" => ("W", 1.0),
        "mW" | "mw" => ("W", 1e-3),
        "uW" | "uw" => ("W", 1e-6),
        "m" => ("m", 1.0),
        "cm" => ("m", 1e-2),
        "sr" | "steradian" => ("sr", 1.0),
        "nm" | "nanometer" | "nanometers" => ("nm", 1.0),
        "um" | "micrometer" | "micrometers" | "micron" | "microns" => ("nm", 1e3),
        "s" => ("s", 1.0),
        _ => return None,
    })
}

/// The factors of a product: names and powers. A group in parentheses behind `/`, or a single name there, counts inverted.
fn powers_of(units: &str) -> Option<Vec<(String, i32)>> {
    let text: String = units.chars().flat_map(plain).collect();
    let (mut found, mut sign, mut in_group) = (Vec::new(), 1, false);
    let mut rest = text.as_str();
    while let Some(c) = rest.chars().next() {
        rest = &rest[c.len_utf8()..];
        match c {
            ' ' | '*' => (),
            '/' => sign = -1,
            '(' if !in_group => in_group = true,
            ')' if in_group => (in_group, sign) = (false, 1),
            _ if c.is_ascii_alphabetic() => {
                let end = rest.find(|c: char| !c.is_ascii_alphabetic()).unwrap_or(rest.len());
                let name = format!("{c}{}", &rest[..end]);
                rest = rest[end..].trim_start_matches('^').trim_start_matches("**");
                let end = rest.find(|c: char| !c.is_ascii_digit() && c != '-').unwrap_or(rest.len());
                let power: i32 = if end == 0 { 1 } else { rest[..end].parse().ok()? };
                if power.abs() > 9 {
                    return None;
                }
                rest = &rest[end..];
                found.push((name, sign * power));
                sign = if in_group { sign } else { 1 };
            }
            _ => return None,
        }
    }
    Some(found)
}

/// A character in ASCII: superscripts become digits, the micro sign u, dots of products spaces.
fn plain(c: char) -> Option<char> {
    Some(match c {
        '⁻' | '−' => '-',
        '¹' => '1',
        '²' => '2',
        'µ' | 'μ' => 'u',
        '·' | '⋅' | '.' | '_' => ' ',
        c => c,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spellings_of_one_unit_are_one_quantity() {
        let radiance = [
            "W m-2 sr-1 nm-1",
            "W·m⁻²·sr⁻¹·nm⁻¹",
            "W/m^2/sr/nm",
            "W/(m2 sr nm)",
            "W m^-2 sr^-1 nm^-1",
            "W sr-1 m-2 nm-1",
        ];
        for units in radiance {
            assert_eq!(parse(units), Some((Quantity::Radiance, 1.0)), "{units}");
        }
        assert_eq!(parse("W m-2 nm-1"), Some((Quantity::Irradiance, 1.0)));
        assert_eq!(parse("s-1 nm-1"), Some((Quantity::Photons, 1.0)));
    }

    #[test]
    fn prefixes_and_areas_give_a_factor() {
        // 1 µW/cm² = 0.01 W/m²; per µm is a thousandth per nm.
        assert_eq!(parse("µW cm-2 sr-1 nm-1"), Some((Quantity::Radiance, 1e-2)));
        assert_eq!(parse("uW/cm^2/sr/nm"), Some((Quantity::Radiance, 1e-2)));
        assert_eq!(parse("mW m**-2 sr**-1 nm**-1"), Some((Quantity::Radiance, 1e-3)));
        assert_eq!(parse("W m-2 sr-1 um-1"), Some((Quantity::Radiance, 1e-3)));
        assert_eq!(parse("W m-2 sr-1 µm-1"), Some((Quantity::Radiance, 1e-3)));
    }

    #[test]
    fn other_text_is_no_quantity_of_light() {
        for units in [
            "",
            "relative",
            "counts",
            "reflectance",
            "W m-2",
            "W m-2 sr-1",
            "W/",
            "m-",
            "sr-1 nm-1",
            "W m99999999999",
            "DN (scaled)",
            "1",
        ] {
            assert_eq!(parse(units), None, "{units}");
        }
    }
}
