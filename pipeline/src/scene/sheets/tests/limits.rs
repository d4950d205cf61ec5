//! Limits: dropped hits, near surfaces, the reach of edges, and settings.

use super::*;
use crate::scene::visibility::{MAX_HITS, TileGrid};

#[test]
fn hits_beyond_the_limit_are_dropped_from_the_far_end_and_counted() {
    let walls: Vec<Shape> = (0..300).rev().map(|k| wall(1.0 + f64::from(k) * 0.01)).collect();
    let mesh = mesh(walls, OPTIONS);
    let frame = Frame::centred(8, 8, 0.05, 50.0);
    let shader = OfPart(&mesh);
    let renderer = Renderer::new(&mesh, frame, &shader, settings(4, 2), Engine::detect()).unwrap();
    let mut worker = renderer.worker();
    let (front, hidden) = renderer.all(0, &mut worker);
    assert_eq!(front.counts.dropped_hits, 44 * 64 * 4);
    assert_eq!(renderer.front(0, &mut worker).counts.dropped_hits, 0);
    assert!(
        front.sheet.depth.iter().all(|&z| z == 1.0) && hidden[0].depth.iter().all(|&z| z > 1.0 && z < 1.03)
    );
    let mut farthest = f64::INFINITY;
    renderer.surfaces(0, &mut worker, |_, _, _, found| {
        assert_eq!(found.len(), MAX_HITS);
        farthest = farthest.min(found[MAX_HITS - 1].0);
    });
    assert!((1.0 / farthest - 3.55).abs() < 1e-6);
}

#[test]
fn near_surfaces_are_counted_or_cut() {
    let mesh = mesh(vec![icosphere([0.0, 0.0, 0.1], 0.001, 2), wall(2.0)], OPTIONS);
    let near = Settings { near_m: 0.2, ..settings(4, 2) };
    let (front, _) = render(&mesh, FRAME, near.clone(), 0);
    assert!(
        front.counts.near_samples > 500 && front.counts.nearest.is_some_and(|(v, t)| v > 10.0 && t < 320)
    );
    let cut = Settings { is_near_cut: true, ..near };
    let (front, hidden) = render(&mesh, FRAME, cut.clone(), 0);
    assert_eq!(front.counts.near_samples, 0);
    assert!(front.sheet.depth.iter().all(|&z| z == 2.0) && hidden[0].is_empty());
    let shader = OfPart(&mesh);
    let renderer = Renderer::new(&mesh, FRAME, &shader, cut, Engine::detect()).unwrap();
    assert_eq!(renderer.front(0, &mut renderer.worker()).sheet, front.sheet);
}

#[test]
fn hidden_sheets_are_needed_within_reach_of_an_edge() {
    // A small ball in tile 0 of 5 × 5 before a wall.
    let frame = Frame::centred(320, 320, 0.05, 50.0);
    let mesh = mesh(vec![icosphere([-0.13, -0.13, 1.0], 0.004, 2), wall(2.0)], OPTIONS);
    let shader = OfPart(&mesh);
    let renderer = Renderer::new(&mesh, frame, &shader, settings(4, 3), Engine::detect()).unwrap();
    let grid = renderer.grid();
    assert_eq!(grid, TileGrid { height_px: 320, width_px: 320 });
    let mut worker = renderer.worker();
    let mut edges = EdgeMap::new(grid, 0.01);
    for tile in 0..grid.tiles() {
        let front = renderer.front(tile, &mut worker);
        edges.add(tile, front.has_edge, front.border);
    }
    assert_eq!((0..25).filter(|&t| edges.has_edge(t)).collect::<Vec<_>>(), [0]);
    let reach = edges.in_reach(70);
    assert_eq!(reach.iter().filter(|&&r| r).count(), 9);
    assert!(!renderer.hidden(0, &mut worker).0[0].is_empty());
}

#[test]
fn settings_out_of_range_are_errors() {
    let mesh = mesh(vec![wall(2.0)], OPTIONS);
    let shader = OfPart(&mesh);
    let of = |s: Settings| Renderer::new(&mesh, FRAME, &shader, s, Engine::PORTABLE).err();
    assert_eq!(of(settings(8, 3)), Some(SettingsError::Samples(8)));
    assert_eq!(of(settings(4, 9)), Some(SettingsError::Sheets(9)));
    assert_eq!(of(settings(4, 0)), Some(SettingsError::Sheets(0)));
    assert_eq!(of(Settings { gap_dioptre: -1.0, ..settings(4, 1) }), Some(SettingsError::Gap(-1.0)));
    assert_eq!(
        of(Settings { near_m: f64::INFINITY, ..settings(4, 1) }),
        Some(SettingsError::Near(f64::INFINITY))
    );
    let background = Some(Background { vergence: 0.0, weights: vec![1.0] });
    assert_eq!(of(Settings { background, ..settings(4, 1) }), Some(SettingsError::Background { bases: 3 }));
    let frame = Frame { focal_mm: 0.0, ..FRAME };
    let error = Renderer::new(&mesh, frame, &shader, settings(4, 1), Engine::PORTABLE).err();
    assert_eq!(error, Some(SettingsError::Frame));
}
