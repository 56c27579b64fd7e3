//! The two factored `.btf` formats: one factorisation per decorrelated channel, or one of all channels.

use std::io::Write;
use std::path::{Path, PathBuf};

use half::f16;
use rayon::prelude::*;

use super::bonn::{header, linear};
use super::{BtfWriter, check_complete, check_view};
use crate::btf::{BtfMeta, Texels};
use crate::color::model::{ColorModel, EPSILON, Written};
use crate::factor::stream::StreamedSvd;
use crate::output::{OutputFile, failed};
use crate::{Error, Result};

crate::params! {
    /// Size of the written factorisations.
    #[derive(Copy)]
    pub(super) struct Size {
        /// Components of each factorisation.
        pub components: usize [1..=4096] = 32,
        /// Single instead of half precision.
        pub single: bool,
    }
}

/// Collects the views and writes the file at the end.
pub(super) struct Factored {
    path: PathBuf,
    /// Created first, so that an unwritable path fails before the work.
    output: OutputFile,
    meta: BtfMeta,
    size: Size,
    model: ColorModel,
    /// One per channel, or one for all.
    parts: Vec<StreamedSvd>,
    next: usize,
}

impl Factored {
    /// Begins a file with a factorisation per channel of the colour model, or of all channels if there is none.
    pub(super) fn create(
        path: &Path,
        meta: &BtfMeta,
        size: Size,
        color_model: Option<Written>,
    ) -> Result<Box<dyn BtfWriter>> {
        meta.check_grid("a .btf file")?;
        let model = ColorModel::plain(color_model.unwrap_or(Written::Rgb).number());
        let (parts, rows) = if color_model.is_some() { (3, meta.pairs()) } else { (1, 3 * meta.pairs()) };
        let part = |_| StreamedSvd::with_spare(meta.texels(), rows, size.components);
        let parts = (0..parts).map(part).collect();
        let output = OutputFile::create(path)?;
        Ok(Box::new(Self { path: path.into(), output, meta: meta.clone(), size, model, parts, next: 0 }))
    }

    /// The rows of part `part` of one image.
    fn rows(&self, part: usize, rgb: &[f32]) -> Vec<f32> {
        if self.parts.len() == 3 {
            return self.model.channel(part, rgb);
        }
        // the format's dynamic range reduction: a logarithm
        let value = |v: f32| (v.max(0.0) + EPSILON).ln();
        (0..3).flat_map(|c| rgb.iter().skip(c).step_by(3).map(move |&v| value(v))).collect()
    }

    fn bytes(&self) -> Vec<u8> {
        let separate = self.parts.len() == 3;
        let signature: &[u8] = if separate { b"!DFMF08FCR" } else { b"!FMF12FCER" };
        let mut bytes = header(signature, &self.meta);
        let u32s = |bytes: &mut Vec<u8>, values: &[usize]| {
            values.iter().for_each(|&v| bytes.extend((v as u32).to_le_bytes()));
        };
        u32s(&mut bytes, &[0]);
        let scalar = if self.size.single { 4 } else { 2 };
        let results: Vec<_> = self.parts.iter().map(|part| part.finish(self.size.components)).collect();
        if separate {
            u32s(&mut bytes, &[self.size.components]);
            bytes.extend(self.model.number.to_le_bytes());
            bytes.extend(self.model.mean.iter().chain(&self.model.matrix).flat_map(|v| v.to_le_bytes()));
        } else {
            bytes.push(1);
            u32s(&mut bytes, &[1, results[0].0.len()]);
        }
        for (singular, u, v) in &results {
            bytes.push(scalar);
            let rows = self.meta.pairs() * if separate { 1 } else { 3 };
            u32s(&mut bytes, &[singular.len(), rows, self.meta.texels()]);
            for values in [singular, u, v] {
                match scalar {
                    2 => bytes.extend(values.iter().flat_map(|&v| f16::from_f32(v).to_le_bytes())),
                    _ => bytes.extend(values.iter().flat_map(|v| v.to_le_bytes())),
                }
            }
        }
        bytes
    }
}

impl BtfWriter for Factored {
    fn view(&mut self, texels: &Texels<'_>) -> Result<()> {
        check_view(&self.meta, self.next, texels)?;
        let len = self.meta.image_len();
        let image = |light: usize| linear(&texels.part(light * len..(light + 1) * len), &self.meta);
        let images: Vec<Vec<f32>> = (0..self.meta.lights.len()).into_par_iter().map(image).collect();
        for part in 0..self.parts.len() {
            let block: Vec<f32> = images.par_iter().flat_map_iter(|rgb| self.rows(part, rgb)).collect();
            let problem = || Error::non_finite(format!("view {} of the source", self.next));
            self.parts[part].push(&block).ok_or_else(problem)?;
        }
        self.next += 1;
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<()> {
        check_complete(&self.meta, self.next)?;
        let bytes = self.bytes();
        let mut file = self.output.file();
        file.write_all(&bytes).map_err(failed(&self.path))?;
        self.output.commit()
    }
}
