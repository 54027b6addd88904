//! Panics of the libraries beneath: the windowing library panics where a display is gone, wgpu where it waits for a device that its driver has lost.
//!
//! Promise: such a panic becomes an error where it happens. The process's own hook, which ends it at every other panic, does not hear of it.
use std::cell::Cell;

use crate::gpu::one_line;

thread_local! {
    static IS_CAUGHT: Cell<bool> = const { Cell::new(false) };
}

/// Keeps the panics that are caught in here from the hook that the process has set; to be called once, after that.
pub fn spare_caught_panics() {
    let usual = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |info| {
        if !IS_CAUGHT.get() {
            usual(info);
        }
    }));
}

/// What a call gives, or what it panicked with, on one line.
pub(crate) fn caught<T>(call: impl FnOnce() -> T) -> Result<T, String> {
    let is_within = IS_CAUGHT.replace(true);
    let result = std::panic::catch_unwind(std::panic::AssertUnwindSafe(call));
    IS_CAUGHT.set(is_within);
    result.map_err(|cause| {
        let text = cause.downcast_ref::<String>().cloned().or_else(|| cause.downcast_ref::<&str>().map(ToString::to_string));
        one_line(&text.unwrap_or_else(|| "it failed without a word".into()))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_is_an_error_of_one_line_and_those_outside_of_it_are_everybodys() {
        assert_eq!(caught(|| 7), Ok(7));
        let what = "lost";
        assert_eq!(caught::<u8>(|| panic!("Parent device\n\n  is {what}")), Err("Parent device is lost".into()));
        let within = caught(|| {
            assert_eq!(caught::<u8>(|| panic!("within")), Err("within".into()));
            IS_CAUGHT.get()
        });
        assert_eq!(within, Ok(true), "who catches within another leaves that one its own");
        assert!(!IS_CAUGHT.get());
    }
}
