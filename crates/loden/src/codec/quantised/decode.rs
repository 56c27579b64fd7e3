//! Decoding of images.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

use half::f16;

use super::{QuantisedMaterial, layout, precision};
use crate::btf::SampleType;
use crate::codec::Codec;
use crate::codec::container::{Container, Tensor};
use crate::codec::decoder::{Decoder, Opened};
use crate::color::domain::Domain;
use crate::direction::Scheme;
use crate::material::Material;
use crate::params::Values;
use crate::{Error, Result};

/// A BTF stored as an index image and a block of ABRDFs, with or without components.
#[derive(Debug)]
pub struct QuantisedBtf {
    opened: Opened,
    clusters: usize,
    /// (texel)
    index: Vec<u16>,
    precision: SampleType,
    /// What the numbers of the block are.
    domain: Domain,
    block: Tensor,
    range: Option<Tensor>,
    c: usize,
    /// Components and coefficients.
    components: Option<[Tensor; 2]>,
}

/// The rows of a block: at least one, and at most as many as the parameters say.
///
/// # Errors
/// [`Error::Invalid`] naming the file and the tensor.
pub fn stored_clusters(container: &Container, tensor: &str, params: &Values) -> Result<usize> {
    let clusters = container.shape(tensor).and_then(|shape| shape.first().copied()).unwrap_or(0);
    let most = params.integer("clusters") as usize;
    if (1..=most).contains(&clusters) {
        return Ok(clusters);
    }
    let problem = format!("found {clusters} clusters, expected 1 to {most}");
    Err(Error::invalid(container.path(), format!("tensor {tensor}"), problem))
}

/// An index image, whose numbers must be less than `clusters`.
///
/// # Errors
/// [`Error::Invalid`] naming the file and the tensor.
pub fn read_index(container: &Container, name: &str, tensor: &Tensor, clusters: usize) -> Result<Vec<u16>> {
    let bytes = container.u8(tensor).chunks_exact(super::index_bytes(clusters));
    let index: Vec<u16> =
        bytes.map(|b| b.iter().rev().fold(0, |number, &byte| number << 8 | u16::from(byte))).collect();
    match index.iter().position(|&k| usize::from(k) >= clusters) {
        Some(texel) => {
            let problem = format!("texel {texel} is in cluster {}, expected less than {clusters}", index[texel]);
            Err(Error::invalid(container.path(), format!("tensor {name}"), problem))
        }
        None => Ok(index),
    }
}

/// Stored numbers.
#[derive(Clone, Copy)]
enum Numbers<'a> {
    F32(&'a [f32]),
    F16(&'a [f16]),
    U8(&'a [u8]),
}

impl Numbers<'_> {
    #[inline(always)]
    fn at(&self, place: usize) -> f32 {
        match self {
            Self::F32(values) => values[place],
            Self::F16(values) => values[place].to_f32(),
            Self::U8(values) => f32::from(values[place]),
        }
    }
}

/// All numbers of a file.
#[derive(Clone, Copy)]
pub(super) struct Tables<'a> {
    /// (cluster, pair, rgb)
    block: Numbers<'a>,
    /// Offset and scale of 8-bit numbers, for each view.
    range: &'a [[f32; 2]],
    pairs: usize,
    lights: usize,
    c: usize,
    /// (cluster, component, pair, rgb)
    components: Numbers<'a>,
    /// (texel, component)
    coefficients: Numbers<'a>,
}

impl Tables<'_> {
    /// The mean of a cluster in pair number `pair`.
    #[inline(always)]
    fn mean(&self, cluster: usize, pair: usize) -> [f32; 3] {
        let place = 3 * (cluster * self.pairs + pair);
        let rgb = std::array::from_fn(|channel| self.block.at(place + channel));
        match self.range.get(pair / self.lights) {
            Some([offset, scale]) => rgb.map(|v| offset + scale * v),
            None => rgb,
        }
    }

    #[inline(always)]
    fn component(&self, cluster: usize, k: usize, pair: usize) -> [f32; 3] {
        let place = 3 * ((cluster * self.c + k) * self.pairs + pair);
        std::array::from_fn(|channel| self.components.at(place + channel))
    }

    /// The value of a texel of `cluster` in pair number `pair`.
    #[inline(always)]
    pub(super) fn value(&self, texel: usize, cluster: usize, pair: usize) -> [f32; 3] {
        let mut sum = self.mean(cluster, pair);
        for k in 0..self.c {
            let coefficient = self.coefficients.at(texel * self.c + k);
            add(&mut sum, coefficient, self.component(cluster, k, pair));
        }
        sum
    }
}

#[inline(always)]
fn add(sum: &mut [f32; 3], factor: f32, rgb: [f32; 3]) {
    sum.iter_mut().zip(rgb).for_each(|(sum, v)| *sum += factor * v);
}

impl QuantisedBtf {
    /// Checks the tensors of an open container: a block of display values.
    ///
    /// # Errors
    /// [`Error::Invalid`] naming the file and the tensor or field.
    pub fn new(container: Container, codec: &dyn Codec) -> Result<Self> {
        Self::with_components(container, codec, Domain::Display, 0)
    }

    /// Checks the tensors of an open container: a block of numbers in `domain`, and `c` components, 0 for none.
    ///
    /// # Errors
    /// [`Error::Invalid`] naming the file and the tensor or field.
    pub fn with_components(container: Container, codec: &dyn Codec, domain: Domain, c: usize) -> Result<Self> {
        let opened = Opened::new(container, codec)?;
        let Opened { container, params, meta, .. } = &opened;
        let clusters = stored_clusters(container, "block", params)?;
        let precision = precision(params);
        let mut tensors = layout(meta, clusters, c, precision)
            .into_iter()
            .map(|spec| Ok((spec.name.clone(), container.tensor(&spec.name, spec.sample_type, &spec.shape)?)))
            .collect::<Result<BTreeMap<_, _>>>()?;
        let mut take = |name: &str| {
            tensors
                .remove(name)
                .ok_or_else(|| Error::invalid(container.path(), format!("tensor {name}"), "it is missing"))
        };
        let (index, block) = (take("index")?, take("block")?);
        let range = if precision == SampleType::U8 { Some(take("block_range")?) } else { None };
        let components = if c > 0 { Some([take("components")?, take("coefficients")?]) } else { None };
        let index = read_index(container, "index", &index, clusters)?;
        Ok(Self { opened, clusters, index, precision, domain, block, range, c, components })
    }

    /// Rows of the block.
    pub fn clusters(&self) -> usize {
        self.clusters
    }

    /// The index image: the cluster of each texel, row by row from the top.
    pub fn index(&self) -> &[u16] {
        &self.index
    }

    /// A row of the block: the display values of a cluster, (view, light, rgb).
    ///
    /// # Errors
    /// [`Error::Parameter`] if there is no such cluster.
    pub fn abrdf(&self, cluster: usize) -> Result<Vec<f32>> {
        if cluster >= self.clusters {
            let problem = format!("found {cluster}, expected less than {}", self.clusters);
            return Err(Error::parameter("cluster", problem));
        }
        let (tables, encoding) = (self.tables(), self.opened.meta.encoding);
        let display = |v: f32| Domain::Display.from_stored(encoding, self.domain.to_stored(encoding, v));
        Ok((0..self.opened.meta.pairs()).flat_map(|pair| tables.mean(cluster, pair).map(display)).collect())
    }

    /// What the numbers of the block are.
    pub(super) fn domain(&self) -> Domain {
        self.domain
    }

    fn numbers(&self, tensor: &Tensor) -> Numbers<'_> {
        match self.precision {
            SampleType::F32 => Numbers::F32(self.opened.container.f32(tensor)),
            SampleType::F16 => Numbers::F16(self.opened.container.f16(tensor)),
            SampleType::U8 => Numbers::U8(self.opened.container.u8(tensor)),
        }
    }

    pub(super) fn tables(&self) -> Tables<'_> {
        let [components, coefficients] = match &self.components {
            Some(tensors) => [self.numbers(&tensors[0]), self.numbers(&tensors[1])],
            None => [Numbers::U8(&[]); 2],
        };
        Tables {
            block: self.numbers(&self.block),
            range: self.range.as_ref().map_or(&[], |range| bytemuck::cast_slice(self.opened.container.f32(range))),
            pairs: self.opened.meta.pairs(),
            lights: self.opened.meta.lights.len(),
            c: self.c,
            components,
            coefficients,
        }
    }
}

impl Decoder for QuantisedBtf {
    fn opened(&self) -> &Opened {
        &self.opened
    }

    fn decode(&self, view: usize, lights: Range<usize>, out: &mut [f32]) -> Result<()> {
        let (tables, c, encoding) = (self.tables(), self.c, self.opened.meta.encoding);
        let coefficients: Vec<f32> = (0..c * self.opened.meta.texels()).map(|i| tables.coefficients.at(i)).collect();
        // means and components of all clusters in one pair
        let mut palette = vec![[0.0; 3]; self.clusters * (1 + c)];
        for (light, out) in lights.zip(out.chunks_exact_mut(self.opened.meta.image_len())) {
            let pair = view * self.opened.meta.lights.len() + light;
            for (cluster, rows) in palette.chunks_exact_mut(1 + c).enumerate() {
                rows[0] = tables.mean(cluster, pair);
                rows[1..].iter_mut().enumerate().for_each(|(k, row)| *row = tables.component(cluster, k, pair));
                if c == 0 {
                    rows[0] = rows[0].map(|v| self.domain.to_stored(encoding, v));
                }
            }
            for (texel, (out, &cluster)) in out.chunks_exact_mut(3).zip(&self.index).enumerate() {
                let rows = &palette[usize::from(cluster) * (1 + c)..][..1 + c];
                let mut sum = rows[0];
                for (&coefficient, &row) in coefficients[texel * c..].iter().zip(&rows[1..]) {
                    add(&mut sum, coefficient, row);
                }
                out.copy_from_slice(&sum);
            }
            if c > 0 && !self.domain.is_stored(encoding) {
                out.iter_mut().for_each(|v| *v = self.domain.to_stored(encoding, *v));
            }
        }
        Ok(())
    }
    fn table_bytes(&self) -> u64 {
        let tensors = self.components.iter().flatten().chain(&self.range).chain([&self.block]);
        let bytes: usize = tensors.map(|tensor| self.opened.container.u8(tensor).len()).sum();
        (bytes + size_of_val(&self.index[..])) as u64
    }

    fn evaluable(self: Arc<Self>, scheme: Scheme) -> Result<Arc<dyn Material>> {
        Ok(Arc::new(QuantisedMaterial::new(self, scheme)?))
    }

    fn clusters(&self) -> Option<&QuantisedBtf> {
        Some(self)
    }
}
