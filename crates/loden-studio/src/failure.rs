//! Errors as answers.

use axum::Json;
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use loden::Error;
use serde_json::json;

/// An answer that says what went wrong: `{"error": {"kind", "message"}}`.
#[derive(Debug)]
pub(crate) struct Failure {
    status: StatusCode,
    kind: &'static str,
    message: String,
}

pub(crate) type Answer<T> = std::result::Result<T, Failure>;

impl Failure {
    pub fn new(status: StatusCode, message: impl Into<String>) -> Self {
        Self { status, kind: "request", message: message.into() }
    }

    /// What it says.
    pub fn message(&self) -> &str {
        &self.message
    }

    pub fn missing(what: &str) -> Self {
        Self::new(StatusCode::NOT_FOUND, format!("there is no {what}"))
    }

    pub fn refused(why: &str) -> Self {
        Self::new(StatusCode::FORBIDDEN, why)
    }
}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        let status = match &error {
            Error::Parameter { .. } => StatusCode::BAD_REQUEST,
            Error::Io { source, .. } if source.kind() == std::io::ErrorKind::NotFound => StatusCode::NOT_FOUND,
            Error::Exists { .. } => StatusCode::CONFLICT,
            _ => StatusCode::UNPROCESSABLE_ENTITY,
        };
        Self { status, kind: error.kind(), message: error.to_string() }
    }
}

impl IntoResponse for Failure {
    fn into_response(self) -> Response {
        let body = json!({ "error": { "kind": self.kind, "message": self.message } });
        (self.status, Json(body)).into_response()
    }
}

/// Runs work that blocks on a thread of its own. A panic becomes an answer.
pub(crate) async fn blocking<T: Send + 'static>(work: impl FnOnce() -> Answer<T> + Send + 'static) -> Answer<T> {
    let broken = |_| Failure::new(StatusCode::INTERNAL_SERVER_ERROR, "the program failed; see its output for details");
    tokio::task::spawn_blocking(work).await.map_err(broken)?
}
