//! An open lens pack, and the packs built into the program.

use std::borrow::Cow;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use pipeline::design::ghost::report::PathFigures;
use pipeline::design::ghost::rings::RingOperator;
use pipeline::lens::planar::PsfPlaces;
use pipeline::lens::{Lens, LensBand, PsfStack};

use super::array::MAX_SAMPLES;
use super::attributes::PackAttributes;
use super::digest;
use super::error::LensPackError;
use super::read::{self, PackGhosts, Tables};
use super::store::PackStore;
use super::stored::Stored;
use crate::durable::HashedFile;

/// Built-in lens packs: name and .zip (`formats/data/SOURCES.md`).
const BUILTIN: [(&str, &[u8]); 1] =
    [("double-gauss-28-npz", include_bytes!("../../data/double-gauss-28.lens.zip"))];

/// An open lens pack: tables in memory, PSFs read on demand. Threads may share it.
pub struct LensPack {
    store: PackStore,
    lens: Lens,
    attributes: PackAttributes,
    ghosts: Option<PackGhosts>,
    notes: Vec<String>,
    /// Whether it has pupil functions in place of PSFs.
    has_pupils: bool,
    /// Bytes of memory for reading the PSFs of each band, in addition to the samples.
    reading_bytes: Vec<usize>,
    /// Digest of tables and PSFs as first read, of the pack and per band.
    digest: OnceLock<String>,
    band_digests: Vec<OnceLock<String>>,
    /// The .zip, if its bytes were hashed.
    hashed: Option<HashedFile>,
}

impl LensPack {
    /// Opens a directory or a .zip and validates every table.
    ///
    /// # Errors
    /// The pack is malformed. PSF samples are validated when they are read.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, LensPackError> {
        Self::from_store(PackStore::open(path.as_ref())?)
    }

    /// Opens a .zip whose bytes are hashed; every later read verifies that they are unchanged.
    pub fn open_hashed(file: HashedFile) -> Result<Self, LensPackError> {
        let store = PackStore::hashed(&file)?;
        Ok(Self { hashed: Some(file), ..Self::from_store(store)? })
    }

    /// Opens a .zip in memory.
    pub fn open_bytes(bytes: impl Into<Cow<'static, [u8]>>) -> Result<Self, LensPackError> {
        Self::named_bytes(PathBuf::from("<lens pack in memory>"), bytes.into())
    }

    fn named_bytes(name: PathBuf, bytes: Cow<'static, [u8]>) -> Result<Self, LensPackError> {
        Self::from_store(PackStore::bytes(name, bytes)?)
    }

    fn from_store(store: PackStore) -> Result<Self, LensPackError> {
        let mut notes = Vec::new();
        let Tables { lens, attributes, ghosts, has_pupils, reading_bytes } =
            read::tables(&store, &mut notes)?;
        let band_digests = vec![OnceLock::new(); lens.bands.len()];
        let digest = OnceLock::new();
        let hashed = None;
        Ok(Self {
            store,
            lens,
            attributes,
            ghosts,
            notes,
            has_pupils,
            reading_bytes,
            digest,
            band_digests,
            hashed,
        })
    }

    /// The tables.
    pub fn lens(&self) -> &Lens {
        &self.lens
    }

    /// Descriptive attributes.
    pub fn attributes(&self) -> &PackAttributes {
        &self.attributes
    }

    /// Its ghosts, if it has any.
    pub fn ghosts(&self) -> Option<&PackGhosts> {
        self.ghosts.as_ref()
    }

    /// Reads the operator of the ghosts of band `band`, if the pack has ghosts. Changes of the pack are found by
    /// [`check_unchanged`](Self::check_unchanged).
    ///
    /// # Errors
    /// There is no such band; a chunk is missing or damaged; values that are not those of an operator.
    pub fn ghost_operator(&self, band: usize) -> Result<Option<RingOperator>, LensPackError> {
        let read = |ghosts: &PackGhosts| read::ghost_operator(&self.store, band, ghosts.sizes);
        self.ghosts.as_ref().map(read).transpose()
    }

    /// Reads the paths of the ghosts of band `band`, the largest share on the axis first; none of a pack that does not list them.
    ///
    /// # Errors
    /// A chunk is missing or damaged; numbers that no path has.
    pub fn ghost_paths(&self, band: usize) -> Result<Option<Vec<PathFigures>>, LensPackError> {
        let read = |_: &PackGhosts| read::ghost_paths(&self.store, band);
        self.ghosts.as_ref().map_or(Ok(None), read)
    }

    /// Defaults used for missing arrays and attributes, one sentence each.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Path of the pack, or its name.
    pub fn path(&self) -> &Path {
        &self.store.path
    }

    /// Whether it has pupil functions, from which [`psf`](Self::psf) computes the PSFs.
    pub fn has_pupils(&self) -> bool {
        self.has_pupils
    }

    /// Whether its tables are over image height: those of a lens with rotational symmetry.
    pub fn is_symmetric(&self) -> bool {
        self.lens.bands.iter().all(LensBand::is_symmetric)
    }

    /// Checks that the lens has image heights, which `what` needs.
    ///
    /// # Errors
    /// [`LensPackError::NotSymmetric`].
    pub fn require_symmetric(&self, what: &str) -> Result<(), LensPackError> {
        match self.is_symmetric() {
            true => Ok(()),
            false => Err(LensPackError::NotSymmetric { path: self.path().into(), what: what.into() }),
        }
    }

    /// Reads the PSFs of band `band`, or computes them from its pupil functions on the calling thread: finite, every window of sum 1, and from
    /// values equal to those read first.
    ///
    /// # Errors
    /// There is no such band; a chunk is missing or damaged; a sample is not finite; the sum of a window is not 1; invalid pupil functions;
    /// [`LensPackError::Changed`]; [`LensPackError::TooLarge`]: pupil functions of more PSFs than are read at once, which
    /// [`psfs_of_sets`](Self::psfs_of_sets) reads.
    pub fn psf(&self, band: usize) -> Result<PsfStack, LensPackError> {
        if let Some(depth) = &self.lens.depth {
            let focus = depth.focus();
            return self.psf_of_node(band, depth.bands.get(band).map_or(0, |nodes| nodes.nearest(focus)));
        }
        match self.stored(band)? {
            Stored::Psfs(stack) => Ok(stack),
            Stored::Pupils(pupils) => {
                let psfs = (pupils.heights(), pupils.size());
                read::check_together(self.path(), &format!("pupil/{band}"), psfs, MAX_SAMPLES)?;
                read::psfs_of(&self.store, &self.lens, (band, 0), &pupils, 1)
            }
        }
    }

    /// Reads band `band`, of values equal to those read first.
    fn stored(&self, band: usize) -> Result<Stored, LensPackError> {
        let stored = match self.has_pupils {
            true => Stored::Pupils(read::pupils(&self.store, &self.lens, band, None)?),
            false => Stored::Psfs(read::psf(&self.store, &self.lens, band, None)?),
        };
        let first = self.band_digests[band].get().filter(|_| self.store.may_change());
        let unchanged = match first {
            Some(first) => *first == self.stored_digest(band, &stored)?,
            None => self.hashed_file_is_unchanged()?,
        };
        let name = if self.has_pupils { "pupil" } else { "psf" };
        if unchanged { Ok(stored) } else { Err(self.changed(format!("{name}/{band} differs"))) }
    }

    /// Digest of band `band`, stored as `stored`, with its ghosts.
    fn stored_digest(&self, band: usize, stored: &Stored) -> Result<String, LensPackError> {
        Ok(digest::stored_digest(&self.lens, band, (stored, self.ghost_operator(band)?.as_ref())))
    }

    /// Reads the PSFs of depth node `node` of band `band` of a pack with depth nodes: finite, every window of sum 1.
    ///
    /// # Errors
    /// There is no such band; a chunk is missing or damaged; a sample is not finite; the sum of a window is not 1. Changes of the pack are
    /// found by [`check_unchanged`](Self::check_unchanged).
    pub fn psf_of_node(&self, band: usize, node: usize) -> Result<PsfStack, LensPackError> {
        read::psf(&self.store, &self.lens, band, Some(node))
    }

    /// Reads the PSFs of the consecutive sets `sets` of band `band`, and of its depth node `node` if it has some, n × n samples each. A set is the PSF at a height; of a
    /// lens without rotational symmetry those of all azimuths at a height, or one of a grid. Computed on `threads` threads, if the pack has pupil functions.
    ///
    /// # Errors
    /// As [`psf_of_node`](Self::psf_of_node), or invalid pupil functions.
    ///
    /// # Panics
    /// There is no such node or set; no set.
    pub fn psfs_of_sets(
        &self,
        band: usize,
        node: usize,
        sets: Range<usize>,
        threads: usize,
    ) -> Result<Vec<f32>, LensPackError> {
        let of_set = |set: usize| self.lens.bands.get(band).map_or(set..set + 1, |b| rows_of_set(b, set));
        let rows = of_set(sets.start).start..of_set(sets.end - 1).end;
        if self.has_pupils {
            let pupils = read::pupils(&self.store, &self.lens, band, Some(rows.clone()))?;
            return Ok(read::psfs_of(&self.store, &self.lens, (band, rows.start), &pupils, threads)?.samples);
        }
        Ok(read::windows(&self.store, &self.lens, (band, Some(node)), Some(rows))?.samples)
    }

    /// Bytes of memory for reading a band's PSFs, in addition to the samples: an encoded and a decoded chunk, or pupil functions and the sums over
    /// their rays.
    pub fn psf_reading_bytes(&self, band: usize) -> usize {
        self.reading_bytes.get(band).copied().unwrap_or_default()
    }

    /// Verifies that the pack is unchanged since it was opened: by size and times of its files, else by the values read.
    ///
    /// # Errors
    /// [`LensPackError::Changed`].
    pub fn check_unchanged(&self) -> Result<(), LensPackError> {
        if self.hashed.is_some() {
            // Another file may have its name now; all reads are from the open file.
            let unchanged = self.hashed_file_is_unchanged()?;
            return if unchanged { Ok(()) } else { Err(self.changed("its bytes differ".into())) };
        }
        if !self.store.may_change() || self.store.files_are_unchanged() {
            return Ok(());
        }
        let reopened = Self::open(&self.store.path).map_err(|e| self.changed(e.to_string()))?;
        if (&reopened.lens, &reopened.ghosts) != (&self.lens, &self.ghosts) {
            return Err(self.changed("its tables differ".into()));
        }
        for (band, first) in self.band_digests.iter().enumerate() {
            let Some(first) = first.get() else { continue };
            let digest = reopened.band_digest(band).map_err(|e| self.changed(e.to_string()))?;
            if digest != *first {
                return Err(self.changed(format!("band {band} differs")));
            }
        }
        Ok(())
    }

    fn hashed_file_is_unchanged(&self) -> Result<bool, LensPackError> {
        let failed = |source| LensPackError::Io { path: self.path().into(), action: "read again", source };
        self.hashed.as_ref().map_or(Ok(true), |file| file.is_unchanged().map_err(failed))
    }

    fn changed(&self, what: String) -> LensPackError {
        LensPackError::Changed { path: self.path().into(), what }
    }

    /// blake3 (hex) of all values that affect pixels; independent of directory or zip, chunks and codecs.
    ///
    /// Computed once, by reading every PSF or pupil function. Name, source and other descriptive attributes are not included.
    ///
    /// # Errors
    /// As [`psf`](Self::psf), for any band.
    pub fn digest(&self) -> Result<&str, LensPackError> {
        if let Some(digest) = self.digest.get() {
            return Ok(digest);
        }
        if let Some(depth) = &self.lens.depth {
            let digests = (0..self.lens.bands.len()).map(|band| self.band_digest(band));
            let digest = digest::depth_digest(&self.lens, depth, digests)?;
            return Ok(self.digest.get_or_init(|| digest));
        }
        let digest = digest::lens_digest(&self.lens, |band| {
            let (stored, ghosts) = (self.stored(band)?, self.ghost_operator(band)?);
            let of_band = || digest::stored_digest(&self.lens, band, (&stored, ghosts.as_ref()));
            self.band_digests[band].get_or_init(of_band);
            Ok::<_, LensPackError>((stored, ghosts))
        })?;
        Ok(self.digest.get_or_init(|| digest))
    }

    /// As [`digest`](Self::digest), of band `band` alone; reads only that band's PSFs.
    pub fn band_digest(&self, band: usize) -> Result<String, LensPackError> {
        if let Some(depth) = &self.lens.depth {
            if let Some(known) = self.band_digests[band].get() {
                return Ok(known.clone());
            }
            let digest =
                digest::depth_band_digest(&self.lens, depth, band, |node| self.psf_of_node(band, node))?;
            return Ok(self.band_digests[band].get_or_init(|| digest).clone());
        }
        let digest = self.stored_digest(band, &self.stored(band)?)?;
        Ok(self.band_digests[band].get_or_init(|| digest).clone())
    }
}

/// Rows of the set `set` of PSFs of a band in its stack.
fn rows_of_set(band: &LensBand, set: usize) -> Range<usize> {
    match band.planar.as_ref().map(|planar| &planar.psfs) {
        Some(PsfPlaces::Polar { azimuth_samples }) => {
            let first: usize = azimuth_samples[..set].iter().sum();
            first..first + azimuth_samples[set]
        }
        Some(PsfPlaces::Cartesian { .. }) | None => set..set + 1,
    }
}

/// Names of the built-in lens packs.
pub fn builtin_names() -> impl Iterator<Item = &'static str> {
    BUILTIN.iter().map(|(name, _)| *name)
}

/// Opens a built-in lens pack: `double-gauss-28-npz`, tables of the Double Gauss 28° made with other software.
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
