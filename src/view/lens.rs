//! What the lens does at a pixel: its figures and PSF there, from the lens that the film was made through.

use crate::args::DesignArgs;
use crate::design;
use crate::lens::look::Subject;
use anyhow::{Context, Result, anyhow};
use formats::chart::cache::Cache;
use formats::lens::builtin_names;
use formats::picture::image::Image;
use pipeline::colour::srgb_encode;
use pipeline::figures::PsfWindow;
use pipeline::geometry::Size;
use serde_json::{Map, Value, json};
use std::sync::Arc;

/// Steps of height at which a lens is looked at, a mm.
const STEPS_PER_MM: f64 = 100.0;
/// Decades that a logarithmic picture of a PSF shows.
const DECADES: f64 = 4.0;
/// Looks to keep, bytes.
const KEPT: usize = 16 << 20;

/// A lens and what was seen of it.
pub struct Lens {
    subject: Subject,
    /// What its user should know.
    pub note: Option<String>,
    /// By the bits of the wavelength, and steps of height.
    seen: Cache<Seen, (u64, u64)>,
}

/// A lens at one field point and wavelength.
pub struct Seen {
    /// Its figures.
    pub figures: Value,
    /// Its PSF, the field point on +x.
    pub psf: PsfWindow,
}

impl Lens {
    /// The lens named, or the built-in one that the film tells of.
    pub fn open(named: Option<&str>, provenance: &Map<String, Value>) -> Result<Self> {
        let job = provenance.get("job").cloned().unwrap_or_default();
        let (name, digest) = (job["lens_name"].as_str(), job["lens_digest"].as_str());
        if let Some(named) = named {
            let subject = Subject::open(named, &DesignArgs::default())?;
            let same = match &subject {
                Subject::Pack(pack) => Some(pack.digest().context("reading the lens")?) == digest,
                Subject::Design(..) => Some(subject.name()) == name,
            };
            let made = name.unwrap_or("an unknown lens");
            let note = (!same).then(|| format!("not the lens that the film was made through, {made}"));
            return Ok(Self::with(subject, note));
        }
        let name = name.context("the film does not tell its lens; name it with --lens")?;
        for own in builtin_names().chain([design::BUILTIN]) {
            let subject = Subject::open(own, &DesignArgs::default())?;
            let same = match &subject {
                Subject::Pack(pack) => Some(pack.digest()?) == digest,
                Subject::Design(..) => subject.name() == name,
            };
            if same {
                return Ok(Self::with(subject, None));
            }
        }
        Err(anyhow!("the film was made through {name}, which is not built in; name its file with --lens"))
    }

    fn with(subject: Subject, note: Option<String>) -> Self {
        Self { subject, note, seen: Cache::new(KEPT) }
    }

    /// Name shown to people.
    pub fn name(&self) -> &str {
        self.subject.name()
    }

    /// Looks at REAL image height `height_mm` at `nm`, to the hundredth of a mm.
    pub fn at(&self, nm: f64, height_mm: f64) -> Result<Arc<Seen>> {
        let step = (height_mm * STEPS_PER_MM).round();
        self.seen.get((nm.to_bits(), step as u64), || {
            let look = self.subject.look(&[nm], &[step / STEPS_PER_MM])?;
            let figures = look.figures(0, 0).json();
            let field = look.fields.into_iter().flatten().next().context("no field point")?;
            let bytes = field.psf.samples.len() * size_of::<f32>();
            Ok((Seen { figures, psf: field.psf }, bytes))
        })
    }
}

impl Seen {
    /// The figures, and what the picture of the PSF shows.
    pub fn json(&self) -> Value {
        let psf = &self.psf;
        json!({
            "figures": self.figures,
            "psf": {"size": psf.size, "pitch_um": psf.pitch_um, "centroid_um": psf.centroid_um()},
        })
    }

    /// A picture of the PSF, its peak white: light as it is, or its logarithm over four decades.
    pub fn picture(&self, logarithmic: bool) -> Image {
        let psf = &self.psf;
        let peak = f64::from(psf.samples.iter().fold(f32::MIN_POSITIVE, |a, b| a.max(*b)));
        let mut image = Image::new(Size::new(psf.size, psf.size), [0; 3]);
        for (y, row) in psf.samples.chunks_exact(psf.size).enumerate() {
            for (pixel, &v) in image.row_mut(y).iter_mut().zip(row) {
                let v = f64::from(v) / peak;
                let shown = match logarithmic {
                    true if v > 0.0 => (1.0 + v.log10() / DECADES).max(0.0),
                    true => 0.0,
                    false => srgb_encode(v),
                };
                *pixel = [(255.0 * shown).round() as u8; 3];
            }
        }
        image
    }
}
