//! Labels of a sample: annotations and masks go where the lens puts the light of the band next to green.

use crate::failure::usage;
use crate::job::arrays::{ArrayLens, Placement};
use anyhow::{Context, Result};
use formats::dataset::coco::{Coco, warped};
use formats::dataset::recipe::PicturesTable;
use pipeline::geometry::Rect;
use serde_json::{Map, Value};
use std::path::{Path, PathBuf};

/// Labels of the pictures.
#[derive(Default)]
pub struct Labels {
    coco: Option<Coco>,
    masks: Option<PathBuf>,
}

/// Where the points of a picture's part land on a film.
pub struct Warp<'a> {
    /// The lens.
    pub lens: &'a ArrayLens,
    /// Film and chart.
    pub place: &'a Placement,
    /// The part of the picture that is the chart.
    pub part: Rect,
    /// Wavelength, nm.
    pub nm: f64,
}

impl Labels {
    /// Those of a recipe whose relative paths start at `folder`.
    ///
    /// # Errors
    /// Annotations that cannot be read; no folder of masks.
    pub fn open(table: &PicturesTable, folder: &Path) -> Result<Self> {
        let coco = table.labels.as_ref().map(|path| Coco::open(&folder.join(path))).transpose();
        let coco = coco.map_err(|e| usage(e.to_string()))?;
        let masks = table.masks.as_ref().map(|path| folder.join(path));
        if let Some(masks) = &masks {
            std::fs::read_dir(masks)
                .map_err(|e| usage(format!("pictures.masks: {}: {e}", masks.display())))?;
        }
        Ok(Self { coco, masks })
    }

    /// Digest of the annotations, for the data set's.
    pub fn digest(&self) -> Option<&str> {
        self.coco.as_ref().map(|coco| coco.digest.as_str())
    }

    /// Categories of the annotations.
    pub fn categories(&self) -> Option<&Value> {
        self.coco.as_ref().map(|coco| &coco.categories)
    }

    /// Whether there are masks.
    pub fn has_masks(&self) -> bool {
        self.masks.is_some()
    }

    /// The mask of a picture: a picture of its name, PNG or TIFF.
    pub fn mask_of(&self, picture: &Path) -> Option<PathBuf> {
        let folder = self.masks.as_ref()?;
        let stem = picture.file_stem()?.to_string_lossy().into_owned();
        let named = |ending: &str| folder.join(format!("{stem}.{ending}"));
        let found = ["png", "tif", "tiff"].map(named).into_iter().find(|path| path.is_file());
        Some(found.unwrap_or_else(|| named("png")))
    }

    /// The annotations of a picture on a film; none without labels.
    ///
    /// # Errors
    /// A picture that the labels do not know; points beyond the field of the lens.
    pub fn annotations(&self, picture: &Path, warp: &Warp<'_>) -> Result<Option<Vec<Map<String, Value>>>> {
        let Some(coco) = &self.coco else { return Ok(None) };
        let name = picture.file_name().map_or(String::new(), |n| n.to_string_lossy().into_owned());
        let all = coco.of(&name).with_context(|| format!("the labels have no image `{name}`"))?;
        let on_film = |annotation| warped(annotation, warp.place.film, |px| warp.film_px(px)).transpose();
        Ok(Some(all.iter().filter_map(on_film).collect::<Result<_>>()?))
    }
}

impl Warp<'_> {
    /// Where points of the picture land on the film, both in pixels from the upper left corner.
    ///
    /// # Errors
    /// Points beyond the field of the lens.
    pub fn film_px(&self, picture_px: &[[f64; 2]]) -> Result<Vec<[f64; 2]>> {
        // Labels may reach beyond the part, and farther than the lens sees: what is there is outside the film wherever it lands.
        let size = self.place.chart;
        let limits = [size.width as f64, size.height as f64];
        let first = [self.part.x as f64, self.part.y as f64];
        let chart: Vec<[f64; 2]> = picture_px
            .iter()
            .map(|p| {
                std::array::from_fn(|i| {
                    (p[i] - first[i]).clamp(-BEYOND * limits[i], (1.0 + BEYOND) * limits[i])
                })
            })
            .collect();
        let inside: Vec<[f64; 2]> =
            chart.iter().map(|p| std::array::from_fn(|i| p[i].clamp(0.0, limits[i]))).collect();
        let film = self.place.film_px(&self.lens.film_of_chart(&self.place.chart_mm(&inside), self.nm)?);
        let moved = |((film, chart), inside): ((&[f64; 2], &[f64; 2]), &[f64; 2])| {
            std::array::from_fn(|i| film[i] + chart[i] - inside[i])
        };
        Ok(film.iter().zip(&chart).zip(&inside).map(moved).collect())
    }

    /// A mask of the chart on the film: of each film pixel the value at the place that its centre shows; 0 outside the chart.
    ///
    /// # Errors
    /// The film reaches beyond the field of the lens.
    pub fn mask(&self, chart: &[u16]) -> Result<Vec<u16>> {
        let (film, size) = (self.place.film, self.place.chart);
        let centres: Vec<[f64; 2]> = (0..film.height)
            .flat_map(|y| (0..film.width).map(move |x| [x as f64 + 0.5, y as f64 + 0.5]))
            .collect();
        let seen = self.lens.chart_of_film(&self.place.film_mm(&centres), self.nm)?;
        let value = |[x, y]: [f64; 2]| {
            let is_inside = x >= 0.0 && y >= 0.0 && x < size.width as f64 && y < size.height as f64;
            if is_inside { chart[y as usize * size.width + x as usize] } else { 0 }
        };
        Ok(self.place.chart_px(&seen).into_iter().map(value).collect())
    }
}

/// Sides of the chart beyond it up to which points of labels are kept apart.
const BEYOND: f64 = 1.0;
