//! Writing factors.

use std::path::Path;

use crate::Result;
use crate::btf::{BtfSource, SampleType};
use crate::codec::container::Writer;
use crate::codec::values::halves;
use crate::codec::{Codec, EncodeSummary};
use crate::color::domain::Domain;
use crate::params::Values;

/// Writes a factored BTF piece by piece, in any order and from any thread.
pub struct FactorWriter {
    writer: Writer,
    components: usize,
    precision: SampleType,
    domain: Option<Domain>,
}

impl FactorWriter {
    /// Checks the parameters and begins the file `path`.
    ///
    /// # Errors
    /// [`crate::Error::Parameter`] if the number of components exceeds the rank; [`crate::Error::Io`].
    pub fn create(path: &Path, codec: &dyn Codec, params: &Values, source: &dyn BtfSource) -> Result<Self> {
        let recipe = codec.recipe(source.meta(), params)?;
        let writer = Writer::create(path, codec, params, source, &recipe)?;
        let precision = recipe.planes[0].sample_type().unwrap_or(SampleType::F32);
        Ok(Self { writer, components: recipe.planes[0].count(), precision, domain: recipe.curve.domain() })
    }

    /// The domain of the factors.
    pub fn domain(&self) -> Domain {
        self.domain.unwrap_or(Domain::Linear)
    }

    /// Number of components.
    pub fn components(&self) -> usize {
        self.components
    }

    /// Writes the mean (light, rgb), if there is one, and the basis (component, light, rgb) of a view.
    ///
    /// # Errors
    /// [`crate::Error::Io`]; [`crate::Error::Parameter`] if a number exceeds half precision.
    pub fn basis(&self, view: usize, mean: &[f32], basis: &[f32]) -> Result<()> {
        if self.writer.has("mean") {
            self.put("mean", view, bytemuck::cast_slice(mean))?;
        }
        match self.precision {
            SampleType::F32 => self.put("basis", view, bytemuck::cast_slice(basis)),
            _ => self.put("basis", view, bytemuck::cast_slice(&halves(basis, &format!("view {view}"))?)),
        }
    }

    /// Writes the coefficients (texel, component) of a view, or those that all views share.
    ///
    /// # Errors
    /// As [`FactorWriter::basis`].
    pub fn coefficients(&self, view: usize, coefficients: &[f32]) -> Result<()> {
        match self.precision {
            SampleType::F32 => self.put("coefficients", view, bytemuck::cast_slice(coefficients)),
            SampleType::F16 => {
                self.put("coefficients", view, bytemuck::cast_slice(&halves(coefficients, &format!("view {view}"))?))
            }
            SampleType::U8 => {
                let (ranges, bytes) = quantise(coefficients, self.components);
                self.put("coefficients_range", view, bytemuck::cast_slice(&ranges))?;
                self.put("coefficients", view, &bytes)
            }
        }
    }

    /// Writes one block of a tensor.
    fn put(&self, tensor: &str, block: usize, data: &[u8]) -> Result<()> {
        self.writer.write(tensor, (block * data.len()) as u64, data)
    }

    /// Finishes the file and returns its size in bytes.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn commit(self) -> Result<EncodeSummary> {
        Ok(EncodeSummary { bytes: self.writer.commit()?, warnings: Vec::new() })
    }
}

/// Quantises each of the `c` interleaved components to 8 bits over its range; returns (offset, scale) pairs and the
/// bytes.
fn quantise(values: &[f32], c: usize) -> (Vec<[f32; 2]>, Vec<u8>) {
    let mut bounds = vec![(f32::INFINITY, f32::NEG_INFINITY); c];
    for texel in values.chunks_exact(c) {
        for (bound, &v) in bounds.iter_mut().zip(texel) {
            *bound = (bound.0.min(v), bound.1.max(v));
        }
    }
    let ranges: Vec<[f32; 2]> = bounds.iter().map(|(low, high)| [*low, (high - low) / 255.0]).collect();
    let inverse: Vec<f32> = ranges.iter().map(|[_, scale]| if *scale > 0.0 { 1.0 / scale } else { 0.0 }).collect();
    let mut bytes = Vec::with_capacity(values.len());
    for texel in values.chunks_exact(c) {
        let quantised =
            texel.iter().zip(&ranges).zip(&inverse).map(|((v, r), inverse)| ((v - r[0]) * inverse + 0.5) as u8);
        bytes.extend(quantised);
    }
    (ranges, bytes)
}
