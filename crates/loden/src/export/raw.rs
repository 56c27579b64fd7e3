//! `raw`: a plain array of numbers with a small TOML file beside it, as read by [`crate::import`].

use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use super::{BtfWriter, Exporter, check_complete, check_view, substitutes};
use crate::btf::{BtfMeta, BtfSource, SampleType, Texels};
use crate::import::raw::Description;
use crate::output::{OutputFile, failed, write_file};
use crate::params::Values;
use crate::{Error, Result};

pub(super) struct Raw;

impl Exporter for Raw {
    fn name(&self) -> &'static str {
        "raw"
    }

    fn doc(&self) -> &'static str {
        "`NAME.toml` with the plain array `NAME.u8`, `.f16` or `.f32` beside it; the source's numbers, unchanged."
    }

    fn ending(&self) -> Option<&'static str> {
        None
    }

    fn beside(&self, path: &Path) -> Vec<PathBuf> {
        ["u8", "f16", "f32"].map(|extension| path.with_extension(extension)).to_vec()
    }

    fn accepts(&self, path: &Path) -> bool {
        path.extension().is_some_and(|e| e == "toml")
    }

    fn losses(&self, source: &dyn BtfSource) -> Vec<&'static str> {
        substitutes(source).into_iter().collect()
    }

    fn create(&self, path: &Path, meta: &BtfMeta, _options: &Values) -> Result<Box<dyn BtfWriter>> {
        let extension = match meta.sample_type {
            SampleType::U8 => "u8",
            SampleType::F16 => "f16",
            SampleType::F32 => "f32",
        };
        let data = path.with_extension(extension);
        let description = Description {
            loden_raw: 1,
            data: data.file_name().map(PathBuf::from).unwrap_or_default(),
            sample_type: meta.sample_type,
            shape: [meta.views.len(), meta.lights.len(), meta.height, meta.width, 3].map(|n| n as u64),
            encoding: meta.encoding,
            cosine: meta.cosine,
            views: meta.views.clone(),
            lights: meta.lights.clone(),
        };
        let toml = toml::to_string(&description).map_err(|e| Error::invalid(path, "description", e.to_string()))?;
        let output = OutputFile::create(data)?;
        Ok(Box::new(RawWriter { toml, path: path.into(), output, meta: meta.clone(), next: 0 }))
    }
}

struct RawWriter {
    toml: String,
    path: PathBuf,
    output: OutputFile,
    meta: BtfMeta,
    next: usize,
}

impl BtfWriter for RawWriter {
    fn view(&mut self, texels: &Texels<'_>) -> Result<()> {
        let bytes: &[u8] = match texels {
            Texels::U8(values) => values,
            Texels::F16(values) => bytemuck::cast_slice(values),
            Texels::F32(values) => bytemuck::cast_slice(values),
        };
        check_view(&self.meta, self.next, texels)?;
        self.next += 1;
        let mut file = BufWriter::new(self.output.file());
        file.write_all(bytes).and_then(|()| file.flush()).map_err(failed(self.output.path()))
    }

    fn finish(self: Box<Self>) -> Result<()> {
        check_complete(&self.meta, self.next)?;
        // write the description last: its presence proves the data complete
        self.output.commit()?;
        write_file(&self.path, |file| file.write_all(self.toml.as_bytes()))
    }
}
