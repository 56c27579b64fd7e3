//! `loden info`: what a measurement or a compressed material is.

use std::fmt::Write;
use std::path::PathBuf;

use clap::Args;
use loden::btf::{BtfMeta, BtfSource, Cosine};
use loden::codec::CompressedBtf;
use loden::direction::DirectionSet;
use loden::import::{self, Measured};
use loden::material::{Brdf, BrdfSample};
use serde_json::{Map, Value, json};

use crate::flags::Assumptions;
use crate::report;
use crate::terminal::Terminal;

#[derive(Args)]
pub struct Info {
    /// A BTF, a BRDF or a .loden file, recognised by its content.
    source: PathBuf,
    #[command(flatten)]
    assumptions: Assumptions,
}

impl Info {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        let (importer, measured) = import::open_named(&self.source, &self.assumptions.options())?;
        let mut info = match &measured {
            Measured::Btf(source) => btf(source.as_ref(), terminal)?,
            Measured::Compressed(btf) => compressed(btf.as_ref(), terminal)?,
            Measured::Brdf(brdf) => self::brdf(&**brdf, terminal),
        };
        info.insert("kind".into(), json!(importer.name()));
        terminal.result(&info, || text(&info))
    }
}

fn btf(source: &dyn BtfSource, terminal: &Terminal) -> anyhow::Result<Map<String, Value>> {
    let mut info = describe(source.meta());
    info.insert("source_bytes".into(), json!(source.source_bytes()));
    let missing: Vec<Value> = source.missing().iter().map(|&(view, light)| pair(source.meta(), view, light)).collect();
    info.insert("missing".into(), json!(missing));
    for (name, text) in source.facts() {
        info.insert((*name).into(), json!(text));
    }
    for (name, value) in range(source)? {
        info.insert(name, value);
    }
    info.insert("warnings".into(), json!(source.warnings()));
    terminal.warn(source.warnings());
    Ok(info)
}

fn compressed(compressed: &dyn CompressedBtf, terminal: &Terminal) -> anyhow::Result<Map<String, Value>> {
    let mut info = btf(compressed, terminal)?;
    let params: Map<String, Value> =
        compressed.params().iter().map(|(name, text)| (name.into(), json!(text))).collect();
    info.insert("method".into(), json!(compressed.method()));
    info.insert("params".into(), Value::Object(params));
    if let Some(Value::Object(error)) = compressed.error().map(|error| json!(error)) {
        info.extend(error);
    }
    if let Some(stage) = compressed.lossless() {
        info.insert("lossless".into(), json!(stage.name));
    }
    info.insert("bytes".into(), json!(compressed.bytes()));
    info.insert("resident_bytes".into(), json!(compressed.resident_bytes()));
    Ok(info)
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

/// The values of the view nearest to the normal: a BTF may be too large to look at all of it.
fn range(source: &dyn BtfSource) -> anyhow::Result<Map<String, Value>> {
    let meta = source.meta();
    let view = meta.views.nearest(glam::Vec3::Z);
    let (mut low, mut high, mut negative) = (f32::INFINITY, f32::NEG_INFINITY, 0u64);
    for light in 0..meta.lights.len() {
        for &value in source.image(view, light)?.to_f32().iter() {
            low = low.min(value);
            high = high.max(value);
            negative += u64::from(value < 0.0);
        }
    }
    let degrees = meta.views.degrees()[view];
    let values = json!({ "range_of_view": degrees, "lowest": low, "highest": high, "negative": negative });
    Ok(values.as_object().cloned().unwrap_or_default())
}

/// What a BRDF's file says and the ranges of its values.
fn brdf(brdf: &dyn Brdf, terminal: &Terminal) -> Map<String, Value> {
    let samples = brdf.samples();
    let notes = brdf.notes();
    terminal.warn(&notes.warnings);
    let mut info = Map::from_iter([("kind".into(), Value::Null), ("holds".into(), json!("brdf"))]);
    for (name, text) in &notes.facts {
        info.insert((*name).into(), json!(text));
    }
    let highest = |of: &dyn Fn(&BrdfSample) -> f32| samples.iter().map(of).fold(f32::NEG_INFINITY, f32::max);
    let values = |s: &BrdfSample| s.value.to_array();
    let mean = |c: usize| samples.iter().map(|s| f64::from(values(s)[c])).sum::<f64>() / samples.len().max(1) as f64;
    let theta = |w: glam::Vec3| loden::direction::theta(w).to_degrees();
    info.insert("samples".into(), json!(samples.len()));
    info.insert("largest_theta_i".into(), json!(highest(&|s| theta(s.wi))));
    info.insert("largest_theta_o".into(), json!(highest(&|s| theta(s.wo))));
    info.insert("lowest".into(), json!(-highest(&|s| -s.value.min_element())));
    info.insert("highest".into(), json!(highest(&|s| s.value.max_element())));
    info.insert("mean".into(), json!([mean(0), mean(1), mean(2)]));
    info.insert("warnings".into(), json!(notes.warnings));
    info
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
            Value::Array(list) if list.iter().all(Value::is_number) && !list.is_empty() => {
                list.iter().map(ToString::to_string).collect::<Vec<_>>().join(" ")
            }
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
