//! Stores parts as a file.

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::recipe::{Part, index_bytes};
use super::{Numbers, Parts, PlaneKind, whole_plane};
use crate::btf::BtfMeta;
use crate::codec::container::{Container, Description, HISTORY, SourceInfo, Writer, write_error};
use crate::codec::lossless::Stage;
use crate::codec::packed::pack;
use crate::codec::{by_name, lossless};
use crate::metric::Report;
use crate::output::OutputFile;
use crate::params::Values;
use crate::{Error, Result};

/// Method name of files that no codec made; the file holds the recipe.
pub const METHOD: &str = "parts";

/// The origin of parts.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Provenance {
    /// The codec, or whatever else made them.
    pub method: String,
    /// Its parameters, as text.
    pub params: Map<String, Value>,
    /// What was compressed.
    pub source: SourceInfo,
    /// The lossless stage the file was packed with.
    #[serde(default)]
    pub lossless: Option<String>,
    /// What was done to the parts since they were compressed, oldest first: edits and exchanges as JSON.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub history: Vec<Value>,
    /// The error of the original parts, with their checksums.
    #[serde(default)]
    pub(crate) measured: Option<Measured>,
}

/// An error and the checksums of the parts it belongs to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Measured {
    /// The error of the decoded images.
    pub error: Report,
    /// CRC-32 of the stored numbers of each plane and table.
    pub checksums: BTreeMap<String, u32>,
}

impl Provenance {
    /// The origin of parts that no codec made, with their source.
    pub fn unknown(source: SourceInfo) -> Self {
        Self { method: METHOD.into(), params: Map::new(), source, lossless: None, history: Vec::new(), measured: None }
    }

    /// The origin of the parts of an open file.
    pub(in crate::codec) fn new(container: &Container, parts: &dyn Parts) -> Result<Self> {
        let measured = |error: &Report| Result::Ok(Measured { error: *error, checksums: checksums(parts)? });
        Ok(Self {
            method: container.method().into(),
            params: container.params_text().clone(),
            source: container.source().clone(),
            lossless: container.lossless().map(|stage| stage.name.into()),
            history: history(container)?,
            measured: container.error().map(measured).transpose()?,
        })
    }

    /// Whether the codec stores these parts for its parameters.
    fn is_of_codec(&self, parts: &dyn Parts) -> bool {
        let Ok(codec) = by_name(&self.method) else { return false };
        let text = |(name, value): (&str, &Value)| Some((name.to_owned(), value.as_str()?.to_owned()));
        let Some(texts) = self.params.iter().map(|(name, value)| text((name, value))).collect::<Option<Vec<_>>>()
        else {
            return false;
        };
        let given = texts.iter().map(|(name, text)| (&name[..], &text[..]));
        let Ok(params) = Values::new(codec.params(), given) else { return false };
        let rows = |name: &str| parts.recipe().tables.iter().find(|table| table.name == name)?.rows();
        let recipe = codec.recipe(parts.meta(), &params).map(|recipe| recipe.with_rows(|table| rows(&table.name)));
        codec.decoder().is_none() && recipe.is_ok_and(|recipe| recipe == *parts.recipe())
    }
}

/// What was done to the parts of an open file, oldest first.
///
/// # Errors
/// [`Error::Invalid`] naming the file.
pub(in crate::codec) fn history(container: &Container) -> Result<Vec<Value>> {
    let Some(text) = container.metadata().get(HISTORY) else { return Ok(Vec::new()) };
    serde_json::from_str(text).map_err(|e| Error::invalid(container.path(), HISTORY, e.to_string()))
}

/// The stored bytes of a plane or table.
fn bytes(parts: &dyn Parts, part: Part) -> Result<(&str, Vec<u8>)> {
    let recipe = parts.recipe();
    let (name, numbers, index): (&str, Numbers, usize) = match part {
        Part::Table(table) => (&recipe.tables[table].name, parts.table(table)?, 0),
        Part::Plane(plane) => {
            let spec = &recipe.planes[plane];
            let index = if let PlaneKind::Index { rows } = spec.kind { index_bytes(rows) } else { 0 };
            (&spec.name, whole_plane(parts, plane)?, index)
        }
    };
    Ok((name, numbers.stored(index)))
}

fn checksums(parts: &dyn Parts) -> Result<BTreeMap<String, u32>> {
    let checksum = |part| {
        let (name, bytes) = bytes(parts, part)?;
        Ok((name.to_owned(), crc32fast::hash(&bytes)))
    };
    parts.recipe().order().into_iter().map(checksum).collect()
}

/// Stores parts as the file `path`, without decoding anything, and returns its size in bytes.
///
/// If the codec of `from` would store exactly these parts, the file is one of its method; for the parts of a file
/// this reproduces the file. Otherwise the method is `parts` and the file holds the recipe. The error of `from` is
/// kept if it belongs to these parts, and the file is packed by the stage of `from`.
///
/// # Errors
/// [`Error::Parameter`] if the recipe does not suit the meta, or the stage is unknown; errors of reading the
/// parts; [`Error::Io`].
pub fn store(parts: &dyn Parts, from: &Provenance, path: &Path) -> Result<u64> {
    let recipe = parts.recipe();
    recipe.check(parts.meta())?;
    let meta = BtfMeta { sample_type: from.source.sample_type, ..parts.meta().clone() };
    let (method, params, kept) = match from.is_of_codec(parts) {
        true => (&from.method[..], from.params.clone(), None),
        false => (METHOD, Map::new(), Some(recipe)),
    };
    let about = Description { method, params, meta: &meta, source: &from.source, recipe: kept, history: &from.history };
    let output = OutputFile::create(path)?;
    let writer = Writer::describe(output.temporary(), &about, &recipe.tensors(&meta))?;
    let mut found = BTreeMap::new();
    for part in recipe.order() {
        let (name, bytes) = bytes(parts, part)?;
        writer.write(name, 0, &bytes)?;
        found.insert(name.to_owned(), crc32fast::hash(&bytes));
    }
    let mut size = writer.commit()?;
    if let Some(name) = &from.lossless {
        let stage: &'static Stage = lossless::by_name(name)?;
        size = size.min(pack(output.temporary(), stage)?);
    }
    if let Some(Measured { error, .. }) = from.measured.as_ref().filter(|measured| measured.checksums == found) {
        write_error(output.temporary(), error)?;
    }
    output.commit()?;
    Ok(size)
}
