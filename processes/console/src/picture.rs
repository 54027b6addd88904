//! A picture of rendering's stream as a browser takes it. Promise: what is not a picture gives none, and an old one is not shown.

use axum::body::Bytes;
use hyst_exchange::system;

/// A picture that is older is not shown, ns: rendering sends one five times a second, and once where it has little time.
const FRESH_NS: u64 = 2_000_000_000;

/// A picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Tick at which it was drawn.
    pub tick: u64,
    /// When it was received, CLOCK_MONOTONIC ns.
    pub at_ns: u64,
    /// The file.
    pub jpeg: Bytes,
}

impl Picture {
    /// From a message; `None` if it is none.
    pub fn encode(message: &[u8]) -> Option<Picture> {
        let (tick, jpeg) = hyst_recording::jpeg(message)?;
        Some(Picture { tick, at_ns: system::now_ns(), jpeg: Bytes::from(jpeg) })
    }

    /// Whether it is still to be shown.
    pub fn is_fresh(&self) -> bool {
        system::now_ns().saturating_sub(self.at_ns) < FRESH_NS
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_is_shown_for_two_seconds_and_what_is_none_never() {
        let at_ns = system::now_ns();
        let picture = Picture { tick: 1, at_ns, jpeg: Bytes::new() };
        assert!(picture.is_fresh() && !Picture { at_ns: at_ns.saturating_sub(FRESH_NS), ..picture }.is_fresh());
        assert_eq!(Picture::encode(&[1, 2, 3]), None);
    }
}
