//! Progress bars, warnings, results and cancellation on a terminal.

use std::io::{self, IsTerminal, Write};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};

use indicatif::{ProgressBar, ProgressStyle};
use loden::progress::Progress;
use serde::Serialize;
use serde_json::json;
use signal_hook::consts::{SIGINT, SIGTERM};

/// Standard output for results, standard error for progress and warnings.
pub struct Terminal {
    json: bool,
    quiet: bool,
    force: bool,
    command: String,
    /// Whether standard output belongs to a file that the user wants there.
    stdout_given: AtomicBool,
    /// Whether the result has been printed.
    printed: AtomicBool,
    signals: Signals,
    bar: Mutex<Option<ProgressBar>>,
}

impl Terminal {
    pub fn new(json: bool, quiet: bool, force: bool) -> Self {
        let [stdout_given, printed] = [false, false].map(AtomicBool::new);
        let (command, signals, bar) = (command_line(), Signals::catch(), Mutex::new(None));
        Self { json, quiet, force, command, stdout_given, printed, signals, bar }
    }

    /// Whether existing outputs are replaced.
    pub fn force(&self) -> bool {
        self.force
    }

    /// From here on results go to standard error.
    pub fn give_stdout_away(&self) {
        self.stdout_given.store(true, Ordering::Relaxed);
    }

    /// Prints a result: as JSON if asked for, else `text`.
    pub fn result(&self, value: &impl Serialize, text: impl FnOnce() -> String) -> anyhow::Result<()> {
        let text = if self.json { serde_json::to_string_pretty(value)? } else { text() };
        self.printed.store(true, Ordering::Relaxed);
        let text = text.trim_end();
        let written = match self.stdout_given.load(Ordering::Relaxed) {
            true => writeln!(io::stderr(), "{text}"),
            false => writeln!(io::stdout(), "{text}"),
        };
        match written {
            // a reader such as `head` may close the pipe early
            Err(e) if e.kind() != io::ErrorKind::BrokenPipe => Err(e.into()),
            _ => Ok(()),
        }
    }

    /// Prints an error as a sentence, and as JSON in place of the result.
    pub fn error(&self, error: &anyhow::Error) {
        // the library's errors are complete; others are printed with their causes
        let known = error.downcast_ref::<loden::Error>();
        let message = match known {
            Some(error @ loden::Error::Exists { .. }) => format!("{error}; --force replaces it"),
            Some(error) => error.to_string(),
            None => format!("{error:#}"),
        };
        eprintln!("error: {message}");
        if self.json && !self.printed.load(Ordering::Relaxed) && !self.stdout_given.load(Ordering::Relaxed) {
            print_error(known.map_or("error", loden::Error::kind), &message, known.and_then(loden::Error::path));
        }
    }

    /// Ends the program as the signal that interrupted it does, so that a shell's loop ends too.
    pub fn die_of_signal(&self) {
        self.signals.raise();
    }

    fn with_bar(&self, act: impl FnOnce(&ProgressBar)) {
        if let Ok(bar) = self.bar.lock()
            && let Some(bar) = bar.as_ref()
        {
            act(bar);
        }
    }
}

impl Progress for Terminal {
    fn begin(&self, name: &str, total: u64) {
        if self.quiet || !std::io::stderr().is_terminal() {
            return;
        }
        let template = "{msg:>12} [{bar:40}] {pos}/{len}  {elapsed} elapsed, {eta} left";
        let style = ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
        let bar = ProgressBar::new(total).with_style(style.progress_chars("=> ")).with_message(name.to_owned());
        if let Ok(mut slot) = self.bar.lock() {
            *slot = Some(bar);
        }
    }

    fn advance(&self, steps: u64) {
        self.with_bar(|bar| bar.inc(steps));
    }

    fn step(&self, text: &str) {
        self.with_bar(|bar| bar.set_message(text.to_owned()));
    }

    fn end(&self) {
        self.with_bar(ProgressBar::finish_and_clear);
        if let Ok(mut slot) = self.bar.lock() {
            *slot = None;
        }
    }

    fn stage(&self, text: &str) {
        if !self.quiet {
            eprintln!("{text}");
        }
    }

    fn warn(&self, text: &str) {
        if !self.quiet {
            eprintln!("warning: {text}");
        }
    }

    fn is_cancelled(&self) -> bool {
        self.signals.any()
    }

    fn command(&self) -> Option<&str> {
        Some(&self.command)
    }
}

/// An error as JSON on standard output.
pub fn print_error(kind: &str, message: &str, file: Option<&std::path::Path>) {
    let value = json!({ "error": { "kind": kind, "message": message, "file": file } });
    let _ = writeln!(io::stdout(), "{value:#}");
}

/// The command line as a shell would read it.
fn command_line() -> String {
    let arguments = std::env::args_os().skip(1).map(|argument| quoted(&argument.to_string_lossy()));
    std::iter::once("loden".to_owned()).chain(arguments).collect::<Vec<_>>().join(" ")
}

/// An argument in quotes, where a shell needs them.
pub fn quoted(argument: &str) -> String {
    let plain = |c: char| c.is_alphanumeric() || "-_./:=,+%@".contains(c);
    if !argument.is_empty() && argument.chars().all(plain) {
        return argument.to_owned();
    }
    format!("'{}'", argument.replace('\'', "'\\''"))
}

/// Signals that ask the program to end: the first stops the work, which leaves nothing half-written; a second one
/// exits at once.
struct Signals([(i32, Arc<AtomicBool>); 2]);

impl Signals {
    fn catch() -> Self {
        let flag = |signal: i32| {
            let flag = Arc::new(AtomicBool::new(false));
            // without a handler the signal ends the program, which also leaves nothing half-written under a final name
            let _ = signal_hook::flag::register_conditional_shutdown(signal, 128 + signal, flag.clone());
            let _ = signal_hook::flag::register(signal, flag.clone());
            (signal, flag)
        };
        Self([flag(SIGINT), flag(SIGTERM)])
    }

    fn any(&self) -> bool {
        self.0.iter().any(|(_, flag)| flag.load(Ordering::Relaxed))
    }

    fn raise(&self) {
        if let Some((signal, _)) = self.0.iter().find(|(_, flag)| flag.load(Ordering::Relaxed)) {
            let _ = signal_hook::low_level::emulate_default_handler(*signal);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::quoted;

    #[test]
    fn arguments_are_quoted_where_a_shell_needs_it() {
        assert_eq!(quoted("a/b-c_1.png"), "a/b-c_1.png");
        assert_eq!(quoted("my wool.zip"), "'my wool.zip'");
        assert_eq!(quoted("it's"), "'it'\\''s'");
        assert_eq!(quoted(""), "''");
    }
}
