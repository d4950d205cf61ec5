//! Request handlers: files of the page, tiles, crops, and data of a pixel.

use super::content::Content;
use super::error::HttpError;
use super::guard::{ServerState, guard};
use super::image_pyramid::{ImagePyramid, LinearValues, Mode};
use super::lens::FieldPoint;
use super::mosaic::Mosaic;
use super::query::{self, Query};
use anyhow::Result;
use axum::Router;
use axum::extract::{Path, State};
use axum::http::header;
use axum::middleware::from_fn_with_state;
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use formats::picture::image::Image;
use formats::picture::tone::Tone;
use pipeline::geometry::{Rect, Size};
use serde_json::{Value, json};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Rows of a crop that are summed at once.
const CROP_ROWS: usize = 256;

/// File of the page.
#[derive(Clone, Copy)]
struct File {
    path: &'static str,
    content_type: &'static str,
    bytes: &'static [u8],
}

const JAVASCRIPT: &str = "text/javascript; charset=utf-8";

const FILES: [File; 7] = [
    File { path: "/", content_type: "text/html; charset=utf-8", bytes: include_bytes!("page/page.html") },
    File {
        path: "/page.css",
        content_type: "text/css; charset=utf-8",
        bytes: include_bytes!("page/page.css"),
    },
    File { path: "/page.js", content_type: JAVASCRIPT, bytes: include_bytes!("page/page.js") },
    File { path: "/raw.js", content_type: JAVASCRIPT, bytes: include_bytes!("page/raw.js") },
    File { path: "/panel.js", content_type: JAVASCRIPT, bytes: include_bytes!("page/panel.js") },
    File {
        path: "/openseadragon.js",
        content_type: JAVASCRIPT,
        bytes: include_bytes!("page/openseadragon.min.js"),
    },
    File { path: "/icon.svg", content_type: "image/svg+xml", bytes: include_bytes!("page/icon.svg") },
];

/// Routes of the server.
pub fn router(state: Arc<ServerState>) -> Router {
    let mut router = Router::new();
    for File { path, content_type, bytes } in FILES {
        router =
            router.route(path, get(move || async move { ([(header::CONTENT_TYPE, content_type)], bytes) }));
    }
    router
        .route("/api/content", get(content))
        .route("/api/exposure", get(exposure))
        .route("/api/pixel", get(pixel))
        .route("/api/lens", get(lens))
        .route("/psf.png", get(psf))
        .route("/crop.png", get(crop))
        .route("/tile/{image}/{level}/{name}", get(tile))
        .fallback(|| async { HttpError::not_found("no such page") })
        .layer(from_fn_with_state(state.clone(), guard))
        .with_state(state)
}

type SharedState = State<Arc<ServerState>>;
type Answer = Result<Response, HttpError>;

fn png(bytes: Vec<u8>) -> Response {
    ([(header::CONTENT_TYPE, "image/png")], bytes).into_response()
}

fn json_response(value: &Value) -> Response {
    ([(header::CONTENT_TYPE, "application/json")], value.to_string()).into_response()
}

/// `/api/content`: description of film, chart and lens.
async fn content(State(state): SharedState) -> Answer {
    Ok(json_response(&state.content.describe()))
}

/// `/api/exposure`: automatic exposure factors of film and chart in a band or under a light.
async fn exposure(State(state): SharedState, query: Query) -> Answer {
    ServerState::run_blocking(&state, move |content, cancel| {
        let mode = query.mode(&content.film)?;
        let film = content.film.exposure(mode, cancel)?;
        let chart = match &content.chart {
            Some(_) if content.same_values() => Some(film),
            Some(chart) if query.is_set("chart") => Some(chart.exposure(mode, cancel)?),
            _ => None,
        };
        Ok(json_response(&json!({"film": film, "chart": chart})))
    })
    .await
}

/// `/tile/IMAGE/LEVEL/ROW_COLUMN.png`, IMAGE `film` or `chart`.
async fn tile(
    State(state): SharedState,
    Path((image, level, name)): Path<(String, String, String)>,
    query: Query,
) -> Answer {
    ServerState::run_blocking(&state, move |content, cancel| {
        let pyramid = pyramid(content, &image)?;
        let (level, position) = query::tile(&level, &name, pyramid)?;
        let (mode, tone) = (query.mode(pyramid)?, query.tone()?);
        let rect = pyramid.tile_rect(level, position).ok_or_else(|| HttpError::not_found("no such tile"))?;
        let mut image = Image::new(rect.size(), [0; 3]);
        render(&*pyramid.tile(level, position, mode, cancel)?, &tone, &mut image, 0);
        Ok(png(image.to_quick_png("lenscube view")))
    })
    .await
}

/// `/crop.png`: pixels at full size with the current tone.
async fn crop(State(state): SharedState, query: Query) -> Answer {
    ServerState::run_blocking(&state, move |content, cancel| {
        let pyramid = pyramid(content, query.image())?;
        let (rect, mode, tone) = (query.crop(pyramid.size())?, query.mode(pyramid)?, query.tone()?);
        let image = render_crop(pyramid, rect, mode, &tone, cancel)?;
        let colours = match mode {
            Mode::Colour(light) => format!("CIE 1931 2 deg, white {}", light.name()),
            Mode::Band(frame) if pyramid.mosaic.is_some() => format!("mosaic of frame {frame}"),
            Mode::Band(band) => format!("band {} nm", pyramid.wavelengths_nm[band]),
            Mode::Developed(frame, light) => format!("frame {frame} developed, white {}", light.name()),
        };
        let (exposure, gamma) = (tone.exposure, tone.gamma);
        let comment = format!("lenscube view, {rect}, {colours}, exposure {exposure}, gamma {gamma}");
        Ok(png(image.to_quick_png(&comment)))
    })
    .await
}

fn render_crop(
    pyramid: &ImagePyramid,
    rect: Rect,
    mode: Mode,
    tone: &Tone,
    cancel: &AtomicBool,
) -> Result<Image> {
    let mut image = Image::new(rect.size(), [0; 3]);
    for first in (0..rect.height).step_by(CROP_ROWS) {
        let rows = CROP_ROWS.min(rect.height - first);
        let rows = Rect::new(rect.y + first as i64, rect.x, rows, rect.width);
        render(&pyramid.region(0, rows, mode, cancel)?, tone, &mut image, first);
    }
    Ok(image)
}

/// Writes linear values into the rows of `image` from `first` on.
fn render(linear: &LinearValues, tone: &Tone, image: &mut Image, first: usize) {
    let width = image.size().width;
    match linear {
        LinearValues::Colour(values) => {
            for (y, line) in (first..).zip(values.chunks_exact(width)) {
                let pixels = image.row_mut(y).iter_mut().zip(line).enumerate();
                pixels.for_each(|(x, (pixel, &rgb))| *pixel = tone.colour(rgb, (y, x)));
            }
        }
        LinearValues::Developed(values) => {
            let cut = Tone { exposure: 1.0, gamma: tone.gamma };
            for (y, line) in (first..).zip(values.chunks_exact(width)) {
                for (x, (pixel, rgb)) in image.row_mut(y).iter_mut().zip(line).enumerate() {
                    *pixel = cut.colour(rgb.map(|v| (v * tone.exposure as f32).clamp(0.0, 1.0)), (y, x));
                }
            }
        }
        LinearValues::Grey(values) => {
            for (y, line) in (first..).zip(values.chunks_exact(width)) {
                let pixels = image.row_mut(y).iter_mut().zip(line).enumerate();
                pixels.for_each(|(x, (pixel, &v))| *pixel = tone.grey(v, (y, x)));
            }
        }
    }
}

/// `/api/pixel`: spectra of film and chart at a pixel, and its field point; of a raw, its numbers and its developed colour.
async fn pixel(State(state): SharedState, query: Query) -> Answer {
    ServerState::run_blocking(&state, move |content, cancel| {
        let (y, x) = query.pixel(content.film.size())?;
        let mut reading = content.pixel(y, x, cancel)?;
        if content.film.mosaic.as_ref().is_some_and(Mosaic::is_developable)
            && let mode @ Mode::Developed(..) = query.mode(&content.film)?
        {
            let mut one = Image::new(Size::new(1, 1), [0; 3]);
            let linear = content.film.region(0, Rect::new(y as i64, x as i64, 1, 1), mode, cancel)?;
            render(&linear, &Tone { exposure: 1.0, gamma: 1.0 }, &mut one, 0);
            reading["developed"] = json!(one.pixel(0, 0));
        }
        Ok(json_response(&reading))
    })
    .await
}

/// `/api/lens`: figures of the lens at a pixel in a band.
async fn lens(State(state): SharedState, query: Query) -> Answer {
    ServerState::run_blocking(&state, move |content, _| {
        Ok(json_response(&field_point(content, &query)?.json()))
    })
    .await
}

/// `/psf.png`: PSF at a pixel in a band, with the field point on +x.
async fn psf(State(state): SharedState, query: Query) -> Answer {
    ServerState::run_blocking(&state, move |content, _| {
        let image = field_point(content, &query)?.psf_image(query.is_set("log"));
        Ok(png(image.to_quick_png("lenscube view")))
    })
    .await
}

fn field_point(content: &Content, query: &Query) -> Result<Arc<FieldPoint>, HttpError> {
    let lens = content.lens.as_ref().map_err(|message| HttpError::not_found(message.clone()))?;
    let (y, x) = query.pixel(content.film.size())?;
    let nm = content.film.wavelengths_nm[query.band(&content.film)?];
    let (height_mm, _) = content
        .height_and_azimuth(y, x)
        .ok_or_else(|| HttpError::not_found("a chart has no field points, only a film"))?;
    // A height beyond the lens tables is not an internal error.
    lens.field_point(nm, height_mm).map_err(|e| HttpError::not_found(crate::failure::line(&e)))
}

fn pyramid<'a>(content: &'a Content, image: &str) -> Result<&'a ImagePyramid, HttpError> {
    content.pyramid(image).ok_or_else(|| {
        HttpError::not_found(format!("no image `{image}`; expected `film`, or `chart` if one is shown"))
    })
}

#[cfg(test)]
mod tests {
    use super::super::image_pyramid::Cancelled;
    use super::*;
    use formats::picture::View;
    use formats::picture::exposure::Exposure;
    use formats::picture::preview::{PreviewOptions, White, preview};
    use pipeline::chart::Generator;
    use pipeline::colour::Illuminant;

    #[test]
    fn crop_and_tile_pixels_equal_those_of_export() {
        let spec = "checker?size=700&overscan=0&wavelengths=400:700:25";
        let pyramid = ImagePyramid::open(&format!("gen:{spec}"), (None, None), None, 64 << 20).unwrap();
        let chart: Generator = spec.parse().unwrap();
        let (rect, cancel) = (Rect::new(17, 300, 290, 310), AtomicBool::new(false));
        for light in Illuminant::ALL {
            let options = PreviewOptions {
                view: View { region: Some(rect), max_side: None, threads: 1 },
                white: White::Illuminant(light),
                exposure: Exposure::Factor(0.031),
            };
            let (expected, _) = preview(&chart, chart.wavelengths_nm(), &options, &|_, _| ()).unwrap();
            let tone = Tone { exposure: 0.031, gamma: 1.0 };
            let mode = Mode::Colour(light);
            assert!(render_crop(&pyramid, rect, mode, &tone, &cancel).unwrap() == expected, "{light:?}");
            let mut tile = Image::new(pyramid.tile_rect(0, (0, 2)).unwrap().size(), [0; 3]);
            render(&pyramid.tile(0, (0, 2), mode, &cancel).unwrap(), &tone, &mut tile, 0);
            assert_eq!(tile.pixel(100, 10), expected.pixel(100 - 17, 512 + 10 - 300));
        }
    }

    #[test]
    fn cancelled_request_reads_nothing() {
        let pyramid =
            ImagePyramid::open("gen:siemens?size=2000&wavelengths=550", (None, None), None, 64 << 20)
                .unwrap();
        let e = pyramid.exposure(Mode::Band(0), &AtomicBool::new(true)).unwrap_err();
        assert!(e.is::<Cancelled>(), "{e}");
        assert!(pyramid.exposure(Mode::Band(0), &AtomicBool::new(false)).unwrap() > 0.0);
    }
}
