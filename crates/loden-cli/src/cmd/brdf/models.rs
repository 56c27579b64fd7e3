//! `loden brdf models`: the reference page of the analytic models, printed from their tables.

use std::fmt::Write;

use clap::Args;
use loden::model::MODELS;
use loden::params::Kind;
use serde_json::{Value, json};

use crate::terminal::Terminal;

#[derive(Args)]
pub struct Models {}

impl Models {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        let model = |model: &&dyn loden::model::Model| {
            let params: Vec<Value> = model
                .params()
                .iter()
                .map(|p| json!({ "name": p.name, "unit": p.unit, "range": range(p.kind), "default": p.default, "doc": p.doc }))
                .collect();
            json!({ "name": model.name(), "doc": model.doc(), "params": params })
        };
        let models: Vec<Value> = MODELS.iter().map(model).collect();
        terminal.result(&models, text)
    }
}

fn range(kind: Kind) -> String {
    match kind {
        Kind::Integer { min, max } => format!("{min}..{max}"),
        Kind::Real { min, max } => format!("{min}..{max}"),
        Kind::Color { min, max } => format!("{min}..{max}, or red,green,blue"),
        Kind::Choice(words) => words.join("|"),
        Kind::Switch => "yes|no".into(),
        Kind::Text(form) => form.expected.into(),
    }
}

fn text() -> String {
    let mut text = String::new();
    for model in MODELS {
        // writing to a string cannot fail
        let _ = writeln!(text, "{}\n  {}", model.name(), model.doc());
        for p in model.params() {
            let unit = if p.unit.is_empty() { String::new() } else { format!(" {}", p.unit) };
            let _ = writeln!(text, "    {:<12} {} ({}{unit}; {})", p.name, p.doc, range(p.kind), p.default);
        }
    }
    text
}
