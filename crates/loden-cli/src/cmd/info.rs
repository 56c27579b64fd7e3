//! `loden info`: what a measurement or a compressed material is.

use std::fmt::Write;
use std::path::PathBuf;

use clap::Args;
use loden::job;
use serde_json::Value;

use crate::flags::Assumptions;
use crate::report;
use crate::terminal::Terminal;

#[derive(Args)]
#[command(after_long_help = "\
Examples:
  loden info wool.zip
  loden info wool.loden --json
  loden info ggx:alpha-x=0.2")]
pub struct Info {
    /// A BTF, BRDF or .loden file or a folder of images, recognised by content; or a model such as `ward:alpha-x=0.1`.
    source: PathBuf,
    #[command(flatten)]
    assumptions: Assumptions,
}

impl Info {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        let opened = job::open(&self.source, self.assumptions.given(), terminal)?;
        let description = serde_json::to_value(job::describe(&opened)?)?;
        terminal.result(&description, || text(&description))
    }
}

fn text(description: &Value) -> String {
    let mut text = String::new();
    for (key, value) in description.as_object().into_iter().flatten() {
        let value = match value {
            Value::Array(list) if list.iter().all(Value::is_number) && !list.is_empty() => {
                list.iter().map(ToString::to_string).collect::<Vec<_>>().join(" ")
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

/// A word without its quotes, anything else as in JSON.
fn plain(value: &Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_owned)
}
