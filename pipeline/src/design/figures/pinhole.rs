//! The pinhole camera whose picture is the chart of a film: the centre of the entrance pupil (paraxial, primary wavelength), looking along the axis, on the
//! ideal image plane.
//!
//! ```text
//! x = f_D·tan(angle)                     f_D: distortion focal length of the film in focus, mm
//! n = film + 2·overscan                  pixels of the chart, of the film's pitch p
//! overscan = max(ideal − real)/p + m     over the film's border and the design's wavelengths: distortion; m: half a PSF window
//! field of view = 2·atan(n·p/(2 f_D))
//! ```
//! m = 1.2 ρ + 12 px for a blur of radius ρ, as windows of depth nodes, else 64 px.
//!
//! A chart in the projection of the film ([`crate::projection`]) is as large as the film and m, and what lateral colour moves: overscan = max|ρ(θ) − r|/p + m. Its directions are those
//! of the chief rays at the primary wavelength. Where its corners would see more than [`MAX_DEG`] from the axis, the margin is narrower.

use crate::design::prescription::error::DesignError;
use crate::design::prescription::system::System;
use crate::design::rays::paraxial::Paraxial;
use crate::design::rays::ray::Tracer;
use crate::geometry::Size;
use crate::projection::{FilmProjection, MAX_DEG, Projection};
use crate::real;

/// Points on a side of the film at which distortion is looked for.
const POINTS: usize = 17;
/// Margin without distances of the scene, px.
const MARGIN_PX: usize = 64;

/// A pinhole camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pinhole {
    /// Pinhole behind the first vertex, mm.
    pub pupil_mm: f64,
    /// Film from the pinhole, mm.
    pub focal_mm: f64,
    /// Pixels of the picture.
    pub size: Size,
    /// Pixels of the picture beyond each side of the film.
    pub overscan_px: usize,
    /// Of these, those that blur needs.
    pub margin_px: usize,
    /// Pixel pitch, µm.
    pub pitch_um: f64,
    /// Blur radius per dioptre, µm.
    pub blur_um: f64,
    /// The plane of the picture.
    pub projection: Projection,
}

/// A pinhole camera that does not exist.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PinholeError {
    /// Rays or paraxial data.
    #[error(transparent)]
    Design(#[from] DesignError),
    /// A film beyond the field.
    #[error(
        "the film's border at {real_mm:.3} mm from the axis; a smaller --film-size lies within the lens's field"
    )]
    Border {
        /// Distance of the point of the border, mm.
        real_mm: f64,
        /// Its ray.
        source: DesignError,
    },
    /// A projection that no picture has.
    #[error(
        "the projection of the film: the angles of chief rays do not ascend with their heights on the film up to {reach_mm:.3} mm"
    )]
    Folded {
        /// Height up to which it was looked for, mm.
        reach_mm: f64,
    },
}

impl Pinhole {
    /// The pinhole of `system`, in focus, for a film of `film` pixels of `pitch_um`. `range`: vergences of the scene's surfaces, farthest and nearest, 1/m.
    ///
    /// # Errors
    /// [`PinholeError`]: the film's border lies beyond the field; the lens has no paraxial image.
    pub fn new(
        system: &System,
        film: Size,
        pitch_um: f64,
        range: Option<(f64, f64)>,
    ) -> Result<Self, PinholeError> {
        let pinhole = Self::of_film(system, film, pitch_um, range)?;
        Ok(pinhole.with_overscan(film, beyond_mm(system, film, pitch_um)? * 1e3 / pitch_um))
    }

    /// As [`Pinhole::new`], with the picture in the projection of the film.
    ///
    /// # Errors
    /// [`PinholeError`].
    pub fn on_film(
        system: &System,
        film: Size,
        pitch_um: f64,
        range: Option<(f64, f64)>,
    ) -> Result<Self, PinholeError> {
        let planar = Self::of_film(system, film, pitch_um, range)?;
        let tracer = Tracer::new(system, system.primary_um())?;
        let half = |px: usize| 0.5e-3 * px as f64 * pitch_um;
        let corner =
            |beyond: usize| real::hypot(half(film.height + 2 * beyond), half(film.width + 2 * beyond));
        let fit = |reach_mm: f64| {
            let angle = |r: f64| Ok(real::atan(tracer.field_of_height(r)?));
            let source = |source| PinholeError::Border { real_mm: reach_mm, source };
            let fitted = FilmProjection::fit(planar.focal_mm, reach_mm, angle).map_err(source)?;
            fitted.ok_or(PinholeError::Folded { reach_mm })
        };
        // The margin may lie beyond the field.
        let projection = fit(corner(planar.margin_px)).or_else(|_| fit(corner(0)))?;
        let mut moved_mm: f64 = 0.0;
        for (um, _) in &system.wavelengths_um {
            let tracer = Tracer::new(system, *um)?;
            for i in 1..=POINTS {
                let real_mm = corner(0) * i as f64 / POINTS as f64;
                let source = |source| PinholeError::Border { real_mm, source };
                let tan = tracer.field_of_height(real_mm).map_err(source)?;
                let on_chart = projection.height_mm(real::atan(tan));
                moved_mm = moved_mm.max((on_chart - real_mm).abs());
            }
        }
        let pinhole = Self { projection: Projection::Film(projection), ..planar };
        let mut pinhole = pinhole.with_overscan(film, moved_mm * 1e3 / pitch_um);
        while pinhole.overscan_px > 0 && pinhole.corner_deg() > MAX_DEG {
            pinhole = pinhole.reaching(film, pinhole.overscan_px - 1);
        }
        Ok(pinhole)
    }

    /// The pinhole by paraxial data; its picture, on the ideal image plane, is as large as the film.
    fn of_film(
        system: &System,
        film: Size,
        pitch_um: f64,
        range: Option<(f64, f64)>,
    ) -> Result<Self, PinholeError> {
        let first = Paraxial::new(system, system.primary_um())?;
        let focal_mm = first.distortion_focal_length_mm.abs();
        let blur_um = first.entrance_radius_mm * focal_mm;
        let focus_vergence = system.object_vergence()?;
        let margin_px = range.map_or(MARGIN_PX, |(far, near)| {
            let blur = (far - focus_vergence).abs().max((near - focus_vergence).abs()) * blur_um / pitch_um;
            (1.2 * blur + 12.0).ceil() as usize
        });
        let pupil_mm = first.entrance_pupil_mm;
        let projection = Projection::Planar;
        Ok(Self { pupil_mm, focal_mm, size: film, overscan_px: 0, margin_px, pitch_um, blur_um, projection })
    }

    fn with_overscan(self, film: Size, moved_px: f64) -> Self {
        self.reaching(film, self.margin_px + moved_px.ceil() as usize)
    }

    /// With a picture that reaches `overscan_px` pixels beyond each side of the film.
    fn reaching(self, film: Size, overscan_px: usize) -> Self {
        let size = Size::new(film.height + 2 * overscan_px, film.width + 2 * overscan_px);
        Self { size, overscan_px, ..self }
    }

    /// Angle from the axis of the corners of the picture, degrees.
    pub fn corner_deg(&self) -> f64 {
        self.projection.angle_rad(self.corner_mm(), self.focal_mm).to_degrees()
    }

    /// Height of the corners of the picture, mm from the axis.
    pub fn corner_mm(&self) -> f64 {
        0.5 * real::hypot(self.side_mm(self.size.height), self.side_mm(self.size.width))
    }

    /// Width or height of `px` pixels of the picture on its plane, mm.
    pub fn side_mm(&self, px: usize) -> f64 {
        px as f64 * self.pitch_um * 1e-3
    }

    /// Angle between opposite sides `px` apart, degrees.
    pub fn fov_deg(&self, px: usize) -> f64 {
        (2.0 * self.projection.angle_rad(self.side_mm(px) / 2.0, self.focal_mm)).to_degrees()
    }
}

/// How far the ideal image plane under the film reaches beyond the film's sides, mm: barrel distortion.
fn beyond_mm(system: &System, film: Size, pitch_um: f64) -> Result<f64, PinholeError> {
    let half = |px: usize| px as f64 * pitch_um * 0.5e-3;
    let (half_x, half_y) = (half(film.width), half(film.height));
    let mut worst: f64 = 0.0;
    for (um, _) in &system.wavelengths_um {
        let tracer = Tracer::new(system, *um)?;
        // Along the right side x is constant, along the upper one y; the others are mirror images.
        for i in 0..POINTS {
            let share = i as f64 / (POINTS - 1) as f64;
            for (x, y, fixed) in [(half_x, share * half_y, half_x), (share * half_x, half_y, half_y)] {
                let real_mm = real::hypot(x, y);
                let tan = tracer
                    .field_of_height(real_mm)
                    .map_err(|source| PinholeError::Border { real_mm, source })?;
                worst = worst.max(fixed * (tan * tracer.ideal_scale_mm().abs() / real_mm - 1.0));
            }
        }
    }
    Ok(worst)
}
