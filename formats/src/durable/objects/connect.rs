//! From a URL and the environment to a store. Credentials come from the environment only, and stay inside the client: a URL that
//! holds some is refused before anything can print or keep it, and shown without them.

use std::collections::HashMap;
use std::net::{SocketAddr, TcpStream};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use object_store::aws::{AmazonS3Builder, AmazonS3ConfigKey};
use object_store::http::HttpBuilder;
use object_store::path::Path as Location;
use object_store::{BackoffConfig, ClientConfigKey, ClientOptions, ObjectStore, RetryConfig};

use super::super::DurableError;
use super::runtime::{wait, within};
use super::{Objects, environment};

/// Requests that fail are sent so often; AWS's own variable says another number.
const ATTEMPTS: usize = 10;
/// After so long none is sent again: below the five minutes for which a signature holds.
const PATIENCE: Duration = Duration::from_secs(180);
/// The longest pause between two.
const PAUSE: Duration = Duration::from_secs(10);
/// One request, the bytes of a shard included.
const REQUEST: &str = "60 seconds";
/// Where machines in the cloud ask who they are.
const METADATA: SocketAddr =
    SocketAddr::new(std::net::IpAddr::V4(std::net::Ipv4Addr::new(169, 254, 169, 254)), 80);

const NOBODY: &str = "no credentials: set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY (files under ~/.aws are not read; `aws \
                      configure export-credentials --format env` prints them), or AWS_SKIP_SIGNATURE=true for a public bucket";

const CREDENTIALS: &str = "credentials do not belong in a URL, where they are shown and kept; set AWS_ACCESS_KEY_ID and \
                           AWS_SECRET_ACCESS_KEY";

/// The scheme of a URL, if it is one.
pub(super) fn scheme(path: &str) -> Option<&str> {
    let (scheme, _) = path.split_once("://")?;
    let word = scheme.starts_with(|c: char| c.is_ascii_alphabetic())
        && scheme.chars().all(|c| c.is_ascii_alphanumeric() || "+-.".contains(c));
    word.then_some(scheme)
}

/// What can be read off a URL.
struct Address<'a> {
    scheme: &'a str,
    /// Bucket, or host and port.
    place: &'a str,
    path: &'a str,
}

impl<'a> Address<'a> {
    fn parse(url: &'a str) -> Result<Self, String> {
        let (scheme, rest) = url.split_once("://").ok_or("expected SCHEME://…")?;
        let (place, path) = rest.split_once('/').unwrap_or((rest, ""));
        if authority(rest).contains('@') {
            return Err(CREDENTIALS.into());
        }
        if url.contains(['?', '#']) {
            return Err(
                "expected no `?` and no `#`: what is signed or asked by the URL is not supported".into()
            );
        }
        if url.contains(char::is_control) {
            return Err("a URL holds no line breaks and no other control characters".into());
        }
        if place.is_empty() {
            return Err("expected s3://BUCKET/PREFIX, or https://HOST/PATH to read".into());
        }
        match scheme {
            "s3" => environment::check_bucket(place)?,
            "http" | "https" => environment::check_web(url)?,
            _ => (),
        }
        Ok(Self { scheme, place, path: path.trim_matches('/') })
    }
}

/// What stands between the scheme and the path, query or fragment.
fn authority(rest: &str) -> &str {
    rest.split(['/', '?', '#', '\\']).next().unwrap_or_default()
}

/// Schemes whose addresses are taken for URLs, and so kept off the screen, also when their slashes are mistyped.
const KNOWN: [&str; 3] = ["s3", "http", "https"];

/// Checks a word of a command line that may be a URL: what must not be shown is refused here, before it is shown.
///
/// # Errors
/// [`DurableError::Address`] for a URL of this program's schemes that holds credentials, a query or a fragment, or that is no valid
/// address. Anything that is no URL is fine.
pub fn check_url(word: &str) -> Result<(), DurableError> {
    let wrong = |problem: String| DurableError::Address { path: shown(word).into(), problem };
    let known = |scheme: &str| KNOWN.iter().any(|k| scheme.eq_ignore_ascii_case(k));
    let Some((head, rest)) = word.split_once(':').filter(|(head, _)| known(head)) else {
        return match scheme(word) {
            Some(_) if authority(word.split_once("://").map_or("", |w| w.1)).contains('@') => {
                Err(wrong(CREDENTIALS.into()))
            }
            _ => Ok(()),
        };
    };
    if word.contains("://") {
        return Address::parse(word).map(drop).map_err(wrong);
    }
    if rest.contains(['@', '?']) {
        return Err(wrong(format!("expected {head}://…")));
    }
    Ok(())
}

/// `url` without what may be secret: user and password, query, fragment; control characters escaped.
pub(super) fn shown(url: &str) -> String {
    let (head, rest) = url.split_once(':').unwrap_or(("", url));
    let rest = rest.trim_start_matches('/');
    // A password may hold any character, also such as end the authority.
    let rest = rest.rsplit_once('@').map_or(rest, |(_, rest)| rest);
    let rest = rest.split(['?', '#']).next().unwrap_or_default();
    let slashes = if url.contains("://") { "//" } else { "" };
    let plain = |c: char| if c.is_control() { c.escape_default().to_string() } else { c.to_string() };
    format!("{head}:{slashes}{rest}").chars().map(plain).collect()
}

pub(super) fn connect(url: &Path) -> Result<Objects, DurableError> {
    let text = url.to_string_lossy();
    let wrong = |problem: String| DurableError::Address { path: shown(&text).into(), problem };
    let address = Address::parse(&text).map_err(wrong)?;
    let web = matches!(address.scheme, "http" | "https");
    let prefix = match web {
        true => Location::from_url_path(address.path),
        false => Location::parse(address.path),
    };
    let prefix = prefix.map_err(|e| wrong(e.to_string()))?;
    // One client for each place: it keeps connections and credentials.
    static CLIENTS: Mutex<Option<HashMap<String, Arc<dyn ObjectStore>>>> = Mutex::new(None);
    let mut clients = CLIENTS.lock().unwrap_or_else(PoisonError::into_inner);
    let clients = clients.get_or_insert_default();
    let name = format!("{}://{}", address.scheme, address.place);
    let store = match clients.get(&name) {
        Some(store) => store.clone(),
        None => within(|| client(&address)).map_err(wrong)?,
    };
    clients.insert(name, store.clone());
    let root = text.trim_end_matches('/').to_owned().into();
    Ok(Objects { root, prefix, store, web })
}

fn client(address: &Address<'_>) -> Result<Arc<dyn ObjectStore>, String> {
    match address.scheme {
        "s3" => s3(address.place),
        "http" | "https" => {
            let options = ClientOptions::new().with_allow_http(true);
            let options = options.with_config(ClientConfigKey::Timeout, REQUEST);
            let url = format!("{}://{}", address.scheme, address.place);
            let builder = HttpBuilder::new().with_url(url).with_client_options(options).with_retry(retry()?);
            Ok(Arc::new(builder.build().map_err(|e| e.to_string())?))
        }
        #[cfg(test)]
        "memory" => Ok(Arc::new(object_store::memory::InMemory::new())),
        other => {
            Err(format!("{other}:// is not known here; expected s3://BUCKET/PREFIX, or http(s)://… to read"))
        }
    }
}

fn retry() -> Result<RetryConfig, String> {
    let attempts = match std::env::var("AWS_MAX_ATTEMPTS") {
        Err(_) => ATTEMPTS,
        Ok(n) => match n.parse() {
            Ok(n @ 1..=100) => n,
            _ => return Err(format!("AWS_MAX_ATTEMPTS={n}: expected a number from 1 to 100")),
        },
    };
    let backoff = BackoffConfig { max_backoff: PAUSE, ..BackoffConfig::default() };
    Ok(RetryConfig { backoff, max_retries: attempts - 1, retry_timeout: PATIENCE })
}

fn s3(bucket: &str) -> Result<Arc<dyn ObjectStore>, String> {
    environment::check()?;
    let mut builder = AmazonS3Builder::from_env().with_bucket_name(bucket).with_retry(retry()?);
    if std::env::var_os("AWS_TIMEOUT").is_none() {
        builder = builder.with_config(AmazonS3ConfigKey::Client(ClientConfigKey::Timeout), REQUEST);
    }
    let set = |key: AmazonS3ConfigKey| builder.get_config_value(&key);
    let on =
        |key| set(key).is_some_and(|v| ["1", "true", "on", "yes", "y"].contains(&v.to_lowercase().as_str()));
    let endpoint = set(AmazonS3ConfigKey::S3Endpoint).or_else(|| set(AmazonS3ConfigKey::Endpoint));
    if let Some(endpoint) = endpoint {
        let open = endpoint.to_lowercase().starts_with("http://");
        if open && !on(AmazonS3ConfigKey::Client(ClientConfigKey::AllowHttp)) {
            return Err(format!(
                "the endpoint {} is not encrypted; if that is meant, set AWS_ALLOW_HTTP=true",
                shown(&endpoint)
            ));
        }
    }
    let (id, secret) = (set(AmazonS3ConfigKey::AccessKeyId), set(AmazonS3ConfigKey::SecretAccessKey));
    if id.is_some() != secret.is_some() {
        let missing = if id.is_none() { "AWS_ACCESS_KEY_ID" } else { "AWS_SECRET_ACCESS_KEY" };
        return Err(format!("of the two halves of the credentials, {missing} is not set"));
    }
    let sources = [
        AmazonS3ConfigKey::AccessKeyId,
        AmazonS3ConfigKey::WebIdentityTokenFile,
        AmazonS3ConfigKey::ContainerCredentialsRelativeUri,
        AmazonS3ConfigKey::ContainerCredentialsFullUri,
    ];
    let known = sources.into_iter().any(|key| set(key).is_some()) || on(AmazonS3ConfigKey::SkipSignature);
    let elsewhere = set(AmazonS3ConfigKey::MetadataEndpoint).is_some();
    let store = builder.build().map_err(|e| e.to_string())?;
    if !known {
        // What is left is a machine in the cloud that may know who it is.
        let answers = elsewhere || TcpStream::connect_timeout(&METADATA, Duration::from_secs(1)).is_ok();
        let provider = store.credentials().clone();
        if !answers || wait(async move { provider.get_credential().await }).is_err() {
            return Err(NOBODY.into());
        }
    }
    Ok(Arc::new(store))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn problem(url: &str) -> String {
        connect(Path::new(url)).unwrap_err().to_string()
    }

    #[test]
    fn urls_are_told_from_paths() {
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
    fn what_a_url_must_not_hold_is_neither_used_nor_shown() {
        for url in
            ["s3://AKIA:hush@bucket/x", "https://me:hush@host/x", "https://host/x?X-Amz-Signature=hush"]
        {
            let said = problem(url);
            assert!(!said.contains("hush") && !said.contains("AKIA"), "{said}");
        }
        assert!(problem("gs://bucket/x").contains("s3://BUCKET/PREFIX"));
        assert!(problem("s3:///x").contains("s3://BUCKET"));
        assert!(problem("s3://bucket/a//b").contains("s3://bucket/a//b"));
        for url in [
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
            let said = check_url(url).map_or_else(|e| e.to_string(), |()| panic!("{url} is taken"));
            for secret in ["hu", "sh@", "AKIA"] {
                assert!(!said.contains(secret), "{url}: {said}");
            }
        }
    }

    #[test]
    fn words_that_are_no_urls_and_urls_without_secrets_are_fine() {
        for word in [
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
            assert!(check_url(word).is_ok(), "{word}: {}", check_url(word).unwrap_err());
        }
    }

    #[test]
    fn malformed_addresses_are_errors_and_no_panics() {
        for (url, expected) in [
            ("s3://my bucket/x", "bucket"),
            ("s3://bucket\n/x", "line breaks"),
            ("s3://bücket/x", "bucket"),
            ("http://ho st/x", "http://ho st/x"),
            ("http://host:port/x", "port"),
        ] {
            let said = problem(url);
            assert!(said.contains(expected) && !said.contains('\n'), "{url:?}: {said}");
            assert!(check_url(url).is_err(), "{url:?}");
        }
    }
}
