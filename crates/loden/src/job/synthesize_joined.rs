//! Several samples side by side, as one.

use std::sync::Arc;

use crate::btf::{BtfMeta, BtfSource, SampleType, Texels};
use crate::{Error, Result};

/// Columns between samples, which repeat the edge of the one before and are not copied.
const GAP: usize = 1;

/// Samples of the same directions, from left to right. Lower ones are continued downwards by their last row.
pub(super) struct Joined {
    meta: BtfMeta,
    samples: Vec<Arc<dyn BtfSource>>,
}

impl Joined {
    /// # Errors
    /// [`Error::Parameter`] if samples differ in their directions or conventions, or are too wide together.
    pub(super) fn new(samples: Vec<Arc<dyn BtfSource>>) -> Result<Self> {
        let first = samples.first().ok_or_else(|| Error::parameter("with", "there is no sample"))?.meta().clone();
        for sample in &samples {
            let meta = sample.meta();
            let same = [
                ("view directions", meta.views == first.views),
                ("light directions", meta.lights == first.lights),
                ("an encoding", meta.encoding == first.encoding),
                ("a cosine", meta.cosine == first.cosine),
            ];
            if let Some((what, _)) = same.iter().find(|(_, same)| !same) {
                return Err(Error::parameter("with", format!("the samples must have {what} in common")));
            }
        }
        let width = samples.iter().map(|sample| sample.meta().width + GAP).sum::<usize>() - GAP;
        let height = samples.iter().map(|sample| sample.meta().height).max().unwrap_or(1);
        Ok(Self { meta: BtfMeta { width, height, sample_type: SampleType::F32, ..first }, samples })
    }

    /// For each texel the number of its sample; none between and below samples.
    pub(super) fn places(&self) -> Vec<Option<usize>> {
        let mut row = Vec::new();
        for (number, sample) in self.samples.iter().enumerate() {
            row.extend((0..sample.meta().width).map(|_| Some(number)));
            row.extend([None; GAP]);
        }
        row.truncate(self.meta.width);
        let inside = |y: usize, number: usize| y < self.samples[number].meta().height;
        (0..self.meta.height)
            .flat_map(|y| row.iter().map(move |number| number.filter(|number| inside(y, *number))).collect::<Vec<_>>())
            .collect()
    }
}

impl BtfSource for Joined {
    fn meta(&self) -> &BtfMeta {
        &self.meta
    }

    fn view(&self, view: usize) -> Result<Texels<'_>> {
        let images = (0..self.meta.lights.len()).map(|light| Ok(self.image(view, light)?.to_f32().into_owned()));
        Ok(Texels::F32(images.collect::<Result<Vec<_>>>()?.concat().into()))
    }

    fn image(&self, view: usize, light: usize) -> Result<Texels<'_>> {
        let mut joined = vec![0.0; self.meta.image_len()];
        let mut left = 0;
        for sample in &self.samples {
            let (width, height) = (sample.meta().width, sample.meta().height);
            let image = sample.image(view, light)?;
            let numbers = image.to_f32();
            let end = (left + width + GAP).min(self.meta.width);
            for (y, row) in joined.chunks_exact_mut(3 * self.meta.width).enumerate() {
                let from = &numbers[3 * width * y.min(height - 1)..][..3 * width];
                row[3 * left..3 * (left + width)].copy_from_slice(from);
                for gap in row[3 * (left + width)..3 * end].chunks_exact_mut(3) {
                    gap.copy_from_slice(&from[3 * width - 3..]);
                }
            }
            left = end;
        }
        Ok(Texels::F32(joined.into()))
    }

    fn release(&self, view: usize) {
        self.samples.iter().for_each(|sample| sample.release(view));
    }

    fn source_bytes(&self) -> u64 {
        self.samples.iter().map(|sample| sample.source_bytes()).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::btf::{Cosine, MemoryBtf};
    use crate::color::Encoding;
    use crate::direction::DirectionSet;

    fn constant(width: usize, height: usize, value: f32, encoding: Encoding) -> Arc<dyn BtfSource> {
        let set = || DirectionSet::from_degrees(vec![[0.0, 0.0], [45.0, 0.0], [45.0, 180.0]]).unwrap();
        let (cosine, sample_type) = (Cosine::Included, SampleType::F32);
        let meta = BtfMeta { width, height, views: set(), lights: set(), encoding, cosine, sample_type };
        let texels = vec![value; meta.pairs() * meta.image_len()];
        Arc::new(MemoryBtf::new(meta, Texels::F32(texels.into())).unwrap())
    }

    #[test]
    fn samples_stand_side_by_side() {
        let joined =
            Joined::new(vec![constant(2, 3, 0.2, Encoding::Srgb), constant(3, 1, 0.7, Encoding::Srgb)]).unwrap();
        assert_eq!((joined.meta.width, joined.meta.height), (6, 3));
        let image = joined.image(1, 2).unwrap().to_f32().into_owned();
        let row: Vec<f32> = image[18..36].iter().step_by(3).copied().collect();
        assert_eq!(row, [0.2, 0.2, 0.2, 0.7, 0.7, 0.7]);
        let (a, b) = (Some(0), Some(1));
        assert_eq!(joined.places()[..12], [a, a, None, b, b, b, a, a, None, None, None, None]);
        assert_eq!(joined.view(0).unwrap().len(), joined.meta.view_len());
        let error = Joined::new(vec![constant(2, 3, 0.2, Encoding::Srgb), constant(2, 3, 0.2, Encoding::Linear)]);
        assert_eq!(error.err().unwrap().to_string(), "with: the samples must have an encoding in common");
    }
}
