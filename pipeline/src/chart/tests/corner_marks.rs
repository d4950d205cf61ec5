//! Corner marks, and the targets below them.

use super::*;

#[test]
fn corner_marks_are_found_where_they_are_drawn() {
    for spec in [
        "checker?size=500x400&fiducials=42",
        "slanted-edge?size=600&grid=3&fiducials=30.3",
        "siemens?size=450&grid=2&fiducials=49",
        "composite?size=700x900&fiducials=40",
        "uniform?size=300&value=0.05&fiducials=28",
        "iso12233-esfr?size=900&grid=4&fiducials=60",
    ] {
        let chart = generate(&format!("{spec}&wavelengths=550&overscan=10"));
        let film = chart.film_size();
        let picture = read(&chart, 0, Rect::new(10, 10, film.height, film.width));
        let found = crate::measure::fiducial::find(&picture, film).unwrap_or_else(|e| panic!("{spec}: {e}"));
        for (found, drawn) in std::iter::zip(found, chart.fiducials().unwrap()) {
            let error = (found.0 - drawn.0).hypot(found.1 - drawn.1);
            assert!(error < 0.01, "{spec}: {found:?} {drawn:?}");
        }
    }
}

#[test]
fn without_corner_marks_nothing_changes() {
    for spec in CHARTS.iter().filter(|s| !s.contains("fiducials")) {
        let (without, zero) = (generate(spec), generate(&format!("{spec}&fiducials=0")));
        assert_eq!(zero.spec().to_string(), without.spec().to_string());
        assert!(!without.spec().to_string().contains("fiducials"));
        assert_eq!(without.fiducials(), None);
    }
}

#[test]
fn targets_below_corner_marks_are_not_reported() {
    let module = 5.0;
    let covered = [Rect::new(0, 0, 65, 80), Rect::new(0, 645, 55, 55), Rect::new(545, 645, 55, 55)];
    for spec in ["points?count=20", "iso12233-esfr?grid=4", "checker", "slanted-edge", "dot-grid?count=9"] {
        let separator = if spec.contains('?') { '&' } else { '?' };
        let size = "size=700x600&wavelengths=550";
        let without = generate(&format!("{spec}{separator}{size}"));
        let chart = generate(&format!("{spec}{separator}{size}&fiducials={}", 7.0 * module));
        for mark in covered {
            let clear = |rect: Rect| rect.intersect(mark).is_empty();
            assert!(chart.patches_px().iter().all(|p| clear(*p) && !p.is_empty()), "{spec}");
            assert!(chart.edges().iter().all(|e| clear(e.patch)), "{spec}");
            assert!(
                chart.points_px().iter().all(|p| clear(Rect::new(p.0 as i64, p.1 as i64, 1, 1))),
                "{spec}"
            );
        }
        assert_eq!(chart.patches_px().len(), without.patches_px().len());
        assert_eq!(chart.edges().is_empty(), without.edges().is_empty(), "{spec}");
        assert!(chart.points_px().len() + 30 > without.points_px().len());
    }
}
