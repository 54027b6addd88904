//! What recorder and rendering say of themselves.

use bytemuck::{Pod, Zeroable};

/// How far the recorder has come.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct RecorderStatus {
    /// The newest tick on disk.
    pub last_tick: u64,
    /// Ticks written.
    pub ticks: u64,
    /// Ticks that could not be had any more.
    pub lost: u64,
    /// Bytes on disk.
    pub bytes: u64,
}

/// The passes of a picture that are timed apart, in their order.
pub const PICTURE_PASSES: [&str; 5] = ["normals", "scene", "focus", "glow", "finish"];

/// What rendering says of itself each frame.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct RenderingStatus {
    /// Frames since the start.
    pub frames: u64,
    /// Bytes uploaded for the last frame (the only copy).
    pub upload_bytes: u64,
    /// Bytes copied for the last frame beyond the upload.
    pub copied_bytes: u64,
    /// Time of the last frame, ms.
    pub frame_ms: f32,
    /// Internal scale, 0…1.
    pub scale: f32,
    /// Time of each of [`PICTURE_PASSES`] as the device counts it, ms; 0 where it keeps no time.
    pub passes_ms: [f32; PICTURE_PASSES.len()],
    /// Width and height of the picture, px.
    pub size_px: [u32; 2],
    /// Ticks from one picture to the next, and the least that they may be.
    pub period_ticks: [u32; 2],
    /// Distance from the lens at which the picture is sharp, m; 0 while nothing is blurred, from outside or to save time.
    pub focus_m: f32,
    /// Tick of the tissue's state that is shown; 0 while the stage is empty.
    pub shown_tick: u64,
}
