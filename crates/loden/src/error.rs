//! The one error type, sorted by who is at fault.

use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A result whose error is [`Error`].
pub type Result<T> = std::result::Result<T, Error>;

/// What can go wrong, sorted by cause: the machine, the file, this program's limits, the caller, or the data.
#[derive(Debug, Clone, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The operating system reported an error (missing file, no permission, full disk).
    #[error("{}: {}", path.display(), plain(source))]
    Io {
        /// The file or folder concerned.
        path: PathBuf,
        /// The system's error.
        source: Arc<std::io::Error>,
    },
    /// An output is there already, and may not be replaced.
    #[error("{} exists already", path.display())]
    Exists {
        /// The file, or the folder with content.
        path: PathBuf,
    },
    /// A file's content contradicts its format.
    #[error("{}: {field}: {problem}", path.display())]
    Invalid {
        /// The file concerned.
        path: PathBuf,
        /// The field, entry or tensor inside the file.
        field: String,
        /// What was found and what was expected.
        problem: String,
    },
    /// The file is of a kind, or uses a feature, that is not supported.
    #[error("{}: {what}", path.display())]
    Unsupported {
        /// The file concerned.
        path: PathBuf,
        /// What is not supported, and what is.
        what: String,
    },
    /// The file asks for more than the limits allow.
    #[error("{}: {field} is {found}, more than the limit of {limit}", path.display())]
    Limit {
        /// The file concerned.
        path: PathBuf,
        /// The field that is too large.
        field: String,
        /// Its value.
        found: u64,
        /// The largest value allowed.
        limit: u64,
    },
    /// The caller's parameter is out of range or contradicts another.
    #[error("{name}: {problem}")]
    Parameter {
        /// The parameter's name, as users write it.
        name: String,
        /// What was found and what was expected.
        problem: String,
    },
    /// The data hold a number that is not finite.
    #[error("{data} holds numbers that are not finite")]
    NonFinite {
        /// Which data, and where in it.
        data: String,
    },
    /// An iterative computation did not converge.
    #[error("{computation} did not converge")]
    NotConverged {
        /// Which computation.
        computation: String,
    },
    /// The caller asked to stop through [`crate::progress::Progress::is_cancelled`].
    #[error("cancelled")]
    Cancelled,
}

impl Error {
    /// Its kind as a word for programs.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Io { .. } => "io",
            Self::Exists { .. } => "exists",
            Self::Invalid { .. } => "invalid",
            Self::Unsupported { .. } => "unsupported",
            Self::Limit { .. } => "limit",
            Self::Parameter { .. } => "usage",
            Self::NonFinite { .. } => "not-finite",
            Self::NotConverged { .. } => "not-converged",
            Self::Cancelled => "cancelled",
        }
    }

    /// The file or folder concerned, if there is one.
    pub fn path(&self) -> Option<&Path> {
        match self {
            Self::Io { path, .. }
            | Self::Exists { path }
            | Self::Invalid { path, .. }
            | Self::Unsupported { path, .. }
            | Self::Limit { path, .. } => Some(path),
            _ => None,
        }
    }

    /// An [`Error::Invalid`] about `field` of the file `path`.
    pub fn invalid(path: impl AsRef<Path>, field: impl Into<String>, problem: impl Into<String>) -> Self {
        Self::Invalid { path: path.as_ref().into(), field: field.into(), problem: problem.into() }
    }

    /// An [`Error::Unsupported`] about the file `path`.
    pub fn unsupported(path: impl AsRef<Path>, what: impl Into<String>) -> Self {
        Self::Unsupported { path: path.as_ref().into(), what: what.into() }
    }

    /// An [`Error::Parameter`] about the parameter `name`.
    pub fn parameter(name: impl Into<String>, problem: impl Into<String>) -> Self {
        Self::Parameter { name: name.into(), problem: problem.into() }
    }

    /// An [`Error::NonFinite`] about `data`, such as "the BRDF" or "view 3".
    pub fn non_finite(data: impl Into<String>) -> Self {
        Self::NonFinite { data: data.into() }
    }

    /// An [`Error::NotConverged`] about `computation`, such as "the eigendecomposition".
    pub fn not_converged(computation: impl Into<String>) -> Self {
        Self::NotConverged { computation: computation.into() }
    }

    /// A closure for `map_err` that attaches `path` to an [`std::io::Error`].
    pub fn io(path: impl AsRef<Path>) -> impl FnOnce(std::io::Error) -> Self {
        move |source| Self::Io { path: path.as_ref().into(), source: Arc::new(source) }
    }
}

/// The words of the operating system without its number.
pub(crate) fn plain(error: &std::io::Error) -> String {
    let text = error.to_string();
    match (error.raw_os_error(), text.rfind(" (os error ")) {
        (Some(_), Some(end)) => text[..end].to_owned(),
        _ => text,
    }
}

#[cfg(test)]
mod tests {
    use std::error::Error as _;

    use super::*;

    #[test]
    fn an_error_of_the_system_keeps_its_cause() {
        let error = Error::io("x.btf")(std::io::ErrorKind::PermissionDenied.into());
        assert_eq!(error.to_string(), "x.btf: permission denied");
        assert_eq!(error.source().unwrap().to_string(), "permission denied");
        assert!(Error::parameter("index", "found 0").source().is_none());
    }

    #[test]
    fn data_and_computations_are_named() {
        assert_eq!(Error::non_finite("view 3").to_string(), "view 3 holds numbers that are not finite");
        assert_eq!(Error::not_converged("the fit").to_string(), "the fit did not converge");
    }
}
