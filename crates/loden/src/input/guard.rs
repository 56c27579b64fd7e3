//! Decoders of other crates, which may panic.

use std::cell::Cell;
use std::panic::AssertUnwindSafe;
use std::sync::Once;

/// Runs a decoder of another crate. A panic is blamed on the file, and the error names the decoder.
pub(crate) fn guarded<T>(decoder: &str, decode: impl FnOnce() -> T) -> std::result::Result<T, String> {
    thread_local!(static IS_GUARDED: Cell<bool> = const { Cell::new(false) });
    static QUIET: Once = Once::new();
    // the message of a panic that is caught is not for the user
    QUIET.call_once(|| {
        let others = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |info| {
            if !IS_GUARDED.get() {
                others(info);
            }
        }));
    });
    let outer = IS_GUARDED.replace(true);
    let decoded = std::panic::catch_unwind(AssertUnwindSafe(decode));
    IS_GUARDED.set(outer);
    decoded.map_err(|_| format!("the content is damaged or of an unusual kind: the {decoder} decoder failed"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn panics_of_decoders_are_errors() {
        assert_eq!(guarded("PNG", || 3), Ok(3));
        let error = guarded("PNG", || -> usize { panic!("index out of range") }).unwrap_err();
        assert!(error.contains("the PNG decoder failed"), "{error}");
    }
}
