//! Fast decoder of recipes whose channels are luminance and chroma, each the dot product of a plane with a table over
//! all pairs.

use std::ops::Range;
use std::sync::Arc;

use glam::{Vec2, Vec3};

use crate::Result;
use crate::btf::{BtfMeta, Rect};
use crate::codec::decoder::Decoder;
use crate::codec::parts::{Axis, Curve, Expr, Parts, TableSpec};
use crate::color::model::{ColorModel, LOG_Y};
use crate::material::angles::{Angles, AngularStencil, Footprint, LightStencil};
use crate::material::sampled::Sampled;
use crate::material::{Blending, Interpolation, Material};

/// The factors of one channel.
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

/// All factors in single precision.
#[derive(Debug)]
struct ChannelsBtf {
    meta: BtfMeta,
    channels: [Channel; 3],
    model: ColorModel,
}

/// See [`super::FORMS`].
///
/// # Errors
/// Errors of reading the parts.
pub fn form(parts: &Arc<dyn Parts>) -> Result<Option<Arc<dyn Decoder>>> {
    let (meta, recipe) = (parts.meta(), parts.recipe());
    let (Expr::Channels(exprs), Curve::LogYuv) = (&recipe.value, recipe.curve) else { return Ok(None) };
    let mut channels = Vec::new();
    for expr in exprs.iter() {
        let Expr::Dot { plane, table, row: None } = *expr else { return Ok(None) };
        let (spec, count) = (&recipe.planes[plane], recipe.planes[plane].count());
        let TableSpec { axes, range, .. } = &recipe.tables[table];
        let known = axes[..] == [Axis::View, Axis::Light, Axis::Component(count)] && range.is_none();
        if !known || spec.per_view() || spec.range().is_some() {
            return Ok(None);
        }
        let texels = parts.plane(plane, 0, Rect::whole(meta))?.to_f32().to_vec();
        channels.push(Channel { count, directions: parts.table(table)?.to_f32().to_vec(), texels });
    }
    let Ok(channels) = channels.try_into() else { return Ok(None) };
    Ok(Some(Arc::new(ChannelsBtf { meta: meta.clone(), channels, model: ColorModel::plain(LOG_Y) })))
}

impl ChannelsBtf {
    /// Linear light, clamped at zero.
    fn linear(&self, [y, u, v]: [f32; 3]) -> Vec3 {
        // the upper bound keeps the values of a damaged file finite
        Vec3::from(self.model.decode([y.min(40.0), u, v])).max(Vec3::ZERO)
    }
}

impl Decoder for ChannelsBtf {
    fn decode(&self, view: usize, lights: Range<usize>, out: &mut [f32]) -> Result<()> {
        let meta = &self.meta;
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

    fn material(self: Arc<Self>, Interpolation { scheme, blending }: Interpolation) -> Result<Arc<dyn Material>> {
        let angles = Angles::new(&self.meta, scheme)?;
        let material = ChannelsMaterial { btf: self.clone(), angles, blending };
        Ok(Arc::new(Sampled::new(material, &self.meta, scheme)?))
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

struct ChannelsMaterial {
    btf: Arc<ChannelsBtf>,
    angles: Angles,
    blending: Blending,
}

impl ChannelsMaterial {
    /// The interpolated value of a channel.
    fn value(&self, channel: &Channel, stencil: &AngularStencil, footprint: &Footprint) -> f32 {
        let lights = self.btf.meta.lights.len();
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

impl Material for ChannelsMaterial {
    fn apparent(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        let view = self.angles.views_around(wo);
        let mut light = LightStencil::NONE;
        let Some(stencil) = self.angles.lit(&view, wi, wo, &mut light) else { return Vec3::ZERO };
        let footprint = Footprint::new(uv, self.btf.meta.width, self.btf.meta.height);
        let value = |stencil: &AngularStencil, footprint: &Footprint| {
            let channels = self.btf.channels.each_ref().map(|channel| self.value(channel, stencil, footprint));
            self.btf.linear(channels) * stencil.factor
        };
        match self.blending {
            Blending::Linear => stencil.averaged(&footprint, value),
            _ => value(&stencil, &footprint),
        }
    }
}
