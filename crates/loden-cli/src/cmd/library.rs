//! `loden library`: a folder of materials.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use loden::library::{AddOptions, Finding, Library as Folder, Record};
use loden::{Error, codec};
use serde_json::{Value, json};

use super::compress::{self, Codecs};
use crate::choice::{self, NONE};
use crate::flags::{Assumptions, Flags};
use crate::report;
use crate::terminal::Terminal;

#[derive(Args)]
pub struct Library {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Add a measurement: copy or link it, compress it and write checksums.
    Add(Add),
    /// Add compressed forms to a BTF of the library.
    Compress(Forms),
    /// List the materials.
    List {
        /// The folder of the library.
        library: PathBuf,
    },
    /// Describe a material and its compressed forms.
    Show {
        /// The folder of the library.
        library: PathBuf,
        /// The material.
        name: String,
    },
    /// Read every file and report what is damaged or missing.
    ///
    /// The exit status is 1 if a file is.
    Verify {
        /// The folder of the library.
        library: PathBuf,
        /// Materials to check [default: all].
        names: Vec<String>,
    },
    /// Remove a material and its files; a linked original stays.
    Remove {
        /// The folder of the library.
        library: PathBuf,
        /// The material.
        name: String,
    },
}

#[derive(Args)]
#[command(after_long_help = compress::epilogue(&["loden library add shelf wool.zip --methods pvmf --components 9"]))]
struct Add {
    /// The folder of the library; it is created if necessary.
    library: PathBuf,
    /// The measurement: any file or folder that `loden info` recognises.
    source: PathBuf,
    /// Name of the material [default: the name of the file].
    #[arg(long)]
    name: Option<String>,
    /// Leave the original where it is instead of copying it.
    #[arg(long)]
    link: bool,
    /// Methods to compress a BTF by, separated by commas.
    #[arg(long, value_delimiter = ',', default_value = codec::DEFAULT, value_name = "METHOD,...", value_parser = choice::methods_or_none())]
    methods: Vec<String>,
    #[command(flatten)]
    assumptions: Assumptions,
    #[command(flatten)]
    params: Flags<Codecs>,
}

#[derive(Args)]
#[command(after_long_help = compress::epilogue(&["loden library compress shelf wool --methods klt,median-cut --clusters 256"]))]
struct Forms {
    /// The folder of the library.
    library: PathBuf,
    /// The material.
    name: String,
    /// Methods to compress it by, separated by commas.
    #[arg(long, required = true, value_delimiter = ',', value_name = "METHOD,...", value_parser = choice::method())]
    methods: Vec<String>,
    #[command(flatten)]
    assumptions: Assumptions,
    #[command(flatten)]
    params: Flags<Codecs>,
}

impl Library {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        match self.command {
            Command::Add(add) => add.run(terminal),
            Command::Compress(forms) => forms.run(terminal),
            Command::List { library } => list(&Folder::new(library), terminal),
            Command::Show { library, name } => {
                let record = Folder::new(library).record(&name)?;
                terminal.result(&shown(&name, &record), || show(&name, &record))
            }
            Command::Verify { library, names } => verify(&Folder::new(library), &names, terminal),
            Command::Remove { library, name } => {
                Folder::new(&library).remove(&name)?;
                let value = json!({ "library": library, "name": name });
                terminal.result(&value, || format!("removed {name} from {}", library.display()))
            }
        }
    }
}

impl Add {
    fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        let stem = self.source.file_stem().map(|stem| stem.to_string_lossy().into_owned());
        let missing =
            || Error::parameter("name", format!("{} has no name to take; give one by --name", self.source.display()));
        let name = self.name.or(stem).ok_or_else(missing)?;
        let methods = self.methods.into_iter().filter(|method| method != NONE).collect();
        let (params, import) = (self.params.given().clone(), self.assumptions.given().clone());
        let options = AddOptions { link: self.link, methods, params, import };
        let record = Folder::new(self.library).add(&name, &self.source, &options, terminal)?;
        terminal.result(&shown(&name, &record), || show(&name, &record))
    }
}

impl Forms {
    fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        let (params, import) = (self.params.given().clone(), self.assumptions.given().clone());
        let options = AddOptions { link: false, methods: self.methods, params, import };
        let record = Folder::new(self.library).compress(&self.name, &options, terminal)?;
        terminal.result(&shown(&self.name, &record), || show(&self.name, &record))
    }
}

fn shown(name: &str, record: &Record) -> Value {
    let bytes: u64 = record.files.values().map(|file| file.bytes).sum();
    let mut material = json!(record);
    for (i, form) in record.compressed.iter().enumerate() {
        // parameters that this program does not know stay as they are written
        if let Ok(values) = form.values() {
            material["compressed"][i]["params"] = json!(values);
        }
    }
    json!({ "name": name, "bytes": bytes, "material": material })
}

fn show(name: &str, record: &Record) -> String {
    let mut rows = vec![("name", name.to_owned()), ("kind", record.kind.clone())];
    rows.push(("original", record.original.display().to_string()));
    rows.extend(record.facts.iter().map(|(name, value)| (name.as_str(), value.clone())));
    if !record.notes.is_empty() {
        rows.push(("notes", record.notes.clone()));
    }
    for form in &record.compressed {
        let text = format!(
            "{}, mean error {:.4}, largest {:.3}, PSNR {:.2} dB, SSIM {:.4}",
            report::bytes(form.bytes),
            form.mean_abs_error,
            form.max_abs_error,
            form.psnr_db,
            form.ssim
        );
        rows.push((&form.method, text));
        rows.push(("", format!("{}: {}", form.file.display(), form.params)));
    }
    rows.push(("files", record.files.len().to_string()));
    rows.iter().map(|(name, value)| format!("{name:>16}  {value}\n")).collect()
}

/// Lists a material whose description cannot be read with the reason.
fn list(library: &Folder, terminal: &Terminal) -> anyhow::Result<()> {
    let names = library.names()?;
    let records: Vec<_> = names.iter().map(|name| library.record(name)).collect();
    let value: Vec<Value> = names
        .iter()
        .zip(&records)
        .map(|(name, record)| match record {
            Ok(record) => shown(name, record),
            Err(error) => json!({ "name": name, "error": error.to_string() }),
        })
        .collect();
    let row = |(name, record): (&String, &loden::Result<Record>)| match record {
        Ok(record) => {
            let fact = |key: &str| record.facts.get(key).cloned().unwrap_or_default();
            let methods: Vec<_> = record.compressed.iter().map(|form| form.method.as_str()).collect();
            let bytes = record.files.values().map(|file| file.bytes).sum();
            vec![
                name.clone(),
                record.kind.clone(),
                fact("holds"),
                fact("size"),
                methods.join(","),
                report::bytes(bytes),
            ]
        }
        Err(error) => vec![name.clone(), format!("{error}"), "-".into(), "-".into(), "-".into(), "-".into()],
    };
    let rows: Vec<_> = names.iter().zip(&records).map(row).collect();
    terminal.result(&value, || report::table(&["name", "kind", "holds", "size", "compressed", "bytes"], &rows))
}

fn verify(library: &Folder, names: &[String], terminal: &Terminal) -> anyhow::Result<()> {
    let findings = library.verify(names, terminal)?;
    let damaged = findings.iter().filter(|finding| finding.damage).count();
    let checked = if names.is_empty() { library.names()?.len() } else { names.len() };
    let value = json!({ "materials": checked, "damaged": damaged, "findings": findings });
    let line = |f: &Finding| format!("{} {}: {}\n", f.material, f.file, f.problem);
    terminal.result(&value, || {
        let lines: String = findings.iter().map(line).collect();
        let [checked, damaged] =
            [(checked, "material"), (damaged, "damaged file")].map(|(n, what)| report::count(n, what));
        format!("{lines}{checked}, {damaged}")
    })?;
    if damaged > 0 {
        anyhow::bail!("{} damaged or missing", report::count(damaged, "file"));
    }
    Ok(())
}
