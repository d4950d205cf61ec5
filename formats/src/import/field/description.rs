//! The meaning of a description: names of array files, numbers and words.

use super::arrays::ArrayName;
use super::map_table::{MAP, MapTable, map_table};
use crate::import::{ImportError, MAX_COUNT};
use crate::toml_table::{Entry, Field, Source, TableError};
use pipeline::bounds;
use pipeline::lens::PsfSample;
use std::path::Path;

const ROOT: [&str; 11] = [
    "name",
    "wavelengths_nm",
    "distortion_focal_length_mm",
    "effective_focal_length_mm",
    "f_number",
    "primary_wavelength_nm",
    "object_distance_mm",
    "magnification",
    "psf",
    "map",
    "shading",
];
const PSF: [&str; 7] = ["files", "x_mm", "y_mm", "pitch_um", "sample", "y_up", "centre"];
const SHADING: [&str; 5] = ["relative_illumination", "x_mm", "y_mm", "y_up", "normalise"];

/// Where the middle sample of a window is put.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Centre {
    /// Where the file has it.
    Keep,
    /// On the centroid of the light.
    Centroid,
    /// On the largest sample.
    Peak,
}

impl Centre {
    pub fn name(self) -> &'static str {
        match self {
            Self::Keep => "keep",
            Self::Centroid => "centroid",
            Self::Peak => "peak",
        }
    }
}

/// Coordinates along one axis, mm: in the description, or in an array file.
#[derive(Clone, Debug)]
pub(super) enum Places {
    List(Vec<f64>),
    File(ArrayName),
}

/// Columns and rows.
#[derive(Clone, Debug)]
pub(super) struct Grid {
    pub x: Places,
    pub y: Places,
    /// Whether y ascends upwards.
    pub y_up: bool,
}

pub(super) struct PsfTable {
    /// A file a band; one file of all bands.
    pub files: Vec<ArrayName>,
    pub grid: Grid,
    pub pitch_um: f64,
    pub sample: PsfSample,
    pub centre: Centre,
}

pub(super) struct ShadingTable {
    pub file: ArrayName,
    /// Its own nodes, if any.
    pub grid: Option<Grid>,
    /// Whether the largest value is 1, else that at the film's centre.
    pub largest_is_one: bool,
}

pub(super) struct Description {
    pub name: String,
    pub wavelengths_nm: Vec<f64>,
    pub distortion_focal_length_mm: f64,
    pub effective_focal_length_mm: Option<f64>,
    pub f_number: Option<f64>,
    pub primary_wavelength_nm: Option<f64>,
    pub object_distance_mm: Option<f64>,
    pub magnification: f64,
    pub psf: PsfTable,
    pub map: MapTable,
    pub shading: Option<ShadingTable>,
}

impl Description {
    /// Reads the text of `path`.
    pub fn parse(path: &Path, text: &str) -> Result<Self, ImportError> {
        let source = Source { path, text };
        let tables = source.parse()?;
        let root = source.root(&tables, &ROOT)?;
        let wavelengths_nm = wavelengths(&root)?;
        let map = match root.table("map", &MAP)? {
            None => MapTable::Identity,
            Some(map) => map_table(path, &map)?,
        };
        let object_distance_mm = root.bounded("object_distance_mm", bounds::GIVEN_DISTANCE_MM)?;
        let magnification = root.bounded("magnification", bounds::MAGNIFICATION)?;
        if object_distance_mm.is_some() != magnification.is_some() {
            return Err(root
                .error("has one of object_distance_mm and magnification, expected both, or none for infinity")
                .into());
        }
        let psf = root.required("psf", "a table [psf] with files, x_mm, y_mm, pitch_um and sample")?;
        let name = match root.field("name") {
            Some(name) => name.text("a name in quotes")?.to_owned(),
            None => path.file_stem().map_or("lens".into(), |stem| stem.to_string_lossy().into_owned()),
        };
        Ok(Self {
            name,
            distortion_focal_length_mm: focal_length(&root, &map)?,
            effective_focal_length_mm: root.bounded("effective_focal_length_mm", bounds::FOCAL_LENGTH_MM)?,
            f_number: root.bounded("f_number", bounds::F_NUMBER)?,
            primary_wavelength_nm: root.bounded("primary_wavelength_nm", bounds::WAVELENGTH_NM)?,
            object_distance_mm,
            magnification: magnification.unwrap_or(0.0),
            psf: psf_table(path, &psf.table("[psf]".into(), &PSF)?, wavelengths_nm.len())?,
            map,
            shading: root.table("shading", &SHADING)?.map(|s| shading_table(path, &s)).transpose()?,
            wavelengths_nm,
        })
    }
}

fn wavelengths(root: &Entry<'_>) -> Result<Vec<f64>, TableError> {
    let field = root.required("wavelengths_nm", "a list of the bands' wavelengths, ascending")?;
    let bounds::Bound { min, max, .. } = bounds::WAVELENGTH_NM;
    let expected = format!("a list of 1 to {MAX_COUNT} wavelengths from {min} to {max} nm, ascending");
    let list = field.numbers()?.filter(|nm| (1..=MAX_COUNT).contains(&nm.len()));
    let list = list.ok_or_else(|| field.error(&expected))?;
    let ascends = list.windows(2).all(|w| w[0] < w[1]);
    match ascends && list.iter().all(|nm| bounds::WAVELENGTH_NM.contains(*nm)) {
        true => Ok(list),
        false => Err(field.error(expected)),
    }
}

/// The distortion focal length; f·pitch with a Brown model.
fn focal_length(root: &Entry<'_>, map: &MapTable) -> Result<f64, TableError> {
    const KEY: &str = "distortion_focal_length_mm";
    let given = root.bounded(KEY, bounds::FOCAL_LENGTH_MM)?;
    let MapTable::Brown(brown) = map else {
        return given
            .ok_or_else(|| root.error(format!("has no key `{KEY}`: ideal height = f·tan(field angle)")));
    };
    let f_mm = brown.focal_length_mm();
    match root.field(KEY).filter(|_| given.is_some_and(|mm| (mm / f_mm - 1.0).abs() > 1e-6)) {
        Some(field) => Err(field.error(format!("{f_mm}, f_px·pitch_um of brown, or no such key"))),
        None => Ok(f_mm),
    }
}

fn psf_table(path: &Path, psf: &Entry<'_>, bands: usize) -> Result<PsfTable, ImportError> {
    let expected =
        "a file name, with {band} for the number of the band from 0, or a list of names, one a band";
    let files = psf.required("files", expected)?;
    let texts = files.texts(expected)?;
    let names: Vec<String> = match texts[..] {
        [one] if one.contains("{band}") => {
            (0..bands).map(|b| one.replace("{band}", &b.to_string())).collect()
        }
        _ => texts.iter().map(|&t| t.to_owned()).collect(),
    };
    let mut names =
        names.iter().map(|name| ArrayName::new(path, &files, name)).collect::<Result<Vec<_>, _>>()?;
    if names.len() == 1 && bands > 1 && names[0].is_whole_fits() {
        names = (0..bands).map(|b| names[0].image(b)).collect();
    }
    if names.len() != 1 && names.len() != bands {
        return Err(files.error(format!("1 file, or {bands}, one a band")).into());
    }
    let sample = psf.required("sample", "\"point\" or \"integrated\" (mean over the square of a pitch)")?;
    let pitch = psf.required("pitch_um", "distance of the samples, µm")?;
    Ok(PsfTable {
        files: names,
        grid: grid(path, psf)?,
        pitch_um: pitch.bounded(bounds::PITCH_UM)?,
        sample: sample.word(&[("point", PsfSample::Point), ("integrated", PsfSample::Integrated)])?,
        centre: match psf.field("centre") {
            None => Centre::Keep,
            Some(f) => f.word(&[Centre::Keep, Centre::Centroid, Centre::Peak].map(|c| (c.name(), c)))?,
        },
    })
}

fn shading_table(path: &Path, shading: &Entry<'_>) -> Result<ShadingTable, ImportError> {
    let has_grid = ["x_mm", "y_mm", "y_up"].iter().any(|key| shading.field(key).is_some());
    Ok(ShadingTable {
        file: array(path, shading, "relative_illumination")?,
        grid: if has_grid { Some(grid(path, shading)?) } else { None },
        largest_is_one: match shading.field("normalise") {
            None => false,
            Some(field) => field.word(&[("centre", false), ("largest", true)])?,
        },
    })
}

/// The array that `key` names.
pub(super) fn array(path: &Path, entry: &Entry<'_>, key: &str) -> Result<ArrayName, ImportError> {
    let field = entry.required(key, "the name of an array file")?;
    ArrayName::new(path, &field, field.text("the name of an array file")?)
}

/// The places `x_mm` and `y_mm`.
pub(super) fn grid(path: &Path, entry: &Entry<'_>) -> Result<Grid, ImportError> {
    let places = |key: &str| {
        let field: Field<'_> = entry.required(key, "a list of places in mm, or the name of an array file")?;
        match field.numbers()? {
            Some(list) => Ok(Places::List(list)),
            None => {
                let name = field.text("a list of places in mm, or the name of an array file")?;
                ArrayName::new(path, &field, name).map(Places::File)
            }
        }
    };
    Ok(Grid { x: places("x_mm")?, y: places("y_mm")?, y_up: entry.flag("y_up")? })
}
