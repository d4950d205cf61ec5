//! What determines a scene: its identity, layout and attributes.

use super::illuminant::illuminant;
use super::prepared::Prepared;
use crate::args::{BackgroundArg, LightsArg, MissingTextures, ReachArg, SceneArgs, SolidsArg};
use crate::failure::usage;
use crate::film::digest;
use anyhow::Result;
use formats::object;
use formats::scene::{SceneLight, SceneSpec};
use pipeline::projection::Projection;
use pipeline::scene::appearance::{Appearance, Assigned};
use pipeline::scene::horizon::UpAxis;
use pipeline::scene::mesh::Mesh;
use pipeline::scene::shading::Shader;
use pipeline::scene::sheets::{Background, Settings};
use serde_json::{Map, Value, json};

/// Version of the rules by which a mesh becomes a scene; another one gives other numbers.
const RULES: u32 = 1;

/// A scene to be made.
pub struct SceneJob {
    /// Everything that changes its numbers.
    pub identity: Map<String, Value>,
    /// Layout of its arrays.
    pub spec: SceneSpec,
    /// Samples, surfaces, limits.
    pub settings: Settings,
    /// Distance from edges within which hidden surfaces are stored, px; `None`: everywhere.
    pub reach_px: Option<usize>,
    light: SceneLight,
    attributes: Map<String, Value>,
}

impl SceneJob {
    /// The job of `args`.
    ///
    /// # Errors
    /// An illuminant that is not known or invisible.
    pub fn new(
        args: &SceneArgs,
        prepared: &Prepared,
        appearance: &Appearance<'_, Mesh>,
        assigned: &[Assigned],
    ) -> Result<Self> {
        let pinhole = &prepared.pinhole;
        let light = SceneLight {
            bases: appearance.list_of_bases().to_vec(),
            illuminant: illuminant(args)?,
            illuminance_lx: args.look.illuminance,
        };
        check_visible(&light)?;
        let spec = SceneSpec {
            size: pinhole.size,
            sheets: args.surfaces.sheets,
            bases: light.bases.len(),
            pitch_um: pinhole.pitch_um,
            centre_mm: (0.0, 0.0),
            shard: SceneSpec::LAYOUT.0,
            chunk: SceneSpec::LAYOUT.1,
            half: args.surfaces.half,
            ids: args.surfaces.ids,
            projection: pinhole.projection,
        };
        if !spec.holds() {
            return Err(usage(format!(
                "the chart would have {} px with {} spectra: a smaller film, or --depths-m with a nearest distance farther away, has fewer",
                spec.size, spec.bases
            )));
        }
        let settings = settings(args, prepared, appearance);
        let reach_px = match args.surfaces.reach_px {
            None => Some(pinhole.margin_px),
            Some(ReachArg::Pixels(px)) => Some(px),
            Some(ReachArg::All) => None,
        };
        let around = environment(args, appearance);
        let identity = identity(args, prepared, assigned, &light, &settings, (reach_px, around));
        let attributes = attributes(args, prepared, &light, &settings);
        Ok(Self { identity, spec, settings, reach_px, light, attributes })
    }

    /// Names of the spectra.
    pub fn bases(&self) -> impl Iterator<Item = &str> {
        self.light.bases.iter().map(|basis| basis.name())
    }

    /// Bytes of a pixel of one surface in memory.
    pub fn plane_bytes(&self) -> usize {
        (self.spec.bases + 2 + usize::from(self.spec.ids)) * size_of::<f32>()
    }

    /// Bytes of all surfaces before compression.
    pub fn bytes(&self) -> u64 {
        self.spec.bytes()
    }

    /// Digest of everything that changes its numbers.
    pub fn digest(&self) -> String {
        digest(&Value::Object(self.identity.clone()))
    }

    /// Attributes of the scene but those of its layout.
    pub fn all_attributes(&self) -> Map<String, Value> {
        let layout = json!({ "shard": self.spec.shard, "chunk": self.spec.chunk });
        let identity = Value::Object(self.identity.clone());
        let mut all = self.attributes.clone();
        let provenance = object! {
            "program": concat!("lenscube ", env!("CARGO_PKG_VERSION")),
            "job_digest": self.digest(),
            "job": identity,
            "layout_digest": digest(&layout),
            "layout": layout,
        };
        all.insert("provenance".into(), provenance.into());
        all
    }
}

/// Fails if the illuminant has no power that is visible.
fn check_visible(light: &SceneLight) -> Result<()> {
    let invisible = light.illuminant.irradiance_scale(light.illuminance_lx).is_none();
    match invisible {
        true => Err(usage(format!(
            "--illuminant {}: it has no power from 380 to 780 nm, so no illuminance",
            light.illuminant.name()
        ))),
        false => Ok(()),
    }
}

fn settings(args: &SceneArgs, prepared: &Prepared, appearance: &Appearance<'_, Mesh>) -> Settings {
    let background = appearance.has_background().then(|| {
        let mut weights = vec![0.0; appearance.bases()];
        appearance.add_background(&mut weights);
        Background { vergence: args.look.background_m.map_or(0.0, |m| 1.0 / m), weights }
    });
    Settings {
        samples: args.surfaces.samples_per_px,
        sheets: args.surfaces.sheets,
        gap_dioptre: args.surfaces.gap_px / prepared.blur_px(),
        near_m: prepared.near_m,
        is_near_cut: args.view.near_m.is_some(),
        background,
    }
}

fn identity(
    args: &SceneArgs,
    prepared: &Prepared,
    assigned: &[Assigned],
    light: &SceneLight,
    settings: &Settings,
    (reach_px, around): (Option<usize>, Option<Value>),
) -> Map<String, Value> {
    let sources: Vec<Value> =
        prepared.sources.iter().map(|s| json!([s.bytes, s.blake3.to_hex().as_str()])).collect();
    let sun = args.look.sun.map(|sun| {
        json!([sun.azimuth_deg, sun.elevation_deg, sun.illuminance_lx.unwrap_or(args.look.illuminance)])
    });
    let mut map = object! {
        "rules": RULES,
        "sources": sources,
        "unit_m": prepared.unit_m,
        "up_axis": if prepared.up == UpAxis::Y { "y" } else { "z" },
        "eye": prepared.pose.eye,
        "right": prepared.pose.right,
        "down": prepared.pose.down,
        "forward": prepared.pose.forward,
        "film_size": [args.film_size.height, args.film_size.width],
        "film_pitch_um": args.film_pitch_um,
        "focal_mm": prepared.pinhole.focal_mm,
        "chart_size": [prepared.pinhole.size.height, prepared.pinhole.size.width],
        "samples_per_px": settings.samples,
        "sheets": settings.sheets,
        "gap_dioptre": settings.gap_dioptre,
        "reach_px": reach_px,
        "near_m": settings.is_near_cut.then_some(settings.near_m),
        "solids": args.surfaces.solids == SolidsArg::Auto,
        "two_sided": args.surfaces.two_sided,
        "materials": assigned.iter().map(|a| json!([a.materials, a.times_texture])).collect::<Vec<_>>(),
        "missing_textures_grey": args.look.missing_textures == MissingTextures::Grey,
        "sun": sun,
        "sky_lx": args.look.sky,
        "sky_samples": args.look.sky.map(|_| args.look.sky_directions()),
        "lights": args.look.lights == Some(LightsArg::File),
        "background": settings.background.as_ref().map(|b| json!({ "vergence": b.vergence, "weights": b.weights })),
    };
    map.extend(light.attributes());
    // Absent without: the identity is then that of programs without these options.
    if let Some(around) = around {
        map.insert("environment".into(), around);
    }
    if let Projection::Film(film) = prepared.pinhole.projection {
        map.insert("projection".into(), json!([film.radius_mm, film.coefficients]));
    }
    for (key, is_set) in [("half", args.surfaces.half), ("ids", args.surfaces.ids)] {
        if is_set {
            map.insert(key.into(), true.into());
        }
    }
    map
}

/// The light around the scene, by the content of its picture.
fn environment(args: &SceneArgs, appearance: &Appearance<'_, Mesh>) -> Option<Value> {
    let given = args.look.environment.as_ref()?;
    let ((height, width), values) = appearance.environment()?.map();
    let mut hash = blake3::Hasher::new();
    values.iter().flatten().for_each(|v| {
        hash.update(&v.to_le_bytes());
    });
    Some(json!({
        "size": [height, width],
        "blake3": hash.finalize().to_hex().as_str(),
        "illuminance_lx": given.illuminance_lx.unwrap_or(args.look.illuminance),
        "azimuth_deg": args.look.environment_azimuth.unwrap_or(0.0),
        "samples": args.look.sky_directions(),
        "is_background": args.look.background == BackgroundArg::Environment,
    }))
}

/// What the scene says of itself beside its layout.
fn attributes(
    args: &SceneArgs,
    prepared: &Prepared,
    light: &SceneLight,
    settings: &Settings,
) -> Map<String, Value> {
    let sources: Vec<Value> = prepared
        .sources
        .iter()
        .map(|s| json!({ "name": s.path.display().to_string(), "bytes": s.bytes, "blake3": s.blake3.to_hex().as_str() }))
        .collect();
    let mut all = object! {
        "focal_mm": prepared.pinhole.focal_mm,
        "film_size": [args.film_size.height, args.film_size.width],
        "overscan_px": prepared.pinhole.overscan_px,
        "lens": args.lens,
        "projection": match prepared.pinhole.projection {
            Projection::Planar => "planar",
            Projection::Film(_) => "film",
        },
        "samples_per_px": settings.samples,
        "gap_dioptre": settings.gap_dioptre,
        "camera": prepared.camera,
        "eye": prepared.pose.eye,
        "right": prepared.pose.right,
        "down": prepared.pose.down,
        "forward": prepared.pose.forward,
        "sources": sources,
        "units": "W m-2 sr-1 nm-1",
    };
    all.extend(light.attributes());
    all
}
