//! Progress and cancellation: the library reports, a program shows.

use crate::{Error, Result};

/// Receives the progress of long work and can ask it to stop. All methods may be called from any thread.
pub trait Progress: Sync {
    /// A task of `total` steps begins; `name` is a short phrase such as `"compress"`.
    fn begin(&self, name: &str, total: u64) {
        let _ = (name, total);
    }
    /// `steps` further steps of the current task are done.
    fn advance(&self, steps: u64) {
        let _ = steps;
    }
    /// The current task is over.
    fn end(&self) {}
    /// Whether the work shall stop as soon as possible with [`Error::Cancelled`].
    fn is_cancelled(&self) -> bool {
        false
    }
}

/// Reports nothing and never cancels.
pub struct Silent;

impl Progress for Silent {}

/// One running task: begins on creation, ends when dropped.
pub struct Task<'a>(&'a dyn Progress);

impl<'a> Task<'a> {
    /// Begins a task of `total` steps.
    pub fn new(progress: &'a dyn Progress, name: &str, total: u64) -> Self {
        progress.begin(name, total);
        Self(progress)
    }

    /// Counts `steps` as done.
    ///
    /// # Errors
    /// [`Error::Cancelled`] if the receiver asked to stop.
    pub fn advance(&self, steps: u64) -> Result<()> {
        self.0.advance(steps);
        self.check()
    }

    /// Counts nothing, but stops if the receiver asked to.
    ///
    /// # Errors
    /// [`Error::Cancelled`] if the receiver asked to stop.
    pub fn check(&self) -> Result<()> {
        if self.0.is_cancelled() { Err(Error::Cancelled) } else { Ok(()) }
    }
}

impl Drop for Task<'_> {
    fn drop(&mut self) {
        self.0.end();
    }
}
