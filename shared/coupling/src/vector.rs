//! The three small checks on `[f32; 3]` that every step of this crate needs. Private: not a maths library.

use glam::Vec3;

/// True if no component is NaN or infinite.
pub(crate) fn is_finite(v: [f32; 3]) -> bool {
    v[0].is_finite() && v[1].is_finite() && v[2].is_finite()
}

/// `v` shortened to `max_length` if it is longer; the result is never longer than `max_length`, rounding included.
/// Expects finite components; a negative or NaN `max_length` gives zero.
pub(crate) fn clamp_length(v: Vec3, max_length: f32) -> Vec3 {
    if max_length.is_nan() || max_length <= 0.0 {
        return Vec3::ZERO;
    }
    // f64: the square of a large but finite f32 must not overflow.
    let length = v.as_dvec3().length();
    if length <= f64::from(max_length) {
        return v;
    }
    // One part in a million short, so that rounding cannot push the result over the limit.
    (v.as_dvec3() * (f64::from(max_length) / length * (1.0 - 1e-6))).as_vec3()
}

/// The step from `from` towards `to`, no longer than `max_step`; `to` itself, bit for bit, if it is near enough.
pub(crate) fn step_towards(from: Vec3, to: Vec3, max_step: f32) -> Vec3 {
    let (from, to_f64) = (from.as_dvec3(), to.as_dvec3());
    let delta = to_f64 - from;
    if delta.length() <= f64::from(max_step) {
        return to;
    }
    // Shortened by what rounding to f32 can add.
    let rounding = f64::from(f32::EPSILON) * (from.length() + to_f64.length());
    let step = (f64::from(max_step) - rounding).max(0.0);
    (from + delta * (step / delta.length())).as_vec3()
}

/// `value` if it is finite and within `low..=high`, clamped to it if finite, else `fallback`.
pub(crate) fn sane(value: f32, low: f32, high: f32, fallback: f32) -> f32 {
    if value.is_finite() { value.clamp(low, high) } else { fallback }
}
