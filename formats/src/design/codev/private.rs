//! The private glasses of a sequence file: `PRV`, `PWL` with wavelengths in nm, a line per glass, `END`.
//!
//! ```text
//! 'NAME' n1 n2 …          indices at the wavelengths of PWL
//! 'NAME' LAU c0 c1 …      Laurent series n² = c0 + c1 λ² + c2 λ⁻² + c3 λ⁻⁴ + …, λ in µm
//! ```

use super::command::Command;
use crate::design::error::LensFileError;
use pipeline::design::glass::{Dispersion, Glass, GlassCatalog};

#[derive(Default)]
pub(super) struct PrivateCatalogue {
    is_open: bool,
    wavelengths_um: Vec<f64>,
    glasses: GlassCatalog,
}

/// Range of a Laurent series, whose own range the file does not give, µm.
const LAURENT_RANGE_UM: (f64, f64) = (0.3, 2.5);

impl PrivateCatalogue {
    pub(super) fn get(&self, name: &str) -> Option<&Glass> {
        self.glasses.get(name)
    }

    /// Reads a command of the catalogue; false outside of it.
    pub(super) fn read(&mut self, key: &str, command: &Command<'_>) -> Result<bool, LensFileError> {
        match (self.is_open, key) {
            (false, "PRV") => self.is_open = true,
            (false, _) => return Ok(false),
            (true, "END") => self.is_open = false,
            (true, "PWL") => {
                let nm: Result<Vec<f64>, _> = (1..command.words.len()).map(|i| command.value(i)).collect();
                self.wavelengths_um = nm?.iter().map(|nm| nm * 1e-3).collect();
            }
            (true, _) => self.read_glass(command)?,
        }
        Ok(true)
    }

    fn read_glass(&mut self, command: &Command<'_>) -> Result<(), LensFileError> {
        let name = command.words[0].trim_matches(['\'', '"']).to_owned();
        let form = command.words.get(1).map(|w| w.to_ascii_uppercase()).unwrap_or_default();
        let is_laurent = form == "LAU";
        if !is_laurent && form.starts_with(|c: char| c.is_ascii_alphabetic()) {
            let problem = format!("private glass {name} of form {form}: expected indices or LAU");
            return Err(command.error(problem));
        }
        let first = 1 + usize::from(is_laurent);
        let values: Result<Vec<f64>, _> = (first..command.words.len()).map(|i| command.value(i)).collect();
        let values = values?;
        let (dispersion, range_um) = if is_laurent {
            (Dispersion::new(1, &values), LAURENT_RANGE_UM)
        } else {
            if values.len() != self.wavelengths_um.len() || values.is_empty() {
                let (n, m) = (values.len(), self.wavelengths_um.len());
                return Err(
                    command.error(format!("{n} indices of private glass {name}, {m} wavelengths in PWL"))
                );
            }
            let um = &self.wavelengths_um;
            let range = um.iter().fold((f64::INFINITY, 0.0), |(a, b): (f64, f64), v| (a.min(*v), b.max(*v)));
            let points: Vec<(f64, f64)> = um.iter().copied().zip(values).collect();
            (Dispersion::table(&points), range)
        };
        let dispersion =
            dispersion.map_err(|problem| command.error(format!("private glass {name}: {problem}")))?;
        self.glasses.add(Glass::new(name, dispersion, range_um));
        Ok(())
    }
}
