//! Lens of a run before it is traced: a pack or a design, its errors, focus and depth, and what it is traced with.

use super::asymmetric::AsymmetricLens;
use super::band_widths::BandWidths;
use super::drawn::DrawnLens;
use super::known::KnownLenses;
use super::tracing::without_tracing_flags;
use crate::args::{BuiltArgs, CoatingsArg, DEPTH_TOLERANCE, DepthArgs, TracingArgs};
use crate::design::{self, DesignFile};
use crate::failure::usage;
use crate::open;
use anyhow::{Context, Result};
use formats::lens::LensPack;
use pipeline::depth::plan::Surfaces;
use pipeline::design::System;
use pipeline::design::depth::trace::DepthOptions;
use pipeline::design::paraxial::Paraxial;
use pipeline::design::skew::grid::GridTrace;
use pipeline::design::skew::map::FilmRange;
use pipeline::design::skew::system::BuiltLens;
use pipeline::design::trace::{LensTrace, TraceOptions};
use pipeline::lens::depth::LensDepth;
use pipeline::lens::planar::PsfPlaces;
use pipeline::lens::{Lens, LensBand};
use std::sync::Arc;

/// Blur radius in film pixels up to which a surface is in focus: the L1 error of a PSF is then at most 2 %, by C·Δρ² with the C of the worst lens of
/// those measured for [`pipeline::design::depth::nodes`], 9 % at 0.5 px.
const SHARP_PX: f64 = 0.25;

/// Lens that `--lens` names, before tracing.
pub enum UntracedLens {
    /// Tables and PSFs in a file, or built in.
    Pack(Arc<LensPack>),
    /// A design.
    Design(Box<UntracedDesign>),
}

/// A design before it is traced.
pub struct UntracedDesign {
    /// The design; of one without rotational symmetry its straightened lens, for first-order figures.
    pub system: System,
    /// As given.
    pub name: String,
    /// Its file unless it is built in.
    pub file: Option<DesignFile>,
    /// How it is traced; none in commands without these flags, by which it is traced as by default.
    pub tracing: Option<TracingArgs>,
    /// Widths of its bands; none if a band is one wavelength.
    pub(super) bands: Option<BandWidths>,
    /// The lens that is traced, if it has no rotational symmetry.
    pub(super) asymmetric: Option<AsymmetricLens>,
    /// Lenses that the process keeps.
    pub(super) known: Option<Arc<KnownLenses>>,
}

impl UntracedLens {
    /// Opens a design, a pack, or a built-in lens, for a command without flags of tracing.
    pub fn open(name: &str) -> Result<Self> {
        if !design::is_design(name) {
            return Ok(Self::Pack(Arc::new(open::symmetric_lens(name)?)));
        }
        let opened = Self::open_focused(name, &DepthArgs::default(), &TracingArgs::default())
            .map_err(|e| without_tracing_flags(name, e))?;
        Ok(match opened {
            Self::Design(design) => Self::Design(Box::new(UntracedDesign { tracing: None, ..*design })),
            pack => pack,
        })
    }

    /// Whether its tables are over image height.
    pub fn is_symmetric(&self) -> bool {
        match self {
            Self::Pack(pack) => pack.lens().is_symmetric(),
            Self::Design(design) => design.asymmetric.as_ref().is_none_or(AsymmetricLens::is_symmetric),
        }
    }

    /// Whether its PSFs are on a grid of columns and rows.
    pub fn has_psf_grid(&self) -> bool {
        let is_grid = |band: &LensBand| {
            let places = band.planar.as_ref().map(|planar| &planar.psfs);
            matches!(places, Some(PsfPlaces::Cartesian { .. }))
        };
        match self {
            Self::Pack(pack) => pack.lens().bands.iter().any(is_grid),
            Self::Design(_) => self.asymmetric_design().is_some(),
        }
    }

    /// The lens, if it has no rotational symmetry by design.
    pub fn asymmetric_design(&self) -> Option<&BuiltLens> {
        match self {
            Self::Pack(_) => None,
            Self::Design(design) => design.asymmetric.as_ref()?.design(),
        }
    }

    /// The lens as built that `args` draw; without tolerances the lens itself.
    ///
    /// # Errors
    /// Usage: tolerances of a pack; errors that the design does not have.
    pub fn with_errors(self, args: &BuiltArgs) -> Result<Self> {
        match self {
            Self::Design(design) => {
                if args.tolerances.is_some() && design.asymmetric.is_some() {
                    return Err(usage(format!(
                        "--tolerances: expected a design with rotational symmetry, `{}` has none",
                        design.name
                    )));
                }
                let drawn = DrawnLens::new(args, &design.system)?;
                let drawn = drawn.map(|drawn| AsymmetricLens::Drawn(Box::new(drawn)));
                let asymmetric = drawn.or(design.asymmetric);
                Ok(Self::Design(Box::new(UntracedDesign { asymmetric, ..*design })))
            }
            Self::Pack(pack) if args.tolerances.is_some() => Err(usage(format!(
                "--tolerances: expected a design; lens `{}` is a lens pack, which was traced before",
                pack.path().display()
            ))),
            pack => Ok(pack),
        }
    }

    /// Opens a design with `coatings`, or a pack, whose tables have theirs.
    ///
    /// # Errors
    /// It cannot be read; coatings that are not known or do not fit.
    pub fn open_coated(name: &str, coatings: &CoatingsArg) -> Result<Self> {
        if *coatings == CoatingsArg::Ideal || !design::is_design(name) {
            return Self::open(name);
        }
        let tracing = TracingArgs { coatings: coatings.clone(), ..TracingArgs::default() };
        Self::open_focused(name, &DepthArgs::default(), &tracing)
    }

    /// Opens a design with the gaps and the focus of `given`, to be traced as `tracing` says, or a pack.
    ///
    /// # Errors
    /// Flags of designs for a pack; a design that cannot be focused there.
    pub fn open_focused(name: &str, given: &DepthArgs, tracing: &TracingArgs) -> Result<Self> {
        if design::is_design(name) {
            let (system, file) = design::focused(name, &tracing.design(&given.gap), given.focus_m)?;
            return Self::of_design(name, system, file, tracing.clone());
        }
        let pack = Arc::new(open::lens(name)?);
        if let [flags @ .., last] = &tracing.given()[..] {
            let before = if flags.is_empty() { String::new() } else { format!("{} and ", flags.join(", ")) };
            return Err(usage(format!(
                "{before}{last}: expected a design; lens `{name}` is a lens pack, which was traced before"
            )));
        }
        match given.focus_m.is_some() || !given.gap.is_empty() || given.depth_tolerance.is_some() {
            false => Ok(Self::Pack(pack)),
            true => Err(usage(format!(
                "--focus-m, --gap and --depth-tolerance are for designs; lens `{name}` is a lens pack, whose focus and depth nodes were set when it was traced"
            ))),
        }
    }

    /// The design `system`, opened as `name` from `file`, to be traced as `tracing` says.
    ///
    /// # Errors
    /// Parts that designs without rotational symmetry do not have.
    pub fn of_design(
        name: &str,
        system: System,
        file: Option<DesignFile>,
        tracing: TracingArgs,
    ) -> Result<Self> {
        let (name, tracing) = (name.to_owned(), Some(tracing));
        let (system, asymmetric) =
            AsymmetricLens::of_design(system).with_context(|| format!("design {name}"))?;
        let (bands, known) = (None, None);
        Ok(Self::Design(Box::new(UntracedDesign { system, name, file, tracing, bands, asymmetric, known })))
    }

    /// The lens, which is looked for among those that are `known` before it is traced, and kept there.
    pub fn among(self, known: Arc<KnownLenses>) -> Self {
        match self {
            Self::Design(design) => Self::Design(Box::new(UntracedDesign { known: Some(known), ..*design })),
            pack => pack,
        }
    }

    /// The lens for the bands of a chart at `chart_nm`, which `--band-samples` integrates over their widths.
    ///
    /// # Errors
    /// Usage: a band without a width; with surfaces at several distances (`has_depth`).
    pub fn with_bands_of(self, chart_nm: &[f64], has_depth: bool) -> Result<Self> {
        match self {
            Self::Design(design) => {
                let asked = design.tracing.as_ref().and_then(TracingArgs::integrated_bands);
                let bands = asked.map(|asked| BandWidths::new(asked, chart_nm, has_depth)).transpose()?;
                Ok(Self::Design(Box::new(UntracedDesign { bands, ..*design })))
            }
            pack => Ok(pack),
        }
    }

    /// Vergences of a pack's farthest and nearest depth node, 1/m; none for a design, which is traced for the scene.
    ///
    /// # Errors
    /// Usage: a pack with nodes for a flat chart.
    pub fn depth_nodes(&self, name: &str, has_depth: bool) -> Result<Option<(f64, f64)>> {
        if has_depth && !self.is_symmetric() {
            let asymmetric = match self {
                Self::Design(design) => design.asymmetric.as_ref(),
                Self::Pack(_) => None,
            };
            let lens = asymmetric.map_or_else(|| format!("`{name}`"), |lens| lens.named(name));
            return Err(usage(format!(
                "surfaces at distances: expected a lens with rotational symmetry, {lens} has none (`--depth none` makes a film of a flat chart)"
            )));
        }
        let Self::Pack(pack) = self else { return Ok(None) };
        match (has_depth, &pack.lens().depth) {
            (false, Some(_)) => Err(usage(format!(
                "lens `{name}` has depth nodes: give the distance of the chart's pixels, an array or one number in m, e.g. `--depth 2`"
            ))),
            _ => Ok(Some(node_range(pack.lens()))),
        }
    }

    /// Fails unless the surface `depth` lies within the depth of field of a pack without depth nodes: blurred by at most [`SHARP_PX`] film pixels
    /// of `pitch_um`, so that its film is the flat one. `true` for such a surface, `false` for any other lens.
    ///
    /// # Errors
    /// Usage: the surfaces are farther from focus, or there are several.
    pub fn is_within_focus(&self, name: &str, surfaces: &Surfaces, pitch_um: f64) -> Result<bool> {
        let Self::Pack(pack) = self else { return Ok(false) };
        let lens = pack.lens();
        if lens.depth.is_some() {
            return Ok(false);
        }
        let focus = lens.object_distance_mm.map_or(0.0, |mm| 1e3 / mm);
        let blur_px = self.focal_mm_and_blur_um()?.1 / pitch_um;
        let blur = |v: f64| blur_px * (v - focus).abs();
        let worst = blur(surfaces.first).max(blur(surfaces.last));
        if worst <= SHARP_PX && surfaces.is_opaque {
            return Ok(true);
        }
        let problem = match worst <= SHARP_PX {
            true => "the scene has hidden surfaces or a coverage".to_owned(),
            false => format!(
                "its blur at {} to {} m is up to {worst:.1} px",
                1.0 / surfaces.last,
                1.0 / surfaces.first
            ),
        };
        Err(usage(format!(
            "lens `{name}` has the PSFs of one object distance, {} m, and {problem}: trace a pack with `lenscube lens trace DESIGN \
             PACK --focus-m M --depths-m NEAR:FAR`, give a design with --focus-m, or `--depth none` for a flat chart",
            1.0 / focus
        )))
    }

    /// Its name.
    pub fn name(&self) -> &str {
        match self {
            Self::Pack(pack) => &pack.lens().name,
            Self::Design(design) => &design.system.name,
        }
    }

    /// Distortion focal length in mm, and blur radius per dioptre in µm.
    ///
    /// # Errors
    /// A design without first-order properties.
    pub fn focal_mm_and_blur_um(&self) -> Result<(f64, f64)> {
        Ok(match self {
            Self::Pack(pack) => {
                let lens = pack.lens();
                let pupil_mm = lens.effective_focal_length_mm / lens.f_number;
                let flat_um = pupil_mm / 2.0 * lens.distortion_focal_length_mm.abs();
                let blur_um = lens.depth.as_ref().map_or(flat_um, |depth| depth.blur_per_dioptre_um);
                (lens.distortion_focal_length_mm, blur_um)
            }
            Self::Design(design) => {
                let system = &design.system;
                let first = Paraxial::new(system, system.primary_um())?;
                let focal_mm = first.distortion_focal_length_mm;
                (focal_mm, first.entrance_radius_mm * focal_mm.abs())
            }
        })
    }

    /// Vergence in focus, 1/m.
    ///
    /// # Errors
    /// A design without first-order properties.
    pub fn focus(&self, given: &DepthArgs) -> Result<f64> {
        Ok(match (given.focus_m, self) {
            (Some(metres), _) => 1.0 / metres,
            (None, Self::Design(design)) => design.system.object_vergence()?,
            (None, Self::Pack(pack)) => {
                let flat = pack.lens().object_distance_mm.map_or(0.0, |mm| 1e3 / mm);
                pack.lens().depth.as_ref().map_or(flat, LensDepth::focus)
            }
        })
    }

    /// What a design is traced for: surfaces over the vergences `range`, 1/m, with the flags `given`.
    ///
    /// # Errors
    /// As [`UntracedLens::focus`].
    pub fn depth_options(&self, given: &DepthArgs, range: (f64, f64)) -> Result<DepthOptions> {
        let tolerance = given.depth_tolerance.unwrap_or(DEPTH_TOLERANCE);
        Ok(DepthOptions { focus: self.focus(given)?, range, tolerance, is_for_film: true })
    }

    /// Magnification (ideal height on the film over object height) and object distance in mm; none for an object at infinity.
    pub fn conjugate(&self) -> Result<Option<(f64, f64)>> {
        let (magnification, distance) = match self {
            Self::Pack(pack) => (pack.lens().magnification, pack.lens().object_distance_mm),
            Self::Design(design) => {
                let system = &design.system;
                let options = TraceOptions::new(Vec::from([system.primary_um() * 1e3]), 1e-3);
                let header = match self.asymmetric_design() {
                    Some(lens) => GridTrace::new(lens, &options, FilmRange::centred([1e-3; 2]))?.header()?,
                    None => LensTrace::new(system, &options)?.header(),
                };
                (header.magnification, header.object_distance_mm)
            }
        };
        Ok(distance.map(|d| (magnification, d)))
    }
}

/// Vergences of the farthest and the nearest depth node of any band, 1/m; 0 without any.
fn node_range(lens: &Lens) -> (f64, f64) {
    let nodes = lens.depth.iter().flat_map(|depth| &depth.bands).flat_map(|band| &band.vergence);
    let range = nodes.fold((f64::INFINITY, 0.0), |(a, z): (f64, f64), v| (a.min(*v), z.max(*v)));
    if range.0 <= range.1 { range } else { (0.0, 0.0) }
}
