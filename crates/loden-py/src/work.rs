//! Long work: without the interpreter's lock, on threads of its own, with progress and Ctrl-C.

use std::panic::resume_unwind;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use loden::progress::Progress;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;

use crate::errors::raise;

/// How often progress is shown and Ctrl-C is noticed.
const TICK: Duration = Duration::from_millis(50);

/// What a caller says about how to work.
#[derive(Default)]
pub(crate) struct How {
    /// Called as `progress(name, done, total)`.
    pub progress: Option<Py<PyAny>>,
    /// Number of threads; by default all that the process may use.
    pub threads: Option<usize>,
}

impl How {
    pub(crate) fn threads(threads: Option<usize>) -> Self {
        Self { progress: None, threads }
    }
}

/// Collects what the library reports, for the thread that holds the interpreter's lock.
#[derive(Default)]
struct Reporter {
    cancelled: AtomicBool,
    state: Mutex<State>,
}

#[derive(Default, Clone, PartialEq)]
struct State {
    name: String,
    done: u64,
    total: u64,
    warnings: Vec<String>,
}

impl Reporter {
    fn change(&self, change: impl FnOnce(&mut State)) {
        if let Ok(mut state) = self.state.lock() {
            change(&mut state);
        }
    }

    /// The state, without the warnings of the one before.
    fn take(&self) -> State {
        let mut found = State::default();
        self.change(|state| {
            found = state.clone();
            state.warnings.clear();
        });
        found
    }
}

impl Progress for Reporter {
    fn begin(&self, name: &str, total: u64) {
        self.change(|state| (state.name, state.done, state.total) = (name.to_owned(), 0, total));
    }

    fn advance(&self, steps: u64) {
        self.change(|state| state.done += steps);
    }

    fn warn(&self, text: &str) {
        self.change(|state| state.warnings.push(text.to_owned()));
    }

    fn is_cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Relaxed)
    }
}

/// Runs `work` on a pool of its own threads. No pool outlives a call, so that a process may fork between calls. Warnings
/// become Python warnings; an exception of the progress function, or Ctrl-C, cancels the work and is raised.
pub(crate) fn run<T: Send>(
    py: Python<'_>,
    how: &How,
    work: impl FnOnce(&dyn Progress) -> loden::Result<T> + Send,
) -> PyResult<T> {
    let threads = how.threads.unwrap_or(0);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    let pool = pool.map_err(|error| PyRuntimeError::new_err(format!("no threads: {error}")))?;
    let reporter = Reporter::default();
    let (result, interrupted) = std::thread::scope(|scope| {
        let (reporter, pool) = (&reporter, &pool);
        let worker = scope.spawn(move || pool.install(|| work(reporter)));
        let (mut shown, mut interrupted) = (State::default(), None);
        while !worker.is_finished() {
            py.detach(|| wait(&worker));
            let outcome = py.check_signals().and_then(|()| show(py, how, reporter, &mut shown));
            if let Err(error) = outcome {
                reporter.cancelled.store(true, Ordering::Relaxed);
                interrupted.get_or_insert(error);
            }
        }
        let result = py.detach(|| worker.join());
        if interrupted.is_none() {
            interrupted = show(py, how, reporter, &mut shown).err();
        }
        (result, interrupted)
    });
    match (result, interrupted) {
        (_, Some(error)) => Err(error),
        // PyO3 raises it as PanicException
        (Err(panic), None) => resume_unwind(panic),
        (Ok(Err(error)), None) => Err(raise(py, &error)),
        (Ok(Ok(value)), None) => Ok(value),
    }
}

/// Waits for a tick, or less if the work ends.
fn wait<T>(worker: &std::thread::ScopedJoinHandle<'_, T>) {
    const STEP: Duration = Duration::from_micros(200);
    let mut waited = Duration::ZERO;
    while waited < TICK && !worker.is_finished() {
        // short work must not wait long
        let pause = STEP.max(waited / 8);
        std::thread::sleep(pause);
        waited += pause;
    }
}

/// Calls the progress function, and raises warnings.
fn show(py: Python<'_>, how: &How, reporter: &Reporter, shown: &mut State) -> PyResult<()> {
    let state = reporter.take();
    for warning in &state.warnings {
        py.import("warnings")?.call_method1("warn", (warning,))?;
    }
    if let Some(progress) = &how.progress
        && (&state.name, state.done, state.total) != (&shown.name, shown.done, shown.total)
    {
        progress.call1(py, (&state.name, state.done, state.total))?;
    }
    *shown = state;
    Ok(())
}
