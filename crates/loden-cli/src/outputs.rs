//! The outputs of a command, checked by one rule before the work; `-` is standard output.

use std::cell::RefCell;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

use loden::output::{Replaced, Rule};
use loden::params::Given;
use loden::{Error, acquire, codec, export, import, renderers};
use tempfile::TempDir;

use crate::terminal::Terminal;

/// The name of standard output.
const STDOUT: &str = "-";

/// Checks the outputs of one command.
pub struct Outputs<'a> {
    terminal: &'a Terminal,
    rule: Rule,
    named: RefCell<Vec<PathBuf>>,
}

impl<'a> Outputs<'a> {
    /// For a command that reads `sources`; names that stand for no file are ignored.
    pub fn new<P: AsRef<Path>>(terminal: &'a Terminal, sources: impl IntoIterator<Item = P>) -> Self {
        let all = |source: P| {
            let source = source.as_ref();
            let files = import::recognise(source).and_then(|importer| importer.files(source));
            std::iter::once(source.to_path_buf()).chain(files.unwrap_or_default())
        };
        let sources = sources.into_iter().flat_map(all).collect();
        Self { terminal, rule: Rule { sources, replace: terminal.force() }, named: RefCell::default() }
    }

    /// A file with one of these endings, `-` with the first; any name if there are none.
    pub fn file(&self, path: &Path, endings: &[&str]) -> anyhow::Result<Target> {
        if path == Path::new(STDOUT) {
            return self.stdout(endings.first().copied());
        }
        let ending = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_lowercase();
        if !endings.is_empty() && !endings.contains(&ending.as_str()) {
            let expected = endings.iter().map(|ending| format!(".{ending}")).collect::<Vec<_>>().join(" or ");
            return Err(Error::parameter("output", format!("{} does not end in {expected}", path.display())).into());
        }
        self.once(path)?;
        self.rule.file(path)?;
        Ok(Target::plain(path))
    }

    /// An optional [`Outputs::file`].
    pub fn optional(&self, path: Option<&PathBuf>, endings: &[&str]) -> anyhow::Result<Option<Target>> {
        path.map(|path| self.file(path, endings)).transpose()
    }

    /// A file that is continued if it exists.
    pub fn continued(&self, path: &Path) -> loden::Result<()> {
        self.once(path)?;
        if path.exists() { Ok(()) } else { self.rule.file(path) }
    }

    /// A BTF in any format: a file, or a folder.
    pub fn btf(&self, path: &Path, format: Option<&str>) -> anyhow::Result<Target> {
        if path == Path::new(STDOUT) {
            let exporter = export::by_name(Path::new("x.zip"), format)?;
            let missing = || Error::parameter("output", format!("{} is not a single file", exporter.name()));
            return self.stdout(Some(exporter.ending().ok_or_else(missing)?));
        }
        let exporter = export::by_name(path, format)?;
        if path.is_dir() {
            return self.whole_folder(path);
        }
        let target = self.file(path, &[])?;
        exporter.beside(path).iter().try_for_each(|file| self.rule.file(file))?;
        Ok(target)
    }

    /// A BRDF in any format.
    pub fn brdf(&self, path: &Path, format: Option<&str>) -> anyhow::Result<Target> {
        if path == Path::new(STDOUT) {
            let missing = "choose the format by --to for standard output";
            let format = format.ok_or_else(|| Error::parameter("output", missing))?;
            return self.stdout(Some(export::brdf_exporter(path, Some(format))?.ending()));
        }
        export::brdf_exporter(path, format)?;
        self.file(path, &[])
    }

    /// A folder that is the output as a whole. One with content is replaced only if this program wrote such a thing.
    pub fn whole_folder(&self, path: &Path) -> anyhow::Result<Target> {
        self.folder(path)?;
        let full = std::fs::read_dir(path).is_ok_and(|mut entries| entries.next().is_some());
        if !full {
            return Ok(Target::plain(path));
        }
        let own = [acquire::photograph::MANIFEST, codec::parts::folder::MANIFEST, renderers::MANIFEST];
        if !own.iter().any(|name| path.join(name).is_file()) && import::open(path, &Given::default()).is_err() {
            let what = "is a folder with other content, which is not replaced; name another folder";
            return Err(Error::parameter("output", format!("{} {what}", path.display())).into());
        }
        Ok(Target { replaced: Some(Replaced::new(path)?), ..Target::plain(path) })
    }

    /// A folder that files are written into; others stay.
    pub fn folder(&self, path: &Path) -> loden::Result<()> {
        if path == Path::new(STDOUT) {
            return Err(Error::parameter("output", "a folder cannot be written to standard output"));
        }
        self.once(path)?;
        self.rule.folder(path)
    }

    fn once(&self, path: &Path) -> loden::Result<()> {
        let mut named = self.named.borrow_mut();
        if named.iter().any(|other| other == path) {
            return Err(Error::parameter("output", format!("{} is named twice", path.display())));
        }
        named.push(path.into());
        Ok(())
    }

    fn stdout(&self, ending: Option<&str>) -> anyhow::Result<Target> {
        self.once(Path::new(STDOUT))?;
        self.terminal.give_stdout_away();
        let folder = tempfile::tempdir().map_err(|error| Error::io(std::env::temp_dir())(error))?;
        let path = folder.path().join("output").with_extension(ending.unwrap_or("txt"));
        Ok(Target { path, given: STDOUT.into(), stdout: Some(folder), replaced: None })
    }
}

/// A checked output.
pub struct Target {
    path: PathBuf,
    given: PathBuf,
    /// The temporary folder of what goes to standard output.
    stdout: Option<TempDir>,
    replaced: Option<Replaced>,
}

impl Target {
    fn plain(path: &Path) -> Self {
        Self { path: path.into(), given: path.into(), stdout: None, replaced: None }
    }

    /// Whether the file ends in this.
    pub fn is(&self, ending: &str) -> bool {
        self.path.extension().is_some_and(|e| e.eq_ignore_ascii_case(ending))
    }

    /// Where to write.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Completes the output, which has been written, and gives its name as the user said it.
    pub fn finish(self) -> anyhow::Result<PathBuf> {
        if self.stdout.is_some() {
            let mut file = File::open(&self.path).map_err(Error::io(&self.path))?;
            match io::copy(&mut file, &mut io::stdout().lock()) {
                // a reader such as `head` may close the pipe early
                Err(error) if error.kind() != io::ErrorKind::BrokenPipe => {
                    return Err(Error::io("standard output")(error).into());
                }
                _ => {}
            }
        }
        if let Some(replaced) = self.replaced {
            replaced.discard()?;
        }
        Ok(self.given)
    }
}
