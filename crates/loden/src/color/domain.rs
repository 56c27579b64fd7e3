//! The domain of a codec: the curve between stored values and the numbers that are factored.

use crate::color::Encoding;
use crate::params::{Kind, Param};

/// Offset that is added to linear light before the logarithm: about three steps of 8-bit sRGB near black.
const LOG_OFFSET: f32 = 1e-3;

crate::words! {
    /// The numbers that a codec factors.
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
/// Linear interpolation between 1024 steps in 1/64..1, within 1e-6 of the curve. Outside, the curve itself is
/// evaluated, also near black, where the second derivative of a pure power is unbounded.
#[derive(Debug, Clone)]
pub(crate) struct Linearizer {
    domain: Domain,
    encoding: Encoding,
    /// Values at the steps, padded to twice the size so that no index is out of bounds.
    table: Option<Box<[f32; Linearizer::STEPS * 2]>>,
}

impl Linearizer {
    const STEPS: usize = 1024;

    /// Prepares the table for stored values in `encoding`.
    pub fn new(domain: Domain, encoding: Encoding) -> Self {
        let curved = domain == Domain::Display && encoding.display() != Encoding::Gamma(1.0);
        let sample = |i: usize| domain.to_linear(encoding, i as f32 / Self::STEPS as f32);
        let table = curved.then(|| Box::new(std::array::from_fn(sample)));
        Self { domain, encoding, table }
    }

    /// Converts a value of the domain to linear light; negative results become zero.
    #[inline(always)]
    pub fn linear(&self, value: f32) -> f32 {
        match &self.table {
            Some(table) if (1.0 / 64.0..=1.0).contains(&value) => {
                let (i, fraction) = split(value * Self::STEPS as f32);
                let [start, end] = [i, i + 1].map(|i| table[i % (Self::STEPS * 2)]);
                start + fraction * (end - start)
            }
            _ => self.curve(value),
        }
    }

    #[inline(never)]
    fn curve(&self, value: f32) -> f32 {
        self.domain.to_linear(self.encoding, value).max(0.0)
    }
}

/// Splits a number in 0..2^22 into a step and the rest, from the mantissa of a sum that has no room for a fraction,
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
            for i in -100..3000 {
                let value = i as f32 / 2345.6;
                let exact = domain.to_linear(encoding, value).max(0.0);
                assert!((table.linear(value) - exact).abs() < 1e-6 * exact.max(1.0), "{domain:?} {encoding} {value}");
            }
        }
    }
}
