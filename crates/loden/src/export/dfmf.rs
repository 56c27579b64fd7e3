//! `dfmf`: `.btf` files as of UBO2014, a factorisation per decorrelated channel.
//!
//! # Format
//! As the importer `ubo2014` reads it: version 4, signature `!DFMF08FCR` without rotations, the bottom row first.
//!
//! # Limits
//! The factorisation sees each view once and keeps some components more than are written meanwhile; memory grows with
//! (pairs + texels) x components. Colour models: `yuv-log` (logarithm of Y, U and V over Y; the usual one), `rgb-log`,
//! `rgb`, `yuv`, `ycocg`; the logarithms take light below 0 as 0.

use std::path::Path;

use super::factored::Factored;
use super::{BtfWriter, Exporter, Options};
use crate::Result;
use crate::btf::BtfMeta;

pub(super) struct Dfmf;

impl Exporter for Dfmf {
    fn name(&self) -> &'static str {
        "dfmf"
    }

    fn doc(&self) -> &'static str {
        "`NAME.btf`: Bonn's factored format (UBO2014), lossy, small."
    }

    fn accepts(&self, path: &Path) -> bool {
        path.extension().is_some_and(|e| e == "btf")
    }

    fn create(&self, path: &Path, meta: &BtfMeta, options: &Options) -> Result<Box<dyn BtfWriter>> {
        Factored::create(path, meta, options, true)
    }
}
