//! The domain of a codec: the curve between stored values and the numbers that are factored.

use serde::{Deserialize, Serialize};

use crate::color::Encoding;
use crate::params::{Kind, Param};

/// Offset that is added to linear light before the logarithm: about three steps of 8-bit sRGB near black.
const LOG_OFFSET: f32 = 1e-3;

crate::words! {
    /// The numbers that a codec factors.
    #[derive(Serialize, Deserialize)]
    #[serde(rename_all = "lowercase")]
    pub enum Domain {
        /// Display-encoded values ([`Encoding::display`]): the stored values themselves, unless these are linear.
        Display = "display",
        /// Linear light.
        Linear = "linear",
        /// ln(linear light + 0.001).
        Log = "log",
    }
}

/// The parameter that selects a [`Domain`].
pub const DOMAIN: Param = Param {
    name: "domain",
    unit: "",
    kind: Kind::Choice(&["display", "linear", "log"]),
    default: "display",
    doc: "Values that are factored: display values (as stored in photographs), linear light, or its logarithm.",
};

impl Domain {
    /// Converts from a stored value in `encoding`.
    #[inline]
    pub fn from_stored(self, encoding: Encoding, value: f32) -> f32 {
        if self.is_stored(encoding) {
            return value;
        }
        let linear = encoding.decode(value);
        match self {
            Self::Display => encoding.display().encode(linear),
            Self::Linear => linear,
            Self::Log => (linear.max(0.0) + LOG_OFFSET).ln(),
        }
    }

    /// Converts to linear light; the result can be negative.
    #[inline]
    pub fn to_linear(self, encoding: Encoding, value: f32) -> f32 {
        match self {
            Self::Display => encoding.display().decode(value),
            Self::Linear => value,
            // the bound keeps values of a damaged file finite
            Self::Log => value.min(80.0).exp() - LOG_OFFSET,
        }
    }

    /// Converts to a stored value in `encoding`; the inverse of [`Domain::from_stored`].
    #[inline]
    pub fn to_stored(self, encoding: Encoding, value: f32) -> f32 {
        if self.is_stored(encoding) { value } else { encoding.encode(self.to_linear(encoding, value)) }
    }

    /// Whether the numbers of the domain are the stored values themselves.
    pub fn is_stored(self, encoding: Encoding) -> bool {
        match self {
            Self::Display => encoding.display() == encoding,
            Self::Linear => encoding == Encoding::Linear,
            Self::Log => false,
        }
    }
}

/// A lookup table of the curve from a [`Domain`] to linear light.
///
/// # Model
/// Linear interpolation within 1e-6 of the curve, between steps of 1/1024 in 1/64..1.99 and of 1/65536 below, where the
/// second derivative of a pure power is unbounded. Above, the curve itself is evaluated.
#[derive(Debug, Clone)]
pub(crate) struct Linearizer {
    domain: Domain,
    encoding: Encoding,
    /// Values at the coarse steps from 0 to 2, then at the fine ones from 0.
    table: Option<Box<[f32; Linearizer::STEPS * 4]>>,
}

impl Linearizer {
    /// Coarse steps from 0 to 1, and fine steps from 0 to [`Linearizer::DARK`].
    const STEPS: usize = 1024;
    /// Below this, steps are fine.
    const DARK: f32 = 1.0 / 64.0;

    /// Prepares the table for stored values in `encoding`.
    pub fn new(domain: Domain, encoding: Encoding) -> Self {
        let curved = domain == Domain::Display && encoding.display() != Encoding::Gamma(1.0);
        let sample = |i: usize| match i.checked_sub(2 * Self::STEPS) {
            Some(fine) => domain.to_linear(encoding, fine as f32 / Self::STEPS as f32 * Self::DARK),
            None => domain.to_linear(encoding, i as f32 / Self::STEPS as f32),
        };
        let table = curved.then(|| Box::new(std::array::from_fn(sample)));
        Self { domain, encoding, table }
    }

    /// Converts a value of the domain to linear light; negative results become zero.
    #[inline(always)]
    pub fn linear(&self, value: f32) -> f32 {
        match &self.table {
            Some(table) if (Self::DARK..=1.99).contains(&value) => {
                let (i, fraction) = split(value * Self::STEPS as f32);
                let [start, end] = [i, i + 1].map(|i| table[i % (4 * Self::STEPS)]);
                start + fraction * (end - start)
            }
            _ => self.dark_or_bright(value),
        }
    }

    /// The same outside the coarse steps; a call, so that the loops that inline the rest stay small.
    #[inline(never)]
    fn dark_or_bright(&self, value: f32) -> f32 {
        match &self.table {
            Some(table) if value < Self::DARK => {
                // the split is of a number above 1, to be right near 0 too
                let (i, fraction) = split(value.max(0.0) * (Self::STEPS as f32 / Self::DARK) + 1.0);
                let [start, end] = [i, i + 1].map(|i| table[2 * Self::STEPS - 1 + i]);
                start + fraction * (end - start)
            }
            _ => self.domain.to_linear(self.encoding, value).max(0.0),
        }
    }
}

/// Splits a number in 1..2^22 into a step and the rest, from the mantissa of a sum that has no room for a fraction,
/// which is cheaper than a conversion. An integer may also be split into the step before and 1.
#[inline(always)]
fn split(x: f32) -> (usize, f32) {
    const FIRST: f32 = (1u32 << 23) as f32;
    let sum = (x - 0.5) + FIRST;
    ((sum.to_bits() & 0x7f_ffff) as usize, x - (sum - FIRST))
}

#[cfg(test)]
mod tests {
    use super::*;

    const ENCODINGS: [Encoding; 3] = [Encoding::Linear, Encoding::Srgb, Encoding::Gamma(1.6)];
    const DOMAINS: [Domain; 3] = [Domain::Display, Domain::Linear, Domain::Log];

    #[test]
    fn every_domain_inverts() {
        for (encoding, domain) in ENCODINGS.iter().flat_map(|e| DOMAINS.map(|d| (*e, d))) {
            for i in 0..=300 {
                let value = i as f32 / 255.0;
                let back = domain.to_stored(encoding, domain.from_stored(encoding, value));
                assert!((back - value).abs() < 4e-5, "{domain:?} {encoding} {value} {back}");
            }
        }
        let Kind::Choice(words) = DOMAIN.kind else { panic!("a choice") };
        assert!(words.iter().copied().eq(DOMAINS.map(Domain::name)));
    }

    #[test]
    fn the_table_follows_the_curve() {
        for (encoding, domain) in ENCODINGS.iter().flat_map(|e| DOMAINS.map(|d| (*e, d))) {
            let table = Linearizer::new(domain, encoding);
            for i in (-100..6000).flat_map(|i| [100 * i, i]) {
                let value = i as f32 / 234_567.8;
                let exact = domain.to_linear(encoding, value).max(0.0);
                assert!((table.linear(value) - exact).abs() < 1e-6 * exact.max(1.0), "{domain:?} {encoding} {value}");
            }
        }
    }
}
