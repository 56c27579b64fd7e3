//! `loden info`: what a measurement or a compressed material is.

use std::fmt::Write;
use std::path::PathBuf;

use clap::Args;
use loden::job::{self, Description};
use serde::Serialize;
use serde_json::{Value, json};

use crate::flags::Assumptions;
use crate::report;
use crate::terminal::Terminal;

#[derive(Args)]
#[command(after_long_help = "\
Examples:
  loden info wool.zip
  loden info wool.loden --json
  loden info *.zip --check
  loden info ggx:alpha-x=0.2")]
pub struct Info {
    /// BTF, BRDF or .loden files or folders of images, recognised by content; or models such as `ward:alpha-x=0.1`.
    #[arg(required = true)]
    sources: Vec<PathBuf>,
    /// Read every picture, and report those that cannot be read.
    ///
    /// The range of values is then that of all images. The exit status is 1 if an image cannot be read.
    #[arg(long)]
    check: bool,
    #[command(flatten)]
    assumptions: Assumptions,
}

/// A source and its description.
#[derive(Serialize)]
struct Described<'a> {
    file: &'a PathBuf,
    #[serde(flatten)]
    description: Description,
}

impl Info {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        if let [source] = &self.sources[..] {
            let description = self.describe(source, terminal)?;
            let (value, unreadable) =
                (value(&Described { file: source, description: description.clone() })?, unreadable(&description));
            terminal.result(&value, || text(&value))?;
            return if unreadable == 0 { Ok(()) } else { Err(failed(unreadable)) };
        }
        let (mut values, mut problems) = (Vec::new(), 0);
        for source in &self.sources {
            match self.describe(source, terminal) {
                Ok(description) => {
                    problems += usize::from(unreadable(&description) > 0);
                    values.push(value(&Described { file: source, description })?);
                }
                Err(loden::Error::Cancelled) => return Err(loden::Error::Cancelled.into()),
                Err(error) => {
                    problems += 1;
                    values.push(json!({ "file": source, "error": error.to_string() }));
                }
            }
        }
        terminal.result(&values, || values.iter().map(text).collect::<Vec<_>>().join("\n"))?;
        match problems {
            0 => Ok(()),
            _ => anyhow::bail!("{} cannot be read as a whole", report::count(problems, "source")),
        }
    }

    fn describe(&self, source: &PathBuf, terminal: &Terminal) -> loden::Result<Description> {
        let import = self.assumptions.given();
        // of several sources each takes the options that its format has
        let opened = match self.sources.len() {
            1 => job::open(source, import, terminal)?,
            _ => job::open_among(source, import, terminal)?,
        };
        job::describe(&opened, self.check, terminal)
    }
}

fn failed(unreadable: usize) -> anyhow::Error {
    anyhow::anyhow!("{} cannot be read", report::count(unreadable, "image"))
}

fn unreadable(description: &Description) -> usize {
    match description {
        Description::Btf(btf) => btf.unreadable.len(),
        Description::Compressed(compressed) => compressed.btf.unreadable.len(),
        Description::Brdf(_) => 0,
    }
}

/// As JSON; through text, in which numbers of single precision stay short.
fn value(described: &Described) -> serde_json::Result<Value> {
    serde_json::from_str(&serde_json::to_string(described)?)
}

fn text(description: &Value) -> String {
    let mut text = String::new();
    for (key, value) in description.as_object().into_iter().flatten() {
        if let ("unreadable" | "duplicates" | "history", Value::Array(list)) = (key.as_str(), value) {
            list.iter().for_each(|problem| text += &format!("{key:>16}  {}\n", plain(problem)));
            continue;
        }
        let value = match value {
            Value::Array(list) if list.iter().all(Value::is_number) && !list.is_empty() => {
                list.iter().map(plain).collect::<Vec<_>>().join(" ")
            }
            Value::Array(list) => format!("{}", list.len()),
            Value::Object(map) => {
                map.iter().map(|(name, value)| format!("{name}={}", plain(value))).collect::<Vec<_>>().join(" ")
            }
            Value::Number(number) if key.ends_with("bytes") => report::bytes(number.as_u64().unwrap_or(0)),
            other => plain(other),
        };
        let _ = writeln!(text, "{key:>16}  {value}");
    }
    text
}

/// A word without its quotes, a fraction with six digits, anything else as in JSON.
fn plain(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Number(number) if number.is_f64() => report::short(number.as_f64().unwrap_or(f64::NAN)),
        other => other.to_string(),
    }
}
