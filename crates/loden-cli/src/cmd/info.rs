//! `loden info`: what a measurement or a compressed material is.

use std::fmt::Write;
use std::path::PathBuf;

use clap::Args;
use loden::btf::{BtfMeta, BtfSource, Cosine};
use loden::codec;
use loden::direction::DirectionSet;
use loden::import::{self, Measured};
use serde_json::{Map, Value, json};

use crate::flags::Assumptions;
use crate::report;
use crate::terminal::Terminal;

#[derive(Args)]
pub struct Info {
    /// An archive, a folder of images, a raw array's .toml, or a .loden file.
    source: PathBuf,
    #[command(flatten)]
    assumptions: Assumptions,
}

impl Info {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        let (importer, measured) = import::open_named(&self.source, &self.assumptions.options())?;
        let mut info = match &measured {
            Measured::Btf(source) => self.btf(importer.name(), &**source, terminal)?,
            Measured::Brdf(brdf) => Map::from_iter([("samples".into(), json!(brdf.samples().len()))]),
        };
        info.insert("kind".into(), json!(importer.name()));
        terminal.result(&info, || text(&info))
    }

    fn btf(&self, kind: &str, source: &dyn BtfSource, terminal: &Terminal) -> anyhow::Result<Map<String, Value>> {
        let mut info = describe(source.meta());
        info.insert("source_bytes".into(), json!(source.source_bytes()));
        let missing: Vec<Value> =
            source.missing().iter().map(|&(view, light)| pair(source.meta(), view, light)).collect();
        info.insert("missing".into(), json!(missing));
        info.insert("warnings".into(), json!(source.warnings()));
        if kind == "loden" {
            let compressed = codec::open(&self.source)?;
            let params: Map<String, Value> =
                compressed.params().iter().map(|(name, text)| (name.into(), json!(text))).collect();
            info.insert("method".into(), json!(compressed.method()));
            info.insert("params".into(), Value::Object(params));
            info.insert("bytes".into(), json!(compressed.bytes()));
        }
        terminal.warn(source.warnings());
        Ok(info)
    }
}

fn describe(meta: &BtfMeta) -> Map<String, Value> {
    let value = json!({
        "kind": null,
        "width": meta.width,
        "height": meta.height,
        "views": meta.views.len(),
        "view_directions": set_name(&meta.views),
        "lights": meta.lights.len(),
        "light_directions": set_name(&meta.lights),
        "pairs": meta.pairs(),
        "encoding": meta.encoding.to_string(),
        "cosine": if meta.cosine == Cosine::Included { "included" } else { "excluded" },
        "sample_type": meta.sample_type,
        "raw8_bytes": meta.raw8_bytes(),
    });
    match value {
        Value::Object(map) => map,
        _ => Map::new(),
    }
}

fn set_name(set: &DirectionSet) -> &'static str {
    set.name().unwrap_or("list")
}

fn pair(meta: &BtfMeta, view: usize, light: usize) -> Value {
    json!({ "light": meta.lights.degrees()[light], "view": meta.views.degrees()[view] })
}

fn text(info: &Map<String, Value>) -> String {
    let mut text = String::new();
    for (key, value) in info {
        let value = match value {
            Value::String(word) => word.clone(),
            Value::Array(list) => format!("{}", list.len()),
            Value::Object(map) => {
                map.iter().map(|(k, v)| format!("{k}={}", v.as_str().unwrap_or_default())).collect::<Vec<_>>().join(" ")
            }
            Value::Number(number) if key.ends_with("bytes") => report::bytes(number.as_u64().unwrap_or(0)),
            other => other.to_string(),
        };
        let _ = writeln!(text, "{key:>16}  {value}");
    }
    text
}
