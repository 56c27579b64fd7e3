//! Entropy coding: adaptive binary range coding, with one routine for both encoding and decoding.
//!
//! # Model
//! An integer is coded as a zero flag, a sign, and its magnitude minus one: unary up to a limit, then exponential
//! Golomb. Each binary decision has a probability that adapts at two speeds. Its context is the band and the
//! magnitudes of neighbours that both sides already know.
//!
//! # References
//! martin1979, marpe2003

/// Probability of zero in units of 1/65536, the average of a fast and a slow estimate; both start fast.
#[derive(Debug, Clone, Copy)]
pub(in crate::codec) struct Bit {
    of_zero: [u16; 2],
    seen: u8,
}

impl Bit {
    /// Both are equally likely.
    pub const EVEN: Self = Self { of_zero: [1 << 15; 2], seen: 0 };
    const SPEEDS: [u32; 2] = [5, 8];

    fn of_zero(self) -> u32 {
        let [a, b] = self.of_zero.map(u32::from);
        ((a + b) / 2).clamp(32, 65536 - 32)
    }

    fn adapt(&mut self, bit: bool) {
        let known = 1 + (u32::from(self.seen) + 1).ilog2();
        self.seen = self.seen.saturating_add(1);
        for (p, speed) in self.of_zero.iter_mut().zip(Self::SPEEDS) {
            if bit {
                *p -= *p >> speed.min(known);
            } else {
                *p += (u16::MAX - *p) >> speed.min(known);
            }
        }
    }
}

/// Encoder or decoder: an encoder stores the decision passed in, a decoder returns the stored one.
pub(in crate::codec) trait Coder {
    /// Codes a decision whose probability of zero is `of_zero` / 65536.
    fn bit(&mut self, of_zero: u32, bit: bool) -> bool;
}

/// Ranges below this are renormalised.
const NARROW: u32 = 1 << 24;

/// Encodes decisions.
#[derive(Debug)]
pub(in crate::codec) struct Encoder {
    low: u64,
    range: u32,
    /// The last byte that a carry can still change, and the number of 0xff bytes after it.
    cache: Option<u8>,
    ones: usize,
    out: Vec<u8>,
}

impl Default for Encoder {
    fn default() -> Self {
        Self { low: 0, range: u32::MAX, cache: None, ones: 0, out: Vec::new() }
    }
}

impl Encoder {
    fn shift(&mut self) {
        let carry = (self.low >> 32) as u8;
        if carry == 0 && (self.low as u32) >= 0xff << 24 {
            self.ones += 1;
        } else {
            self.out.extend(self.cache.map(|byte| byte.wrapping_add(carry)));
            self.out.extend(std::iter::repeat_n(0xffu8.wrapping_add(carry), self.ones));
            (self.cache, self.ones) = (Some((self.low >> 24) as u8), 0);
        }
        self.low = (self.low << 8) & u64::from(u32::MAX);
    }

    /// The bytes written. A decoder reads zeros beyond the end.
    pub fn finish(mut self) -> Vec<u8> {
        for _ in 0..5 {
            self.shift();
        }
        while self.out.last() == Some(&0) {
            self.out.pop();
        }
        self.out
    }
}

impl Coder for Encoder {
    fn bit(&mut self, of_zero: u32, bit: bool) -> bool {
        let bound = (self.range >> 16) * of_zero;
        if bit {
            self.low += u64::from(bound);
            self.range -= bound;
        } else {
            self.range = bound;
        }
        while self.range < NARROW {
            self.range <<= 8;
            self.shift();
        }
        bit
    }
}

/// Decodes decisions.
#[derive(Debug)]
pub(in crate::codec) struct Decoder<'a> {
    code: u32,
    range: u32,
    rest: std::slice::Iter<'a, u8>,
}

impl<'a> Decoder<'a> {
    /// Starts at the bytes of an [`Encoder`].
    pub fn new(bytes: &'a [u8]) -> Self {
        let mut decoder = Self { code: 0, range: u32::MAX, rest: bytes.iter() };
        for _ in 0..4 {
            decoder.shift();
        }
        decoder
    }

    fn shift(&mut self) {
        self.code = self.code << 8 | u32::from(self.rest.next().copied().unwrap_or(0));
    }
}

impl Coder for Decoder<'_> {
    fn bit(&mut self, of_zero: u32, _: bool) -> bool {
        let bound = (self.range >> 16) * of_zero;
        let bit = self.code >= bound;
        if bit {
            self.code -= bound;
            self.range -= bound;
        } else {
            self.range = bound;
        }
        while self.range < NARROW {
            self.range <<= 8;
            self.shift();
        }
        bit
    }
}

/// Number of context classes of neighbours and of frequency.
const LEVELS: usize = 12;
const BANDS: usize = 8;
/// The largest magnitude minus one coded in unary.
const UNARY: usize = 14;
/// Maximum number of bits of an exponential Golomb code.
const TAIL: usize = 24;

/// Adaptive probabilities for integers.
#[derive(Debug, Clone)]
pub(in crate::codec) struct Numbers {
    zero: [[Bit; BANDS]; LEVELS],
    size: [[Bit; UNARY]; LEVELS],
    tail: [Bit; TAIL],
}

impl Default for Numbers {
    fn default() -> Self {
        Self { zero: [[Bit::EVEN; BANDS]; LEVELS], size: [[Bit::EVEN; UNARY]; LEVELS], tail: [Bit::EVEN; TAIL] }
    }
}

/// Codes a decision with an adaptive probability.
pub(in crate::codec) fn adaptive(coder: &mut impl Coder, model: &mut Bit, bit: bool) -> bool {
    let bit = coder.bit(model.of_zero(), bit);
    model.adapt(bit);
    bit
}

impl Numbers {
    /// Codes `value`, which a decoder ignores, and returns it. `around` is a weighted sum of neighbouring magnitudes;
    /// `frequency` counts from zero.
    pub fn code(&mut self, coder: &mut impl Coder, value: i32, around: u32, frequency: usize) -> i32 {
        let level = level(around);
        let band = ((frequency + 1).ilog2() as usize).min(BANDS - 1);
        if !adaptive(coder, &mut self.zero[level][band], value != 0) {
            return 0;
        }
        let negative = coder.bit(1 << 15, value < 0);
        let more = value.unsigned_abs().wrapping_sub(1);
        let mut size = 0;
        while size < UNARY as u32 && adaptive(coder, &mut self.size[level][size as usize], more > size) {
            size += 1;
        }
        if size == UNARY as u32 {
            size += self.golomb(coder, more.wrapping_sub(size));
        }
        let size = size as i32 + 1;
        if negative { -size } else { size }
    }

    fn golomb(&mut self, coder: &mut impl Coder, value: u32) -> u32 {
        let value = value.wrapping_add(1);
        let bits = value.max(1).ilog2() as usize;
        let mut count = 0;
        while count + 1 < TAIL && adaptive(coder, &mut self.tail[count], bits > count) {
            count += 1;
        }
        let rest = (0..count).rev().fold(1u32, |sum, i| sum << 1 | u32::from(coder.bit(1 << 15, value >> i & 1 != 0)));
        rest - 1
    }
}

/// Lower bounds of the classes above the fifth.
const STEPS: [u32; LEVELS - 5] = [5, 7, 10, 15, 24, 40, 70];

fn level(around: u32) -> usize {
    if around < STEPS[0] { around as usize } else { 4 + STEPS.partition_point(|&step| step <= around) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn round_trip(values: &[i32]) -> (Vec<i32>, usize) {
        let around = |i: usize| if i == 0 { 0 } else { values[i - 1].unsigned_abs().min(1000) };
        let (mut encoder, mut numbers) = (Encoder::default(), Numbers::default());
        for (i, &value) in values.iter().enumerate() {
            numbers.code(&mut encoder, value, around(i), i % 40);
        }
        let bytes = encoder.finish();
        let (mut decoder, mut numbers) = (Decoder::new(&bytes), Numbers::default());
        let found = (0..values.len()).map(|i| numbers.code(&mut decoder, 0, around(i), i % 40)).collect();
        (found, bytes.len())
    }

    proptest! {
        #[test]
        fn numbers_come_back(values in proptest::collection::vec(prop_oneof![-3i32..4, -100i32..100, -4_000_000i32..4_000_000], 0..400)) {
            prop_assert_eq!(round_trip(&values).0, values);
        }

        #[test]
        fn any_bytes_decode_to_something(bytes in proptest::collection::vec(any::<u8>(), 0..64)) {
            let (mut decoder, mut numbers) = (Decoder::new(&bytes), Numbers::default());
            for i in 0..500 {
                let value = numbers.code(&mut decoder, 0, i * i, i as usize);
                prop_assert!(value.unsigned_abs() < 1 << 25);
            }
        }
    }

    #[test]
    fn carries_run_through_bytes_of_ones() {
        let mut encoder = Encoder::default();
        let bits: Vec<bool> = (0..4000).map(|i| i % 97 != 0).collect();
        for &bit in &bits {
            encoder.bit(40, bit);
        }
        let bytes = encoder.finish();
        let mut decoder = Decoder::new(&bytes);
        assert!(bits.iter().all(|&bit| decoder.bit(40, false) == bit));
    }

    #[test]
    fn a_skewed_source_costs_about_its_entropy() {
        // one in 64 is non-zero: an entropy of 0.116 bits, plus a sign
        let values: Vec<i32> = (0..1 << 16).map(|i: u32| i32::from(i.wrapping_mul(0x9E37_79B9) >> 26 == 0)).collect();
        let (found, bytes) = round_trip(&values);
        assert_eq!(found, values);
        let ideal = 65536.0 * (0.1161 + 1.0 / 64.0) / 8.0;
        assert!((bytes as f64) < 1.1 * ideal, "{bytes} {ideal}");
    }

    #[test]
    fn levels_rise_through_all_classes() {
        let levels: Vec<usize> = (0..200).map(level).collect();
        assert!(levels.is_sorted() && levels[0] == 0 && levels[199] == LEVELS - 1);
        assert!((0..LEVELS).all(|l| levels.contains(&l)), "{levels:?}");
    }
}
