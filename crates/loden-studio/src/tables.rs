//! The library's registries with their parameters: the page makes its controls of them.

use axum::Json;
use loden::codec::{self, CODECS};
use loden::job::sample_kinds;
use loden::params::{Kind, Param};
use loden::render::object::OBJECTS;
use loden::renderers::RENDERERS;
use loden::synth::{self, SYNTHESES};
use serde_json::{Value, json};

/// Codecs, syntheses, samples, renderers and objects.
pub(crate) async fn tables() -> Json<Value> {
    let entry = |name: &str, doc: &str, params: &[Param]| json!({ "name": name, "doc": doc, "params": params.iter().map(param).collect::<Vec<_>>() });
    let codecs: Vec<Value> = CODECS.iter().map(|one| entry(one.name(), one.doc(), one.params())).collect();
    let syntheses: Vec<Value> = SYNTHESES.iter().map(|one| entry(one.name(), one.doc(), one.params())).collect();
    let files = ["maps", "mesh"];
    let samples = sample_kinds().into_iter().filter(|one| !files.contains(&one.name));
    let samples: Vec<Value> = samples.map(|one| entry(one.name, one.doc, one.params)).collect();
    let renderers: Vec<Value> = RENDERERS.iter().map(|one| entry(one.name(), one.doc(), &[])).collect();
    let objects: Vec<Value> = OBJECTS.iter().map(|one| entry(one.name, one.doc, &[])).collect();
    Json(json!({
        "version": env!("CARGO_PKG_VERSION"), "codecs": codecs, "codec": codec::DEFAULT, "syntheses": syntheses,
        "synthesis": synth::DEFAULT, "samples": samples, "renderers": renderers, "objects": objects,
    }))
}

fn param(param: &Param) -> Value {
    let (kind, range) = match param.kind {
        Kind::Integer { min, max } => ("integer", json!([min, max])),
        Kind::Real { min, max } => ("real", json!([min, max])),
        Kind::Color { min, max } => ("color", json!([min, max])),
        Kind::Choice(words) => ("choice", json!(words)),
        Kind::Switch => ("switch", Value::Null),
        Kind::Text(form) => ("text", json!(form.examples)),
    };
    json!({
        "name": param.name, "unit": param.unit, "kind": kind, "range": range, "default": param.default, "doc": param.doc,
    })
}
