//! What the shaders read per frame, laid out as they declare it (`scene.wgsl`, `post.wgsl`). No number that is not finite gets past here.
use bytemuck::{Pod, Zeroable};

use crate::{
    blood::{LIT, SPECTRUM},
    camera::{Eye, NEAR_M, View},
    fluid::Fluid,
    overlay::COLUMNS,
    shadow::{lamp_view, texel},
    targets::Sizes,
};

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
pub(crate) struct Globals {
    view_proj: [[f32; 4]; 4],
    eye: [f32; 4],
    light: [f32; 4],
    light_axis: [f32; 4],
    cone: [f32; 4],
    clip: [f32; 4],
    fluid_min: [f32; 4],
    fluid_max: [f32; 4],
    blood: [f32; 4],
    murk: [f32; 4],
    blood_min: [f32; 4],
    blood_max: [f32; 4],
    lamp: [[f32; 4]; 4],
}

impl Globals {
    /// The same, seen from the lamp.
    pub(crate) fn seen_from_lamp(&self) -> Self {
        Self { view_proj: self.lamp, ..*self }
    }
}

/// Radius beyond which nothing is blurred more, as a share of the picture's side: that of a wall at 4 mm, which the taps still cover without gaps.
const LARGEST_DISC: f32 = 0.02;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
pub(crate) struct Post {
    size: [f32; 4],
    lens: [f32; 4],
    tone: [f32; 4],
    text: [f32; 4],
    focus: [f32; 4],
}

pub(crate) fn globals(eye: &Eye, light: f32, fluid: &Fluid, has_shadows: bool) -> Globals {
    // at the tip: full at 10 mm, and what the cavity mirrors is of the same lamp; outside: a lamp that gives one unit at the target, from wherever it stands
    let (intensity, outer, inner, ambient) = if eye.round {
        (2.2 * light, 0.42, 0.97, light.min(1.0))
    } else {
        (1.3 * light * eye.lamp_m * eye.lamp_m * 1.0e4, -1.1, -1.0, 1.4)
    };
    Globals {
        view_proj: eye.view_proj.to_cols_array_2d(),
        eye: eye.eye_m.extend(1.0).to_array(),
        light: eye.light_m.extend(intensity).to_array(),
        light_axis: eye.light_axis.extend(outer).to_array(),
        cone: [inner, ambient, NEAR_M, if has_shadows { texel() } else { 0.0 }],
        clip: eye.clip,
        fluid_min: fluid.min,
        fluid_max: fluid.max,
        blood: glam::Vec3::from(LIT).extend(1.0).to_array(),
        // The light of the lamp, which is beside the lens, goes there and comes back.
        murk: (2.0 * fluid.extinction_per_m * glam::Vec3::from(SPECTRUM)).extend(0.0).to_array(),
        blood_min: fluid.where_any[0],
        blood_max: fluid.where_any[1],
        lamp: lamp_view(eye).to_cols_array_2d(),
    }
}

/// Pixels for each of a glyph's, in a picture so high.
pub(crate) fn glyph_px(height_px: f32) -> f32 {
    (height_px / 420.0).round().max(1.0)
}

pub(crate) fn post(view: &View, eye: &Eye, sizes: Sizes) -> Post {
    let flag = |on: bool| f32::from(u8::from(on));
    let [w, h] = sizes.shown.map(|n| n as f32);
    let [iw, ih] = sizes.inner.map(|n| n as f32);
    let gain = if view.gain.is_finite() { view.gain.clamp(0.05, 20.0) } else { 1.0 };
    let rate = if view.adaptation.is_finite() { view.adaptation.clamp(0.0, 1.0) } else { 1.0 };
    let (sharp, spread) = eye.focus.map_or((0.0, 0.0), |focus| (focus.sharp, focus.spread));
    Post {
        size: [w, h, iw, ih],
        lens: [eye.distortion[0], eye.distortion[1], flag(eye.round), eye.notch_rad],
        tone: [gain, rate, flag(!eye.round), if view.quality.bloom { 0.35 } else { 0.0 }],
        text: [glyph_px(h), COLUMNS as f32, view.overlay.rows() as f32, flag(!view.overlay.sign.is_empty())],
        focus: [sharp, spread * iw, LARGEST_DISC * iw, 0.0],
    }
}
