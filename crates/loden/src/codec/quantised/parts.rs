//! Index image and block as picture files.

use std::io::Cursor;
use std::path::Path;

use image::{ExtendedColorType, ImageFormat};
use rayon::prelude::*;

use super::QuantisedBtf;
use crate::btf::BtfSource;
use crate::output::write_file;
use crate::{Error, Result};

/// The index image: 16-bit grey, a pixel for each texel.
pub const INDEX_FILE: &str = "index.png";

/// The block: 8-bit display values, a row for each cluster, a pixel for each pair, light after light of each view.
pub const BLOCK_FILE: &str = "block.png";

impl QuantisedBtf {
    /// Writes [`INDEX_FILE`] and [`BLOCK_FILE`] into a folder, which is made if there is none. Values of the block outside 0..1
    /// are clamped.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn write_parts(&self, folder: &Path) -> Result<()> {
        std::fs::create_dir_all(folder).map_err(Error::io(folder))?;
        let meta = self.meta();
        let index: Vec<u8> = self.index().iter().flat_map(|k| k.to_ne_bytes()).collect();
        png(&folder.join(INDEX_FILE), &index, [meta.width, meta.height], ExtendedColorType::L16)?;
        let mut block = vec![0; self.clusters() * meta.pairs() * 3];
        block.par_chunks_exact_mut(meta.pairs() * 3).enumerate().try_for_each(|(cluster, row)| {
            let values = self.abrdf(cluster)?;
            row.iter_mut().zip(values).for_each(|(out, v)| *out = (v.clamp(0.0, 1.0) * 255.0).round() as u8);
            Ok::<(), Error>(())
        })?;
        png(&folder.join(BLOCK_FILE), &block, [meta.pairs(), self.clusters()], ExtendedColorType::Rgb8)
    }
}

fn png(path: &Path, bytes: &[u8], [width, height]: [usize; 2], colour: ExtendedColorType) -> Result<()> {
    let mut file = Cursor::new(Vec::new());
    image::write_buffer_with_format(&mut file, bytes, width as u32, height as u32, colour, ImageFormat::Png)
        .map_err(|e| Error::io(path)(std::io::Error::other(e)))?;
    write_file(path, |out| out.write_all(file.get_ref()))
}
