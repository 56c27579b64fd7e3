//! Command lines.

use std::path::Path;

use loden::params::{Given, Kind, Param};

/// A command line of `loden` as a shell reads it.
pub(super) struct Words(String);

impl Words {
    /// `loden` and the words of a command.
    pub fn new(command: &str) -> Self {
        Self(format!("loden {command}"))
    }

    /// A word of its own.
    pub fn word(mut self, word: impl ToString) -> Self {
        self.0 += &format!(" {}", quoted(&word.to_string()));
        self
    }

    /// A file.
    pub fn path(self, path: &Path) -> Self {
        self.word(path.display())
    }

    /// A flag with its value.
    pub fn flag(self, name: &str, value: impl ToString) -> Self {
        Self(format!("{} --{name}", self.0)).word(value)
    }

    /// A flag with a file.
    pub fn file(self, name: &str, path: &Path) -> Self {
        self.flag(name, path.display())
    }

    /// A flag without a value, if it is on.
    pub fn switch(self, name: &str, on: bool) -> Self {
        if on { Self(format!("{} --{name}", self.0)) } else { self }
    }

    /// Parameters as flags.
    pub fn params(self, given: &Given, table: &[Param]) -> Self {
        let is_switch = |name: &str| table.iter().any(|param| param.name == name && param.kind == Kind::Switch);
        given.iter().fold(self, |words, (name, text)| match is_switch(name) {
            true => words.switch(name, text == "yes"),
            false => words.flag(name, text),
        })
    }

    /// With the output.
    pub fn output(self, path: &Path) -> String {
        Self(format!("{} -o", self.0)).path(path).0
    }
}

/// A word in quotes, where a shell needs them.
fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_alphanumeric() || "-_./:=,+%@".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        return word.to_owned();
    }
    format!("'{}'", word.replace('\'', "'\\''"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shell_reads_what_was_meant() {
        let words = Words::new("compress").path(Path::new("my wool.zip")).flag("quality", 60).switch("tileable", false);
        assert_eq!(
            words.output(Path::new("it's.loden")),
            r"loden compress 'my wool.zip' --quality 60 -o 'it'\''s.loden'"
        );
    }
}
