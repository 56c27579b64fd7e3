//! `bdi`: `.btf` files with every value in half precision, texel by texel.
//!
//! # Format
//! As read by the importer `ubo2014`: version 4, signature `!BDIF06R2!`, uncompressed, one scan line per chunk, bottom row
//! first.
//!
//! # Limits
//! Must be chosen by name: the extension `.btf` stands for `dfmf`. Values beyond 65504, the range of half precision, are
//! refused.

use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use half::f16;

use super::bonn::{header, linear};
use super::{BtfWriter, Exporter, check_complete, check_view, substitutes};
use crate::btf::{BtfMeta, BtfSource, Texels};
use crate::output::{OutputFile, failed};
use crate::params::Values;
use crate::{Error, Result};

pub(super) struct Bdi;

impl Exporter for Bdi {
    fn name(&self) -> &'static str {
        "bdi"
    }

    fn doc(&self) -> &'static str {
        "`NAME.btf` with `--to bdi`: Bonn's format of all values in half precision, large."
    }

    fn ending(&self) -> Option<&'static str> {
        Some("btf")
    }

    fn accepts(&self, _path: &Path) -> bool {
        false
    }

    fn losses(&self, source: &dyn BtfSource) -> Vec<&'static str> {
        substitutes(source).into_iter().chain(["precision beyond 11 bits"]).collect()
    }

    fn create(&self, path: &Path, meta: &BtfMeta, _options: &Values) -> Result<Box<dyn BtfWriter>> {
        meta.check_grid("a .btf file")?;
        let texel = meta.pairs() as u64 * 6;
        let line = texel * meta.width as u64;
        if line > u64::from(u32::MAX) {
            return Err(Error::unsupported(path, format!("a scan line of {line} bytes does not fit into a chunk")));
        }
        let output = OutputFile::create(path)?;
        let mut bytes = header(b"!BDIF06R2!", meta);
        bytes.extend(1u32.to_le_bytes());
        bytes.push(0);
        bytes.resize(bytes.len() + meta.texels(), 1);
        bytes.extend(0u32.to_le_bytes());
        let start = bytes.len() as u64;
        let mut file = BufWriter::new(output.file());
        file.write_all(&bytes).map_err(failed(path))?;
        for row in 0..meta.height as u64 {
            let at = SeekFrom::Start(start + row * (line + 4));
            file.seek(at).and_then(|_| file.write_all(&(line as u32).to_le_bytes())).map_err(failed(path))?;
        }
        file.flush().map_err(failed(path))?;
        drop(file);
        Ok(Box::new(Writer { path: path.into(), output, meta: meta.clone(), start, next: 0 }))
    }
}

struct Writer {
    path: PathBuf,
    output: OutputFile,
    meta: BtfMeta,
    start: u64,
    next: usize,
}

impl BtfWriter for Writer {
    fn view(&mut self, texels: &Texels<'_>) -> Result<()> {
        check_view(&self.meta, self.next, texels)?;
        let (len, lights) = (self.meta.image_len(), self.meta.lights.len());
        let images: Vec<Vec<f32>> =
            (0..lights).map(|light| linear(&texels.part(light * len..(light + 1) * len), &self.meta)).collect();
        let texel_bytes = self.meta.pairs() as u64 * 6;
        let line = texel_bytes * self.meta.width as u64 + 4;
        let mut file = self.output.file();
        let mut block = Vec::with_capacity(lights * 6);
        for texel in 0..self.meta.texels() {
            block.clear();
            for image in &images {
                block.extend(image[3 * texel..3 * texel + 3].iter().flat_map(|&v| f16::from_f32(v).to_le_bytes()));
            }
            if let Some(value) =
                images.iter().flat_map(|i| &i[3 * texel..3 * texel + 3]).find(|v| !f16::from_f32(**v).is_finite())
            {
                if !value.is_finite() {
                    return Err(Error::non_finite(format!("view {} of the source", self.next)));
                }
                let problem = format!("view {} holds {value}, expected values of at most {}", self.next, f16::MAX);
                return Err(Error::unsupported(&self.path, problem));
            }
            let (x, y) = ((texel % self.meta.width) as u64, (texel / self.meta.width) as u64);
            let at = self.start + y * line + 4 + x * texel_bytes + (self.next * lights * 6) as u64;
            file.seek(SeekFrom::Start(at)).and_then(|_| file.write_all(&block)).map_err(failed(&self.path))?;
        }
        self.next += 1;
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<()> {
        check_complete(&self.meta, self.next)?;
        self.output.commit()
    }
}
