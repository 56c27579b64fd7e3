//! Run-time selection of instruction sets, and computation with several values at a time.

pub(crate) mod many;

/// Defines a function whose body is compiled twice, for the baseline and for AVX2; the version is selected at run time.
///
/// The body consists of plain loops that vectorise. Neither version fuses a product and a sum into one rounding, so
/// both give the same bits.
macro_rules! wide {
    ($(#[$doc:meta])* $vis:vis fn $name:ident<$m:ident: $bound:path>($($arg:ident: $ty:ty),* $(,)?) $body:block) => {
        $(#[$doc])*
        $vis fn $name<$m: $bound>($($arg: $ty),*) {
            #[inline(always)]
            fn portable<$m: $bound>($($arg: $ty),*) $body

            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx2")]
                fn avx2<$m: $bound>($($arg: $ty),*) {
                    portable($($arg),*);
                }
                if crate::simd::has_avx2() {
                    // SAFETY: the processor has AVX2.
                    return unsafe { avx2($($arg),*) };
                }
            }
            portable($($arg),*);
        }
    };
    ($(#[$doc:meta])* $vis:vis fn $name:ident$(<$l:lifetime>)?$(<const $n:ident: $t:ty>)?($($arg:ident: $ty:ty),* $(,)?) $(-> $ret:ty)? $body:block) => {
        $(#[$doc])*
        $vis fn $name$(<$l>)?$(<const $n: $t>)?($($arg: $ty),*) $(-> $ret)? {
            #[inline(always)]
            fn portable$(<$l>)?$(<const $n: $t>)?($($arg: $ty),*) $(-> $ret)? $body

            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx2")]
                fn avx2$(<$l>)?$(<const $n: $t>)?($($arg: $ty),*) $(-> $ret)? {
                    portable$(::<$n>)?($($arg),*)
                }
                if crate::simd::has_avx2() {
                    // SAFETY: the processor has AVX2.
                    return unsafe { avx2$(::<$n>)?($($arg),*) };
                }
            }
            portable$(::<$n>)?($($arg),*)
        }
    };
}

pub(crate) use wide;

/// Natural exponential of x <= 700 with a relative error of 3e-13, without calls or branches, so loops over it
/// vectorise. Zero below -708, where results would be subnormal.
#[inline(always)]
pub(crate) fn exp(x: f64) -> f64 {
    // adding this leaves the nearest integer in the lowest bits
    const MAGIC: f64 = 1.5 * (1u64 << 52) as f64;
    // ln 2 in two parts; products of the first with integers are exact
    const HIGH: f64 = f64::from_bits(0x3fe6_2e42_fee0_0000);
    const LOW: f64 = 1.908_214_929_270_587_7e-10;
    let shifted = x * std::f64::consts::LOG2_E + MAGIC;
    let whole = shifted - MAGIC;
    let r = x - whole * HIGH - whole * LOW;
    // 1 + r + r^2 / 2! + ..., in pairs, which shortens the chain of dependent products
    let (r2, r4) = (r * r, (r * r) * (r * r));
    let low = 1.0 + r + (1.0 / 2.0 + r * (1.0 / 6.0)) * r2;
    let middle = 1.0 / 24.0 + r * (1.0 / 120.0) + (1.0 / 720.0 + r * (1.0 / 5040.0)) * r2;
    let high = 1.0 / 40_320.0 + r * (1.0 / 362_880.0) + r2 * (1.0 / 3_628_800.0);
    let sum = low + middle * r4 + high * (r4 * r4);
    let power = f64::from_bits(shifted.to_bits().wrapping_add(1023) << 52);
    if x > -708.0 { sum * power } else { 0.0 }
}

/// Natural logarithm of a positive normal number, accurate to 2e-14 relative or absolute, whichever is larger, without
/// calls or branches, so loops over it vectorise.
#[inline(always)]
pub(crate) fn ln(x: f64) -> f64 {
    const ROOT_HALF: u64 = std::f64::consts::FRAC_1_SQRT_2.to_bits();
    const TWO52: u64 = 0x4330_0000_0000_0000;
    // x = 2^(power - 1023) m with m in sqrt(1/2)..sqrt(2)
    let power = x.to_bits().wrapping_sub(ROOT_HALF).wrapping_add(1023 << 52) >> 52;
    let m = f64::from_bits(x.to_bits().wrapping_sub(power.wrapping_sub(1023) << 52));
    let power = f64::from_bits(power | TWO52) - (f64::from_bits(TWO52) + 1023.0);
    let s = (m - 1.0) / (m + 1.0);
    // 1 + t / 3 + t^2 / 5 + ...
    let t = s * s;
    let t2 = t * t;
    let low = 1.0 + t * (1.0 / 3.0) + (1.0 / 5.0 + t * (1.0 / 7.0)) * t2;
    let high = 1.0 / 9.0 + t * (1.0 / 11.0) + (1.0 / 13.0 + t * (1.0 / 15.0)) * t2;
    2.0 * s * (low + high * (t2 * t2)) + power * std::f64::consts::LN_2
}

/// Prefetches the cache line of a number that is needed soon; does nothing if the index is out of range.
#[inline(always)]
pub(crate) fn prefetch<T>(values: &[T], place: usize) {
    #[cfg(target_arch = "x86_64")]
    if let Some(value) = values.get(place) {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        // SAFETY: a prefetch of readable memory; SSE is part of x86-64.
        unsafe { _mm_prefetch::<{ _MM_HINT_T0 }>(std::ptr::from_ref(value).cast()) };
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (values, place);
}

/// Whether the processor has AVX2.
#[cfg(target_arch = "x86_64")]
#[inline]
pub(crate) fn has_avx2() -> bool {
    #[cfg(test)]
    if PORTABLE.get() {
        return false;
    }
    is_x86_feature_detected!("avx2")
}

/// Whether the processor has AVX-512 with all number sizes and vector lengths (F, VL, DQ, BW).
#[cfg(target_arch = "x86_64")]
#[inline]
pub(crate) fn has_avx512() -> bool {
    let all = is_x86_feature_detected!("avx512f")
        && is_x86_feature_detected!("avx512vl")
        && is_x86_feature_detected!("avx512dq")
        && is_x86_feature_detected!("avx512bw");
    all && has_avx2()
}

#[cfg(test)]
std::thread_local! {
    static PORTABLE: std::cell::Cell<bool> = const { std::cell::Cell::new(false) };
}

/// Runs `f` on this thread with the portable code only.
#[cfg(test)]
pub(crate) fn portable<T>(f: impl FnOnce() -> T) -> T {
    PORTABLE.set(true);
    let result = f();
    PORTABLE.set(false);
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exponentials_and_logarithms_are_as_accurate_as_documented() {
        for i in 0..200_000u32 {
            let x = -707.9 + f64::from(i) * 0.007;
            let (found, expected) = (exp(x), x.exp());
            assert!((found / expected - 1.0).abs() < 4e-13, "exp({x}): {found} {expected}");
            let y = (f64::from(i) * 0.003 - 300.0).exp() * 1.7;
            assert!((ln(y) - y.ln()).abs() < 3e-14 * y.ln().abs().max(1.0), "ln({y}): {} {}", ln(y), y.ln());
        }
        for nothing in [-708.0, -1e6, f64::NEG_INFINITY] {
            assert_eq!(exp(nothing), 0.0);
        }
        assert_eq!((exp(0.0), ln(1.0)), (1.0, 0.0));
    }
}
