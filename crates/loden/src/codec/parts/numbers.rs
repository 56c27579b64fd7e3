//! Stored numbers of any type, shared rather than copied.

use std::fmt;
use std::marker::PhantomData;
use std::ops::{Deref, Range};
use std::sync::Arc;

use bytemuck::Pod;
use half::f16;
use half::slice::HalfFloatSliceExt;

use crate::btf::{BtfMeta, Rect, SampleType};
use crate::{Error, Result};

/// Memory that holds numbers: the map of a file, or a vector.
pub(in crate::codec) trait Memory: Send + Sync {
    /// All bytes, aligned for any type of number.
    fn bytes(&self) -> &[u8];
}

impl<T: Pod + Send + Sync> Memory for Vec<T> {
    fn bytes(&self) -> &[u8] {
        bytemuck::cast_slice(self)
    }
}

/// A slice of numbers that shares ownership of its memory, so cloning is cheap.
#[derive(Clone)]
pub struct Shared<T> {
    memory: Arc<dyn Memory>,
    /// Range in bytes.
    range: Range<usize>,
    kind: PhantomData<T>,
}

impl<T: Pod> Shared<T> {
    /// The bytes `range` of some memory, which must be aligned and hold whole numbers.
    pub(in crate::codec) fn new(memory: Arc<dyn Memory>, range: Range<usize>) -> Self {
        Self { memory, range, kind: PhantomData }
    }

    /// A subrange of the numbers.
    ///
    /// # Panics
    /// If the range exceeds the slice.
    pub fn part(&self, range: Range<usize>) -> Self {
        assert!(range.start <= range.end && range.end <= self.len(), "{range:?} of {} numbers", self.len());
        let byte = |number: usize| self.range.start + number * size_of::<T>();
        Self { memory: self.memory.clone(), range: byte(range.start)..byte(range.end), kind: PhantomData }
    }
}

impl<T: Pod + Send + Sync> From<Vec<T>> for Shared<T> {
    fn from(values: Vec<T>) -> Self {
        let range = 0..size_of_val(&values[..]);
        Self::new(Arc::new(values), range)
    }
}

impl<T: Pod> Deref for Shared<T> {
    type Target = [T];

    #[inline]
    fn deref(&self) -> &[T] {
        bytemuck::cast_slice(&self.memory.bytes()[self.range.clone()])
    }
}

impl<T: Pod + PartialEq> PartialEq for Shared<T> {
    fn eq(&self, other: &Self) -> bool {
        **self == **other
    }
}

impl<T: Pod> fmt::Debug for Shared<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} numbers", self.len())
    }
}

/// Numbers of a plane or table as stored. 8-bit numbers are integers 0..255; the recipe says what values they stand
/// for.
#[derive(Debug, Clone, PartialEq)]
pub enum Numbers {
    /// 8 bits.
    U8(Shared<u8>),
    /// Rows that an index plane chooses.
    Index(Shared<u16>),
    /// Half precision.
    F16(Shared<f16>),
    /// Single precision.
    F32(Shared<f32>),
}

/// Calls a generic function with the numbers, whatever their type.
macro_rules! with_each {
    ($numbers:expr, $values:ident => $result:expr) => {
        match $numbers {
            Numbers::U8($values) => Numbers::U8($result),
            Numbers::Index($values) => Numbers::Index($result),
            Numbers::F16($values) => Numbers::F16($result),
            Numbers::F32($values) => Numbers::F32($result),
        }
    };
}

impl Numbers {
    /// Count of the numbers.
    pub fn len(&self) -> usize {
        match self {
            Self::U8(values) => values.len(),
            Self::Index(values) => values.len(),
            Self::F16(values) => values.len(),
            Self::F32(values) => values.len(),
        }
    }

    /// Whether there are no numbers.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Their type; `None` for indices.
    pub fn sample_type(&self) -> Option<SampleType> {
        match self {
            Self::U8(_) => Some(SampleType::U8),
            Self::Index(_) => None,
            Self::F16(_) => Some(SampleType::F16),
            Self::F32(_) => Some(SampleType::F32),
        }
    }

    /// All numbers in single precision, which represents each of the types exactly.
    pub fn to_f32(&self) -> Shared<f32> {
        match self {
            Self::U8(values) => values.iter().map(|&v| f32::from(v)).collect::<Vec<_>>().into(),
            Self::Index(values) => values.iter().map(|&v| f32::from(v)).collect::<Vec<_>>().into(),
            Self::F16(values) => values.to_f32_vec().into(),
            Self::F32(values) => values.clone(),
        }
    }

    /// The bytes as stored in a file, little endian; `index` is the number of bytes per index.
    pub(in crate::codec) fn stored(&self, index: usize) -> Vec<u8> {
        match self {
            Self::U8(values) => values.to_vec(),
            Self::Index(values) => values.iter().flat_map(|k| k.to_le_bytes().into_iter().take(index)).collect(),
            Self::F16(values) => values.iter().flat_map(|v| v.to_le_bytes()).collect(),
            Self::F32(values) => values.iter().flat_map(|v| v.to_le_bytes()).collect(),
        }
    }

    /// A subrange of the numbers.
    ///
    /// # Panics
    /// If the range exceeds the numbers.
    pub fn part(&self, range: Range<usize>) -> Self {
        with_each!(self, values => values.part(range))
    }

    /// The numbers of a rectangle of texels of a plane with `count` numbers per texel.
    pub(super) fn cut(&self, meta: &BtfMeta, texels: Rect, count: usize) -> Self {
        fn rows<T: Pod + Send + Sync>(all: &Shared<T>, width: usize, texels: Rect, count: usize) -> Shared<T> {
            let first = |y: usize| count * (y * width + texels.x);
            if texels.width == width || texels.height == 1 {
                return all.part(first(texels.y)..first(texels.y) + count * texels.texels());
            }
            let row = |y: usize| &all[first(y)..][..count * texels.width];
            (texels.y..texels.y + texels.height).flat_map(|y| row(y).iter().copied()).collect::<Vec<T>>().into()
        }
        with_each!(self, values => rows(values, meta.width, texels, count))
    }

    /// The numbers of some texels of a plane with `count` numbers per texel.
    pub(in crate::codec) fn gathered(&self, count: usize, texels: impl Iterator<Item = usize>) -> Self {
        with_each!(self, values => texels.flat_map(|texel| values[texel * count..][..count].iter().copied()).collect::<Vec<_>>().into())
    }

    /// Concatenates numbers of the same type; `None` if types differ or the list is empty.
    pub fn concat(all: &[Self]) -> Option<Self> {
        macro_rules! join {
            ($kind:ident) => {{
                let slice = |part: &Self| if let Self::$kind(values) = part { Some(values.clone()) } else { None };
                let parts = all.iter().map(slice).collect::<Option<Vec<_>>>()?;
                Self::$kind(parts.iter().flat_map(|part| part.iter().copied()).collect::<Vec<_>>().into())
            }};
        }
        match all {
            [] => None,
            [one] => Some(one.clone()),
            [Self::U8(_), ..] => Some(join!(U8)),
            [Self::Index(_), ..] => Some(join!(Index)),
            [Self::F16(_), ..] => Some(join!(F16)),
            [Self::F32(_), ..] => Some(join!(F32)),
        }
    }

    /// Checks the count and type of numbers (`None` for indices), and that all are finite.
    ///
    /// # Errors
    /// [`Error::Parameter`] naming `name`.
    pub(in crate::codec) fn check(&self, name: &str, sample_type: Option<SampleType>, count: usize) -> Result<()> {
        let wrong = |problem: String| Err(Error::parameter(name, problem));
        if self.sample_type() != sample_type {
            let word = |sample_type: Option<SampleType>| sample_type.map_or("indices".into(), |t| format!("{t:?}"));
            return wrong(format!("found {}, expected {}", word(self.sample_type()), word(sample_type)));
        }
        if self.len() != count {
            return wrong(format!("found {} numbers, expected {count}", self.len()));
        }
        let bad = match self {
            Self::U8(_) | Self::Index(_) => None,
            Self::F16(values) => values.iter().position(|v| !v.is_finite()),
            Self::F32(values) => values.iter().position(|v| !v.is_finite()),
        };
        bad.map_or(Ok(()), |place| wrong(format!("number {place} is not finite")))
    }
}
