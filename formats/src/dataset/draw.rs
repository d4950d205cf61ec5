//! What sample k is made of: every combination in order, or drawn at random.
//!
//! Random numbers are functions of the sample's number, the purpose and the seed ([`pipeline::sensor::random`], Philox4x32-10), so a sample is the same for
//! any number of samples, order, threads and interruption. A list is drawn from uniformly; the part of a picture lies anywhere in it.

use std::f64::consts::PI;

use pipeline::sensor::random::{Stream, uniform_of, word_of};

use super::recipe::Recipe;
use super::values::{Numbers, Range};

/// What a random number is for; the order is part of the data sets that exist.
#[derive(Clone, Copy)]
#[repr(u32)]
enum Purpose {
    Picture = 0,
    PartX = 1,
    PartY = 2,
    Lens = 3,
    Focus = 4,
    Place = 5,
    Radius = 6,
    Angle = 7,
    Sensor = 8,
    Exposure = 9,
    ExposureEv = 10,
    Gain = 11,
    Noise = 12,
}

/// What a sample is made of.
#[derive(Clone, Debug, PartialEq)]
pub struct Draw {
    /// Its number.
    pub sample: u64,
    /// Index of the picture.
    pub picture: usize,
    /// Place of the part in the picture, shares of the free rows and columns: (y, x).
    pub part: (f64, f64),
    /// Index of the lens.
    pub lens: usize,
    /// Object distance in focus, m.
    pub focus_m: Option<f64>,
    /// Centre of the film, (x, y) in mm from the axis.
    pub center_mm: [f64; 2],
    /// Index of the sensor.
    pub sensor: usize,
    /// Index of the exposure.
    pub exposure: usize,
    /// Further exposure, EV.
    pub exposure_ev: f64,
    /// Gain of the converter.
    pub gain: f64,
    /// Seed of the noise.
    pub noise_seed: u64,
}

/// The samples of a recipe for a number of pictures.
pub struct Draws<'a> {
    recipe: &'a Recipe,
    pictures: usize,
}

impl<'a> Draws<'a> {
    /// Those of `recipe`.
    pub fn new(recipe: &'a Recipe, pictures: usize) -> Self {
        Self { recipe, pictures }
    }

    /// Number of samples.
    pub fn count(&self) -> u64 {
        let product = || self.combinations().iter().fold(1u64, |all, n| all.saturating_mul(*n as u64));
        self.recipe.samples.unwrap_or_else(product)
    }

    /// Numbers of choices, the slowest first.
    fn combinations(&self) -> [usize; 10] {
        let Recipe { lens, film, sensor, .. } = self.recipe;
        let numbers = |n: Option<&Numbers>| match n {
            Some(Numbers::List(values)) => values.len(),
            _ => 1,
        };
        let of_sensor = |f: &dyn Fn(&super::recipe::SensorTable) -> usize| sensor.as_ref().map_or(1, f);
        [
            self.pictures,
            lens.name.0.len(),
            numbers(lens.focus_m.as_ref()),
            film.center_mm.as_ref().map_or_else(|| numbers(film.radius_mm.as_ref()), Vec::len),
            numbers(film.angle_deg.as_ref()),
            of_sensor(&|s| s.name.0.len()),
            of_sensor(&|s| s.exposure.0.len()),
            of_sensor(&|s| numbers(s.exposure_ev.as_ref())),
            of_sensor(&|s| numbers(s.gain.as_ref())),
            self.recipe.repeats as usize,
        ]
    }

    /// Sample `sample`.
    pub fn of(&self, sample: u64) -> Draw {
        let recipe = self.recipe;
        let uniform = |purpose: Purpose| uniform_of(counter(sample, purpose), recipe.seed);
        let sizes = self.combinations();
        let drawn = recipe.samples.is_some();
        // Index of choice `at` of the combinations.
        let index = |at: usize, purpose: Purpose| match drawn {
            true => ((uniform(purpose) * sizes[at] as f64) as usize).min(sizes[at] - 1),
            false => {
                let after = sizes[at + 1..].iter().fold(1u64, |all, n| all * *n as u64);
                (sample / after % sizes[at] as u64) as usize
            }
        };
        let number = |at: usize, purpose: Purpose, numbers: Option<&Numbers>| match numbers? {
            Numbers::List(values) => Some(values[index(at, purpose)]),
            Numbers::Range(range) => Some(range.at(uniform(purpose))),
        };
        let film = &recipe.film;
        let sensor = recipe.sensor.as_ref();
        Draw {
            sample,
            picture: index(0, Purpose::Picture),
            part: (uniform(Purpose::PartY), uniform(Purpose::PartX)),
            lens: index(1, Purpose::Lens),
            focus_m: number(2, Purpose::Focus, recipe.lens.focus_m.as_ref()),
            center_mm: match (&film.center_mm, &film.radius_mm) {
                (Some(places), _) => places[index(3, Purpose::Place)],
                (None, None) => [0.0; 2],
                (None, Some(radius)) => {
                    let r = match radius {
                        Numbers::List(values) => values[index(3, Purpose::Radius)],
                        Numbers::Range(range) => range.radius_at(uniform(Purpose::Radius)),
                    };
                    let turn = Numbers::Range(Range { from: 0.0, to: 360.0, log: false });
                    let degrees = number(4, Purpose::Angle, Some(film.angle_deg.as_ref().unwrap_or(&turn)));
                    let (sin, cos) = pipeline::real::sin_cos(degrees.unwrap_or_default() * PI / 180.0);
                    [r * cos, r * sin]
                }
            },
            sensor: index(5, Purpose::Sensor),
            exposure: index(6, Purpose::Exposure),
            exposure_ev: number(7, Purpose::ExposureEv, sensor.and_then(|s| s.exposure_ev.as_ref()))
                .unwrap_or(0.0),
            gain: number(8, Purpose::Gain, sensor.and_then(|s| s.gain.as_ref())).unwrap_or(1.0),
            noise_seed: word_of(counter(sample, Purpose::Noise), recipe.seed),
        }
    }
}

/// Counter of the random numbers of a sample.
fn counter(sample: u64, purpose: Purpose) -> [u32; 4] {
    [sample as u32, (sample >> 32) as u32, purpose as u32, Stream::Sample as u32]
}

#[cfg(test)]
mod tests;
