//! Markdown of the guide as a manual page (man-pages(7)): headings, paragraphs, lists, indented examples, tables as they stand.

use super::Page;

/// The page `lenscube-NAME(7)`.
pub fn manual_page(page: &Page) -> String {
    let mut out = format!(
        ".TH \"LENSCUBE-{}\" 7 \"\" \"lenscube {}\"\n.SH NAME\nlenscube\\-{} \\- {}\n",
        page.name.to_uppercase(),
        env!("CARGO_PKG_VERSION"),
        page.name,
        escape(page.about)
    );
    let mut is_preformatted = false;
    for line in page.text.lines() {
        // Tables and examples keep their lines.
        let keeps_lines = line.starts_with("    ") || line.starts_with('|');
        if keeps_lines != is_preformatted && !(is_preformatted && line.is_empty()) {
            out += if keeps_lines { ".PP\n.nf\n" } else { ".fi\n.PP\n" };
            is_preformatted = keeps_lines;
        }
        out += &match line {
            _ if is_preformatted => format!("{}\n", escape(line)),
            "" => ".PP\n".to_owned(),
            // Pictures have no place in a manual page.
            _ if line.starts_with("![") => String::new(),
            _ => match (heading(line), line.strip_prefix("- ")) {
                (Some(title), _) => format!(".SH \"{}\"\n", escape(&title.to_uppercase())),
                (None, Some(item)) => format!(".IP \\(bu 2\n{}\n", escape(item)),
                (None, None) => format!("{}\n", escape(line.trim_start())),
            },
        };
    }
    if is_preformatted {
        out += ".fi\n";
    }
    out
}

fn heading(line: &str) -> Option<&str> {
    line.starts_with('#').then(|| line.trim_start_matches('#').trim())
}

/// Text as roff prints it unchanged.
pub fn escape(text: &str) -> String {
    let text = text.replace('\\', "\\e").replace('-', "\\-");
    // A leading dot or apostrophe would begin a request.
    if text.starts_with(['.', '\'']) { format!("\\&{text}") } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn examples_and_tables_keep_their_lines() {
        let text = "# Title\n\nWords of\na paragraph.\n\n    lenscube run --x\n\n![p](a.png)\n\n- item\n  more\n\n| a | b |\n|---|---|\n";
        let page = manual_page(&Page { name: "topic", about: "about it", text });
        let body = &page[page.find(".SH \"TITLE\"").unwrap()..];
        let expected = ".SH \"TITLE\"\n.PP\nWords of\na paragraph.\n.PP\n.PP\n.nf\n    lenscube run \\-\\-x\n\n.fi\n.PP\n.PP\n.IP \\(bu 2\nitem\nmore\n.PP\n.PP\n.nf\n| a | b |\n|\\-\\-\\-|\\-\\-\\-|\n.fi\n";
        assert_eq!(body, expected);
    }
}
