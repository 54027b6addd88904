//! What the swaps of a test cost the hand, by role. A few are judged by their mean, beside controls of 1.5 s. Of many each has a control that is as long, and
//! they are judged as the faults of a campaign are.

use hystation::campaign::judge::Verdict;
use station_tests::Station;
use station_tests::paired::{how_many, judge, now, origin, tally};
use station_tests::windows::Pairs;
use std::collections::BTreeMap;

/// Ticks of the control window of each of a few.
const CONTROL_TICKS: u64 = 1_500;
/// Swaps that must count.
pub const LEAST: usize = 3;
/// Ticks that each of a few may cost, beyond what so long a control loses: none, as far as they tell.
const ALLOWED_EACH: f64 = 0.05;

/// The windows of a test's swaps.
pub struct Costs {
    what: &'static str,
    /// Ticks that one of the device may cost, for it has no spare, and the hand waits for it.
    device_ticks: f64,
    are_many: bool,
    of_role: BTreeMap<&'static str, Pairs>,
}

impl Costs {
    /// None yet. What is said of many begins with where they are made, and how many it takes.
    pub fn new(what: &'static str, device_ticks: f64, are_many: bool, station: &Station) -> Costs {
        if are_many {
            println!("{what}: {}, from {}; {}", origin(station), now(), how_many());
        }
        Costs { what, device_ticks, are_many, of_role: BTreeMap::new() }
    }

    /// Ticks that a swap of a role may cost.
    fn allowed(&self, role: &str) -> f64 {
        if role == "device" { self.device_ticks } else { 0.0 }
    }

    /// A swap of a role. One of many is told at once, so that a run that is cut off has said what it knows.
    pub fn around<T>(&mut self, role: &'static str, station: &Station, done: impl FnOnce() -> T) -> T {
        let allowed = self.allowed(role);
        let pairs = self.of_role.entry(role).or_default();
        if !self.are_many {
            return pairs.around(station, CONTROL_TICKS, done);
        }
        let result = pairs.beside(station, done);
        println!("{role}: {}", tally(pairs.as_long(), allowed as u64));
        result
    }

    /// Fails if they cost the hand something: those of the device by themselves, those of all others together, and of many each role's.
    pub fn judge(mut self, station: &Station) {
        let broken = if self.are_many { self.judge_many() } else { Vec::new() };
        let device = self.of_role.remove("device");
        let mut all = Pairs::default();
        self.of_role.values().for_each(|pairs| all.add(pairs));
        if let Some(mut device) = device {
            device.heed_controls_of(&all);
            device.judge_each(&format!("{} of the device", self.what), self.device_ticks, LEAST, station);
        }
        if !self.of_role.is_empty() {
            all.judge(self.what, LEAST, station);
        }
        let name = |role: &str| format!("{} of {role}", self.what);
        match self.are_many {
            true => self.of_role.iter().for_each(|(role, pairs)| pairs.assert_each(&name(role), 0.0, station)),
            false => all.judge_each(self.what, ALLOWED_EACH, LEAST, station),
        }
        assert!(broken.is_empty(), "{broken:?} cost the hand more than their controls\n{}", station.said());
    }

    /// Judges each role's, and all together but the device's; gives the names of those that cost something beyond doubt.
    fn judge_many(&self) -> Vec<String> {
        let mut all = Pairs::default();
        let others = self.of_role.iter().filter(|(role, _)| **role != "device");
        others.for_each(|(_, pairs)| all.add(pairs));
        let each = self.of_role.iter().map(|(role, pairs)| (format!("{} of {role}", self.what), pairs, self.allowed(role)));
        let together = (format!("{} of all but the device", self.what), &all, 0.0);
        let mut broken = Vec::new();
        for (name, pairs, allowed) in each.chain([together]) {
            if judge(&name, pairs.as_long(), allowed as u64) == Verdict::Broken {
                broken.push(name);
            }
        }
        println!("{}: until {}", self.what, now());
        broken
    }
}
