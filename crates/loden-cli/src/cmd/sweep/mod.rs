//! `loden sweep`: every method on one measurement, bytes against errors, with a page about it.

mod page;

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use clap::Args;
use loden::codec::{self, CODECS, Codec};
use loden::job::{self, Comparison, Cost, Setting, Sweeping, Swept, Trouble};
use loden::output;
use loden::progress::Progress;

use super::compare;
use crate::choice::{self, ALL};
use crate::flags::Assumptions;
use crate::outputs::Outputs;
use crate::report;
use crate::terminal::{Terminal, quoted};

#[derive(Args)]
#[command(after_long_help = "\
Examples:
  loden sweep wool.zip -o swept
  loden sweep wool.zip --methods pvmf,klt --draft -o swept")]
pub struct Sweep {
    /// The BTF: any file or folder that `loden info` recognises.
    source: PathBuf,
    /// Methods, separated by commas.
    #[arg(long, value_delimiter = ',', default_value = ALL, value_name = "NAME,...", value_parser = choice::methods_or_all())]
    methods: Vec<String>,
    /// Folder for the page index.html, the figures sweep.json and the compressed files.
    ///
    /// With the method pvmf also components.png: one image for every number of components.
    #[arg(long, short, value_name = "DIR")]
    output: PathBuf,
    /// Render small, noisy pictures, for a first look.
    #[arg(long)]
    draft: bool,
    #[command(flatten)]
    assumptions: Assumptions,
}

impl Sweep {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        Outputs::new(terminal, [&self.source]).folder(&self.output)?;
        let source = job::open_btf(&self.source, self.assumptions.given(), terminal)?;
        output::create_folder(&self.output)?;
        let codecs = self.codecs()?;
        let encode = |codec: &'static dyn Codec, setting: &Setting, path: &Path| self.encode(codec, setting, path);
        let sweeping = Sweeping { source: source.as_ref(), codecs: &codecs, folder: &self.output, encode: &encode };
        let Swept { rows, failed } = job::sweep(&sweeping, terminal)?;
        let json = serde_json::to_string_pretty(&rows)?;
        output::write_file(self.output.join("sweep.json"), |file| file.write_all(json.as_bytes()))?;
        let story = page::Story { sweep: &self, source: &source, rows: &rows };
        let html = story.write(terminal)?;
        if let Some(picture) = story.components(None)? {
            picture.write_noted(self.output.join("components.png"), terminal.command())?;
        }
        let page = self.output.join("index.html");
        output::write_file(&page, |file| file.write_all(html.as_bytes()))?;
        terminal.result(&rows, || {
            let rows: Vec<Comparison> = rows.iter().map(|row| row.row.clone()).collect();
            format!("{}\nLook at {}", compare::table(&rows), page.display())
        })?;
        if !failed.is_empty() {
            anyhow::bail!("{} failed: {}", report::count(failed.len(), "setting"), failed.join(", "));
        }
        Ok(())
    }

    /// The command line of this sweep.
    fn command(&self) -> String {
        let [source, output] = [&self.source, &self.output].map(|path| quoted(&path.display().to_string()));
        let draft = if self.draft { " --draft" } else { "" };
        let assumptions: String =
            self.assumptions.arguments().iter().map(|word| format!(" {}", quoted(word))).collect();
        format!("loden sweep {source} --methods {}{draft}{assumptions} -o {output}", self.methods.join(","))
    }

    fn codecs(&self) -> loden::Result<Vec<&'static dyn Codec>> {
        if self.methods.iter().any(|name| name == ALL) {
            return Ok(CODECS.to_vec());
        }
        self.methods.iter().map(|name| codec::by_name(name)).collect()
    }

    /// Compresses in a process of its own, so that the memory is the encoder's.
    fn encode(&self, codec: &dyn Codec, setting: &Setting, path: &Path) -> Result<Cost, Trouble> {
        let failed = |problem: String| Trouble::Failed(problem);
        let program = std::env::current_exe().map_err(|error| failed(error.to_string()))?;
        let mut command = Command::new(program);
        command.arg("compress").arg(&self.source).arg("--output").arg(path).args(["--method", codec.name()]);
        command.args([
            "--no-error",
            "--json",
            "--quiet",
            "--force",
            "--threads",
            &rayon::current_num_threads().to_string(),
        ]);
        command.args(self.assumptions.arguments());
        command.args(setting.iter().map(|(name, text)| format!("--{name}={text}")));
        let done = command.stderr(Stdio::piped()).output().map_err(|error| failed(error.to_string()))?;
        let problem = || String::from_utf8_lossy(&done.stderr).trim().trim_start_matches("error: ").to_owned();
        match done.status.code() {
            Some(0) => serde_json::from_slice(&done.stdout).map_err(|error| failed(error.to_string())),
            Some(2) => Err(Trouble::Unsuitable(problem())),
            _ => Err(failed(problem())),
        }
    }
}
