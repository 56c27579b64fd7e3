//! The BTF as images: one photograph per view and light, in the order (view, light, y, x, rgb).

use std::borrow::Cow;
use std::ops::Range;
use std::path::PathBuf;

use glam::Vec3;
use half::f16;
use serde::{Deserialize, Serialize};

use crate::color::Encoding;
use crate::direction::DirectionSet;
use crate::params::Given;
use crate::{Error, Result};

crate::words! {
    /// Whether stored values contain the cosine of the light's polar angle.
    #[derive(Serialize, Deserialize)]
    #[serde(rename_all = "lowercase")]
    pub enum Cosine {
        /// Plain photographs: the value is the apparent value pi L / E_perp.
        Included = "included",
        /// The cosine was divided out: the value is pi times the BRDF.
        Excluded = "excluded",
    }
}

crate::words! {
    /// The type of stored numbers.
    #[derive(Serialize, Deserialize)]
    #[serde(rename_all = "lowercase")]
    pub enum SampleType {
        /// IEEE single precision.
        F32 = "f32",
        /// IEEE half precision: 11 bits, up to 65504.
        F16 = "f16",
        /// 8 bits; in texels, 255 is the encoded value 1.
        U8 = "u8",
    }
}

crate::words! {
    /// The type of stored numbers that cannot have 8 bits.
    pub enum FloatType {
        /// IEEE single precision.
        F32 = "f32",
        /// IEEE half precision: 11 bits, up to 65504.
        F16 = "f16",
    }
}

impl From<FloatType> for SampleType {
    fn from(float: FloatType) -> Self {
        match float {
            FloatType::F32 => Self::F32,
            FloatType::F16 => Self::F16,
        }
    }
}

impl SampleType {
    /// Bytes of one number.
    pub fn bytes(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::F16 => 2,
            Self::F32 => 4,
        }
    }
}

/// The description of a BTF, without its texels.
///
/// A BTF may have its own list of pairs instead of every view with every light: `lights` then has the light of each image and
/// the view that it is seen from ([`DirectionSet::seen_from`]), and `views` has one entry, which means nothing ([`DirectionSet::normal`]).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BtfMeta {
    /// Texels per row.
    pub width: usize,
    /// Rows; row 0 is the top (v = 1).
    pub height: usize,
    /// View directions, in storage order.
    pub views: DirectionSet,
    /// Light directions, the same for every view.
    pub lights: DirectionSet,
    /// How stored values encode light.
    pub encoding: Encoding,
    /// Whether the light's cosine is included in the values.
    pub cosine: Cosine,
    /// The number type of the texels.
    pub sample_type: SampleType,
}

impl BtfMeta {
    /// Texels in one image.
    pub fn texels(&self) -> usize {
        self.width * self.height
    }

    /// Whether the BTF has its own list of pairs.
    pub fn is_listed(&self) -> bool {
        self.lights.seen_from().is_some()
    }

    /// The directions of a pair: light and view.
    ///
    /// # Panics
    /// If the pair does not exist.
    #[inline]
    pub fn pair(&self, view: usize, light: usize) -> (Vec3, Vec3) {
        let (views, view) = self.view_of(view, light);
        (self.lights.directions()[light], views.directions()[view])
    }

    /// The directions of a pair in degrees: theta and phi of light and view.
    ///
    /// # Panics
    /// If the pair does not exist.
    pub fn pair_degrees(&self, view: usize, light: usize) -> [[f64; 2]; 2] {
        let (views, view) = self.view_of(view, light);
        [self.lights.degrees()[light], views.degrees()[view]]
    }

    fn view_of(&self, view: usize, light: usize) -> (&DirectionSet, usize) {
        self.lights.seen_from().map_or((&self.views, view), |views| (views, light))
    }

    /// The pair (view, light) nearest to these directions.
    pub fn nearest_pair(&self, wi: Vec3, wo: Vec3) -> (usize, usize) {
        if !self.is_listed() {
            return (self.views.nearest(wo), self.lights.nearest(wi));
        }
        let distance = |light: &usize| {
            let (a, b) = self.pair(0, *light);
            a.distance_squared(wi) + b.distance_squared(wo)
        };
        (0, (0..self.lights.len()).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or(0))
    }

    /// Checks that there is an image for every view with every light.
    ///
    /// # Errors
    /// [`Error::Parameter`] saying that `what` needs that.
    pub fn check_grid(&self, what: &str) -> Result<()> {
        if !self.is_listed() {
            return Ok(());
        }
        let problem = format!(
            "{what} needs every view with every light; this BTF has its own list of {} pairs",
            self.lights.len()
        );
        Err(Error::parameter("pairs", problem))
    }

    /// Checks that `views` suits `lights`: one entry if there is a list of pairs.
    ///
    /// # Errors
    /// [`Error::Parameter`].
    pub fn check_pairs(&self) -> Result<()> {
        if self.views.seen_from().is_some() {
            return Err(Error::parameter("views", "found pairs, which belong into lights"));
        }
        if self.is_listed() && self.views.len() != 1 {
            let problem = format!("found {} directions, expected 1 beside a list of pairs", self.views.len());
            return Err(Error::parameter("views", problem));
        }
        Ok(())
    }

    /// Numbers in one image, three per texel.
    pub fn image_len(&self) -> usize {
        3 * self.texels()
    }

    /// Numbers in all images of one view.
    pub fn view_len(&self) -> usize {
        self.lights.len() * self.image_len()
    }

    /// Number of images.
    pub fn pairs(&self) -> usize {
        self.views.len() * self.lights.len()
    }

    /// Checks that the images `lights` of a view exist and that `out` has room for them.
    pub(crate) fn check_decode(&self, view: usize, lights: std::ops::Range<usize>, out: &[f32]) -> Result<()> {
        for (name, found, count) in
            [("view", view, self.views.len()), ("light", lights.end.saturating_sub(1), self.lights.len())]
        {
            if found >= count {
                return Err(Error::parameter(name, format!("found {found}, expected less than {count}")));
            }
        }
        let expected = lights.len() * self.image_len();
        if out.len() != expected {
            return Err(Error::parameter("out", format!("found {} numbers, expected {expected}", out.len())));
        }
        Ok(())
    }

    /// Checks that these texels of these images exist and that `out` has room for them.
    pub(crate) fn check_read(&self, views: &[usize], lights: &[usize], texels: Rect, out: &[f32]) -> Result<()> {
        for (name, indices, count) in [("view", views, self.views.len()), ("light", lights, self.lights.len())] {
            if let Some(found) = indices.iter().find(|index| **index >= count) {
                return Err(Error::parameter(name, format!("found {found}, expected less than {count}")));
            }
        }
        texels.check(self)?;
        let expected = 3 * views.len() * lights.len() * texels.texels();
        if out.len() != expected {
            return Err(Error::parameter("out", format!("found {} numbers, expected {expected}", out.len())));
        }
        Ok(())
    }

    /// Size in bytes of the whole BTF, raw in 8 bits: the reference of compression ratios.
    pub fn raw8_bytes(&self) -> u64 {
        self.pairs() as u64 * self.image_len() as u64
    }
}

/// A rectangle of texels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rect {
    /// Left column.
    pub x: usize,
    /// Top row.
    pub y: usize,
    /// Number of columns.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
}

impl Rect {
    /// All texels of a BTF with the description `meta`.
    pub fn whole(meta: &BtfMeta) -> Self {
        Self { x: 0, y: 0, width: meta.width, height: meta.height }
    }

    /// Number of texels.
    pub fn texels(&self) -> usize {
        self.width * self.height
    }

    /// Checks that the rectangle lies within the images of a BTF with the description `meta`.
    ///
    /// # Errors
    /// [`Error::Parameter`] if it does not.
    pub fn check(&self, meta: &BtfMeta) -> Result<()> {
        let inside = |first: usize, count: usize, size: usize| first <= size && count <= size - first;
        if inside(self.x, self.width, meta.width) && inside(self.y, self.height, meta.height) {
            return Ok(());
        }
        let problem = format!("{self:?} is not within {} x {} texels", meta.width, meta.height);
        Err(Error::parameter("rect", problem))
    }
}

/// Texels as stored, interleaved RGB: borrowed from a memory map or owned after decoding.
#[derive(Debug, Clone, PartialEq)]
pub enum Texels<'a> {
    /// 8-bit values.
    U8(Cow<'a, [u8]>),
    /// Half-precision values.
    F16(Cow<'a, [f16]>),
    /// Single-precision values.
    F32(Cow<'a, [f32]>),
}

impl Texels<'_> {
    /// Count of the numbers.
    pub fn len(&self) -> usize {
        match self {
            Self::U8(values) => values.len(),
            Self::F16(values) => values.len(),
            Self::F32(values) => values.len(),
        }
    }

    /// Whether there are no numbers.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The numbers of `range`, borrowed.
    ///
    /// # Panics
    /// If the range exceeds the texels.
    pub fn part(&self, range: std::ops::Range<usize>) -> Texels<'_> {
        match self {
            Self::U8(values) => Texels::U8(Cow::Borrowed(&values[range])),
            Self::F16(values) => Texels::F16(Cow::Borrowed(&values[range])),
            Self::F32(values) => Texels::F32(Cow::Borrowed(&values[range])),
        }
    }

    /// No numbers, with room for `capacity`.
    fn empty(sample_type: SampleType, capacity: usize) -> Self {
        match sample_type {
            SampleType::U8 => Self::U8(Cow::Owned(Vec::with_capacity(capacity))),
            SampleType::F16 => Self::F16(Cow::Owned(Vec::with_capacity(capacity))),
            SampleType::F32 => Self::F32(Cow::Owned(Vec::with_capacity(capacity))),
        }
    }

    /// Appends numbers of the same type.
    fn append(&mut self, other: &Texels) -> Result<()> {
        match (self, other) {
            (Self::U8(all), Texels::U8(more)) => all.to_mut().extend_from_slice(more),
            (Self::F16(all), Texels::F16(more)) => all.to_mut().extend_from_slice(more),
            (Self::F32(all), Texels::F32(more)) => all.to_mut().extend_from_slice(more),
            _ => return Err(Error::parameter("source", "images have different number types")),
        }
        Ok(())
    }

    /// The values as encoded numbers: 8-bit values divided by 255, floating-point values as they are.
    pub fn to_f32(&self) -> Cow<'_, [f32]> {
        match self {
            Self::U8(values) => values.iter().map(|&v| f32::from(v) / 255.0).collect(),
            Self::F16(values) => values.iter().map(|v| v.to_f32()).collect(),
            Self::F32(values) => Cow::Borrowed(values),
        }
    }
}

/// How a measurement was opened: enough for [`crate::import::reopen`].
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Origin {
    /// The file or folder, absolute.
    pub path: PathBuf,
    /// The name of its importer.
    pub importer: String,
    /// The given options of the importer.
    pub options: Given,
}

/// What the files of a measurement are, whatever they are called now.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Identity {
    /// The name of the file or folder.
    pub name: String,
    /// SHA-256 of the file as `sha256sum` prints it; of several files, of the lines that `sha256sum` prints for them, with
    /// their paths relative to the folder, sorted by path.
    pub sha256: String,
}

/// A readable BTF: an archive, a raw array, or a compressed file that is decoded on demand.
///
/// Methods may be called from several threads at once; each call does its work on the calling thread.
pub trait BtfSource: Send + Sync {
    /// Size, directions and conventions.
    fn meta(&self) -> &BtfMeta;

    /// All images of one view, shape (light, y, x, rgb).
    ///
    /// # Errors
    /// If the images cannot be read or decoded.
    fn view(&self, view: usize) -> Result<Texels<'_>>;

    /// One image, shape (y, x, rgb).
    ///
    /// # Errors
    /// If the image cannot be read or decoded.
    fn image(&self, view: usize, light: usize) -> Result<Texels<'_>>;

    /// The texels of a rectangle of some images as encoded numbers, shape (view, light, y, x, rgb), into `out` of
    /// 3 x `views` x `lights` x `texels` numbers.
    ///
    /// # Errors
    /// [`Error::Parameter`] if a view, light or texel does not exist or `out` has the wrong length; otherwise if an
    /// image cannot be read or decoded.
    fn read(&self, views: &[usize], lights: &[usize], texels: Rect, out: &mut [f32]) -> Result<()> {
        let meta = self.meta();
        meta.check_read(views, lights, texels, out)?;
        let pairs = views.iter().flat_map(|&view| lights.iter().map(move |&light| (view, light)));
        for ((view, light), out) in pairs.zip(out.chunks_exact_mut((3 * texels.texels()).max(1))) {
            let image = self.image(view, light)?;
            for (row, out) in out.chunks_exact_mut(3 * texels.width).enumerate() {
                let first = 3 * ((texels.y + row) * meta.width + texels.x);
                out.copy_from_slice(&image.part(first..first + out.len()).to_f32());
            }
        }
        Ok(())
    }

    /// Some rows of all images of one view as stored, shape (light, y, x, rgb).
    ///
    /// # Errors
    /// [`Error::Parameter`] if a row does not exist; otherwise if the images cannot be read or decoded.
    fn rows(&self, view: usize, rows: Range<usize>) -> Result<Texels<'_>> {
        let meta = self.meta();
        if rows.start > rows.end || rows.end > meta.height {
            return Err(Error::parameter("rows", format!("found {rows:?}, expected less than {}", meta.height)));
        }
        let range = 3 * meta.width * rows.start..3 * meta.width * rows.end;
        let mut all = Texels::empty(meta.sample_type, range.len() * meta.lights.len());
        for light in 0..meta.lights.len() {
            let image = self.image(view, light)?;
            if image.len() != meta.image_len() {
                let problem =
                    format!("image ({view}, {light}) has {} numbers, expected {}", image.len(), meta.image_len());
                return Err(Error::parameter("source", problem));
            }
            all.append(&image.part(range.clone()))?;
        }
        Ok(all)
    }

    /// How to open the source again, in this process or another; `None` if it was not opened from a file.
    fn origin(&self) -> Option<Origin> {
        None
    }

    /// What the files of the source are; `None` if it was not opened from files. Reads the files once.
    ///
    /// # Errors
    /// [`Error::Io`].
    fn identity(&self) -> Result<Option<Identity>> {
        Ok(None)
    }

    /// The caller is done with the images of `view` for now. A memory-mapped source gives their pages back, so that
    /// a pass over all views stays within bounded memory; texels still borrowed stay valid.
    fn release(&self, view: usize) {
        let _ = view;
    }

    /// Size of the original files in bytes.
    fn source_bytes(&self) -> u64;

    /// Pairs (view, light) that were not measured. Their images repeat the nearest measured light of that view.
    fn missing(&self) -> &[(usize, usize)] {
        &[]
    }

    /// Why conventions of [`BtfSource::meta`] that the files do not state are what they are, and other facts from the
    /// files: (field, reason).
    fn facts(&self) -> &[(&'static str, String)] {
        &[]
    }

    /// Warnings for the user about what was repaired or assumed on opening, one sentence each.
    fn warnings(&self) -> &[String] {
        &[]
    }
}

/// A whole BTF in memory.
#[derive(Debug, Clone, PartialEq)]
pub struct MemoryBtf {
    meta: BtfMeta,
    texels: Texels<'static>,
}

impl MemoryBtf {
    /// From texels in the order (view, light, y, x, rgb), in the sample type of `meta`.
    ///
    /// # Errors
    /// [`Error::Parameter`] if the number or type of the texels does not match `meta`.
    pub fn new(meta: BtfMeta, texels: Texels<'static>) -> Result<Self> {
        let expected = meta.views.len() * meta.view_len();
        if texels.len() != expected {
            return Err(Error::parameter("texels", format!("found {} numbers, expected {expected}", texels.len())));
        }
        let found = match &texels {
            Texels::U8(_) => SampleType::U8,
            Texels::F16(_) => SampleType::F16,
            Texels::F32(_) => SampleType::F32,
        };
        if found != meta.sample_type {
            return Err(Error::parameter("texels", format!("found {found:?}, expected {:?}", meta.sample_type)));
        }
        Ok(Self { meta, texels })
    }

    fn part(&self, index: usize, len: usize) -> Result<Texels<'_>> {
        let range = index * len..(index + 1) * len;
        let outside = || Error::parameter("view", format!("image block {index} of {len} numbers does not exist"));
        Ok(match &self.texels {
            Texels::U8(values) => Texels::U8(Cow::Borrowed(values.get(range).ok_or_else(outside)?)),
            Texels::F16(values) => Texels::F16(Cow::Borrowed(values.get(range).ok_or_else(outside)?)),
            Texels::F32(values) => Texels::F32(Cow::Borrowed(values.get(range).ok_or_else(outside)?)),
        })
    }
}

impl BtfSource for MemoryBtf {
    fn meta(&self) -> &BtfMeta {
        &self.meta
    }

    fn view(&self, view: usize) -> Result<Texels<'_>> {
        self.part(view, self.meta.view_len())
    }

    fn image(&self, view: usize, light: usize) -> Result<Texels<'_>> {
        self.part(view * self.meta.lights.len() + light, self.meta.image_len())
    }

    fn source_bytes(&self) -> u64 {
        (self.texels.len() * self.meta.sample_type.bytes()) as u64
    }
}

/// View 0 of a source and every `step`-th after it, as a BTF of its own.
pub(crate) struct EveryView<'a> {
    source: &'a dyn BtfSource,
    step: usize,
    meta: BtfMeta,
}

impl<'a> EveryView<'a> {
    /// Every `step`-th view.
    ///
    /// # Errors
    /// [`Error::Parameter`] if `step` is 0.
    pub fn new(source: &'a dyn BtfSource, step: usize) -> Result<Self> {
        if step == 0 {
            return Err(Error::parameter("step", "found 0, expected at least 1"));
        }
        let mut meta = source.meta().clone();
        meta.views = DirectionSet::from_degrees(meta.views.degrees().iter().copied().step_by(step).collect())?;
        Ok(Self { source, step, meta })
    }
}

impl BtfSource for EveryView<'_> {
    fn meta(&self) -> &BtfMeta {
        &self.meta
    }

    fn view(&self, view: usize) -> Result<Texels<'_>> {
        self.source.view(view * self.step)
    }

    fn image(&self, view: usize, light: usize) -> Result<Texels<'_>> {
        self.source.image(view * self.step, light)
    }

    fn rows(&self, view: usize, rows: Range<usize>) -> Result<Texels<'_>> {
        self.source.rows(view * self.step, rows)
    }

    fn identity(&self) -> Result<Option<Identity>> {
        self.source.identity()
    }

    fn release(&self, view: usize) {
        self.source.release(view * self.step);
    }

    fn source_bytes(&self) -> u64 {
        self.source.source_bytes()
    }
}
