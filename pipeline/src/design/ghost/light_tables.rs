//! Light along many rays for several wavelengths at once: factors of [`light`](super::light) tabulated over the angle of incidence.
//!
//! Tables are over the cosine on the side of the lower index, where reflectances are smooth up to grazing incidence on either side, linear between 512 entries: 10⁻⁵ of the
//! light of a path. Totally reflected light is computed without a table.

use std::collections::BTreeMap;

use super::light::{Factors, GhostLight};
use super::path::{Act, Crossing};
use super::trace::Meeting;
use crate::real;

/// Wavelengths that are computed at once.
pub(super) const LANES: usize = 8;
const ENTRIES: usize = 512;
/// Cosine of grazing incidence.
const GRAZING: f64 = 1e-6;

type Lanes = [f32; LANES];
/// |a_s|², |a_p|², real and imaginary part of a_s a_p*, each for all wavelengths.
type Entry = [Lanes; 4];

/// Tables of a lens for up to [`LANES`] wavelengths.
pub(super) struct LightTables<'l> {
    lights: &'l [GhostLight],
    tables: BTreeMap<(usize, bool, bool), Vec<Entry>>,
}

/// The tables along a path.
pub(super) struct PathTables<'l, 'c> {
    lights: &'l [GhostLight],
    crossings: &'c [Crossing<'c>],
    tables: Vec<Option<&'l [Entry]>>,
}

impl<'l> LightTables<'l> {
    /// Tables of all surfaces that `paths` cross, for `lights`.
    pub(super) fn new<'c>(lights: &'l [GhostLight], paths: impl Iterator<Item = &'c [Crossing<'c>]>) -> Self {
        let mut tables = BTreeMap::new();
        for crossing in paths.flatten().filter(|c| needs_table(c)) {
            tables.entry(key(crossing)).or_insert_with(|| {
                (0..ENTRIES).map(|k| entry(lights, crossing, k as f64 / (ENTRIES - 1) as f64)).collect()
            });
        }
        Self { lights, tables }
    }

    /// Those along `crossings`.
    pub(super) fn along<'c>(&'l self, crossings: &'c [Crossing<'c>]) -> PathTables<'l, 'c> {
        let table = |c: &Crossing<'_>| self.tables.get(&key(c)).filter(|_| needs_table(c)).map(Vec::as_slice);
        PathTables { lights: self.lights, crossings, tables: crossings.iter().map(table).collect() }
    }
}

fn needs_table(crossing: &Crossing<'_>) -> bool {
    crossing.is_boundary && crossing.act != Act::Ideal
}

fn key(crossing: &Crossing<'_>) -> (usize, bool, bool) {
    (crossing.surface, crossing.is_backward, crossing.act == Act::Reflects)
}

/// Factors where the cosine on the side of the lower index is `outer`.
fn entry(lights: &[GhostLight], crossing: &Crossing<'_>, outer: f64) -> Entry {
    let outer = outer.max(GRAZING);
    let mut entry = [[0.0; LANES]; 4];
    for (lane, light) in lights.iter().enumerate() {
        let (n1, n2) = (light.indices[crossing.media.0], light.indices[crossing.media.1]);
        let cos = match n1 > n2 {
            true => (1.0 - (n2 / n1).powi(2) * (1.0 - outer * outer)).sqrt(),
            false => outer,
        };
        put(&mut entry, lane, light.factors(crossing, cos));
    }
    entry
}

fn put(entry: &mut Entry, lane: usize, factors: Factors) {
    let values = [factors.s, factors.p, factors.sp.re, factors.sp.im];
    for (row, value) in entry.iter_mut().zip(values) {
        row[lane] = value as f32;
    }
}

impl PathTables<'_, '_> {
    /// Shares of the light of a ray that are left on the film, for each wavelength.
    pub(super) fn weights(&self, meetings: &[Meeting]) -> [f64; LANES] {
        let last = self.crossings.len() - 1;
        let (mut s, mut p) = ([1.0_f64; LANES], [1.0_f64; LANES]);
        let (mut re, mut im) = ([0.0_f64; LANES], [0.0_f64; LANES]);
        let mut absorbed = [0.0_f64; LANES];
        for (index, (crossing, meeting)) in self.crossings.iter().zip(meetings).enumerate() {
            let length = meeting.length_mm.max(0.0);
            for (sum, light) in absorbed.iter_mut().zip(self.lights) {
                *sum += light.losses.absorption_per_mm[crossing.media.0] * length;
            }
            let Some(table) = self.tables[index].filter(|_| index < last) else { continue };
            let [cos, sin] = meeting.turn;
            if sin != 0.0 {
                let (cc, ss, cs) = (cos * cos, sin * sin, cos * sin);
                for k in 0..LANES {
                    let (a, b, c) = (s[k], p[k], re[k]);
                    s[k] = cc * a + ss * b + 2.0 * cs * c;
                    p[k] = ss * a + cc * b - 2.0 * cs * c;
                    re[k] = cs * (b - a) + (cc - ss) * c;
                }
            }
            let [fs, fp, fr, fi] = self.factors(table, crossing, meeting.cos);
            for k in 0..LANES {
                s[k] *= fs[k];
                p[k] *= fp[k];
                let (a, b) = (re[k], im[k]);
                re[k] = fr[k] * a - fi[k] * b;
                im[k] = fr[k] * b + fi[k] * a;
            }
        }
        std::array::from_fn(|k| match k < self.lights.len() {
            true if absorbed[k] == 0.0 => 0.5 * (s[k] + p[k]),
            true => 0.5 * (s[k] + p[k]) * real::exp(-absorbed[k]),
            false => 0.0,
        })
    }

    fn factors(&self, table: &[Entry], crossing: &Crossing<'_>, cos: f64) -> [[f64; LANES]; 4] {
        let (n1, n2) = crossing.indices;
        let outer2 = if n1 > n2 { 1.0 - (n1 / n2).powi(2) * (1.0 - cos * cos) } else { cos * cos };
        if outer2 < GRAZING * GRAZING {
            let mut entry = [[0.0; LANES]; 4];
            for (lane, light) in self.lights.iter().enumerate() {
                put(&mut entry, lane, light.factors(crossing, cos.max(GRAZING)));
            }
            return entry.map(|row| row.map(f64::from));
        }
        let at = outer2.sqrt().min(1.0) * (ENTRIES - 1) as f64;
        let k = (at as usize).min(ENTRIES - 2);
        let share = at - k as f64;
        let (low, high) = (&table[k], &table[k + 1]);
        std::array::from_fn(|row| {
            std::array::from_fn(|lane| {
                let (a, b) = (f64::from(low[row][lane]), f64::from(high[row][lane]));
                a + share * (b - a)
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::path::{GhostLens, ghost_paths};
    use super::super::test_lenses::*;
    use super::*;

    #[test]
    fn tabulated_light_is_that_of_each_ray() {
        for coating in coatings() {
            let coated =
                crate::design::prescription::coatings::Coatings { default: coating, surfaces: Vec::new() };
            let system = crate::design::System::double_gauss_28().with_coatings(&coated).unwrap();
            let apertures = Apertures::new(&system, 24.57).unwrap();
            let lens = GhostLens::new(&system, 0.54, &apertures).unwrap();
            let lights: Vec<GhostLight> =
                [0.54, 0.56].map(|um| GhostLight::new(&system, um, 0.1).unwrap()).to_vec();
            let (paths, _) = ghost_paths(&system, true);
            let crossings: Vec<_> = paths.iter().map(|p| lens.crossings(Some(*p))).collect();
            let tables = LightTables::new(&lights, crossings.iter().map(Vec::as_slice));
            let mut meetings = Vec::new();
            let mut rays = 0;
            for way in &crossings {
                let along = tables.along(way);
                for (tan, x, y) in [(0.0, 3.0, 4.0), (0.1, -5.0, 8.0), (0.24, 7.0, 12.0)] {
                    let Some(_) = lens.follow(way, lens.start(tan, x, y).0, &mut meetings) else { continue };
                    let found = along.weights(&meetings);
                    rays += 1;
                    // Near total reflection the angle outside differs from one wavelength to the next.
                    for ((light, found), tolerance) in lights.iter().zip(found).zip([1e-3, 1e-2]) {
                        let exact = light.weight(way, &meetings);
                        assert!((found - exact).abs() <= tolerance * exact + 1e-12, "{found:e} {exact:e}");
                    }
                    assert_eq!(found[2..], [0.0; LANES - 2]);
                }
            }
            assert!(rays > 60, "{rays}");
        }
    }
}
