//! The checkpoint file of an unfinished picture.
//!
//! # Model
//! Little-endian: 8 bytes `LODENCP1`; the SHA-256 of the scene's description; width, height and depth as 32-bit
//! numbers and the seed as a 64-bit number; for each tile of 16 x 16 pixels, row by row, the number of samples as a
//! 32-bit number, the sums of its pixels as triples in single precision, and the sums of squared luminances in single
//! precision; finally a CRC-32 of all this.

use std::fs;
use std::io::ErrorKind;
use std::ops::Deref;

use glam::Vec3;
use sha2::{Digest, Sha256};

use super::{Checkpoint, Grid, Settings, Tile};
use crate::output::write_file;
use crate::{Error, Result};

const MAGIC: &[u8; 8] = b"LODENCP1";
const HEAD: usize = 8 + 32 + 3 * 4 + 8;

impl Checkpoint {
    /// The tiles of the file; `None` if there is no such file.
    pub(super) fn read(&self, grid: Grid, settings: &Settings) -> Result<Option<Vec<Tile>>> {
        let bad = |field: &str, problem: String| Error::invalid(&self.path, field, problem);
        let expected = HEAD + 4 * grid.len() + 16 * grid.width * grid.height + 4;
        // a file of another size belongs to another picture and need not be read
        match fs::metadata(&self.path) {
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(Error::io(&self.path)(error)),
            Ok(found) if found.len() != expected as u64 => {
                let problem =
                    format!("found {} bytes, expected {expected}: it belongs to another picture", found.len());
                return Err(bad("size", problem));
            }
            Ok(_) => {}
        }
        let bytes = fs::read(&self.path).map_err(Error::io(&self.path))?;
        if bytes.len() != expected {
            return Err(bad("size", "it changed while being read".into()));
        }
        let (content, sum) = bytes.split_at(expected - 4);
        if crc32fast::hash(content).to_le_bytes() != sum {
            return Err(bad("checksum", "the file is damaged".into()));
        }
        if content[..HEAD] != self.head(grid, settings) {
            return Err(bad("scene", "the file belongs to another scene, size, depth or seed".into()));
        }
        Ok(Some(tiles(&content[HEAD..], grid)))
    }

    /// Replaces the file.
    pub(super) fn write(
        &self,
        grid: Grid,
        settings: &Settings,
        tiles: impl Iterator<Item = impl Deref<Target = Tile>>,
    ) -> Result<()> {
        let mut bytes = self.head(grid, settings).to_vec();
        for tile in tiles {
            bytes.extend(tile.count.to_le_bytes());
            tile.sum.iter().flat_map(|sum| sum.to_array()).for_each(|v| bytes.extend(v.to_le_bytes()));
            tile.square.iter().for_each(|v| bytes.extend(v.to_le_bytes()));
        }
        bytes.extend(crc32fast::hash(&bytes).to_le_bytes());
        write_file(&self.path, |file| file.write_all(&bytes))
    }

    fn head(&self, grid: Grid, settings: &Settings) -> [u8; HEAD] {
        let numbers = [grid.width as u32, grid.height as u32, settings.depth].map(u32::to_le_bytes).concat();
        let mut head = [0; HEAD];
        let scene = Sha256::digest(&self.scene);
        let parts = [&MAGIC[..], &scene, &numbers, &settings.seed.to_le_bytes()].concat();
        head.copy_from_slice(&parts);
        head
    }
}

fn tiles(bytes: &[u8], grid: Grid) -> Vec<Tile> {
    let mut words = bytes.chunks_exact(4).map(|word| [word[0], word[1], word[2], word[3]]);
    let mut next = || words.next().unwrap_or_default();
    (0..grid.len())
        .map(|index| {
            let mut tile = grid.empty(index);
            tile.count = u32::from_le_bytes(next());
            tile.sum.iter_mut().for_each(|sum| *sum = Vec3::from([0; 3].map(|_| f32::from_le_bytes(next()))));
            tile.square.iter_mut().for_each(|square| *square = f32::from_le_bytes(next()));
            tile
        })
        .collect()
}
