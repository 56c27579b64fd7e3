//! The library's errors as Python exceptions.

use std::io::ErrorKind;

use loden::Error;
use pyo3::prelude::*;

/// The class of `loden.errors` for an error of the library.
fn class(error: &Error) -> &'static str {
    match error {
        Error::Io { source, .. } if source.kind() == ErrorKind::NotFound => "MissingFileError",
        Error::Io { .. } => "FileError",
        Error::Exists { .. } => "OutputExistsError",
        Error::Invalid { .. } => "InvalidFileError",
        Error::Unsupported { .. } => "UnsupportedError",
        Error::Limit { .. } => "LimitError",
        Error::Parameter { .. } => "ParameterError",
        Error::NonFinite { .. } => "NotFiniteError",
        Error::NotConverged { .. } => "NotConvergedError",
        Error::Cancelled => "CancelledError",
        // new kinds are errors, too
        _ => "Error",
    }
}

/// The field of a file, or the parameter, that an error is about.
fn field(error: &Error) -> Option<&str> {
    match error {
        Error::Invalid { field, .. } | Error::Limit { field, .. } => Some(field),
        Error::Parameter { name, .. } => Some(name),
        _ => None,
    }
}

/// An exception of `loden.errors` with the attributes `path` and `field`.
pub(crate) fn raise(py: Python<'_>, error: &Error) -> PyErr {
    let path = error.path().map(|path| path.to_string_lossy().into_owned());
    let make = || {
        let class = py.import("loden.errors")?.getattr(class(error))?;
        class.call1((error.to_string(), path, field(error)))
    };
    match make() {
        Ok(exception) => PyErr::from_value(exception),
        Err(other) => other,
    }
}

/// A wrong argument of the call itself.
pub(crate) fn wrong(py: Python<'_>, name: &str, problem: impl Into<String>) -> PyErr {
    raise(py, &Error::parameter(name, problem))
}
