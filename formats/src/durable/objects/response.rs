//! Errors of requests: whether they may pass, and the user's way out. Only code and message of a response are quoted: the rest of an
//! error document may contain signed values and keys.

use std::path::Path;

use object_store::Error;
use object_store::client::{HttpError, HttpErrorKind};

use super::super::error::DurableError;

type AnyError = dyn std::error::Error + 'static;

const CHECK_CREDENTIALS: &str = "check AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY, AWS_SESSION_TOKEN and AWS_REGION, and that they allow to \
                                 get, put, delete and list here (without the right to list, S3 reports missing objects as forbidden)";
const LOGIN_REQUIRED: &str = "the web server requires a login, which is not supported for http(s)://";
const CHECK_BUCKET: &str = "check the bucket's name, AWS_ENDPOINT_URL and AWS_REGION, or create the bucket";

/// An error and its causes.
fn causes(error: &AnyError) -> impl Iterator<Item = &AnyError> {
    std::iter::successors(Some(error), |e| (*e).source())
}

/// Texts of an error and its causes; the response is available only there.
fn texts(error: &AnyError) -> impl Iterator<Item = String> {
    causes(error).map(ToString::to_string)
}

/// The HTTP status of the response, if there was one.
fn status(error: &AnyError) -> Option<u16> {
    let number = |text: String| {
        let (_, after) = text.split_once("status code: ")?;
        after.get(..3)?.parse().ok()
    };
    texts(error).find_map(number)
}

/// Whether the response reports a missing bucket.
pub(super) fn is_missing_bucket(error: &AnyError) -> bool {
    texts(error).any(|text| text.contains("<Code>NoSuchBucket</Code>"))
}

/// Whether a response was interrupted, and the client has not repeated the request as often as it may: it repeats requests without
/// a response, but not those whose error document (of a missing object, say) is interrupted.
pub(super) fn is_interrupted(error: &Error) -> bool {
    let Some(transport) = causes(error).find_map(|e| e.downcast_ref::<HttpError>()) else { return false };
    match texts(error).find(|text| text.starts_with("Error performing")).map(|text| repetitions(&text)) {
        None => true,
        Some(Some((repeated, allowed))) => repeated < allowed,
        Some(None) => !matches!(transport.kind(), HttpErrorKind::Connect | HttpErrorKind::Timeout),
    }
}

/// How often the client repeated a request, and how often it may, where it did.
fn repetitions(text: &str) -> Option<(usize, usize)> {
    let (_, after) = text.split_once(", after ")?;
    let (repeated, after) = after.split_once(" retries, max_retries: ")?;
    let (allowed, _) = after.split_once(',')?;
    Some((repeated.parse().ok()?, allowed.parse().ok()?))
}

/// The text of an element of the response's XML.
fn element(error: &AnyError, name: &str) -> Option<String> {
    texts(error).find_map(|text| {
        let (_, after) = text.split_once(&format!("<{name}>"))?;
        after.split_once(&format!("</{name}>")).map(|(content, _)| content.trim().to_owned())
    })
}

/// Status, code and message of a response, or the error of the connection.
fn reason(error: &Error) -> String {
    let transport = causes(error).find_map(|e| e.downcast_ref::<HttpError>());
    if let Some(e) = transport {
        // The last cause is the system's: connection refused, no such host.
        return causes(e).last().map_or_else(|| e.to_string(), ToString::to_string);
    }
    let code = element(error, "Code");
    let status = status(error).map(|s| format!("the store answers {s}"));
    let parts: Vec<String> = [status, code, element(error, "Message")].into_iter().flatten().collect();
    if parts.is_empty() { last_cause(error) } else { parts.join(": ") }
}

/// Text of the last cause of an error that is no response, without any document.
fn last_cause(error: &Error) -> String {
    let last = causes(error).last().map_or_else(|| error.to_string(), ToString::to_string);
    last.split('<').next().unwrap_or_default().trim().to_owned()
}

/// Classifies an error of a request.
pub(super) fn durable_error(doing: &'static str, path: &Path, error: &Error) -> DurableError {
    let (path, reason) = (path.to_path_buf(), reason(error));
    let rejected = |reason, way_out| DurableError::Rejected { doing, path: path.clone(), reason, way_out };
    let web = !path.starts_with("s3:");
    match (error, status(error)) {
        _ if is_missing_bucket(error) => rejected(reason, CHECK_BUCKET),
        (Error::PermissionDenied { .. } | Error::Unauthenticated { .. }, _) | (_, Some(401 | 403)) => {
            rejected(reason, if web { LOGIN_REQUIRED } else { CHECK_CREDENTIALS })
        }
        (Error::NotFound { .. }, _) => rejected(reason, CHECK_BUCKET),
        (Error::NotSupported { .. }, _) => rejected(
            "the server does not support range requests".into(),
            "a sharded array needs a server that supports them",
        ),
        (_, Some(301 | 307 | 400)) => rejected(reason, "check AWS_REGION and AWS_ENDPOINT_URL"),
        (_, Some(s)) if (400..500).contains(&s) && ![408, 409, 429].contains(&s) => {
            rejected(reason, "check the URL, and AWS_ENDPOINT_URL")
        }
        _ => DurableError::Unreachable { doing, path, reason },
    }
}
