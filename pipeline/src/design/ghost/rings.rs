//! Ghosts of a whole scene as one linear operator: rings of the scene to rings of the film, for each azimuthal order.
//!
//! A lens is symmetric about its axis, so that a source turned by an angle has its ghosts turned by that angle. With S(i, φ) the power of ring i of the ideal image and
//! S_m its Fourier series over the azimuth φ,
//! ```text
//! V_m(j) = Σ_i G_m(j, i) S_m(i),     G_m(j, i) = Σ_rays from ring i  w · share_j(R) · cos(m Θ) · g_m,     m = 0 … M, M = 1.5 N
//! ```
//! R distance from the axis where a ray lands, Θ its azimuth less that of its source, share_j linear between the two rings about R; beyond the last ring light is dropped. G is real: each
//! ray has its mirror image. Σ_j G_0(j, i) is the light of ring i that lands on the film. Rings have the radii (i + ½) Δ, Δ = corner/N, of ideal height for the source, to 1.25 times the
//! corner, of real height on the film.
//!
//! g_m is Jackson's kernel: the azimuthal series ends at M, and without it light beside a bright spot would turn negative. It widens spots by π/M of their distance from the axis (rms),
//! 2 rings at the corner.
//! Sources: Jackson, The Theory of Approximation (1930), I.2; Hullin et al., ACM Trans. Graph. 30, 108 (2011), for grids of rays.

use std::f64::consts::PI;

use crate::real;

/// Share of the film's corner to which the scene's rings reach.
pub const SOURCE_REACH: f64 = 1.25;
/// Azimuths of a ring per ring of the film.
const AZIMUTHS_PER_RING: usize = 8;
/// Power of the central ring over the density there and 2π Δ² · ½: by linear shares it also has light of the ring about it.
const CENTRAL: f64 = 13.0 / 24.0;

/// Sizes of a ring operator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RingSizes {
    /// Width of a ring, mm.
    pub ring_mm: f64,
    /// Rings of the film.
    pub rings: usize,
    /// Rings of the scene.
    pub source_rings: usize,
}

impl RingSizes {
    /// `rings` rings to the film's corner.
    pub fn new(corner_mm: f64, rings: usize) -> Self {
        let source_rings = (SOURCE_REACH * rings as f64).ceil() as usize;
        Self { ring_mm: corner_mm / rings as f64, rings, source_rings }
    }

    /// Numbers of an operator: orders, rings of the film, rings of the scene.
    pub fn shape(&self) -> [usize; 3] {
        [self.orders() + 1, self.rings, self.source_rings]
    }

    /// Radius of the last ring's outer edge, the film's corner, mm.
    pub fn corner_mm(&self) -> f64 {
        self.ring_mm * self.rings as f64
    }

    /// Azimuthal orders above 0: M.
    pub fn orders(&self) -> usize {
        3 * self.rings / 2
    }

    /// Azimuths of rings of scene and film.
    pub fn azimuths(&self) -> usize {
        AZIMUTHS_PER_RING * self.rings
    }

    /// Radius of ring `i`, mm.
    pub fn radius_mm(&self, i: usize) -> f64 {
        (i as f64 + 0.5) * self.ring_mm
    }

    /// The ring at or below the radius `r_mm`, and the share of the next one.
    pub(super) fn about(&self, r_mm: f64) -> (usize, f64) {
        let at = (r_mm / self.ring_mm - 0.5).max(0.0);
        let low = at as usize;
        (low, at - low as f64)
    }

    /// Area that stands for ring `i` in a density, mm².
    pub(super) fn area_mm2(&self, i: usize) -> f64 {
        let radius = if i == 0 { CENTRAL } else { i as f64 + 0.5 };
        2.0 * PI * radius * self.ring_mm * self.ring_mm
    }
}

/// The operator of one wavelength.
#[derive(Clone, Debug, PartialEq)]
pub struct RingOperator {
    /// Sizes.
    pub sizes: RingSizes,
    /// G_m(j, i): order, ring of the film, ring of the scene.
    pub values: Vec<f32>,
}

/// Power on the rings of a scene or a film: ring, azimuth.
#[derive(Clone, Debug, PartialEq)]
pub struct RingPower {
    /// Azimuths of each ring.
    pub azimuths: usize,
    /// Power, azimuth as the fast index.
    pub power: Vec<f64>,
}

impl RingPower {
    /// No power on `rings` rings.
    pub fn dark(rings: usize, azimuths: usize) -> Self {
        Self { azimuths, power: vec![0.0; rings * azimuths] }
    }

    /// Adds `power` at (x, y) in mm, shared between the rings and azimuths about it; dropped beyond the last ring.
    pub fn add(&mut self, sizes: &RingSizes, (x_mm, y_mm): (f64, f64), power: f64) {
        let (ring, share) = sizes.about((x_mm * x_mm + y_mm * y_mm).sqrt());
        let turn = real::atan2(y_mm, x_mm) / (2.0 * PI) * self.azimuths as f64;
        let turn = if turn < 0.0 { turn + self.azimuths as f64 } else { turn };
        let azimuth = turn as usize;
        let part = turn - azimuth as f64;
        for (ring, share) in [(ring, 1.0 - share), (ring + 1, share)] {
            for (azimuth, part) in [(azimuth, 1.0 - part), (azimuth + 1, part)] {
                let at = ring * self.azimuths + azimuth % self.azimuths;
                if let Some(sum) = self.power.get_mut(at) {
                    *sum += power * share * part;
                }
            }
        }
    }

    /// Power per mm² at (x, y) in mm, bilinear over rings and azimuths; the last ring's beyond it.
    pub fn density(&self, sizes: &RingSizes, (x_mm, y_mm): (f64, f64)) -> f64 {
        let rings = self.power.len() / self.azimuths;
        let r = (x_mm * x_mm + y_mm * y_mm).sqrt();
        let turn = real::atan2(y_mm, x_mm) / (2.0 * PI) * self.azimuths as f64;
        let turn = if turn < 0.0 { turn + self.azimuths as f64 } else { turn };
        let on_ring = |ring: usize, turn: f64| {
            let azimuth = turn as usize;
            let part = turn - azimuth as f64;
            let value = |a: usize| self.power[ring * self.azimuths + a % self.azimuths];
            let power = (1.0 - part) * value(azimuth) + part * value(azimuth + 1);
            power * self.azimuths as f64 / sizes.area_mm2(ring)
        };
        let at = r / sizes.ring_mm - 0.5;
        if at < 0.0 {
            // Between the innermost ring and its other side.
            let other = on_ring(0, turn + 0.5 * self.azimuths as f64);
            return (1.0 + at) * on_ring(0, turn) - at * other;
        }
        let low = (at as usize).min(rings - 1);
        let high = (low + 1).min(rings - 1);
        let share = (at - low as f64).min(1.0);
        (1.0 - share) * on_ring(low, turn) + share * on_ring(high, turn)
    }
}

/// Jackson's kernel: g_0 = 1 … g_M.
pub(super) fn jackson(orders: usize) -> Vec<f64> {
    let n = orders as f64 + 1.0;
    let angle = PI / (n + 1.0);
    let cotangent = real::cos(angle) / real::sin(angle);
    (0..=orders)
        .map(|m| {
            let m = m as f64;
            ((n - m + 1.0) * real::cos(m * angle) + real::sin(m * angle) * cotangent) / (n + 1.0)
        })
        .collect()
}

/// Most light of ghosts of a ring, over that of its image: a uniform scene through uncoated germanium has less.
const MOST_LIGHT: f64 = 100.0;

impl RingOperator {
    /// Checks values that were stored: finite, and those of each order at most those of order 0, which are light.
    ///
    /// # Errors
    /// What is wrong.
    pub fn check(&self) -> Result<(), String> {
        let RingSizes { rings, source_rings, .. } = self.sizes;
        let light = &self.values[..rings * source_rings];
        for (at, v) in self.values.iter().enumerate() {
            let most = f64::from(light[at % light.len()]);
            // Rounded to f32.
            let is_within = f64::from(*v).abs() <= most * (1.0 + 1e-5) + 1e-12;
            if !is_within {
                let (order, rest) = (at / light.len(), at % light.len());
                let (ring, source) = (rest / source_rings, rest % source_rings);
                return Err(format!(
                    "{v} at order {order}, ring {ring} of the film and {source} of the scene, expected at most the light of order 0, {most}"
                ));
            }
        }
        match (0..source_rings).map(|ring| (ring, self.share(ring))).find(|(_, share)| *share > MOST_LIGHT) {
            Some((ring, share)) => Err(format!(
                "ghosts of ring {ring} of the scene have {share} times the light of its image, expected at most {MOST_LIGHT}"
            )),
            None => Ok(()),
        }
    }

    /// (1 − `share`) of this operator and `share` of `next`, of the same sizes.
    ///
    /// # Panics
    /// Other sizes.
    #[must_use]
    pub fn towards(&self, next: &Self, share: f64) -> Self {
        assert_eq!(self.sizes, next.sizes);
        let mean = |(a, b): (&f32, &f32)| (f64::from(*a) + share * (f64::from(*b) - f64::from(*a))) as f32;
        Self { sizes: self.sizes, values: self.values.iter().zip(&next.values).map(mean).collect() }
    }

    /// The operator of the columns (order, ring of the film) of each ring of the scene.
    pub(super) fn of_columns(sizes: RingSizes, columns: &[&[f64]]) -> Self {
        let rows = (sizes.orders() + 1) * sizes.rings;
        let values = (0..rows).flat_map(|row| columns.iter().map(move |column| column[row] as f32)).collect();
        Self { sizes, values }
    }

    /// Light of ring `ring` of the scene that lands on the film: Σ_j G_0(j, i).
    pub fn share(&self, ring: usize) -> f64 {
        let RingSizes { rings, source_rings, .. } = self.sizes;
        (0..rings).map(|j| f64::from(self.values[j * source_rings + ring])).sum()
    }

    /// Power on the film's rings of the power `scene` on the scene's.
    pub fn apply(&self, scene: &RingPower) -> RingPower {
        let RingSizes { rings, source_rings, .. } = self.sizes;
        let azimuths = scene.azimuths;
        let wave: Vec<(f64, f64)> = (0..azimuths)
            .map(|k| real::sin_cos(2.0 * PI * k as f64 / azimuths as f64))
            .map(|(s, c)| (c, s))
            .collect();
        let mut film = RingPower::dark(rings, azimuths);
        for m in 0..=self.sizes.orders() {
            let series = |ring: usize| {
                let values = &scene.power[ring * azimuths..(ring + 1) * azimuths];
                values.iter().enumerate().fold((0.0, 0.0), |(c, s), (k, v)| {
                    let (cos, sin) = wave[k * m % azimuths];
                    (c + v * cos, s + v * sin)
                })
            };
            let sources: Vec<(f64, f64)> = (0..source_rings).map(series).collect();
            // Order m and its conjugate.
            let scale = if m == 0 { 1.0 } else { 2.0 } / azimuths as f64;
            for j in 0..rings {
                let row = &self.values[(m * rings + j) * source_rings..][..source_rings];
                let (c, s) = row
                    .iter()
                    .zip(&sources)
                    .fold((0.0, 0.0), |(c, s), (g, v)| (c + f64::from(*g) * v.0, s + f64::from(*g) * v.1));
                let out = &mut film.power[j * azimuths..(j + 1) * azimuths];
                for (k, out) in out.iter_mut().enumerate() {
                    let (cos, sin) = wave[k * m % azimuths];
                    *out += scale * (c * cos + s * sin);
                }
            }
        }
        film
    }
}

#[cfg(test)]
mod tests {
    use super::super::sums::RingSums;
    use super::*;

    /// A ghost that turns the image through the axis and blurs it to a disc.
    fn turned(sizes: RingSizes) -> RingOperator {
        let golden = PI * (3.0 - 5.0_f64.sqrt());
        let column = |ring: usize| {
            let mut sums = RingSums::new(sizes, 1);
            for k in 0..1500 {
                let k = f64::from(k) + 0.5;
                let (sin, cos) = (k * golden).sin_cos();
                let rho = 2.0 * (k / 1500.0).sqrt();
                sums.add((-1.1 * sizes.radius_mm(ring) + rho * cos, rho * sin), &[1e-3 / 1500.0]);
            }
            sums.orders(0)
        };
        let columns: Vec<Vec<f64>> = (0..sizes.source_rings).map(column).collect();
        RingOperator::of_columns(sizes, &columns.iter().map(Vec::as_slice).collect::<Vec<_>>())
    }

    fn near(found: f64, expected: f64, tolerance: f64) {
        assert!((found - expected).abs() <= tolerance, "{found} instead of {expected}");
    }

    #[test]
    fn scene_of_two_sources_equals_a_direct_sum_and_turns_with_it() {
        let sizes = RingSizes { ring_mm: 0.25, rings: 80, source_rings: 80 };
        let operator = turned(sizes);
        let azimuths = sizes.azimuths();
        let mut scene = RingPower::dark(80, azimuths);
        let sources: Vec<(f64, f64, f64)> = (0..4)
            .flat_map(|r| (0..6).map(move |c| (f64::from(20 + c) - 48.0, f64::from(60 + r) - 48.0, 1.0)))
            .chain([(70.0 - 48.0, 30.0 - 48.0, 9.0)])
            .map(|(x, y, power)| (0.25 * x, 0.25 * y, power * 0.0625))
            .collect();
        for (x, y, power) in &sources {
            scene.add(&sizes, (*x, *y), *power);
        }
        let total: f64 = sources.iter().map(|s| s.2).sum();
        near(scene.power.iter().sum(), total, 1e-13 * total);
        let film = operator.apply(&scene);
        // All of it lands within the rings: the share 10⁻³, to the rounding of the stored values.
        near(film.power.iter().sum::<f64>() / (1e-3 * total), 1.0, 1e-6);
        assert!(film.power.iter().all(|v| *v > -1e-12 * total));
        // A direct sum, in blocks of 4 rings and 1/16 turn.
        let mut direct = RingPower::dark(80, azimuths);
        let golden = PI * (3.0 - 5.0_f64.sqrt());
        for (x, y, power) in &sources {
            for k in 0..1500 {
                let k = f64::from(k) + 0.5;
                let (sin, cos) = (k * golden).sin_cos();
                let rho = 2.0 * (k / 1500.0).sqrt();
                direct.add(&sizes, (-1.1 * x + rho * cos, -1.1 * y + rho * sin), power * 1e-3 / 1500.0);
            }
        }
        let blocks = |power: &RingPower| {
            let mut blocks = vec![0.0; 20 * 16];
            for (at, v) in power.power.iter().enumerate() {
                blocks[at / azimuths / 4 * 16 + at % azimuths * 16 / azimuths] += v;
            }
            blocks
        };
        let (found, expected) = (blocks(&film), blocks(&direct));
        let l1: f64 = std::iter::zip(&found, &expected).map(|(a, b)| (a - b).abs()).sum();
        let l1 = l1 / expected.iter().sum::<f64>();
        assert!(l1 < 0.06, "{l1}");
        // Turned by five azimuths.
        let turn = |power: &RingPower| RingPower {
            azimuths,
            power: power
                .power
                .chunks(azimuths)
                .flat_map(|ring| {
                    let mut r = ring.to_vec();
                    r.rotate_right(5);
                    r
                })
                .collect(),
        };
        let (a, b) = (operator.apply(&turn(&scene)), turn(&film));
        let largest = b.power.iter().copied().fold(0.0, f64::max);
        for (a, b) in std::iter::zip(&a.power, &b.power) {
            near(*a, *b, 1e-12 * largest);
        }
    }

    #[test]
    fn even_density_on_the_rings_is_read_as_it_was_put_on_them() {
        let sizes = RingSizes { ring_mm: 0.5, rings: 24, source_rings: 30 };
        let mut even = RingPower::dark(24, sizes.azimuths());
        let step = 0.02;
        for i in -700..700 {
            for j in -700..700 {
                let at = ((f64::from(i) + 0.5) * step, (f64::from(j) + 0.5) * step);
                even.add(&sizes, at, 3.0 * step * step);
            }
        }
        // The mean over the azimuth: near the axis steps of 0.02 mm are wider than an azimuth.
        for r in [1e-3, 0.1, 0.3, 0.8, 2.2, 11.7] {
            let at = |k: i32| (f64::from(k) * PI / 96.0).sin_cos();
            let mean =
                (0..192).map(|k| even.density(&sizes, (r * at(k).1, r * at(k).0))).sum::<f64>() / 192.0;
            near(mean, 3.0, 0.02);
        }
    }

    #[test]
    fn kernel_of_jackson_is_nowhere_negative() {
        let g = jackson(96);
        assert_eq!(g[0], 1.0);
        for k in 0..2000 {
            let angle = PI * f64::from(k) / 2000.0;
            let value: f64 = 1.0 + 2.0 * (1..=96).map(|m| g[m] * (m as f64 * angle).cos()).sum::<f64>();
            assert!(value > -1e-12, "{value} at {angle}");
        }
        // Its width: cos of an angle of π/M.
        near(g[1], real::cos(PI / 98.0), 1e-12);
    }

    #[test]
    fn operators_between_two_have_their_weighted_light() {
        let of = |values: [f32; 2]| {
            let sizes = RingSizes::new(3.0, 16);
            let per_order = sizes.rings * sizes.source_rings;
            let values =
                (0..sizes.orders() + 1).flat_map(|order| vec![values[order.min(1)]; per_order]).collect();
            RingOperator { sizes, values }
        };
        let (first, next) = (of([4e-4, -2e-4]), of([8e-4, 6e-4]));
        assert_eq!(first.towards(&next, 0.0), first);
        assert_eq!(first.towards(&next, 1.0), next);
        let between = first.towards(&next, 0.25);
        assert_eq!(between.check(), Ok(()));
        assert!((between.share(3) - 16.0 * 5e-4).abs() < 1e-9, "{}", between.share(3));
        assert!(between.values.last().unwrap().abs() < 1e-10);
        assert_eq!(of([4e-4, 4e-4]).check(), Ok(()));
        // An order above the light, negative light, no numbers, more light than ghosts have.
        for wrong in [[4e-4, 5e-4], [-4e-4, 0.0], [4e-4, f32::NAN], [f32::INFINITY, 0.0], [10.0, 0.0]] {
            assert!(of(wrong).check().is_err(), "{wrong:?}");
        }
    }
}
