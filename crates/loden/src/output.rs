//! Outputs that appear under their final name only when complete.

use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use tempfile::{NamedTempFile, TempDir};

use crate::{Error, Result};

/// A file being written beside its final place. Dropped without [`OutputFile::commit`], it leaves nothing.
#[derive(Debug)]
pub struct OutputFile {
    temporary: NamedTempFile,
    path: PathBuf,
}

impl OutputFile {
    /// Begins writing the file `path`; an existing file is replaced on commit.
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
        let prefix = prefix(&path);
        let temporary = builder(&prefix, 0o666).tempfile_in(parent(&path)).map_err(Error::io(&path))?;
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
        temporary.persist(&path).map(drop).map_err(|e| Error::io(&path)(e.error))
    }
}

/// Writes a whole file through `write` and renames it into place.
///
/// # Errors
/// [`Error::Io`] naming `path`, also if `write` fails; nothing is left behind.
pub fn write_file(path: impl AsRef<Path>, write: impl FnOnce(&mut dyn Write) -> std::io::Result<()>) -> Result<()> {
    let output = OutputFile::create(&path)?;
    let mut buffer = BufWriter::new(output.file());
    write(&mut buffer).and_then(|()| buffer.flush()).map_err(Error::io(&path))?;
    drop(buffer);
    output.commit()
}

/// A folder being written beside its final place. Dropped without [`OutputDir::commit`], it leaves nothing.
#[derive(Debug)]
pub(crate) struct OutputDir {
    temporary: TempDir,
    path: PathBuf,
}

impl OutputDir {
    /// Begins writing the folder `path`, which must be empty if it exists.
    ///
    /// # Errors
    /// [`Error::Unsupported`] if `path` is a folder with content; [`Error::Io`] if it is a file, or its parent cannot be
    /// written.
    pub fn create(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref().to_path_buf();
        if path.exists() {
            let empty = fs::read_dir(&path).map_err(Error::io(&path))?.next().is_none();
            if !empty {
                return Err(Error::unsupported(
                    &path,
                    "found a folder with content, expected an empty folder or nothing",
                ));
            }
        }
        let prefix = prefix(&path);
        let temporary = builder(&prefix, 0o777).tempdir_in(parent(&path)).map_err(Error::io(&path))?;
        Ok(Self { temporary, path })
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
        let Self { temporary, path } = self;
        // renaming replaces an empty folder
        fs::rename(temporary.path(), &path).map_err(Error::io(&path))?;
        let _ = temporary.keep();
        Ok(())
    }
}

fn parent(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

fn prefix(path: &Path) -> String {
    format!(".{}.", path.file_name().unwrap_or_default().to_string_lossy())
}

/// A hidden temporary name beside the final one, with default permissions (the umask applies).
fn builder(prefix: &str, mode: u32) -> tempfile::Builder<'_, 'static> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(prefix).suffix(".partial");
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
        assert!(failed.unwrap_err().to_string().starts_with(&path.display().to_string()));
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
}
