//! `carrier`: numbers in the pixels of 8-bit pictures, as exported for RenderMan.
//!
//! # Format
//! See [`crate::codec::parts::carrier`]. The folder, or the file `carrier.json` in it, is named.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::{Importer, Measured};
use crate::Result;
use crate::codec::Decoded;
use crate::codec::parts::carrier::{self, MANIFEST};
use crate::params::Values;

pub(super) struct Carrier;

/// The folder of the pictures.
fn folder(path: &Path) -> PathBuf {
    if path.is_dir() { path.into() } else { path.parent().map_or_else(PathBuf::new, Path::to_path_buf) }
}

impl Importer for Carrier {
    fn name(&self) -> &'static str {
        "carrier"
    }

    fn doc(&self) -> &'static str {
        "Numbers in the pixels of 8-bit TIFF pictures: component images, or an index image and a block image."
    }

    fn recognises(&self, path: &Path) -> Result<bool> {
        let is_named = path.file_name().is_some_and(|name| name == MANIFEST);
        Ok(if path.is_dir() { path.join(MANIFEST).is_file() } else { is_named })
    }

    fn open(&self, path: &Path, _options: &Values) -> Result<Measured> {
        let (parts, _) = carrier::read(&folder(path))?;
        Ok(Measured::Btf(Arc::new(Decoded::new(Arc::new(parts))?)))
    }
}
