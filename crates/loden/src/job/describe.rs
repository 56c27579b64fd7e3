//! Descriptions of measurements and compressed materials in figures.

use glam::Vec3;
use serde::Serialize;
use serde::ser::{SerializeMap, Serializer};

use super::Opened;
use crate::Result;
use crate::btf::{BtfMeta, BtfSource, Cosine, SampleType};
use crate::codec::CompressedBtf;
use crate::direction::{self, DirectionSet};
use crate::import::Measured;
use crate::material::{Brdf, BrdfSample};
use crate::metric::Report;
use crate::params::Values;

/// The description of a material.
#[derive(Debug, Clone, Serialize)]
#[serde(untagged)]
pub enum Description {
    /// A BTF as images.
    Btf(BtfDescription),
    /// A compressed BTF.
    Compressed(Box<CompressedDescription>),
    /// A BRDF.
    Brdf(BrdfDescription),
}

/// A BTF.
#[derive(Debug, Clone, Serialize)]
pub struct BtfDescription {
    /// The format of the file.
    pub kind: &'static str,
    /// Texels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Number of view directions.
    pub views: usize,
    /// The name of their set, or `list`.
    pub view_directions: &'static str,
    /// Number of light directions.
    pub lights: usize,
    /// The name of their set, or `list`.
    pub light_directions: &'static str,
    /// Number of images.
    pub pairs: usize,
    /// How stored values encode light.
    pub encoding: crate::color::Encoding,
    /// Whether the values contain the light's cosine.
    pub cosine: Cosine,
    /// The number type of the texels.
    pub sample_type: SampleType,
    /// Bytes of the whole BTF at 8 bits.
    pub raw8_bytes: u64,
    /// Bytes of its files.
    pub source_bytes: u64,
    /// Number of pairs that were not measured.
    pub missing: Vec<Pair>,
    /// Further statements of the file, and the reasons for conventions.
    #[serde(flatten, serialize_with = "as_map")]
    pub facts: Vec<(&'static str, String)>,
    /// The view nearest to the normal, which the next three figures describe: polar angle and azimuth in degrees.
    pub range_of_view: [f64; 2],
    /// Lowest stored value.
    pub lowest: f32,
    /// Highest stored value.
    pub highest: f32,
    /// Number of negative stored values.
    pub negative: u64,
    /// Assumptions and repairs.
    pub warnings: Vec<String>,
}

/// Directions in degrees: polar angle and azimuth.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Pair {
    /// The light.
    pub light: [f64; 2],
    /// The viewer.
    pub view: [f64; 2],
}

/// A compressed BTF.
#[derive(Debug, Clone, Serialize)]
pub struct CompressedDescription {
    /// The decoded BTF.
    #[serde(flatten)]
    pub btf: BtfDescription,
    /// The codec.
    pub method: String,
    /// Its parameters.
    pub params: Values,
    /// Its error, if measured at compression.
    #[serde(flatten)]
    pub error: Option<Report>,
    /// The lossless stage of the file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lossless: Option<&'static str>,
    /// Size of the file.
    pub bytes: u64,
    /// Bytes of the tables for evaluation.
    pub resident_bytes: u64,
}

/// A BRDF.
#[derive(Debug, Clone, Serialize)]
pub struct BrdfDescription {
    /// The format of the file, or the name of the model.
    pub kind: &'static str,
    /// `brdf`.
    pub holds: &'static str,
    /// Statements of the file and assumptions.
    #[serde(flatten, serialize_with = "as_map")]
    pub facts: Vec<(&'static str, String)>,
    /// Number of measured values.
    pub samples: usize,
    /// The largest polar angle of a light, degrees.
    pub largest_theta_i: f32,
    /// The largest polar angle of a viewer, degrees.
    pub largest_theta_o: f32,
    /// The lowest value, 1/sr.
    pub lowest: f32,
    /// The highest value, 1/sr.
    pub highest: f32,
    /// The mean of each channel, 1/sr.
    pub mean: [f64; 3],
    /// Assumptions and repairs.
    pub warnings: Vec<String>,
}

/// Facts as entries of the enclosing object; whole numbers are numbers.
fn as_map<S: Serializer>(facts: &[(&'static str, String)], serializer: S) -> std::result::Result<S::Ok, S::Error> {
    let mut map = serializer.serialize_map(Some(facts.len()))?;
    for (name, text) in facts {
        match text.parse::<u64>() {
            Ok(number) => map.serialize_entry(name, &number)?,
            Err(_) => map.serialize_entry(name, text)?,
        }
    }
    map.end()
}

/// Describes what was opened. Reads one view of a BTF for the range of its values.
///
/// # Errors
/// Errors of reading the view.
pub fn describe(opened: &Opened) -> Result<Description> {
    Ok(match &opened.measured {
        Measured::Btf(source) => Description::Btf(btf(opened.kind, source.as_ref())?),
        Measured::Compressed(source) => Description::Compressed(Box::new(compressed(opened.kind, source.as_ref())?)),
        Measured::Brdf(source) => Description::Brdf(brdf(opened.kind, source.as_ref())),
    })
}

fn btf(kind: &'static str, source: &dyn BtfSource) -> Result<BtfDescription> {
    let meta = source.meta();
    let view = meta.views.nearest(Vec3::Z);
    // a BTF may be too large to read as a whole
    let (mut lowest, mut highest, mut negative) = (f32::INFINITY, f32::NEG_INFINITY, 0u64);
    for light in 0..meta.lights.len() {
        for &value in source.image(view, light)?.to_f32().iter() {
            lowest = lowest.min(value);
            highest = highest.max(value);
            negative += u64::from(value < 0.0);
        }
    }
    Ok(BtfDescription {
        kind,
        width: meta.width,
        height: meta.height,
        views: meta.views.len(),
        view_directions: set_name(&meta.views),
        lights: meta.lights.len(),
        light_directions: set_name(&meta.lights),
        pairs: meta.pairs(),
        encoding: meta.encoding,
        cosine: meta.cosine,
        sample_type: meta.sample_type,
        raw8_bytes: meta.raw8_bytes(),
        source_bytes: source.source_bytes(),
        missing: source.missing().iter().map(|&(view, light)| pair(meta, view, light)).collect(),
        facts: source.facts().to_vec(),
        range_of_view: meta.views.degrees()[view],
        lowest,
        highest,
        negative,
        warnings: source.warnings().to_vec(),
    })
}

fn compressed(kind: &'static str, source: &CompressedBtf) -> Result<CompressedDescription> {
    Ok(CompressedDescription {
        btf: btf(kind, source)?,
        method: source.method().into(),
        params: source.params().clone(),
        error: source.error().copied(),
        lossless: source.lossless().map(|stage| stage.name),
        bytes: source.bytes(),
        resident_bytes: source.resident_bytes(),
    })
}

fn brdf(kind: &'static str, brdf: &dyn Brdf) -> BrdfDescription {
    let samples = brdf.samples();
    let highest = |of: &dyn Fn(&BrdfSample) -> f32| samples.iter().map(of).fold(f32::NEG_INFINITY, f32::max);
    let mean = |c: usize| samples.iter().map(|s| f64::from(s.value[c])).sum::<f64>() / samples.len().max(1) as f64;
    let theta = |w: Vec3| direction::theta(w).to_degrees();
    BrdfDescription {
        kind,
        holds: "brdf",
        facts: brdf.notes().facts.clone(),
        samples: samples.len(),
        largest_theta_i: highest(&|s| theta(s.wi)),
        largest_theta_o: highest(&|s| theta(s.wo)),
        lowest: -highest(&|s| -s.value.min_element()),
        highest: highest(&|s| s.value.max_element()),
        mean: [mean(0), mean(1), mean(2)],
        warnings: brdf.notes().warnings.clone(),
    }
}

fn set_name(set: &DirectionSet) -> &'static str {
    set.name().unwrap_or("list")
}

fn pair(meta: &BtfMeta, view: usize, light: usize) -> Pair {
    Pair { light: meta.lights.degrees()[light], view: meta.views.degrees()[view] }
}
