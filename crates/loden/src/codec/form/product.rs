//! Fast decoder of recipes that are a product of three tables, over lights, half vectors and views, each chosen by
//! its own index plane.

use std::ops::Range;
use std::sync::Arc;

use glam::{Vec2, Vec3};

use crate::Result;
use crate::btf::{BtfMeta, Rect};
use crate::codec::decoder::Decoder;
use crate::codec::parts::{Axis, Expr, Numbers, Parts, PlaneKind};
use crate::color::domain::{Domain, Linearizer};
use crate::direction::{Scheme, half};
use crate::material::Material;
use crate::material::angles::{Angles, AngularStencil, Footprint};
use crate::material::sampled::Sampled;
use crate::separable::Grid;

/// The clustered factors of one kind.
#[derive(Debug)]
struct Factors {
    /// (cluster, place)
    values: Vec<Vec3>,
    size: usize,
    /// (texel)
    index: Vec<u16>,
}

impl Factors {
    /// The factor of the recipe whose table has this axis, besides rows and channels.
    fn find(parts: &dyn Parts, terms: &[Expr], axis: impl Fn(Axis) -> bool) -> Result<Option<Self>> {
        let recipe = parts.recipe();
        for term in terms {
            let Expr::Table { table, row: Some(row) } = *term else { continue };
            let (spec, PlaneKind::Index { rows }) = (&recipe.tables[table], &recipe.planes[row].kind) else { continue };
            let [Axis::Row(_), middle, Axis::Channel] = spec.axes[..] else { continue };
            if !axis(middle) || spec.range.is_some() {
                continue;
            }
            let Numbers::Index(index) = parts.plane(row, 0, Rect::whole(parts.meta()))? else { continue };
            let values: Vec<Vec3> = parts.table(table)?.to_f32().chunks_exact(3).map(Vec3::from_slice).collect();
            return Ok(Some(Self { size: values.len() / rows, values, index: index.to_vec() }));
        }
        Ok(None)
    }

    /// A texel's values at a list of weighted places.
    fn of_texel(&self, texel: usize, places: impl Iterator<Item = (usize, f32)>) -> Vec3 {
        self.of_cluster(usize::from(self.index[texel]), places)
    }

    fn of_cluster(&self, cluster: usize, places: impl Iterator<Item = (usize, f32)>) -> Vec3 {
        let row = &self.values[cluster * self.size..][..self.size];
        places.map(|(place, weight)| row[place] * weight).sum()
    }

    /// All clusters' values at a list of weighted places.
    fn palette(&self, places: impl Iterator<Item = (usize, f32)> + Clone) -> Vec<Vec3> {
        (0..self.values.len() / self.size).map(|cluster| self.of_cluster(cluster, places.clone())).collect()
    }
}

/// All factors in single precision.
#[derive(Debug)]
struct ProductBtf {
    meta: BtfMeta,
    domain: Domain,
    resolution: usize,
    light: Factors,
    half: Factors,
    view: Factors,
}

/// See [`super::FORMS`].
///
/// # Errors
/// Errors of reading the parts.
pub fn form(parts: &Arc<dyn Parts>) -> Result<Option<Arc<dyn Decoder>>> {
    let (meta, recipe) = (parts.meta(), parts.recipe());
    let (Expr::Product(terms), Some(domain)) = (&recipe.value, recipe.curve.domain()) else { return Ok(None) };
    if terms.len() != 3 {
        return Ok(None);
    }
    let find = |axis: &dyn Fn(Axis) -> bool| Factors::find(&**parts, terms, axis);
    let (Some(light), Some(half), Some(view)) = (
        find(&|axis| axis == Axis::Light)?,
        find(&|axis| matches!(axis, Axis::Half(_)))?,
        find(&|axis| axis == Axis::View)?,
    ) else {
        return Ok(None);
    };
    let resolution = half.size.isqrt();
    Ok(Some(Arc::new(ProductBtf { meta: meta.clone(), domain, resolution, light, half, view })))
}

impl Decoder for ProductBtf {
    fn decode(&self, view: usize, lights: Range<usize>, out: &mut [f32]) -> Result<()> {
        let meta = &self.meta;
        let indices = [&self.light, &self.half, &self.view].map(|factors| &factors.index[..]);
        for (light, out) in lights.zip(out.chunks_exact_mut(meta.image_len())) {
            let wh = half(meta.lights.directions()[light], meta.views.directions()[view]);
            let p = self.light.palette([(light, 1.0)].into_iter());
            let q = self.half.palette(Grid::stencil(self.resolution, wh).into_iter());
            let r = self.view.palette([(view, 1.0)].into_iter());
            for (texel, out) in out.chunks_exact_mut(3).enumerate() {
                let [i, j, k] = indices.map(|index| usize::from(index[texel]));
                let value = p[i] * q[j] * r[k];
                out.copy_from_slice(&value.to_array().map(|v| self.domain.to_stored(meta.encoding, v)));
            }
        }
        Ok(())
    }

    fn table_bytes(&self) -> u64 {
        let bytes = |f: &Factors| size_of_val(&f.values[..]) + size_of_val(&f.index[..]);
        [&self.light, &self.half, &self.view].map(bytes).iter().sum::<usize>() as u64
    }

    fn material(self: Arc<Self>, scheme: Scheme) -> Result<Arc<dyn Material>> {
        let angles = Angles::new(&self.meta, scheme)?;
        let linearizer = Linearizer::new(self.domain, self.meta.encoding);
        let material = ProductMaterial { btf: self.clone(), angles, linearizer };
        Ok(Arc::new(Sampled::new(material, &self.meta, scheme)?))
    }
}

/// Interpolates factors between directions, and their products between texels.
struct ProductMaterial {
    btf: Arc<ProductBtf>,
    angles: Angles,
    linearizer: Linearizer,
}

impl ProductMaterial {
    fn value(&self, texel: usize, stencil: &AngularStencil, wh: &[(usize, f32); 4]) -> Vec3 {
        let ProductBtf { light, half, view, .. } = &*self.btf;
        light.of_texel(texel, stencil.light.iter())
            * half.of_texel(texel, wh.iter().copied())
            * view.of_texel(texel, stencil.view.iter())
    }
}

impl Material for ProductMaterial {
    fn apparent(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        let view = self.angles.views_around(wo);
        let Some(stencil) = self.angles.lit(&view, wi) else { return Vec3::ZERO };
        let wh = Grid::stencil(self.btf.resolution, half(wi, wo));
        let footprint = Footprint::new(uv, self.btf.meta.width, self.btf.meta.height);
        let texels = footprint.texel.into_iter().zip(footprint.weight);
        let sum: Vec3 = texels.map(|(texel, weight)| self.value(texel, &stencil, &wh) * weight).sum();
        Vec3::from(sum.to_array().map(|v| self.linearizer.linear(v))) * stencil.factor
    }
}
