//! Golden scenes of `golden/make_scene_golden.py`: surfaces, coverage and number of sheets bit for bit, distances and weights to one unit in the
//! last place. `SCENE_GOLDEN=FOLDER` reads another folder, such as one made with `--full`.

use lenscube_pipeline::scene::description::{AlphaMode, Geometry, Material, Part, Positions};
use lenscube_pipeline::scene::frame::Frame;
use lenscube_pipeline::scene::mesh::{Mesh, MeshOptions};
use lenscube_pipeline::scene::pose::Pose;
use lenscube_pipeline::scene::shading::{SampleHit, Shader};
use lenscube_pipeline::scene::sheets::{Background, Renderer, Settings, Sheet};
use lenscube_pipeline::scene::visibility::Engine;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// An array of a golden file as bytes of its elements.
struct Array {
    shape: Vec<usize>,
    bytes: Vec<u8>,
}

impl Array {
    /// The next array in the format of `numpy.save`.
    fn take(from: &mut &[u8]) -> Self {
        let length = usize::from(u16::from_le_bytes([from[8], from[9]]));
        let header = std::str::from_utf8(&from[10..10 + length]).unwrap();
        let between = |a: &str, b: char| header.split(a).nth(1).unwrap().split(b).next().unwrap();
        assert!(header.contains("'fortran_order': False"), "{header}");
        let size: usize = between("'descr': '<", '\'')[1..].parse().unwrap();
        let shape: Vec<usize> =
            between("'shape': (", ')').split(',').filter_map(|n| n.trim().parse().ok()).collect();
        let bytes = shape.iter().product::<usize>() * size;
        let array = Self { shape, bytes: from[10 + length..][..bytes].to_vec() };
        *from = &from[10 + length + bytes..];
        array
    }

    fn values<const N: usize, T>(&self, of: impl Fn([u8; N]) -> T) -> Vec<T> {
        self.bytes.as_chunks::<N>().0.iter().map(|b| of(*b)).collect()
    }
}

struct ByMaterial {
    of_triangle: Vec<usize>,
    materials: Vec<([f64; 3], Material)>,
}

impl Shader for ByMaterial {
    fn bases(&self) -> usize {
        3
    }

    fn is_opaque(&self, triangle: u32) -> bool {
        self.materials[self.of_triangle[triangle as usize]].1.alpha_mode == AlphaMode::Opaque
    }

    fn exists(&self, triangle: u32, hit: &SampleHit, samples: usize) -> bool {
        let number = self.of_triangle[triangle as usize];
        let material = &self.materials[number].1;
        let place = (f64::from(hit.sample) + 0.5) / samples as f64 + number as f64 * 0.618_033_988_749_894_9;
        match material.alpha_mode {
            AlphaMode::Opaque => true,
            AlphaMode::Mask(cutoff) => material.alpha >= cutoff,
            AlphaMode::Blend => f64::from(material.alpha) > place % 1.0,
        }
    }

    fn add_weights(&self, triangle: u32, hits: &[SampleHit], sums: &mut [f64]) {
        let weights = self.materials[self.of_triangle[triangle as usize]].0;
        for hit in hits {
            assert!(hit.barycentric.iter().all(|b| (0.0..=1.0).contains(b)) && hit.vergence > 0.0);
            sums.iter_mut().zip(weights).for_each(|(s, w)| *s += w);
        }
    }
}

/// One part per triangle, so that each has its material.
fn scene(materials: &Array, vertices: &Array, triangles: &Array) -> (Vec<Part>, ByMaterial) {
    let positions: Vec<[f32; 3]> = vertices.values(f32::from_le_bytes).as_chunks::<3>().0.to_vec();
    let of = materials.values(f32::from_le_bytes);
    let materials: Vec<([f64; 3], Material)> = of
        .as_chunks::<7>()
        .0
        .iter()
        .map(|&[r, g, b, two_sided, alpha, mode, cutoff]| {
            let alpha_mode = [AlphaMode::Opaque, AlphaMode::Mask(cutoff), AlphaMode::Blend][mode as usize];
            let two_sided = two_sided != 0.0;
            let material =
                Material { alpha, alpha_mode, two_sided, ..Material::matt(String::new(), [r, g, b]) };
            ([r, g, b].map(f64::from), material)
        })
        .collect();
    let rows = triangles.values(u16::from_le_bytes);
    let rows = rows.as_chunks::<4>().0;
    let mut parts = Vec::new();
    for &[a, b, c, material] in rows {
        let corners = [a, b, c].map(|v| positions[usize::from(v)]);
        let geometry = Geometry {
            positions: Positions::F32(corners.to_vec().into()),
            triangles: vec![[0, 1, 2]].into(),
            ..Geometry::default()
        };
        let identity = std::array::from_fn(|i| std::array::from_fn(|k| f64::from(u8::from(i == k))));
        parts.push(Part {
            name: "part".into(),
            node: 0,
            to_world: identity,
            geometry: Arc::new(geometry),
            material: usize::from(material),
        });
    }
    (parts, ByMaterial { of_triangle: rows.iter().map(|r| usize::from(r[3])).collect(), materials })
}

struct Digest(u64);

impl Digest {
    fn add(&mut self, word: u64) {
        self.0 = self.0.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(word);
    }
}

/// Digests of bands of 8 rows: surfaces, coverage, number of sheets.
fn digests(renderer: &Renderer<'_>, sheets: &[&Sheet]) -> Vec<[u64; 3]> {
    let mut bands: Vec<[Digest; 3]> = (0..8).map(|_| [Digest(0), Digest(0), Digest(0)]).collect();
    let mut worker = renderer.worker();
    renderer.surfaces(0, &mut worker, |row, _, _, of| {
        let digest = &mut bands[row / 8][0];
        digest.add(of.len() as u64);
        for &(vergence, triangle) in of {
            digest.add(vergence.to_bits());
            digest.add(u64::from(triangle));
        }
    });
    for at in 0..64 * 64 {
        let band = &mut bands[at / 64 / 8];
        sheets.iter().for_each(|s| band[1].add(u64::from(s.coverage[at].to_bits())));
        band[2].add(sheets.iter().filter(|s| s.coverage[at] > 0.0).count() as u64);
    }
    bands.into_iter().map(|band| band.map(|d| d.0)).collect()
}

/// Units in the last place between two positive numbers.
fn units_apart(a: f32, b: f32) -> u32 {
    a.to_bits().abs_diff(b.to_bits())
}

fn check(path: &Path) -> usize {
    let bytes = std::fs::read(path).unwrap();
    let mut bytes = &bytes[..];
    let settings = Array::take(&mut bytes).values(f64::from_le_bytes);
    let [pitch_mm, focal_mm, size, sheets, gap, solids, background, ..] = settings[..] else { panic!() };
    let [materials, vertices, triangles] = std::array::from_fn(|_| Array::take(&mut bytes));
    let (parts, shader) = scene(&materials, &vertices, &triangles);
    let materials: Vec<Material> = shader.materials.iter().map(|m| m.1.clone()).collect();
    let pose = Pose::looking([0.0; 3], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]).unwrap();
    let options = MeshOptions { unit_m: 1.0, solids: solids != 0.0, two_sided: false };
    let mesh = Mesh::new(&parts, &materials, &pose, options).unwrap();
    let frame = Frame::centred(size as usize, size as usize, pitch_mm, focal_mm);
    let mut compared = 0;
    for samples in [1, 4, 16] {
        let expected = Array::take(&mut bytes).values(u64::from_le_bytes);
        let values = Array::take(&mut bytes);
        let settings = Settings {
            samples,
            sheets: sheets as usize,
            gap_dioptre: gap,
            near_m: 0.0,
            is_near_cut: false,
            background: (!background.is_nan())
                .then(|| Background { vergence: background, weights: settings[7..10].to_vec() }),
        };
        for engine in Engine::available() {
            let renderer = Renderer::new(&mesh, frame.clone(), &shader, settings.clone(), engine).unwrap();
            let mut worker = renderer.worker();
            let (front, hidden) = renderer.all(0, &mut worker);
            let of: Vec<&Sheet> = std::iter::once(&front.sheet).chain(&hidden).collect();
            let place = format!("{} {samples} {}", path.display(), engine.name());
            let pixels = values.values(f32::from_le_bytes);
            for line in pixels.chunks_exact(values.shape[1]) {
                let at = line[0] as usize * 64 + line[1] as usize;
                for (sheet, expected) in of.iter().zip(line[2..].as_chunks::<5>().0) {
                    assert_eq!(sheet.coverage[at], expected[0], "{place}: {at}");
                    let w = [0, 1, 2].map(|b| sheet.weights[b * 64 * 64 + at]);
                    let got = [sheet.depth[at], w[0], w[1], w[2]];
                    let apart = got.iter().zip(&expected[1..]).map(|(a, b)| units_apart(*a, *b)).max();
                    assert!(apart <= Some(1), "{place}: pixel {at}: {got:?}, expected {expected:?}");
                    compared += 1;
                }
            }
            assert_eq!(digests(&renderer, &of).as_flattened(), expected, "{place}");
            // In two passes.
            let alone = renderer.front(0, &mut worker);
            assert_eq!((&alone.sheet, alone.has_edge), (&front.sheet, front.has_edge), "{place}");
            assert_eq!(format!("{:?}", alone.border), format!("{:?}", front.border), "{place}");
            assert_eq!(renderer.hidden(0, &mut worker).0, hidden, "{place}");
        }
    }
    assert!(bytes.is_empty());
    compared
}

#[test]
fn golden_scenes() {
    let folder = std::env::var_os("SCENE_GOLDEN").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/scene/golden/scenes"),
        PathBuf::from,
    );
    let mut paths: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    paths.retain(|p| p.extension().is_some_and(|e| e == "npy"));
    paths.sort();
    assert!(paths.len() >= 16, "{} scenes", paths.len());
    let compared: usize = paths.iter().map(|p| check(p)).sum();
    assert!(compared >= 16 * 3 * 40, "{compared} sheets of pixels");
}
