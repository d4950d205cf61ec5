//! What a store's refusal means: whether it may pass, and the way out. Answers are quoted by their code and message only:
//! the rest of an error document may hold what was signed, and keys' names.

use std::path::Path;

use object_store::Error;
use object_store::client::HttpError;

use super::super::DurableError;

type Any = dyn std::error::Error + 'static;

const WHO: &str = "check AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY, AWS_SESSION_TOKEN and AWS_REGION, and that they allow to \
                   get, put, delete and list here (without the right to list, S3 forbids what is not there)";
const LOGIN: &str = "the web server wants a login, which http(s):// cannot give it here";
const WHERE: &str = "check the bucket's name, AWS_ENDPOINT_URL and AWS_REGION, or create the bucket";

/// The chain of an error and its causes.
fn chain(error: &Any) -> impl Iterator<Item = &Any> {
    std::iter::successors(Some(error), |e| (*e).source())
}

/// What the server said: its words are only in the text of the error.
fn said(error: &Any) -> impl Iterator<Item = String> {
    chain(error).map(ToString::to_string)
}

/// The HTTP status of the answer, if there was one.
pub(super) fn status(error: &Any) -> Option<u16> {
    let number = |text: String| {
        let (_, after) = text.split_once("status code: ")?;
        after.get(..3)?.parse().ok()
    };
    said(error).find_map(number)
}

/// Whether an answer says that there is no such bucket.
pub(super) fn names_bucket(error: &Any) -> bool {
    said(error).any(|text| text.contains("<Code>NoSuchBucket</Code>"))
}

/// Whether an answer began and broke off, rather than never came after all repetitions of the request.
pub(super) fn broken_off(error: &Error) -> bool {
    let transport = chain(error).any(|e| e.is::<HttpError>());
    transport && !said(error).any(|text| text.starts_with("Error performing"))
}

/// The text of an element of the answer's XML.
fn element(error: &Any, name: &str) -> Option<String> {
    said(error).find_map(|text| {
        let (_, after) = text.split_once(&format!("<{name}>"))?;
        after.split_once(&format!("</{name}>")).map(|(words, _)| words.trim().to_owned())
    })
}

/// Status, code and message of an answer; or why there was none.
fn reason(error: &Error) -> String {
    let transport = chain(error).find_map(|e| e.downcast_ref::<HttpError>());
    if let Some(e) = transport {
        // The last cause is the system's: connection refused, no such host.
        return chain(e).last().map_or_else(|| e.to_string(), ToString::to_string);
    }
    let code = element(error, "Code");
    let status = status(error).map(|s| format!("the store answers {s}"));
    let words: Vec<String> = [status, code, element(error, "Message")].into_iter().flatten().collect();
    if words.is_empty() { plain(error) } else { words.join(": ") }
}

/// An error that is no answer of a server: in its own words, without what may be a document.
fn plain(error: &Error) -> String {
    let last = chain(error).last().map_or_else(|| error.to_string(), ToString::to_string);
    last.split('<').next().unwrap_or_default().trim().to_owned()
}

/// Sorts an error of the store into its kind.
pub(super) fn fault(doing: &'static str, path: &Path, error: &Error) -> DurableError {
    let (path, reason) = (path.to_path_buf(), reason(error));
    let refused = |reason, way_out| DurableError::Refused { doing, path: path.clone(), reason, way_out };
    let web = !path.starts_with("s3:");
    match (error, status(error)) {
        _ if names_bucket(error) => refused(reason, WHERE),
        (Error::PermissionDenied { .. } | Error::Unauthenticated { .. }, _) | (_, Some(401 | 403)) => {
            refused(reason, if web { LOGIN } else { WHO })
        }
        (Error::NotFound { .. }, _) => refused(reason, WHERE),
        (Error::NotSupported { .. }, _) => refused(
            "the server sends no parts of files".into(),
            "a sharded array needs a server that answers range requests",
        ),
        (_, Some(301 | 307 | 400)) => refused(reason, "check AWS_REGION and AWS_ENDPOINT_URL"),
        (_, Some(s)) if (400..500).contains(&s) && ![408, 409, 429].contains(&s) => {
            refused(reason, "check the URL, and AWS_ENDPOINT_URL")
        }
        _ => DurableError::Unreachable { doing, path, reason },
    }
}
