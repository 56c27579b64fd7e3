//! DFMF: decorrelated full-matrix factorisation of log-luminance and chroma.
//!
//! # Model
//! Linear light becomes ln(Y + 0.00001), U / Y and V / Y. For each of these channels the matrix of all pairs by all texels is
//! factored on its own, M = D T, without a mean ([`crate::factor::stream`]): rows of D are pairs, columns of T texels. Two
//! channels of chroma need fewer components than the luminance, and errors are relative, as the eye's are. Directions
//! and texels are interpolated in these channels.
//!
//! # Limits
//! Near black the logarithm magnifies the noise of 8-bit values. Each view is seen once; what the first views dropped, later
//! ones cannot bring back. Memory grows with (pairs + texels) x components.
//!
//! # References
//! mueller2009, schwartz2013. As in Bonn's `.btf` files of that name, which have as many components in all channels.

use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::btf::{BtfMeta, BtfSource};
use crate::codec::container::{Container, TensorSpec, Writer};
use crate::codec::decoder::{Decoder, Opened};
use crate::codec::values::{image, numbers, stored, view_texels};
use crate::codec::{Codec, CompressedBtf, EncodeSummary};
use crate::color::domain::Domain;
use crate::color::model::{ColorModel, LOG_Y};
use crate::direction::Scheme;
use crate::factor::stream::StreamedSvd;
use crate::material::Material;
use crate::material::angles::{Angles, AngularStencil, Footprint};
use crate::material::sampled::Sampled;
use crate::params::{Kind, Param, Values};
use crate::progress::{Progress, Task};
use crate::{Error, Result};

/// The codec.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Dfmf;

const PARAMS: &[Param] = &[
    Param {
        name: "components",
        unit: "",
        kind: Kind::Integer { min: 1, max: 4096 },
        default: "32",
        doc: "Components of the luminance; at most the rank, the smaller of pairs and texels.",
    },
    Param {
        name: "chroma",
        unit: "",
        kind: Kind::Integer { min: 1, max: 4096 },
        default: "8",
        doc: "Components of each of the two channels of chroma; at most those of the luminance.",
    },
    crate::codec::values::PRECISION,
];

/// Components of each channel.
fn counts(params: &Values) -> [usize; 3] {
    ["components", "chroma", "chroma"].map(|name| params.integer(name) as usize)
}

/// The largest numbers of components are the rank's, and the luminance's.
fn check(counts: [usize; 3], meta: &BtfMeta) -> Result<()> {
    let rank = meta.pairs().min(meta.texels());
    for (name, found, most) in [("components", counts[0], rank), ("chroma", counts[1], counts[0])] {
        if found > most {
            return Err(Error::parameter(name, format!("found {found}, expected at most {most}")));
        }
    }
    Ok(())
}

fn layout(meta: &BtfMeta, counts: [usize; 3], params: &Values) -> Vec<TensorSpec> {
    let sample_type = crate::codec::values::precision(params);
    let directions = |k: usize| vec![meta.views.len(), meta.lights.len(), counts[k]];
    let texels = |k: usize| vec![meta.height, meta.width, counts[k]];
    let names = [("y_directions", "y_texels"), ("u_directions", "u_texels"), ("v_directions", "v_texels")];
    let both = |(k, (a, b))| [(a, directions(k)), (b, texels(k))];
    names
        .into_iter()
        .enumerate()
        .flat_map(both)
        .map(|(name, shape)| TensorSpec { name: name.into(), sample_type, shape })
        .collect()
}

impl Codec for Dfmf {
    fn name(&self) -> &'static str {
        "dfmf"
    }

    fn doc(&self) -> &'static str {
        "Log-luminance and chroma factored on their own: relative errors, fewer components for colour."
    }

    fn params(&self) -> &'static [Param] {
        PARAMS
    }

    fn encode(
        &self,
        source: &dyn BtfSource,
        params: &Values,
        path: &Path,
        progress: &dyn Progress,
    ) -> Result<EncodeSummary> {
        let (meta, counts, model) = (source.meta(), counts(params), ColorModel::plain(LOG_Y));
        check(counts, meta)?;
        let writer = Writer::create(path, self.name(), params, source, &layout(meta, counts, params))?;
        let task = Task::new(progress, "compress", meta.views.len() as u64);
        let mut parts = counts.map(|count| StreamedSvd::with_spare(meta.texels(), meta.pairs(), count));
        for view in 0..meta.views.len() {
            let texels = view_texels(source, view)?;
            let lights = (0..meta.lights.len()).into_par_iter();
            let images: Vec<Vec<f32>> = lights.map(|light| image(&texels, light, meta, Domain::Linear)).collect();
            for (channel, part) in parts.iter_mut().enumerate() {
                let rows: Vec<f32> = images.par_iter().flat_map_iter(|rgb| model.channel(channel, rgb)).collect();
                let problem = || Error::parameter("source", format!("view {view} holds numbers that are not finite"));
                part.push(&rows).ok_or_else(problem)?;
            }
            source.release(view);
            task.advance(1)?;
        }
        for (channel, (part, count)) in parts.iter().zip(counts).enumerate() {
            let (singular, directions, texels) = part.finish(count);
            for (side, rows) in [directions, texels].into_iter().enumerate() {
                let rows = padded(&rows, singular.len(), count);
                writer.write(2 * channel + side, 0, &stored(&rows, params)?)?;
            }
        }
        Ok(EncodeSummary { bytes: writer.commit()?, warnings: Vec::new() })
    }

    fn dial(&self, meta: &BtfMeta, place: f64) -> Vec<(&'static str, String)> {
        let most = meta.pairs().min(meta.texels()).min(1024);
        vec![("components", crate::codec::count(place, most)), ("chroma", crate::codec::count(place, most.div_ceil(4)))]
    }

    fn open(&self, container: Container) -> Result<Arc<dyn CompressedBtf>> {
        let opened = Opened::new(container, self)?;
        let (meta, counts) = (&opened.meta, counts(&opened.params));
        check(counts, meta).map_err(|e| Error::invalid(opened.container.path(), "params", e.to_string()))?;
        let layout = layout(meta, counts, &opened.params);
        let mut tensors =
            layout.iter().map(|spec| numbers(&opened.container, spec)).collect::<Result<Vec<_>>>()?.into_iter();
        let channels = counts.map(|count| {
            let mut next = || tensors.next().unwrap_or_default();
            Channel { count, directions: next(), texels: next() }
        });
        Ok(Arc::new(DfmfBtf { opened, channels, model: ColorModel::plain(LOG_Y) }))
    }
}

/// Rows of `found` numbers, each with zeros up to `count`.
fn padded(rows: &[f32], found: usize, count: usize) -> Vec<f32> {
    let zeros = || std::iter::repeat_n(0.0, count - found);
    rows.chunks_exact(found.max(1)).flat_map(|row| row.iter().copied().chain(zeros())).collect()
}

/// The factors of a channel.
#[derive(Debug)]
struct Channel {
    count: usize,
    /// (pair, component)
    directions: Vec<f32>,
    /// (texel, component)
    texels: Vec<f32>,
}

impl Channel {
    fn row(&self, pair: usize) -> &[f32] {
        &self.directions[pair * self.count..][..self.count]
    }

    fn texel(&self, texel: usize) -> &[f32] {
        &self.texels[texel * self.count..][..self.count]
    }
}

/// Opened: the factors in single precision.
#[derive(Debug)]
struct DfmfBtf {
    opened: Opened,
    channels: [Channel; 3],
    model: ColorModel,
}

impl DfmfBtf {
    /// Linear light, not negative.
    fn linear(&self, [y, u, v]: [f32; 3]) -> Vec3 {
        // the bound keeps a damaged file's values finite
        Vec3::from(self.model.decode([y.min(40.0), u, v])).max(Vec3::ZERO)
    }
}

impl Decoder for DfmfBtf {
    fn opened(&self) -> &Opened {
        &self.opened
    }

    fn decode(&self, view: usize, lights: Range<usize>, out: &mut [f32]) -> Result<()> {
        let meta = &self.opened.meta;
        for (light, out) in lights.zip(out.chunks_exact_mut(meta.image_len())) {
            let pair = view * meta.lights.len() + light;
            let rows = self.channels.each_ref().map(|channel| channel.row(pair));
            for (texel, out) in out.chunks_exact_mut(3).enumerate() {
                let sums = [0, 1, 2].map(|k| dot(rows[k], self.channels[k].texel(texel)));
                let linear = self.linear(sums).to_array();
                out.copy_from_slice(&linear.map(|v| meta.encoding.encode(v)));
            }
        }
        Ok(())
    }

    fn table_bytes(&self) -> u64 {
        let bytes = |c: &Channel| size_of_val(&c.directions[..]) + size_of_val(&c.texels[..]);
        self.channels.iter().map(bytes).sum::<usize>() as u64
    }

    fn evaluable(self: Arc<Self>, scheme: Scheme) -> Result<Arc<dyn Material>> {
        let angles = Angles::new(&self.opened.meta, scheme)?;
        let material = DfmfMaterial { btf: self.clone(), angles };
        Ok(Arc::new(Sampled::new(material, &self.opened.meta, scheme)?))
    }
}

fn dot(a: &[f32], b: &[f32]) -> f32 {
    let mut lanes = [0.0f32; 8];
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<8>(), b.as_chunks::<8>());
    for (a, b) in a.iter().zip(b) {
        (0..8).for_each(|i| lanes[i] += a[i] * b[i]);
    }
    lanes.iter().sum::<f32>() + a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum::<f32>()
}

struct DfmfMaterial {
    btf: Arc<DfmfBtf>,
    angles: Angles,
}

impl DfmfMaterial {
    /// The interpolated value of a channel.
    fn value(&self, channel: &Channel, stencil: &AngularStencil, footprint: &Footprint) -> f32 {
        let lights = self.btf.opened.meta.lights.len();
        let direction = |k: usize| -> f32 {
            let of_view = |view: usize| -> f32 {
                stencil.light.iter().map(|(light, weight)| weight * channel.row(view * lights + light)[k]).sum()
            };
            stencil.view.iter().map(|(view, weight)| weight * of_view(view)).sum()
        };
        let texels = footprint.texel.map(|texel| channel.texel(texel));
        let texel = |k: usize| -> f32 { texels.iter().zip(footprint.weight).map(|(t, weight)| weight * t[k]).sum() };
        (0..channel.count).map(|k| direction(k) * texel(k)).sum()
    }
}

impl Material for DfmfMaterial {
    fn apparent(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        let Some(stencil) = self.angles.stencil(wi, wo) else { return Vec3::ZERO };
        let footprint = Footprint::new(uv, self.btf.opened.meta.width, self.btf.opened.meta.height);
        let channels = self.btf.channels.each_ref().map(|channel| self.value(channel, &stencil, &footprint));
        self.btf.linear(channels) * stencil.factor
    }
}
