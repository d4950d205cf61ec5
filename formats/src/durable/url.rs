//! URLs of stores: recognition, validation, and display without credentials.

use std::path::Path;

use super::error::DurableError;
use crate::escape;

const CREDENTIALS: &str = "credentials in a URL are not supported, because URLs are printed and stored; set AWS_ACCESS_KEY_ID and \
                           AWS_SECRET_ACCESS_KEY";

/// Schemes whose addresses count as URLs, so that their credentials are not printed, also if the slashes are mistyped.
const SCHEMES: [&str; 3] = ["s3", "http", "https"];

/// Whether a path is a URL, `SCHEME://…`.
pub fn is_url(path: &Path) -> bool {
    path.to_str().is_some_and(|p| scheme(p).is_some())
}

/// The scheme of a URL, if it is one.
fn scheme(path: &str) -> Option<&str> {
    let (scheme, _) = path.split_once("://")?;
    let valid = scheme.starts_with(|c: char| c.is_ascii_alphabetic())
        && scheme.chars().all(|c| c.is_ascii_alphanumeric() || "+-.".contains(c));
    valid.then_some(scheme)
}

/// Parts of a valid URL.
#[cfg_attr(not(feature = "s3"), expect(dead_code, reason = "no URL is opened"))]
pub(super) struct Address<'a> {
    pub(super) scheme: &'a str,
    /// Bucket, or host and port.
    pub(super) host: &'a str,
    /// Path without slashes at its ends.
    pub(super) path: &'a str,
}

impl<'a> Address<'a> {
    pub(super) fn parse(url: &'a str) -> Result<Self, String> {
        let (scheme, rest) = url.split_once("://").ok_or("expected SCHEME://…")?;
        let (host, path) = rest.split_once('/').unwrap_or((rest, ""));
        if authority(rest).contains('@') {
            return Err(CREDENTIALS.into());
        }
        if url.contains(['?', '#']) {
            return Err("expected no `?` and no `#`: signed URLs and queries are not supported".into());
        }
        if url.contains(char::is_control) {
            return Err("expected no line breaks and no other control characters in a URL".into());
        }
        if host.is_empty() {
            return Err("expected s3://BUCKET/PREFIX, or https://HOST/PATH to read".into());
        }
        match scheme {
            "s3" => check_bucket(host)?,
            "http" | "https" => check_web(url)?,
            _ => (),
        }
        Ok(Self { scheme, host, path: path.trim_matches('/') })
    }
}

/// The part between the scheme and the path, query or fragment.
fn authority(rest: &str) -> &str {
    rest.split(['/', '?', '#', '\\']).next().unwrap_or_default()
}

/// Validates an argument of a command line that may be a URL, before anything prints it.
///
/// # Errors
/// [`DurableError::Address`] for a URL of this program's schemes that contains credentials, a query or a fragment, or that is no valid
/// address. Anything but a URL is valid.
pub fn check_url(argument: &str) -> Result<(), DurableError> {
    let invalid = |problem: String| DurableError::Address { path: redacted(argument).into(), problem };
    let known = |scheme: &str| SCHEMES.iter().any(|k| scheme.eq_ignore_ascii_case(k));
    let Some((head, rest)) = argument.split_once(':').filter(|(head, _)| known(head)) else {
        return match scheme(argument) {
            Some(_) if authority(argument.split_once("://").map_or("", |parts| parts.1)).contains('@') => {
                Err(invalid(CREDENTIALS.into()))
            }
            _ => Ok(()),
        };
    };
    if argument.contains("://") {
        return Address::parse(argument).map(drop).map_err(invalid);
    }
    if rest.contains(['@', '?']) {
        return Err(invalid(format!("expected {head}://…")));
    }
    Ok(())
}

/// `url` without user, password, query and fragment; control characters escaped.
pub(super) fn redacted(url: &str) -> String {
    let (head, rest) = url.split_once(':').unwrap_or(("", url));
    let rest = rest.trim_start_matches('/');
    // A password may contain any character, also those that end the authority.
    let rest = rest.rsplit_once('@').map_or(rest, |(_, rest)| rest);
    let rest = rest.split(['?', '#']).next().unwrap_or_default();
    let slashes = if url.contains("://") { "//" } else { "" };
    escape::one_line(&format!("{head}:{slashes}{rest}")).into_owned()
}

/// Validates the name of a bucket: letters, digits, `.`, `-`, `_` (Amazon S3 User Guide, "General purpose bucket naming rules", old ones
/// included).
fn check_bucket(name: &str) -> Result<(), String> {
    let allowed = |c: char| c.is_ascii_alphanumeric() || ".-_".contains(c);
    match name.len() <= 255 && name.chars().all(allowed) {
        true => Ok(()),
        false => Err(
            "the bucket's name contains a character other than letters, digits, `.`, `-` and `_`, or is too long"
                .into(),
        ),
    }
}

/// Validates the address of a web server, host and port included.
#[cfg(feature = "s3")]
fn check_web(url: &str) -> Result<(), String> {
    reqwest::Url::parse(url).map(drop).map_err(|e| format!("{e}, expected https://HOST/PATH"))
}

/// As such a build opens no address of a web server, none is validated.
#[cfg(not(feature = "s3"))]
fn check_web(_url: &str) -> Result<(), String> {
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn problem(url: &str) -> String {
        check_url(url).map_or_else(|e| e.to_string(), |()| panic!("{url} is accepted"))
    }

    #[test]
    fn urls_have_a_scheme_and_paths_have_none() {
        for (path, expected) in [
            ("s3://bucket/film.zarr", Some("s3")),
            ("https://host:9000/a", Some("https")),
            ("/data/a://b", None),
            ("a/b", None),
            ("://b", None),
            ("C:/x", None),
        ] {
            assert_eq!(scheme(path), expected, "{path}");
        }
    }

    #[test]
    fn url_with_credentials_query_or_fragment_is_rejected_and_redacted() {
        for url in [
            "s3://AKIA:hush@bucket/x",
            "https://me:hush@host/x",
            "https://host/x?X-Amz-Signature=hush",
            "http://user:hush@host/film.zarr",
            "http://user:hu?sh@host/x",
            "http://user:hu/sh@host/x",
            "https://host/x?X-Amz-Credential=AKIA&X-Amz-Signature=hush",
            "s3://bucket/film.zarr#token=hush",
            "http:/user:hush@host/x",
            "https:user:hush@host",
            "HTTPS://user:hush@host/x",
            "ftp://user:hush@host/x",
            "s3://AKIA:hush@bucket/film.zarr//film",
        ] {
            let message = problem(url);
            for secret in ["hu", "sh@", "AKIA"] {
                assert!(!message.contains(secret), "{url}: {message}");
            }
        }
        assert!(problem("s3:///x").contains("s3://BUCKET"));
    }

    #[test]
    fn other_arguments_and_urls_without_secrets_are_valid() {
        for argument in [
            "s3://bucket/film.zarr",
            "s3://bucket/film.zarr//film",
            "http://host:9000/a@b/chart.zarr//chart",
            "gs://bucket/film.zarr",
            "gen:checker?size=64",
            "/data/a://b?c@d",
            "http",
            "--half",
            "me@host:film.zarr",
            "400:700:10",
        ] {
            assert!(check_url(argument).is_ok(), "{argument}: {}", check_url(argument).unwrap_err());
        }
    }
}
