//! The door for lens packs: a Zarr v3 group `*.lens.zarr`, a .zip of it, or a lens inside the program.
//!
//! | array | shape | unit |
//! |---|---|---|
//! | `wavelength` | (B) | nm, ascending |
//! | `ideal_height`, `image_height` | (B, M) | mm, ascending from 0: f·tan(field) with the DISTORTION focal length; REAL chief-ray height |
//! | `relative_illumination` | (B, M) | 1 on axis |
//! | `psf_height` | (B, K) | mm, REAL image height of each PSF, ascending from 0 |
//! | `azimuth_count` | (B, K) | 1 on axis, else a multiple of 4 |
//! | `psf/<band>` | (K, n, n) | share of the light per sample, sum 1; n odd; chief ray at the centre; field point on +x, row down |
//! | `psf_pitch` | (B) | µm |
//! | `psf_energy` | (B, K) | share of all the light that the window held before normalisation |
//! | `solid_angle` | (B) | sr, π·NA²; missing: π/(4N²) |
//! | `transmission` | (B) | missing: 1 |
//!
//! Tables may be of any float or integer type. A band with fewer field points or heights than the widest ends its rows with
//! NaN (`azimuth_count`: anything); `psf/<band>` then has as many windows as `psf_height` has numbers. Windows whose sum misses
//! 1 by more than 1e-3 are an error, by less than 1e-6 are kept, in between are divided by their sum.
//! Required attributes: `schema`, `distortion_focal_length_mm`, `effective_focal_length_mm`, `f_number`,
//! `primary_wavelength_nm`, `psf_sample`. Defaults: `object_distance_mm` null = infinity, `magnification` 0, `name` the file's;
//! `image_plane`, `defocus_mm`, `frame`, `psf_tolerance` and `source` are shown, never computed with.
//!
//! Tables are read when the pack is opened, PSFs band by band when asked for (a traced band takes 60 MB). Shards, Zarr v2 and
//! chunks left out by the writer (but for all-zero PSF chunks) are errors. Nothing in a pack, however damaged, may panic.

mod array;
mod attributes;
mod digest;
mod error;
mod number;
mod read;
mod sink;
mod stamp;
mod store;
mod summary;

mod write;

pub use error::LensPackError;
pub use stamp::SealedFile;
pub use summary::{BandSummary, LensSummary, summary};

pub use write::{LensPackWriter, write};

use pipeline::lens::{Lens, PsfStack};
use serde_json::Value;
use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use store::Store;

/// The one schema this program reads and writes.
pub const SCHEMA: &str = "lenscube/lens-pack/1";

/// Lenses inside the program: name and .zip (`formats/data/SOURCES.md`).
const BUILTIN: [(&str, &[u8]); 1] =
    [("double-gauss-28-npz", include_bytes!("../../data/double-gauss-28.lens.zip"))];

/// What a pack says about itself in words; shown, never computed with.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PackAttributes {
    /// Where the image plane is.
    pub image_plane: Option<String>,
    /// Image plane minus paraxial focus, mm; positive away from the lens.
    pub defocus_mm: Option<f64>,
    /// The conventions in words.
    pub frame: Option<String>,
    /// Bounds that the PSFs keep.
    pub psf_tolerance: Option<Value>,
    /// Program, version, file, settings.
    pub source: Option<Value>,
}

/// An open lens pack: tables in memory, PSFs on demand. May be shared between threads.
pub struct LensPack {
    store: Store,
    lens: Lens,
    attributes: PackAttributes,
    notes: Vec<String>,
    /// Bytes of one chunk of PSFs, decoded, per band.
    psf_chunk_bytes: Vec<usize>,
    /// Of the PSFs and tables as they were read first, whole and per band.
    digest: OnceLock<String>,
    band_digests: Vec<OnceLock<String>>,
    /// The one file that it lies in, if its bytes are known.
    sealed: Option<SealedFile>,
}

impl LensPack {
    /// Opens a directory or a .zip, and checks every table.
    ///
    /// # Errors
    /// Whatever is wrong with the pack, but for its PSF samples, which are checked when they are read.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, LensPackError> {
        Self::from_store(Store::open(path.as_ref())?)
    }

    /// Opens a .zip whose bytes are known; every later read is checked against them.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn open_sealed(sealed: SealedFile) -> Result<Self, LensPackError> {
        let store = Store::sealed(&sealed)?;
        Ok(Self { sealed: Some(sealed), ..Self::from_store(store)? })
    }

    /// Opens a .zip in memory.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn open_bytes(bytes: impl Into<Cow<'static, [u8]>>) -> Result<Self, LensPackError> {
        Self::named_bytes(PathBuf::from("<lens pack in memory>"), bytes.into())
    }

    fn named_bytes(name: PathBuf, bytes: Cow<'static, [u8]>) -> Result<Self, LensPackError> {
        Self::from_store(Store::bytes(name, bytes)?)
    }

    fn from_store(store: Store) -> Result<Self, LensPackError> {
        let mut notes = Vec::new();
        let (lens, attributes, psf_chunk_bytes) = read::lens(&store, &mut notes)?;
        let band_digests = vec![OnceLock::new(); lens.bands.len()];
        let digest = OnceLock::new();
        Ok(Self { store, lens, attributes, notes, psf_chunk_bytes, digest, band_digests, sealed: None })
    }

    /// The tables.
    pub fn lens(&self) -> &Lens {
        &self.lens
    }

    /// What the pack says about itself.
    pub fn attributes(&self) -> &PackAttributes {
        &self.attributes
    }

    /// Defaults taken for what the pack does not hold, one sentence each.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Where the pack lies, or what it is called.
    pub fn path(&self) -> &Path {
        &self.store.path
    }

    /// Reads the PSFs of band `band`: finite, every window of sum 1, and the same as when they were read first.
    ///
    /// # Errors
    /// No such band; a chunk missing or damaged; a sample not finite; a window whose sum is not 1;
    /// [`LensPackError::Changed`].
    pub fn psf(&self, band: usize) -> Result<PsfStack, LensPackError> {
        let stack = read::psf(&self.store, &self.lens, band)?;
        let known = self.band_digests[band].get().filter(|_| self.store.may_change());
        let same = match known {
            Some(known) => *known == digest::of_band(&self.lens, band, &stack),
            None => self.bytes_hold()?,
        };
        if same { Ok(stack) } else { Err(self.changed(format!("psf/{band} differs"))) }
    }

    /// Bytes that reading a band's PSFs takes beside the samples: a chunk as stored and as decoded.
    pub fn psf_reading_bytes(&self, band: usize) -> usize {
        // What is stored may be twice as long as what it decodes to.
        3 * self.psf_chunk_bytes.get(band).copied().unwrap_or_default()
    }

    /// Checks that what the pack was read from is still the same: files whose size and times are as they were, else the bytes of
    /// what was read.
    ///
    /// # Errors
    /// [`LensPackError::Changed`].
    pub fn check_unchanged(&self) -> Result<(), LensPackError> {
        if self.sealed.is_some() {
            // Whatever its name stands for now: what was read came from the file that was opened.
            return if self.bytes_hold()? { Ok(()) } else { Err(self.changed("its bytes differ".into())) };
        }
        if !self.store.may_change() || self.store.same_files() {
            return Ok(());
        }
        let now = Self::open(&self.store.path).map_err(|e| self.changed(e.to_string()))?;
        if now.lens != self.lens {
            return Err(self.changed("its tables differ".into()));
        }
        for (band, known) in self.band_digests.iter().enumerate() {
            let Some(known) = known.get() else { continue };
            let own = now.band_digest(band).map_err(|e| self.changed(e.to_string()))?;
            if own != *known {
                return Err(self.changed(format!("psf/{band} differs")));
            }
        }
        Ok(())
    }

    fn bytes_hold(&self) -> Result<bool, LensPackError> {
        let failed = |source| LensPackError::Io { path: self.path().into(), action: "read again", source };
        self.sealed.as_ref().map_or(Ok(true), |sealed| sealed.holds().map_err(failed))
    }

    fn changed(&self, what: String) -> LensPackError {
        LensPackError::Changed { path: self.path().into(), what }
    }

    /// blake3 (hex) of all that changes pixels; the same for a directory, its zip, and any chunks or codecs.
    ///
    /// Computed once, by reading every PSF. Name, source and other words do not count.
    ///
    /// # Errors
    /// As [`psf`](Self::psf), for any band.
    pub fn digest(&self) -> Result<&str, LensPackError> {
        if let Some(digest) = self.digest.get() {
            return Ok(digest);
        }
        let digest = digest::of(&self.lens, |band| {
            let stack = self.psf(band)?;
            self.band_digests[band].get_or_init(|| digest::of_band(&self.lens, band, &stack));
            Ok::<_, LensPackError>(stack)
        })?;
        Ok(self.digest.get_or_init(|| digest))
    }

    /// As [`digest`](Self::digest), of band `band` alone: reads no other band's PSFs.
    ///
    /// # Errors
    /// As [`psf`](Self::psf).
    pub fn band_digest(&self, band: usize) -> Result<String, LensPackError> {
        let stack = self.psf(band)?;
        Ok(self.band_digests[band].get_or_init(|| digest::of_band(&self.lens, band, &stack)).clone())
    }
}

/// Names of the lens packs inside the program.
pub fn builtin_names() -> impl Iterator<Item = &'static str> {
    BUILTIN.iter().map(|(name, _)| *name)
}

/// Opens a lens pack inside the program: `double-gauss-28-npz`, tables of the Double Gauss 28° made with other software.
///
/// # Errors
/// [`LensPackError::NotBuiltin`] for any other name.
pub fn builtin(name: &str) -> Result<LensPack, LensPackError> {
    match BUILTIN.iter().find(|(known, _)| *known == name) {
        Some((_, bytes)) => LensPack::named_bytes(format!("built-in lens {name}").into(), (*bytes).into()),
        None => Err(LensPackError::NotBuiltin {
            name: name.into(),
            known: builtin_names().collect::<Vec<_>>().join(", "),
        }),
    }
}
