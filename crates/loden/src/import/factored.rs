//! `factored`: BRDFs as products of tables, written by `loden factor`.
//!
//! # Format
//! As described in the module `separable`: a safetensors file with the metadata entry `loden_brdf`.

use std::path::Path;
use std::sync::Arc;

use super::{Importer, Measured, head};
use crate::Result;
use crate::material::{Notes, Tabulated};
use crate::params::Values;
use crate::separable::{self, MARK};

pub(super) struct Factored;

impl Importer for Factored {
    fn name(&self) -> &'static str {
        "factored"
    }

    fn doc(&self) -> &'static str {
        "A BRDF as a product of tables, written by `loden factor`."
    }

    fn recognises(&self, path: &Path) -> Result<bool> {
        let bytes = head(path, 4096)?;
        Ok(bytes.get(8) == Some(&b'{') && bytes.windows(MARK.len()).any(|word| word == MARK.as_bytes()))
    }

    fn open(&self, path: &Path, _options: &Values) -> Result<Measured> {
        let (factored, making) = separable::read(path)?;
        let mut notes = Notes::default();
        notes.fact("factored_from", making.source);
        notes.fact("method", making.method);
        notes.fact("params", making.params);
        notes.fact("tables", factored.tables().len());
        notes.fact("table_bytes", factored.bytes());
        notes.fact("mean_rel_error", making.mean_rel_error);
        notes.fact("rmse", making.rmse);
        Ok(Measured::Brdf(Arc::new(Tabulated::new(factored, notes))))
    }
}
