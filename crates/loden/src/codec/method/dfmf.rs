//! DFMF: decorrelated full-matrix factorisation of log-luminance and chroma.
//!
//! # Model
//! Linear light is converted to ln(Y + 0.00001), U / Y and V / Y. For each of these channels the matrix of all pairs
//! by all texels is factored separately, without a mean ([`crate::factor::stream`]): M = D T, where rows of D are
//! pairs and columns of T are texels. The two chroma channels need fewer components than luminance, and errors are
//! relative, as in human vision. Directions and texels are interpolated in these channels.
//!
//! # Limits
//! Negative light becomes black. Near black the logarithm amplifies the noise of 8-bit values. Each view is read once, so whatever the first views
//! discard is lost for later ones. Memory grows with (pairs + texels) x components.
//!
//! # References
//! mueller2009, schwartz2013. As in Bonn's `.btf` files of this name, which use the same number of components in all
//! channels.

use std::path::Path;

use rayon::prelude::*;

use crate::btf::{BtfMeta, BtfSource, FloatType};
use crate::codec::container::Writer;
use crate::codec::parts::{Axis, Curve, Expr, PlaneSpec, Recipe, TableSpec};
use crate::codec::values::{FLOAT_PRECISION, image, stored, view_texels};
use crate::codec::{Codec, EncodeSummary};
use crate::color::domain::Domain;
use crate::color::model::{ColorModel, LOG_Y};
use crate::factor::stream::StreamedSvd;
use crate::params::{Param, Params as _, Values};
use crate::progress::{Progress, Task};
use crate::{Error, Result};

/// The codec.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Dfmf;

crate::params! {
    struct Settings {
        /// Number of luminance components; at most the rank, the smaller of pairs and texels.
        components: usize [1..=4096] = 32,
        /// Number of components for each chroma channel; at most that of the luminance.
        chroma: usize [1..=4096] = 8,
        precision: FloatType => FLOAT_PRECISION,
    }
}

/// Number of components per channel.
fn counts(settings: &Settings) -> [usize; 3] {
    [settings.components, settings.chroma, settings.chroma]
}

/// Limits the luminance to the rank and chroma to the luminance.
fn check(counts: [usize; 3], meta: &BtfMeta) -> Result<()> {
    let rank = meta.pairs().min(meta.texels());
    for (name, found, most) in [("components", counts[0], rank), ("chroma", counts[1], counts[0])] {
        if found > most {
            return Err(Error::parameter(name, format!("found {found}, expected at most {most}")));
        }
    }
    Ok(())
}

/// Factors over directions and texels, for the luminance and both chroma channels.
const NAMES: [(&str, &str); 3] =
    [("y_directions", "y_texels"), ("u_directions", "u_texels"), ("v_directions", "v_texels")];

fn recipe(settings: &Settings) -> Recipe {
    let (counts, sample_type) = (counts(settings), settings.precision.into());
    let table = |(names, count): ((&str, &str), usize)| {
        TableSpec::new(names.0, &[Axis::View, Axis::Light, Axis::Component(count)], sample_type)
    };
    let plane = |(names, count): ((&str, &str), usize)| PlaneSpec::numbers(names.1, count, sample_type);
    Recipe {
        planes: NAMES.into_iter().zip(counts).map(plane).collect(),
        tables: NAMES.into_iter().zip(counts).map(table).collect(),
        value: Expr::Channels(Box::new([0, 1, 2].map(|channel| Expr::dot(channel, channel)))),
        curve: Curve::LogYuv,
    }
}

impl Codec for Dfmf {
    fn name(&self) -> &'static str {
        "dfmf"
    }

    fn doc(&self) -> &'static str {
        "Log-luminance and chroma factored separately: relative errors, fewer components for colour."
    }

    fn params(&self) -> &'static [Param] {
        Settings::TABLE
    }

    fn encode(
        &self,
        source: &dyn BtfSource,
        params: &Values,
        path: &Path,
        progress: &dyn Progress,
    ) -> Result<EncodeSummary> {
        let settings = Settings::from_values(params)?;
        let (meta, counts, model) = (source.meta(), counts(&settings), ColorModel::plain(LOG_Y));
        let writer = Writer::create(path, self, params, source, &self.recipe(meta, params)?)?;
        let task = Task::new(progress, "compress", meta.views.len() as u64);
        let mut parts = counts.map(|count| StreamedSvd::with_spare(meta.texels(), meta.pairs(), count));
        for view in 0..meta.views.len() {
            let texels = view_texels(source, view)?;
            let lights = (0..meta.lights.len()).into_par_iter();
            let images: Vec<Vec<f32>> = lights.map(|light| image(&texels, light, meta, Domain::Linear)).collect();
            for (channel, part) in parts.iter_mut().enumerate() {
                let rows: Vec<f32> = images.par_iter().flat_map_iter(|rgb| model.channel(channel, rgb)).collect();
                let problem = || Error::non_finite(format!("view {view} of the source"));
                part.push(&rows).ok_or_else(problem)?;
            }
            source.release(view);
            task.advance(1)?;
        }
        for (channel, (part, count)) in parts.iter().zip(counts).enumerate() {
            let (singular, directions, texels) = part.finish(count);
            for (name, rows) in [(NAMES[channel].0, directions), (NAMES[channel].1, texels)] {
                let rows = padded(&rows, singular.len(), count);
                writer.write(name, 0, &stored(&rows, settings.precision)?)?;
            }
        }
        Ok(EncodeSummary { bytes: writer.commit()?, warnings: Vec::new() })
    }

    fn dial(&self, meta: &BtfMeta, place: f64) -> Vec<(&'static str, String)> {
        let most = meta.pairs().min(meta.texels()).min(1024);
        vec![("components", crate::codec::count(place, most)), ("chroma", crate::codec::count(place, most.div_ceil(4)))]
    }

    fn limits(&self, meta: &BtfMeta, params: &Values) -> Result<Vec<(&'static str, usize)>> {
        let rank = meta.pairs().min(meta.texels());
        Ok(vec![("components", rank), ("chroma", rank.min(Settings::from_values(params)?.components))])
    }

    fn recipe(&self, meta: &BtfMeta, params: &Values) -> Result<Recipe> {
        let settings = Settings::from_values(params)?;
        check(counts(&settings), meta)?;
        Ok(recipe(&settings))
    }
}

/// Pads rows of `found` numbers with zeros to `count`.
fn padded(rows: &[f32], found: usize, count: usize) -> Vec<f32> {
    let zeros = || std::iter::repeat_n(0.0, count - found);
    rows.chunks_exact(found.max(1)).flat_map(|row| row.iter().copied().chain(zeros())).collect()
}
