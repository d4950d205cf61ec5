//! How much of the lens's field and of the film the chart covers.
//!
//! The chart lies on the ideal image plane, or a scene in the projection of the film: a chart pixel is scale · film pitch wide, an angle α off the axis lands at f·tan α, f being the
//! distortion focal length. The share of the field is the height of the chart's farthest corner over that of the lens's outermost field
//! point. A film pixel at the REAL height r shows the chart at r's ideal height (first band), or at r without the
//! stage distortion.

use super::bands::JobPlan;
use super::inputs::Inputs;
use crate::args::RunArgs;
use pipeline::geometry::{Frame, Rect, Size};
use pipeline::lens::LensBand;
use pipeline::projection::Projection;
use pipeline::resample::Surround;
use pipeline::stage::Stage;
use std::fmt::{self, Display, Formatter};

/// Points along each side of a region at which the chart is looked for.
const SAMPLES: usize = 101;
/// Share of the film beyond the chart above which a note is printed.
const MIN_NOTED_SHARE: f64 = 0.01;

/// Size of the chart on the ideal image plane, and what it leaves uncovered.
pub struct Coverage {
    chart: Size,
    /// Width and height, mm.
    mm: (f64, f64),
    /// Angles between its edges, degrees; none for a finite object distance.
    degrees: Option<(f64, f64)>,
    /// Height of its farthest corner over that of the lens's outermost field point, and the diameter of the field, mm.
    field: Option<(f64, f64)>,
    /// Share of the film that shows what surrounds the chart.
    beyond: f64,
}

impl Coverage {
    /// Of the chart of `inputs`.
    pub fn new(args: &RunArgs, inputs: &Inputs, plan: &JobPlan) -> Self {
        let frame = &inputs.frame;
        let mm = (
            frame.chart.width as f64 * frame.scale.1 * frame.pitch_mm(),
            frame.chart.height as f64 * frame.scale.0 * frame.pitch_mm(),
        );
        let lens = plan.lens.lens();
        let angle = |size: f64, centre: f64| {
            let focal_mm = lens.distortion_focal_length_mm.abs();
            let to_degrees = |mm: f64| frame.projection.angle_rad(mm, focal_mm).to_degrees();
            to_degrees(centre + size / 2.0) - to_degrees(centre - size / 2.0)
        };
        let (cy, cx) = frame.center_mm;
        let regions: Vec<Rect> = plan.regions.iter().map(|r| r.rect).collect();
        let band = plan.bands.first().map(|b| &b.lens).filter(|_| args.stages.contains(&Stage::Distortion));
        let corner_mm = (cx.abs() + mm.0 / 2.0).hypot(cy.abs() + mm.1 / 2.0);
        // Of the ideal image plane.
        let field_mm = inputs.field_height_mm.filter(|_| frame.projection == Projection::Planar);
        Self {
            chart: frame.chart,
            mm,
            degrees: lens.object_distance_mm.is_none().then(|| (angle(mm.0, cx), angle(mm.1, cy))),
            field: field_mm.map(|field_mm| (corner_mm / field_mm, 2.0 * field_mm)),
            beyond: share_beyond(frame, &regions, band),
        }
    }

    /// A note if the chart does not reach much of the film.
    pub fn note(&self, args: &RunArgs) -> Option<String> {
        let shown = match args.surround {
            Surround::Edge => "the chart's edge pixels",
            Surround::Black => "black",
            Surround::Mirror => "the chart mirrored",
        };
        let enlarging = match args.placement.fit {
            None => "`--fit contain` or `--scale`",
            Some(_) => "`--scale` instead of --fit",
        };
        (self.beyond >= MIN_NOTED_SHARE).then(|| {
            format!(
                "{:.0} % of the film lies beyond the chart and shows {shown} (--surround); {enlarging} enlarges the chart, \
                 without --film-size the film has the chart's size",
                100.0 * self.beyond
            )
        })
    }
}

/// Share of the film's `regions` beyond the chart, by samples.
fn share_beyond(frame: &Frame, regions: &[Rect], band: Option<&LensBand>) -> f64 {
    let (half_height, half_width) = (
        frame.chart.height as f64 * frame.scale.0 * frame.pitch_mm() / 2.0,
        frame.chart.width as f64 * frame.scale.1 * frame.pitch_mm() / 2.0,
    );
    let is_beyond = |y_px: f64, x_px: f64| {
        let (y, x) =
            ((y_px - frame.axis_px.0) * frame.pitch_mm(), (x_px - frame.axis_px.1) * frame.pitch_mm());
        let [x, y] = band.map_or([x, y], |b| frame.projection.point_mm(b.ideal_point_at([x, y])));
        (y - frame.center_mm.0).abs() > half_height || (x - frame.center_mm.1).abs() > half_width
    };
    let area: f64 = regions.iter().map(|r| r.size().pixels() as f64).sum();
    let beyond = regions.iter().map(|r| {
        // Centres of equal parts of the region.
        let place = |first: i64, side: usize, k: usize| {
            first as f64 - 0.5 + side as f64 * (k as f64 + 0.5) / SAMPLES as f64
        };
        let points = (0..SAMPLES * SAMPLES)
            .filter(|k| is_beyond(place(r.y, r.height, k / SAMPLES), place(r.x, r.width, k % SAMPLES)));
        r.size().pixels() as f64 * points.count() as f64 / (SAMPLES * SAMPLES) as f64
    });
    beyond.sum::<f64>() / area.max(1.0)
}

impl Display for Coverage {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "chart of {} px: {} x {} mm", self.chart, short(self.mm.0), short(self.mm.1))?;
        if let Some((x, y)) = self.degrees {
            write!(f, ", {} x {} degrees", short(x), short(y))?;
        }
        if let Some((share, diameter_mm)) = self.field {
            write!(
                f,
                "; its corners are at {:.0} % of the lens's field of {} mm diameter",
                100.0 * share,
                short(diameter_mm)
            )?;
        }
        Ok(())
    }
}

/// Three digits.
fn short(v: f64) -> String {
    let decimals = match v.abs() {
        v if v >= 100.0 => 0,
        v if v >= 10.0 => 1,
        v if v >= 1.0 => 2,
        _ => 3,
    };
    format!("{v:.decimals$}")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn band(ideal_over_real: f64) -> LensBand {
        LensBand {
            ideal_height_mm: vec![0.0, 10.0 * ideal_over_real],
            ..LensBand::ideal(550.0, vec![0.0, 10.0])
        }
    }

    #[test]
    fn share_beyond_the_chart_is_that_of_the_areas() {
        let frame = |film, chart| Frame::centred(film, chart, 10.0);
        let whole = |f: &Frame| [f.film.rect()];
        let same = frame(Size::new(200, 300), Size::new(200, 300));
        assert_eq!(share_beyond(&same, &whole(&same), Some(&band(1.0))), 0.0);
        // The chart covers a quarter of a film of twice its sides.
        let larger = frame(Size::new(400, 600), Size::new(200, 300));
        assert!((share_beyond(&larger, &whole(&larger), Some(&band(1.0))) - 0.75).abs() < 0.01);
        assert_eq!(share_beyond(&larger, &[Rect::new(150, 200, 100, 200)], Some(&band(1.0))), 0.0);
        // Ideal heights are 25 % larger than REAL ones: the film shows more than the chart.
        let distorted = share_beyond(&same, &whole(&same), Some(&band(1.25)));
        assert!((distorted - (1.0 - 0.8 * 0.8)).abs() < 0.01, "{distorted}");
        assert_eq!(share_beyond(&same, &whole(&same), None), 0.0);
        let shifted = Frame { center_mm: (0.0, 1.5), ..same };
        assert!((share_beyond(&shifted, &whole(&shifted), Some(&band(1.0))) - 0.5).abs() < 0.01);
    }
}
