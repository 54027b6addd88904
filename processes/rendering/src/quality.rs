//! Pictures give way first: the inner resolution follows the time that a frame takes.
//!
//! Promise: a pure function; the scale stays within its bounds for every input, also for a frame time that is not a number.

/// Smallest share of the shown height that is drawn.
pub const MIN_SCALE: f32 = 0.375;
/// Steps of the scale, so that textures are not made anew for a change that nobody sees.
pub const SCALE_STEP: f32 = 0.125;
/// A larger picture is tried if it is expected below this share of the budget.
const ROOM: f32 = 0.75;
/// Share of a frame's time that does not follow the scale (lens, text, hand-over), as measured on lavapipe at 640×480.
const FIXED: f32 = 0.35;

/// How much is drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quality {
    /// inner resolution as a share of the shown one, per axis, in `MIN_SCALE..=1`
    pub scale: f32,
    /// glow around highlights
    pub bloom: bool,
    /// what is out of focus is blurred
    pub focus: bool,
}

impl Default for Quality {
    fn default() -> Self {
        Self { scale: 1.0, bloom: true, focus: true }
    }
}

/// The scale for the next frame. `frame_ms` is what the last frame took at `scale`, `budget_ms` what it may take.
///
/// Falls at once, by as many steps as needed if the cost were proportional to the number of pixels; rises by one step and only if the larger
/// picture is expected well within the budget, so that it does not oscillate.
pub fn next_scale(frame_ms: f32, budget_ms: f32, scale: f32) -> f32 {
    let now = quantised(scale);
    if !(frame_ms.is_finite() && budget_ms.is_finite() && budget_ms > 0.0) {
        return MIN_SCALE;
    }
    if frame_ms > budget_ms {
        let fits = now * (0.95 * budget_ms / frame_ms).sqrt();
        return quantised((fits / SCALE_STEP).floor() * SCALE_STEP).min((now - SCALE_STEP).max(MIN_SCALE));
    }
    let larger = quantised(now + SCALE_STEP);
    let expected_ms = frame_ms.max(0.0) * (FIXED + (1.0 - FIXED) * (larger / now).powi(2));
    if expected_ms < ROOM * budget_ms { larger } else { now }
}

fn quantised(scale: f32) -> f32 {
    if !scale.is_finite() {
        return 1.0;
    }
    ((scale / SCALE_STEP).round() * SCALE_STEP).clamp(MIN_SCALE, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Runs the controller against a machine whose frame costs `ms_at_full` at scale 1.
    fn settled(ms_at_full: f32, budget_ms: f32) -> (f32, usize) {
        let (mut scale, mut changes) = (1.0_f32, 0);
        for frame in 0..100 {
            let next = next_scale(ms_at_full * scale * scale, budget_ms, scale);
            changes += usize::from(frame > 10 && next != scale);
            scale = next;
        }
        (scale, changes)
    }

    #[test]
    fn settles_without_oscillation_on_every_machine() {
        for tenth in 1..2_000 {
            let (scale, changes) = settled(tenth as f32 * 0.1, 33.0);
            assert_eq!(changes, 0, "still changing at {tenth} tenths of a millisecond");
            assert!((MIN_SCALE..=1.0).contains(&scale));
            assert!(scale == MIN_SCALE || tenth as f32 * 0.1 * scale * scale <= 33.0);
        }
    }

    #[test]
    fn falls_at_once_and_rises_by_one_step() {
        assert_eq!(next_scale(132.0, 33.0, 1.0), 0.375); // a quarter of the pixels fits 0.49: the step below
        assert_eq!(next_scale(1.0, 33.0, 0.5), 0.625);
        assert_eq!(next_scale(33.1, 33.0, 1.0), 0.875);
    }

    #[test]
    fn no_number_leaves_the_bounds() {
        for frame in [f32::NAN, f32::INFINITY, -1.0, 0.0, 1e30] {
            for budget in [f32::NAN, 0.0, -5.0, 33.0] {
                for scale in [f32::NAN, -3.0, 0.0, 0.4, 9.0] {
                    assert!((MIN_SCALE..=1.0).contains(&next_scale(frame, budget, scale)), "{frame} {budget} {scale}");
                }
            }
        }
    }
}
