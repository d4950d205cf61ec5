//! A manual page: that of clap, with the sections EXAMPLES, EXIT STATUS, ENVIRONMENT and FILES (man-pages(7)).

use crate::failure::code;
use crate::manual::roff::escape;
use anyhow::{Context, Result};
use clap_mangen::Man;

/// Variables that the program reads.
const ENVIRONMENT: [(&str, &str); 5] = [
    ("XDG_CACHE_HOME", "directory of the cache of traced lenses, instead of ~/.cache"),
    (
        "TMPDIR",
        "directory of temporary files of films at a URL, and of traced bands if the cache cannot be written",
    ),
    (
        "AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY, AWS_SESSION_TOKEN, AWS_REGION",
        "credentials and region of s3://BUCKET/PREFIX",
    ),
    ("AWS_ENDPOINT_URL, AWS_ALLOW_HTTP", "address of another S3-compatible store, and true for http"),
    ("AWS_MAX_ATTEMPTS, AWS_TIMEOUT", "attempts of a request, 1 to 100, and its time limit"),
];

/// Files that the program makes beside its outputs.
const FILES: [(&str, &str); 3] = [
    ("~/.cache/lenscube/lenses", "traced bands of designs; may be deleted at any time (lenscube-cache(1))"),
    ("FILM.zarr/runs", "records of the runs of a film, and its locks"),
    (
        ".tmp-lenscube-*",
        "temporary files of a running process; the next command in the directory removes those of ended ones",
    ),
];

/// The page of `command`.
pub(super) fn page(mut command: clap::Command) -> Result<Vec<u8>> {
    let after = command.get_after_help().map(ToString::to_string).unwrap_or_default();
    command = command.after_help("");
    let man = Man::new(command.clone());
    let mut bytes = Vec::new();
    let parts = [
        Man::render_title,
        Man::render_name_section,
        Man::render_synopsis_section,
        Man::render_description_section,
        Man::render_options_section,
    ];
    for part in parts {
        part(&man, &mut bytes).context("writing a manual page")?;
    }
    if command.has_subcommands() {
        man.render_subcommands_section(&mut bytes).context("writing a manual page")?;
    }
    let (examples, remarks) = split(&after);
    let mut text = String::new();
    if !remarks.is_empty() {
        text += &format!(".SH NOTES\n{}", paragraphs(&remarks));
    }
    if !examples.is_empty() {
        let lines: Vec<String> = examples.iter().map(|line| escape(line)).collect();
        text += &format!(".SH EXAMPLES\n.nf\n{}\n.fi\n", lines.join("\n"));
    }
    text += &definitions("EXIT STATUS", &code::MEANINGS.map(|(code, meaning)| (code.to_string(), meaning)));
    text += &definitions("ENVIRONMENT", &ENVIRONMENT);
    text += &definitions("FILES", &FILES);
    bytes.extend(text.into_bytes());
    if command.get_version().is_some() {
        man.render_version_section(&mut bytes).context("writing a manual page")?;
    }
    Ok(bytes)
}

/// Command lines, and the other lines, of a help text.
fn split(after: &str) -> (Vec<String>, Vec<String>) {
    let lines = after.lines().filter(|l| !l.trim_end().is_empty() && !l.starts_with("Example"));
    // The exit codes have a section of their own.
    let lines = lines.filter(|l| !l.starts_with("Exit codes:"));
    let (examples, remarks): (Vec<&str>, Vec<&str>) = lines.partition(|l| l.starts_with("  "));
    let owned = |list: Vec<&str>| list.iter().map(|l| l.trim().to_owned()).collect();
    (owned(examples), owned(remarks))
}

fn paragraphs(lines: &[String]) -> String {
    lines.iter().map(|line| format!("{}\n", escape(line))).collect()
}

fn definitions(title: &str, all: &[(impl AsRef<str>, &str)]) -> String {
    let mut out = format!(".SH \"{title}\"\n");
    for (term, text) in all {
        out += &format!(".TP\n\\fB{}\\fR\n{}\n", escape(term.as_ref()), escape(text));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn page_has_examples_exit_codes_environment_and_files() {
        let command = clap::Command::new("lenscube-try")
            .about("Try")
            .after_help("Examples:\n  lenscube try .hidden --force\nA remark.\nExit codes: 0 complete");
        let page = String::from_utf8(page(command).unwrap()).unwrap();
        for words in [
            ".SH EXAMPLES\n.nf\nlenscube try .hidden \\-\\-force\n.fi\n",
            ".SH NOTES\nA remark.\n",
            ".SH \"EXIT STATUS\"\n.TP\n\\fB0\\fR\ncomplete\n",
            "\\fBXDG_CACHE_HOME\\fR",
            ".SH \"FILES\"",
        ] {
            assert!(page.contains(words), "{words}: {page}");
        }
        assert!(!page.contains("Exit codes"), "{page}");
        assert_eq!(escape(".x\\y"), "\\&.x\\ey");
    }
}
