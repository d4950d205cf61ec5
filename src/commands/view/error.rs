//! Error response of a request.

use super::image_pyramid::Cancelled;
use anyhow::Error;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};

/// Status and message of a failed request.
#[derive(Debug)]
pub struct HttpError(pub StatusCode, pub String);

impl HttpError {
    /// Invalid request.
    pub fn bad_request(message: impl Into<String>) -> Self {
        Self(StatusCode::BAD_REQUEST, message.into())
    }

    /// Resource that does not exist.
    pub fn not_found(message: impl Into<String>) -> Self {
        Self(StatusCode::NOT_FOUND, message.into())
    }
}

impl From<Error> for HttpError {
    fn from(e: Error) -> Self {
        let status = match e.is::<Cancelled>() {
            true => StatusCode::SERVICE_UNAVAILABLE,
            false => StatusCode::INTERNAL_SERVER_ERROR,
        };
        Self(status, crate::failure::line(&e))
    }
}

impl IntoResponse for HttpError {
    fn into_response(self) -> Response {
        (self.0, [(header::CONTENT_TYPE, "text/plain; charset=utf-8")], self.1).into_response()
    }
}
