//! `dfmf`: the `.btf` files of UBO2014, with a factorisation per decorrelated channel.
//!
//! # Format
//! As read by the importer `ubo2014`: version 4, signature `!DFMF08FCR` without rotations, the bottom row first.
//!
//! # Limits
//! The factorisation reads each view once and keeps a few more components than it writes; memory grows with (pairs +
//! texels) x components. Colour models: `yuv-log` (logarithm of Y, U and V over Y; the usual one), `rgb-log`, `rgb`,
//! `yuv`, `ycocg`; the logarithms clamp negative light to 0.

use std::path::Path;

use super::factored::{Factored, Size};
use super::{BtfWriter, Exporter, substitutes};
use crate::Result;
use crate::btf::{BtfMeta, BtfSource};
use crate::color::model::Written;
use crate::params::{Param, Params, Values};

pub(super) struct Dfmf;

crate::params! {
    struct Options {
        size: Size,
        /// Colour model of the factorised channels.
        color_model: Written = "yuv-log",
    }
}

impl Exporter for Dfmf {
    fn name(&self) -> &'static str {
        "dfmf"
    }

    fn doc(&self) -> &'static str {
        "`NAME.btf`: Bonn's factored format (UBO2014), lossy, small."
    }

    fn ending(&self) -> Option<&'static str> {
        Some("btf")
    }

    fn accepts(&self, path: &Path) -> bool {
        path.extension().is_some_and(|e| e == "btf")
    }

    fn params(&self) -> &'static [Param] {
        Options::TABLE
    }

    fn losses(&self, source: &dyn BtfSource) -> Vec<&'static str> {
        substitutes(source).into_iter().chain(["what exceeds the components"]).collect()
    }

    fn create(&self, path: &Path, meta: &BtfMeta, options: &Values) -> Result<Box<dyn BtfWriter>> {
        let Options { size, color_model } = Options::from_values(options)?;
        Factored::create(path, meta, size, Some(color_model))
    }
}
