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
                .map(|p| {
                    let (range, default) = (typed_range(p.kind), typed(p.kind, p.default));
                    json!({ "name": p.name, "unit": p.unit, "range": range, "default": default, "doc": p.doc })
                })
                .collect();
            // `params` is what a material has; this is what it may have
            json!({ "name": model.name(), "doc": model.doc(), "parameters": params })
        };
        let models: Vec<Value> = MODELS.iter().map(model).collect();
        terminal.result(&models, text)
    }
}

/// Lowest and highest number, or the words.
fn typed_range(kind: Kind) -> Value {
    match kind {
        Kind::Integer { min, max } => json!([min, max]),
        Kind::Real { min, max } | Kind::Color { min, max } => json!([min, max]),
        Kind::Choice(words) => json!(words),
        Kind::Switch => json!([false, true]),
        Kind::Text(form) => json!(form.expected),
    }
}

/// A value in its own type: a colour as three numbers.
fn typed(kind: Kind, text: &str) -> Value {
    let numbers: Option<Vec<f64>> = text.split(',').map(|word| word.parse().ok()).collect();
    match (kind, numbers.as_deref()) {
        (Kind::Integer { .. }, _) => text.parse::<i64>().map_or(json!(text), |number| json!(number)),
        (Kind::Real { .. }, Some([number])) => json!(number),
        (Kind::Color { .. }, Some([grey])) => json!([grey, grey, grey]),
        (Kind::Color { .. }, Some(rgb)) => json!(rgb),
        (Kind::Switch, _) => json!(text == "yes"),
        _ => json!(text),
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
