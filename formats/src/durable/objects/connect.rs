//! Client of a store, from its address and the environment. Credentials come from the environment only and stay inside the client.

use std::collections::HashMap;
use std::net::{SocketAddr, TcpStream};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use object_store::aws::{AmazonS3Builder, AmazonS3ConfigKey};
use object_store::http::HttpBuilder;
use object_store::{BackoffConfig, ClientConfigKey, ClientOptions, ObjectStore, RetryConfig};

use super::super::url::{Address, redacted};
use super::environment;
use super::request::{block_on, within_runtime};

/// Attempts of a request unless AWS_MAX_ATTEMPTS sets another number.
const ATTEMPTS: usize = 10;
/// Time after which a request is not repeated: less than the five minutes for which a signature is valid.
const RETRY_TIMEOUT: Duration = Duration::from_secs(180);
/// Maximum pause between two attempts.
const MAX_PAUSE: Duration = Duration::from_secs(10);
/// Timeout of one request, transfer of a shard included.
const REQUEST_TIMEOUT: &str = "60 seconds";
/// Instance metadata service of cloud machines.
const INSTANCE_METADATA: SocketAddr =
    SocketAddr::new(std::net::IpAddr::V4(std::net::Ipv4Addr::new(169, 254, 169, 254)), 80);

const NO_CREDENTIALS: &str = "no credentials: set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY (files under ~/.aws are not read; `aws \
                              configure export-credentials --format env` prints them), or AWS_SKIP_SIGNATURE=true for a public bucket";

/// The client for an address; one client for each host, which keeps connections and credentials.
pub(super) fn client(address: &Address<'_>) -> Result<Arc<dyn ObjectStore>, String> {
    static CLIENTS: Mutex<Option<HashMap<String, Arc<dyn ObjectStore>>>> = Mutex::new(None);
    let mut clients = CLIENTS.lock().unwrap_or_else(PoisonError::into_inner);
    let clients = clients.get_or_insert_default();
    let name = format!("{}://{}", address.scheme, address.host);
    let client = match clients.get(&name) {
        Some(client) => client.clone(),
        None => within_runtime(|| new_client(address))?,
    };
    clients.insert(name, client.clone());
    Ok(client)
}

fn new_client(address: &Address<'_>) -> Result<Arc<dyn ObjectStore>, String> {
    match address.scheme {
        "s3" => s3(address.host),
        "http" | "https" => {
            let options = ClientOptions::new().with_allow_http(true);
            let options = options.with_config(ClientConfigKey::Timeout, REQUEST_TIMEOUT);
            let url = format!("{}://{}", address.scheme, address.host);
            let builder = HttpBuilder::new().with_url(url).with_client_options(options).with_retry(retry()?);
            Ok(Arc::new(builder.build().map_err(|e| e.to_string())?))
        }
        #[cfg(test)]
        "memory" => Ok(Arc::new(object_store::memory::InMemory::new())),
        other => {
            Err(format!("{other}:// is not supported; expected s3://BUCKET/PREFIX, or http(s)://… to read"))
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
    let backoff = BackoffConfig { max_backoff: MAX_PAUSE, ..BackoffConfig::default() };
    Ok(RetryConfig { backoff, max_retries: attempts - 1, retry_timeout: RETRY_TIMEOUT })
}

fn s3(bucket: &str) -> Result<Arc<dyn ObjectStore>, String> {
    environment::check()?;
    let mut builder = AmazonS3Builder::from_env().with_bucket_name(bucket).with_retry(retry()?);
    if std::env::var_os("AWS_TIMEOUT").is_none() {
        builder = builder.with_config(AmazonS3ConfigKey::Client(ClientConfigKey::Timeout), REQUEST_TIMEOUT);
    }
    let set = |key: AmazonS3ConfigKey| builder.get_config_value(&key);
    let on =
        |key| set(key).is_some_and(|v| ["1", "true", "on", "yes", "y"].contains(&v.to_lowercase().as_str()));
    let endpoint = set(AmazonS3ConfigKey::S3Endpoint).or_else(|| set(AmazonS3ConfigKey::Endpoint));
    if let Some(endpoint) = endpoint {
        let unencrypted = endpoint.to_lowercase().starts_with("http://");
        if unencrypted && !on(AmazonS3ConfigKey::Client(ClientConfigKey::AllowHttp)) {
            return Err(format!(
                "the endpoint {} is not encrypted; to allow that, set AWS_ALLOW_HTTP=true",
                redacted(&endpoint)
            ));
        }
    }
    let (id, secret) = (set(AmazonS3ConfigKey::AccessKeyId), set(AmazonS3ConfigKey::SecretAccessKey));
    if id.is_some() != secret.is_some() {
        let missing = if id.is_none() { "AWS_ACCESS_KEY_ID" } else { "AWS_SECRET_ACCESS_KEY" };
        return Err(format!("incomplete credentials: {missing} is not set"));
    }
    let sources = [
        AmazonS3ConfigKey::AccessKeyId,
        AmazonS3ConfigKey::WebIdentityTokenFile,
        AmazonS3ConfigKey::ContainerCredentialsRelativeUri,
        AmazonS3ConfigKey::ContainerCredentialsFullUri,
    ];
    let known = sources.into_iter().any(|key| set(key).is_some()) || on(AmazonS3ConfigKey::SkipSignature);
    let metadata_endpoint = set(AmazonS3ConfigKey::MetadataEndpoint).is_some();
    let store = builder.build().map_err(|e| e.to_string())?;
    if !known {
        // The remaining source is the instance metadata service.
        let reachable = metadata_endpoint
            || TcpStream::connect_timeout(&INSTANCE_METADATA, Duration::from_secs(1)).is_ok();
        let provider = store.credentials().clone();
        if !reachable || block_on(async move { provider.get_credential().await }).is_err() {
            return Err(NO_CREDENTIALS.into());
        }
    }
    Ok(Arc::new(store))
}
