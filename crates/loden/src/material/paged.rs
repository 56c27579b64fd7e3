//! A BTF evaluated from its images, within a memory limit.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

use glam::Vec3;
use half::f16;
use rayon::prelude::*;

use super::images::{Corners, Images};
use super::interpolation::Interpolation;
use super::texels::{Lookup, TexelMaterial, TexelPoint};
use crate::btf::{BtfMeta, BtfSource, SampleType, Texels};
use crate::direction::Stencil;
use crate::memory::Memory;
use crate::progress::{Progress, Task};
use crate::{Error, Result};

/// Side of a block of texels that share a page.
const SIDE: usize = 4;

/// Pages per cache set.
const WAYS: usize = 8;

/// No page.
const NONE: u32 = u32::MAX;

/// The images of a BTF as a material that stays within a memory limit.
///
/// # Model
/// The images are rearranged once into a temporary file without a name. A page holds the texels of a 4 x 4 block seen
/// from one view under all lights, which is what neighbouring rays read. The most recently used pages stay in memory,
/// in sets of eight. Values are those of [`super::RawBtf`], bit for bit.
///
/// # Limits
/// The file is as large as the decoded images. While it is written, each thread also holds a band of one view;
/// together these take a quarter of the limit. The system's file cache is not counted.
#[derive(Debug)]
pub struct PagedBtf {
    images: Images,
    numbers: SampleType,
    file: File,
    /// The folder of the file, for errors.
    folder: PathBuf,
    /// Bytes of a page.
    page: usize,
    sets: Vec<Mutex<Set>>,
    read: AtomicU64,
    asked: AtomicU64,
}

/// A set of the page cache.
#[derive(Debug)]
struct Set {
    pages: [u32; WAYS],
    used: [u32; WAYS],
    clock: u32,
    /// Empty until the first page has been read.
    bytes: Vec<u8>,
}

impl PagedBtf {
    /// Reads all images once and writes them into a temporary file in `folder`.
    ///
    /// # Errors
    /// [`Error::Parameter`] if `memory` cannot hold a page, or the directions do not allow the scheme; errors of
    /// the source; [`Error::Io`]; [`Error::Cancelled`].
    pub fn new(
        source: &dyn BtfSource,
        interpolation: impl Into<Interpolation>,
        Memory(memory): Memory,
        folder: &Path,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let meta = source.meta();
        let images = Images::new(meta, interpolation.into())?;
        // Determine the size of a page
        let first = source.image(0, 0)?;
        let numbers = match first {
            Texels::U8(_) => SampleType::U8,
            Texels::F16(_) => SampleType::F16,
            Texels::F32(_) => SampleType::F32,
        };
        drop(first);
        let page = 3 * numbers.bytes() * SIDE * SIDE * meta.lights.len();
        // Check the memory limit
        let sets = memory as usize / (WAYS * page);
        let pages = meta.views.len() * blocks(meta)[0] * blocks(meta)[1];
        if sets == 0 || pages >= NONE as usize {
            let problem = format!("found {}, expected at least {}", Memory(memory), Memory((WAYS * page) as u64));
            return Err(Error::parameter("memory", problem));
        }
        let file = tempfile::tempfile_in(folder).map_err(Error::io(folder))?;
        let empty = || Set { pages: [NONE; WAYS], used: [0; WAYS], clock: 0, bytes: Vec::new() };
        let paged = Self {
            images,
            numbers,
            file,
            folder: folder.into(),
            page,
            sets: (0..sets.min(pages)).map(|_| Mutex::new(empty())).collect(),
            read: AtomicU64::new(0),
            asked: AtomicU64::new(0),
        };
        paged.rearrange(source, memory as usize / 4, folder, progress)?;
        Ok(paged)
    }

    fn meta(&self) -> &BtfMeta {
        &self.images.lookup.meta
    }

    /// Memory of the cached pages, in bytes.
    pub fn resident_bytes(&self) -> u64 {
        let set = |set: &Mutex<Set>| set.lock().unwrap_or_else(PoisonError::into_inner).bytes.len() as u64;
        self.sets.iter().map(set).sum()
    }

    /// Size of the temporary file, in bytes.
    pub fn file_bytes(&self) -> u64 {
        let [columns, rows] = blocks(self.meta());
        (self.meta().views.len() * columns * rows * self.page) as u64
    }

    /// Number of pages requested, and of pages read from the file.
    pub fn requests(&self) -> (u64, u64) {
        (self.asked.load(Ordering::Relaxed), self.read.load(Ordering::Relaxed))
    }

    /// Writes all pages, in bands of block rows whose buffers fit into `memory`.
    fn rearrange(&self, source: &dyn BtfSource, memory: usize, folder: &Path, progress: &dyn Progress) -> Result<()> {
        let [columns, rows] = blocks(self.meta());
        let threads = rayon::current_num_threads();
        let band_rows = (memory / (threads * columns * self.page)).clamp(1, rows);
        let task = Task::new(progress, "rearrange", self.meta().views.len() as u64);
        (0..self.meta().views.len()).into_par_iter().try_for_each_init(Vec::new, |band, view| {
            for first in (0..rows).step_by(band_rows) {
                let count = band_rows.min(rows - first);
                band.clear();
                band.resize(count * columns * self.page, 0);
                for light in 0..self.meta().lights.len() {
                    self.scatter(&source.image(view, light)?, light, first, band)?;
                }
                let place = ((view * rows + first) * columns * self.page) as u64;
                write_at(&self.file, band, place).map_err(Error::io(folder))?;
            }
            source.release(view);
            task.advance(1)
        })
    }

    /// Copies the texels of one image into their pages, for as many block rows from `first` as fit into `band`.
    fn scatter(&self, texels: &Texels, light: usize, first: usize, band: &mut [u8]) -> Result<()> {
        let bytes: &[u8] = match texels {
            Texels::U8(values) => values,
            Texels::F16(values) => bytemuck::cast_slice(values),
            Texels::F32(values) => bytemuck::cast_slice(values),
        };
        let texel = 3 * self.numbers.bytes();
        if bytes.len() != texel * self.meta().texels() {
            let problem = format!("an image has {} bytes, expected {}", bytes.len(), texel * self.meta().texels());
            return Err(Error::parameter("source", problem));
        }
        let [columns, _] = blocks(self.meta());
        let band_rows = band.len() / (columns * self.page);
        let top = first * SIDE;
        for y in top..(top + band_rows * SIDE).min(self.meta().height) {
            let line = &bytes[y * self.meta().width * texel..][..self.meta().width * texel];
            for (block, run) in line.chunks(SIDE * texel).enumerate() {
                let page = (y - top) / SIDE * columns + block;
                let at = page * self.page + (light * SIDE * SIDE + y % SIDE * SIDE) * texel;
                band[at..][..run.len()].copy_from_slice(run);
            }
        }
        Ok(())
    }

    /// Calls `show` with the bytes of a page.
    fn with_page(&self, page: usize, show: impl FnOnce(&[u8])) -> Result<()> {
        self.asked.fetch_add(1, Ordering::Relaxed);
        // Multiplicative hash: neighbouring pages go to distant sets
        let set = (page as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 32;
        let set = &self.sets[((set * self.sets.len() as u64) >> 32) as usize];
        let mut set = set.lock().unwrap_or_else(PoisonError::into_inner);
        set.clock = set.clock.wrapping_add(1);
        let found = set.pages.iter().position(|&p| p == page as u32);
        let way = found.unwrap_or_else(|| {
            let age =
                |way: &usize| if set.pages[*way] == NONE { u32::MAX } else { set.clock.wrapping_sub(set.used[*way]) };
            (0..WAYS).max_by_key(age).unwrap_or(0)
        });
        set.used[way] = set.clock;
        if found.is_none() {
            self.read.fetch_add(1, Ordering::Relaxed);
            set.bytes.resize(WAYS * self.page, 0);
            // after a failure the slot holds a partial page
            set.pages[way] = NONE;
            let place = &mut set.bytes[way * self.page..][..self.page];
            read_at(&self.file, place, (page * self.page) as u64).map_err(Error::io(&self.folder))?;
            set.pages[way] = page as u32;
        }
        show(&set.bytes[way * self.page..][..self.page]);
        Ok(())
    }

    /// The page of a texel in a view, and its index in the block.
    #[inline]
    fn place(&self, view: usize, texel: usize) -> (usize, usize) {
        let (x, y) = (texel % self.meta().width, texel / self.meta().width);
        let [columns, rows] = blocks(self.meta());
        ((view * rows + y / SIDE) * columns + x / SIDE, y % SIDE * SIDE + x % SIDE)
    }

    /// The numbers to average of the texel at an index of a page.
    #[inline]
    fn numbers_of(&self, page: &[u8], light: usize, within: usize) -> Vec3 {
        let size = self.numbers.bytes();
        let at = &page[3 * size * (light * SIDE * SIDE + within)..][..3 * size];
        match self.numbers {
            SampleType::U8 => Vec3::from([0, 1, 2].map(|i| self.images.byte(at[i]))),
            SampleType::F16 => Vec3::from([0, 2, 4].map(|i| f16::from_ne_bytes([at[i], at[i + 1]]).to_f32()))
                .map(|v| self.images.number(v)),
            SampleType::F32 => {
                Vec3::from([0, 4, 8].map(|i| f32::from_ne_bytes([at[i], at[i + 1], at[i + 2], at[i + 3]])))
                    .map(|v| self.images.number(v))
            }
        }
    }

    /// The numbers to average of a footprint in one view. After a failure, which is kept, the values are meaningless.
    fn fill(&self, view: usize, lights: &Stencil, texels: &[usize; 4], out: &mut Corners) {
        let places = texels.map(|texel| self.place(view, texel));
        for k in 0..4 {
            let page = places[k].0;
            if places[..k].iter().any(|other| other.0 == page) {
                continue;
            }
            let same = || (k..4).filter(|&other| places[other].0 == page);
            let read = self.with_page(page, |bytes| {
                for ((light, _), out) in lights.iter().zip(out.iter_mut()).filter(|(light, _)| light.1 > 0.0) {
                    same().for_each(|other| out[other] = self.numbers_of(bytes, light, places[other].1));
                }
            });
            if self.images.lookup.failure.ok(read).is_none() {
                return;
            }
        }
    }
}

#[cfg(unix)]
fn read_at(file: &File, out: &mut [u8], at: u64) -> io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, out, at)
}

#[cfg(unix)]
fn write_at(file: &File, bytes: &[u8], at: u64) -> io::Result<()> {
    std::os::unix::fs::FileExt::write_all_at(file, bytes, at)
}

#[cfg(windows)]
fn read_at(file: &File, mut out: &mut [u8], mut at: u64) -> io::Result<()> {
    while !out.is_empty() {
        match std::os::windows::fs::FileExt::seek_read(file, out, at)? {
            0 => return Err(io::ErrorKind::UnexpectedEof.into()),
            n => (out, at) = (&mut out[n..], at + n as u64),
        }
    }
    Ok(())
}

#[cfg(windows)]
fn write_at(file: &File, mut bytes: &[u8], mut at: u64) -> io::Result<()> {
    while !bytes.is_empty() {
        let n = std::os::windows::fs::FileExt::seek_write(file, bytes, at)?;
        (bytes, at) = (&bytes[n..], at + n as u64);
    }
    Ok(())
}

/// Number of columns and rows of blocks.
fn blocks(meta: &BtfMeta) -> [usize; 2] {
    [meta.width.div_ceil(SIDE), meta.height.div_ceil(SIDE)]
}

impl TexelMaterial for PagedBtf {
    fn lookup(&self) -> &Lookup {
        &self.images.lookup
    }

    fn value(&self, point: &TexelPoint, wi: Vec3) -> Vec3 {
        let fill =
            |view, lights: &Stencil, texels: &[usize; 4], out: &mut Corners| self.fill(view, lights, texels, out);
        self.images.apparent(point, wi, fill)
    }

    fn luminances(&self, view: usize, lights: &[usize], texels: &[usize]) -> Result<Vec<f32>> {
        let mut found = vec![0.0; lights.len() * texels.len()];
        for (i, &texel) in texels.iter().enumerate() {
            let (page, within) = self.place(view, texel);
            self.with_page(page, |bytes| {
                for (row, &light) in found.chunks_exact_mut(texels.len()).zip(lights) {
                    row[i] = self.images.luminance(light, self.numbers_of(bytes, light, within));
                }
            })?;
        }
        Ok(found)
    }
}
