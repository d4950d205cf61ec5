//! Figure of `lenscube depth`: distances, blur radii and slabs of tiles, each with its scale.

use super::overview::Overview;
use super::report::{distance_text, mean_and_most, metres};
use crate::job::preview::Preview;
use crate::progress::short_number;
use formats::picture::figure::{Anchor, Figure, Text};
use formats::picture::image::Image;
use formats::picture::plot::colour_bar;
use formats::picture::style::{Rgb, Style, inferno};
use pipeline::geometry::Size;

/// Longest side of a panel, px of the figure.
pub const SIDE: usize = 380;
/// Space for a colour bar right of a panel, px.
const BAR: usize = 120;
/// Left margin, height above the panels and below them, px.
const LEFT: usize = 24;
const TOP: usize = 84;
const BELOW: usize = 60;
/// Shortest colour bar, px.
const MIN_HEIGHT: usize = 160;

/// A panel: picture, its title, the label of its scale with numbers at shares of it, a caption.
struct Panel {
    image: Image,
    title: &'static str,
    label: &'static str,
    numbers: Vec<(f64, String)>,
    caption: String,
}

/// The figure.
pub fn figure(preview: &Preview, overview: &Overview, style: Style) -> Figure {
    let panels: Vec<Panel> = [Some(depth(preview, overview)), Some(blur(preview, overview)), slabs(preview)]
        .into_iter()
        .flatten()
        .collect();
    let height = panels.iter().map(|panel| panel.image.size().height).max().unwrap_or(0).max(MIN_HEIGHT);
    let width: usize = panels.iter().map(|panel| panel.image.size().width + BAR).sum();
    let mut figure = Figure::new(Size::new(TOP + height + BELOW, LEFT + width + LEFT), style);
    let title = format!("{}, in focus at {}", preview.lens, distance_text(preview.focus));
    let most = (LEFT + width) as f64;
    figure.text(Text {
        size: 17.0,
        max_width: most,
        ..Text::new((LEFT as f64, 24.0), Anchor::Start, &title)
    });
    let mut x = LEFT as f64;
    for panel in &panels {
        let (top, size) = (TOP as f64, panel.image.size());
        let space = (size.width + BAR - 12) as f64;
        figure.text(Text { max_width: space, ..Text::new((x, 62.0), Anchor::Start, panel.title) });
        figure.picture((x, top), &panel.image, 1);
        let bar = [x + size.width as f64 + 10.0, top, 14.0, size.height.max(MIN_HEIGHT) as f64];
        colour_bar(&mut figure, bar, panel.label, &panel.numbers, inferno);
        let below = top + height as f64 + 24.0;
        figure.text(Text { max_width: space, ..Text::new((x, below), Anchor::Start, &panel.caption) });
        x += (size.width + BAR) as f64;
    }
    figure
}

/// Distances, by vergence.
fn depth(preview: &Preview, overview: &Overview) -> Panel {
    let (first, last) = (preview.depth.surfaces.first, preview.depth.surfaces.last);
    let share = |v: f64| if last > first { (v - first) / (last - first) } else { 0.5 };
    let image = enlarged(overview.size, overview.means().map(|(v, _)| inferno(share(v))));
    let mut numbers = vec![(share(first), metres(first)), (share(last), metres(last))];
    numbers.dedup();
    // Round distances between the ends, where they do not touch another number.
    for power in -3..4 {
        for digit in [1.0, 2.0, 5.0] {
            let v = 1.0 / (digit * 10f64.powi(power));
            let is_free = numbers.iter().all(|(at, _)| (at - share(v)).abs() > 0.09);
            if first < v && v < last && is_free {
                numbers.push((share(v), metres(v)));
            }
        }
    }
    let caption = format!("chart of {} px", preview.frame.chart);
    Panel { image, title: "distance", label: "m, linear in 1/m", numbers, caption }
}

/// Blur radii.
fn blur(preview: &Preview, overview: &Overview) -> Panel {
    let most = overview.means().map(|(_, blur)| blur).fold(0.0, f64::max);
    let scale = if most > 0.0 { most } else { 1.0 };
    let image = enlarged(overview.size, overview.means().map(|(_, blur)| inferno(blur / scale)));
    let caption =
        format!("{} px per dioptre from focus", short_number((preview.blur_px * 100.0).round() / 100.0));
    Panel { image, title: "blur radius", label: "film pixels", numbers: ticks(scale), caption }
}

/// Slabs in reach of the tiles of the film; none without a plan.
fn slabs(preview: &Preview) -> Option<Panel> {
    let band = preview.band.as_ref()?;
    let (tiling, slabs) = band.tile_slabs(&preview.frame);
    let film = preview.frame.film;
    let longest = film.height.max(film.width);
    let side = |n: usize| (n * SIDE).div_ceil(longest);
    let mut image = Image::new(Size::new(side(film.height), side(film.width)), inferno(0.0));
    let (mean, most) = mean_and_most(&slabs);
    let most = most.max(1);
    let columns = tiling.count().1;
    for (y, row) in (0..image.size().height).map(|y| (y, y * longest / SIDE / tiling.tile())) {
        for (x, pixel) in image.row_mut(y).iter_mut().enumerate() {
            let tile = row * columns + x * longest / SIDE / tiling.tile();
            *pixel = inferno(slabs[tile.min(slabs.len() - 1)] as f64 / most as f64);
        }
    }
    let caption = format!("film of {film} px, tiles of {}; mean {mean:.1}", tiling.tile());
    let numbers =
        ticks(most as f64).into_iter().filter(|(at, _)| (at * most as f64).fract().abs() < 1e-9).collect();
    Some(Panel { image, title: "slabs in reach of a tile", label: "slabs", numbers, caption })
}

/// An image of the colours of `size` parts, enlarged by a whole number up to [`SIDE`].
fn enlarged(size: Size, colours: impl Iterator<Item = Rgb>) -> Image {
    let times = (SIDE / size.height.max(size.width)).max(1);
    let mut image = Image::new(Size::new(size.height * times, size.width * times), [0; 3]);
    for (i, colour) in colours.enumerate() {
        let (y, x) = (i / size.width * times, i % size.width * times);
        for row in y..y + times {
            image.row_mut(row)[x..x + times].fill(colour);
        }
    }
    image
}

/// Round numbers from 0 to `most`, at their shares of it.
fn ticks(most: f64) -> Vec<(f64, String)> {
    let ten = 10f64.powi((most / 4.0).log10().floor() as i32);
    let step = [1.0, 2.0, 5.0, 10.0].into_iter().map(|k| k * ten).find(|step| most / step <= 5.0);
    let step = step.unwrap_or(most);
    (0..)
        .map(|i| f64::from(i) * step)
        .take_while(|v| *v <= most * (1.0 + 1e-9))
        .map(|v| (v / most, short_number(v)))
        .collect()
}
