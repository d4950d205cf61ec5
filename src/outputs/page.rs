//! HTML of reports: one file with embedded figures.

use formats::picture::text::escape;

/// A page with the title `title` (HTML) and the style sheet `style`.
pub fn page(name: &str, title: &str, style: &str, body: &str) -> String {
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>{name}</title><style>{style}</style></head>\
         <body><h1>{title}</h1>{body}</body></html>\n"
    )
}

/// A table whose first row is its head.
pub fn table(rows: Vec<Vec<String>>) -> String {
    let row = |(k, cells): (usize, &Vec<String>)| {
        let tag = if k == 0 { "th" } else { "td" };
        let cells: String = cells.iter().map(|c| format!("<{tag}>{}</{tag}>", escape(c))).collect();
        format!("<tr>{cells}</tr>")
    };
    format!("<table>{}</table>", rows.iter().enumerate().map(row).collect::<String>())
}
