//! What a case asks for where the device that is plugged in does not come: whoever sits at it hears so before they look for it in vain.

use super::Supervisor;
use crate::journal;
use hyst_messages::page::hardware;
use hyst_messages::{DeviceStatement, Role, Slot};
use hyst_scene::{Brief, Reach};

impl Supervisor {
    /// Somebody has become ready: what rights he has, and where his device comes to.
    pub(super) fn note_ready(&mut self, slot: Slot) {
        self.note_rights(slot);
        self.note_reach(slot);
    }

    /// Holds what a device states of its workspace against the case once it has become ready, the first time.
    fn note_reach(&mut self, slot: Slot) {
        if slot.role() != Role::Hardware || self.is_reach_known {
            return;
        }
        let stated = self.viewer.slot_page(slot).and_then(|page| page.cell(hardware::STATEMENT));
        let Some((_, stated)) = stated else { return };
        self.is_reach_known = true;
        let brief = std::fs::read_to_string(self.station.brief()).ok().and_then(|text| serde_json::from_str::<Brief>(&text).ok());
        let Some(brief) = brief else { return }; // a scene asks for nothing
        if let Some(text) = short_of(&brief, &stated, self.station.pivot_m()) {
            journal::say(&self.station, &text);
        }
    }
}

/// What is said of a device that does not come to all that a case asks for. Of one whose statement is refused something else is said.
fn short_of(brief: &Brief, stated: &DeviceStatement, pivot_m: [f32; 3]) -> Option<String> {
    stated.check().ok()?;
    let [pitch_rad, yaw_rad, insertion_m] =
        [stated.pitch_rad, stated.yaw_rad, stated.insertion_m].map(|range| range.map(f64::from));
    let beyond = brief.beyond(&Reach { pivot_m: pivot_m.map(f64::from), pitch_rad, yaw_rad, insertion_m });
    let text = || {
        format!(
            "the device, as it states, ends short of what the case asks for: {}; give it another place, or take another device",
            beyond.join(", ")
        )
    };
    (!beyond.is_empty()).then(text)
}
