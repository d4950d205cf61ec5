//! CIEDE2000 of patches: of the second raw against the first, and of both against a ColorChecker where there are 24.

use crate::camera::Developer;
use crate::failure::usage;
use anyhow::Result;
use pipeline::colour::{CHECKER_PATCHES, Illuminant, checker_names};
use pipeline::develop::matrix::{difference, patch_targets, scaled_to_greys};
use pipeline::geometry::Rect;
use serde_json::{Value, json};
use std::fmt::Write;

/// A patch.
pub struct Patch {
    /// Its pixels.
    pub rect: Rect,
    /// Its name.
    pub name: String,
    /// Mean linear sRGB in both raws.
    pub rgb: [[f64; 3]; 2],
    /// CIEDE2000 of the second raw against the first.
    pub delta_e: f64,
    /// CIEDE2000 of each raw against the ColorChecker.
    pub to_checker: Option<[f64; 2]>,
}

impl Patch {
    pub fn json(&self) -> Value {
        let r = self.rect;
        json!({
            "patch": [r.x, r.y, r.width, r.height],
            "name": self.name,
            "linear_srgb": self.rgb,
            "delta_e_2000": self.delta_e,
            "delta_e_2000_to_checker": self.to_checker,
        })
    }
}

/// The table of all patches.
pub fn csv(patches: &[Patch]) -> String {
    let mut text = String::from(
        "name,x,y,width,height,a_red,a_green,a_blue,b_red,b_green,b_blue,delta_e_2000,a_to_checker,b_to_checker\n",
    );
    for p in patches {
        let [a, b] = p.rgb.map(|c| c.map(|v| format!("{v:.6}")).join(","));
        let checker = p.to_checker.map_or([String::new(), String::new()], |c| c.map(|v| format!("{v:.4}")));
        let r = p.rect;
        // Writing to a String cannot fail.
        let _ = writeln!(
            text,
            "{},{},{},{},{},{a},{b},{:.4},{}",
            p.name,
            r.x,
            r.y,
            r.width,
            r.height,
            p.delta_e,
            checker.join(",")
        );
    }
    text
}

/// Measures patches of the developed raws.
pub fn measure(developers: &[Developer; 2], rects: &[Rect]) -> Result<Vec<Patch>> {
    let all = developers[0].rect();
    if let Some(r) = rects.iter().find(|r| !all.contains(**r)) {
        return Err(usage(format!(
            "--patch {},{},{},{} is not inside the picture of {}",
            r.x,
            r.y,
            r.width,
            r.height,
            all.size()
        )));
    }
    let mean = |developer: &Developer, rect: &Rect| -> Result<[f64; 3]> {
        let (linear, channels) = (developer.linear(*rect)?, developer.channels());
        let one = |c: usize| {
            let values = linear.iter().skip(c.min(channels - 1)).step_by(channels);
            values.map(|v| f64::from(*v)).sum::<f64>() / rect.size().pixels() as f64
        };
        Ok(std::array::from_fn(one))
    };
    let means = |developer| rects.iter().map(|r| mean(developer, r)).collect::<Result<Vec<_>>>();
    let both = [means(&developers[0])?, means(&developers[1])?];
    let checker =
        (rects.len() == CHECKER_PATCHES).then(|| [0, 1].map(|k| to_checker(&developers[k], &both[k])));
    let patch = |(k, rect): (usize, &Rect)| Patch {
        rect: *rect,
        name: match checker {
            Some(_) => checker_names()[k].clone(),
            None => format!("patch {k}"),
        },
        rgb: [both[0][k], both[1][k]],
        delta_e: difference(both[0][k], both[1][k]),
        to_checker: checker.as_ref().map(|c| [c[0][k], c[1][k]]),
    };
    Ok(rects.iter().enumerate().map(patch).collect())
}

/// CIEDE2000 against the ColorChecker, the greys as bright as they should be.
fn to_checker(developer: &Developer, found: &[[f64; 3]]) -> Vec<f64> {
    let light = developer.frame.light().unwrap_or(Illuminant::D65);
    let targets = patch_targets(light);
    // Dark greys have no scale: their differences are then not numbers.
    let scaled = scaled_to_greys(found, &targets).unwrap_or_else(|| vec![[f64::NAN; 3]; found.len()]);
    std::iter::zip(scaled, targets).map(|(f, t)| difference(f, t)).collect()
}
