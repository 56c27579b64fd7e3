//! Image sources with their origin.

use std::ops::Range;
use std::path::PathBuf;
use std::sync::{Arc, OnceLock};

use crate::Result;
use crate::btf::{BtfMeta, BtfSource, Identity, Origin, Rect, Texels};
use crate::input;

/// A source with its origin.
pub(super) struct Opened {
    pub source: Arc<dyn BtfSource>,
    pub origin: Origin,
    /// All files that it is read from.
    pub files: Vec<PathBuf>,
    /// Read when it is asked for first.
    pub identity: OnceLock<Identity>,
}

impl BtfSource for Opened {
    fn origin(&self) -> Option<Origin> {
        Some(self.origin.clone())
    }

    fn identity(&self) -> Result<Option<Identity>> {
        if let Some(identity) = self.identity.get() {
            return Ok(Some(identity.clone()));
        }
        let identity = input::identity(&self.origin.path, &self.files)?;
        Ok(Some(self.identity.get_or_init(|| identity).clone()))
    }

    fn meta(&self) -> &BtfMeta {
        self.source.meta()
    }

    fn view(&self, view: usize) -> Result<Texels<'_>> {
        self.source.view(view)
    }

    fn image(&self, view: usize, light: usize) -> Result<Texels<'_>> {
        self.source.image(view, light)
    }

    fn rows(&self, view: usize, rows: Range<usize>) -> Result<Texels<'_>> {
        self.source.rows(view, rows)
    }

    fn read(&self, views: &[usize], lights: &[usize], texels: Rect, out: &mut [f32]) -> Result<()> {
        self.source.read(views, lights, texels, out)
    }

    fn release(&self, view: usize) {
        self.source.release(view);
    }

    fn source_bytes(&self) -> u64 {
        self.source.source_bytes()
    }

    fn missing(&self) -> &[(usize, usize)] {
        self.source.missing()
    }

    fn facts(&self) -> &[(&'static str, String)] {
        self.source.facts()
    }

    fn warnings(&self) -> &[String] {
        self.source.warnings()
    }
}
