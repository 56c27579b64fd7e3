//! `loden list`: formats, codecs, models and the like with their parameters, printed from the library's tables.

use std::fmt::Write;

use clap::{Args, ValueEnum};
use loden::codec::CODECS;
use loden::export::{BRDF_EXPORTERS, EXPORTERS};
use loden::import::IMPORTERS;
use loden::job::sample_kinds;
use loden::model::MODELS;
use loden::params::{Kind, Param};
use loden::renderers::RENDERERS;
use loden::separable::FACTORISATIONS;
use loden::synth::SYNTHESES;
use serde_json::{Map, Value, json};

use crate::terminal::Terminal;

#[derive(Args)]
#[command(after_long_help = "\
Examples:
  loden list codecs
  loden list --json")]
pub struct List {
    /// What to list [default: everything].
    what: Option<What>,
}

/// What can be listed.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum What {
    /// Formats that are read, with what their files may leave open.
    Formats,
    /// Formats that are written.
    Exporters,
    /// Methods of compression.
    Codecs,
    /// Analytic BRDFs.
    Models,
    /// Factorisations of BRDFs.
    Factorisations,
    /// Methods of making materials larger.
    Syntheses,
    /// Samples of the virtual goniometer.
    Samples,
    /// Other renderers.
    Renderers,
}

/// One thing of a list.
struct Row {
    name: &'static str,
    doc: &'static str,
    params: &'static [Param],
}

impl What {
    fn name(self) -> String {
        self.to_possible_value().map_or(String::new(), |value| value.get_name().to_owned())
    }

    fn rows(self) -> Vec<Row> {
        let row = |name, doc, params| Row { name, doc, params };
        match self {
            Self::Formats => IMPORTERS.iter().map(|one| row(one.name(), one.doc(), one.params())).collect(),
            Self::Exporters => {
                let btfs = EXPORTERS.iter().map(|one| row(one.name(), one.doc(), one.params()));
                btfs.chain(BRDF_EXPORTERS.iter().map(|one| row(one.name(), one.doc(), one.params()))).collect()
            }
            Self::Codecs => CODECS.iter().map(|one| row(one.name(), one.doc(), one.params())).collect(),
            Self::Models => MODELS.iter().map(|one| row(one.name(), one.doc(), one.params())).collect(),
            Self::Factorisations => FACTORISATIONS.iter().map(|one| row(one.name(), one.doc(), one.params())).collect(),
            Self::Syntheses => SYNTHESES.iter().map(|one| row(one.name(), one.doc(), one.params())).collect(),
            Self::Samples => sample_kinds().iter().map(|one| row(one.name, one.doc, one.params)).collect(),
            Self::Renderers => RENDERERS.iter().map(|one| row(one.name(), one.doc(), &[])).collect(),
        }
    }
}

impl List {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        if let Some(what) = self.what {
            return print(what, terminal);
        }
        let all = What::value_variants();
        let value: Map<String, Value> = all.iter().map(|what| (what.name(), json(*what))).collect();
        terminal.result(&value, || all.iter().map(|what| format!("{}\n\n{}\n", what.name(), text(*what))).collect())
    }
}

/// Prints one list.
pub fn print(what: What, terminal: &Terminal) -> anyhow::Result<()> {
    terminal.result(&json(what), || text(what))
}

fn json(what: What) -> Value {
    let param = |p: &Param| {
        let (range, default) = (typed_range(p.kind), typed(p.kind, p.default));
        json!({ "name": p.name, "unit": p.unit, "range": range, "default": default, "doc": p.doc })
    };
    // `params` is what a material has; this is what it may have
    let row = |row: Row| {
        let parameters: Vec<Value> = row.params.iter().map(param).collect();
        json!({ "name": row.name, "doc": row.doc, "parameters": parameters })
    };
    what.rows().into_iter().map(row).collect()
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

fn text(what: What) -> String {
    let mut text = String::new();
    for Row { name, doc, params } in what.rows() {
        // writing to a string cannot fail
        let _ = writeln!(text, "{name}\n  {doc}");
        for p in params {
            let unit = if p.unit.is_empty() { String::new() } else { format!(" {}", p.unit) };
            let default = if p.is_optional() { String::new() } else { format!("; {}{unit}", p.default) };
            let _ = writeln!(text, "    {:<12} {} ({}{default})", p.name, p.doc, range(p.kind));
        }
    }
    text
}
