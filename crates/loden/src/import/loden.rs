//! `loden`: the project's own format, decoded by the codec that wrote it.

use std::path::Path;

use super::{Importer, Measured, head};
use crate::params::Values;
use crate::{Result, codec};

pub(super) struct Loden;

impl Importer for Loden {
    fn name(&self) -> &'static str {
        "loden"
    }

    fn doc(&self) -> &'static str {
        "A material compressed by this program; images are decoded on demand."
    }

    fn recognises(&self, path: &Path) -> Result<bool> {
        // the container describes an empty or truncated file better than "not recognised" does
        let named = path.extension().is_some_and(|e| e == "loden") && path.is_file();
        let bytes = head(path, 4096)?;
        let container = bytes.get(8) == Some(&b'{') && bytes.windows(7).any(|w| w == b"\"loden\"");
        Ok(named || container)
    }

    fn open(&self, path: &Path, _options: &Values) -> Result<Measured> {
        Ok(Measured::Compressed(codec::open(path)?))
    }
}
