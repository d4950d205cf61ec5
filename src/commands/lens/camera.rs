//! `lenscube lens camera`: the pinhole camera whose picture is the chart of a film.
//!
//! The chart is what a pinhole at the centre of the entrance pupil (paraxial, primary wavelength) sees along the axis, on the ideal image plane:
//!
//! ```text
//! x = f_D·tan(angle)                     f_D: distortion focal length of the film in focus, mm
//! n = film + 2·overscan                  pixels of the chart, of the film's pitch p
//! overscan = max(ideal − real)/p + m     over the film's border and the design's wavelengths: distortion; m: half a PSF window
//! field of view = 2·atan(n·p/(2 f_D))
//! ```
//! m = 1.2 ρ + 12 px for a blur of radius ρ, as windows of depth nodes, else 64 px.
//!
//! Conventions of renderers: Blender's lens and sensor width have the ratio f_D : n·p, its Z pass is the distance along the axis. PBRT's fov is that of the
//! picture's narrower side; its film `gbuffer` writes positions in the camera's frame, of which P.Z is the distance along the axis
//! (pbrt.org/fileformat-v4). Mitsuba's fov is that of `fov_axis`, and its AOV depth the distance from the pinhole, along the ray
//! (mitsuba.readthedocs.io, integrator aov); it begins at the near clipping plane, which is set to 0.1 mm.

use crate::args::{CameraArgs, Renderer};
use crate::design;
use crate::progress::print;
use anyhow::{Context, Result};
use pipeline::design::System;
use pipeline::design::paraxial::Paraxial;
use pipeline::design::ray::Tracer;
use pipeline::geometry::Size;
use pipeline::real;
use serde_json::json;

/// Points on a side of the film at which distortion is looked for.
const POINTS: usize = 17;
/// Margin without distances of the scene, px.
const MARGIN_PX: usize = 64;

/// A pinhole camera.
struct Pinhole {
    /// Pinhole behind the first vertex, mm.
    pupil_mm: f64,
    /// Film from the pinhole, mm.
    focal_mm: f64,
    /// Pixels of the picture.
    size: Size,
    overscan_px: usize,
    pitch_um: f64,
    /// Blur radius per dioptre, µm.
    blur_um: f64,
}

impl Pinhole {
    fn new(args: &CameraArgs, system: &System) -> Result<Self> {
        let first = Paraxial::new(system, system.primary_um())?;
        let blur_um = first.entrance_radius_mm * first.distortion_focal_length_mm.abs();
        let margin_px = match args.depths_m {
            None => MARGIN_PX,
            Some((far, near)) => {
                let focus = args.focus_m.map_or_else(|| system.object_vergence(), |m| Ok(1.0 / m))?;
                let blur = (far - focus).abs().max((near - focus).abs()) * blur_um / args.film_pitch_um;
                (1.2 * blur + 12.0).ceil() as usize
            }
        };
        let distortion_px = beyond_mm(system, args)? * 1e3 / args.film_pitch_um;
        let overscan_px = margin_px + distortion_px.ceil() as usize;
        let size = Size::new(args.film_size.height + 2 * overscan_px, args.film_size.width + 2 * overscan_px);
        Ok(Self {
            pupil_mm: first.entrance_pupil_mm,
            focal_mm: first.distortion_focal_length_mm.abs(),
            size,
            overscan_px,
            pitch_um: args.film_pitch_um,
            blur_um,
        })
    }

    /// Width or height of the picture on the ideal image plane, mm.
    fn side_mm(&self, px: usize) -> f64 {
        px as f64 * self.pitch_um * 1e-3
    }

    /// Angle between opposite sides `px` apart, degrees.
    fn fov_deg(&self, px: usize) -> f64 {
        (2.0 * real::atan2(self.side_mm(px) / 2.0, self.focal_mm)).to_degrees()
    }
}

/// How far the ideal image plane under the film reaches beyond the film's sides, mm: barrel distortion.
fn beyond_mm(system: &System, args: &CameraArgs) -> Result<f64> {
    let half = |px: usize| px as f64 * args.film_pitch_um * 0.5e-3;
    let (half_x, half_y) = (half(args.film_size.width), half(args.film_size.height));
    let mut worst: f64 = 0.0;
    for (um, _) in &system.wavelengths_um {
        let tracer = Tracer::new(system, *um)?;
        // Along the right side x is constant, along the upper one y; the others are mirror images.
        for i in 0..POINTS {
            let share = i as f64 / (POINTS - 1) as f64;
            for (x, y, fixed) in [(half_x, share * half_y, half_x), (share * half_x, half_y, half_y)] {
                let real_mm = real::hypot(x, y);
                let tan = tracer.field_of_height(real_mm).with_context(|| {
                    format!("the film's border at {real_mm:.3} mm from the axis; a smaller --film-size lies within the lens's field")
                })?;
                worst = worst.max(fixed * (tan * tracer.ideal_scale_mm().abs() / real_mm - 1.0));
            }
        }
    }
    Ok(worst)
}

/// Runs the command.
pub fn command(args: &CameraArgs) -> Result<()> {
    let (system, _) = design::focused(&args.design, &args.parameters, args.focus_m)?;
    let camera = Pinhole::new(args, &system).with_context(|| format!("camera of {}", args.design))?;
    print(match (args.renderer, args.json) {
        (Some(renderer), _) => renderer_text(renderer, &camera),
        (None, true) => serde_json::to_string_pretty(&json!({
            "pinhole_behind_first_vertex_mm": camera.pupil_mm,
            "focal_length_mm": camera.focal_mm,
            "width_px": camera.size.width,
            "height_px": camera.size.height,
            "overscan_px": camera.overscan_px,
            "pitch_um": camera.pitch_um,
            "width_mm": camera.side_mm(camera.size.width),
            "height_mm": camera.side_mm(camera.size.height),
            "horizontal_fov_deg": camera.fov_deg(camera.size.width),
            "vertical_fov_deg": camera.fov_deg(camera.size.height),
            "blur_per_dioptre_um": camera.blur_um,
        }))?,
        (None, false) => text(args, &camera),
    });
    Ok(())
}

fn text(args: &CameraArgs, camera: &Pinhole) -> String {
    let Size { width, height } = camera.size;
    let focus = args.focus_m.map_or_else(String::new, |m| format!(" --focus-m {m}"));
    format!(
        "pinhole                 {:.4} mm behind the first vertex, on the axis, looking along it\n\
         focal length            {:.6} mm\n\
         picture                 {} px of {} µm: {:.4} x {:.4} mm\n\
         field of view           {:.6} x {:.6} deg\n\
         overscan                {} px on each side of the film of {}\n\
         blur radius             {:.3} px per dioptre from focus\n\
         use its picture with    lenscube run CHART FILM --lens {}{focus} --film-size {} --film-pitch-um {}",
        camera.pupil_mm,
        camera.focal_mm,
        camera.size,
        camera.pitch_um,
        camera.side_mm(width),
        camera.side_mm(height),
        camera.fov_deg(width),
        camera.fov_deg(height),
        camera.overscan_px,
        args.film_size,
        camera.blur_um / camera.pitch_um,
        args.design,
        args.film_size,
        args.film_pitch_um,
    )
}

fn renderer_text(renderer: Renderer, camera: &Pinhole) -> String {
    let Size { width, height } = camera.size;
    match renderer {
        // Blender clips small sensors: only the ratio matters.
        Renderer::Blender => format!(
            "import bpy\n\
             # Location: {:.4} mm behind the lens's first vertex. Z of the view layer: --depth-kind planar\n\
             scene = bpy.context.scene\n\
             data = scene.camera.data\n\
             data.type, data.sensor_fit = \"PERSP\", \"HORIZONTAL\"\n\
             data.sensor_width, data.lens = 36.0, {:.9}\n\
             data.shift_x = data.shift_y = 0.0\n\
             data.dof.use_dof = False\n\
             scene.render.resolution_x, scene.render.resolution_y = {width}, {height}\n\
             scene.render.resolution_percentage = 100\n\
             scene.render.pixel_aspect_x = scene.render.pixel_aspect_y = 1.0\n\
             bpy.context.view_layer.use_pass_z = True",
            camera.pupil_mm,
            36.0 * camera.focal_mm / camera.side_mm(width)
        ),
        Renderer::Pbrt => format!(
            "# LookAt: eye {:.4} mm behind the lens's first vertex. Depth: P.Z, --depth-kind planar\n\
             Camera \"perspective\" \"float fov\" [ {:.9} ]\n\
             Film \"gbuffer\" \"integer xresolution\" [ {width} ] \"integer yresolution\" [ {height} ] \"string coordinatesystem\" [ \"camera\" ] \"string filename\" [ \"scene.exr\" ]",
            camera.pupil_mm,
            camera.fov_deg(width.min(height))
        ),
        Renderer::Mitsuba => format!(
            "<!-- to_world: origin {:.4} mm behind the lens's first vertex. Depth: aov dd:depth, --depth-kind ray -->\n\
             <sensor type=\"perspective\">\n    \
             <string name=\"fov_axis\" value=\"x\"/>\n    \
             <float name=\"fov\" value=\"{:.9}\"/>\n    \
             <float name=\"near_clip\" value=\"0.0001\"/>\n    \
             <film type=\"hdrfilm\">\n        \
             <integer name=\"width\" value=\"{width}\"/>\n        \
             <integer name=\"height\" value=\"{height}\"/>\n        \
             <rfilter type=\"box\"/>\n    \
             </film>\n\
             </sensor>",
            camera.pupil_mm,
            camera.fov_deg(width)
        ),
    }
}
