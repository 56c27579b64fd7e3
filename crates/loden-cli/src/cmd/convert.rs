//! `loden convert`: a measurement in another form, and what that cost.

use std::path::PathBuf;

use clap::Args;
use loden::btf::BtfSource;
use loden::export::{self, ColorModel, ImageFormat};
use loden::import::{self, Measured, Options};
use loden::material::Brdf;
use loden::progress::Progress;
use loden::{job, metric};
use serde_json::{Map, Value, json};

use crate::flags::Assumptions;
use crate::terminal::Terminal;

#[derive(Args)]
pub struct Convert {
    /// Anything `loden info` knows.
    source: PathBuf,
    /// A BTF: `.zip` or a folder (Bonn layout), `.toml` (raw array, the quickest to read), `.btf`. A BRDF: `.bsdf`
    /// (Mitsuba 3, pbrt), `.binary` (MERL), `.astm`, `.exr` (one slice).
    output: PathBuf,
    /// The format by name, where the ending does not tell: raw, dfmf, fmf, bdi, ubo2003; rgl, merl, astm, slice.
    #[arg(long, value_name = "NAME")]
    to: Option<String>,
    /// Components of each factorisation of a .btf file.
    #[arg(long, default_value_t = 32)]
    components: usize,
    /// Single instead of half precision in a .btf file.
    #[arg(long)]
    single: bool,
    /// The colours in which a .btf file is factored.
    #[arg(long, default_value = "yuv-log")]
    color_model: ColorModelFlag,
    /// Do not read the output again to say how far it is from the source.
    #[arg(long)]
    no_check: bool,
    #[command(flatten)]
    pictures: Pictures,
    #[command(flatten)]
    assumptions: Assumptions,
}

/// See [`ColorModel`].
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum ColorModelFlag {
    YuvLog,
    RgbLog,
    Rgb,
    Yuv,
    Ycocg,
}

/// How pictures are stored.
#[derive(Args)]
pub struct Pictures {
    /// Store lossless PNG instead of JPEG.
    #[arg(long)]
    png: bool,
    /// Store EXR, linear light in half precision, instead of JPEG.
    #[arg(long, conflicts_with = "png")]
    exr: bool,
    /// JPEG quality.
    #[arg(long, default_value_t = 95, value_parser = clap::value_parser!(u8).range(1..=100))]
    quality: u8,
}

impl Pictures {
    pub fn options(&self) -> export::Options {
        let image = match (self.png, self.exr) {
            (true, _) => ImageFormat::Png,
            (_, true) => ImageFormat::ExrHalf,
            _ => ImageFormat::Jpeg(self.quality),
        };
        export::Options { image, ..export::Options::default() }
    }
}

impl Convert {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        let result = match job::open(&self.source, &self.assumptions.options(), terminal)?.measured.images() {
            Ok(source) => self.btf(source.as_ref(), terminal)?,
            Err(brdf) => self.brdf(brdf.as_ref())?,
        };
        terminal.result(&result, || text(&result))
    }

    fn btf(&self, source: &dyn BtfSource, terminal: &Terminal) -> anyhow::Result<Map<String, Value>> {
        let exporter = export::by_name(&self.output, self.to.as_deref())?;
        let color_model = match self.color_model {
            ColorModelFlag::YuvLog => ColorModel::YuvLog,
            ColorModelFlag::RgbLog => ColorModel::RgbLog,
            ColorModelFlag::Rgb => ColorModel::Rgb,
            ColorModelFlag::Yuv => ColorModel::Yuv,
            ColorModelFlag::Ycocg => ColorModel::Ycocg,
        };
        let (components, half) = (self.components, !self.single);
        let options = export::Options { components, half, color_model, ..self.pictures.options() };
        export::export_as(exporter, source, &self.output, &options, terminal)?;
        let mut result = Map::new();
        result.insert("output".into(), json!(self.output));
        result.insert("format".into(), json!(exporter.name()));
        result.insert("images".into(), json!(source.meta().pairs()));
        result.insert("lost".into(), json!(lost(exporter.name(), source)));
        if !self.no_check {
            let back = import::open(&self.output, &Options::default())?;
            match metric::compare(source, back.as_ref(), terminal) {
                Ok(report) => {
                    result.insert("mean_error".into(), json!(report.mean_abs_error));
                    result.insert("largest_error".into(), json!(report.max_abs_error));
                }
                // pictures have the cosine in them whatever the source has
                Err(loden::Error::Parameter { problem, .. }) => terminal.warn(&format!("not compared: {problem}")),
                Err(other) => return Err(other.into()),
            }
        }
        Ok(result)
    }

    fn brdf(&self, brdf: &dyn Brdf) -> anyhow::Result<Map<String, Value>> {
        let exporter = export::brdf_exporter(&self.output, self.to.as_deref())?;
        let samples = brdf.samples();
        exporter.write(brdf, &samples, &self.output)?;
        let mut result = Map::new();
        result.insert("output".into(), json!(self.output));
        result.insert("format".into(), json!(exporter.name()));
        result.insert("samples".into(), json!(samples.len()));
        result.insert("lost".into(), json!(exporter.losses(brdf)));
        if !self.no_check
            && let Ok((_, Measured::Brdf(back))) = import::open_named(&self.output, &Options::default())
        {
            let found = metric::round_trip(&samples, back.as_ref());
            result.insert("relative_error".into(), json!(found.relative_error));
            result.insert("largest_error".into(), json!(found.largest_error));
        }
        Ok(result)
    }
}

/// What a format of BTFs cannot hold.
fn lost(format: &str, source: &dyn BtfSource) -> Vec<&'static str> {
    let mut lost = match format {
        "raw" => vec![],
        "ubo2003" => vec!["what pictures of this kind cannot hold: finer steps, and light beyond 1 unless EXR"],
        "bdi" => vec!["precision beyond 11 bits"],
        _ => vec!["what the components leave over"],
    };
    if !source.missing().is_empty() {
        lost.push("which pairs were not measured: they hold their substitutes");
    }
    lost
}

fn text(result: &Map<String, Value>) -> String {
    let word = |key: &str| result.get(key).and_then(Value::as_str).unwrap_or_default().to_owned();
    let count = result.get("images").map(|n| format!("{n} images"));
    let count = count.unwrap_or_else(|| format!("{} samples", result.get("samples").unwrap_or(&Value::Null)));
    let mut text = format!("{}: {}, {count}\n", word("output"), word("format"));
    for (key, name) in [
        ("mean_error", "mean error of display values"),
        ("relative_error", "error relative to the values, cosine-weighted"),
        ("largest_error", "largest"),
    ] {
        if let Some(error) = result.get(key).and_then(Value::as_f64) {
            text += &format!("{name}: {error:.6}\n");
        }
    }
    for lost in result.get("lost").and_then(Value::as_array).into_iter().flatten() {
        text += &format!("lost: {}\n", lost.as_str().unwrap_or_default());
    }
    text
}
