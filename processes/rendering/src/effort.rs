//! How often and how finely pictures are drawn: what the machine manages, and no more than leaves the other engines their time.
//!
//! Promise: a pure function; rate and scale stay within their bounds for every input, also for a time that is not a number. Pictures come 30 times a
//! second at least as far as the focus and then the resolution and the shadows can give way, and more often only with all of them; of a rate or a focus that
//! did not last, and of their successors, it takes ever longer until one is tried again.
use crate::quality::{SHADED_SCALE, next_scale};

/// Ticks between two pictures at the lowest rate: 30 in a second, the rate of the paper's display.
pub const SLOWEST_TICKS: u64 = 33;
/// The same at the highest rate: 250 in a second, as often as the quickest displays show one.
pub const FASTEST_TICKS: u64 = 4;
/// The rates between which it goes, ticks.
const LADDER_TICKS: [u64; 4] = [SLOWEST_TICKS, 16, 8, FASTEST_TICKS];
/// Share of the period that a picture may take, 26 of 33 ms: what is left belongs to the engines on the same cores.
const SHARE: f32 = 26.0 / 33.0;
/// Share of its other time that a picture takes longer with what is out of focus blurred, at most as seen on lavapipe at 640×480.
const FOCUS: f32 = 0.25;
/// A higher rate, or the focus, is tried if a picture takes less than this share of what it may take there ...
const ROOM: f32 = 0.75;
/// ... each time for so long at first, ticks. After each rate that did not last it is twice as long, up to the second figure.
const PATIENCE_TICKS: [u64; 2] = [500, 16_000];
/// With fewer cores the hand's own threads are on those that pictures are drawn from, and there are 30 in a second unless more are asked for.
const LEAST_CORES: usize = 4;
/// Where no display says how many pictures it shows in a second.
const USUAL_HZ: f32 = 240.0;

/// The least ticks between two pictures: as the settings ask, or as the machine is. Pictures that the processor draws take time of the engines', so more
/// than 30 in a second come by themselves from a GPU alone, and no more than the display shows.
pub fn fastest_ticks(asked_hz: Option<u32>, is_software: bool, cores: usize, refresh_hz: Option<f32>) -> u64 {
    let hz = match asked_hz {
        Some(hz) => hz as f32,
        None if is_software || cores < LEAST_CORES => return SLOWEST_TICKS,
        None => refresh_hz.filter(|hz| hz.is_finite() && *hz > 0.0).unwrap_or(USUAL_HZ),
    };
    ((1.0e3 / hz) as u64).clamp(FASTEST_TICKS, SLOWEST_TICKS)
}

/// The least ticks between two pictures that wait for a display of this rate, if `fastest_ticks` is that rate, cut off to whole ticks, or less. There are no
/// more of them than the display shows: one that waited in vain for its turn would be taken for slow.
pub fn in_step(fastest_ticks: u64, refresh_hz: Option<f32>) -> Option<u64> {
    let period_ms = 1.0e3 / refresh_hz.filter(|hz| hz.is_finite() && *hz > 0.0)?;
    let ticks = fastest_ticks.max(period_ms.ceil() as u64);
    (fastest_ticks as f32 > period_ms - 1.0 && ticks <= SLOWEST_TICKS).then_some(ticks)
}

/// What the next picture is drawn with.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Effort {
    /// ticks between two pictures, in `FASTEST_TICKS..=SLOWEST_TICKS`
    pub period_ticks: u64,
    /// inner resolution as a share of the shown one, per axis, in `MIN_SCALE..=1`
    pub scale: f32,
    /// what is out of focus is blurred
    pub focus: bool,
    /// what the lamp at the tip does not reach is dark
    pub shadows: bool,
    /// for how long there has been room for the focus, or with it for a higher rate
    roomy_ticks: u64,
    /// for how long there must be
    patience_ticks: u64,
    /// what the picture before took to draw, ms
    last_ms: f32,
}

impl Default for Effort {
    fn default() -> Self {
        Self {
            period_ticks: SLOWEST_TICKS,
            scale: 1.0,
            focus: true,
            shadows: true,
            roomy_ticks: 0,
            patience_ticks: PATIENCE_TICKS[0],
            last_ms: 0.0,
        }
    }
}

impl Effort {
    /// The effort of the first picture. Where the processor draws it is a small one without the focus: whoever looks waits for any picture, and five pictures
    /// later it has grown to what the machine manages; a large one would first take as long as ten small ones.
    pub fn at_start(is_software: bool) -> Effort {
        if is_software { Effort { scale: SHADED_SCALE, focus: false, ..Effort::default() } } else { Effort::default() }
    }

    /// All that there is, at such a rate: where pictures give way for nothing.
    pub fn whole(fastest_ticks: u64) -> Effort {
        Effort { period_ticks: fastest_ticks.clamp(FASTEST_TICKS, SLOWEST_TICKS), ..Effort::default() }
    }

    /// The effort after a picture that took `frame_ms` to draw, and `step_ms` from the loop's wake-up until it was shown.
    ///
    /// What is too slow gives way at once, in rate first, at the lowest rate in focus, then in resolution, at the end of which the shadows go. What is quick
    /// comes back the other way about.
    /// At the lowest rate a single slow picture costs nothing: a stall of the machine says nothing of the next one, and the loop makes up for it.
    pub fn next(self, frame_ms: f32, step_ms: f32, fastest_ticks: u64) -> Effort {
        let lasting_ms = frame_ms.min(self.last_ms);
        let effort = Effort { last_ms: frame_ms, ..self };
        let fastest = fastest_ticks.clamp(FASTEST_TICKS, SLOWEST_TICKS);
        let period = self.period_ticks.clamp(fastest, SLOWEST_TICKS);
        let fits = |ticks: u64, share: f32| step_ms >= 0.0 && step_ms <= share * budget_ms(ticks);
        if period < SLOWEST_TICKS && !fits(period, 1.0) {
            let mut slower = LADDER_TICKS.into_iter().rev().filter(|ticks| *ticks > period);
            let period_ticks = slower.find(|ticks| fits(*ticks, 1.0)).unwrap_or(SLOWEST_TICKS);
            let patience_ticks = (2 * self.patience_ticks).min(PATIENCE_TICKS[1]);
            return Effort { period_ticks, patience_ticks, roomy_ticks: 0, last_ms: 0.0, ..self };
        }
        if period == SLOWEST_TICKS && self.focus && lasting_ms > budget_ms(period) {
            let patience_ticks = (2 * self.patience_ticks).min(PATIENCE_TICKS[1]);
            return Effort { period_ticks: period, focus: false, patience_ticks, roomy_ticks: 0, last_ms: 0.0, ..self };
        }
        let drawn = (self.scale, self.shadows);
        let (scale, shadows) = if period == SLOWEST_TICKS { next_scale(lasting_ms, budget_ms(period), drawn) } else { drawn };
        let faster = LADDER_TICKS.into_iter().find(|ticks| *ticks < period).unwrap_or(period).max(fastest);
        let has_room = match self.focus {
            true => faster < period && fits(faster, ROOM),
            false => frame_ms >= 0.0 && (1.0 + FOCUS) * frame_ms <= ROOM * budget_ms(period),
        };
        let has_room = has_room && scale >= 1.0;
        let roomy_ticks = if has_room { self.roomy_ticks + period } else { 0 };
        let effort = Effort { period_ticks: period, scale, shadows, roomy_ticks: 0, ..effort };
        match roomy_ticks >= self.patience_ticks {
            true if self.focus => Effort { period_ticks: faster, ..effort },
            true => Effort { focus: true, ..effort },
            false => Effort { roomy_ticks, ..effort },
        }
    }
}

/// Time that a picture may take, ms.
fn budget_ms(period_ticks: u64) -> f32 {
    SHARE * period_ticks as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quality::MIN_SCALE;

    /// Draws for so long, ticks, on a machine whose picture costs `ms(tick)` at scale 1 with the focus, and `REST_MS` beside it; gives the ticks of all changes of the rate.
    fn drawn(effort: &mut Effort, fastest: u64, for_ticks: u64, ms: impl Fn(u64) -> f32) -> Vec<u64> {
        const REST_MS: f32 = 0.2;
        let (mut tick, mut changes) = (0, Vec::new());
        while tick < for_ticks {
            let focus = if effort.focus { 1.0 } else { 1.0 / (1.0 + FOCUS) };
            let frame_ms = ms(tick) * effort.scale * effort.scale * focus;
            let next = effort.next(frame_ms, frame_ms + REST_MS, fastest);
            if next.period_ticks != effort.period_ticks {
                changes.push(tick);
            }
            *effort = next;
            tick += effort.period_ticks;
        }
        changes
    }

    #[test]
    fn software_small_machines_and_slow_displays_stay_at_thirty_and_a_gpu_follows_its_display() {
        assert_eq!(fastest_ticks(None, true, 64, Some(144.0)), SLOWEST_TICKS);
        assert_eq!(fastest_ticks(None, false, 2, Some(144.0)), SLOWEST_TICKS, "the hand's threads are on both cores");
        for (refresh_hz, ticks) in
            [(24.0, 33), (30.0, 33), (59.94, 16), (75.0, 13), (120.0, 8), (144.0, 6), (240.0, 4), (500.0, 4)]
        {
            assert_eq!(fastest_ticks(None, false, 16, Some(refresh_hz)), ticks, "{refresh_hz}");
        }
        for none in [None, Some(0.0), Some(-60.0), Some(f32::NAN), Some(f32::INFINITY)] {
            assert_eq!(fastest_ticks(None, false, 16, none), FASTEST_TICKS, "headless: {none:?}");
        }
        for (asked_hz, ticks) in [(0, 33), (30, 33), (60, 16), (120, 8), (240, 4), (u32::MAX, 4)] {
            assert_eq!(fastest_ticks(Some(asked_hz), true, 1, Some(60.0)), ticks, "asked for {asked_hz}");
        }
    }

    #[test]
    fn pictures_that_wait_for_the_display_are_no_more_than_it_shows_and_none_wait_for_a_slower_one() {
        for (refresh_hz, fastest, ticks) in
            [(60.0, 16, 17), (59.94, 16, 17), (144.0, 6, 7), (250.0, 4, 4), (500.0, 4, 4), (60.0, 33, 33), (75.0, 16, 16)]
        {
            assert_eq!(in_step(fastest, Some(refresh_hz)), Some(ticks), "{refresh_hz}");
        }
        for (refresh_hz, fastest) in [(60.0, 4), (60.0, 8), (24.0, 33), (0.0, 4), (-60.0, 4), (f32::NAN, 4)] {
            assert_eq!(in_step(fastest, Some(refresh_hz)), None, "{refresh_hz}");
        }
        assert_eq!(in_step(FASTEST_TICKS, None), None);
    }

    #[test]
    fn the_rate_is_the_highest_that_the_machine_manages_and_no_higher_than_wanted() {
        for (ms, fastest, ticks) in
            [(1.0, 4, 4), (2.0, 4, 4), (2.8, 4, 8), (4.0, 4, 8), (5.0, 4, 16), (20.0, 4, 33), (1.0, 13, 13), (1.0, 33, 33)]
        {
            let mut effort = Effort::default();
            let changes = drawn(&mut effort, fastest, 60_000, |_| ms);
            assert_eq!((effort.period_ticks, effort.scale), (ticks, 1.0), "{ms} ms");
            assert!(changes.len() <= 3 && changes.iter().all(|tick| *tick < 3_000), "{ms} ms: {changes:?}");
        }
    }

    #[test]
    fn a_picture_that_is_too_slow_costs_the_rate_first_and_at_the_lowest_rate_the_resolution() {
        let quick = Effort { period_ticks: FASTEST_TICKS, ..Effort::default() };
        let slower = quick.next(5.0, 5.5, FASTEST_TICKS);
        assert_eq!((slower.period_ticks, slower.scale), (8, 1.0), "as far as needed: 5.5 ms fit into 0.79 of 8");
        assert_eq!(quick.next(5.0, 12.0, FASTEST_TICKS).period_ticks, 16, "what is beside the drawing counts");
        let slowest = quick.next(50.0, 50.0, FASTEST_TICKS);
        assert_eq!((slowest.period_ticks, slowest.scale, slowest.focus), (SLOWEST_TICKS, 1.0, true));
        let stalled = slowest.next(50.0, 50.0, FASTEST_TICKS);
        assert_eq!((stalled.scale, stalled.focus), (1.0, true), "one may be a stall");
        let sharp = stalled.next(50.0, 50.0, FASTEST_TICKS);
        assert_eq!((sharp.scale, sharp.focus), (1.0, false), "what is out of focus is the first that is given up");
        let still_slow = sharp.next(50.0, 50.0, FASTEST_TICKS);
        assert_eq!(still_slow.scale, 1.0, "of what is drawn otherwise one alone says nothing either");
        assert!(still_slow.next(50.0, 50.0, FASTEST_TICKS).scale < 1.0);
        let mut coarse = Effort { scale: 0.5, ..Effort::default() };
        assert!(drawn(&mut coarse, FASTEST_TICKS, 400, |_| 0.5).is_empty(), "first it becomes fine again");
        assert_eq!(coarse.scale, 1.0);
    }

    #[test]
    fn at_thirty_pictures_the_scale_alone_decides_as_it_does_without_a_rate() {
        let (mut effort, mut drawn, mut last_ms) = (Effort { focus: false, ..Effort::default() }, (1.0, true), 0.0_f32);
        let mut least = 1.0_f32;
        for picture in 0..2_000_u32 {
            let ms: f32 = 200.0 * drawn.0 * drawn.0 * (0.09 + (picture / 100 % 3) as f32);
            drawn = next_scale(ms.min(last_ms), budget_ms(SLOWEST_TICKS), drawn);
            (last_ms, least) = (ms, least.min(drawn.0));
            effort = effort.next(ms, 1.3 * ms, SLOWEST_TICKS);
            assert_eq!(
                (effort.period_ticks, effort.scale, effort.shadows),
                (SLOWEST_TICKS, drawn.0, drawn.1),
                "picture {picture}"
            );
        }
        assert_eq!(least, MIN_SCALE, "it has been everywhere");
    }

    #[test]
    fn the_focus_comes_back_where_there_is_time_for_it_and_only_there() {
        for (ms, is_back) in [(19.0, true), (25.0, false), (40.0, false)] {
            let mut effort = Effort { focus: false, ..Effort::default() };
            drawn(&mut effort, SLOWEST_TICKS, 60_000, |_| ms);
            assert_eq!(effort.focus, is_back, "{ms} ms");
        }
        // A picture in forty comes late: the focus does not go and come with it.
        let (mut effort, mut changes) = (Effort::default(), 0);
        for picture in 0..10_000_u32 {
            let before = effort.focus;
            let ms = if picture % 40 == 0 { 35.0 } else { 10.0 };
            effort = effort.next(ms, ms, SLOWEST_TICKS);
            changes += usize::from(effort.focus != before);
        }
        assert_eq!(changes, 0, "in five minutes");
    }

    #[test]
    fn a_machine_that_cannot_hold_a_rate_is_tried_ever_more_seldom() {
        // For 20 ms in every 700 it is slow: there is always time to try a higher rate, and never time to keep it.
        let slow_at_times = |tick: u64| if tick % 700 < 20 { 14.0 } else { 1.0 };
        let mut effort = Effort::default();
        let changes = drawn(&mut effort, FASTEST_TICKS, 600_000, slow_at_times);
        let late = changes.iter().filter(|tick| **tick > 300_000).count();
        assert!(changes.len() > 4, "it is tried: {changes:?}");
        assert!(late <= 2 * 3 * 300_000 / 16_000, "{late} changes in the last five minutes");
    }

    #[test]
    fn no_number_leaves_the_bounds() {
        let odd = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -1.0, 0.0, 1.0e30, 3.0];
        for period_ticks in [0, 1, 4, 5, 33, u64::MAX] {
            for fastest in [0, 4, 10, 33, u64::MAX] {
                for (frame_ms, step_ms) in odd.iter().flat_map(|a| odd.map(|b| (*a, b))) {
                    let next = Effort { period_ticks, ..Effort::default() }.next(frame_ms, step_ms, fastest);
                    assert!((FASTEST_TICKS..=SLOWEST_TICKS).contains(&next.period_ticks), "{next:?}");
                    assert!((MIN_SCALE..=1.0).contains(&next.scale), "{next:?}");
                }
            }
        }
    }
}
