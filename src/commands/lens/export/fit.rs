//! A camera model fitted to a lens: its file, its coefficients, its residuals.

use super::film::Film;
use super::opened::Opened;
use crate::args::{ColmapModel, LensExportArgs, ModelArg, Terms};
use crate::progress::number;
use anyhow::Result;
use formats::camera_model::lensfun::Profile;
use formats::camera_model::opencv::{Calibration, yaml};
use formats::camera_model::table::{Row, csv};
use formats::camera_model::{colmap, lensfun, rig};
use pipeline::camera_model::Intrinsics;
use pipeline::camera_model::field_map::{FieldPoint, FieldSource};
use pipeline::camera_model::fisheye::Fisheye;
use pipeline::camera_model::ftheta::FTheta;
use pipeline::camera_model::lensfun::{LateralColour, Projection, PtLens, Vignetting};
use pipeline::camera_model::opencv::OpenCv;
use pipeline::camera_model::target::{Residual, Target};
use rayon::prelude::*;
use serde_json::{Value, json};

/// Rows of a table.
const ROWS: usize = 257;

/// A fitted model.
pub struct Fit {
    /// The file.
    pub text: String,
    pub coefficients: Value,
    /// What each residual is of, and the residual in film pixels.
    pub residuals: Vec<(&'static str, Residual)>,
    /// Principal point, px.
    pub principal_point: [f64; 2],
    /// Maximum error of relative illumination, where it is fitted.
    pub illumination_error: Option<f64>,
}

/// A lens, its film, and field points over it.
pub struct Fitted<'a> {
    pub opened: &'a Opened,
    pub film: &'a Film,
    /// Of one wavelength, or red, green, blue.
    pub sources: &'a [FieldSource<'a>],
    pub target: &'a Target,
}

impl Fitted<'_> {
    /// The chief rays of the wavelength of distortion.
    fn source(&self) -> &FieldSource<'_> {
        &self.sources[self.sources.len() / 2]
    }

    /// The wavelength of distortion, without the digits of rounding.
    fn wavelength_nm(&self) -> f64 {
        number(self.source().wavelength_nm())
    }

    fn intrinsics(&self) -> Intrinsics {
        Intrinsics { size: self.film.size, focal_px: self.target.focal_mm / self.film.pitch_mm }
    }

    /// The model of `args`.
    ///
    /// # Errors
    /// A model that does not describe the field; rays that do not reach the film.
    pub fn fit(&self, args: &LensExportArgs) -> Result<Fit> {
        match args.model {
            ModelArg::OpenCv => self.opencv(args.terms),
            ModelArg::OpenCvFisheye => self.fisheye(),
            ModelArg::FTheta => self.ftheta(),
            ModelArg::Lut => self.table(),
            ModelArg::Lensfun => self.lensfun(),
            ModelArg::Colmap => self.colmap(args.colmap_model),
            ModelArg::PsfFits | ModelArg::PsfNpy | ModelArg::PsfZarr | ModelArg::IsetCam => {
                unreachable!("not fitted")
            }
        }
    }

    fn radial(&self, model: &OpenCv) -> Residual {
        self.target.residual_px(|p| self.target.focal_mm * model.radius(p.tan))
    }

    fn angular(&self, model: &Fisheye) -> Residual {
        self.target.residual_px(|p| self.target.focal_mm * model.radius(p.angle_rad))
    }

    /// The YAML of OpenCV.
    fn calibration(&self, distortion: &[f64], is_fisheye: bool, residual: Residual) -> Fit {
        let calibration = Calibration {
            lens: &self.opened.lens().name,
            wavelength_nm: self.wavelength_nm(),
            intrinsics: self.intrinsics(),
            residual_px: [residual.max, residual.rms],
        };
        let names: &[&str] = match (is_fisheye, distortion.len()) {
            (true, _) => &["k1", "k2", "k3", "k4"],
            (false, 5) => &["k1", "k2", "p1", "p2", "k3"],
            _ => &["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"],
        };
        Fit {
            text: yaml(&calibration, distortion, is_fisheye),
            coefficients: named(names, distortion),
            residuals: vec![("distortion", residual)],
            principal_point: self.intrinsics().principal_point(0.0),
            illumination_error: None,
        }
    }

    fn opencv(&self, terms: Terms) -> Result<Fit> {
        let model = match terms {
            Terms::Five => OpenCv::polynomial(self.target)?,
            Terms::Eight => OpenCv::rational(self.target)?,
        };
        let ([k1, k2, k3], [k4, k5, k6]) = (model.numerator, model.denominator);
        let all = [k1, k2, 0.0, 0.0, k3, k4, k5, k6];
        let used = if terms == Terms::Five { 5 } else { 8 };
        Ok(self.calibration(&all[..used], false, self.radial(&model)))
    }

    fn fisheye(&self) -> Result<Fit> {
        let model = Fisheye::fit(self.target)?;
        Ok(self.calibration(&model.k, true, self.angular(&model)))
    }

    fn colmap(&self, model: ColmapModel) -> Result<Fit> {
        let (model, residual) = match model {
            ColmapModel::OpenCvFisheye => {
                let fit = Fisheye::fit(self.target)?;
                (colmap::Model::OpenCvFisheye(fit), self.angular(&fit))
            }
            ColmapModel::FullOpenCv => {
                let fit = OpenCv::rational(self.target)?;
                (colmap::Model::FullOpenCv(fit), self.radial(&fit))
            }
            ColmapModel::OpenCv | ColmapModel::Radial => {
                let fit = OpenCv::two_terms(self.target)?;
                let is_radial = model == ColmapModel::Radial;
                let kind = if is_radial { colmap::Model::Radial(fit) } else { colmap::Model::OpenCv(fit) };
                (kind, self.radial(&fit))
            }
        };
        let intrinsics = self.intrinsics();
        let nm = self.wavelength_nm();
        Ok(Fit {
            text: colmap::cameras(&self.opened.lens().name, nm, &intrinsics, &model),
            coefficients: json!({ "model": model.name(), "params": model.parameters(&intrinsics) }),
            residuals: vec![("distortion", residual)],
            principal_point: intrinsics.principal_point(0.5),
            illumination_error: None,
        })
    }

    fn ftheta(&self) -> Result<Fit> {
        let (model, target) = (FTheta::fit(self.target)?, self.target);
        let pitch_mm = self.film.pitch_mm;
        let forward = target.residual_px(|p| pitch_mm * model.distance_px(p.angle_rad));
        // Angles as pixels of the film: of the forward polynomial at both angles.
        let back = |p: &FieldPoint| model.distance_px(model.angle_rad(p.real_mm / pitch_mm));
        let inverse = target.residual(|p| back(p) - model.distance_px(p.angle_rad));
        let intrinsics = self.intrinsics();
        Ok(Fit {
            text: rig::json(&self.opened.lens().name, &intrinsics, &model),
            coefficients: json!({ "angle_to_pixeldistance": model.forward, "pixeldistance_to_angle": model.inverse }),
            residuals: vec![("distortion", forward), ("inverse", inverse)],
            principal_point: intrinsics.principal_point(0.5),
            illumination_error: None,
        })
    }

    fn table(&self) -> Result<Fit> {
        let (source, last_mm) = (self.source(), self.film.area.last_mm());
        let scale_mm = source.ideal_scale_mm();
        let height = |i: usize| last_mm * i as f64 / (ROWS - 1) as f64;
        let points = (0..ROWS).into_par_iter().map(|i| source.point_at(height(i)));
        let points: Vec<FieldPoint> = points.collect::<Result<_, _>>()?;
        let row = |(point, relative_illumination): (&FieldPoint, f64)| Row {
            field_angle_deg: point.angle_rad.to_degrees(),
            ideal_height_mm: scale_mm * point.tan,
            image_height_mm: point.real_mm,
            relative_illumination,
        };
        let rows: Vec<Row> = std::iter::zip(&points, source.illumination(&points)?).map(row).collect();
        // What linear interpolation of the table makes of a field point.
        let interpolated = |p: &FieldPoint| {
            let ideal_mm = scale_mm * p.tan;
            let k = rows.partition_point(|row| row.ideal_height_mm < ideal_mm).clamp(1, ROWS - 1);
            let (a, b) = (&rows[k - 1], &rows[k]);
            let share = (ideal_mm - a.ideal_height_mm) / (b.ideal_height_mm - a.ideal_height_mm);
            a.image_height_mm + share * (b.image_height_mm - a.image_height_mm)
        };
        Ok(Fit {
            text: csv(&rows),
            coefficients: json!({ "rows": ROWS }),
            residuals: vec![("linear interpolation", self.target.residual_px(interpolated))],
            principal_point: self.intrinsics().principal_point(0.0),
            illumination_error: None,
        })
    }

    fn lensfun(&self) -> Result<Fit> {
        let (target, lens, size) = (self.target, self.opened.lens(), self.film.size);
        let half_mm = [size.width, size.height].map(|n| 0.5 * n as f64 * self.film.pitch_mm);
        let smaller_mm = half_mm[0].min(half_mm[1]);
        let distortion = PtLens::fit(target, Projection::of_field(&target.last()), smaller_mm)?;
        let colour = |source: &FieldSource<'_>| LateralColour::fit(target, source, smaller_mm);
        let [red, blue] = [colour(&self.sources[0])?, colour(&self.sources[2])?];
        let vignetting = Vignetting::fit(target, self.source(), half_mm[0].hypot(half_mm[1]))?;
        let profile = Profile {
            lens: &lens.name,
            focal_mm: target.focal_mm,
            f_number: lens.f_number,
            distance_m: lens.object_distance_mm.map_or(f64::INFINITY, |mm| mm * 1e-3),
            size,
            pitch_mm: self.film.pitch_mm,
            distortion,
            lateral_colour: [red, blue],
            vignetting,
        };
        let residual = target.residual_px(|p| distortion.real_mm(target, p));
        Ok(Fit {
            text: lensfun::xml(&profile),
            coefficients: json!({
                "cropfactor": profile.crop_factor(),
                "focal": target.focal_mm * distortion.scale,
                "ptlens": named(&["a", "b", "c"], &distortion.abc),
                "tca": {
                    "red": named(&["v", "c", "b"], &red.vcb),
                    "blue": named(&["v", "c", "b"], &blue.vcb),
                },
                "pa": named(&["k1", "k2", "k3"], &vignetting.k),
            }),
            residuals: vec![("distortion", residual), ("red", red.residual), ("blue", blue.residual)],
            principal_point: self.intrinsics().principal_point(0.0),
            illumination_error: Some(vignetting.residual.max),
        })
    }
}

fn named(names: &[&str], values: &[f64]) -> Value {
    Value::Object(std::iter::zip(names, values).map(|(n, v)| ((*n).to_owned(), json!(v))).collect())
}
