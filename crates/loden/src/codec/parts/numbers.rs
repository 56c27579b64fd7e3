//! Numbers as they are stored, in any of the types.

use std::borrow::Cow;
use std::ops::Range;

use half::f16;
use half::slice::HalfFloatSliceExt;

use crate::btf::SampleType;
use crate::{Error, Result};

/// Numbers of a plane or table as stored: borrowed from the file, or owned. 8-bit numbers are whole numbers 0..255; what
/// they stand for is the recipe's to say.
#[derive(Debug, Clone, PartialEq)]
pub enum Numbers<'a> {
    /// 8 bits.
    U8(Cow<'a, [u8]>),
    /// Rows that an index plane chooses.
    Index(Cow<'a, [u16]>),
    /// Half precision.
    F16(Cow<'a, [f16]>),
    /// Single precision.
    F32(Cow<'a, [f32]>),
}

impl Numbers<'_> {
    /// How many there are.
    pub fn len(&self) -> usize {
        match self {
            Self::U8(values) => values.len(),
            Self::Index(values) => values.len(),
            Self::F16(values) => values.len(),
            Self::F32(values) => values.len(),
        }
    }

    /// Whether there are none.
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

    /// One of them in single precision.
    ///
    /// # Panics
    /// If there is none at this place.
    #[inline(always)]
    pub fn at(&self, place: usize) -> f32 {
        match self {
            Self::U8(values) => f32::from(values[place]),
            Self::Index(values) => f32::from(values[place]),
            Self::F16(values) => values[place].to_f32(),
            Self::F32(values) => values[place],
        }
    }

    /// All in single precision, which holds each of the types exactly.
    pub fn to_f32(&self) -> Cow<'_, [f32]> {
        match self {
            Self::U8(values) => values.iter().map(|&v| f32::from(v)).collect(),
            Self::Index(values) => values.iter().map(|&v| f32::from(v)).collect(),
            Self::F16(values) => values.to_f32_vec().into(),
            Self::F32(values) => Cow::Borrowed(values),
        }
    }

    /// The numbers of a range, borrowed.
    ///
    /// # Panics
    /// If the range is out of bounds.
    pub fn part(&self, range: Range<usize>) -> Numbers<'_> {
        match self {
            Self::U8(values) => Numbers::U8(Cow::Borrowed(&values[range])),
            Self::Index(values) => Numbers::Index(Cow::Borrowed(&values[range])),
            Self::F16(values) => Numbers::F16(Cow::Borrowed(&values[range])),
            Self::F32(values) => Numbers::F32(Cow::Borrowed(&values[range])),
        }
    }

    /// Appends numbers of the same type; others are left out.
    pub(super) fn extend(&mut self, more: &Numbers) {
        match (self, more) {
            (Self::U8(all), Numbers::U8(more)) => all.to_mut().extend_from_slice(more),
            (Self::Index(all), Numbers::Index(more)) => all.to_mut().extend_from_slice(more),
            (Self::F16(all), Numbers::F16(more)) => all.to_mut().extend_from_slice(more),
            (Self::F32(all), Numbers::F32(more)) => all.to_mut().extend_from_slice(more),
            _ => {}
        }
    }

    /// Checks that there are as many numbers of a type, `None` for indices, and that all are finite.
    ///
    /// # Errors
    /// [`Error::Parameter`] about `name`.
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
        match bad {
            Some(place) => wrong(format!("number {place} is {}, expected only finite ones", self.at(place))),
            None => Ok(()),
        }
    }

    /// Numbers that borrow nothing.
    pub fn into_owned(self) -> Numbers<'static> {
        match self {
            Self::U8(values) => Numbers::U8(Cow::Owned(values.into_owned())),
            Self::Index(values) => Numbers::Index(Cow::Owned(values.into_owned())),
            Self::F16(values) => Numbers::F16(Cow::Owned(values.into_owned())),
            Self::F32(values) => Numbers::F32(Cow::Owned(values.into_owned())),
        }
    }
}
