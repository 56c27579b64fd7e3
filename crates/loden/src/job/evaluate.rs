//! Evaluation of a material at the directions of a CSV file.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DVec3, Vec2, Vec3};
use rayon::prelude::*;
use serde::Serialize;

use super::open;
use super::samples::read_rows;
use crate::direction::from_angles;
use crate::import::Measured;
use crate::material::{Brdf, Interpolation, Material, RawBtf};
use crate::model::Analytic;
use crate::output::write_file;
use crate::params::Given;
use crate::progress::Progress;
use crate::{Error, Result};

/// Maximum bytes of decoded images in memory; beyond, images are read as needed.
const KEEP: u64 = 1 << 31;

/// The written values.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Evaluation {
    /// The CSV file.
    pub output: PathBuf,
    /// Number of rows without the heading.
    pub rows: usize,
    /// The quantity.
    pub quantity: Quantity,
}

/// The quantity of values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub enum Quantity {
    /// Values of a BRDF.
    #[serde(rename = "f_r in 1/sr")]
    Brdf,
    /// Values of a BTF.
    #[serde(rename = "apparent value pi L / E")]
    Apparent,
}

impl Quantity {
    /// Its name and unit.
    pub fn text(self) -> &'static str {
        match self {
            Self::Brdf => "f_r in 1/sr",
            Self::Apparent => "apparent value pi L / E",
        }
    }
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

/// Evaluates a material, named as for [`open()`], at the rows theta_i, phi_i, theta_o, phi_o\[, u, v\] of `queries`:
/// light and view in degrees, texture coordinates. Writes these rows with r, g, b appended, or with the value of each
/// measured wavelength if `spectral`.
///
/// # Errors
/// Errors of opening the material; [`Error::Invalid`] naming the line of an invalid row; [`Error::Parameter`] if
/// the material has no spectra.
pub fn evaluate(
    material: &Path,
    queries: &Path,
    output: &Path,
    (spectral, interpolation): (bool, Interpolation),
    options: &Given,
    progress: &dyn Progress,
) -> Result<Evaluation> {
    let text = std::fs::read_to_string(queries).map_err(Error::io(queries))?;
    let (heading, queries) = parse(queries, &text)?;
    let material = kind(open(material, options, progress)?.measured, interpolation)?;
    let (columns, values) = values(&material, &queries, spectral)?;
    let mut out = format!("{heading},{}\n", columns.join(","));
    for (query, values) in queries.iter().zip(&values) {
        let values: Vec<String> = values.iter().map(ToString::to_string).collect();
        out += &format!("{},{}\n", query.text, values.join(","));
    }
    write_file(output, |file| file.write_all(out.as_bytes()))?;
    let quantity = if matches!(material, Kind::Brdf(_)) { Quantity::Brdf } else { Quantity::Apparent };
    Ok(Evaluation { output: output.into(), rows: queries.len(), quantity })
}

fn kind(measured: Measured, how: Interpolation) -> Result<Kind> {
    Ok(match measured {
        Measured::Brdf(brdf) => Kind::Brdf(brdf),
        Measured::Compressed(compressed) => Kind::Btf(compressed.material(how)?),
        Measured::Btf(source) => {
            let bytes = source.meta().raw8_bytes() * source.meta().sample_type.bytes() as u64;
            let keep = bytes <= KEEP;
            let material = if keep { RawBtf::new(source, how)? } else { RawBtf::on_demand(source, how)? };
            Kind::Btf(Arc::new(material))
        }
    })
}

/// The names of the columns, and a row of values for each query.
fn values(material: &Kind, queries: &[Query], spectral: bool) -> Result<(Vec<String>, Vec<Vec<f32>>)> {
    let rgb = ["r", "g", "b"].map(str::to_owned).to_vec();
    let each = |f: &(dyn Fn(&Query) -> Vec<f32> + Sync)| queries.par_iter().map(f).collect::<Vec<_>>();
    match material {
        Kind::Brdf(brdf) if spectral && !brdf.wavelengths().is_empty() => {
            let names = brdf.wavelengths().iter().map(|nm| format!("{nm}nm")).collect();
            Ok((names, each(&|q| brdf.spectrum(q.wi, q.wo))))
        }
        _ if spectral => Err(Error::parameter("spectral", "the file holds RGB values, no spectra")),
        Kind::Brdf(brdf) => Ok((rgb, each(&|q| brdf.eval(q.uv, q.wi, q.wo).to_array().to_vec()))),
        Kind::Btf(btf) => {
            let values = each(&|q| btf.apparent(q.uv, q.wi, q.wo).to_array().to_vec());
            btf.check()?;
            Ok((rgb, values))
        }
    }
}

/// The heading and the rows.
fn parse(path: &Path, text: &str) -> Result<(String, Vec<Query>)> {
    let mut heading = None;
    let mut queries = Vec::new();
    let mut columns = None;
    for (line, row) in (1..).zip(text.lines()).filter(|(_, row)| !row.trim().is_empty()) {
        let numbers: Option<Vec<f32>> = row.split(',').map(|word| word.trim().parse().ok()).collect();
        let wrong = |problem: String| Error::invalid(path, format!("line {line}"), problem);
        let Some(numbers) = numbers else {
            if queries.is_empty() && heading.is_none() {
                heading = Some(row.trim().to_owned());
                continue;
            }
            return Err(wrong("not all numbers".into()));
        };
        if ![4, 6].contains(&numbers.len()) || *columns.get_or_insert(numbers.len()) != numbers.len() {
            return Err(wrong(format!("{} numbers, expected 4 or 6, the same in every row", numbers.len())));
        }
        queries.push(
            query(row, &numbers).ok_or_else(|| {
                wrong(format!("polar angles {} and {}, expected 0..90 degrees", numbers[0], numbers[2]))
            })?,
        );
    }
    let standard = if columns == Some(6) { "theta_i,phi_i,theta_o,phi_o,u,v" } else { "theta_i,phi_i,theta_o,phi_o" };
    Ok((heading.unwrap_or_else(|| standard.into()), queries))
}

/// A row of four or six numbers; `None` if an angle is out of range.
fn query(row: &str, numbers: &[f32]) -> Option<Query> {
    let polar = |theta: f32| (0.0..=90.0).contains(&theta);
    if !polar(numbers[0]) || !polar(numbers[2]) || !numbers.iter().all(|v| v.is_finite()) {
        return None;
    }
    let direction = |i: usize| from_angles(numbers[i].to_radians(), numbers[i + 1].to_radians());
    let uv = numbers.get(4).map_or(Vec2::ZERO, |&u| Vec2::new(u, numbers[5]));
    Some(Query { text: row.trim().to_owned(), wi: direction(0), wo: direction(2), uv })
}

/// Evaluates a model in double precision at the rows of `queries`: theta_i, phi_i, theta_o, phi_o in degrees, or wi and
/// wo as unit vectors if `vectors`. Writes f_r in 1/sr as r, g, b, and the density of samples; returns the number of
/// rows.
///
/// # Errors
/// [`Error::Invalid`] naming the line of an invalid row; [`Error::Io`].
pub fn evaluate_model(brdf: &Analytic, queries: &Path, vectors: bool, output: &Path) -> Result<usize> {
    let rows = read_rows(queries, if vectors { 6 } else { 4 })?;
    let mut text = String::from("r,g,b,pdf\n");
    for row in &rows {
        let (wi, wo) = directions(row);
        let f = brdf.brdf(wi, wo);
        // writing to a string cannot fail
        let _ = writeln!(text, "{:e},{:e},{:e},{:e}", f.x, f.y, f.z, brdf.density(wi, wo));
    }
    write_file(output, |out| out.write_all(text.as_bytes()))?;
    Ok(rows.len())
}

fn directions(row: &[f64]) -> (DVec3, DVec3) {
    let angles = |t: f64, p: f64| {
        let ((st, ct), (sp, cp)) = (t.to_radians().sin_cos(), p.to_radians().sin_cos());
        DVec3::new(st * cp, st * sp, ct)
    };
    match row {
        [a, b, c, d] => (angles(*a, *b), angles(*c, *d)),
        _ => (DVec3::from_slice(row), DVec3::from_slice(&row[3..])),
    }
}
