//! Errors during an evaluation.

use std::sync::OnceLock;

use crate::{Error, Result};

/// Keeps the first error of a material whose functions return plain values: [`super::Material::check`].
#[derive(Debug, Default)]
pub struct Failure(OnceLock<Error>);

impl Failure {
    /// Keeps the error, unless an earlier one is kept.
    pub fn keep(&self, error: Error) {
        let _ = self.0.set(error);
    }

    /// The value of a result; `None` for an error, which is kept.
    pub fn ok<T>(&self, result: Result<T>) -> Option<T> {
        result.map_err(|error| self.keep(error)).ok()
    }

    /// Fails if an error was kept.
    ///
    /// # Errors
    /// The first error that was kept.
    pub fn check(&self) -> Result<()> {
        self.0.get().map_or(Ok(()), |error| Err(error.clone()))
    }
}
