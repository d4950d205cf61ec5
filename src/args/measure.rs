//! `lenscube measure`.

use super::choices::{STYLE, one_of};
use super::values::{bounded, figure, pair_within, roi};
use clap::{ArgGroup, Args};
use formats::picture::style::Style;
use pipeline::bounds;
use pipeline::geometry::Rect;
use std::path::PathBuf;

/// `lenscube measure`
#[derive(Debug, Args)]
#[command(group = ArgGroup::new("what").required(true).args(["edge", "points", "profile", "glare", "flare"]))]
#[command(
    after_help = "Examples:\n  lenscube measure film.zarr --edge 1020,900,1034,1060 --band 550 --plot edge.svg\n  \
lenscube measure film.zarr//roi_0 --points '100,100;300.5,80'\n  \
lenscube measure film.zarr --profile 0,512,1023,512 --csv profile.csv\n  \
lenscube measure film.zarr --glare 500,500,24,24 --white-area 300,500,24,24\n  \
lenscube measure raw.zarr --glare 500,500,24,24 --white-area 300,500,24,24\n  \
lenscube measure night.zarr --flare 512,384,10 --band 550 --plot flare.svg --map flare.png\n\
Positions X,Y are column and row of the array, pixel centres at integers."
)]
pub struct MeasureArgs {
    /// Film or chart: PATH or URL, optionally with //array, or gen:KIND?…; for --glare and --flare also a raw, measured in electrons of light per colour
    #[arg(value_name = "FILM")]
    pub film: String,
    /// Edge spread function and MTF (e-SFR, ISO 12233) of the edge near this line; the edge is fitted by a straight line
    #[arg(long, value_name = "X0,Y0,X1,Y1", value_parser = four, allow_hyphen_values = true)]
    pub edge: Option<[f64; 4]>,
    /// Centroids near positions
    #[arg(long, value_name = "X,Y;…", value_parser = places, allow_hyphen_values = true)]
    pub points: Option<Places>,
    /// Values along a line in steps of 1 px, interpolated linearly
    #[arg(long, value_name = "X0,Y0,X1,Y1", value_parser = four, allow_hyphen_values = true)]
    pub profile: Option<[f64; 4]>,
    /// Veiling glare index (ISO 9358): the mean of this black area over that of --white-area
    #[arg(long, value_name = "X,Y,W,H", value_parser = roi, requires = "white_area", conflicts_with_all = ["plot", "csv"])]
    pub glare: Option<Rect>,
    /// Flare of a lamp, the middle and the radius of its image: light beside it over that of its image, or of --white-area
    #[arg(long, value_name = "X,Y,R", value_parser = lamp, allow_hyphen_values = true)]
    pub flare: Option<(f64, f64, f64)>,
    /// White area of --glare; with --flare, what the flare is normalised by
    #[arg(long, value_name = "X,Y,W,H", value_parser = roi, conflicts_with_all = ["edge", "points", "profile"])]
    pub white_area: Option<Rect>,
    /// Half width of the region around an edge or a point, px
    #[arg(long, value_name = "PX", default_value_t = 24, value_parser = clap::value_parser!(u32).range(4..=1000))]
    pub half_px: u32,
    /// One band, by its wavelength in nm [default: all]
    #[arg(long, value_name = "NM", value_parser = bounded(bounds::WAVELENGTH_NM))]
    pub band: Option<f64>,
    /// Wavelengths in nm, in place of those of the store, if it has some
    #[arg(long, value_name = "NM")]
    pub wavelengths: Option<String>,
    /// Write the curve or the points to a CSV file
    #[arg(long, value_name = "FILE")]
    pub csv: Option<PathBuf>,
    /// Write all figures and curves to a JSON file
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Write a plot of the curves, PNG or SVG by the extension
    #[arg(long, alias = "svg", value_name = "FILE", value_parser = figure(), conflicts_with = "points")]
    pub plot: Option<PathBuf>,
    /// Write a map of the flare of one band or colour to a PNG file: from 1e-6 (black) to 1, logarithmic
    #[arg(long, value_name = "FILE.png", value_parser = png, conflicts_with_all = ["edge", "points", "profile", "glare"])]
    pub map: Option<PathBuf>,
    /// Frame of a raw
    #[arg(long, value_name = "N", default_value_t = 0, conflicts_with_all = ["edge", "points", "profile"])]
    pub frame: usize,
    /// Replace existing files
    #[arg(long)]
    pub overwrite: bool,
    /// Colours of figures
    #[arg(long, value_parser = one_of(STYLE), default_value = "light")]
    pub style: Style,
}

/// Positions (row, column).
#[derive(Clone, Debug, PartialEq)]
pub struct Places(pub Vec<(f64, f64)>);

fn places(text: &str) -> Result<Places, String> {
    let place = |t: &str| pair_within(bounds::POSITION_PX, t).map(|(x, y)| (y, x));
    text.split(';').map(place).collect::<Result<_, _>>().map(Places)
}

/// Middle (column, row) and radius of a lamp, px.
fn lamp(text: &str) -> Result<(f64, f64, f64), String> {
    let list: Vec<f64> = text.split(',').map(bounded(bounds::POSITION_PX)).collect::<Result<_, _>>()?;
    match list[..] {
        [x, y, radius] if radius >= 1.0 => Ok((x, y, radius)),
        [_, _, radius] => Err(format!("the radius is {radius} px, expected at least 1")),
        _ => Err("expected three numbers X,Y,R".into()),
    }
}

fn png(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    match path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("png")) {
        true => Ok(path),
        false => Err("expected a name that ends with .png".into()),
    }
}

pub(super) fn four(text: &str) -> Result<[f64; 4], String> {
    let list: Vec<f64> = text.split(',').map(bounded(bounds::POSITION_PX)).collect::<Result<_, _>>()?;
    let four: [f64; 4] = list.try_into().map_err(|_| "expected four numbers X0,Y0,X1,Y1")?;
    let [x0, y0, x1, y1] = four;
    match (x1 - x0).hypot(y1 - y0) {
        d if (1.0..=1e6).contains(&d) => Ok(four),
        d => Err(format!("the two positions are {d} px apart, expected 1 to 1e6")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_out_of_range_are_called_so() {
        for error in [four("1e300,0,1,1").unwrap_err(), places("1e300,0").unwrap_err()] {
            assert!(error.contains("the position"), "{error}");
        }
    }
}
