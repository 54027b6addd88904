//! How finely each picture is drawn, and how often: as the effort says or, where nobody waits for a picture, as finely as can be.

use super::Vision;
use hyst_engine::Pace;
use hyst_engine::settings::Settings;
use hyst_exchange::system;
use rendering::{Effort, FrameStats, SHADED_SCALE};

/// Whether a picture may take its time: on a virtual clock no hand waits for one, and what goes into a folder is looked at later.
fn is_unhurried(settings: &Settings) -> bool {
    settings.lockstep && settings.pictures.is_some()
}

/// The effort of the first picture.
pub(super) fn first(settings: &Settings, is_software: bool, fastest_ticks: u64) -> Effort {
    if is_unhurried(settings) { Effort::whole(fastest_ticks) } else { Effort::at_start(is_software) }
}

/// The effort after a picture that took so long to draw, and to show, ms.
fn after(settings: &Settings, before: Effort, [frame_ms, step_ms]: [f32; 2], fastest_ticks: u64) -> Effort {
    if is_unhurried(settings) { before } else { before.next(frame_ms, step_ms, fastest_ticks) }
}

impl Vision<'_> {
    /// Rate and resolution of the next picture. What goes to the disk or to the operator's page comes seldom, and counts for nothing here.
    pub(super) fn give_way(&mut self, stats: &FrameStats, pace: &mut Pace) {
        let step_ms = system::now_ns().saturating_sub(pace.woken_ns()) as f32 * 1e-6;
        let before = self.effort;
        self.effort = after(&self.life.settings, before, [stats.total_ms, step_ms], self.fastest_ticks);
        if self.effort.period_ticks != before.period_ticks {
            pace.set_period(self.effort.period_ticks);
        }
        self.set_quality();
    }

    /// Draws as the effort says.
    pub(super) fn set_quality(&mut self) {
        let quality = &mut self.view.quality;
        (quality.scale, quality.focus, quality.shadows) = (self.effort.scale, self.effort.focus, self.effort.shadows);
        // The glow goes with the last pixels that can be spared, and comes back with the first.
        quality.bloom = self.effort.scale > SHADED_SCALE;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rendering::SLOWEST_TICKS;

    /// The pictures of the documents were drawn at a share of their size, without focus, and then enlarged.
    #[test]
    fn on_a_virtual_clock_what_goes_into_a_folder_gives_way_for_nothing_and_all_else_does() {
        for (lockstep, pictures, is_whole) in
            [(true, Some("out"), true), (true, None, false), (false, Some("out"), false), (false, None, false)]
        {
            let settings = Settings { lockstep, pictures: pictures.map(Into::into), ..Settings::default() };
            let mut effort = first(&settings, true, SLOWEST_TICKS);
            let is_all = |effort: &Effort| effort.scale == 1.0 && effort.focus && effort.shadows;
            assert_eq!(is_all(&effort), is_whole, "the first: {settings:?}");
            for _ in 0..10 {
                effort = after(&settings, effort, [900.0, 900.0], SLOWEST_TICKS);
            }
            assert_eq!(is_all(&effort), is_whole, "after slow ones: {settings:?}");
            assert_eq!(effort.period_ticks, SLOWEST_TICKS);
        }
    }
}
