//! The mesh before the camera of a lens, and the frame of the chart.

use super::chart_frame::{check_size, frame, margin_note, pinhole};
use super::illuminant::illuminant;
use super::scratch;
use super::seen::Seen;
use crate::args::{MeshUnit, MissingTextures, SceneArgs, SolidsArg, UpAxisArg};
use crate::design;
use crate::failure::usage;
use crate::machine::{MAX_DEFAULT, MemoryLimit, threads};
use crate::outputs::Guard;
use crate::progress::mib;
use anyhow::{Context, Result};
use formats::mesh::{self, Limits, SourceFile};
use formats::mesh_name::is_mesh;
use pipeline::design::pinhole::Pinhole;
use pipeline::scene::description::{Camera, Scene};
use pipeline::scene::frame::Frame;
use pipeline::scene::horizon::UpAxis;
use pipeline::scene::mesh::{Mesh, MeshError, MeshOptions};
use pipeline::scene::pose::Pose;
use pipeline::scratch::Scratch;
use std::path::PathBuf;

/// Distance in focal lengths below which a surface is too near for a picture.
const NEAR_FOCAL_LENGTHS: f64 = 10.0;
/// Difference of the file's field of view and the film's, relative, from which on it is told.
const OTHER_FIELD: f64 = 0.01;

/// Share by which a vergence may exceed that of `--depths-m`.
const NEARER: f64 = 0.02;
/// What a scene is made of.
pub struct Prepared {
    /// As the file has it.
    pub scene: Scene,
    /// The files that were read, the mesh first.
    pub sources: Vec<SourceFile>,
    /// Place and axes of the camera.
    pub pose: Pose,
    /// Name of the camera, if it is one of the file.
    pub camera: Option<String>,
    /// Triangles in the camera frame.
    pub mesh: Mesh,
    /// The lens's pinhole, with the size of the chart.
    pub pinhole: Pinhole,
    /// The chart.
    pub frame: Frame,
    /// Metres per unit of the file.
    pub unit_m: f64,
    /// Axis of the file that points up.
    pub up: UpAxis,
    /// Surfaces that are nearer are cut, or too near, m.
    pub near_m: f64,
    /// Limit of memory.
    pub limit: MemoryLimit,
    /// Worker threads.
    pub threads: usize,
    /// Number of textures.
    pub textures: usize,
    /// Share of the chart in which there is a surface.
    pub covered: f64,
    /// Notes to print.
    pub notes: Vec<String>,
}

impl Prepared {
    /// Reads the mesh of `args` and places it before the camera.
    ///
    /// # Errors
    /// The design cannot be focused; the film is beyond its field; the mesh cannot be read or has no triangle before the camera; its camera is not known.
    pub fn new(args: &SceneArgs) -> Result<Self> {
        let (system, _) = design::focused(&args.lens, &args.design, args.focus_m)?;
        let pinhole = |range| pinhole(args, &system, range);
        let first = pinhole(None)?;
        check_size(args, &first)?;
        let focal_mm = first.focal_mm;
        let near_m = args.view.near_m.unwrap_or(NEAR_FOCAL_LENGTHS * focal_mm * 1e-3);
        let limit = MemoryLimit::new(args.memory, MAX_DEFAULT);
        let (unit_m, up) = unit_and_axis(args)?;
        illuminant(args)?;
        if let Some(folder) = args.look.allow_path.iter().find(|folder| !folder.is_dir()) {
            return Err(usage(format!("--allow-path {}: there is no such folder", folder.display())));
        }
        let folder = scratch::folder(args.out.as_deref());
        let lists = Scratch::new(&folder, limit.bytes);
        let limits = Limits {
            scratch: lists.clone(),
            allow_paths: args.look.allow_path.clone(),
            missing_textures_grey: args.look.missing_textures == MissingTextures::Grey,
            ..Limits::of_memory(limit.bytes)
        };
        let (mut scene, sources) = mesh::read(&args.mesh, &limits).map_err(|e| match e {
            mesh::MeshError::Io { .. } => e.into(),
            mesh::MeshError::Scratch(e) => scratch::no_space(&e),
            e => usage(e.to_string()),
        })?;
        check_outputs(args, &sources)?;
        let mut notes = std::mem::take(&mut scene.notes);
        notes.extend(sun_note(args));
        let (pose, camera) = pose(args, &scene, unit_m, up)?;
        let read: usize = scene.bytes();
        check_memory(&limit, read, "the mesh with its textures")?;
        let triangles: u64 = scene.parts.iter().map(|part| part.geometry.triangles.len() as u64).sum();
        scratch::check_space(&lists, &folder, triangles)?;
        let options = MeshOptions {
            unit_m,
            solids: args.surfaces.solids == SolidsArg::Auto,
            two_sided: args.surfaces.two_sided,
        };
        let mesh = Mesh::with_scratch(&scene.parts, &scene.materials, &pose, options, &lists);
        let mesh = mesh.map_err(|e| match e {
            MeshError::Scratch(e) => scratch::no_space(&e),
            e => usage(format!("mesh {}: {e}", args.mesh.display())),
        })?;
        let facts = mesh.facts();
        let range = args.depths_m.unwrap_or((1.0 / facts.farthest_m, 1.0 / facts.nearest_m.max(near_m)));
        let range = (range.0.min(range.1), range.1);
        // What lies between corners, such as a floor below the camera, may be seen nearer than any of them.
        let coarse = Seen::new(args, &mesh, &scene.parts, &pinhole(Some(range))?, near_m)?;
        let nearest = coarse.nearest_vergence.max(range.1);
        if args.depths_m.is_some() && nearest > range.1 * (1.0 + NEARER) {
            return Err(usage(format!(
                "--depths-m: a surface at {:.4} m is seen, nearer than {:.4} m; give the nearest distance",
                1.0 / nearest,
                1.0 / range.1
            )));
        }
        let pinhole = pinhole(Some((range.0, nearest)))?;
        if facts.degenerate > 0 {
            notes.push(format!(
                "{} of {} triangles have two equal corners and are left out",
                facts.degenerate, facts.triangles
            ));
        }
        notes.extend(distance_note(facts.nearest_m, facts.farthest_m));
        if let Some(camera) = camera {
            notes.extend(field_note(args, camera, &pinhole));
        }
        notes.extend(margin_note(&pinhole));
        let frame = frame(args, &pinhole, 1.0)?;
        let camera = camera.map(|camera| camera.name.clone());
        let (threads, textures) = (threads(args.threads), scene.textures.len());
        Ok(Self {
            sources,
            pose,
            camera,
            mesh,
            pinhole,
            frame,
            unit_m,
            up,
            near_m,
            limit,
            threads,
            textures,
            covered: coarse.covered,
            notes,
            scene,
        })
    }

    /// Bytes in memory of the mesh, as the file has it and before the camera.
    pub fn bytes(&self) -> usize {
        self.mesh.bytes() + self.scene.bytes()
    }

    /// Blur radius per dioptre in chart pixels.
    pub fn blur_px(&self) -> f64 {
        self.pinhole.blur_um / self.pinhole.pitch_um
    }
}

/// Fails if `what` takes more than the limit of memory.
///
/// # Errors
/// Usage.
pub fn check_memory(limit: &MemoryLimit, bytes: usize, what: &str) -> Result<()> {
    match bytes as u64 > limit.bytes {
        true => Err(limit.too_small(format!("{what} takes {}", mib(bytes)))),
        false => Ok(()),
    }
}

/// Metres per unit of the file, and its upward axis.
fn unit_and_axis(args: &SceneArgs) -> Result<(f64, UpAxis)> {
    let axis = match args.view.up_axis {
        None | Some(UpAxisArg::Y) => UpAxis::Y,
        Some(UpAxisArg::Z) => UpAxis::Z,
    };
    std::fs::metadata(&args.mesh).with_context(|| format!("mesh {}", args.mesh.display()))?;
    if !is_mesh(&args.mesh) {
        // Refused by its name when it is read.
        return Ok((1.0, axis));
    }
    let given = [("--mesh-unit", args.view.mesh_unit.is_some()), ("--up-axis", args.view.up_axis.is_some())];
    match (mesh::is_gltf(&args.mesh), args.view.mesh_unit) {
        (true, _) => match given.iter().find(|(_, given)| *given) {
            Some((flag, _)) => Err(usage(format!(
                "{flag} applies to OBJ and PLY, which do not state it; glTF is in metres with +Y up: {}",
                args.mesh.display()
            ))),
            None => Ok((1.0, axis)),
        },
        (false, Some(unit)) => Ok((MeshUnit::metres(unit), axis)),
        (false, None) => Err(usage(format!(
            "{}: OBJ and PLY files do not state the unit of their positions; give --mesh-unit m, cm, mm, in or ft",
            args.mesh.display()
        ))),
    }
}

/// Fails if the scene is, contains or lies in one of the files of the mesh.
fn check_outputs(args: &SceneArgs, sources: &[SourceFile]) -> Result<()> {
    let folder = args.mesh.parent().unwrap_or(std::path::Path::new(""));
    let files = sources
        .iter()
        .map(|source| if source.path == args.mesh { source.path.clone() } else { folder.join(&source.path) });
    let guard =
        Guard::default().reads_as("mesh", &args.mesh.display().to_string(), files.collect::<Vec<PathBuf>>());
    guard.may_write("SCENE", args.out.as_ref()).check()
}

/// Place and axes of the camera, and the file's camera, if it is one.
fn pose<'a>(
    args: &SceneArgs,
    scene: &'a Scene,
    unit_m: f64,
    up: UpAxis,
) -> Result<(Pose, Option<&'a Camera>)> {
    let listed = || match scene.cameras.is_empty() {
        true => "it has none".to_owned(),
        false => {
            let names = scene.cameras.iter().enumerate().map(|(i, c)| format!("{i} `{}`", c.name));
            format!("its cameras are {}", names.collect::<Vec<_>>().join(", "))
        }
    };
    if let (Some(eye), Some(target)) = (args.view.eye, args.view.target) {
        let default_up = match up {
            UpAxis::Y => [0.0, 1.0, 0.0],
            UpAxis::Z => [0.0, 0.0, 1.0],
        };
        let pose = Pose::looking(eye, target, args.view.up.unwrap_or(default_up));
        return Ok((pose.map_err(|e| usage(format!("--eye, --target, --up: {e}")))?, None));
    }
    let camera = match (&args.view.camera, &scene.cameras[..]) {
        (None, [only]) => only,
        (None, []) => {
            return Err(usage(format!(
                "{}: no camera in the file; give its place and direction by --eye X,Y,Z --target X,Y,Z",
                args.mesh.display()
            )));
        }
        (None, _) => {
            return Err(usage(format!(
                "{}: several cameras; choose one by --camera: {}",
                args.mesh.display(),
                listed()
            )));
        }
        (Some(given), all) => {
            let by_number = given.parse::<usize>().ok().and_then(|n| all.get(n));
            let mut of_name = all.iter().filter(|camera| camera.name == *given);
            let (first, second) = (of_name.next(), of_name.next());
            if second.is_some() {
                return Err(usage(format!(
                    "--camera {given}: several cameras have this name; give the number: {}",
                    listed()
                )));
            }
            let named = first.or(by_number);
            named.ok_or_else(|| {
                usage(format!("--camera {given}: {} has no such camera; {}", args.mesh.display(), listed()))
            })?
        }
    };
    if camera.yfov_rad.is_none() {
        return Err(usage(format!(
            "{}: camera `{}` is orthographic, which no lens is; choose another by --camera, or give --eye and --target",
            args.mesh.display(),
            camera.name
        )));
    }
    let pose = Pose::of_node(&camera.to_world, unit_m)
        .map_err(|e| usage(format!("{}: camera `{}`: {e}", args.mesh.display(), camera.name)))?;
    Ok((pose, Some(camera)))
}

/// A note if the field of view of the file's camera is not that of the film.
fn field_note(args: &SceneArgs, camera: &Camera, pinhole: &Pinhole) -> Option<String> {
    let film_deg = pinhole.fov_deg(args.film_size.height);
    let file_deg = camera.yfov_rad?.to_degrees();
    ((file_deg / film_deg - 1.0).abs() > OTHER_FIELD).then(|| {
        format!(
            "camera `{}` has a vertical field of view of {file_deg:.2} deg, the film behind {} has {film_deg:.2} deg, which is used",
            camera.name, args.lens
        )
    })
}

/// A note on a sun below the horizon.
fn sun_note(args: &SceneArgs) -> Option<String> {
    let sun = args.look.sun.filter(|sun| sun.elevation_deg < 0.0)?;
    Some(format!(
        "--sun: it is {} deg below the horizon: what faces up is dark, and only the mesh casts shadows on what faces down",
        -sun.elevation_deg
    ))
}

/// A note on distances that look like those of another unit.
fn distance_note(nearest_m: f64, farthest_m: f64) -> Option<String> {
    let look = |what: &str, m: f64| {
        Some(format!("the {what} corner before the camera is {m:.3e} m from it; is the unit right?"))
    };
    match () {
        () if farthest_m > 1e6 => look("farthest", farthest_m),
        () if farthest_m < 1e-3 => look("farthest", farthest_m),
        () if nearest_m > 1e6 => look("nearest", nearest_m),
        () => None,
    }
}
