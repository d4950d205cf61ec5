//! The sheets of a pixel: the rule for its samples, and the light that they keep.

use super::super::pixel::{PixelSheets, PixelSurfaces};
use super::*;

/// [`OfPart`], whose weights are known to be the same everywhere.
struct EvenOfPart<'a>(OfPart<'a>);

impl Shader for EvenOfPart<'_> {
    fn bases(&self) -> usize {
        3
    }
    fn is_opaque(&self, _: u32) -> bool {
        true
    }
    fn exists(&self, _: u32, _: &SampleHit, _: usize) -> bool {
        true
    }
    fn even_weights(&self, triangle: u32, weights: &mut [f64]) -> bool {
        weights[self.0.0.part_of(triangle).0 % 3] = 1.0;
        true
    }
    fn add_weights(&self, triangle: u32, hits: &[SampleHit], sums: &mut [f64]) {
        self.0.add_weights(triangle, hits, sums);
    }
}

#[test]
fn pixels_of_one_kind_have_the_sheets_of_the_rule() {
    // Walls one behind the other, balls in them, and triangles of about a pixel, against the rule for one pixel.
    let shapes = vec![
        wall(3.0),
        icosphere([0.01, 0.0, 1.0], 0.015, 4),
        icosphere([-0.01, 0.01, 1.5], 0.02, 1),
        wall(2.0),
        wall(2.001),
        icosphere([0.0, 0.02, 2.5], 0.02, 4),
    ];
    for options in [OPTIONS, MeshOptions { solids: false, ..OPTIONS }] {
        let mesh = mesh(shapes.clone(), options);
        for samples in [1, 4, 16, 64] {
            let (shader, even) = (OfPart(&mesh), EvenOfPart(OfPart(&mesh)));
            let settings = settings(samples, 3);
            let of =
                |shader| Renderer::new(&mesh, FRAME, shader, settings.clone(), Engine::detect()).unwrap();
            let (renderer, of_even) = (of(&shader), of(&even));
            let mut worker = renderer.worker();
            let (front, hidden) = renderer.all(0, &mut worker);
            assert_eq!((front.clone(), hidden.clone()), of_even.all(0, &mut worker));
            let (front_alone, hidden_alone) = (of_even.front(0, &mut worker), of_even.hidden(0, &mut worker));
            assert_eq!((&front_alone.sheet, front_alone.has_edge), (&front.sheet, front.has_edge));
            assert_eq!(hidden_alone.0, hidden);
            assert_eq!(hidden_alone.1.hidden_samples, front.counts.hidden_samples);
            assert_eq!(hidden_alone.1.hidden_back_samples, front.counts.hidden_back_samples);
            let mut all = vec![vec![Vec::new(); samples]; 4096];
            renderer.surfaces(0, &mut worker, |row, column, sample, found| {
                all[row * 64 + column][sample] = found.to_vec();
            });
            let (mut made, mut surfaces) = (PixelSheets::default(), PixelSurfaces::default());
            for (at, of_pixel) in all.iter().enumerate() {
                surfaces.clear();
                for of_sample in of_pixel {
                    of_sample.iter().for_each(|s| surfaces.push(s.0));
                    surfaces.end_sample();
                }
                made.compute(&surfaces, 3, settings.gap_dioptre, true);
                let flat: Vec<u32> = of_pixel.iter().flatten().map(|s| s.1).collect();
                for (q, sheet) in std::iter::once(&front.sheet).chain(&hidden).enumerate() {
                    let Some(expected) = made.sheets().get(q) else {
                        assert_eq!((sheet.coverage[at], sheet.depth[at]), (0.0, 0.0), "{samples} {at} {q}");
                        continue;
                    };
                    assert_eq!(sheet.coverage[at], expected.coverage as f32, "{samples} {at} {q}");
                    assert_eq!(sheet.depth[at], (1.0 / expected.vergence) as f32, "{samples} {at} {q}");
                    let members = made.members(expected);
                    for basis in 0..3 {
                        let of_basis = |m: &&(u32, usize)| mesh.part_of(flat[m.1]).0 % 3 == basis;
                        let weight = members.iter().filter(of_basis).count() as f64 / members.len() as f64;
                        assert_eq!(sheet.weights[basis * 4096 + at], weight as f32, "{samples} {at} {q}");
                    }
                }
            }
        }
    }
}

#[test]
fn the_sheets_in_their_order_give_what_the_samples_see_first() {
    let mut random = Random(4);
    let (mut made, mut surfaces) = (PixelSheets::default(), PixelSurfaces::default());
    let mut merged = 0;
    for round in 0..20_000 {
        surfaces.clear();
        let n = [1, 4, 16, 64][round % 4];
        for _ in 0..n {
            let mut of: Vec<f64> = (0..(random.next() * 4.0) as usize)
                .map(|_| (random.next() * 5.0).floor() + random.next() * 0.3)
                .collect();
            of.sort_by(|a, b| b.total_cmp(a));
            of.iter().for_each(|&v| surfaces.push(v));
            surfaces.end_sample();
        }
        let sheets = round % 3 + 1;
        made.compute(&surfaces, sheets, 0.1, true);
        assert!(made.sheets().len() <= sheets);
        // The weight of a surface is a function of its number.
        let weight = |surface: usize| 0.1 + (surface % 7) as f64;
        let (mut open, mut light) = (1.0, 0.0);
        for sheet in made.sheets() {
            let members = made.members(sheet);
            let mean = members.iter().map(|m| weight(m.1)).sum::<f64>() / members.len() as f64;
            light += open * sheet.coverage * mean;
            open *= 1.0 - sheet.coverage;
            assert!(sheet.coverage > 0.0 && sheet.coverage <= 1.0);
        }
        let seen: f64 = (0..n).filter_map(|i| surfaces.of(i).next()).map(weight).sum::<f64>() / n as f64;
        assert!((light - seen).abs() <= 1e-14 * (1.0 + seen), "{light} {seen}");
        merged += usize::from(made.late() > 0);
    }
    assert!(merged > 1000);
}

#[test]
fn stored_sheets_keep_the_light_of_the_first_surfaces() {
    let mut random = Random(5);
    let corners = (0..300)
        .map(|_| [random.between(-0.06, 0.06), random.between(-0.06, 0.06), random.between(0.9, 1.4)]);
    let shapes: Vec<Shape> =
        corners.collect::<Vec<_>>().chunks(3).map(|c| (c.to_vec(), vec![[0, 1, 2]])).collect();
    let mesh = mesh(shapes, OPTIONS);
    let shader = OfPart(&mesh);
    for sheets in [1, 3] {
        let renderer = Renderer::new(&mesh, FRAME, &shader, settings(16, sheets), Engine::detect()).unwrap();
        let mut worker = renderer.worker();
        let mut seen = vec![[0.0; 3]; 4096];
        renderer.surfaces(0, &mut worker, |row, column, _, found| {
            if let Some(first) = found.first() {
                seen[row * 64 + column][mesh.part_of(first.1).0 % 3] += 1.0 / 16.0;
            }
        });
        let (front, hidden) = renderer.all(0, &mut worker);
        assert!(front.counts.merged_pixels > 0);
        for (at, seen) in seen.iter().enumerate() {
            let (mut open, mut light) = (1.0, [0.0; 3]);
            for sheet in std::iter::once(&front.sheet).chain(&hidden) {
                let c = f64::from(sheet.coverage[at]);
                (0..3).for_each(|b| light[b] += open * c * f64::from(sheet.weights[b * 4096 + at]));
                open *= 1.0 - c;
            }
            assert!((0..3).all(|b| (light[b] - seen[b]).abs() <= 3e-7), "{light:?} {seen:?}");
        }
    }
}
