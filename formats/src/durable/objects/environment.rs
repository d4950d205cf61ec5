//! Checks of what the environment and a URL state about a store, before a client is made of it: the client's library panics on some
//! malformed values, and prints others. No message holds a value that may be secret.

use object_store::aws::AmazonS3ConfigKey as Key;
use reqwest::Url;

use super::connect::shown;

/// Checks the variables of the environment from which a client is made.
pub(super) fn check() -> Result<(), String> {
    for (name, value) in std::env::vars_os() {
        let Some(name) = name.to_str().filter(|n| n.starts_with("AWS_")) else { continue };
        let Ok(key) = name.to_ascii_lowercase().parse::<Key>() else { continue };
        let value = value.to_str().ok_or_else(|| format!("{name} is not UTF-8"))?;
        check_value(&key, value).map_err(|problem| format!("{name} {problem}"))?;
    }
    Ok(())
}

/// What is wrong with the value of one variable.
fn check_value(key: &Key, value: &str) -> Result<(), String> {
    if value.contains(char::is_control) {
        return Err(
            "holds a line break or another control character (was it read from a file with one at its end?)"
                .into(),
        );
    }
    let word = || match value.chars().all(|c| c.is_ascii_graphic()) {
        true => Ok(()),
        false => Err("holds a space or a character that is not ASCII".to_owned()),
    };
    match key {
        Key::AccessKeyId | Key::SecretAccessKey | Key::Token => word(),
        Key::Region | Key::DefaultRegion => {
            let region = !value.is_empty() && value.chars().all(|c| c.is_ascii_alphanumeric() || c == '-');
            if region { Ok(()) } else { Err(format!("is {value:?}, expected a region such as us-east-1")) }
        }
        Key::Endpoint | Key::S3Endpoint | Key::StsEndpoint | Key::MetadataEndpoint => {
            let expected = "expected http://HOST:PORT or https://HOST";
            if value.is_empty() {
                return Err(format!("is empty, {expected}, or unset it"));
            }
            match Url::parse(value) {
                Ok(url) if !url.username().is_empty() || url.password().is_some() => {
                    Err("holds credentials, which are shown and kept; set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY".into())
                }
                Ok(url) if url.query().is_some() || url.fragment().is_some() => {
                    Err(format!("holds a query or a fragment, {expected}"))
                }
                Ok(url) if matches!(url.scheme(), "http" | "https") && url.has_host() => word(),
                Ok(_) => Err(format!("is {}, {expected}", shown(value))),
                Err(e) => Err(format!("is no URL ({e}), {expected}")),
            }
        }
        _ => Ok(()),
    }
}

/// Names of buckets: letters, digits, `.`, `-`, `_` (Amazon S3 User Guide, "General purpose bucket naming rules", old ones included).
pub(super) fn check_bucket(name: &str) -> Result<(), String> {
    let known = |c: char| c.is_ascii_alphanumeric() || ".-_".contains(c);
    match name.len() <= 255 && name.chars().all(known) {
        true => Ok(()),
        false => Err("the bucket's name holds a character other than letters, digits, `.`, `-` and `_`, or is too long".into()),
    }
}

/// Addresses of web servers, host and port included.
pub(super) fn check_web(url: &str) -> Result<(), String> {
    Url::parse(url).map(drop).map_err(|e| format!("{e}, expected https://HOST/PATH"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn malformed_values_are_named_and_secret_ones_not_shown() {
        let problem = |key: &Key, value: &str| check_value(key, value).unwrap_err();
        for key in [Key::AccessKeyId, Key::SecretAccessKey, Key::Token, Key::Region] {
            for value in ["hush\n", "hu sh", "h\u{e9}sh", "\0hush"] {
                let said = problem(&key, value);
                let secret = key != Key::Region;
                assert!(!said.contains('\n'), "{key:?} {value:?}: {said}");
                assert!(!secret || !said.contains("sh,"), "{key:?} {value:?}: {said}");
                assert!(
                    !(secret && (said.contains("hush") || said.contains("hu sh"))),
                    "{key:?} {value:?}: {said}"
                );
            }
        }
        for value in [
            "",
            "127.0.0.1:9000",
            "localhost:9000",
            "minio",
            "ftp://host",
            "http://",
            "http://ho st",
            "//host",
        ] {
            let said = problem(&Key::Endpoint, value);
            assert!(said.contains("expected http://HOST:PORT"), "{value:?}: {said}");
        }
        for value in [
            "http://me:hush@host",
            "https://hush@host",
            "https://host/?X-Amz-Signature=hush",
            "me:hush@host:9000",
        ] {
            let said = problem(&Key::Endpoint, value);
            assert!(!said.contains("hush"), "{value}: {said}");
        }
        for (key, value) in [
            (Key::Endpoint, "http://127.0.0.1:9000"),
            (Key::Endpoint, "https://s3.example.org/prefix"),
            (Key::Region, "eu-central-1"),
            (Key::SecretAccessKey, "a/+=b"),
            (Key::Token, ""),
            (Key::RoleArn, "arn:aws:iam::1:role/x"),
        ] {
            assert_eq!(check_value(&key, value), Ok(()), "{key:?} {value}");
        }
    }
}
