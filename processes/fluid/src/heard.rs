//! What is heard of the hand: the newest sample of the hardware that counts, by the rule of `device` ([`Admission`]); for one that does not, the one before
//! stays. Of a tip of which nobody has heard for a while nobody knows how fast it goes: its scope stands still, and the valves stay as they were. On a virtual
//! clock each sample is as it was computed or recorded.

use hyst_exchange::ReadPage;
use hyst_messages::page::hardware;
use hyst_messages::{Admission, DeviceStatement, HardwareSample};

/// Older than so much is a sample of which nothing further was heard, ns: as old as `device` lets it become.
const MOST_OLD_NS: u64 = 10_000_000;

/// The hardware as the fluid hears it.
pub struct Heard {
    page: Option<ReadPage>,
    trusts: bool,
    stated: Option<DeviceStatement>,
    /// Number of the newest sample that was looked at.
    number: u64,
    /// The newest that counted, of this life of the hardware or of one before.
    sample: Option<HardwareSample>,
    /// By which those of this life count.
    admission: Admission,
    is_kept: bool,
    refused: u64,
}

impl Heard {
    /// Nothing yet; on a virtual clock it `trusts` what it hears.
    pub fn new(trusts: bool) -> Heard {
        let (page, stated, sample, admission) = (None, None, None, Admission::default());
        Heard { page, trusts, stated, number: 0, sample, admission, is_kept: false, refused: 0 }
    }

    /// Another life of the hardware: gives back the page of the one before. Its samples count when it has stated what it is.
    pub fn replace(&mut self, page: ReadPage) -> Option<ReadPage> {
        let next = Heard { page: Some(page), sample: self.sample, refused: self.refused, ..Heard::new(self.trusts) };
        std::mem::replace(self, next).page
    }

    /// Whether there is somebody to hear.
    pub fn is_connected(&self) -> bool {
        self.page.is_some()
    }

    /// Tick of the newest sample, whether it counts or not.
    pub fn newest_tick(&self) -> Option<u64> {
        let newest = self.page.as_ref().and_then(|page| page.cell(hardware::SAMPLE));
        newest.map(|(_, sample)| sample.hardware_tick)
    }

    /// The sample that counts, at a time of CLOCK_MONOTONIC.
    pub fn look(&mut self, now_ns: u64) -> Option<HardwareSample> {
        let page = self.page.as_ref()?;
        let newest = page.cell(hardware::SAMPLE);
        if self.trusts {
            return newest.map(|(_, sample)| sample);
        }
        if self.stated.is_none() {
            let stated = page.cell(hardware::STATEMENT).map(|(_, stated)| stated);
            self.stated = stated.filter(|stated| stated.check().is_ok());
        }
        let newest = newest.filter(|(number, _)| *number != self.number);
        if let (Some(stated), Some((number, sample))) = (self.stated, newest) {
            self.number = number;
            self.is_kept = !self.admission.admit(&stated, &sample);
            self.refused += u64::from(self.is_kept);
            self.sample = if self.is_kept { self.sample } else { Some(sample) };
        }
        let sample = self.sample?;
        let is_old = now_ns.saturating_sub(sample.time_ns) > MOST_OLD_NS;
        Some(if is_old { HardwareSample { velocity_m_s: [0.0; 3], ..sample } } else { sample })
    }

    /// Whether the newest sample was refused, and one of before stands for it.
    pub fn is_kept(&self) -> bool {
        self.is_kept
    }

    /// How many samples were refused since this was asked last.
    pub fn take_refused(&mut self) -> u64 {
        std::mem::take(&mut self.refused)
    }
}

#[cfg(test)]
#[path = "../../../shared/messages/tests/support/stated.rs"]
pub(crate) mod stated;

#[cfg(test)]
mod tests {
    use super::stated::stated;
    use super::*;
    use hyst_exchange::{OwnedPage, Station};
    use hyst_messages::{Pose, Role, Slot, TICK_NS};

    /// So deep, and on its way in.
    fn at(tick: u64, insertion_m: f32) -> HardwareSample {
        let pose =
            Pose { position_m: [0.0, 0.0, insertion_m], orientation: [0.0, 0.0, 0.0, 1.0], insertion_m, ..Pose::default() };
        let velocity_m_s = [0.0, 0.0, 0.01];
        HardwareSample { hardware_tick: tick, time_ns: tick * TICK_NS, pose, velocity_m_s, ..HardwareSample::default() }
    }

    fn with_a_page(name: &str, trusts: bool, body: impl FnOnce(&OwnedPage, Heard)) {
        let station = Station::named(&format!("t{}-heard-{name}", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        let slot = Slot::first(Role::Hardware);
        let page = station.create_slot(slot, 3).unwrap();
        let mut heard = Heard::new(trusts);
        assert!(heard.replace(station.read_slot(slot, 3).unwrap()).is_none());
        body(&page, heard);
        station.wipe();
    }

    #[test]
    fn a_sample_that_the_device_refuses_is_refused_here_too_and_the_one_before_stays() {
        with_a_page("refuses", false, |page, mut heard| {
            let ns = |tick: u64| tick * TICK_NS;
            page.write(hardware::SAMPLE, &at(1, 0.05));
            assert_eq!(heard.look(ns(1)), None, "it has not said what it is");
            page.write(hardware::STATEMENT, &stated());
            assert_eq!(heard.look(ns(1)), Some(at(1, 0.05)));
            let bad: [fn(&mut HardwareSample); 4] = [
                |sample| sample.pose.position_m[1] = f32::NAN,
                |sample| sample.controls.set_pressure_pa = 1e6,
                |sample| sample.controls.outflow_valve = 7.0,
                |sample| sample.pose.position_m[2] += 0.4,
            ];
            for (tick, change) in (2..).zip(bad) {
                let mut sample = at(tick, 0.05);
                change(&mut sample);
                page.write(hardware::SAMPLE, &sample);
                assert_eq!((heard.look(ns(tick)), heard.is_kept()), (Some(at(1, 0.05)), true), "{sample:?}");
                assert_eq!(heard.look(ns(tick)), Some(at(1, 0.05)), "looked at again");
            }
            assert_eq!((heard.take_refused(), heard.take_refused()), (4, 0), "each once");
            // Nobody knows how fast the tip goes of which nothing that counts was heard for long.
            let still = HardwareSample { velocity_m_s: [0.0; 3], ..at(1, 0.05) };
            assert_eq!(heard.look(ns(12)), Some(still));
            page.write(hardware::SAMPLE, &at(13, 0.051));
            assert_eq!((heard.look(ns(13)), heard.is_kept()), (Some(at(13, 0.051)), false));
        });
    }

    #[test]
    fn on_a_virtual_clock_each_sample_counts() {
        with_a_page("virtual", true, |page, mut heard| {
            assert_eq!((heard.look(1 << 60), heard.newest_tick()), (None, None));
            for (tick, insertion_m) in [(1, 0.02), (2, 0.09), (3, 7.0)] {
                page.write(hardware::SAMPLE, &at(tick, insertion_m));
                assert_eq!((heard.look(1 << 60), heard.newest_tick()), (Some(at(tick, insertion_m)), Some(tick)));
            }
            assert_eq!((heard.take_refused(), heard.is_kept()), (0, false));
        });
    }
}
