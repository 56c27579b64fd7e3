//! Progress and cancellation: the library reports, the program displays.

use std::sync::Mutex;

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
    /// The current task has come to a step; `text` is a short phrase such as `"trial 3"`.
    fn step(&self, text: &str) {
        let _ = text;
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
    /// A synthesis has come this far: `source(x, y)` is the column and row of the sample that a texel of the result copies, none
    /// where that is not known yet. The result is `width` x `height` texels, fewer while it is coarse. This is called often;
    /// receivers choose what they draw.
    fn unfinished(&self, width: usize, height: usize, source: &dyn Fn(usize, usize) -> Option<[u16; 2]>) {
        let _ = (width, height, source);
    }
    /// The command line that asked for the work, to be noted in pictures; none outside a command line.
    fn command(&self) -> Option<&str> {
        None
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

    /// Shows a synthesis that is not finished, see [`Progress::unfinished`].
    pub fn unfinished(&self, width: usize, height: usize, source: &dyn Fn(usize, usize) -> Option<[u16; 2]>) {
        self.0.unfinished(width, height, source);
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

/// Steps of the task of [`Shares`] for each of them.
const SHARE: u64 = 1000;

/// One task for several pieces of work, one after the other or at once: their own tasks are parts of it.
pub struct Shares<'a>(Task<'a>);

impl<'a> Shares<'a> {
    /// Begins a task of at most `most` pieces of work.
    pub fn new(to: &'a dyn Progress, name: &str, most: usize) -> Self {
        Self(Task::new(to, name, most as u64 * SHARE))
    }

    /// Begins a piece of work.
    pub fn share(&self) -> Share<'_> {
        Share { to: self.0.0, at: Mutex::default() }
    }
}

/// The progress of one piece of work, which is done when this is dropped; see [`Shares`].
pub struct Share<'a> {
    to: &'a dyn Progress,
    at: Mutex<At>,
}

/// How far a piece of work is.
#[derive(Default)]
struct At {
    /// Tasks that have ended.
    ended: i32,
    /// Steps of the running task, and those that are done.
    total: u64,
    done: u64,
    /// Steps that have been reported.
    reported: u64,
}

impl Share<'_> {
    /// Changes the place and reports the steps in between. How many tasks there will be is not known: each takes half of what
    /// is left.
    fn change(&self, change: impl FnOnce(&mut At)) {
        let Ok(mut at) = self.at.lock() else { return };
        change(&mut at);
        let left = 0.5f64.powi(at.ended);
        let share = at.done.min(at.total) as f64 / at.total.max(1) as f64;
        let place = ((1.0 - left * (1.0 - 0.5 * share)) * SHARE as f64) as u64;
        self.report(&mut at, place);
    }

    fn report(&self, at: &mut At, place: u64) {
        let steps = place.saturating_sub(at.reported);
        at.reported += steps;
        self.to.advance(steps);
    }
}

impl Progress for Share<'_> {
    fn begin(&self, _name: &str, total: u64) {
        self.change(|at| (at.total, at.done) = (total, 0));
    }

    fn advance(&self, steps: u64) {
        self.change(|at| at.done += steps);
    }

    fn end(&self) {
        self.change(|at| (at.ended, at.total, at.done) = (at.ended + 1, 0, 0));
    }

    fn step(&self, text: &str) {
        self.to.step(text);
    }

    fn warn(&self, text: &str) {
        self.to.warn(text);
    }

    fn command(&self) -> Option<&str> {
        self.to.command()
    }

    fn is_cancelled(&self) -> bool {
        self.to.is_cancelled()
    }
}

impl Drop for Share<'_> {
    fn drop(&mut self) {
        if let Ok(mut at) = self.at.lock() {
            self.report(&mut at, SHARE);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Writes down what it is told.
    #[derive(Default)]
    struct Log(Mutex<(Vec<String>, u64)>);

    impl Progress for Log {
        fn begin(&self, name: &str, total: u64) {
            self.0.lock().unwrap().0.push(format!("begin {name} {total}"));
        }
        fn advance(&self, steps: u64) {
            self.0.lock().unwrap().1 += steps;
        }
        fn step(&self, text: &str) {
            let mut log = self.0.lock().unwrap();
            let line = format!("{text} at {}", log.1);
            log.0.push(line);
        }
        fn end(&self) {
            self.0.lock().unwrap().0.push("end".into());
        }
    }

    #[test]
    fn several_pieces_of_work_are_one_task() {
        let log = Log::default();
        let shares = Shares::new(&log, "search", 4);
        let work = |share: &Share, steps: u64| {
            let task = Task::new(share, "encode", 10);
            (0..steps).for_each(|_| task.advance(1).unwrap());
        };
        for trial in 0..3 {
            let share = shares.share();
            share.step(&format!("trial {trial}"));
            work(&share, 10);
            work(&share, 10);
        }
        let (one, other) = (shares.share(), shares.share());
        work(&one, 5);
        work(&other, 10);
        // a half, since a task that ends was the whole
        one.step("both");
        drop((one, other));
        drop(shares);
        let (lines, steps) = log.0.into_inner().unwrap();
        assert_eq!(
            lines,
            ["begin search 4000", "trial 0 at 0", "trial 1 at 1000", "trial 2 at 2000", "both at 4000", "end"]
        );
        assert_eq!(steps, 5000);
    }
}
