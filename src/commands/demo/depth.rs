//! `lenscube demo --depth`: the focus pulled from near to far through a scene at several distances.
//!
//! The scene is drawn (`gen:depth-scene`): a disc at 0.1 m, a black ball, a floor, a wall at 1 m. The built-in lens `phone` blurs by 2.5 µm per dioptre, 11 px of
//! this film between disc and wall.

use super::{DemoDirectory, picture, request, text};
use crate::args::{DemoArgs, DepthArgs, ProgressArg, RunArgs};
use crate::commands::chart::write;
use crate::commands::run;
use crate::failure::usage;
use crate::machine::threads;
use crate::progress::{log_line, print};
use anyhow::Result;
use formats::chart::Codec;
use formats::picture::contact_sheet::{Crop, contact_sheet};
use formats::picture::exposure::Exposure;
use pipeline::chart::Generator;
use pipeline::geometry::Rect;
use std::path::Path;

const LENS: &str = "phone";
const SCENE: &str = "depth-scene?size=480x320&near_m=0.1&far_m=1&wavelengths=450,550,650&pitch_um=2";
/// Names of the films and their focus, m.
const FOCUS: [(&str, f64); 3] = [("near", 0.1), ("middle", 0.18), ("far", 1.0)];
/// Error between depth nodes: half of the default's nodes.
const TOLERANCE: f64 = 0.08;

/// Makes scene, films and picture in the demo's directory; the exit code.
pub fn command(args: &DemoArgs, demo: &mut DemoDirectory) -> Result<u8> {
    let (dir, threads) = (&args.dir, threads(args.threads));
    log_line("1/3  scene: chart, distances and hidden surfaces");
    let scene: Generator = SCENE.parse().map_err(|e| usage(format!("{e}")))?;
    demo.create("scene.zarr", |path| write(&scene, path, Codec::default(), threads, true))?;
    log_line("2/3  three films: the lens phone focused at 0.1, 0.18 and 1 m, traced once");
    let chart = text(&dir.join("scene.zarr"));
    for (name, focus_m) in FOCUS {
        let code = demo.create(&format!("{name}.zarr"), |path| film(&chart, path, focus_m, threads))?;
        if code != 0 {
            return Ok(code);
        }
    }
    log_line("3/3  picture");
    demo.create("focus.png", |path| focus_pictures(dir, &scene, path, threads))?;
    let d = dir.display();
    print(format!(
        "
Results
  {d}/focus.png    the scene and its films, focused on the disc at 0.1 m, the ball at 0.18 m and the wall at 1 m: blurred
                   edges show what lies behind them

Next commands
  lenscube run {d}/scene.zarr flat.zarr --lens {LENS} --focus-m 0.1 --depth none     everything in focus
  lenscube lens camera {LENS} --focus-m 0.1 --film-size 480x320 --for blender              the camera for a scene of one's own
  lenscube view {d}/near.zarr --chart {d}/scene.zarr --open"
    ));
    Ok(0)
}

/// Makes the film of the scene by the lens focused at `focus_m`; the exit code.
fn film(chart: &str, film: &Path, focus_m: f64, threads: usize) -> Result<u8> {
    let surfaces =
        DepthArgs { focus_m: Some(focus_m), depth_tolerance: Some(TOLERANCE), ..DepthArgs::default() };
    let job = RunArgs { lens: LENS.into(), surfaces, ..request(chart, film, threads) };
    run::run_job(&job, None, ProgressArg::Auto)
}

/// Writes focus.png: the scene and the films under the same exposure.
fn focus_pictures(dir: &Path, scene: &Generator, out: &Path, threads: usize) -> Result<()> {
    let (edge, film) = (scene.overscan_px() as i64, scene.film_size());
    let middle = Rect::new(edge, edge, film.height, film.width);
    let (chart, exposure) = picture(&text(&dir.join("scene.zarr")), Some(middle), Exposure::Auto, threads)?;
    let mut crops = vec![Crop { image: chart, caption: "the scene, as a pinhole sees it".into() }];
    for (name, focus_m) in FOCUS {
        let source = text(&dir.join(format!("{name}.zarr")));
        let (image, _) = picture(&source, None, Exposure::Factor(exposure), threads)?;
        crops.push(Crop { image, caption: format!("film, focus at {focus_m} m") });
    }
    let pairs: Vec<[Crop; 2]> = crops.as_chunks::<2>().0.to_vec();
    let picture = contact_sheet("Disc at 0.1 m, ball at 0.18 m, wall at 1 m behind a phone lens", &pairs, 1)?;
    Ok(picture.write_png(out, "lenscube demo --depth: focus from near to far")?)
}
