//! Run-time choice of instruction sets.

/// Defines a function whose body is compiled twice, for the baseline and for AVX2, and chosen at run time.
///
/// The body has plain loops that vectorise. Neither version contracts a product and a sum into one rounding, so both
/// give the same bits.
macro_rules! wide {
    ($(#[$doc:meta])* $vis:vis fn $name:ident$(<const $n:ident: $t:ty>)?($($arg:ident: $ty:ty),* $(,)?) $(-> $ret:ty)? $body:block) => {
        $(#[$doc])*
        $vis fn $name$(<const $n: $t>)?($($arg: $ty),*) $(-> $ret)? {
            #[inline(always)]
            fn portable$(<const $n: $t>)?($($arg: $ty),*) $(-> $ret)? $body

            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx2")]
                fn avx2$(<const $n: $t>)?($($arg: $ty),*) $(-> $ret)? {
                    portable$(::<$n>)?($($arg),*)
                }
                if crate::factor::simd::has_avx2() {
                    // SAFETY: the processor has AVX2.
                    return unsafe { avx2$(::<$n>)?($($arg),*) };
                }
            }
            portable$(::<$n>)?($($arg),*)
        }
    };
}

pub(crate) use wide;

/// Asks for a number's cache line, which is used soon; nothing happens if there is no such number.
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

/// Whether AVX2 can be used.
#[cfg(target_arch = "x86_64")]
#[inline]
pub(crate) fn has_avx2() -> bool {
    #[cfg(test)]
    if PORTABLE.get() {
        return false;
    }
    is_x86_feature_detected!("avx2")
}

#[cfg(test)]
std::thread_local! {
    static PORTABLE: std::cell::Cell<bool> = const { std::cell::Cell::new(false) };
}

/// Runs `f` on this thread without the special instruction sets.
#[cfg(test)]
pub(crate) fn portable<T>(f: impl FnOnce() -> T) -> T {
    PORTABLE.set(true);
    let result = f();
    PORTABLE.set(false);
    result
}
