//! From a mesh to the sheets of each tile.
//!
//! Row by row: the sorted hits of all samples, then the surfaces and sheets of each pixel. Sheet 0 alone needs the nearest hit only, unless that may
//! be no surface: where a material has alpha, at backs of one-sided solids and of hits nearer than the limit all hits are found.
//! Weights are summed triangle by triangle in f64 and rounded to f32 once.

use super::edges::{Border, is_apart};
use super::pixel::{PixelSheets, PixelSurfaces};
use super::settings::{Settings, SettingsError};
use super::tile::{Counts, Front, Sheet};
use super::uniform::{Kind, NumberedLayer};
use crate::scene::frame::{Frame, pattern};
use crate::scene::mesh::Mesh;
use crate::scene::shading::{SampleHit, Shader};
use crate::scene::visibility::bins::Bins;
use crate::scene::visibility::raster::{PixelLayer, RowHits};
use crate::scene::visibility::surfaces::{Sample, hit, surfaces};
use crate::scene::visibility::tile::{Kept, TileScene};
use crate::scene::visibility::{Engine, TileGrid};

/// Number of the triangle of the background.
const BACKGROUND: u32 = u32::MAX;

/// Makes the sheets of a scene, tile by tile. Bits depend neither on the engine nor on the order of tiles.
pub struct Renderer<'a> {
    mesh: &'a Mesh,
    frame: Frame,
    pub(super) shader: &'a dyn Shader,
    /// Bases of the shader.
    pub(super) bases: usize,
    pub(super) settings: Settings,
    pub(super) places: Vec<[f64; 2]>,
    bins: Bins,
    engine: Engine,
    /// Surfaces of a larger vergence are left out, 1/m.
    pub(super) nearest: f64,
}

/// Memory of a thread for the tiles that it makes.
pub struct Worker {
    scene: TileScene,
    hits: RowHits,
    pixel: Pixel,
}

/// The surfaces of a pixel and its sheets.
#[derive(Default)]
pub(super) struct Pixel {
    surfaces: PixelSurfaces,
    /// Number in the tile of the triangle of each surface.
    numbers: Vec<u32>,
    /// Direction of each sample.
    directions: Vec<(f64, f64)>,
    sheets: PixelSheets,
    pending: Vec<(u32, usize)>,
    pub(super) hits: Vec<SampleHit>,
    pub(super) sums: Vec<f64>,
    /// Layers of a pixel whose samples have the same number of surfaces, and those that are surfaces.
    pub(super) layers: Vec<PixelLayer>,
    pub(super) surface_layers: Vec<usize>,
    /// Those that are sheets.
    pub(super) sheet_layers: Vec<NumberedLayer>,
}

/// Which sheets are made.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Pass {
    /// Sheet 0.
    Front,
    /// Sheets 1 and more.
    Hidden,
    /// All.
    All,
}

/// Sheets of a tile while they are made.
pub(super) struct Output {
    pub(super) sheets: Vec<Sheet>,
    /// Vergence of sheet 0, NaN without coverage.
    pub(super) vergence: Vec<f32>,
    has_edge: bool,
    pub(super) counts: Counts,
}

impl<'a> Renderer<'a> {
    /// Lists the triangles of each tile.
    ///
    /// # Errors
    /// [`SettingsError`].
    pub fn new(
        mesh: &'a Mesh,
        frame: Frame,
        shader: &'a dyn Shader,
        settings: Settings,
        engine: Engine,
    ) -> Result<Self, SettingsError> {
        let places = pattern(settings.samples).ok_or(SettingsError::Samples(settings.samples))?;
        settings.check(shader.bases())?;
        if !frame.is_valid() {
            return Err(SettingsError::Frame);
        }
        let nearest = if settings.is_near_cut { 1.0 / settings.near_m } else { f64::INFINITY };
        let bins = Bins::new(mesh, &frame).map_err(SettingsError::Scratch)?;
        Ok(Self { mesh, frame, shader, bases: shader.bases(), settings, places, bins, engine, nearest })
    }

    /// The tiles.
    pub fn grid(&self) -> TileGrid {
        self.bins.grid()
    }

    /// Bytes in memory of the lists of triangles.
    pub fn bytes(&self) -> usize {
        self.bins.bytes()
    }

    /// Memory for one thread.
    pub fn worker(&self) -> Worker {
        Worker {
            scene: TileScene::new(self.places.clone()),
            hits: RowHits::new(self.places.len()),
            pixel: Pixel::default(),
        }
    }

    /// Sheet 0 of a tile.
    pub fn front(&self, tile: usize, worker: &mut Worker) -> Front {
        let mut output = self.make(tile, worker, Pass::Front);
        let (_, _, height, width) = self.grid().rect(tile);
        Front {
            sheet: output.sheets.swap_remove(0),
            has_edge: output.has_edge,
            border: border(&output.vergence, height, width),
            counts: output.counts,
        }
    }

    /// Sheets 1 and more of a tile, one less than `sheets`, and what is counted of them.
    pub fn hidden(&self, tile: usize, worker: &mut Worker) -> (Vec<Sheet>, Counts) {
        let output = self.make(tile, worker, Pass::Hidden);
        (output.sheets, output.counts)
    }

    /// All sheets of a tile; its front has sheet 0.
    pub fn all(&self, tile: usize, worker: &mut Worker) -> (Front, Vec<Sheet>) {
        let mut output = self.make(tile, worker, Pass::All);
        let (_, _, height, width) = self.grid().rect(tile);
        let hidden = output.sheets.split_off(1);
        let front = Front {
            sheet: output.sheets.swap_remove(0),
            has_edge: output.has_edge,
            border: border(&output.vergence, height, width),
            counts: output.counts,
        };
        (front, hidden)
    }

    /// The surfaces of all samples of a tile: calls `found` with row, column, sample, and (vergence, triangle) of each surface, the nearest first.
    pub fn surfaces(
        &self,
        tile: usize,
        worker: &mut Worker,
        mut found: impl FnMut(usize, usize, usize, &[(f64, u32)]),
    ) {
        let Worker { scene, hits, pixel } = worker;
        scene.prepare(self.mesh, &self.frame, &self.bins, self.shader, tile);
        let (row0, column0, height, width) = scene.rect();
        let mut list = Vec::new();
        for row in 0..height {
            scene.hits(&self.frame, row, self.engine, Kept::All, hits);
            for column in 0..width {
                self.find_surfaces(scene, hits, column, pixel);
                for sample in 0..self.places.len() {
                    list.clear();
                    let of = pixel.surfaces.of(sample).filter(|&k| pixel.numbers[k] != BACKGROUND);
                    list.extend(
                        of.map(|k| (pixel.surfaces.vergence(k), scene.triangle(pixel.numbers[k]).triangle)),
                    );
                    found(row0 + row, column0 + column, sample, &list);
                }
            }
        }
    }

    /// The sheets of a tile that `pass` makes.
    fn make(&self, tile: usize, worker: &mut Worker, pass: Pass) -> Output {
        let Worker { scene, hits, pixel } = worker;
        scene.prepare(self.mesh, &self.frame, &self.bins, self.shader, tile);
        let (_, _, height, width) = scene.rect();
        let made = match pass {
            Pass::Front => 1,
            Pass::Hidden => self.settings.sheets - 1,
            Pass::All => self.settings.sheets,
        };
        let mut output = Output {
            sheets: (0..made).map(|_| Sheet::empty(height * width, self.bases)).collect(),
            vergence: vec![f32::NAN; height * width],
            has_edge: false,
            counts: Counts::default(),
        };
        if pass != Pass::Hidden {
            output.counts.samples = (height * width * self.places.len()) as u64;
        }
        if made == 0 || (scene.is_empty() && self.settings.background.is_none()) {
            return output;
        }
        let dropped = hits.dropped();
        // The nearest hit is the first surface, but for those that `has_unclear` finds.
        let kept = if pass == Pass::Front && !scene.has_alpha() { Kept::Nearest } else { Kept::All };
        let may_be_uniform = !scene.has_alpha()
            && self.nearest == f64::INFINITY
            && (pass == Pass::Front || self.settings.background.is_none());
        let is_unclear =
            kept == Kept::Nearest && (scene.has_one_sided_back() || self.nearest < f64::INFINITY);
        for row in 0..height {
            scene.hits(&self.frame, row, self.engine, kept, hits);
            let mut kind = Kind { pass, kept };
            if is_unclear && hits.has_unclear(self.nearest) {
                scene.hits_again(self.engine, Kept::All, hits);
                kind.kept = Kept::All;
            }
            for column in 0..width {
                let at = row * width + column;
                if may_be_uniform && self.make_uniform(scene, hits, (at, column), pixel, kind, &mut output) {
                    continue;
                }
                match kind.kept {
                    Kept::Nearest => self.find_first(scene, hits, column, pixel),
                    Kept::All => self.find_surfaces(scene, hits, column, pixel),
                }
                self.make_pixel(scene, pixel, at, pass, &mut output);
            }
        }
        if pass != Pass::Front {
            output.counts.dropped_hits = hits.dropped() - dropped;
        }
        if pass != Pass::Hidden {
            output.has_edge |= has_edge(&output.vergence, height, width, self.settings.gap_dioptre);
        }
        output
    }

    /// First surfaces of all samples of a pixel, where the nearest hit is one.
    #[inline]
    fn find_first(&self, scene: &TileScene, hits: &RowHits, column: usize, pixel: &mut Pixel) {
        pixel.surfaces.clear();
        pixel.numbers.clear();
        pixel.directions.clear();
        for i in 0..self.places.len() {
            pixel.directions.push(scene.direction(i, column));
            let (vergence, label) = hits.hit(i, column, 0);
            if vergence > 0.0 {
                pixel.surfaces.push(vergence);
                pixel.numbers.push(label.number());
            } else if let Some(background) = &self.settings.background {
                pixel.surfaces.push(background.vergence);
                pixel.numbers.push(BACKGROUND);
            }
            pixel.surfaces.end_sample();
        }
    }

    /// Surfaces of all samples of a pixel.
    #[inline]
    fn find_surfaces(&self, scene: &mut TileScene, hits: &RowHits, column: usize, pixel: &mut Pixel) {
        pixel.surfaces.clear();
        pixel.numbers.clear();
        pixel.directions.clear();
        let samples = self.places.len();
        for i in 0..samples {
            let (x, y) = scene.direction(i, column);
            pixel.directions.push((x, y));
            let sample = Sample { sample: i, samples, x, y, nearest: self.nearest };
            surfaces(scene.solids(), hits.of(i, column), sample, self.shader, |vergence, number| {
                pixel.surfaces.push(vergence);
                pixel.numbers.push(number);
            });
            if let Some(background) = &self.settings.background {
                pixel.surfaces.push(background.vergence);
                pixel.numbers.push(BACKGROUND);
            }
            pixel.surfaces.end_sample();
        }
    }

    /// Sheets of a pixel into those of the tile.
    #[inline]
    fn make_pixel(&self, scene: &TileScene, pixel: &mut Pixel, at: usize, pass: Pass, output: &mut Output) {
        let sheets = if pass == Pass::Front { 1 } else { self.settings.sheets };
        let is_last = sheets == self.settings.sheets;
        let mut made = std::mem::take(&mut pixel.sheets);
        made.compute(&pixel.surfaces, sheets, self.settings.gap_dioptre, is_last);
        let first = usize::from(pass == Pass::Hidden);
        for (sheet, to) in made.sheets().iter().skip(first).zip(&mut output.sheets) {
            let members = made.members(sheet);
            self.add_weights(scene, pixel, members);
            let count = members.len() as f64;
            let weights = pixel.sums.iter().map(|sum| (sum / count) as f32);
            store(to, at, (sheet.vergence, sheet.coverage), weights);
        }
        if pass != Pass::Front || is_last {
            output.counts.merged_pixels += u64::from(made.late() > 0);
        }
        if pass != Pass::Front {
            for sheet in made.sheets().iter().skip(1) {
                self.count_hidden(scene, pixel, made.members(sheet), &mut output.counts);
            }
        }
        if pass != Pass::Hidden {
            if let Some(sheet) = made.sheets().first() {
                output.vergence[at] = sheet.vergence as f32;
                // Samples added late see another surface.
                let late = if sheets == 1 { made.late() } else { 0 };
                output.has_edge |= made.members(sheet).len() - late < self.places.len();
            }
            self.count_near_samples(scene, pixel, &mut output.counts);
        }
        pixel.sheets = made;
    }

    /// Sums of the weights of the members of a sheet, triangle by triangle in the order of their first samples.
    #[inline]
    fn add_weights(&self, scene: &TileScene, pixel: &mut Pixel, members: &[(u32, usize)]) {
        let Pixel { surfaces, numbers, directions, pending, hits, sums, .. } = pixel;
        sums.clear();
        sums.resize(self.bases, 0.0);
        hits.clear();
        let number = numbers[members[0].1];
        let samples = self.places.len();
        let of = |sample: u32, surface: usize| {
            let (x, y) = directions[sample as usize];
            let sample = Sample { sample: sample as usize, samples, x, y, nearest: self.nearest };
            hit(&scene.triangle(numbers[surface]).edges, surfaces.vergence(surface), sample)
        };
        if number != BACKGROUND && members.iter().all(|m| numbers[m.1] == number) {
            hits.extend(members.iter().map(|&(sample, surface)| of(sample, surface)));
            self.shader.add_weights(scene.triangle(number).triangle, hits, sums);
            return;
        }
        pending.clear();
        pending.extend_from_slice(members);
        while let Some(&(_, first)) = pending.first() {
            let number = numbers[first];
            hits.clear();
            pending.retain(|&(sample, surface)| {
                let is_other = numbers[surface] != number;
                match &self.settings.background {
                    _ if is_other => {}
                    Some(background) if number == BACKGROUND => {
                        sums.iter_mut().zip(&background.weights).for_each(|(sum, w)| *sum += w);
                        let (x, y) = directions[sample as usize];
                        self.shader.add_background_at(x, y, sums);
                    }
                    _ => hits.push(of(sample, surface)),
                }
                is_other
            });
            if !hits.is_empty() {
                self.shader.add_weights(scene.triangle(number).triangle, hits, sums);
            }
        }
    }

    /// Counts the samples of a hidden sheet.
    fn count_hidden(&self, scene: &TileScene, pixel: &Pixel, members: &[(u32, usize)], counts: &mut Counts) {
        for &(_, surface) in members {
            let number = pixel.numbers[surface];
            if number != BACKGROUND {
                let t = scene.triangle(number);
                counts.hidden_samples += 1;
                counts.hidden_back_samples += u64::from(t.solid == u32::MAX && !t.is_front);
            }
        }
    }

    /// Counts the samples whose first surface is too near.
    #[inline]
    fn count_near_samples(&self, scene: &TileScene, pixel: &Pixel, counts: &mut Counts) {
        for i in 0..self.places.len() {
            let Some(first) = pixel.surfaces.of(i).next() else { continue };
            let (vergence, number) = (pixel.surfaces.vergence(first), pixel.numbers[first]);
            if number != BACKGROUND {
                counts.near_samples += u64::from(vergence * self.settings.near_m > 1.0);
                if counts.nearest.is_none_or(|(v, _)| vergence >= v) {
                    counts.find_nearest(vergence, scene.triangle(number).triangle);
                }
            }
        }
    }
}

/// Writes a sheet of a pixel: vergence and coverage, and the weights.
#[inline(always)]
pub(super) fn store(
    to: &mut Sheet,
    at: usize,
    (vergence, coverage): (f64, f64),
    weights: impl Iterator<Item = f32>,
) {
    let pixels = to.depth.len();
    for (place, weight) in to.weights.iter_mut().skip(at).step_by(pixels).zip(weights) {
        *place = weight;
    }
    to.depth[at] = if vergence > 0.0 { (1.0 / vergence) as f32 } else { f32::INFINITY };
    to.coverage[at] = coverage as f32;
    to.pixels += 1;
}

/// Border of a tile from its vergences.
fn border(vergence: &[f32], height: usize, width: usize) -> Border {
    let column = |c: usize| (0..height).map(|r| vergence[r * width + c]).collect();
    Border {
        top: vergence[..width].to_vec(),
        bottom: vergence[(height - 1) * width..].to_vec(),
        left: column(0),
        right: column(width - 1),
    }
}

/// Whether two neighbours in a tile are apart.
fn has_edge(vergence: &[f32], height: usize, width: usize, gap: f64) -> bool {
    (0..height).any(|r| {
        let row = &vergence[r * width..][..width];
        row.windows(2).any(|w| is_apart(w[0], w[1], gap))
            || (r + 1 < height
                && row.iter().zip(&vergence[(r + 1) * width..]).any(|(&a, &b)| is_apart(a, b, gap)))
    })
}
