//! Validation of the AWS_* environment variables before a client is created: the client's library panics on some malformed values and
//! prints others. No message contains a value that may be secret.

use object_store::aws::AmazonS3ConfigKey as Key;
use reqwest::Url;

use super::super::url::redacted;

/// Validates the environment variables that configure a client.
pub(super) fn check() -> Result<(), String> {
    for (name, value) in std::env::vars_os() {
        let Some(name) = name.to_str().filter(|n| n.starts_with("AWS_")) else { continue };
        let Ok(key) = name.to_ascii_lowercase().parse::<Key>() else { continue };
        let value = value.to_str().ok_or_else(|| format!("{name} is not UTF-8"))?;
        check_value(&key, value).map_err(|problem| format!("{name} {problem}"))?;
    }
    Ok(())
}

/// Validates one variable; the error continues a sentence that begins with its name.
fn check_value(key: &Key, value: &str) -> Result<(), String> {
    if value.contains(char::is_control) {
        return Err(
            "contains a line break or another control character (was it read from a file with one at its end?)"
                .into(),
        );
    }
    let check_graphic = || match value.chars().all(|c| c.is_ascii_graphic()) {
        true => Ok(()),
        false => Err("contains a space or a character that is not ASCII".to_owned()),
    };
    match key {
        Key::AccessKeyId | Key::SecretAccessKey | Key::Token => check_graphic(),
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
                    Err("contains credentials, which would be printed; set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY".into())
                }
                Ok(url) if url.query().is_some() || url.fragment().is_some() => {
                    Err(format!("contains a query or a fragment, {expected}"))
                }
                Ok(url) if matches!(url.scheme(), "http" | "https") && url.has_host() => check_graphic(),
                Ok(_) => Err(format!("is {}, {expected}", redacted(value))),
                Err(e) => Err(format!("is not a URL ({e}), {expected}")),
            }
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn malformed_values_are_errors_without_secrets() {
        let problem = |key: &Key, value: &str| check_value(key, value).unwrap_err();
        for key in [Key::AccessKeyId, Key::SecretAccessKey, Key::Token, Key::Region] {
            for value in ["hush\n", "hu sh", "h\u{e9}sh", "\0hush"] {
                let message = problem(&key, value);
                let secret = key != Key::Region;
                assert!(!message.contains('\n'), "{key:?} {value:?}: {message}");
                assert!(!secret || !message.contains("sh,"), "{key:?} {value:?}: {message}");
                assert!(
                    !(secret && (message.contains("hush") || message.contains("hu sh"))),
                    "{key:?} {value:?}: {message}"
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
            let message = problem(&Key::Endpoint, value);
            assert!(message.contains("expected http://HOST:PORT"), "{value:?}: {message}");
        }
        for value in [
            "http://me:hush@host",
            "https://hush@host",
            "https://host/?X-Amz-Signature=hush",
            "me:hush@host:9000",
        ] {
            let message = problem(&Key::Endpoint, value);
            assert!(!message.contains("hush"), "{value}: {message}");
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
