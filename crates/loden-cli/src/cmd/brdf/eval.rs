//! `loden brdf eval`: values of an analytic model.

use std::fmt::Write as _;
use std::path::PathBuf;

use clap::Args;
use loden::output::write_file;
use serde_json::json;

use crate::reflectance::{self, Setting};
use crate::terminal::Terminal;

#[derive(Args)]
pub struct Eval {
    /// The model; `loden brdf models` lists them.
    model: String,
    /// A parameter of the model; may be repeated.
    #[arg(long, value_name = "NAME=VALUE")]
    set: Vec<Setting>,
    /// Directions, a CSV file: theta_i, phi_i, theta_o, phi_o in degrees, or with --vectors wi and wo as x, y, z.
    #[arg(long, value_name = "FILE")]
    queries: PathBuf,
    /// The queries are unit vectors.
    #[arg(long)]
    vectors: bool,
    /// Where to write the values, a CSV file: f_r in 1/sr as r, g, b, and the density of samples.
    #[arg(long, short)]
    output: PathBuf,
}

impl Eval {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        let brdf = reflectance::analytic(&self.model, &self.set)?;
        let columns = if self.vectors { 6 } else { 4 };
        let rows = reflectance::read_csv(&self.queries, columns)?;
        let mut text = String::from("r,g,b,pdf\n");
        for row in &rows {
            let (wi, wo) = directions(row);
            let f = brdf.brdf(wi, wo);
            // writing to a string cannot fail
            let _ = writeln!(text, "{:.17e},{:.17e},{:.17e},{:.17e}", f.x, f.y, f.z, brdf.density(wi, wo));
        }
        write_file(&self.output, |out| out.write_all(text.as_bytes()))?;
        let value = json!({ "output": self.output, "model": self.model, "count": rows.len() });
        terminal.result(&value, || format!("{}: {} values", self.output.display(), rows.len()))
    }
}

fn directions(row: &[f64]) -> (glam::DVec3, glam::DVec3) {
    let angles = |t: f64, p: f64| {
        let ((st, ct), (sp, cp)) = (t.to_radians().sin_cos(), p.to_radians().sin_cos());
        glam::DVec3::new(st * cp, st * sp, ct)
    };
    match row {
        [a, b, c, d] => (angles(*a, *b), angles(*c, *d)),
        _ => (glam::DVec3::from_slice(row), glam::DVec3::from_slice(&row[3..])),
    }
}
