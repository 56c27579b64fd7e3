//! Progress and cancellation: the library reports, the program displays.

use crate::{Error, Result};

/// Receives the progress of long operations and can ask them to stop. All methods may be called from any thread.
pub trait Progress: Sync {
    /// A task of `total` steps begins; `name` is a short phrase such as `"compress"`.
    fn begin(&self, name: &str, total: u64) {
        let _ = (name, total);
    }
    /// `steps` more steps of the current task are done.
    fn advance(&self, steps: u64) {
        let _ = steps;
    }
    /// The current task has ended.
    fn end(&self) {}
    /// The next stage of a job with several begins; `text` says which, in a few words.
    fn stage(&self, text: &str) {
        let _ = text;
    }
    /// Something was assumed or repaired; `text` is a sentence for the user.
    fn warn(&self, text: &str) {
        let _ = text;
    }
    /// Whether the operation should stop as soon as possible with [`Error::Cancelled`].
    fn is_cancelled(&self) -> bool {
        false
    }
}

/// Ignores progress and never cancels.
pub struct Silent;

impl Progress for Silent {}

/// A running task: begins when created, ends when dropped.
pub struct Task<'a>(&'a dyn Progress);

impl<'a> Task<'a> {
    /// Begins a task of `total` steps.
    pub fn new(progress: &'a dyn Progress, name: &str, total: u64) -> Self {
        progress.begin(name, total);
        Self(progress)
    }

    /// Reports `steps` steps as done.
    ///
    /// # Errors
    /// [`Error::Cancelled`] if the receiver asked to stop.
    pub fn advance(&self, steps: u64) -> Result<()> {
        self.0.advance(steps);
        self.check()
    }

    /// Stops if the receiver asked to; reports no step.
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
