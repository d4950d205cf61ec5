//! `lenscube report`.

use super::choices::{STYLE, one_of};
use super::values::{pair_within, positive, threads};
use clap::Args;
use formats::picture::style::Style;
use pipeline::bounds;
use pipeline::colour::Illuminant;
use std::path::PathBuf;

/// `lenscube report`
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  lenscube report edges.raw.zarr --chart iso12233-esfr --out report\n  \
lenscube report star.png checker.png --chart siemens --chart checker --out report\n  \
lenscube report a.raw.zarr --chart dot-grid --against b.raw.zarr --out report\n  \
lenscube report photo.dng --chart 'checker?fiducials=40' --out report\n\
Charts and what they tell: iso12233-esfr (e-SFR; OECF, noise, dynamic range), slanted-edge (e-SFR), siemens (s-SFR), dead-leaves (texture),\n\
oecf (OECF, noise, visual noise, dynamic range), dot-grid (distortion, lateral colour), uniform (shading), black-spots (veiling glare),\n\
checker (colour errors). Make them by `lenscube chart`; give here the settings that they were made with. `lenscube help reports`")]
pub struct ReportArgs {
    /// Pictures of charts, one chart each: raws of `lenscube sensor`, DNG of any camera, PNG, TIFF, JPEG, WebP or OpenEXR
    #[arg(value_name = "PICTURE", required = true)]
    pub pictures: Vec<String>,
    /// Chart of each picture in turn, or one for all: KIND or KIND?key=value…; its film is as large as the picture, or, with fiducials, of the size that is given
    #[arg(long, value_name = "KIND", required = true)]
    pub chart: Vec<String>,
    /// Pictures of a second camera, of the same charts in turn
    #[arg(long, value_name = "PICTURE", num_args = 1..)]
    pub against: Vec<String>,
    /// Places of the corners of the chart's film in each picture in turn, or one for all: top left, top right, bottom right, bottom left of the chart [default: its fiducials, else those of the picture]
    #[arg(long, value_name = "X,Y;X,Y;X,Y;X,Y", value_parser = corners, allow_hyphen_values = true)]
    pub corners: Vec<Corners>,
    /// Directory for the report: report.html, report.json and figures as SVG
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Decode integer samples as linear instead of sRGB
    #[arg(long)]
    pub linear: bool,
    /// Name of the camera, and of the second one [default: the pictures' names]
    #[arg(long, value_name = "NAME")]
    pub name: Vec<String>,
    /// Pixels per degree at which visual noise is looked at: 34 of a picture at 100 % on a display of 96 pixels per inch, half a metre away
    #[arg(long, value_name = "N", default_value_t = 34.0, value_parser = positive)]
    pub pixels_per_degree: f64,
    /// Light of the chart, D65, A or E, of pictures; raws record it if their film does
    #[arg(long, value_name = "LIGHT", default_value = "D65", value_parser = light)]
    pub light: Illuminant,
    /// Frame of raws
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub frame: usize,
    /// Worker threads [default: all cores]
    #[arg(long, value_parser = threads)]
    pub threads: Option<usize>,
    /// Replace the files of an earlier report
    #[arg(long)]
    pub overwrite: bool,
    /// Colours of figures
    #[arg(long, value_parser = one_of(STYLE), default_value = "light")]
    pub style: Style,
}

fn light(text: &str) -> Result<Illuminant, String> {
    text.parse().map_err(|_| format!("expected D65, A or E, found `{text}`"))
}

/// Corners (row, column), clockwise from the top left one of the chart.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corners(pub [(f64, f64); 4]);

fn corners(text: &str) -> Result<Corners, String> {
    let place = |t: &str| pair_within(bounds::POSITION_PX, t).map(|(x, y)| (y, x));
    let all: Vec<(f64, f64)> = text.split(';').map(place).collect::<Result<_, _>>()?;
    let all: [(f64, f64); 4] = all.try_into().map_err(|_| "expected four positions X,Y;X,Y;X,Y;X,Y")?;
    Ok(Corners(all))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corners_are_rows_and_columns() {
        let found = corners("1,2;30,2;30,40;1,40").unwrap();
        assert_eq!(found.0, [(2.0, 1.0), (2.0, 30.0), (40.0, 30.0), (40.0, 1.0)]);
        assert!(corners("1,2;3,4").unwrap_err().contains("four positions"));
        assert!(corners("1,2;3,4;5,x;7,8").is_err());
    }
}
