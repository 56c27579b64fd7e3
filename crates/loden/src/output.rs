//! Outputs that appear under their final name only when complete, and checks of them before the work.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use tempfile::{NamedTempFile, TempDir};

use crate::error::plain;
use crate::{Error, Result};

/// The ending of temporary names.
const PARTIAL: &str = ".partial";

/// What an output must not replace. [`OutputFile`] itself replaces an existing file; a front end checks all outputs of a
/// job by this rule before the work begins.
#[derive(Debug, Clone, Default)]
pub struct Rule {
    /// The files and folders that the job reads.
    pub sources: Vec<PathBuf>,
    /// Whether other existing outputs are replaced.
    pub replace: bool,
}

impl Rule {
    /// Checks that the file `path` may and can be written.
    ///
    /// # Errors
    /// [`Error::Parameter`] if it is one of the sources, through links too; [`Error::Exists`]; as [`OutputFile::create`].
    pub fn file(&self, path: &Path) -> Result<()> {
        self.not_a_source(path, false)?;
        if fs::symlink_metadata(path).is_ok() && !self.replace && !path.is_dir() {
            return Err(Error::Exists { path: path.into() });
        }
        OutputFile::create(path).map(drop)
    }

    /// Checks that a folder may and can be filled. Its parents need not exist.
    ///
    /// # Errors
    /// [`Error::Parameter`] if it is or contains one of the sources; [`Error::Exists`] if it has content; [`Error::Io`] if
    /// it cannot be written.
    pub fn folder(&self, path: &Path) -> Result<()> {
        self.not_a_source(path, true)?;
        if path.is_dir() {
            let empty = fs::read_dir(path).map_err(Error::io(path))?.next().is_none();
            if !empty && !self.replace {
                return Err(Error::Exists { path: path.into() });
            }
        }
        self.writable(path)
    }

    /// Checks that files can be written into the folder `path`, or into the nearest parent that exists.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn writable(&self, path: &Path) -> Result<()> {
        let existing = path.ancestors().find(|folder| folder.exists()).unwrap_or(Path::new("."));
        let probe = builder(".", &suffix(), 0o666).tempfile_in(existing).map(drop);
        probe.map_err(|error| failed(&existing.join("file"))(error)).map_err(|error| match error {
            Error::Io { source, .. } => Error::Io { path: path.into(), source },
            other => other,
        })
    }

    fn not_a_source(&self, path: &Path, folder: bool) -> Result<()> {
        let Ok(output) = fs::canonicalize(path) else { return Ok(()) };
        for source in self.sources.iter().filter_map(|source| fs::canonicalize(source).ok()) {
            let problem = match source == output {
                true => "is the source",
                false if folder && source.starts_with(&output) => "contains the source",
                false => continue,
            };
            return Err(Error::parameter("output", format!("{} {problem}; name another output", path.display())));
        }
        Ok(())
    }
}

/// A file being written beside its final place. Dropped without [`OutputFile::commit`], it leaves nothing.
#[derive(Debug)]
pub struct OutputFile {
    temporary: NamedTempFile,
    path: PathBuf,
}

impl OutputFile {
    /// Begins writing the file `path`; an existing file is replaced on commit. Removes what a killed run left of the same
    /// file.
    ///
    /// # Errors
    /// [`Error::Io`] naming `path` if its folder cannot be written; [`Error::Unsupported`] if `path` is a folder or
    /// a device, which renaming would replace.
    pub fn create(path: impl AsRef<Path>) -> Result<Self> {
        // follow links: replace the target, not the link
        let path = fs::canonicalize(&path).unwrap_or_else(|_| path.as_ref().to_path_buf());
        if fs::metadata(&path).is_ok_and(|existing| !existing.is_file()) {
            return Err(Error::unsupported(
                &path,
                "found something that is not a regular file, expected a file or nothing",
            ));
        }
        remove_remains(&path);
        let temporary = builder(&prefix(&path), &suffix(), 0o666).tempfile_in(parent(&path)).map_err(failed(&path))?;
        // a second sign, beside the process in its name, that the file is being written
        let _ = temporary.as_file().try_lock();
        Ok(Self { temporary, path })
    }

    /// The open file.
    pub fn file(&self) -> &File {
        self.temporary.as_file()
    }

    /// The final name.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The temporary name, used until commit.
    pub fn temporary(&self) -> &Path {
        self.temporary.path()
    }

    /// Renames the file into place.
    ///
    /// # Errors
    /// [`Error::Io`] naming the final path; nothing is left behind.
    pub fn commit(self) -> Result<()> {
        let Self { temporary, path } = self;
        temporary.persist(&path).map(drop).map_err(|e| failed(&path)(e.error))
    }
}

/// Writes a whole file through `write` and renames it into place.
///
/// # Errors
/// [`Error::Io`] naming `path`, also if `write` fails; nothing is left behind.
pub fn write_file(path: impl AsRef<Path>, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<()> {
    let output = OutputFile::create(&path)?;
    let mut buffer = BufWriter::new(output.file());
    write(&mut buffer).and_then(|()| buffer.flush()).map_err(failed(path.as_ref()))?;
    drop(buffer);
    output.commit()
}

/// A folder being written beside its final place. Dropped without [`OutputDir::commit`], it leaves nothing.
#[derive(Debug)]
pub(crate) struct OutputDir {
    temporary: TempDir,
    path: PathBuf,
    /// Held as long as the folder is being written.
    _lock: Option<File>,
}

impl OutputDir {
    /// Begins writing the folder `path`, which must be empty if it exists. Removes what a killed run left of the same
    /// folder.
    ///
    /// # Errors
    /// [`Error::Exists`] if `path` is a folder with content; [`Error::Io`] if it is a file, or its parent cannot be
    /// written.
    pub fn create(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref().to_path_buf();
        if path.exists() {
            let empty = fs::read_dir(&path).map_err(failed(&path))?.next().is_none();
            if !empty {
                return Err(Error::Exists { path });
            }
        }
        remove_remains(&path);
        let temporary = builder(&prefix(&path), &suffix(), 0o777).tempdir_in(parent(&path)).map_err(failed(&path))?;
        let lock = File::open(temporary.path()).ok().filter(|folder| folder.try_lock().is_ok());
        Ok(Self { temporary, path, _lock: lock })
    }

    /// The temporary folder, to write into until commit.
    pub fn folder(&self) -> &Path {
        self.temporary.path()
    }

    /// Renames the folder into place.
    ///
    /// # Errors
    /// [`Error::Io`] naming the final path; nothing is left behind.
    pub fn commit(self) -> Result<()> {
        let Self { temporary, path, .. } = self;
        // renaming replaces an empty folder
        fs::rename(temporary.path(), &path).map_err(failed(&path))?;
        let _ = temporary.keep();
        Ok(())
    }
}

/// Creates a folder and its parents, unless they exist.
///
/// # Errors
/// [`Error::Io`] naming `path`.
pub fn create_folder(path: impl AsRef<Path>) -> Result<()> {
    fs::create_dir_all(&path).map_err(failed(path.as_ref()))
}

/// An existing folder, moved aside while its successor is written. Dropped without [`Replaced::discard`], it moves back
/// unless the successor has taken its place.
#[derive(Debug)]
pub struct Replaced {
    path: PathBuf,
    aside: PathBuf,
}

impl Replaced {
    /// Moves the folder `path` aside, to a hidden name beside it.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn new(path: &Path) -> Result<Self> {
        // a folder given as `.` or by a link has its name at the end of the whole path
        let path = fs::canonicalize(path).map_err(failed(path))?;
        let aside = parent(&path).join(format!("{}{}.replaced", prefix(&path), std::process::id()));
        fs::rename(&path, &aside).map_err(failed(&path))?;
        Ok(Self { path, aside })
    }

    /// Deletes the folder.
    ///
    /// # Errors
    /// [`Error::Io`] naming the part that cannot be deleted.
    pub fn discard(self) -> Result<()> {
        fs::remove_dir_all(&self.aside).map_err(Error::io(&self.aside))
    }
}

impl Drop for Replaced {
    fn drop(&mut self) {
        if !self.path.exists() {
            let _ = fs::rename(&self.aside, &self.path);
        }
    }
}

/// A closure for `map_err` of an output: says in a sentence why `path` cannot be written.
pub(crate) fn failed(path: &Path) -> impl FnOnce(io::Error) -> Error {
    move |error| {
        let path = named(path);
        let folder = parent(&path).display();
        let reason = match error.kind() {
            io::ErrorKind::NotFound => format!("there is no folder {folder}"),
            io::ErrorKind::NotADirectory => format!("{folder} is not a folder"),
            io::ErrorKind::PermissionDenied => format!("no permission to write in the folder {folder}"),
            io::ErrorKind::ReadOnlyFilesystem => format!("the folder {folder} is read-only"),
            io::ErrorKind::StorageFull => "the disk is full".into(),
            io::ErrorKind::FileTooLarge => "File too large".into(),
            io::ErrorKind::QuotaExceeded => "the quota of the disk is used up".into(),
            _ if error.raw_os_error().is_some() => plain(&error),
            kind => kind.to_string(),
        };
        let source = io::Error::new(error.kind(), format!("cannot be written: {reason}"));
        Error::Io { path, source: Arc::new(source) }
    }
}

/// The final name and the process of a temporary name: a dot, the final name, random letters, the process, the ending.
/// Earlier versions named no process.
fn unfinished(name: &str) -> Option<(&str, Option<u32>)> {
    let (rest, last) = name.strip_suffix(PARTIAL)?.strip_prefix('.')?.rsplit_once('.')?;
    let random = |word: &str| word.len() == 6 && word.chars().all(|c| c.is_ascii_alphanumeric());
    match (rest.rsplit_once('.'), last.parse()) {
        (Some((name, letters)), Ok(process)) if random(letters) => Some((name, Some(process))),
        _ => random(last).then_some((rest, None)),
    }
}

/// A path without the temporary names in it.
fn named(path: &Path) -> PathBuf {
    let component = |part: std::path::Component| {
        let mut name = &*part.as_os_str().to_string_lossy();
        while let Some((inner, _)) = unfinished(name) {
            name = inner;
        }
        PathBuf::from(name)
    };
    path.components().map(component).collect()
}

/// Whether a process runs; any may, where the system has no list of them.
fn is_running(process: u32) -> bool {
    let all = Path::new("/proc");
    process == std::process::id() || !all.join("self").exists() || all.join(process.to_string()).exists()
}

/// Removes temporary files and folders of `path` that a process left which has ended. A failure is harmless: they stay.
fn remove_remains(path: &Path) {
    let Some(wanted) = path.file_name().map(|name| name.to_string_lossy()) else { return };
    let Ok(entries) = fs::read_dir(parent(path)) else { return };
    for entry in entries.flatten() {
        let name = entry.file_name();
        let name = name.to_string_lossy();
        // a file that is written in several steps has the ending several times
        let (mut rest, mut running) = (&*name, false);
        while let Some((inner, process)) = unfinished(rest) {
            running |= process.is_some_and(is_running);
            rest = inner;
        }
        if rest.len() == name.len() || rest != wanted || running {
            continue;
        }
        let (remains, is_dir) = (entry.path(), entry.path().is_dir());
        let unused = File::open(&remains).is_ok_and(|file| file.try_lock().is_ok());
        let _ = match (unused, is_dir) {
            (true, true) => fs::remove_dir_all(remains),
            (true, false) => fs::remove_file(remains),
            _ => Ok(()),
        };
    }
}

fn parent(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// The part of a temporary name before its random letters.
fn prefix(path: &Path) -> String {
    format!(".{}.", path.file_name().unwrap_or_default().to_string_lossy())
}

/// The part after them.
fn suffix() -> String {
    format!(".{}{PARTIAL}", std::process::id())
}

/// A hidden temporary name beside the final one, with default permissions (the umask applies).
fn builder<'a>(prefix: &'a str, suffix: &'a str, mode: u32) -> tempfile::Builder<'a, 'a> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(prefix).suffix(suffix);
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(fs::Permissions::from_mode(mode));
    }
    builder
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_is_left_of_an_abandoned_output() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("x.bin");
        drop(OutputFile::create(&path).unwrap());
        drop(OutputDir::create(dir.path().join("y")).unwrap());
        let failed = write_file(&path, |_| Err(std::io::ErrorKind::StorageFull.into()));
        let expected = format!("{}: cannot be written: the disk is full", path.display());
        assert_eq!(failed.unwrap_err().to_string(), expected);
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0);
    }

    #[test]
    #[cfg(unix)]
    fn links_are_followed_and_special_files_are_refused() {
        let dir = tempfile::tempdir().unwrap();
        let (target, link) = (dir.path().join("target"), dir.path().join("link"));
        fs::write(&target, "old").unwrap();
        std::os::unix::fs::symlink(&target, &link).unwrap();
        write_file(&link, |f| f.write_all(b"new")).unwrap();
        assert!(link.is_symlink());
        assert_eq!(fs::read_to_string(&target).unwrap(), "new");
        for special in [dir.path(), Path::new("/dev/null")] {
            assert!(OutputFile::create(special).unwrap_err().to_string().contains("not a regular file"));
        }
    }

    #[test]
    fn commit_replaces_a_file_and_fills_an_empty_folder() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("x.bin");
        for text in ["one", "two"] {
            write_file(&path, |f| f.write_all(text.as_bytes())).unwrap();
            assert_eq!(fs::read_to_string(&path).unwrap(), text);
        }
        let folder = dir.path().join("y");
        fs::create_dir(&folder).unwrap();
        let output = OutputDir::create(&folder).unwrap();
        fs::write(output.folder().join("a"), "a").unwrap();
        output.commit().unwrap();
        assert!(folder.join("a").exists());
        assert!(OutputDir::create(&folder).is_err(), "a folder with content is not replaced");
    }

    #[test]
    fn what_a_killed_run_left_is_removed_by_the_next() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        // no process has the highest number
        let left = [
            ".x.bin.Ab12Cd.4194304.partial",
            "..x.bin.Ab12Cd.4194304.partial.Ef34Gh.4194304.partial",
            ".x.bin.Ab12Cd.partial",
        ];
        let own = format!(".x.bin.Ab12Cd.{}.partial", std::process::id());
        let others = [".x.bin.backup.Ab12Cd.4194304.partial", ".y.bin.Ab12Cd.4194304.partial", ".x.bin.old", &own];
        for name in left.iter().chain(&others) {
            fs::write(at(name), "remains").unwrap();
        }
        fs::create_dir(at(".f.Ab12Cd.4194304.partial")).unwrap();
        let other = OutputFile::create(at("x.bin")).unwrap();
        assert!(left.iter().all(|name| !at(name).exists()) && others.iter().all(|name| at(name).exists()));
        drop(OutputDir::create(at("f")).unwrap());
        assert!(!at(".f.Ab12Cd.4194304.partial").exists());
        // what this run is writing stays, in several steps too
        let running = OutputDir::create(at("f")).unwrap();
        drop(OutputDir::create(at("f")).unwrap());
        write_file(other.temporary(), |f| f.write_all(b"first step")).unwrap();
        drop(OutputFile::create(at("x.bin")).unwrap());
        assert!(running.folder().exists());
        assert_eq!(fs::read_to_string(other.temporary()).unwrap(), "first step");
    }

    #[test]
    fn errors_do_not_show_temporary_names() {
        let shown = named(Path::new("/a/.out.Ab12Cd.12.partial/v00/..x.bin.Ab12Cd.7.partial.Ef34Gh.7.partial"));
        assert_eq!(shown, Path::new("/a/out/v00/x.bin"));
        assert_eq!(named(Path::new("./a/.hidden/x.partial/b")), Path::new("./a/.hidden/x.partial/b"));
    }

    #[test]
    fn sources_and_existing_files_are_safe() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        fs::write(at("source"), "source").unwrap();
        fs::write(at("old"), "old").unwrap();
        fs::create_dir_all(at("full/inner")).unwrap();
        let rule = Rule { sources: vec![at("source")], replace: false };
        let force = Rule { replace: true, ..rule.clone() };
        assert!(matches!(rule.file(&at("old")), Err(Error::Exists { .. })));
        assert!(force.file(&at("old")).is_ok() && rule.file(&at("new")).is_ok());
        assert!(matches!(rule.folder(&at("full")), Err(Error::Exists { .. })));
        assert!(force.folder(&at("full")).is_ok() && rule.folder(&at("full/inner")).is_ok());
        assert!(rule.folder(&at("some/new/folder")).is_ok() && !at("some").exists());
        let message = |result: Result<()>| result.unwrap_err().to_string();
        assert!(message(force.file(&at("source"))).ends_with("source is the source; name another output"));
        assert!(message(force.file(&at("full/../source"))).contains("is the source"));
        assert!(message(force.folder(dir.path())).contains("contains the source"));
        assert!(message(rule.file(&at("none/x"))).contains("x: cannot be written: there is no folder "));
        assert!(message(rule.file(&at("old/x"))).contains("old is not a folder"));
        assert!(message(rule.folder(&at("old/x"))).contains("old is not a folder"));
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(at("source"), at("link")).unwrap();
            assert!(message(force.file(&at("link"))).contains("is the source"));
        }
        assert_eq!(fs::read_to_string(at("old")).unwrap(), "old");
    }

    #[test]
    fn a_replaced_folder_comes_back_after_a_failure() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("y");
        fs::create_dir(&path).unwrap();
        fs::write(path.join("a"), "a").unwrap();
        drop(Replaced::new(&path).unwrap());
        assert!(path.join("a").exists());
        let replaced = Replaced::new(&path).unwrap();
        OutputDir::create(&path).unwrap().commit().unwrap();
        replaced.discard().unwrap();
        assert!(!path.join("a").exists());
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
    }
}
