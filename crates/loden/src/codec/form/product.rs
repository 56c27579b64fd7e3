//! Fast decoder of recipes that are a product of tables over lights, views, half and difference vectors, or a sum of
//! such products; an index plane chooses the row of each.

use std::ops::Range;
use std::sync::Arc;

use glam::{Vec2, Vec3};

use crate::Result;
use crate::btf::{BtfMeta, Rect};
use crate::codec::decoder::Decoder;
use crate::codec::parts::{Axis, Expr, Numbers, Parts, PlaneKind};
use crate::color::domain::{Domain, Linearizer};
use crate::direction::Stencil;
use crate::material::angles::{Angles, AngularStencil, Footprint, LightStencil};
use crate::material::sampled::Sampled;
use crate::material::{Blending, Interpolation, Material};
use crate::separable::{Grid, Projection};

/// The clustered factors of one kind.
#[derive(Debug)]
struct Factors {
    /// (cluster, place)
    values: Vec<Vec3>,
    size: usize,
    /// What the places are.
    axis: Axis,
    /// (texel)
    index: Arc<[u16]>,
}

/// The places of each axis around a pair of directions, with weights.
struct Places {
    light: Stencil,
    view: Stencil,
    half: [(usize, f32); 4],
    difference: [(usize, f32); 4],
}

impl Factors {
    /// The factor of an expression; `None` if it has other axes than one direction, or no rows.
    fn new(parts: &dyn Parts, expr: &Expr) -> Result<Option<Self>> {
        let recipe = parts.recipe();
        let Expr::Table { table, row: Some(row) } = *expr else { return Ok(None) };
        let (spec, PlaneKind::Index { rows }) = (&recipe.tables[table], &recipe.planes[row].kind) else {
            return Ok(None);
        };
        let ([Axis::Row(_), axis, Axis::Channel], None) = (&spec.axes[..], spec.range) else { return Ok(None) };
        if !matches!(axis, Axis::Light | Axis::View | Axis::Half(_) | Axis::Difference(_)) {
            return Ok(None);
        }
        let Numbers::Index(index) = parts.plane(row, 0, Rect::whole(parts.meta()))? else { return Ok(None) };
        let values: Vec<Vec3> = parts.table(table)?.to_f32().chunks_exact(3).map(Vec3::from_slice).collect();
        Ok(Some(Self { size: values.len() / rows, values, axis: *axis, index: index.to_vec().into() }))
    }

    /// The value of a cluster around a pair.
    #[inline]
    fn value(&self, cluster: usize, places: &Places) -> Vec3 {
        let row = &self.values[cluster * self.size..][..self.size];
        let sum = |(place, weight): (usize, f32)| row[place] * weight;
        match self.axis {
            Axis::Light => places.light.iter().map(sum).sum(),
            Axis::View => places.view.iter().map(sum).sum(),
            Axis::Half(_) => places.half.into_iter().map(sum).sum(),
            _ => places.difference.into_iter().map(sum).sum(),
        }
    }
}

/// All factors in single precision.
#[derive(Debug)]
struct ProductBtf {
    meta: BtfMeta,
    domain: Domain,
    /// Nodes per side of the tables over half vectors and over difference vectors.
    sides: [usize; 2],
    /// (term, factor)
    terms: Vec<Vec<Factors>>,
}

/// See [`super::FORMS`].
///
/// # Errors
/// Errors of reading the parts.
pub fn form(parts: &Arc<dyn Parts>) -> Result<Option<Arc<dyn Decoder>>> {
    let (meta, recipe) = (parts.meta(), parts.recipe());
    let products = match &recipe.value {
        Expr::Sum(terms) => &terms[..],
        one => std::slice::from_ref(one),
    };
    let Some(domain) = recipe.curve.domain() else { return Ok(None) };
    let mut terms = Vec::new();
    for product in products {
        let Expr::Product(factors) = product else { return Ok(None) };
        let found = factors.iter().map(|expr| Factors::new(&**parts, expr)).collect::<Result<Option<Vec<_>>>>()?;
        let Some(found) = found else { return Ok(None) };
        terms.push(found);
    }
    let mut sides = [2, 2];
    for (k, side) in sides.iter_mut().enumerate() {
        let of_kind = |factors: &Factors| match factors.axis {
            Axis::Half(side) => (k == 0).then_some(side),
            Axis::Difference(side) => (k == 1).then_some(side),
            _ => None,
        };
        let mut found = terms.iter().flatten().filter_map(of_kind);
        *side = found.next().unwrap_or(*side);
        if found.any(|other| other != *side) {
            return Ok(None);
        }
    }
    Ok(Some(Arc::new(ProductBtf { meta: meta.clone(), domain, sides, terms })))
}

impl ProductBtf {
    fn places(&self, (wi, wo): (Vec3, Vec3), light: Stencil, view: Stencil) -> Places {
        let around = |side: usize, projection: Projection| Grid::stencil(side, projection.of(wi, wo));
        let half = around(self.sides[0], Projection::Half);
        Places { light, view, half, difference: around(self.sides[1], Projection::Difference) }
    }
}

impl Decoder for ProductBtf {
    fn decode(&self, view: usize, lights: Range<usize>, out: &mut [f32]) -> Result<()> {
        let meta = &self.meta;
        for (light, out) in lights.zip(out.chunks_exact_mut(meta.image_len())) {
            let places = self.places(meta.pair(view, light), Stencil::one(light), Stencil::one(view));
            // the values of all clusters
            let palette = |factors: &Factors| -> Vec<Vec3> {
                (0..factors.values.len() / factors.size).map(|cluster| factors.value(cluster, &places)).collect()
            };
            let palettes: Vec<Vec<Vec<Vec3>>> =
                self.terms.iter().map(|term| term.iter().map(palette).collect()).collect();
            for (texel, out) in out.chunks_exact_mut(3).enumerate() {
                let product = |(factors, palettes): (&Vec<Factors>, &Vec<Vec<Vec3>>)| -> Vec3 {
                    let values = factors.iter().zip(palettes).map(|(f, values)| values[usize::from(f.index[texel])]);
                    values.product()
                };
                let value: Vec3 = self.terms.iter().zip(&palettes).map(product).sum();
                out.copy_from_slice(&value.to_array().map(|v| self.domain.to_stored(meta.encoding, v)));
            }
        }
        Ok(())
    }

    fn table_bytes(&self) -> u64 {
        let bytes = |f: &Factors| size_of_val(&f.values[..]) + size_of_val(&f.index[..]);
        self.terms.iter().flatten().map(bytes).sum::<usize>() as u64
    }

    fn material(self: Arc<Self>, Interpolation { scheme, blending }: Interpolation) -> Result<Arc<dyn Material>> {
        let angles = Angles::new(&self.meta, scheme)?;
        let linearizer = Linearizer::new(self.domain, self.meta.encoding);
        let material = ProductMaterial { btf: self.clone(), angles, blending, linearizer };
        Ok(Arc::new(Sampled::new(material, &self.meta, scheme)?))
    }
}

/// Interpolates factors between directions, and sums of products between texels; or averages linear light.
struct ProductMaterial {
    btf: Arc<ProductBtf>,
    angles: Angles,
    blending: Blending,
    linearizer: Linearizer,
}

impl ProductMaterial {
    fn value(&self, texel: usize, places: &Places) -> Vec3 {
        let factor = |factors: &Factors| factors.value(usize::from(factors.index[texel]), places);
        self.btf.terms.iter().map(|term| term.iter().map(factor).product::<Vec3>()).sum()
    }
}

impl Material for ProductMaterial {
    fn apparent(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        let view = self.angles.views_around(wo);
        let mut light = LightStencil::NONE;
        let Some(stencil) = self.angles.lit(&view, wi, wo, &mut light) else { return Vec3::ZERO };
        let footprint = Footprint::new(uv, self.btf.meta.width, self.btf.meta.height);
        let mut places = self.btf.places((wi, wo), *stencil.light, *stencil.view);
        let mut value = |&AngularStencil { view, light, factor }: &AngularStencil, footprint: &Footprint| {
            (places.view, places.light) = (*view, *light);
            let texels = footprint.texel.into_iter().zip(footprint.weight).filter(|(_, weight)| *weight > 0.0);
            let sum: Vec3 = texels.map(|(texel, weight)| self.value(texel, &places) * weight).sum();
            sum.map(|v| self.linearizer.linear(v)) * factor
        };
        match self.blending {
            Blending::Linear => stencil.averaged(&footprint, value),
            _ => value(&stencil, &footprint),
        }
    }
}
