//! `loden eval`: a material at directions listed in a file.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Args;
use glam::{Vec2, Vec3};
use loden::Error;
use loden::direction::{Scheme, from_angles};
use loden::import::{self, Measured};
use loden::material::{Brdf, Material, RawBtf};
use rayon::prelude::*;
use serde_json::json;

use super::decompress::SchemeFlag;
use crate::flags::Assumptions;
use crate::terminal::Terminal;

/// Images that would need more memory than this are decoded when asked for.
const KEEP: u64 = 1 << 31;

#[derive(Args)]
pub struct Eval {
    /// Anything `loden info` knows.
    source: PathBuf,
    /// Rows theta_i,phi_i,theta_o,phi_o[,u,v]: light and view in degrees, texture coordinates; a heading is allowed.
    #[arg(long, value_name = "CSV")]
    queries: PathBuf,
    /// The rows with r,g,b appended: f_r in 1/sr of a BRDF, the apparent value pi L / E of a BTF.
    #[arg(long, short, value_name = "CSV")]
    output: PathBuf,
    /// Append the value of each measured wavelength in place of r,g,b.
    #[arg(long)]
    spectral: bool,
    /// How to interpolate between measured directions.
    #[arg(long, default_value = "triangles")]
    interpolation: SchemeFlag,
    #[command(flatten)]
    assumptions: Assumptions,
}

struct Query {
    text: String,
    wi: Vec3,
    wo: Vec3,
    uv: Vec2,
}

enum Kind {
    Brdf(Arc<dyn Brdf>),
    Btf(Arc<dyn Material>),
}

impl Eval {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        let text = std::fs::read_to_string(&self.queries).map_err(Error::io(&self.queries))?;
        let (heading, queries) = parse(&self.queries, &text)?;
        let material = self.open(terminal)?;
        let (columns, values) = self.evaluate(&material, &queries)?;
        let mut out = format!("{heading},{}\n", columns.join(","));
        for (query, values) in queries.iter().zip(&values) {
            let values: Vec<String> = values.iter().map(ToString::to_string).collect();
            out += &format!("{},{}\n", query.text, values.join(","));
        }
        loden::output::write_file(&self.output, |file| file.write_all(out.as_bytes()))?;
        let quantity = if matches!(material, Kind::Brdf(_)) { "f_r in 1/sr" } else { "apparent value pi L / E" };
        let result = json!({ "output": self.output, "rows": queries.len(), "quantity": quantity });
        terminal.result(&result, || format!("{}: {} rows, {quantity}", self.output.display(), queries.len()))
    }

    fn evaluate(&self, material: &Kind, queries: &[Query]) -> loden::Result<(Vec<String>, Vec<Vec<f32>>)> {
        let rgb = ["r", "g", "b"].map(str::to_owned).to_vec();
        let each = |f: &(dyn Fn(&Query) -> Vec<f32> + Sync)| queries.par_iter().map(f).collect::<Vec<_>>();
        match material {
            Kind::Brdf(brdf) if self.spectral && !brdf.wavelengths().is_empty() => {
                let names = brdf.wavelengths().iter().map(|nm| format!("{nm}nm")).collect();
                Ok((names, each(&|q| brdf.spectrum(q.wi, q.wo))))
            }
            _ if self.spectral => Err(Error::parameter("spectral", "the file holds RGB values, no spectra")),
            Kind::Brdf(brdf) => Ok((rgb, each(&|q| brdf.eval(q.uv, q.wi, q.wo).to_array().to_vec()))),
            Kind::Btf(btf) => Ok((rgb, each(&|q| btf.apparent(q.uv, q.wi, q.wo).to_array().to_vec()))),
        }
    }

    fn open(&self, terminal: &Terminal) -> loden::Result<Kind> {
        let scheme: Scheme = self.interpolation.into();
        match import::open_named(&self.source, &self.assumptions.options())?.1 {
            Measured::Brdf(brdf) => {
                terminal.warn(&brdf.notes().warnings);
                Ok(Kind::Brdf(brdf))
            }
            Measured::Compressed(compressed) => Ok(Kind::Btf(compressed.material(scheme)?)),
            Measured::Btf(source) => {
                terminal.warn(source.warnings());
                let bytes = source.meta().raw8_bytes() * source.meta().sample_type.bytes() as u64;
                let keep = bytes <= KEEP;
                let material = if keep { RawBtf::new(source, scheme)? } else { RawBtf::on_demand(source, scheme)? };
                Ok(Kind::Btf(Arc::new(material)))
            }
        }
    }
}

/// The heading and the rows.
fn parse(path: &Path, text: &str) -> loden::Result<(String, Vec<Query>)> {
    let mut heading = None;
    let mut queries = Vec::new();
    let mut columns = None;
    for (line, row) in (1..).zip(text.lines()).filter(|(_, row)| !row.trim().is_empty()) {
        let numbers: Option<Vec<f32>> = row.split(',').map(|word| word.trim().parse().ok()).collect();
        let Some(numbers) = numbers else {
            if queries.is_empty() && heading.is_none() {
                heading = Some(row.trim().to_owned());
                continue;
            }
            return Err(Error::invalid(path, format!("line {line}"), "not all numbers"));
        };
        let wrong = |problem: String| Err(Error::invalid(path, format!("line {line}"), problem));
        if ![4, 6].contains(&numbers.len()) || *columns.get_or_insert(numbers.len()) != numbers.len() {
            return wrong(format!("{} numbers, expected 4 or 6, the same in every row", numbers.len()));
        }
        let polar = |theta: f32| (0.0..=90.0).contains(&theta);
        if !polar(numbers[0]) || !polar(numbers[2]) || !numbers.iter().all(|v| v.is_finite()) {
            return wrong(format!("polar angles {} and {}, expected 0..90 degrees", numbers[0], numbers[2]));
        }
        let direction = |i: usize| from_angles(numbers[i].to_radians(), numbers[i + 1].to_radians());
        let uv = numbers.get(4).map_or(Vec2::ZERO, |&u| Vec2::new(u, numbers[5]));
        queries.push(Query { text: row.trim().to_owned(), wi: direction(0), wo: direction(2), uv });
    }
    let standard = if columns == Some(6) { "theta_i,phi_i,theta_o,phi_o,u,v" } else { "theta_i,phi_i,theta_o,phi_o" };
    Ok((heading.unwrap_or_else(|| standard.into()), queries))
}
