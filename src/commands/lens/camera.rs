//! `lenscube lens camera`: the pinhole camera whose picture is the chart of a film.
//!
//! [`Pinhole`] has the equations.
//!
//! Conventions of renderers: Blender's lens and sensor width have the ratio f_D : n·p, its Z pass is the distance along the axis. PBRT's fov is that of the
//! picture's narrower side; its film `gbuffer` writes positions in the camera's frame, of which P.Z is the distance along the axis
//! (pbrt.org/fileformat-v4). Mitsuba's fov is that of `fov_axis`, and its AOV depth the distance from the pinhole, along the ray
//! (mitsuba.readthedocs.io, integrator aov); it begins at the near clipping plane, which is set to 0.1 mm.

use crate::args::{CameraArgs, Renderer};
use crate::design;
use crate::progress::print;
use anyhow::{Context, Result};
use pipeline::design::pinhole::Pinhole;
use pipeline::geometry::Size;
use serde_json::json;

/// Runs the command.
pub fn command(args: &CameraArgs) -> Result<()> {
    let (system, _) = design::focused(&args.design, &args.parameters, args.focus_m)?;
    let camera = Pinhole::new(&system, args.film_size, args.film_pitch_um, args.depths_m)
        .with_context(|| format!("camera of {}", args.design))?;
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
