//! The answers: the page's own files, tiles, crops, and what is known of a pixel.

use super::door::{Desk, Refusal};
use super::query::{self, Query};
use super::site::Site;
use super::stack::{Linear, Mode, Stack};
use anyhow::Result;
use axum::extract::{Path, Query as Asked, State};
use axum::http::header;
use axum::response::{IntoResponse, Response};
use formats::picture::image::Image;
use formats::picture::tone::Tone;
use pipeline::geometry::Rect;
use serde_json::{Value, json};
use std::collections::HashMap;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Rows of a crop that are summed at once.
const STRIP_ROWS: usize = 256;

/// One of the page's own files.
#[derive(Clone, Copy)]
pub struct File {
    /// Its address.
    pub path: &'static str,
    kind: &'static str,
    bytes: &'static [u8],
}

/// The page.
pub const FILES: [File; 6] = [
    File { path: "/", kind: "text/html; charset=utf-8", bytes: include_bytes!("page/page.html") },
    File { path: "/page.css", kind: "text/css; charset=utf-8", bytes: include_bytes!("page/page.css") },
    File { path: "/page.js", kind: "text/javascript; charset=utf-8", bytes: include_bytes!("page/page.js") },
    File {
        path: "/panel.js",
        kind: "text/javascript; charset=utf-8",
        bytes: include_bytes!("page/panel.js"),
    },
    File {
        path: "/openseadragon.js",
        kind: "text/javascript; charset=utf-8",
        bytes: include_bytes!("page/openseadragon.min.js"),
    },
    File { path: "/icon.svg", kind: "image/svg+xml", bytes: include_bytes!("page/icon.svg") },
];

impl File {
    /// It as an answer.
    pub fn answer(self) -> Response {
        ([(header::CONTENT_TYPE, self.kind)], self.bytes).into_response()
    }
}

type Words = Asked<HashMap<String, String>>;
type At = State<Arc<Desk>>;
type Answer = Result<Response, Refusal>;

fn png(bytes: Vec<u8>) -> Response {
    ([(header::CONTENT_TYPE, "image/png")], bytes).into_response()
}

fn words(value: &Value) -> Response {
    ([(header::CONTENT_TYPE, "application/json")], value.to_string()).into_response()
}

/// `/api/site`: what is on view.
pub async fn site(State(desk): At) -> Answer {
    Ok(words(&desk.site.describe()))
}

/// `/api/exposure`: the factor that suits a band or light; for film and chart.
pub async fn exposure(State(desk): At, Asked(asked): Words) -> Answer {
    desk.work(move |site, stop| {
        let query = Query(asked);
        let mode = query.mode(&site.film)?;
        let film = site.film.exposure(mode, stop)?;
        let chart = match &site.chart {
            Some(_) if site.same_values() => Some(film),
            Some(chart) if query.set("chart") => Some(chart.exposure(mode, stop)?),
            _ => None,
        };
        Ok(words(&json!({"film": film, "chart": chart})))
    })
    .await
}

/// `/tile/STACK/LEVEL/ROW_COLUMN.png`.
pub async fn tile(
    State(desk): At,
    Path((stack, level, name)): Path<(String, String, String)>,
    Asked(asked): Words,
) -> Answer {
    desk.work(move |site, stop| {
        let (stack, query) = (named(site, &stack)?, Query(asked));
        let (level, at) = query::tile(&level, &name, stack)?;
        let (mode, tone) = (query.mode(stack)?, query.tone()?);
        let rect = stack.tile_rect(level, at).ok_or_else(|| Refusal::missing("no such tile"))?;
        let mut image = Image::new(rect.size(), [0; 3]);
        show(&*stack.tile(level, at, mode, stop)?, &tone, &mut image, 0);
        Ok(png(image.to_quick_png("lenscube view")))
    })
    .await
}

/// `/crop.png`: pixels in full, as they are shown.
pub async fn crop(State(desk): At, Asked(asked): Words) -> Answer {
    desk.work(move |site, stop| {
        let query = Query(asked);
        let stack = named(site, query.0.get("stack").map_or("film", String::as_str))?;
        let (rect, mode, tone) = (query.crop(stack.size())?, query.mode(stack)?, query.tone()?);
        let image = cropped(stack, rect, mode, &tone, stop)?;
        let what = match mode {
            Mode::Colour(light) => format!("CIE 1931 2 deg, white {}", light.name()),
            Mode::Band(band) => format!("band {} nm", stack.wavelengths_nm[band]),
        };
        let comment =
            format!("lenscube view, {rect}, {what}, exposure {}, gamma {}", tone.exposure, tone.gamma);
        Ok(png(image.to_quick_png(&comment)))
    })
    .await
}

fn cropped(stack: &Stack, rect: Rect, mode: Mode, tone: &Tone, stop: &AtomicBool) -> Result<Image> {
    let mut image = Image::new(rect.size(), [0; 3]);
    for first in (0..rect.height).step_by(STRIP_ROWS) {
        let rows = STRIP_ROWS.min(rect.height - first);
        let strip = Rect::new(rect.y + first as i64, rect.x, rows, rect.width);
        show(&stack.window(0, strip, mode, stop)?, tone, &mut image, first);
    }
    Ok(image)
}

/// Writes linear values into the rows of `image` from `first` on.
fn show(linear: &Linear, tone: &Tone, image: &mut Image, first: usize) {
    let width = image.size().width;
    match linear {
        Linear::Colour(values) => {
            for (y, line) in (first..).zip(values.chunks_exact(width)) {
                let pixels = image.row_mut(y).iter_mut().zip(line).enumerate();
                pixels.for_each(|(x, (pixel, &rgb))| *pixel = tone.colour(rgb, (y, x)));
            }
        }
        Linear::Grey(values) => {
            for (y, line) in (first..).zip(values.chunks_exact(width)) {
                let pixels = image.row_mut(y).iter_mut().zip(line).enumerate();
                pixels.for_each(|(x, (pixel, &v))| *pixel = tone.grey(v, (y, x)));
            }
        }
    }
}

/// `/api/pixel`: spectrum of film and chart, and where the pixel lies.
pub async fn pixel(State(desk): At, Asked(asked): Words) -> Answer {
    desk.work(move |site, stop| {
        let (y, x) = Query(asked).pixel(site.film.size())?;
        Ok(words(&site.pixel(y, x, stop)?))
    })
    .await
}

/// `/api/lens`: what the lens does at a pixel in a band.
pub async fn lens(State(desk): At, Asked(asked): Words) -> Answer {
    desk.work(move |site, _| Ok(words(&seen(site, &Query(asked))?.json()))).await
}

/// `/psf.png`: the PSF at a pixel in a band, the field point on +x.
pub async fn psf(State(desk): At, Asked(asked): Words) -> Answer {
    desk.work(move |site, _| {
        let query = Query(asked);
        Ok(png(seen(site, &query)?.picture(query.set("log")).to_quick_png("lenscube view")))
    })
    .await
}

fn seen(site: &Site, query: &Query) -> Result<Arc<super::lens::Seen>, Refusal> {
    let lens = site.lens.as_ref().map_err(|why| Refusal::missing(why.clone()))?;
    let (y, x) = query.pixel(site.film.size())?;
    let nm = site.film.wavelengths_nm[query.band(&site.film)?];
    let (height_mm, _) =
        site.field_point(y, x).ok_or_else(|| Refusal::missing("only a film has field points"))?;
    // Beyond the lens's tables is no fault of the program.
    lens.at(nm, height_mm).map_err(|e| Refusal::missing(crate::failure::line(&e)))
}

fn named<'a>(site: &'a Site, stack: &str) -> Result<&'a Stack, Refusal> {
    site.stack(stack).ok_or_else(|| Refusal::missing("neither `film` nor a `chart` that is on view"))
}
