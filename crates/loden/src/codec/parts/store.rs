//! Storing parts as a file.

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::recipe::{Part, index_bytes};
use super::{Numbers, Parts, PlaneKind, whole_plane};
use crate::Result;
use crate::btf::BtfMeta;
use crate::codec::container::{Container, Description, SourceInfo, Writer, write_error};
use crate::codec::lossless::Stage;
use crate::codec::packed::pack;
use crate::codec::{by_name, lossless};
use crate::metric::Report;
use crate::output::OutputFile;
use crate::params::Values;

/// The method of files that are no codec's: the recipe stands in the file.
pub const METHOD: &str = "parts";

/// Where parts are from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Provenance {
    /// The codec that made them, or what else wrote them.
    pub method: String,
    /// Its parameters, values as text.
    pub params: Map<String, Value>,
    /// What it compressed.
    pub source: SourceInfo,
    /// The lossless stage that the file was packed by.
    #[serde(default)]
    pub lossless: Option<String>,
    /// The error of the parts whose checksums these are.
    #[serde(default)]
    pub measured: Option<Measured>,
}

/// An error, and what it is the error of.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Measured {
    /// How far decoded images were from the source.
    pub error: Report,
    /// CRC-32 of the stored numbers of each plane and table.
    pub checksums: BTreeMap<String, u32>,
}

impl Provenance {
    /// Parts that no codec made, of a source.
    pub fn unknown(source: SourceInfo) -> Self {
        Self { method: METHOD.into(), params: Map::new(), source, lossless: None, measured: None }
    }

    /// Of the parts of an open file.
    pub(in crate::codec) fn new(container: &Container, parts: &dyn Parts) -> Result<Self> {
        let measured = |error: &Report| Result::Ok(Measured { error: *error, checksums: checksums(parts)? });
        Ok(Self {
            method: container.method().into(),
            params: container.params_text().clone(),
            source: container.source().clone(),
            lossless: container.lossless().map(|stage| stage.name.into()),
            measured: container.error().map(measured).transpose()?,
        })
    }

    /// Whether these parts are what the codec stores for its parameters.
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
/// Parts that are what the codec of `from` stores become a file of its method: for those of a file, the same file. Others
/// become one of the method `parts`, which holds the recipe. The error of `from` is stored if it is the error of these parts,
/// and the file is packed by the stage of `from`.
///
/// # Errors
/// [`crate::Error::Parameter`] if the recipe does not suit the meta, or the stage is unknown; what reading the parts gives;
/// [`crate::Error::Io`].
pub fn store(parts: &dyn Parts, from: &Provenance, path: &Path) -> Result<u64> {
    let recipe = parts.recipe();
    recipe.check(parts.meta())?;
    let meta = BtfMeta { sample_type: from.source.sample_type, ..parts.meta().clone() };
    let (method, params, kept) = match from.is_of_codec(parts) {
        true => (&from.method[..], from.params.clone(), None),
        false => (METHOD, Map::new(), Some(recipe)),
    };
    let about = Description { method, params, meta: &meta, source: &from.source, recipe: kept };
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
        size = pack(output.temporary(), stage)?;
    }
    if let Some(Measured { error, .. }) = from.measured.as_ref().filter(|measured| measured.checksums == found) {
        write_error(output.temporary(), error)?;
    }
    output.commit()?;
    Ok(size)
}
