//! Warnings about requests: each kind once, with the line of its first occurrence and a count.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// The warnings of a scene.
#[derive(Default)]
pub(super) struct Notes {
    /// Files in the order in which they were first mentioned.
    files: Vec<PathBuf>,
    kinds: HashMap<String, usize>,
    notes: Vec<Note>,
}

struct Note {
    file: usize,
    line: usize,
    text: String,
    count: usize,
}

impl Notes {
    /// Notes an occurrence of a kind of warning; `text` is kept of the first one.
    pub(super) fn add(&mut self, kind: String, text: String, line: usize, path: &Path) {
        if let Some(&known) = self.kinds.get(&kind) {
            self.notes[known].count += 1;
            return;
        }
        let file = self.files.iter().position(|file| file == path).unwrap_or_else(|| {
            self.files.push(path.into());
            self.files.len() - 1
        });
        self.kinds.insert(kind, self.notes.len());
        self.notes.push(Note { file, line, text, count: 1 });
    }

    /// One sentence for each kind, by file and line.
    pub(super) fn sentences(&self) -> Vec<String> {
        let mut sorted: Vec<&Note> = self.notes.iter().collect();
        sorted.sort_by_key(|note| (note.file, note.line));
        let sentence = |note: &&Note| {
            let place = format!("{}: line {}", self.files[note.file].display(), note.line);
            match note.count {
                1 => format!("{place}: {}", note.text),
                count => format!("{place}: {} ({count} times)", note.text),
            }
        };
        sorted.iter().map(sentence).collect()
    }
}

/// A message without its numbers: messages that differ in nothing else are of one kind.
pub(super) fn kind_of(message: &str) -> String {
    message.chars().filter(|c| !c.is_ascii_digit() && !matches!(c, '.' | '-')).collect()
}
