//! The commands that do what a demo did, made of the same values.

use std::path::Path;

use loden::job::{Comparison, Look};
use loden::params::Values;
use loden::{acquire, codec};

use crate::flags::Assumptions;
use crate::terminal::quoted;

/// Command lines.
pub struct Commands {
    lines: Vec<String>,
    /// Flags of the source's conventions.
    source: Vec<String>,
}

impl Commands {
    pub fn new(assumptions: &Assumptions) -> Self {
        Self { lines: Vec::new(), source: assumptions.arguments() }
    }

    fn add(&mut self, words: Vec<String>) {
        let words = words.iter().map(|word| quoted(word));
        self.lines.push(std::iter::once("loden".to_owned()).chain(words).collect::<Vec<_>>().join(" "));
    }

    /// The measurement of a built-in sample with its default parameters.
    pub fn acquire(&mut self, sample: &str, options: &acquire::Options, output: &Path) {
        let (size, spp) = (options.size.to_string(), options.spp.to_string());
        let words = ["acquire", sample, "--size", &size, "--spp", &spp, "-o", &name(output)];
        self.add(words.map(str::to_owned).to_vec());
    }

    /// One compressed file; without its error, which the comparison measures.
    pub fn compress(&mut self, source: &Path, row: &Comparison) {
        let mut words = ["compress", &name(source), "--method", &row.method].map(str::to_owned).to_vec();
        words.extend(given(&row.method, &row.params));
        words.extend(self.source.clone());
        words.extend(["--no-error".into(), "-o".into(), name(&row.file)]);
        self.add(words);
    }

    pub fn compare(&mut self, source: &Path, rows: &[Comparison]) {
        let files = rows.iter().map(|row| name(&row.file));
        let words = ["compare".to_owned(), name(source)].into_iter().chain(files);
        self.add(words.chain(self.source.clone()).collect());
    }

    /// A picture of an object.
    pub fn render(&mut self, look: &Look, material: &Path, output: &Path) {
        let mut words = vec!["render".to_owned(), "--material".into(), name(material)];
        words.extend(flags(look));
        words.extend(["-o".into(), name(output)]);
        self.add(words);
    }

    /// Pictures of an object with several materials.
    pub fn sheet(&mut self, look: &Look, source: &Path, files: &[&Path], output: &Path) {
        let mut words = vec!["render".to_owned(), "--sheet".into(), name(source)];
        words.extend(files.iter().map(|file| name(file)));
        words.extend(flags(look).into_iter().chain(self.source.clone()));
        words.extend(["-o".into(), name(output)]);
        self.add(words);
    }

    pub fn text(&self) -> String {
        self.lines.join("\n")
    }
}

/// The parameters of a method that differ from its defaults, as flags.
fn given(method: &str, params: &Values) -> Vec<String> {
    let table = codec::by_name(method).map_or(&[][..], |codec| codec.params());
    let default = |name: &str| table.iter().find(|param| param.name == name).map(|param| param.default);
    let changed = params.iter().filter(|(name, value)| default(name) != Some(*value));
    changed.map(|(name, value)| format!("--{name}={value}")).collect()
}

/// What differs from the defaults of `loden render`.
fn flags(look: &Look) -> Vec<String> {
    let settings = look.settings;
    let size = format!("{}x{}", settings.width, settings.height);
    ["--object", &look.object, "--size", &size, "--spp", &settings.spp.to_string()].map(str::to_owned).to_vec()
}

fn name(path: &Path) -> String {
    path.display().to_string()
}
