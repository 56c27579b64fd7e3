//! `loden fit`: analytic models fitted to a measured BRDF, ranked.

use std::path::PathBuf;

use clap::Args;
use loden::fit::{Metric, Options};
use loden::job::{self, Assignment, FitAt, FitRequest, Ranked};

use crate::choice::{self, ALL};
use crate::flags::Assumptions;
use crate::outputs::Outputs;
use crate::report;
use crate::terminal::Terminal;

#[derive(Args)]
#[command(after_long_help = "\
Examples:
  loden fit gold.binary --spheres ranking.png
  loden fit wool.zip --model ggx --json")]
pub struct Fit {
    /// A BRDF file, a BTF (averaged over its texels), a model such as `ward:alpha-x=0.1`, or samples in a .csv file.
    ///
    /// The columns of a .csv file are theta_i, phi_i, theta_o, phi_o in degrees and r, g, b in 1/sr.
    source: PathBuf,
    /// Model; `loden brdf models` lists the parameters.
    #[arg(long, default_value = ALL, value_parser = choice::model_or_all())]
    model: String,
    /// Directions at which the BRDF is sampled.
    #[arg(long, value_enum, default_value = "even")]
    at: At,
    /// Number of lobes, for models that can have several.
    #[arg(long, value_name = "N", default_value_t = 1)]
    lobes: usize,
    /// Error to minimise: root mean square of the difference of this quantity.
    ///
    /// Of all choices of directions and error, the defaults give fits that look most like the original when rendered.
    #[arg(long, value_enum, default_value = "log")]
    metric: MetricFlag,
    /// Minimum number of starting points of the search.
    #[arg(long, value_name = "N", default_value_t = 12)]
    starts: usize,
    /// Seed of the starting points.
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Whether the fit may be anisotropic [default: as the source].
    #[arg(long, value_name = "BOOL")]
    anisotropic: Option<bool>,
    /// Value of a parameter that is a word, which is not fitted; may be repeated.
    #[arg(long, value_name = "NAME=VALUE")]
    set: Vec<Assignment>,
    /// Render a row of spheres, the original first, then the fits by rank: .png or .exr.
    #[arg(long, value_name = "FILE")]
    spheres: Option<PathBuf>,
    /// Plot polar slices of the original and the best fits, .svg.
    #[arg(long, value_name = "FILE")]
    polar: Option<PathBuf>,
    /// Write the samples in use to a .csv file.
    #[arg(long, value_name = "FILE")]
    dump: Option<PathBuf>,
    #[command(flatten)]
    assumptions: Assumptions,
}

/// See [`FitAt`].
#[derive(Debug, Clone, Copy, PartialEq, clap::ValueEnum)]
enum At {
    /// The nodes of its table.
    Nodes,
    /// Pairs of directions spread evenly up to 80 degrees from the normal.
    Even,
}

/// See [`Metric`].
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum MetricFlag {
    /// f cos, the reflected light.
    Cosine,
    /// ln(1 + f cos).
    Log,
    /// The cube root of f cos, close to perceived lightness.
    CubeRoot,
}

impl Fit {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        let outputs = Outputs::new(terminal, [&self.source]);
        let dump = outputs.optional(self.dump.as_ref(), &[])?;
        let spheres = outputs.optional(self.spheres.as_ref(), &["png", "exr"])?;
        let polar = outputs.optional(self.polar.as_ref(), &["svg"])?;
        let ranking = job::rank(&self.request(), terminal)?;
        if let Some(target) = dump {
            job::write_samples(target.path(), &ranking.data.samples())?;
            target.finish()?;
        }
        if let Some(target) = spheres {
            ranking.write_spheres(target.path(), terminal)?;
            target.finish()?;
        }
        if let Some(target) = polar {
            ranking.write_polar(target.path())?;
            target.finish()?;
        }
        terminal.result(&ranking, || table(&ranking.fits))
    }

    fn request(&self) -> FitRequest {
        let metric = match self.metric {
            MetricFlag::Cosine => Metric::Cosine,
            MetricFlag::Log => Metric::Logarithmic,
            MetricFlag::CubeRoot => Metric::CubeRoot,
        };
        let (starts, seed, lobes) = (self.starts, self.seed, self.lobes);
        FitRequest {
            source: self.source.clone(),
            model: Some(self.model.clone()).filter(|model| model != ALL),
            fixed: self.set.clone(),
            at: match self.at {
                At::Nodes => FitAt::Nodes,
                At::Even => FitAt::Even,
            },
            options: Options { metric, starts, seed, lobes, ..Options::default() },
            anisotropic: self.anisotropic,
            import: self.assumptions.given().clone(),
        }
    }
}

/// Numbers with six significant digits.
fn short(text: &str) -> String {
    let number = |word: &str| word.parse::<f64>().map_or(word.to_owned(), report::short);
    text.split(',').map(number).collect::<Vec<_>>().join(",")
}

fn table(fits: &[Ranked]) -> String {
    let cells = |fit: &Ranked| {
        let numbers = [(fit.error, 5), (fit.relative_error, 4), (fit.seconds, 2)];
        [vec![fit.model.to_owned()], numbers.map(|(value, digits)| format!("{value:.digits$}")).to_vec()].concat()
    };
    let mut text = report::table(&["model", "error", "relative", "s"], &fits.iter().map(cells).collect::<Vec<_>>());
    if let [best, ..] = fits {
        let value = |(name, text): (&str, &str)| format!("{name}={}", short(text));
        let values: Vec<_> = best.params.iter().filter(|(_, text)| !text.is_empty()).map(value).collect();
        text += &format!("\nThe best, as a material: {}:{}", best.model, values.join(":"));
    }
    text
}
