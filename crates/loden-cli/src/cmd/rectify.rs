//! `loden rectify`: raw photographs made into a BTF.

use std::borrow::Cow;
use std::path::PathBuf;
use std::time::Instant;

use clap::Args;
use loden::btf::Texels;
use loden::export;
use loden::rectify::{Options, Outcome, Photographs};
use serde_json::{Value, json};

use super::convert::Pictures;
use crate::terminal::Terminal;

#[derive(Args)]
pub struct Rectify {
    /// A TOML file that describes the photographs.
    manifest: PathBuf,
    /// `.zip` or a folder (Bonn layout), `.btf`, or `.toml` (raw array of linear f32).
    #[arg(long, short)]
    output: PathBuf,
    /// Texels per side of the images.
    #[arg(long, default_value_t = Options::default().size)]
    size: usize,
    /// Refuse photographs whose frame's edges are off by more pixels than this, root mean square.
    #[arg(long, default_value_t = Options::default().max_error, value_name = "PIXELS")]
    max_error: f64,
    #[command(flatten)]
    pictures: Pictures,
}

impl Rectify {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        let start = Instant::now();
        let options = Options { size: self.size, max_error: self.max_error };
        let photographs = Photographs::open(&self.manifest)?;
        let mut writer = export::create(&self.output, &photographs.meta(&options), &self.pictures.options())?;
        let outcomes =
            photographs.rectify(&options, terminal, &mut |texels| writer.view(&Texels::F32(Cow::Owned(texels))))?;
        writer.finish()?;
        let refused: Vec<&Outcome> = outcomes.iter().filter(|outcome| outcome.refused.is_some()).collect();
        let reasons: Vec<String> = refused.iter().map(|outcome| reason(outcome)).collect();
        terminal.warn(&reasons);
        let mut errors: Vec<f64> = outcomes.iter().filter_map(|outcome| outcome.error).collect();
        errors.sort_by(f64::total_cmp);
        let (median, largest) = (errors.get(errors.len() / 2), errors.last());
        let saturated = outcomes.iter().filter(|outcome| outcome.saturated > 0).count();
        let seconds = start.elapsed().as_secs_f64();
        let rows: Vec<Value> = outcomes.iter().map(row).collect();
        let value = json!({
            "output": self.output,
            "images": outcomes.len(),
            "size": self.size,
            "median_error_px": median,
            "largest_error_px": largest,
            "saturated": saturated,
            "refused": refused.len(),
            "photographs": rows,
            "seconds": seconds,
        });
        terminal.result(&value, || {
            let mut text = format!("{}: {} images, {seconds:.1} s\n", self.output.display(), outcomes.len());
            if let (Some(median), Some(largest)) = (median, largest) {
                text += &format!("edges of the frame: median error {median:.3} pixels, largest {largest:.3}\n");
            }
            if saturated > 0 {
                text += &format!("saturated pixels in {saturated} photographs\n");
            }
            if !refused.is_empty() {
                text += &format!("refused: {}; they repeat the nearest light of their view\n", refused.len());
            }
            text
        })
    }
}

fn reason(outcome: &Outcome) -> String {
    format!("{} is refused: {}", outcome.file.display(), outcome.refused.as_deref().unwrap_or_default())
}

fn row(outcome: &Outcome) -> Value {
    json!({
        "file": outcome.file,
        "view": outcome.pair[0],
        "light": outcome.pair[1],
        "error_px": outcome.error,
        "saturated": outcome.saturated,
        "refused": outcome.refused,
    })
}
