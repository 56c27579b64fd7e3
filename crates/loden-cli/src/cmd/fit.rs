//! `loden fit`: analytic models fitted to a measured BRDF, ranked.

use std::path::PathBuf;

use clap::Args;
use loden::fit::{Metric, Options};
use loden::job::{self, Assignment, FitAt, FitRequest, Ranked};

use crate::flags::Assumptions;
use crate::report;
use crate::terminal::Terminal;

#[derive(Args)]
pub struct Fit {
    /// A BRDF file, a BTF (averaged), a model such as `ward:alpha-x=0.1`, or samples in a .csv file: theta_i, phi_i,
    /// theta_o, phi_o in degrees, r, g, b in 1/sr.
    source: PathBuf,
    /// A model's name, or `all`; `loden brdf models` lists them.
    #[arg(long, default_value = "all")]
    model: String,
    /// Where the BRDF is compared: at the nodes of its table, or at pairs of directions spread evenly up to 80 degrees.
    #[arg(long, value_enum, default_value = "nodes")]
    at: At,
    /// Lobes of the models that have several.
    #[arg(long, default_value_t = 1)]
    lobes: usize,
    /// What is made small: root mean square of f cos, of ln(1 + f cos), or of the cube root of f cos.
    #[arg(long, value_enum, default_value = "cosine")]
    metric: MetricFlag,
    /// Places from which the search starts, at least.
    #[arg(long, default_value_t = 12)]
    starts: usize,
    /// Another seed tries other places.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Whether the surface has a grain [default: what the source says of itself].
    #[arg(long)]
    anisotropic: Option<bool>,
    /// A parameter of the model that is a word and so does not vary; may be repeated.
    #[arg(long, value_name = "NAME=VALUE")]
    set: Vec<Assignment>,
    /// A row of spheres, the original first, then the fits by rank: .png or .exr.
    #[arg(long, value_name = "FILE")]
    spheres: Option<PathBuf>,
    /// Polar slices of the original and the best fits, .svg.
    #[arg(long, value_name = "FILE")]
    polar: Option<PathBuf>,
    /// Writes the samples that are used in the form of a .csv source.
    #[arg(long, value_name = "FILE")]
    dump: Option<PathBuf>,
    #[command(flatten)]
    assumptions: Assumptions,
}

/// Which samples a model is fitted to.
#[derive(Debug, Clone, Copy, PartialEq, clap::ValueEnum)]
enum At {
    Nodes,
    Even,
}

/// See [`Metric`].
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum MetricFlag {
    Cosine,
    Log,
    CubeRoot,
}

impl Fit {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        let ranking = job::rank(&self.request(), terminal)?;
        if let Some(path) = &self.dump {
            job::write_samples(path, &ranking.data.samples())?;
        }
        if let Some(path) = &self.spheres {
            ranking.write_spheres(path, terminal)?;
        }
        if let Some(path) = &self.polar {
            ranking.write_polar(path)?;
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
            model: Some(self.model.clone()).filter(|model| model != "all"),
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

fn table(fits: &[Ranked]) -> String {
    let cells = |fit: &Ranked| {
        let numbers = [(fit.error, 5), (fit.relative_error, 4), (fit.seconds, 2)];
        [vec![fit.model.to_owned()], numbers.map(|(value, digits)| format!("{value:.digits$}")).to_vec()].concat()
    };
    let mut text = report::table(&["model", "error", "relative", "s"], &fits.iter().map(cells).collect::<Vec<_>>());
    if let [fit] = fits {
        let values: Vec<_> = fit.params.iter().map(|(name, text)| format!("{name}={text}")).collect();
        text.push_str(&values.join("\n"));
    }
    text
}
