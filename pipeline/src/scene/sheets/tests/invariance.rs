//! The same sheets on any engine and thread, in two passes, and at any place of the world.

use super::*;
use crate::scene::mesh::tests::IDENTITY;
use crate::scene::pose::Pose;
use crate::scratch::Scratch;
use rayon::prelude::*;

#[test]
fn tiles_have_the_same_bits_on_any_engine_and_thread_and_in_two_passes() {
    let frame = Frame::centred(300, 330, 0.02, 50.0);
    let shapes = || {
        let ball = |k: usize| icosphere([k as f64 * 0.012 - 0.05, 0.01, 1.0 + k as f64 * 0.1], 0.011, 2);
        (0..8)
            .map(|k| if k % 3 == 0 { flipped(ball(k)) } else { ball(k) })
            .chain([wall(2.5)])
            .collect::<Vec<_>>()
    };
    let materials: Vec<_> = (0..9).map(|k| material(k % 2 == 0)).collect();
    let parts: Vec<_> = shapes().into_iter().enumerate().map(|(k, shape)| part(shape, k)).collect();
    let mesh = Mesh::new(&parts, &materials, &crate::scene::mesh::tests::pose(), OPTIONS).unwrap();
    let shader = OfPart(&mesh);
    let of = |engine: Engine| Renderer::new(&mesh, frame.clone(), &shader, settings(4, 3), engine).unwrap();
    let renderer = of(Engine::PORTABLE);
    let mut worker = renderer.worker();
    let tiles = 0..renderer.grid().tiles();
    let expected: Vec<_> =
        tiles.clone().map(|tile| format!("{:?}", renderer.all(tile, &mut worker))).collect();
    for engine in Engine::available() {
        let renderer = of(engine);
        let found: Vec<_> = tiles
            .clone()
            .into_par_iter()
            .map_init(|| renderer.worker(), |worker, tile| format!("{:?}", renderer.all(tile, worker)))
            .collect();
        assert!(found == expected);
        for tile in tiles.clone().rev() {
            let (all, hidden) = renderer.all(tile, &mut worker);
            let front = renderer.front(tile, &mut worker);
            assert!(front.sheet == all.sheet && front.has_edge == all.has_edge);
            assert_eq!(front.counts.nearest, all.counts.nearest);
            assert!(renderer.hidden(tile, &mut worker).0 == hidden);
        }
    }
}

#[test]
fn a_mesh_in_a_scratch_file_has_the_same_sheets() {
    let frame = Frame::centred(192, 192, 0.02, 50.0);
    let parts: Vec<_> = [icosphere([0.003, 0.001, 1.0], 0.03, 6), wall(2.0)]
        .into_iter()
        .enumerate()
        .map(|(k, shape)| part(shape, k))
        .collect();
    let materials = [material(true), material(true)];
    let scratch = Scratch::new(&std::env::temp_dir(), 0);
    let of = |scratch: &Scratch| {
        let pose = crate::scene::mesh::tests::pose();
        let mesh = Mesh::with_scratch(&parts, &materials, &pose, OPTIONS, scratch).unwrap();
        let sheets: Vec<_> = (0..9).map(|tile| render(&mesh, frame.clone(), settings(4, 2), tile)).collect();
        (sheets, *mesh.facts(), mesh.bytes())
    };
    let (expected, facts, in_memory) = of(&Scratch::default());
    let (found, found_facts, left) = of(&scratch);
    assert!(found == expected && found_facts == facts && facts.solids == 1);
    assert!(
        left < in_memory / 4 && scratch.file_bytes() > 2 << 20,
        "{left} {in_memory} {}",
        scratch.file_bytes()
    );
}

#[test]
fn the_place_and_direction_of_the_world_do_not_matter() {
    let frame = Frame::centred(256, 256, 0.0125, 50.0);
    let shapes = || vec![icosphere([0.003, 0.001, 1.0], 0.012, 3), wall(2.0)];
    let all = |mesh: &Mesh| {
        (0..16).map(|tile| render(mesh, frame.clone(), settings(4, 2), tile)).collect::<Vec<_>>()
    };
    let expected = all(&mesh(shapes(), OPTIONS));
    // Turned by 3-4-5 about y, then moved.
    let turn = |[x, y, z]: [f64; 3]| [0.6 * x + 0.8 * z, y, 0.6 * z - 0.8 * x];
    let materials = [material(true), material(true)];
    for (move_m, in_nodes, unit) in
        [([5e6, -5e6, 5e6], true, 1.0), ([5e6, 2e6, -1e6], false, 1.0), ([0.0; 3], true, 0.01)]
    {
        let eye = move_m;
        let to = turn([0.0, 0.0, 1.0]);
        let pose = Pose::looking(eye, [0, 1, 2].map(|k| eye[k] + to[k]), [0.0, -1.0, 0.0]).unwrap();
        let place = |p: [f64; 3]| {
            let t = turn(p);
            [0, 1, 2].map(|k| (t[k] + if in_nodes { 0.0 } else { move_m[k] }) / unit)
        };
        let parts: Vec<_> = shapes()
            .into_iter()
            .map(|(v, t)| {
                let mut part = part((v.into_iter().map(place).collect(), t), 0);
                part.to_world = IDENTITY;
                if in_nodes {
                    (0..3).for_each(|k| part.to_world[k][3] = move_m[k] / unit);
                }
                part
            })
            .collect();
        let moved = Mesh::new(&parts, &materials, &pose, MeshOptions { unit_m: unit, ..OPTIONS }).unwrap();
        let mut other = 0;
        for ((front, hidden), (expected, expected_hidden)) in all(&moved).iter().zip(&expected) {
            for (a, b) in [(&front.sheet, &expected.sheet), (&hidden[0], &expected_hidden[0])] {
                for at in 0..a.depth.len() {
                    other += usize::from(a.coverage[at] != b.coverage[at]);
                    if a.coverage[at] == b.coverage[at] && b.coverage[at] > 0.0 {
                        assert!((a.depth[at] / b.depth[at] - 1.0).abs() <= 2e-7);
                    }
                }
            }
        }
        // Less than 10⁻⁵ of 65,536 pixels.
        assert_eq!(other, 0);
    }
}
