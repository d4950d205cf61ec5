//! `report.html`: the main figures of one camera, or of two side by side, and below them the sections.

use super::section::Section;
use crate::outputs::page::{page, table};
use formats::picture::style::{Colour, Style, hex};
use formats::picture::text::{escape, font_css};

const STYLE: &str = "body{font:15px/1.5 Inter,'DejaVu Sans',Helvetica,Arial,sans-serif;color:#111;max-width:1500px;margin:0 auto;padding:24px}\
h1{font-size:26px}h2{font-size:20px;margin-top:40px;border-bottom:1px solid #bbb}h3{font-size:16px;margin:20px 0 4px}\
table{border-collapse:collapse;margin:12px 0;font-size:13px}th,td{padding:3px 9px;border:1px solid #ccc;text-align:right;font-variant-numeric:tabular-nums}\
th{background:#f2f2f2}td:first-child,th:first-child{text-align:left}.sides{display:flex;gap:24px;align-items:flex-start}.sides>div{flex:1 1 0;min-width:0}\
.one{max-width:800px}svg{max-width:100%;height:auto;display:block;margin:8px 0}.note{color:#555}.doubtful{color:#a00}details{margin:8px 0}\
@media print{body{padding:0;font-size:11px}table{font-size:9px}tr,svg{break-inside:avoid}h2,h3{break-after:avoid}}";

/// A camera: its name and what was measured of it, chart by chart.
pub struct Camera {
    /// Name.
    pub name: String,
    /// Sections.
    pub sections: Vec<Section>,
}

/// The page of one or two cameras, whose sections are of the same charts.
pub fn html(cameras: &[Camera], style: Style) -> String {
    let names: Vec<String> = cameras.iter().map(|c| escape(&c.name)).collect();
    let mut body = format!(
        "<p>Measured with lenscube {} from pictures of charts. Values are linear in light.</p>",
        env!("CARGO_PKG_VERSION")
    );
    body += &summary(cameras);
    for (k, first) in cameras[0].sections.iter().enumerate() {
        let class = if cameras.len() > 1 { "sides" } else { "one" };
        body += &format!(
            "<h2>{}</h2><p class=\"note\">{}.</p><div class=\"{class}\">",
            escape(first.title),
            escape(first.standard)
        );
        for camera in cameras {
            body += &format!("<div>{}</div>", side(&camera.sections[k], &camera.name));
        }
        body += "</div>";
    }
    let dark = match style {
        Style::Light => String::new(),
        Style::Dark => {
            let colour = |c| hex(style.rgb(c));
            format!(
                "body{{background:{};color:{}}}th{{background:#2a2d31}}th,td,h2{{border-color:{}}}.note{{color:#aaa}}.doubtful{{color:#f88}}",
                colour(Colour::Paper),
                colour(Colour::Ink),
                colour(Colour::Grid)
            )
        }
    };
    let css = format!("{}{STYLE}{dark}", font_css());
    page("lenscube report", &format!("Report of {}", names.join(" and ")), &css, &body)
}

/// The main figures of all sections, a column a camera.
fn summary(cameras: &[Camera]) -> String {
    let mut head = vec!["figure".to_owned()];
    head.extend(cameras.iter().map(|c| c.name.clone()));
    let mut rows = vec![head];
    for (k, first) in cameras[0].sections.iter().enumerate() {
        for (name, _) in &first.figures {
            let mut row = vec![name.clone()];
            row.extend(cameras.iter().map(|camera| {
                let own = camera.sections[k].figures.iter().find(|(n, _)| n == name);
                own.map_or("none".into(), |(_, value)| value.clone())
            }));
            rows.push(row);
        }
    }
    table(rows)
}

/// A section of one camera.
fn side(section: &Section, camera: &str) -> String {
    let mut text = format!("<h3>{}</h3><p class=\"note\">{}</p>", escape(camera), escape(&section.picture));
    if let Some(camera) = &section.camera {
        text += &format!("<p class=\"note\">{}</p>", escape(camera));
    }
    if !section.remarks.is_empty() {
        let all: Vec<String> = section.remarks.iter().map(|r| format!("<li>{}</li>", escape(r))).collect();
        text += &format!("<ul class=\"doubtful\">{}</ul>", all.concat());
    }
    text.extend(section.plots.iter().map(formats::picture::figure::Figure::to_svg_element));
    for rows in &section.tables {
        text += &format!("<details><summary>Table</summary>{}</details>", table(rows.clone()));
    }
    text
}
