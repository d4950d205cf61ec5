//! The coatings of a lens, and the text of a prescription that determines its light.
//!
//! A default belongs to the boundaries with air: cemented surfaces stay bare (they reflect about 3·10⁻⁴; a quarter wave on cement would be wrong). Mirrors
//! reflect everything unless a coating is given for them. With coatings light is also absorbed in glass ([`absorption`](super::absorption)).

use super::absorption::Absorption;
use super::coating::Coating;
use super::error::DesignError;
use super::system::{Medium, System};

/// Coatings of a lens.
#[derive(Clone, Debug, PartialEq)]
pub struct Coatings {
    /// Of boundaries with air that are not named.
    pub default: Coating,
    /// Of single surfaces, by their index from 0; `None`: all light passes.
    pub surfaces: Vec<(usize, Option<Coating>)>,
}

impl System {
    /// The lens with coatings and the absorption of its glasses; adds notes on what is not known.
    ///
    /// # Errors
    /// [`DesignError::Incomplete`]: a surface that the lens does not have or that cannot have its coating.
    pub fn with_coatings(mut self, coatings: &Coatings) -> Result<Self, DesignError> {
        for i in 0..self.image() {
            self.surfaces[i].coating = self.default_coating(i, &coatings.default);
        }
        for (i, coating) in &coatings.surfaces {
            let (number, count) = (i + 1, self.image());
            let problem = match self.surfaces.get(*i).filter(|_| *i < count) {
                None => format!("has surfaces 1 to {count}, a coating is given for surface {number}"),
                Some(s) if s.is_mirror && matches!(coating, Some(Coating::Films(_) | Coating::Bare)) => {
                    format!("has a mirror as surface {number}, whose coating is a reflectance or a table")
                }
                Some(s) if s.ideal_focal_mm.is_some() && coating.is_some() => {
                    format!("has an ideal lens as surface {number}, which has no coating")
                }
                Some(_) => {
                    self.surfaces[*i].coating = coating.clone();
                    continue;
                }
            };
            return Err(DesignError::Incomplete { problem });
        }
        self.note_mirrors();
        self.find_absorption();
        Ok(self)
    }

    /// The medium before surface `i`.
    fn medium_before(&self, i: usize) -> &Medium {
        i.checked_sub(1).map_or(&Medium::Air, |before| &self.surfaces[before].medium)
    }

    /// Whether light is refracted at surface `i`, and whether one side of it is air.
    pub fn is_boundary(&self, i: usize) -> (bool, bool) {
        let (before, s) = (self.medium_before(i), &self.surfaces[i]);
        let refracts = !s.is_mirror && s.ideal_focal_mm.is_none() && *before != s.medium;
        (refracts, refracts && (*before == Medium::Air || s.medium == Medium::Air))
    }

    fn default_coating(&self, i: usize, default: &Coating) -> Option<Coating> {
        match self.is_boundary(i) {
            (false, _) => None,
            (true, true) => Some(default.clone()),
            (true, false) => Some(Coating::Bare),
        }
    }

    fn note_mirrors(&mut self) {
        let bare = |i: &usize| self.surfaces[*i].is_mirror && self.surfaces[*i].coating.is_none();
        let mirrors: Vec<String> = (0..self.image()).filter(bare).map(|i| (i + 1).to_string()).collect();
        if !mirrors.is_empty() {
            let surfaces = mirrors.join(", ");
            self.notes.push(format!("mirrors without a coating reflect all light: surfaces {surfaces}"));
        }
    }

    /// Absorption of the built-in table where a catalogue has none.
    fn find_absorption(&mut self) {
        let mut unknown: Vec<String> = Vec::new();
        for s in &mut self.surfaces {
            let Medium::Glass(glass) = &mut s.medium else { continue };
            if glass.absorption.is_none() {
                glass.absorption = Absorption::builtin(glass);
            }
            if glass.absorption.is_none() && !unknown.contains(&glass.name) {
                unknown.push(glass.name.clone());
            }
        }
        if !unknown.is_empty() {
            self.notes.push(format!(
                "no absorption is known of glass {}: taken as clear (a catalogue with IT records has it)",
                unknown.join(", ")
            ));
        }
    }

    /// Text of everything that determines traced tables, for digests. Absorption and names of coatings count in a lens with coatings only, and what a lens
    /// without them does not have is left out, so that its digests remain those of before there were coatings.
    pub fn identity(&self) -> String {
        self.text(self.has_coatings())
    }

    /// Whether a surface has a coating.
    pub fn has_coatings(&self) -> bool {
        self.surfaces.iter().any(|s| s.coating.is_some())
    }

    /// [`identity`](Self::identity) of a lens with coatings without what they are: equal of lenses that differ in their coatings alone.
    pub fn identity_without_coatings(&self) -> String {
        let mut system = self.clone();
        system.surfaces.iter_mut().for_each(|s| s.coating = None);
        system.text(true)
    }

    fn text(&self, has_absorption: bool) -> String {
        let mut system = Self { name: String::new(), notes: Vec::new(), ..self.clone() };
        for s in &mut system.surfaces {
            s.coating_name = None;
            if let (Medium::Glass(glass), false) = (&mut s.medium, has_absorption) {
                glass.absorption = None;
            }
        }
        ["coating_name", "coating", "absorption", "asymmetry"]
            .iter()
            .fold(format!("{system:?}"), |text, field| text.replace(&format!(", {field}: None"), ""))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mgf2() -> Coatings {
        Coatings { default: Coating::quarter_wave("MgF2", 1.38, 0.55), surfaces: Vec::new() }
    }

    #[test]
    fn default_is_for_boundaries_with_air() {
        let lens = System::double_gauss_28().with_coatings(&mgf2()).unwrap();
        let kinds: Vec<_> = lens.surfaces.iter().map(|s| s.coating.as_ref()).collect();
        let count = |wanted: fn(&Coating) -> bool| kinds.iter().flatten().filter(|c| wanted(c)).count();
        // Ten glass surfaces, two of them cemented; the stop and the film have none.
        assert_eq!(count(|c| matches!(c, Coating::Films(_))), 8);
        assert_eq!(count(|c| matches!(c, Coating::Bare)), 2);
        assert_eq!(kinds.iter().filter(|k| k.is_none()).count(), lens.surfaces.len() - 10);
        assert!(lens.notes.iter().all(|n| !n.contains("absorption")), "{:?}", lens.notes);
    }

    #[test]
    fn wrong_surface_is_an_error() {
        let coatings = Coatings { surfaces: vec![(99, Some(Coating::Bare))], ..mgf2() };
        let error = System::double_gauss_28().with_coatings(&coatings).unwrap_err().to_string();
        assert!(error.contains("surface 100"), "{error}");
    }

    #[test]
    fn identity_of_a_lens_without_coatings_is_that_of_before() {
        let lens = System::double_gauss_28();
        let text = lens.identity();
        assert!(!text.contains("coating") && !text.contains("absorption"));
        let coated = lens.clone().with_coatings(&mgf2()).unwrap();
        assert_ne!(coated.identity(), text);
        let bare = Coatings { default: Coating::Bare, surfaces: Vec::new() };
        let bare = lens.clone().with_coatings(&bare).unwrap();
        assert_ne!(coated.identity(), bare.identity());
        assert_eq!(coated.identity_without_coatings(), bare.identity_without_coatings());
        assert!(coated.identity().contains("absorption: Some"));
        let mut named = lens;
        named.surfaces[0].coating_name = Some("AR".to_owned());
        assert_eq!(named.identity(), text);
    }
}
