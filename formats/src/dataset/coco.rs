//! COCO annotations, and where a lens puts them.
//!
//! Conventions of COCO: boxes [x, y, width, height] and polygons [x, y, x, y, …] are measured from the upper left corner of the picture, in pixels, so that
//! the first pixel's centre is (0.5, 0.5); keypoints [x, y, v, …] are indices of pixels, so that its centre is (0, 0). Both are kept.
//!
//! A box becomes the box around its warped border, cut at the film; what lies wholly outside is left out. Polygons are warped at their vertices and at points
//! between them. A keypoint outside the film has v = 0. Masks in run lengths are left out, and the annotation says so: give them as pictures.

use std::collections::HashMap;
use std::path::Path;

use pipeline::geometry::Size;
use serde_json::{Map, Value, json};

use crate::durable::read_file_at_most;

/// Largest file of annotations that is read, bytes.
const MAX_BYTES: u64 = 2 << 30;
/// Points on each side of a box.
const SIDE_POINTS: usize = 32;
/// Longest piece of a polygon's side, pixels.
const PIECE_PX: f64 = 16.0;

/// Annotations that cannot be read.
#[derive(Debug, thiserror::Error)]
#[error("labels {path}: {problem}")]
pub struct CocoError {
    path: String,
    problem: String,
}

/// Annotations by picture.
#[derive(Clone, Debug, Default)]
pub struct Coco {
    /// Annotations of the picture of a file name.
    by_name: HashMap<String, Vec<Map<String, Value>>>,
    /// Categories, as the file has them.
    pub categories: Value,
    /// Digest of the file.
    pub digest: String,
}

impl Coco {
    /// Reads the file at `path`.
    ///
    /// # Errors
    /// [`CocoError`].
    pub fn open(path: &Path) -> Result<Self, CocoError> {
        let fail = |problem: String| CocoError { path: path.display().to_string(), problem };
        let bytes = read_file_at_most(path, MAX_BYTES).map_err(|e| fail(e.to_string()))?;
        let bytes = bytes.ok_or_else(|| fail(format!("expected at most {MAX_BYTES} bytes, found more")))?;
        let file: Value = serde_json::from_slice(&bytes).map_err(|e| fail(format!("expected JSON: {e}")))?;
        let list = |name: &str| {
            file[name]
                .as_array()
                .ok_or_else(|| fail(format!("expected COCO annotations with a list `{name}`, found none")))
        };
        let mut names: HashMap<u64, String> = HashMap::new();
        let mut by_name: HashMap<String, Vec<Map<String, Value>>> = HashMap::new();
        for (k, image) in list("images")?.iter().enumerate() {
            let id = image["id"]
                .as_u64()
                .ok_or_else(|| fail(format!("images[{k}]: expected a whole number `id`")))?;
            let name = image["file_name"]
                .as_str()
                .ok_or_else(|| fail(format!("images[{k}]: expected a text `file_name`")))?;
            let name =
                Path::new(name).file_name().map_or(String::new(), |n| n.to_string_lossy().into_owned());
            by_name.insert(name.clone(), Vec::new());
            names.insert(id, name);
        }
        for (k, annotation) in list("annotations")?.iter().enumerate() {
            let of = annotation["image_id"].as_u64().and_then(|id| names.get(&id));
            let name = of.ok_or_else(|| {
                fail(format!("annotations[{k}]: expected the `image_id` of one of its images"))
            })?;
            let fields = check(annotation).map_err(|e| fail(format!("annotations[{k}]: {e}")))?;
            by_name.entry(name.clone()).or_default().push(fields);
        }
        Ok(Self {
            by_name,
            categories: file["categories"].clone(),
            digest: blake3::hash(&bytes).to_hex().to_string(),
        })
    }

    /// Annotations of the picture of a file name; none if the file has no such picture.
    pub fn of(&self, name: &str) -> Option<&[Map<String, Value>]> {
        self.by_name.get(name).map(Vec::as_slice)
    }
}

/// The fields of an annotation, of which numbers are numbers.
fn check(annotation: &Value) -> Result<Map<String, Value>, String> {
    let fields = annotation.as_object().ok_or("expected fields in braces")?;
    let are_numbers = |name: &str, group: usize| match fields.get(name) {
        None => Ok(()),
        Some(values) => match numbers(values).filter(|v| v.len() % group == 0) {
            Some(_) => Ok(()),
            None => Err(format!("`{name}`: expected finite numbers in groups of {group}")),
        },
    };
    are_numbers("bbox", 4)?;
    are_numbers("keypoints", 3)?;
    if fields.get("bbox").is_some_and(|b| b.as_array().map(Vec::len) != Some(4)) {
        return Err("`bbox`: expected four numbers".into());
    }
    if let Some(Value::Array(polygons)) = fields.get("segmentation")
        && !polygons.iter().all(|p| numbers(p).is_some_and(|v| v.len() >= 6 && v.len() % 2 == 0))
    {
        return Err("`segmentation`: expected polygons of three points or more".into());
    }
    Ok(fields.clone())
}

fn numbers(value: &Value) -> Option<Vec<f64>> {
    value.as_array()?.iter().map(|v| v.as_f64().filter(|v| v.is_finite())).collect()
}

/// An annotation on a film of `size`; `map` is where points of the picture land, both in pixels from the upper left corner. None: it lies outside.
///
/// # Errors
/// Those of `map`.
pub fn warped<E>(
    annotation: &Map<String, Value>,
    size: Size,
    map: impl Fn(&[[f64; 2]]) -> Result<Vec<[f64; 2]>, E>,
) -> Result<Option<Map<String, Value>>, E> {
    let mut out = annotation.clone();
    let limits = [size.width as f64, size.height as f64];
    if let Some(bbox) = annotation.get("bbox").and_then(numbers) {
        match box_around(&map(&border(&bbox))?, limits) {
            Some(bbox) => out.insert("bbox".into(), json!(bbox)),
            None => return Ok(None),
        };
    }
    match annotation.get("segmentation") {
        Some(Value::Array(polygons)) => {
            let mut all = Vec::new();
            for polygon in polygons.iter().filter_map(numbers) {
                all.push(map(&pieces(&polygon))?.concat());
            }
            out.insert("segmentation".into(), json!(all));
        }
        Some(_) => {
            out.remove("segmentation");
            out.insert("left_out".into(), json!("segmentation in run lengths"));
        }
        None => {}
    }
    // The area of the picture's region is not that of the film's.
    out.remove("area");
    if let Some(points) = annotation.get("keypoints").and_then(numbers) {
        let (triples, _) = points.as_chunks::<3>();
        let centres: Vec<[f64; 2]> = triples.iter().map(|[x, y, _]| [x + 0.5, y + 0.5]).collect();
        let mapped = map(&centres)?;
        let mut labelled = 0;
        let of = |([_, _, v], [x, y]): (&[f64; 3], [f64; 2])| {
            let is_inside = (0.0..limits[0]).contains(&x) && (0.0..limits[1]).contains(&y);
            if *v > 0.0 && is_inside {
                labelled += 1;
                [x - 0.5, y - 0.5, *v]
            } else {
                [0.0; 3]
            }
        };
        let keypoints: Vec<[f64; 3]> = triples.iter().zip(mapped).map(of).collect();
        out.insert("keypoints".into(), json!(keypoints.concat()));
        out.insert("num_keypoints".into(), json!(labelled));
    }
    Ok(Some(out))
}

/// Points on the border of a box.
fn border(bbox: &[f64]) -> Vec<[f64; 2]> {
    let [x, y, w, h] = [bbox[0], bbox[1], bbox[2], bbox[3]];
    let along = |k: usize| k as f64 / SIDE_POINTS as f64;
    (0..=SIDE_POINTS)
        .map(along)
        .flat_map(|t| [[x + t * w, y], [x + t * w, y + h], [x, y + t * h], [x + w, y + t * h]])
        .collect()
}

/// The box around points, cut at the film; none if nothing is left.
fn box_around(points: &[[f64; 2]], limits: [f64; 2]) -> Option<[f64; 4]> {
    let range = |axis: usize| {
        let values = points.iter().map(|p| p[axis].clamp(0.0, limits[axis]));
        values.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)))
    };
    let ((left, right), (top, bottom)) = (range(0), range(1));
    (right > left && bottom > top).then_some([left, top, right - left, bottom - top])
}

/// The vertices of a closed polygon, and points between them.
fn pieces(polygon: &[f64]) -> Vec<[f64; 2]> {
    let (vertices, _) = polygon.as_chunks::<2>();
    let mut all = Vec::new();
    for (k, a) in vertices.iter().enumerate() {
        let b = vertices[(k + 1) % vertices.len()];
        let length = pipeline::real::hypot(b[0] - a[0], b[1] - a[1]);
        let count = ((length / PIECE_PX).ceil() as usize).max(1);
        all.extend((0..count).map(|i| {
            let t = i as f64 / count as f64;
            [a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])]
        }));
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::convert::Infallible;

    /// Twice as large, 3 px to the right.
    fn double(points: &[[f64; 2]]) -> Result<Vec<[f64; 2]>, Infallible> {
        Ok(points.iter().map(|[x, y]| [2.0 * x + 3.0, 2.0 * y]).collect())
    }

    fn annotation(text: Value) -> Map<String, Value> {
        check(&text).unwrap()
    }

    #[test]
    fn boxes_polygons_and_keypoints_follow_the_map() {
        let given = annotation(json!({
            "id": 7, "category_id": 1, "area": 12, "bbox": [1, 2, 3, 4],
            "segmentation": [[1, 2, 4, 2, 4, 40]], "keypoints": [1, 2, 2, 90, 2, 2, 1, 2, 0],
        }));
        let out = warped(&given, Size::new(100, 100), double).unwrap().unwrap();
        assert_eq!(out["bbox"], json!([5.0, 4.0, 6.0, 8.0]));
        assert_eq!(out["keypoints"], json!([5.5, 4.5, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]));
        assert_eq!((&out["num_keypoints"], &out["id"], out.get("area")), (&json!(1), &json!(7), None));
        let polygon = numbers(&out["segmentation"][0]).unwrap();
        assert_eq!(polygon[..4], [5.0, 4.0, 11.0, 4.0]);
        assert_eq!(polygon.len() / 2, 1 + 3 + 3, "the long sides have points between their ends");
    }

    #[test]
    fn what_lies_outside_is_cut_or_left_out() {
        let size = Size::new(10, 10);
        let cut = annotation(json!({"bbox": [2, 1, 9, 1]}));
        assert_eq!(warped(&cut, size, double).unwrap().unwrap()["bbox"], json!([7.0, 2.0, 3.0, 2.0]));
        let outside = annotation(json!({"bbox": [20, 1, 9, 1]}));
        assert_eq!(warped(&outside, size, double).unwrap(), None);
        let runs =
            annotation(json!({"bbox": [0, 0, 1, 1], "segmentation": {"counts": [1, 2], "size": [1, 3]}}));
        let out = warped(&runs, size, double).unwrap().unwrap();
        assert_eq!(
            (out.get("segmentation"), &out["left_out"]),
            (None, &json!("segmentation in run lengths"))
        );
    }

    #[test]
    fn annotations_that_are_none_are_refused() {
        for text in [
            json!({"bbox": [1, 2, 3]}),
            json!({"bbox": [1, 2, 3, "4"]}),
            json!({"keypoints": [1, 2]}),
            json!({"segmentation": [[1, 2, 3, 4]]}),
            json!([]),
        ] {
            assert!(check(&text).is_err(), "{text}");
        }
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.json");
        for (text, expected) in [
            ("{", "expected JSON"),
            ("{}", "`images`"),
            (
                r#"{"images": [{"id": 1, "file_name": "a.png"}], "annotations": [{"image_id": 2}]}"#,
                "image_id",
            ),
        ] {
            std::fs::write(&path, text).unwrap();
            let error = Coco::open(&path).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        }
        std::fs::write(
            &path,
            r#"{"images": [{"id": 1, "file_name": "d/a.png"}], "annotations": [{"image_id": 1, "bbox": [0,0,1,1]}]}"#,
        )
        .unwrap();
        let coco = Coco::open(&path).unwrap();
        assert_eq!((coco.of("a.png").map(<[_]>::len), coco.of("b.png")), (Some(1), None));
    }
}
