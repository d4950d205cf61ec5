//! The lenses of a data set, opened when a sample needs them.

use crate::failure::usage;
use crate::job::arrays::{ArrayFilm, ArrayLens, Placement};
use anyhow::{Context, Result};
use formats::dataset::Numbers;
use formats::dataset::draw::Draw;
use formats::dataset::recipe::{Flag, Recipe};
use pipeline::geometry::Size;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

/// Lenses that are open at once.
const MAX_OPEN: usize = 4;
/// Flags of the recipe's own fields.
const OWN: [&str; 12] = [
    "lens",
    "focus_m",
    "film_pitch_um",
    "film_size",
    "axis",
    "center",
    "scale",
    "stages",
    "roi",
    "threads",
    "memory",
    "fit",
];

/// A lens of the recipe in focus at a distance, and its index.
type Known = ((usize, Option<u64>), Arc<ArrayLens>);

/// The lenses.
pub struct Optics<'a> {
    recipe: &'a Recipe,
    folder: PathBuf,
    /// Names with their paths.
    names: Vec<String>,
    flags: Vec<String>,
    wavelengths_nm: Vec<f64>,
    /// How far from the axis the films of all samples reach, mm; none if their size is not known.
    reach_mm: Option<f64>,
    memory: u64,
    open: Mutex<Vec<Known>>,
}

impl<'a> Optics<'a> {
    /// The lenses of `recipe`, whose relative paths start at `folder`, within `memory` bytes.
    ///
    /// # Errors
    /// Usage: a flag that is one of the recipe's own fields.
    pub fn new(recipe: &'a Recipe, folder: &Path, wavelengths_nm: &[f64], memory: u64) -> Result<Self> {
        let names = recipe.lens.name.0.iter().map(|name| located(name, folder)).collect();
        let mut flags = Vec::new();
        for (name, value) in &recipe.lens.flags {
            let id = name.replace('-', "_");
            if OWN.contains(&&*id) {
                return Err(usage(format!(
                    "lens.flags.{name}: the recipe has its own fields for it: lens.name, lens.focus_m, film.pitch_um, pictures.size, film.center_mm; \
                     threads and memory are flags of `lenscube dataset`"
                )));
            }
            let flag = id.replace('_', "-");
            match value {
                Flag::Switch(true) => flags.push(format!("--{flag}")),
                Flag::Switch(false) => {}
                Flag::Whole(v) => flags.push(format!("--{flag}={v}")),
                Flag::Number(v) => flags.push(format!("--{flag}={v}")),
                Flag::Text(v) if is_file(&id, v, folder) => {
                    flags.push(format!("--{flag}={}", folder.join(v).display()));
                }
                Flag::Text(v) => flags.push(format!("--{flag}={v}")),
            }
        }
        let (reach_mm, open) = (reach_mm(recipe), Mutex::default());
        let folder = folder.to_path_buf();
        Ok(Self {
            recipe,
            folder,
            names,
            flags,
            wavelengths_nm: wavelengths_nm.to_vec(),
            reach_mm,
            memory,
            open,
        })
    }

    /// Opens each lens once, without tracing it.
    ///
    /// # Errors
    /// A lens that cannot be opened, or not with the recipe's flags.
    pub fn check(&self) -> Result<()> {
        let focus_m = match &self.recipe.lens.focus_m {
            None => None,
            Some(Numbers::List(values)) => values.first().copied(),
            Some(Numbers::Range(range)) => Some(range.from),
        };
        (0..self.names.len())
            .try_for_each(|lens| self.opened(&self.lens_flags(lens, focus_m), lens).map(drop))
    }

    fn lens_flags(&self, lens: usize, focus_m: Option<f64>) -> Vec<String> {
        let mut flags = vec![format!("--lens={}", self.names[lens]), "--threads=1".into()];
        flags.push(format!("--memory={}", self.memory / MAX_OPEN.min(self.states()) as u64));
        flags.extend(focus_m.map(|m| format!("--focus-m={m}")));
        flags.extend(self.flags.iter().cloned());
        flags
    }

    fn opened(&self, flags: &[String], lens: usize) -> Result<ArrayLens> {
        ArrayLens::open(flags, Some(self.wavelengths_nm.clone()))
            .with_context(|| format!("lens {}", self.names[lens]))
    }

    /// Name of a lens, as in the recipe.
    pub fn name(&self, lens: usize) -> &str {
        &self.recipe.lens.name.0[lens]
    }

    /// The lens of a sample.
    ///
    /// # Errors
    /// It cannot be opened.
    pub fn lens(&self, draw: &Draw) -> Result<Arc<ArrayLens>> {
        let key = (draw.lens, draw.focus_m.map(f64::to_bits));
        let mut open = self.open.lock().expect("no panic while held");
        if let Some(at) = open.iter().position(|(known, _)| *known == key) {
            let known = open.remove(at);
            let lens = Arc::clone(&known.1);
            open.push(known);
            return Ok(lens);
        }
        let mut flags = self.lens_flags(draw.lens, draw.focus_m);
        let mut lens = self.opened(&flags, draw.lens)?;
        if let (true, Some(reach_mm)) = (lens.is_symmetric_design(), self.reach_mm) {
            flags.push(format!("--reach-mm={reach_mm}"));
            lens = self.opened(&flags, draw.lens)?;
        }
        let lens = Arc::new(lens);
        if open.len() == MAX_OPEN {
            open.remove(0);
        }
        open.push((key, Arc::clone(&lens)));
        Ok(lens)
    }

    /// Lenses times distances in focus, at most.
    fn states(&self) -> usize {
        let distances = match &self.recipe.lens.focus_m {
            None => 1,
            Some(Numbers::List(values)) => values.len(),
            Some(Numbers::Range(_)) => MAX_OPEN,
        };
        self.names.len() * distances
    }

    /// Where the film of `size` of a sample lies: its chart has a margin, and its centre is what the film's centre sees.
    ///
    /// # Errors
    /// The place lies beyond the field of the lens.
    pub fn placement(&self, lens: &ArrayLens, draw: &Draw, film: Size, label_nm: f64) -> Result<Placement> {
        let margin = 2 * self.recipe.film.margin_px;
        let center_mm = draw.center_mm;
        let chart_center_mm = match center_mm == [0.0; 2] {
            true => center_mm,
            false => lens.chart_of_film(&[center_mm], label_nm)?[0],
        };
        let chart = Size::new(film.height + margin, film.width + margin);
        Ok(Placement { film, chart, pitch_um: self.recipe.film.pitch_um, center_mm, chart_center_mm })
    }

    /// Flags of `lenscube run` for the film of a sample, in the recipe's folder.
    pub fn run_flags(&self, lens: &ArrayLens, draw: &Draw, place: &Placement) -> Vec<String> {
        let mut flags = vec![format!("--lens={}", self.name(draw.lens))];
        flags.extend(draw.focus_m.map(|m| format!("--focus-m={m}")));
        let from_folder = |flag: &String| flag.replacen(&format!("={}/", self.folder.display()), "=", 1);
        flags.extend(self.flags.iter().map(from_folder));
        let reach_mm = self.reach_mm.filter(|_| lens.is_symmetric_design());
        flags.extend(reach_mm.map(|mm| format!("--reach-mm={mm}")));
        flags.extend(place.flags());
        flags
    }

    /// The film of a placement, with all stages, or with distortion alone.
    ///
    /// # Errors
    /// Every error of `lenscube run` before its first pixel.
    pub fn film(&self, lens: &ArrayLens, place: &Placement, clean: bool) -> Result<Arc<ArrayFilm>> {
        let mut flags = place.flags();
        if clean {
            flags.push("--stages=distortion".into());
        }
        lens.film(place.chart, &flags)
    }
}

/// Distance of the farthest corner of a film of `recipe` from the axis, mm.
fn reach_mm(recipe: &Recipe) -> Option<f64> {
    let [width, height] = recipe.pictures.size?;
    let half_mm = 0.5e-3 * recipe.film.pitch_um * pipeline::real::hypot(width as f64, height as f64);
    let farthest = match (&recipe.film.center_mm, &recipe.film.radius_mm) {
        (Some(places), _) => places.iter().map(|[x, y]| pipeline::real::hypot(*x, *y)).fold(0.0, f64::max),
        (None, Some(Numbers::List(radii))) => radii.iter().copied().fold(0.0, f64::max),
        (None, Some(Numbers::Range(range))) => range.to,
        (None, None) => 0.0,
    };
    Some(farthest + half_mm)
}

/// A lens of the recipe: a file in `folder`, or a name.
fn located(name: &str, folder: &Path) -> String {
    let path = folder.join(name);
    match path.exists() && !crate::open::is_builtin(name) {
        true => path.display().to_string(),
        false => name.to_owned(),
    }
}

/// Whether the value of a flag names a file in `folder`.
fn is_file(id: &str, value: &str, folder: &Path) -> bool {
    ["glass_catalog", "coatings", "tolerances", "sensor_reflectance"].contains(&id)
        && folder.join(value).is_file()
}

/// Files of the lenses of `recipe` in `folder`.
pub fn files(recipe: &Recipe, folder: &Path) -> Vec<PathBuf> {
    let lenses =
        recipe.lens.name.0.iter().filter(|name| !crate::open::is_builtin(name)).map(|name| folder.join(name));
    let of_flag = |(name, value): (&String, &Flag)| match value {
        Flag::Text(v) if is_file(&name.replace('-', "_"), v, folder) => Some(folder.join(v)),
        _ => None,
    };
    lenses.filter(|path| path.exists()).chain(recipe.lens.flags.iter().filter_map(of_flag)).collect()
}
