//! The Vision Engine: what the surgeon sees, drawn with Vulkan on a GPU or on lavapipe, in a window or headless.
//!
//! The scene graph ([`Stage`]) reads what streams in and hands it to the driver, which is the only copy; normals, textures and light are
//! computed by the device. Pictures give way first ([`Effort`]); no failure in here is anything but one error of one line, and nothing
//! in here is on the way from the hand to the force.
//!
//! Technique: forward shading with solid noise at rest positions (Perlin 2002), smooth normals by a gather over incident triangles,
//! inverse-square spotlight, thin-lens focus gathered over discs, a filmic curve, and a radial lens polynomial of degree 4.
mod blood;
mod bubbles;
mod camera;
mod caught;
mod effort;
mod error;
mod flow;
mod fluid;
mod font;
mod gpu;
mod hash;
mod help;
mod input;
mod layouts;
mod marks;
mod motes;
#[cfg(test)]
mod noise;
mod ostia;
mod overlay;
mod passes;
mod pipelines;
mod present;
mod quality;
mod renderer;
mod shadow;
pub mod shapes;
mod stage;
mod targets;
mod timing;
mod uniforms;
mod window;

pub use bubbles::Bubbles;
pub use camera::{Camera, Endoscope, External, USUAL_PERIPHERY_RATIO, View, distortion};
pub use caught::spare_caught_panics;
pub use effort::{Effort, FASTEST_TICKS, SLOWEST_TICKS, fastest_ticks, in_step};
pub use error::RenderError;
pub use flow::FlowField;
pub use fluid::{CLEAR, FluidField, MAX_CELLS};
pub use gpu::{Gpu, Prefer, Without};
pub use help::{help, help_hint};
pub use input::{Key, PointerInput};
pub use marks::{Arrow, Marks};
pub use motes::Motes;
pub use ostia::{MOUTH_RADIUS_M, ostia};
pub use overlay::{ALARM, ALARM_COLUMNS, COLUMNS, Overlay, ROWS};
pub use present::{Shown, append_jpeg, save_png};
pub use quality::{MIN_SCALE, Quality, SCALE_STEP, SHADED_SCALE, next_scale};
pub use renderer::{FRAME_LIMIT, FrameStats, MAX_SIDE_PX, Renderer};
pub use stage::{Appearance, MAX_OBJECTS, MAX_SPOTS, MAX_TRIANGLES, Material, Stage, SurfaceMesh, Surroundings};
pub use timing::PASS_NAMES;
pub use window::{Pane, Status, Window};
