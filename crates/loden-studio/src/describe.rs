//! Materials described for the page.

use std::path::Path;
use std::time::UNIX_EPOCH;

use loden::btf::{BtfMeta, BtfSource};
use loden::codec::CompressedBtf;
use loden::codec::parts::Expr;
use loden::import::Measured;
use loden::job::Opened;
use loden::renderers;
use serde_json::{Map, Value, json};

use crate::catalogue::Key;
use crate::failure::Failure;

fn base(id: &str, path: &Path, (_, bytes, modified): &Key) -> Map<String, Value> {
    let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy();
    let since = modified.and_then(|time| time.duration_since(UNIX_EPOCH).ok()).map(|age| age.as_secs());
    [("id", json!(id)), ("name", json!(name)), ("bytes", json!(bytes)), ("modified", json!(since))]
        .map(|(name, value)| (name.to_owned(), value))
        .into_iter()
        .collect()
}

/// A row of the list.
pub(crate) fn row(id: &str, path: &Path, key: &Key, opened: &Opened) -> Value {
    let mut row = base(id, path, key);
    row.extend(map(json!({ "kind": opened.kind, "holds": holds(&opened.measured) })));
    match &opened.measured {
        Measured::Btf(source) => row.extend(map(images(&**source))),
        Measured::Compressed(compressed) => {
            row.extend(map(images(&**compressed)));
            row.extend(map(of_compressed(compressed)));
        }
        Measured::Brdf(_) => {}
    }
    Value::Object(row)
}

/// A row for a file that cannot be read.
pub(crate) fn damaged(id: &str, path: &Path, key: &Key, failure: &Failure) -> Value {
    let mut row = base(id, path, key);
    row.insert("problem".into(), json!(failure.message()));
    Value::Object(row)
}

/// All that the page shows of an open material.
pub(crate) fn whole(id: &str, path: &Path, key: &Key, opened: &Opened) -> Value {
    let mut value = map(row(id, path, key, opened));
    value.insert("warnings".into(), json!(opened.measured.warnings()));
    match &opened.measured {
        Measured::Btf(source) => value.extend(map(directions(&**source))),
        Measured::Compressed(compressed) => {
            value.extend(map(directions(&**compressed)));
            value.insert("params".into(), json!(compressed.params()));
            value.insert("report".into(), json!(compressed.error()));
            let has_rows = matches!(compressed.parts().recipe().value, Expr::Table { row: Some(_), .. });
            value.insert("has_rows".into(), json!(has_rows));
            value.insert("rearranged".into(), json!(compressed.source_map().is_some()));
            value.insert("resident_bytes".into(), json!(compressed.resident_bytes()));
            let history: Vec<String> = compressed.history().unwrap_or_default().iter().map(Value::to_string).collect();
            value.insert("history".into(), json!(history));
            let shown = renderers::by_name("three").and_then(|three| three.check(path, compressed));
            value.insert("not_on_gpu".into(), json!(shown.err().map(|error| error.to_string())));
        }
        Measured::Brdf(brdf) => {
            let facts: Map<String, Value> =
                brdf.notes().facts.iter().map(|(name, fact)| ((*name).to_owned(), json!(fact))).collect();
            value.insert("facts".into(), Value::Object(facts));
        }
    }
    Value::Object(value)
}

fn map(value: Value) -> Map<String, Value> {
    match value {
        Value::Object(map) => map,
        _ => Map::new(),
    }
}

fn holds(measured: &Measured) -> &'static str {
    match measured {
        Measured::Btf(_) => "btf",
        Measured::Compressed(_) => "compressed",
        Measured::Brdf(_) => "brdf",
    }
}

fn images(source: &dyn BtfSource) -> Value {
    let meta = source.meta();
    json!({
        "width": meta.width, "height": meta.height, "pairs": meta.pairs(),
        "views": views(meta).len(), "lights": meta.lights.len(), "raw_bytes": meta.raw8_bytes(),
        "bytes": source.source_bytes(),
    })
}

fn of_compressed(compressed: &CompressedBtf) -> Value {
    let source = compressed.source().identity.as_ref().map(|identity| identity.name.as_str());
    json!({
        "method": compressed.method(), "error": compressed.error().map(|report| report.mean_abs_error),
        "source": source, "bytes": compressed.bytes(), "has_changed": compressed.history().is_ok_and(|all| !all.is_empty()),
    })
}

fn views(meta: &BtfMeta) -> &loden::direction::DirectionSet {
    meta.lights.seen_from().unwrap_or(&meta.views)
}

/// The measured directions in degrees: of a list of pairs, a view for each light.
fn directions(source: &dyn BtfSource) -> Value {
    let meta = source.meta();
    json!({
        "listed": meta.is_listed(), "view_degrees": views(meta).degrees(), "light_degrees": meta.lights.degrees(),
        "encoding": meta.encoding.to_string(), "cosine": meta.cosine, "sample_type": meta.sample_type,
        "missing": source.missing(),
        "facts": source.facts().iter().map(|(name, fact)| ((*name).to_owned(), json!(fact))).collect::<Map<_, _>>(),
    })
}
