//! Sums of products in AVX2.

use std::arch::x86_64::*;

use super::{Compact, LANES, Pairs, line_of};

impl Compact {
    /// Gives the same bits as [`Compact::products_portable`].
    #[target_feature(enable = "avx2")]
    #[inline]
    #[expect(clippy::needless_range_loop, reason = "one index runs over several arrays")]
    pub(super) fn products_avx2<const T: usize>(
        &self,
        pairs: &Pairs,
        texels: [usize; T],
        weights: [i16; T],
    ) -> [i32; 3] {
        let (groups, lines) = (self.c / LANES, self.lines());
        let count = pairs.count.min(16);
        let mut in_range = self.fixed.lines.len() == groups;
        for line in &pairs.line[..count] {
            in_range &= line + 3 * lines <= self.rows.len();
        }
        for texel in texels {
            in_range &= texel + self.lines() <= self.coefficients.len();
        }
        assert!(in_range, "the texel and the stencil belong to this table");
        let (rows, coefficients) = (self.rows.as_ptr(), self.coefficients.as_ptr());
        let mut pair_weights = [_mm256_setzero_si256(); 16];
        for i in 0..count {
            pair_weights[i] = _mm256_set1_epi16(pairs.weight[i]);
        }
        let mut totals = [_mm256_setzero_si256(); 3];
        for group in 0..groups {
            let (line, shift) = line_of(group, self.fine);
            let coarse = group >= self.fine;
            let (upper, highest) = (_mm256_set1_epi16(0x7800), _mm256_set1_epi16(0xf000u16 as i16));
            let mut number = _mm256_setzero_si256();
            for t in 0..T {
                // SAFETY: checked above; a line has 16 bytes.
                let bytes = unsafe { _mm_loadu_si128(coefficients.add(texels[t] + line).cast()) };
                let bytes = _mm256_cvtepu8_epi16(bytes);
                let widened = match (coarse, shift) {
                    (true, 0) => _mm256_and_si256(_mm256_slli_epi16::<11>(bytes), upper),
                    (true, _) => _mm256_and_si256(_mm256_slli_epi16::<7>(bytes), upper),
                    (false, _) => _mm256_slli_epi16::<7>(bytes),
                };
                number = _mm256_add_epi16(number, _mm256_mulhrs_epi16(widened, _mm256_set1_epi16(weights[t])));
            }
            let [offset, scale] = &self.fixed.lines[group];
            // SAFETY: 16 numbers each.
            let (offset, scale) =
                unsafe { (_mm256_loadu_si256(offset.as_ptr().cast()), _mm256_loadu_si256(scale.as_ptr().cast())) };
            let coefficient = _mm256_add_epi16(_mm256_mulhrs_epi16(number, scale), offset);
            let mut component = [_mm256_setzero_si256(); 3];
            for i in 0..count {
                for channel in 0..3 {
                    // SAFETY: checked above; a line has 16 bytes.
                    let bytes = unsafe { _mm_loadu_si128(rows.add(pairs.line[i] + channel * lines + line).cast()) };
                    let bytes = _mm256_cvtepi8_epi16(bytes);
                    let wide = match (coarse, shift) {
                        (true, 0) => _mm256_slli_epi16::<12>(bytes),
                        (true, _) => _mm256_and_si256(_mm256_slli_epi16::<8>(bytes), highest),
                        (false, _) => _mm256_slli_epi16::<8>(bytes),
                    };
                    component[channel] =
                        _mm256_add_epi16(component[channel], _mm256_mulhrs_epi16(wide, pair_weights[i]));
                }
            }
            for channel in 0..3 {
                let product = _mm256_madd_epi16(coefficient, component[channel]);
                totals[channel] = _mm256_add_epi32(totals[channel], product);
            }
        }
        // add up eight lanes of three channels at once
        let [r, g, b] = totals;
        let rg = _mm256_hadd_epi32(r, g);
        let rgb = _mm256_hadd_epi32(rg, _mm256_hadd_epi32(b, b));
        let sum = _mm_add_epi32(_mm256_castsi256_si128(rgb), _mm256_extracti128_si256::<1>(rgb));
        [_mm_extract_epi32::<0>(sum), _mm_extract_epi32::<1>(sum), _mm_extract_epi32::<2>(sum)]
    }
}
