//! Generated charts of all kinds.

mod corner_marks;
mod patches;
mod pixels;
mod shapes;
mod specification;

use super::*;

fn generate(spec: &str) -> Generator {
    spec.parse().unwrap_or_else(|e| panic!("{spec}: {e}"))
}

fn read(chart: &Generator, band: usize, rect: Rect) -> Vec<f32> {
    let mut out = vec![f32::NAN; rect.size().pixels()];
    chart.read(band, rect, &mut out).unwrap();
    out
}

const CHARTS: [&str; 23] = [
    "checker?size=200x97&noise=0.2&wavelengths=550",
    "uniform?value=3.5&size=40",
    "points?size=301x200&count=5&overscan=7",
    "points?size=150&count=5&blob=disc&width_px=5.5",
    "slanted-edge?size=77x101&overscan=3",
    "slanted-edge?size=200x300&grid=3&angle_deg=-84",
    "siemens?size=255&grid=2&spokes=36",
    "iso12233-esfr?size=240x300&grid=3&angle_deg=-7",
    "dot-grid?size=301x200&count=5&width_px=9.5",
    "black-spots?size=301x200&spots=4&diameter=11%",
    "lamp?size=90x120&radius=7.5&x=30.25&y=100",
    "checker?size=200x97&illuminant=A",
    "composite?size=700&wavelengths=450,550,650",
    "composite?size=1002x1301&wavelengths=550",
    "depth-scene?size=400x300&wavelengths=550,600&noise=0.1",
    "checker?size=400x300&wavelengths=550&fiducials=35",
    "slanted-edge?size=300x310&wavelengths=550&fiducials=30.25&noise=0.02",
    "uniform?size=200&value=0.01&fiducials=21",
    "siemens?size=255x200&wavelengths=550&grid=2&spokes=48&profile=sine",
    "dead-leaves?size=330x301&wavelengths=550&seed=7",
    "dead-leaves?size=300&wavelengths=550&r_min_px=3&r_max_px=3&contrast=20&fiducials=28&overscan=4",
    "oecf?size=300x250&wavelengths=550&patches=12&density=2&fiducials=21",
    "depth-scene?size=300x200&wavelengths=550&near_m=0.3&far_m=inf&part=depth",
];
