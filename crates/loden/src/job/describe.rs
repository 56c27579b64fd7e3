//! Descriptions of measurements and compressed materials in figures.

use glam::Vec3;
use rayon::prelude::*;
use serde::Serialize;
use serde::ser::{SerializeMap, Serializer};

use super::Opened;
use crate::Result;
use crate::btf::{BtfMeta, BtfSource, Cosine, Identity, SampleType, Texels};
use crate::codec::CompressedBtf;
use crate::direction::{self, DirectionSet};
use crate::import::Measured;
use crate::material::{Blending, Brdf, BrdfSample};
use crate::metric::Report;
use crate::params::Values;
use crate::progress::{Progress, Task};

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
    /// Number of view directions; of a list of pairs, of different ones.
    pub views: usize,
    /// The name of their set, `list`, or `list of pairs`.
    pub view_directions: &'static str,
    /// Number of light directions; of a list of pairs, of different ones.
    pub lights: usize,
    /// The name of their set, `list`, or `list of pairs`.
    pub light_directions: &'static str,
    /// Number of images.
    pub pairs: usize,
    /// How stored values encode light.
    pub encoding: crate::color::Encoding,
    /// Whether the values contain the light's cosine.
    pub cosine: Cosine,
    /// What is averaged between directions and texels unless told otherwise: `linear` light or `stored` values.
    pub blending: &'static str,
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
    /// Directions that occur twice, a phrase each.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub duplicates: Vec<String>,
    /// Number of images that were read for the next three figures: all, or as many of every view as are read in moments.
    pub images_read: usize,
    /// Lowest stored value.
    pub lowest: f32,
    /// Highest stored value.
    pub highest: f32,
    /// Number of negative stored values.
    pub negative: u64,
    /// Images that cannot be read: why, a sentence each.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub unreadable: Vec<String>,
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
    /// What it was compressed from, if the file states that.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub source: Option<Identity>,
    /// Name and version of the program that wrote the file.
    pub program: Option<String>,
    /// The codec.
    pub method: String,
    /// Its parameters.
    pub params: Values,
    /// Its error, if measured at compression.
    #[serde(flatten)]
    pub error: Option<Report>,
    /// What was done to it since it was compressed, oldest first.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub history: Vec<String>,
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

/// Facts as entries of the enclosing object; numbers are numbers.
fn as_map<S: Serializer>(facts: &[(&'static str, String)], serializer: S) -> std::result::Result<S::Ok, S::Error> {
    let mut map = serializer.serialize_map(Some(facts.len()))?;
    for (name, text) in facts {
        match (text.parse::<u64>(), text.parse::<f64>()) {
            (Ok(number), _) => map.serialize_entry(name, &number)?,
            (_, Ok(number)) if number.is_finite() => map.serialize_entry(name, &number)?,
            _ => map.serialize_entry(name, text)?,
        }
    }
    map.end()
}

/// Describes what was opened. For the range of its values all images of a BTF are read if `whole`, and those that
/// cannot be are listed; else images of all views, as many as are read in moments.
///
/// # Errors
/// Errors of reading the images; [`crate::Error::Cancelled`].
pub fn describe(opened: &Opened, whole: bool, progress: &dyn Progress) -> Result<Description> {
    let Opened { kind, measured, .. } = opened;
    Ok(match measured {
        Measured::Btf(source) => Description::Btf(btf(kind, source.as_ref(), whole, progress)?),
        Measured::Compressed(source) => {
            let btf = btf(kind, source.as_ref(), whole, progress)?;
            Description::Compressed(Box::new(compressed(btf, source.as_ref())?))
        }
        Measured::Brdf(source) => Description::Brdf(brdf(kind, source.as_ref())),
    })
}

/// The stored values of some images.
struct Range {
    images: usize,
    lowest: f32,
    highest: f32,
    negative: u64,
    unreadable: Vec<String>,
}

impl Range {
    const NOTHING: Self =
        Self { images: 0, lowest: f32::INFINITY, highest: f32::NEG_INFINITY, negative: 0, unreadable: Vec::new() };

    fn of(texels: &Texels) -> Self {
        let values = texels.to_f32();
        Self {
            images: 1,
            lowest: values.iter().copied().fold(f32::INFINITY, f32::min),
            highest: values.iter().copied().fold(f32::NEG_INFINITY, f32::max),
            negative: values.iter().filter(|value| **value < 0.0).count() as u64,
            unreadable: Vec::new(),
        }
    }

    fn and(mut self, other: Self) -> Self {
        self.unreadable.extend(other.unreadable);
        Self {
            images: self.images + other.images,
            lowest: self.lowest.min(other.lowest),
            highest: self.highest.max(other.highest),
            negative: self.negative + other.negative,
            unreadable: self.unreadable,
        }
    }
}

/// Texels that are read if not all of them are asked for.
const TEXELS: usize = 16 << 20;

/// The values of all images, or of about as many of each view as [`TEXELS`] allows, but at least one.
fn range(source: &dyn BtfSource, whole: bool, progress: &dyn Progress) -> Result<Range> {
    let meta = source.meta();
    let (views, lights) = (meta.views.len(), meta.lights.len());
    let of_view = if whole { lights } else { (TEXELS / meta.texels() / views).clamp(1, lights) };
    let task = Task::new(progress, "check", views as u64);
    let view = |view: usize| {
        let image = |i: usize| {
            // other lights in every view
            let light = (i * lights / of_view + view) % lights;
            match source.image(view, light) {
                Ok(texels) => Range::of(&texels),
                Err(error) => Range { unreadable: vec![error.to_string()], ..Range::NOTHING },
            }
        };
        let range = (0..of_view).map(image).fold(Range::NOTHING, Range::and);
        source.release(view);
        task.advance(1).map(|()| range)
    };
    let ranges = (0..views).into_par_iter().map(view).collect::<Result<Vec<_>>>()?;
    Ok(ranges.into_iter().fold(Range::NOTHING, Range::and))
}

/// The directions of a set that occur twice; of a list of pairs, those pairs.
fn duplicates(what: &str, set: &DirectionSet) -> Vec<String> {
    let at = |i: usize| (set.directions()[i], set.seen_from().map(|views| views.directions()[i]));
    let same = |i: &usize| (0..*i).find(|k| at(*k) == at(*i));
    let phrase = |(k, i): (usize, usize)| {
        let [theta, phi] = set.degrees()[i];
        let direction = if set.seen_from().is_some() { "pair of directions, light" } else { "direction" };
        format!("{what} {k} and {i} have the same {direction} ({theta}, {phi})")
    };
    (0..set.len()).filter_map(|i| same(&i).map(|k| phrase((k, i)))).collect()
}

fn btf(kind: &'static str, source: &dyn BtfSource, whole: bool, progress: &dyn Progress) -> Result<BtfDescription> {
    let meta = source.meta();
    let mut range = range(source, whole, progress)?;
    let mut warnings = source.warnings().to_vec();
    if let (false, Some(first)) = (whole, range.unreadable.first()) {
        let count = range.unreadable.len();
        warnings.push(format!("images that cannot be read: {count} (--check lists all), the first: {first}"));
        range.unreadable.clear();
    }
    let views = meta.lights.seen_from().unwrap_or(&meta.views);
    Ok(BtfDescription {
        kind,
        width: meta.width,
        height: meta.height,
        views: if meta.is_listed() { distinct(views) } else { views.len() },
        view_directions: set_name(if meta.is_listed() { &meta.lights } else { views }),
        lights: if meta.is_listed() { distinct(&meta.lights) } else { meta.lights.len() },
        light_directions: set_name(&meta.lights),
        pairs: meta.pairs(),
        encoding: meta.encoding,
        cosine: meta.cosine,
        blending: Blending::Linear.name(),
        sample_type: meta.sample_type,
        raw8_bytes: meta.raw8_bytes(),
        source_bytes: source.source_bytes(),
        missing: source.missing().iter().map(|&(view, light)| pair(meta, view, light)).collect(),
        facts: source.facts().to_vec(),
        duplicates: [duplicates("view", &meta.views), duplicates("light", &meta.lights)].concat(),
        images_read: range.images,
        lowest: range.lowest,
        highest: range.highest,
        negative: range.negative,
        unreadable: range.unreadable,
        warnings,
    })
}

fn compressed(mut btf: BtfDescription, source: &CompressedBtf) -> Result<CompressedDescription> {
    let recipe = source.parts().recipe();
    if !recipe.is_linear() {
        btf.blending = recipe.blending(Blending::Auto).name();
    }
    Ok(CompressedDescription {
        btf,
        source: source.source().identity.clone(),
        program: source.program().map(str::to_owned),
        method: source.method().into(),
        params: source.params().clone(),
        error: source.error().copied(),
        history: source.history()?.iter().map(ToString::to_string).collect(),
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

fn distinct(set: &DirectionSet) -> usize {
    let mut found: Vec<[u32; 3]> = set.directions().iter().map(|w| w.to_array().map(f32::to_bits)).collect();
    found.sort_unstable();
    found.dedup();
    found.len()
}

fn set_name(set: &DirectionSet) -> &'static str {
    if set.seen_from().is_some() { "list of pairs" } else { set.name().unwrap_or("list") }
}

fn pair(meta: &BtfMeta, view: usize, light: usize) -> Pair {
    let [light, view] = meta.pair_degrees(view, light);
    Pair { light, view }
}
