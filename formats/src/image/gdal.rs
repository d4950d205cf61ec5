//! GDAL's metadata in a TIFF (tag 42112): XML of items, each with a name and, for one band, its index `sample`.
//!
//! | item | meaning |
//! |---|---|
//! | `wavelength` (any case), with `wavelength_units` | wavelength of the band; without units a number of 200 to 2500 is in nm |
//! | `CENTRAL_WAVELENGTH_UM` | the same in µm |
//! | role `description`, or `Band_N` | used if it holds one number followed by nm or µm |
//! | roles `scale`, `offset` | value = sample · scale + offset |

use std::collections::HashMap;

use roxmltree::Document;

/// Wavelengths that are in nm where no unit is given.
const NM_WITHOUT_UNIT: std::ops::RangeInclusive<f64> = 200.0..=2500.0;
/// Maximum size of the text.
const MAX_XML_BYTES: usize = 16 << 20;

/// What the metadata define.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct GdalMetadata {
    /// Wavelengths in nm, if every band has one.
    pub(crate) wavelengths_nm: Option<Vec<f64>>,
    /// (scale, offset) of each band; empty if there are none.
    pub(crate) scaling: Vec<(f64, f64)>,
}

/// Parses the metadata of a file with `bands` bands; the error describes the defect.
pub(crate) fn parse(xml: &str, bands: usize) -> Result<GdalMetadata, String> {
    if xml.len() > MAX_XML_BYTES {
        return Err(format!("{} bytes of XML", xml.len()));
    }
    let document = Document::parse(xml.trim_end_matches('\0')).map_err(|e| e.to_string())?;
    let mut items: HashMap<(String, usize), String> = HashMap::new();
    for item in document.descendants().filter(|n| n.has_tag_name("Item")) {
        let key = item.attribute("role").filter(|r| !r.is_empty()).or(item.attribute("name"));
        let key = key.unwrap_or_default().to_lowercase();
        let text = item.text().unwrap_or_default().trim().to_owned();
        let (key, band) = match (item.attribute("sample"), key.strip_prefix("band_")) {
            (Some(band), _) => (key, band.parse().ok()),
            // ENVI's descriptions, counted from 1.
            (None, Some(number)) => {
                ("band_".into(), number.parse::<usize>().ok().and_then(|n| n.checked_sub(1)))
            }
            _ => continue,
        };
        if let Some(band) = band.filter(|b| *b < bands) {
            items.entry((key, band)).or_insert(text);
        }
    }
    let item = |key: &str, band: usize| items.get(&(key.to_owned(), band)).map(String::as_str);
    let wavelength = |band: usize| -> Option<f64> {
        if let Some(text) = item("wavelength", band) {
            let unit = item("wavelength_units", band).or(item("wavelength_unit", band));
            return with_unit(text).or_else(|| {
                let number = text.parse::<f64>().ok()?;
                match unit {
                    Some(unit) => Some(rounded(number * per_unit(unit)?)),
                    None => Some(number).filter(|n| NM_WITHOUT_UNIT.contains(n)),
                }
            });
        }
        if let Some(um) = item("central_wavelength_um", band).and_then(|t| t.parse::<f64>().ok()) {
            return Some(rounded(um * 1e3));
        }
        ["description", "band_"].iter().find_map(|key| with_unit(item(key, band)?))
    };
    let wavelengths_nm = (0..bands).map(wavelength).collect();
    let factor = |key: &str, band, default: f64| match item(key, band) {
        None => Ok(default),
        Some(text) => {
            let number = text.parse::<f64>().ok().filter(|v| v.is_finite() && (*v != 0.0 || key == "offset"));
            number.ok_or_else(|| format!("{key} `{}` of band {band}", short(text)))
        }
    };
    let scaling: Result<Vec<_>, String> =
        (0..bands).map(|b| Ok((factor("scale", b, 1.0)?, factor("offset", b, 0.0)?))).collect();
    let mut scaling = scaling?;
    if scaling.iter().all(|s| *s == (1.0, 0.0)) {
        scaling.clear();
    }
    Ok(GdalMetadata { wavelengths_nm, scaling })
}

fn short(text: &str) -> String {
    text.chars().take(40).collect()
}

/// 0.55 µm is 550 nm, not 550.0000000000001.
fn rounded(nm: f64) -> f64 {
    (nm * 1e6).round() / 1e6
}

fn per_unit(unit: &str) -> Option<f64> {
    match unit.trim().to_lowercase().as_str() {
        "nm" | "nanometers" | "nanometres" | "nanometer" => Some(1.0),
        "um" | "µm" | "μm" | "micrometers" | "micrometres" | "microns" | "micrometer" => Some(1e3),
        _ => None,
    }
}

/// The wavelength in nm if `text` holds exactly one number that is followed by a unit of length: `Band 3 (550.5 nm)`.
fn with_unit(text: &str) -> Option<f64> {
    let lower = text.to_lowercase();
    let bytes = lower.as_bytes();
    let (mut found, mut at) = (None, 0);
    while at < bytes.len() {
        if !bytes[at].is_ascii_digit() {
            at += 1;
            continue;
        }
        let end = at + bytes[at..].iter().take_while(|b| b.is_ascii_digit() || **b == b'.').count();
        let unit: String = lower[end..]
            .trim_start_matches([' ', '_', '-'])
            .chars()
            .take_while(|c| c.is_alphabetic())
            .collect();
        if let (Some(factor), Ok(number)) = (per_unit(&unit), lower[at..end].parse::<f64>())
            && found.replace(rounded(number * factor)).is_some()
        {
            return None;
        }
        at = end;
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    fn xml(items: &str) -> String {
        format!("<GDALMetadata>{items}</GDALMetadata>")
    }

    #[test]
    fn wavelengths_are_read_with_and_without_units() {
        for (items, expected) in [
            (
                r#"<Item name="WAVELENGTH" sample="0">450</Item><Item name="WAVELENGTH" sample="1">550</Item>"#,
                Some([450.0, 550.0]),
            ),
            (
                r#"<Item name="wavelength" sample="1">0.55 um</Item><Item name="wavelength" sample="0">450nm</Item>"#,
                Some([450.0, 550.0]),
            ),
            (
                r#"<Item name="wavelength" sample="0">0.45</Item><Item name="wavelength_units" sample="0">Micrometers</Item>
                   <Item name="wavelength" sample="1">0.55</Item><Item name="wavelength_units" sample="1">Micrometers</Item>"#,
                Some([450.0, 550.0]),
            ),
            (
                r#"<Item name="CENTRAL_WAVELENGTH_UM" sample="0" domain="IMAGERY">0.45</Item>
                   <Item name="CENTRAL_WAVELENGTH_UM" sample="1" domain="IMAGERY">0.55</Item>"#,
                Some([450.0, 550.0]),
            ),
            (
                r#"<Item name="DESCRIPTION" sample="0" role="description">band 1 (450.0 nm)</Item>
                   <Item name="DESCRIPTION" sample="1" role="description">band 2 (550 Nanometers)</Item>"#,
                Some([450.0, 550.0]),
            ),
            (
                r#"<Item name="Band_1">450.0 Nanometers</Item><Item name="Band_2">550.0 Nanometers</Item>"#,
                Some([450.0, 550.0]),
            ),
            // The unit of a small number is not guessed, and every band must have a wavelength.
            (
                r#"<Item name="wavelength" sample="0">0.45</Item><Item name="wavelength" sample="1">0.55</Item>"#,
                None,
            ),
            (r#"<Item name="wavelength" sample="0">450</Item>"#, None),
            (r#"<Item name="DESCRIPTION" sample="0" role="description">450</Item>"#, None),
        ] {
            let found = parse(&xml(items), 2).unwrap().wavelengths_nm;
            assert_eq!(found, expected.map(|e| e.to_vec()), "{items}");
        }
    }

    #[test]
    fn scale_and_offset_are_applied_by_role() {
        let items = r#"<Item name="SCALE" sample="1" role="scale">0.5</Item><Item name="OFFSET" sample="1" role="offset">-1</Item>"#;
        assert_eq!(parse(&xml(items), 2).unwrap().scaling, [(1.0, 0.0), (0.5, -1.0)]);
        let zero = r#"<Item name="SCALE" sample="1" role="scale">0</Item>"#;
        assert!(parse(&xml(zero), 2).unwrap_err().contains("band 1"));
    }

    #[test]
    fn invalid_xml_and_entities_are_errors() {
        assert!(parse("<GDALMetadata>", 1).is_err());
        assert!(parse("<!DOCTYPE a [<!ENTITY b 'c'>]><a>&b;</a>", 1).is_err());
    }
}
