//! What of a window is drawn into, on whichever thread that is.
//!
//! Promise: it is of use as long as the window's own thread keeps the window, and is to be dropped before.
use std::sync::Arc;

use winit::{dpi::LogicalSize, window::Window as Native};

use super::guarded;
use crate::error::RenderError;

/// A window, as whoever draws has it.
#[derive(Clone)]
pub struct Pane {
    pub(super) native: Arc<Native>,
    pub(super) refresh_hz: Option<f32>,
}

impl std::fmt::Debug for Pane {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Pane").field("refresh_hz", &self.refresh_hz).finish_non_exhaustive()
    }
}

impl Pane {
    /// Pictures in a second that the display it was opened on shows, if the display says it.
    pub fn refresh_hz(&self) -> Option<f32> {
        self.refresh_hz
    }

    /// Asks for another size of what is inside, px; the user's display has the last word.
    ///
    /// # Errors
    /// [`RenderError::NoDisplay`] if the display went away.
    pub fn resize(&self, width_px: u32, height_px: u32) -> Result<(), RenderError> {
        guarded(|| self.native.request_inner_size(LogicalSize::new(width_px, height_px))).map(|_| ())
    }

    pub(crate) fn handle(&self) -> Arc<Native> {
        Arc::clone(&self.native)
    }
}
