//! `raw`: a plain array of numbers with a small TOML file beside it.
//!
//! # Format
//! The TOML file names the data file and describes it:
//!
//! ```toml
//! loden_raw = 1
//! data = "wool.u8"                # beside this file
//! type = "u8"                     # u8, f16 or f32, little-endian
//! shape = [81, 81, 256, 256, 3]   # view, light, row (top first), column, rgb
//! views = "bonn81"                # or "ubo2014", or a list of [polar angle, azimuth] in degrees
//! lights = "bonn81"
//! encoding = "srgb"               # srgb, linear, or gamma and a number: gamma2.2
//! cosine = "included"             # or excluded
//! ```
//!
//! A set with its own list of pairs has `views = [[0, 0]]`, the shape [1, pairs, row, column, 3], and for every image four numbers in
//! `lights`: polar angle and azimuth of the light, then of the view.
//!
//! The array is memory-mapped and may be larger than memory.

use std::borrow::Cow;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use memmap2::Mmap;
use serde::{Deserialize, Serialize};

use super::{Conventions, Importer, Measured, head, located};
use crate::btf::{BtfMeta, BtfSource, Cosine, Rect, SampleType, Texels};
use crate::color::Encoding;
use crate::direction::DirectionSet;
use crate::input::{self, map, release};
use crate::params::{Param, Params, Values};
use crate::{Error, Result};

/// Maximum size of TOML files in bytes.
const MAX_TOML: u64 = 16 << 20;

/// The content of the TOML file.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Description {
    pub loden_raw: u32,
    pub data: PathBuf,
    #[serde(rename = "type")]
    pub sample_type: SampleType,
    pub shape: [u64; 5],
    pub encoding: Encoding,
    pub cosine: Cosine,
    pub views: DirectionSet,
    pub lights: DirectionSet,
}

pub(super) struct Raw;

impl Importer for Raw {
    fn name(&self) -> &'static str {
        "raw"
    }

    fn doc(&self) -> &'static str {
        "A plain array (view, light, row, column, rgb) of u8, f16 or f32 with a TOML file beside it; memory-mapped."
    }

    fn recognises(&self, path: &Path) -> Result<bool> {
        let bytes = head(path, 4096)?;
        let text = String::from_utf8_lossy(&bytes);
        Ok(text.lines().any(|line| line.trim_start().starts_with("loden_raw")))
    }

    fn params(&self) -> &'static [Param] {
        Conventions::TABLE
    }

    fn open(&self, path: &Path, options: &Values) -> Result<Measured> {
        let options = Conventions::from_values(options)?;
        let description: Description = read_toml(path)?;
        Ok(Measured::Btf(Arc::new(RawSource::new(path, description, &options)?)))
    }

    fn files(&self, path: &Path) -> Result<Vec<PathBuf>> {
        let description: Description = read_toml(path)?;
        Ok(vec![path.into(), path.with_file_name(description.data)])
    }
}

/// Reads a TOML file as `T`; errors name the line.
pub(crate) fn read_toml<T: serde::de::DeserializeOwned>(path: &Path) -> Result<T> {
    let bytes = head(path, MAX_TOML)?;
    let text = str::from_utf8(&bytes).map_err(|e| Error::invalid(path, "text", e.to_string()))?;
    toml::from_str(text).map_err(|e| {
        let line = e.span().map_or(1, |span| text[..span.start].matches('\n').count() + 1);
        Error::invalid(path, format!("line {line}"), input::in_words(e.message()))
    })
}

struct RawSource {
    meta: BtfMeta,
    path: PathBuf,
    map: Mmap,
    /// Pairs whose numbers are known to be finite.
    checked: Vec<AtomicBool>,
}

impl RawSource {
    fn new(toml: &Path, d: Description, options: &Conventions) -> Result<Self> {
        let expected = d.bytes().map_err(|(field, problem)| Error::invalid(toml, field, problem))?;
        let path = toml.parent().unwrap_or(Path::new("")).join(&d.data);
        let found = std::fs::metadata(&path).map_err(Error::io(&path))?.len();
        if found != expected {
            let problem = format!("found {found} bytes, expected {expected} for the shape {:?}", d.shape);
            return Err(Error::invalid(&path, "size", problem));
        }
        let map = map(&path)?;
        let meta = BtfMeta {
            width: d.shape[3] as usize,
            height: d.shape[2] as usize,
            views: d.views,
            lights: d.lights,
            encoding: options.encoding.unwrap_or(d.encoding),
            cosine: options.cosine.unwrap_or(d.cosine),
            sample_type: d.sample_type,
        };
        meta.check_pairs().map_err(located(toml))?;
        let checked = (0..meta.pairs()).map(|_| AtomicBool::new(false)).collect();
        Ok(Self { meta, path, map, checked })
    }

    /// The bytes of `count` images, starting with pair `first`.
    fn range(&self, first: usize, count: usize) -> Range<usize> {
        let image = self.meta.image_len() * self.meta.sample_type.bytes();
        first * image..(first + count) * image
    }

    /// A range of numbers of the array, unchecked.
    fn numbers(&self, first: usize, count: usize) -> Result<Texels<'_>> {
        let size = self.meta.sample_type.bytes();
        let bytes = &self.map[first * size..(first + count) * size];
        // the map is page-aligned and images hold whole numbers, so this cannot fail
        let misaligned = |e| Error::invalid(&self.path, "data", format!("{e}"));
        Ok(match self.meta.sample_type {
            SampleType::U8 => Texels::U8(Cow::Borrowed(bytes)),
            SampleType::F16 => Texels::F16(Cow::Borrowed(bytemuck::try_cast_slice(bytes).map_err(misaligned)?)),
            SampleType::F32 => Texels::F32(Cow::Borrowed(bytemuck::try_cast_slice(bytes).map_err(misaligned)?)),
        })
    }

    fn not_finite(&self, number: usize) -> Error {
        Error::invalid(&self.path, "data", format!("number {number} is not finite"))
    }

    /// A range of images, each checked on first use.
    fn images(&self, first: usize, count: usize) -> Result<Texels<'_>> {
        let len = self.meta.image_len();
        let texels = self.numbers(first * len, count * len)?;
        for (i, checked) in self.checked[first..first + count].iter().enumerate() {
            if !checked.load(Ordering::Relaxed) {
                finite(&texels.part(i * len..(i + 1) * len)).map_err(|at| self.not_finite((first + i) * len + at))?;
                checked.store(true, Ordering::Relaxed);
            }
        }
        Ok(texels)
    }
}

impl Description {
    /// The size of the data file in bytes; or a wrong field and the problem.
    fn bytes(&self) -> std::result::Result<u64, (&'static str, String)> {
        if self.loden_raw != 1 {
            return Err(("loden_raw", format!("found version {}, expected 1", self.loden_raw)));
        }
        let [views, lights, height, width, channels] = self.shape;
        for (name, count, set) in [("views", views, &self.views), ("lights", lights, &self.lights)] {
            if set.len() as u64 != count {
                return Err((name, format!("found {} directions, expected {count} as in the shape", set.len())));
            }
        }
        if width == 0 || height == 0 || channels != 3 {
            return Err(("shape", format!("found {:?}; rows and columns must be positive, channels 3", self.shape)));
        }
        let number = self.sample_type.bytes() as u64;
        let product = self.shape.iter().try_fold(number, |product, &n| product.checked_mul(n));
        product.ok_or_else(|| ("shape", format!("{:?} overflows", self.shape)))
    }
}

/// Parses finite numbers; the error is the index of the first one that is not finite.
fn finite(texels: &Texels<'_>) -> std::result::Result<(), usize> {
    let first = match texels {
        Texels::U8(_) => None,
        Texels::F16(values) => values.iter().position(|v| !v.is_finite()),
        Texels::F32(values) => values.iter().position(|v| !v.is_finite()),
    };
    first.map_or(Ok(()), Err)
}

impl BtfSource for RawSource {
    fn meta(&self) -> &BtfMeta {
        &self.meta
    }

    fn view(&self, view: usize) -> Result<Texels<'_>> {
        let lights = self.meta.lights.len();
        self.images(view * lights, lights)
    }

    fn image(&self, view: usize, light: usize) -> Result<Texels<'_>> {
        self.images(view * self.meta.lights.len() + light, 1)
    }

    fn read(&self, views: &[usize], lights: &[usize], texels: Rect, out: &mut [f32]) -> Result<()> {
        self.meta.check_read(views, lights, texels, out)?;
        let pairs = views.iter().flat_map(|view| lights.iter().map(move |light| view * self.meta.lights.len() + light));
        for (pair, out) in pairs.zip(out.chunks_exact_mut((3 * texels.texels()).max(1))) {
            for (row, out) in out.chunks_exact_mut(3 * texels.width).enumerate() {
                let first = 3 * ((texels.y + row) * self.meta.width + texels.x);
                let numbers = self.numbers(pair * self.meta.image_len() + first, out.len())?;
                finite(&numbers).map_err(|at| self.not_finite(pair * self.meta.image_len() + first + at))?;
                out.copy_from_slice(&numbers.to_f32());
            }
        }
        Ok(())
    }

    fn release(&self, view: usize) {
        let lights = self.meta.lights.len();
        release(&self.map, self.range(view * lights, lights));
    }

    fn source_bytes(&self) -> u64 {
        self.map.len() as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import;
    use crate::params::Given;

    const GOOD: &str = "loden_raw = 1\ndata = \"x.u8\"\ntype = \"u8\"\nshape = [1, 2, 2, 2, 3]\nviews = [[0, 0]]\n\
                        lights = [[0, 0], [30.0, 90.0]]\nencoding = \"srgb\"\ncosine = \"included\"\n";

    fn open(text: &str, data: usize) -> Result<Arc<dyn BtfSource>> {
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join("x.toml"), text).unwrap();
        std::fs::write(dir.path().join("x.u8"), (0..data).map(|i| i as u8).collect::<Vec<_>>()).unwrap();
        import::open(dir.path().join("x.toml"), &Given::default())
    }

    #[test]
    fn views_and_images_are_slices_of_the_file() {
        let source = open(GOOD, 24).unwrap();
        let Texels::U8(image) = source.image(0, 1).unwrap() else { panic!("u8 expected") };
        assert_eq!(image.to_vec(), (12..24).collect::<Vec<u8>>());
        assert_eq!(source.view(0).unwrap().len(), 24);
    }

    #[test]
    fn errors_name_file_and_field() {
        let cases = [
            ("data = \"x.u8\"", "data = \"y.u8\"", "y.u8: "),
            (
                "[1, 2, 2, 2, 3]",
                "[1, 2, 2, 3, 3]",
                "x.u8: size: found 24 bytes, expected 36 for the shape [1, 2, 2, 3, 3]",
            ),
            ("[1, 2, 2, 2, 3]", "[2, 2, 2, 2, 3]", "x.toml: views: found 1 directions, expected 2 as in the shape"),
            ("[1, 2, 2, 2, 3]", "[1, 2, 0, 2, 3]", "x.toml: shape: "),
            ("[1, 2, 2, 2, 3]", "[1, 2, -2, 2, 3]", "x.toml: line 4: "),
            ("[1, 2, 2, 2, 3]", "[1, 2, 9223372036854775807, 9223372036854775807, 3]", "x.toml: shape: "),
            ("\"u8\"\nshape", "\"u9\"\nshape", "x.toml: line 3: "),
            ("loden_raw = 1", "loden_raw = 2", "x.toml: loden_raw: found version 2"),
            ("\"included\"", "\"included\"\ncolour = 1", "x.toml: line 9: "),
        ];
        for (from, to, expected) in cases {
            let text = GOOD.replace(from, to);
            assert_ne!(text, GOOD, "{from}");
            let error = open(&text, 24).err().unwrap().to_string();
            assert!(error.contains(expected), "{error}\nshould contain {expected}");
        }
    }

    #[test]
    fn a_number_that_is_not_finite_is_named() {
        let dir = tempfile::tempdir().unwrap();
        let text = GOOD.replace("x.u8", "x.f32").replace("\"u8\"", "\"f32\"");
        std::fs::write(dir.path().join("x.toml"), text).unwrap();
        let mut numbers = [0.5f32; 24];
        numbers[13] = f32::NAN;
        std::fs::write(dir.path().join("x.f32"), bytemuck::cast_slice(&numbers)).unwrap();
        let source = import::open(dir.path().join("x.toml"), &Given::default()).unwrap();
        assert!(source.image(0, 0).is_ok());
        let error = source.image(0, 1).unwrap_err().to_string();
        assert!(error.ends_with("x.f32: data: number 13 is not finite"), "{error}");
    }
}
