//! `fmf`: `.btf` files with one factorisation of all channels.
//!
//! # Format
//! As read by the importer `ubo2014`: version 4, signature `!FMF12FCER` without rotations and height map, logarithms of
//! the values, the bottom row first.
//!
//! # Limits
//! As for `dfmf`; negative light is clamped to 0. Must be chosen by name: the extension `.btf` stands for `dfmf`.

use std::path::Path;

use super::factored::{Factored, Size};
use super::{BtfWriter, Exporter, substitutes};
use crate::Result;
use crate::btf::{BtfMeta, BtfSource};
use crate::params::{Param, Params, Values};

pub(super) struct Fmf;

impl Exporter for Fmf {
    fn name(&self) -> &'static str {
        "fmf"
    }

    fn doc(&self) -> &'static str {
        "`NAME.btf` with `--to fmf`: Bonn's format with one factorisation of all channels."
    }

    fn ending(&self) -> Option<&'static str> {
        Some("btf")
    }

    fn accepts(&self, _path: &Path) -> bool {
        false
    }

    fn params(&self) -> &'static [Param] {
        Size::TABLE
    }

    fn losses(&self, source: &dyn BtfSource) -> Vec<&'static str> {
        substitutes(source).into_iter().chain(["what exceeds the components"]).collect()
    }

    fn create(&self, path: &Path, meta: &BtfMeta, options: &Values) -> Result<Box<dyn BtfWriter>> {
        Factored::create(path, meta, Size::from_values(options)?, None)
    }
}
