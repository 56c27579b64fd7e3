//! `loden sweep`: every method on one measurement, bytes against errors, with a page about it.

mod page;

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Arc;

use clap::Args;
use loden::btf::{BtfMeta, BtfSource};
use loden::codec::lossless::{Rate, rates};
use loden::codec::{self, CODECS, Codec};
use loden::direction::from_angles;
use loden::metric::{Detail, detail};
use loden::{Error, import, output};
use serde::Serialize;
use serde_json::Value;

use super::compare::{self, Row};
use super::demo::SHOWN;
use crate::flags::Assumptions;
use crate::terminal::Terminal;

#[derive(Args)]
pub struct Sweep {
    /// The measurement: anything `loden info` knows.
    source: PathBuf,
    /// The methods, or `all`.
    #[arg(long, value_delimiter = ',', default_value = "all", value_name = "NAME,...")]
    methods: Vec<String>,
    /// The folder for the page `index.html`, the figures `sweep.json` and the compressed files.
    #[arg(long, short, value_name = "DIR")]
    output: PathBuf,
    /// Small and noisy pictures, for a first look.
    #[arg(long)]
    draft: bool,
    #[command(flatten)]
    assumptions: Assumptions,
}

/// Settings of methods that published figures exist for; the others take places of their dial.
const SETTINGS: &[(&str, &[&[&str]])] = &[
    (
        "pvmf",
        &[
            &["components", "2"],
            &["components", "4"],
            &["components", "7"],
            &["components", "9"],
            &["components", "15"],
            &["components", "17"],
            &["components", "22"],
            &["components", "30"],
        ],
    ),
    ("pca", &[&["components", "4"], &["components", "16"], &["components", "64"]]),
    ("svd", &[&["components", "4"], &["components", "16"], &["components", "64"]]),
    (
        "median-cut",
        &[
            &["clusters", "64", "split", "longest-edge"],
            &["clusters", "256", "split", "balanced"],
            &["clusters", "256", "split", "longest-edge"],
            &["clusters", "400", "split", "longest-edge"],
        ],
    ),
    ("analytic", &[&["model", "lafortune"], &["model", "lafortune", "lobes", "2"], &["model", "ggx"]]),
];

/// Files for pictures are those nearest to the raw data over this.
const SHOWN_RATIO: f64 = 100.0;

/// Places of a dial that are swept.
const PLACES: [f64; 4] = [0.3, 0.45, 0.6, 0.75];

/// One file: what it cost, and where its errors are.
#[derive(Serialize)]
struct Entry {
    #[serde(flatten)]
    row: Row,
    /// The setting as flags.
    flags: String,
    /// Bytes of the tables that texels are evaluated from.
    resident_bytes: u64,
    detail: Detail,
    /// What general compressors would make of the file, for one file of each method.
    lossless: Vec<Rate>,
}

impl Sweep {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        let source = import::open(&self.source, &self.assumptions.options())?;
        terminal.warn(source.warnings());
        std::fs::create_dir_all(&self.output).map_err(Error::io(&self.output))?;
        let seen = seen(source.meta());
        let mut entries = Vec::new();
        for codec in self.codecs()? {
            for flags in settings(codec, source.meta()) {
                terminal.say(&format!("{} {}", codec.name(), flags.join(" ")));
                match self.measure(codec, &flags, &source, &seen, terminal) {
                    Ok(entry) => entries.push(entry),
                    Err(e) if matches!(e.downcast_ref(), Some(Error::Cancelled)) => return Err(e),
                    Err(e) => terminal.warn(&[format!("{} {}: {e}", codec.name(), flags.join(" "))]),
                }
            }
        }
        if entries.is_empty() {
            return Err(Error::parameter("methods", "none of them could compress this measurement").into());
        }
        for i in shown(&entries, source.meta()) {
            entries[i].lossless = rates(codec::open(&entries[i].row.file)?.as_ref())?;
        }
        let json = serde_json::to_string_pretty(&entries)?;
        output::write_file(self.output.join("sweep.json"), |file| file.write_all(json.as_bytes()))?;
        let html = page::Story { sweep: &self, source: &source, entries: &entries }.write(terminal)?;
        let page = self.output.join("index.html");
        output::write_file(&page, |file| file.write_all(html.as_bytes()))?;
        terminal.result(&entries, || {
            let rows: Vec<Row> = entries.iter().map(|entry| entry.row.clone()).collect();
            format!("{}\nLook at {}", compare::table(&rows), page.display())
        })
    }

    fn codecs(&self) -> loden::Result<Vec<&'static dyn Codec>> {
        if self.methods.iter().any(|name| name == "all") {
            return Ok(CODECS.to_vec());
        }
        self.methods.iter().map(|name| codec::by_name(name)).collect()
    }

    /// Compresses in a process of its own, so that the memory is the encoder's.
    fn measure(
        &self,
        codec: &dyn Codec,
        flags: &[String],
        source: &Arc<dyn BtfSource>,
        seen: &[(usize, usize)],
        terminal: &Terminal,
    ) -> anyhow::Result<Entry> {
        let words: Vec<&str> = flags.iter().map(|flag| flag.trim_start_matches('-')).collect();
        let path = self.output.join(format!("{}-{}.loden", codec.name(), words.join("-")));
        let encoded = self.encode(codec, flags, &path)?;
        let row = compare::compare(source.as_ref(), &path, false, terminal)?;
        let compressed = codec::open(&path)?;
        let detail = detail(source.as_ref(), compressed.as_ref(), seen, terminal)?;
        let row =
            Row { encode_s: encoded["encode_s"].as_f64(), peak_rss_bytes: encoded["peak_rss_bytes"].as_u64(), ..row };
        let resident_bytes = compressed.resident_bytes();
        Ok(Entry { row, flags: flags.join(" "), resident_bytes, detail, lossless: Vec::new() })
    }

    fn encode(&self, codec: &dyn Codec, flags: &[String], path: &Path) -> anyhow::Result<Value> {
        let mut command = Command::new(std::env::current_exe()?);
        command.arg("compress").arg(&self.source).arg("--output").arg(path).args(["--method", codec.name()]);
        command.args(["--no-error", "--json", "--quiet", "--threads", &rayon::current_num_threads().to_string()]);
        let done = command.args(self.assumptions.flags()).args(flags).stderr(Stdio::piped()).output()?;
        if !done.status.success() {
            anyhow::bail!("{}", String::from_utf8_lossy(&done.stderr).trim());
        }
        Ok(serde_json::from_slice(&done.stdout)?)
    }
}

/// The settings of a method as flags; those that a small measurement makes equal only once.
fn settings(codec: &dyn Codec, meta: &BtfMeta) -> Vec<Vec<String>> {
    let flags = |given: &[(&str, &str)]| -> Vec<String> {
        given.iter().flat_map(|(name, text)| [format!("--{name}"), (*text).to_owned()]).collect()
    };
    let published = SETTINGS.iter().find(|(name, _)| *name == codec.name()).map_or(&[][..], |(_, settings)| *settings);
    let mut all: Vec<Vec<String>> = published
        .iter()
        .map(|setting| flags(setting.as_chunks::<2>().0.iter().map(|[a, b]| (*a, *b)).collect::<Vec<_>>().as_slice()))
        .collect();
    if all.is_empty() {
        for place in PLACES {
            let dial = codec.dial(meta, place);
            all.push(flags(&dial.iter().map(|(name, text)| (*name, text.as_str())).collect::<Vec<_>>()));
        }
    }
    all.dedup();
    all
}

/// The pairs (view, light) nearest to those that pages show.
fn seen(meta: &BtfMeta) -> Vec<(usize, usize)> {
    let direction = |[theta, phi]: [f32; 2]| from_angles(theta.to_radians(), phi.to_radians());
    SHOWN.iter().map(|&(l, v)| (meta.views.nearest(direction(v)), meta.lights.nearest(direction(l)))).collect()
}

/// The methods in order.
fn methods(entries: &[Entry]) -> Vec<&str> {
    let mut methods: Vec<&str> = entries.iter().map(|entry| entry.row.method.as_str()).collect();
    methods.dedup();
    methods
}

/// For each method the entry with a file of middling size.
fn shown(entries: &[Entry], meta: &BtfMeta) -> Vec<usize> {
    let wanted = meta.raw8_bytes() as f64 / SHOWN_RATIO;
    let far = |i: &usize| (entries[*i].row.bytes as f64 / wanted).ln().abs();
    let nearest = |method: &str| {
        let of_method = (0..entries.len()).filter(|&i| entries[i].row.method == method);
        of_method.min_by(|a, b| far(a).total_cmp(&far(b)))
    };
    methods(entries).into_iter().filter_map(nearest).collect()
}
