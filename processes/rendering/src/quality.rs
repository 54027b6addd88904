//! Pictures give way first: the inner resolution follows the time that a frame takes.
//!
//! Promise: a pure function; the scale stays within its bounds for every input, also for a frame time that is not a number.

/// Smallest share of the shown height that is drawn.
pub const MIN_SCALE: f32 = 0.25;
/// The smallest with shadows: before fewer pixels are drawn they are given up.
pub const SHADED_SCALE: f32 = 0.375;
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
    /// what the lamp at the tip does not reach is dark
    pub shadows: bool,
}

impl Default for Quality {
    fn default() -> Self {
        Self { scale: 1.0, bloom: true, focus: true, shadows: true }
    }
}

/// The scale for the next frame, and whether it has shadows. `frame_ms` is what the last frame took with these, `budget_ms` what it may take.
///
/// Falls at once, by as many steps as needed if the cost were proportional to the number of pixels; rises by one step and only if the larger
/// picture is expected well within the budget, so that it does not oscillate. Where not even [`SHADED_SCALE`] fits, the shadows go there, and only then
/// pixels again; they come back there as soon as there is room for more pixels, which cost more than they do.
pub fn next_scale(frame_ms: f32, budget_ms: f32, (scale, shadows): (f32, bool)) -> (f32, bool) {
    let wanted = fitting_scale(frame_ms, budget_ms, scale);
    match shadows {
        true if wanted < SHADED_SCALE => (SHADED_SCALE, false),
        false if wanted > SHADED_SCALE => (SHADED_SCALE, true),
        _ => (wanted, shadows),
    }
}

/// The same as if pixels were all that there is to give up.
fn fitting_scale(frame_ms: f32, budget_ms: f32, scale: f32) -> f32 {
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

    /// What the shadows cost, as a share of a picture without them.
    const SHADOWS: [f32; 4] = [0.0, 0.2, 0.5, 0.9];

    /// What a frame costs on a machine where one at scale 1 with shadows costs `ms_at_full`.
    fn cost_ms(ms_at_full: f32, share: f32, (scale, shadows): (f32, bool)) -> f32 {
        ms_at_full * scale * scale / if shadows { 1.0 } else { 1.0 + share }
    }

    #[test]
    fn settles_without_oscillation_on_every_machine_whatever_its_shadows_cost() {
        for (tenth, share) in (1..4_000).flat_map(|tenth| SHADOWS.map(|share| (tenth, share))) {
            let ms_at_full = tenth as f32 * 0.1;
            let (mut drawn, mut changes) = ((1.0_f32, true), 0);
            for frame in 0..100 {
                let next = next_scale(cost_ms(ms_at_full, share, drawn), 33.0, drawn);
                changes += usize::from(frame > 10 && next != drawn);
                drawn = next;
            }
            assert_eq!(changes, 0, "still changing at {ms_at_full} ms, of which shadows are {share} of the rest");
            assert!(
                (MIN_SCALE..=1.0).contains(&drawn.0) && (drawn.1 || drawn.0 <= SHADED_SCALE),
                "{ms_at_full}, {share}: {drawn:?}"
            );
            assert!(drawn == (MIN_SCALE, false) || cost_ms(ms_at_full, share, drawn) <= 33.0, "{ms_at_full}, {share}: {drawn:?}");
        }
    }

    #[test]
    fn falls_at_once_and_rises_by_one_step() {
        assert_eq!(next_scale(132.0, 33.0, (1.0, true)), (0.375, true)); // a quarter of the pixels fits 0.49: the step below
        assert_eq!(next_scale(1.0, 33.0, (0.5, true)), (0.625, true));
        assert_eq!(next_scale(33.1, 33.0, (1.0, true)), (0.875, true));
    }

    /// At 0.375 of its size a picture that was still too slow stayed so.
    #[test]
    fn where_few_pixels_are_too_many_the_shadows_go_and_then_pixels_and_both_come_back_the_other_way_about() {
        let (mut drawn, mut rungs) = ((1.0, true), Vec::new());
        for ms_at_full in [800.0, 2.0] {
            for _ in 0..12 {
                let next = next_scale(cost_ms(ms_at_full, 0.2, drawn), 33.0, drawn);
                if next != drawn {
                    rungs.push(next);
                }
                drawn = next;
            }
        }
        let (down, up) = rungs.split_at(2);
        assert_eq!(down, [(0.375, false), (0.25, false)]);
        assert_eq!(up, [(0.375, false), (0.375, true), (0.5, true), (0.625, true), (0.75, true), (0.875, true), (1.0, true)]);
    }

    #[test]
    fn no_number_leaves_the_bounds() {
        for frame in [f32::NAN, f32::INFINITY, -1.0, 0.0, 1e30] {
            for budget in [f32::NAN, 0.0, -5.0, 33.0] {
                for (scale, shadows) in
                    [f32::NAN, -3.0, 0.0, 0.4, 9.0].into_iter().flat_map(|scale| [(scale, true), (scale, false)])
                {
                    let (next, _) = next_scale(frame, budget, (scale, shadows));
                    assert!((MIN_SCALE..=1.0).contains(&next), "{frame} {budget} {scale}");
                }
            }
        }
    }
}
