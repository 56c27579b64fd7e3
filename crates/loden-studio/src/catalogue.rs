//! The materials below the given folders, and those that are open.

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::SystemTime;

use loden::direction::Scheme;
use loden::import;
use loden::job::{self, Opened};
use loden::material::{Interpolation, Material};
use loden::memory::Memory;
use loden::params::Given;
use loden::progress::Silent;
use loden::{Error, Result};
use serde_json::Value;

use crate::describe;
use crate::failure::Answer;
use crate::folders::Folders;

/// Folders within folders that are searched.
const DEPTH: usize = 4;

/// Files and folders that are looked at.
const LOOKED_AT: usize = 5000;

/// Materials that stay open, and evaluated materials that stay in memory.
const OPEN: usize = 12;
const EVALUATED: usize = 3;

/// Memory for the images of one material that is evaluated between measured directions.
const IMAGES: Memory = Memory(1 << 30);

/// Pictures that a folder must have to be taken for a BTF.
const PICTURES: usize = 4;

/// A file as it was: another one under the same name is another key.
pub(crate) type Key = (PathBuf, u64, Option<SystemTime>);

/// The key of a file or folder.
pub(crate) fn key(path: &Path) -> Result<Key> {
    let found = std::fs::metadata(path).map_err(Error::io(path))?;
    Ok((path.into(), found.len(), found.modified().ok()))
}

/// The most recently used things, by key.
pub(crate) struct Recent<T>(Mutex<Vec<(Key, T)>>);

impl<T> Default for Recent<T> {
    fn default() -> Self {
        Self(Mutex::default())
    }
}

impl<T: Clone> Recent<T> {
    /// What was made for a key, or is made now; the `most` recent ones are kept.
    pub fn get(&self, key: &Key, most: usize, make: impl FnOnce() -> Answer<T>) -> Answer<T> {
        if let Some(found) = self.take(key) {
            self.put(key, &found, most);
            return Ok(found);
        }
        let made = make()?;
        self.put(key, &made, most);
        Ok(made)
    }

    fn take(&self, key: &Key) -> Option<T> {
        let mut all = lock(&self.0);
        let at = all.iter().position(|(known, _)| known == key)?;
        Some(all.remove(at).1)
    }

    fn put(&self, key: &Key, value: &T, most: usize) {
        let mut all = lock(&self.0);
        all.retain(|(known, _)| known != key);
        all.push((key.clone(), value.clone()));
        let excess = all.len().saturating_sub(most);
        all.drain(..excess);
    }
}

/// Locks, whatever happened to others that held the lock.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// What is known of the materials.
#[derive(Default)]
pub(crate) struct Catalogue {
    opened: Recent<Arc<Opened>>,
    evaluated: Recent<Arc<dyn Material>>,
    /// Rows of the list; none for files that are no materials.
    rows: Mutex<HashMap<Key, Option<Value>>>,
    /// Thumbnails as PNG.
    pub thumbnails: Mutex<HashMap<Key, Arc<Vec<u8>>>>,
}

impl Catalogue {
    /// Opens a material. Files that a description refers to must be below the given folders, too.
    pub fn open(&self, folders: &Folders, path: &Path) -> Answer<Arc<Opened>> {
        self.opened.get(&key(path)?, OPEN, || {
            for file in import::recognise(path)?.files(path)? {
                folders.check(&file)?;
            }
            Ok(Arc::new(job::open(path, &Given::default(), &Silent)?))
        })
    }

    /// A material for evaluation between measured directions. The images of a BTF are read for it once.
    pub fn material(&self, folders: &Folders, path: &Path) -> Answer<Arc<dyn Material>> {
        self.evaluated.get(&key(path)?, EVALUATED, || {
            let opened = self.open(folders, path)?;
            let place = std::env::temp_dir();
            let interpolation = Interpolation::from(Scheme::Triangles);
            let found = opened.measured.clone().material_within(interpolation, Some((IMAGES, &place)), &Silent)?;
            Ok(found.material)
        })
    }

    /// The list of all materials, sorted by name.
    pub fn list(&self, folders: &Folders) -> Vec<Value> {
        let (mut seen, mut rows, mut left) = (HashSet::new(), Vec::new(), LOOKED_AT);
        for (number, place) in folders.places() {
            let mut found = Vec::new();
            walk(&place.path, if place.is_implicit { 1 } else { DEPTH }, &mut left, &mut found);
            for path in found {
                // a link, or a folder within another given one
                let is_new = std::fs::canonicalize(&path).is_ok_and(|real| seen.insert(real));
                if let Some(id) = folders.id(number, &path).filter(|id| is_new && folders.find(id).is_ok()) {
                    rows.extend(self.row(folders, &id, &path));
                }
            }
        }
        rows
    }

    fn row(&self, folders: &Folders, id: &str, path: &Path) -> Option<Value> {
        let key = key(path).ok()?;
        if let Some(known) = lock(&self.rows).get(&key) {
            return known.clone();
        }
        let row = import::recognise(path).is_ok().then(|| match self.open(folders, path) {
            Ok(opened) => Some(describe::row(id, path, &key, &opened)),
            // a folder of other pictures
            Err(_) if path.is_dir() => None,
            Err(failure) => Some(describe::damaged(id, path, &key, &failure)),
        });
        let row = row.flatten();
        lock(&self.rows).insert(key, row.clone());
        row
    }
}

/// Files that may be materials, and folders of pictures.
fn walk(path: &Path, depth: usize, left: &mut usize, found: &mut Vec<PathBuf>) {
    if *left == 0 {
        return;
    }
    *left -= 1;
    if !path.is_dir() {
        found.push(path.into());
        return;
    }
    let Ok(entries) = std::fs::read_dir(path) else { return };
    let mut entries: Vec<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
    entries.retain(|path| !path.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.')));
    entries.sort();
    if entries.iter().filter(|path| is_picture(path)).count() >= PICTURES {
        found.push(path.into());
    } else if depth > 0 {
        entries.iter().filter(|path| depth > 1 || path.is_file()).for_each(|path| walk(path, depth - 1, left, found));
    }
}

fn is_picture(path: &Path) -> bool {
    let ending = path.extension().and_then(|ending| ending.to_str()).unwrap_or_default().to_lowercase();
    ["png", "jpg", "jpeg", "exr", "hdr", "bmp", "tif", "tiff"].contains(&ending.as_str())
}
