//! A codec of our own.

use std::path::Path;

use loden::Result;
use loden::btf::{BtfMeta, BtfSource, SampleType};
use loden::codec::container::SourceInfo;
use loden::codec::parts::{Axis, Curve, Expr, MemoryParts, Numbers, PlaneSpec, Provenance, Recipe, TableSpec, store};
use loden::codec::{Codec, EncodeSummary};
use loden::params::{Param, Params, Values};
use loden::progress::{Progress, Task};

/// Texels in classes of equally many by their brightness, each class with its mean for every pair of directions.
pub struct Means;

loden::params! {
    /// The parameters of [`Means`].
    pub struct Classes {
        /// Classes of texels.
        pub rows: usize [1..=256] = 4,
    }
}

impl Codec for Means {
    fn name(&self) -> &'static str {
        "means"
    }

    fn doc(&self) -> &'static str {
        "Classes of equally bright texels, and the mean of each."
    }

    fn params(&self) -> &'static [Param] {
        Classes::TABLE
    }

    fn recipe(&self, _: &BtfMeta, params: &Values) -> Result<Recipe> {
        let Classes { rows } = Classes::from_values(params)?;
        let axes = [Axis::Row(rows), Axis::View, Axis::Light, Axis::Channel];
        Ok(Recipe {
            planes: vec![PlaneSpec::index("class", rows)],
            tables: vec![TableSpec::new("mean", &axes, SampleType::F32)],
            value: Expr::Table { table: 0, row: Some(0) },
            curve: Curve::Linear,
        })
    }

    fn encode(
        &self,
        source: &dyn BtfSource,
        params: &Values,
        path: &Path,
        progress: &dyn Progress,
    ) -> Result<EncodeSummary> {
        let (meta, Classes { rows }) = (source.meta(), Classes::from_values(params)?);
        // sort the texels by brightness, from one image
        let image = source.image(0, 0)?.to_f32().into_owned();
        let brightness = |texel: usize| image[3 * texel..3 * texel + 3].iter().sum::<f32>();
        let mut order: Vec<usize> = (0..meta.texels()).collect();
        order.sort_by(|&a, &b| brightness(a).total_cmp(&brightness(b)));
        let mut class = vec![0u16; meta.texels()];
        order.iter().enumerate().for_each(|(place, &texel)| class[texel] = (place * rows / meta.texels()) as u16);
        // average the texels of each class
        let mut count = vec![0.0f32; rows];
        class.iter().for_each(|&row| count[usize::from(row)] += 1.0);
        let mut mean = vec![0.0f32; rows * 3 * meta.pairs()];
        let task = Task::new(progress, "means", meta.views.len() as u64);
        for view in 0..meta.views.len() {
            for (light, image) in source.view(view)?.to_f32().chunks_exact(meta.image_len()).enumerate() {
                for (rgb, &row) in image.chunks_exact(3).zip(&class) {
                    let pair = (usize::from(row) * meta.views.len() + view) * meta.lights.len() + light;
                    for (sum, &value) in mean[3 * pair..].iter_mut().zip(rgb) {
                        *sum += meta.encoding.decode(value) / count[usize::from(row)];
                    }
                }
            }
            task.advance(1)?;
        }
        let recipe = self.recipe(meta, params)?;
        let (planes, tables) = (vec![Numbers::Index(class.into())], vec![Numbers::F32(mean.into())]);
        let parts = MemoryParts::new(meta.clone(), recipe, planes, tables)?;
        let bytes = store(&parts, &Provenance::unknown(SourceInfo::new(source)?), path)?;
        Ok(EncodeSummary { bytes, warnings: Vec::new() })
    }
}
