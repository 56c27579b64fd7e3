//! Image sources with their origin.

use std::sync::Arc;

use crate::Result;
use crate::btf::{BtfMeta, BtfSource, Origin, Rect, Texels};

/// A source with its origin.
pub(super) struct Opened {
    pub source: Arc<dyn BtfSource>,
    pub origin: Origin,
}

impl BtfSource for Opened {
    fn origin(&self) -> Option<Origin> {
        Some(self.origin.clone())
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
