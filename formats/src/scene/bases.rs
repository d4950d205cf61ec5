//! Spectra of a scene as its attributes hold them.
//!
//! ```json
//! "bases": [{"reflectance": "red", "light": "illuminant"},
//!           {"reflectance": {"name": "brick.csv", "wavelengths_nm": [400, 700], "values": [0.1, 0.3]}, "light": {"colour": [1, 0.9, 0.8]}}],
//! "illuminant": "D65" or {"name": …, "wavelengths_nm": …, "values": …}, "illuminance_lx": 1000
//! ```

use pipeline::colour::Illuminant;
use pipeline::scene::weights::{Basis, LightSpectrum, Reflectance, SceneIlluminant, Spectrum};
use serde_json::{Map, Value, json};

/// Light and reflectances of a scene: what the weights of its surfaces are weights of.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneLight {
    /// A spectrum for each weight.
    pub bases: Vec<Basis>,
    /// White light.
    pub illuminant: SceneIlluminant,
    /// Its illuminance, lx.
    pub illuminance_lx: f64,
}

impl SceneLight {
    /// As attributes of a scene.
    pub fn attributes(&self) -> Map<String, Value> {
        let illuminant = match &self.illuminant {
            SceneIlluminant::Cie(light) => json!(light.name()),
            SceneIlluminant::Measured(spectrum) => spectrum_json(spectrum),
        };
        crate::object! {
            "bases": self.bases.iter().map(basis_json).collect::<Vec<_>>(),
            "illuminant": illuminant,
            "illuminance_lx": self.illuminance_lx,
        }
    }

    /// From the attributes of a scene; `None` if they are not such.
    pub fn from_attributes(attributes: &Map<String, Value>) -> Option<Self> {
        let illuminant = match attributes.get("illuminant")? {
            Value::String(name) => SceneIlluminant::Cie(name.parse::<Illuminant>().ok()?),
            other => SceneIlluminant::Measured(spectrum(other, f64::INFINITY)?),
        };
        let bases = attributes.get("bases")?.as_array()?.iter().map(basis).collect::<Option<Vec<_>>>()?;
        let illuminance_lx = attributes.get("illuminance_lx")?.as_f64()?;
        let is_lit = illuminance_lx.is_finite() && illuminance_lx > 0.0 && !bases.is_empty();
        is_lit.then_some(Self { bases, illuminant, illuminance_lx })
    }
}

fn spectrum_json(spectrum: &Spectrum) -> Value {
    json!({"name": spectrum.name(), "wavelengths_nm": spectrum.wavelengths_nm(), "values": spectrum.values()})
}

/// A spectrum of values up to `max`.
fn spectrum(value: &Value, max: f64) -> Option<Spectrum> {
    let numbers = |key: &str| serde_json::from_value::<Vec<f64>>(value.get(key)?.clone()).ok();
    let name = value.get("name")?.as_str()?;
    Spectrum::new(name, numbers("wavelengths_nm")?, numbers("values")?, max).ok()
}

fn basis_json(basis: &Basis) -> Value {
    let reflectance = match &basis.reflectance {
        Reflectance::Red => json!("red"),
        Reflectance::Green => json!("green"),
        Reflectance::Blue => json!("blue"),
        Reflectance::Named(spectrum) => spectrum_json(spectrum),
    };
    let light = match &basis.light {
        LightSpectrum::Illuminant => json!("illuminant"),
        LightSpectrum::Colour(linear) => json!({ "colour": linear }),
    };
    json!({ "reflectance": reflectance, "light": light })
}

fn basis(value: &Value) -> Option<Basis> {
    let reflectance = match value.get("reflectance")? {
        Value::String(kind) => match &**kind {
            "red" => Reflectance::Red,
            "green" => Reflectance::Green,
            "blue" => Reflectance::Blue,
            _ => return None,
        },
        other => Reflectance::Named(spectrum(other, 1.0)?),
    };
    let light = match value.get("light")? {
        Value::String(kind) if kind == "illuminant" => LightSpectrum::Illuminant,
        other => {
            let linear: [f64; 3] = serde_json::from_value(other.get("colour")?.clone()).ok()?;
            linear.iter().all(|v| v.is_finite() && *v >= 0.0).then_some(LightSpectrum::Colour(linear))?
        }
    };
    Some(Basis { reflectance, light })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn attributes_are_read_back() {
        let brick = Spectrum::new("brick.csv", vec![400.0, 700.0], vec![0.1, 0.3], 1.0).unwrap();
        let lamp = Spectrum::new("lamp.csv", vec![380.0, 780.0], vec![1.0, 20.0], f64::INFINITY).unwrap();
        let reflectances =
            [Reflectance::Red, Reflectance::Green, Reflectance::Blue, Reflectance::Named(brick)];
        let mut bases: Vec<Basis> = reflectances
            .iter()
            .map(|r| Basis { reflectance: r.clone(), light: LightSpectrum::Illuminant })
            .collect();
        bases.push(Basis { reflectance: Reflectance::Red, light: LightSpectrum::Colour([1.0, 0.5, 0.25]) });
        for illuminant in [SceneIlluminant::Cie(Illuminant::A), SceneIlluminant::Measured(lamp)] {
            let light = SceneLight { bases: bases.clone(), illuminant, illuminance_lx: 1000.0 };
            assert_eq!(SceneLight::from_attributes(&light.attributes()), Some(light));
        }
    }

    #[test]
    fn attributes_that_are_no_spectra_are_refused() {
        let good = json!({
            "bases": [{"reflectance": "red", "light": "illuminant"}],
            "illuminant": "D65", "illuminance_lx": 1000.0
        });
        let read = |value: &Value| SceneLight::from_attributes(value.as_object().unwrap());
        assert!(read(&good).is_some());
        for (pointer, bad) in [
            ("/bases", json!([])),
            ("/bases/0/reflectance", json!("violet")),
            (
                "/bases/0/reflectance",
                json!({"name": "a", "wavelengths_nm": [400, 500], "values": [0.5, 1.5]}),
            ),
            (
                "/bases/0/reflectance",
                json!({"name": "a", "wavelengths_nm": [500, 400], "values": [0.5, 0.5]}),
            ),
            ("/bases/0/light", json!({"colour": [1, 2]})),
            ("/illuminant", json!("D66")),
            ("/illuminance_lx", json!(-1.0)),
        ] {
            let mut value = good.clone();
            *value.pointer_mut(pointer).unwrap() = bad;
            assert_eq!(read(&value), None, "{pointer}");
        }
    }
}
