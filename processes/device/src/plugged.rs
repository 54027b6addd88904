//! What is plugged in: the hardware's page, what it states of itself, and its newest sample that counts ([`Admission`]). When none has come that does for
//! [`MOST_OLD_TICKS`], nobody knows where the tip is, and the force is let go: held for 2 ticks, then ramped to zero. Once the hardware is
//! known to be dead none is commanded at all: the motors of its next life would jump to it. From what that one's first sample says the force returns ([`Plug`]).

use hyst_coupling::ServoParams;
use hyst_engine::{Failure, Life};
use hyst_exchange::{ReadPage, system};
use hyst_messages::page::device::Distrust;
use hyst_messages::page::hardware;
use hyst_messages::{Admission, DeviceLimits, DeviceStatement, HardwareSample, Role, TICK_NS};

/// Ticks without a new sample that counts, after which the force is let go. A device on USB is late by some ticks now and then.
const MOST_OLD_TICKS: u32 = 10;
/// The same of hardware that is said to be dead: one that speaks on is not.
const MOST_DEAD_TICKS: u32 = 1;
/// How long a device that was started waits for what the hardware states, ns: as long as a start may take.
const PATIENCE_NS: u64 = 25_000_000_000;
/// Between two looks for it, ns.
const LOOK_NS: u64 = 100_000;

/// Whether the hardware is there in a tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Plug {
    /// As it was.
    #[default]
    Stays,
    /// It has died, and of another life no sample has counted yet.
    Out,
    /// It is there again, with the sample of this tick: what its motors make, N.
    In([f32; 3]),
}

/// The hardware as the device sees it.
pub struct Plugged {
    page: ReadPage,
    stated: DeviceStatement,
    /// On a virtual clock samples come as they were recorded or are computed, each in its tick.
    trusts: bool,
    /// Number of the newest sample that was looked at.
    number: u64,
    /// The newest that counted, of this life of the hardware or of one before.
    sample: HardwareSample,
    /// By which those of this life count.
    admission: Admission,
    old_ticks: u32,
    plug: Plug,
}

impl Plugged {
    /// Waits until the hardware has said what it is, and checks that.
    pub fn wait(life: &Life, page: ReadPage) -> Result<Plugged, Failure> {
        let deadline_ns = system::now_ns() + PATIENCE_NS;
        while page.cell(hardware::STATEMENT).is_none() {
            if life.clock.stop_requested() || !life.is_alive(Role::Hardware, page.incarnation()) {
                return Err(Failure::Broken("the hardware has gone before it said what it is".into()));
            }
            if system::now_ns() > deadline_ns {
                let within_s = PATIENCE_NS / 1_000_000_000;
                return Err(Failure::Input(format!("the driver has not stated what its device is within {within_s} s")));
            }
            life.heartbeat();
            system::sleep_ns(LOOK_NS);
        }
        let mut plugged = Plugged::new(page, life.is_lockstep());
        plugged.hear()?;
        Ok(plugged)
    }

    fn new(page: ReadPage, trusts: bool) -> Plugged {
        let (stated, sample, admission) = (DeviceStatement::default(), HardwareSample::default(), Admission::default());
        Plugged { page, stated, trusts, number: 0, sample, admission, old_ticks: 0, plug: Plug::Stays }
    }

    /// Another life of the hardware: gives back the page of the one before. What it says counts when it has stated what it is.
    pub fn replace(&mut self, page: ReadPage) -> ReadPage {
        let next = Plugged { sample: self.sample, plug: Plug::Out, ..Plugged::new(page, self.trusts) };
        std::mem::replace(self, next).page
    }

    /// Whether the hardware is there in this tick.
    pub fn plug(&self) -> Plug {
        self.plug
    }

    /// Whether the motors have made a force in this life of theirs.
    pub fn has_pushed(&self) -> bool {
        let largest_step = hardware::TOTALS + hardware::Total::ForceStepMax as usize;
        f64::from_bits(self.page.load64(largest_step)) > 0.0
    }

    /// Reads the statement, if it was not read yet. One that is wrong is refused; a successor of this process meets it when it starts.
    fn hear(&mut self) -> Result<bool, Failure> {
        if self.stated.version == 0 {
            let Some((_, stated)) = self.page.cell(hardware::STATEMENT) else { return Ok(false) };
            stated.check().map_err(|why| Failure::Input(format!("what the driver states cannot be used: {why}")))?;
            self.stated = stated;
        }
        Ok(true)
    }

    /// The page.
    pub fn page(&self) -> &ReadPage {
        &self.page
    }

    /// What may be asked of the hardware at most; nothing is stated before it was heard.
    pub fn limits(&self) -> DeviceLimits {
        carried(&self.stated)
    }

    /// The sample of this tick. Once a tick.
    pub fn look(&mut self, life: &Life) -> Result<HardwareSample, Failure> {
        self.old_ticks = self.old_ticks.saturating_add(1);
        let is_gone = self.old_ticks > MOST_DEAD_TICKS && !life.is_alive(Role::Hardware, self.page.incarnation());
        self.plug = if is_gone || self.plug == Plug::Out { Plug::Out } else { Plug::Stays };
        if !self.hear()? || self.page.cell_number(hardware::SAMPLE) == self.number {
            return Ok(self.sample);
        }
        if let Some((number, sample)) = self.page.cell(hardware::SAMPLE) {
            self.number = number;
            if let Err(why) = self.take(sample) {
                life.refuse(self.page.incarnation(), why);
            }
        }
        Ok(self.sample)
    }

    /// Whether nobody knows where the tip is.
    pub fn is_silent(&self) -> bool {
        !self.trusts && (self.old_ticks > MOST_OLD_TICKS || self.plug == Plug::Out)
    }

    fn take(&mut self, sample: HardwareSample) -> Result<(), Distrust> {
        if !self.trusts && !self.admission.admit(&self.stated, &sample) {
            return Err(Distrust::Invalid);
        }
        (self.sample, self.old_ticks) = (sample, 0);
        if self.plug == Plug::Out {
            self.plug = Plug::In(sample.force_n);
        }
        Ok(())
    }
}

/// What a device can do, as far as the damping that it states carries it: the coupling is passive up to a stiffness that grows with that. Told as a smaller limit,
/// so that the servos, and a replay, need to know no more than limits.
fn carried(stated: &DeviceStatement) -> DeviceLimits {
    let limits = stated.limits;
    let is_known = stated.device_damping_n_s_m > 0.0;
    if !is_known {
        return limits;
    }
    let params = ServoParams::default().relying_on(stated.device_damping_n_s_m);
    let params = params.for_device(limits.max_force_n, limits.max_stiffness_n_m, limits.max_damping_n_s_m);
    DeviceLimits {
        max_force_n: limits.max_force_n,
        max_stiffness_n_m: limits.max_stiffness_n_m.min(params.coupling_limit_n_m(TICK_NS as f32 * 1e-9)),
        max_damping_n_s_m: limits.max_damping_n_s_m.min(params.max_damping_n_s_m),
    }
}

#[cfg(test)]
#[path = "../../../shared/messages/tests/support/stated.rs"]
mod stated;

#[cfg(test)]
mod tests {
    use super::stated::stated;
    use super::*;
    use hyst_exchange::{OwnedPage, Station};
    use hyst_messages::page::station as layout;
    use hyst_messages::{Pose, Slot};

    /// At rest, so deep.
    fn at(tick: u64, insertion_m: f32) -> HardwareSample {
        let pose =
            Pose { position_m: [0.0, 0.0, insertion_m], orientation: [0.0, 0.0, 0.0, 1.0], insertion_m, ..Pose::default() };
        HardwareSample { hardware_tick: tick, time_ns: tick * TICK_NS, pose, ..HardwareSample::default() }
    }

    /// A station in which this process is the device.
    fn begun(name: &str) -> (Station, Life) {
        let station = Station::named(&format!("t{}-{name}", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        std::fs::write(station.settings(), "").unwrap();
        let slot = Slot::first(Role::Device);
        let _own = station.create_slot(slot, 4).unwrap();
        let life = Life::begin(station.name(), slot, 4).unwrap();
        (station, life)
    }

    /// A life of the hardware that has begun.
    fn hardware_of(station: &Station, incarnation: u32) -> (OwnedPage, ReadPage) {
        let (slot, keeper) = (Slot::first(Role::Hardware), station.open_for_keeping().unwrap());
        let own = station.create_slot(slot, incarnation).unwrap();
        keeper.store32(layout::SLOT_DEAD + slot.number(), 0);
        keeper.store32(layout::SLOT_INCARNATION + slot.number(), incarnation);
        (own, station.read_slot(slot, incarnation).unwrap())
    }

    /// The force was commanded on for a tip of which nobody knew, and the motors of a driver that was started again would have jumped to it.
    #[test]
    fn hardware_that_has_died_is_silent_until_a_sample_of_another_life_counts_which_says_what_its_motors_make() {
        let (station, life) = begun("replugged");
        let dead = layout::SLOT_DEAD + Slot::first(Role::Hardware).number();
        let (own, page) = hardware_of(&station, 3);
        let mut plugged = Plugged::new(page, false);
        own.write(hardware::STATEMENT, &stated());
        own.write(hardware::SAMPLE, &at(900, 0.05));
        let look = |plugged: &mut Plugged| (plugged.look(&life).unwrap(), plugged.is_silent(), plugged.plug());
        let there = (at(900, 0.05), false, Plug::Stays);
        assert_eq!([look(&mut plugged), look(&mut plugged), look(&mut plugged)], [there; 3], "a device may be late");
        own.write(hardware::SAMPLE, &at(901, 0.05));
        assert_eq!(look(&mut plugged), (at(901, 0.05), false, Plug::Stays));
        station.open_for_keeping().unwrap().store32(dead, 1);
        own.write(hardware::SAMPLE, &at(902, 0.05));
        let last = (at(902, 0.05), false, Plug::Stays);
        assert_eq!(look(&mut plugged), last, "who speaks is not dead, whatever is said of it");
        let is_pushed_by = |force_n: f64| {
            own.store64(hardware::TOTALS + hardware::Total::ForceStepMax as usize, force_n.to_bits());
            plugged.has_pushed()
        };
        assert_eq!([0.0, 0.3].map(is_pushed_by), [false, true]);
        let gone = (at(902, 0.05), true, Plug::Out);
        assert_eq!([look(&mut plugged), look(&mut plugged), look(&mut plugged)], [last, gone, gone]);

        let (next, page) = hardware_of(&station, 5);
        let _before = plugged.replace(page);
        assert!(look(&mut plugged) == gone && !plugged.has_pushed(), "it has said nothing, and its motors have made nothing");
        next.write(hardware::SAMPLE, &at(1, 0.06));
        assert_eq!(look(&mut plugged), gone, "nor what it is");
        next.write(hardware::STATEMENT, &stated());
        next.write(hardware::SAMPLE, &at(2, f32::NAN));
        assert_eq!(look(&mut plugged), gone, "no place");
        let first = HardwareSample { force_n: [0.0, 0.0, 0.3], ..at(3, 0.06) };
        next.write(hardware::SAMPLE, &first);
        assert_eq!(look(&mut plugged), (first, false, Plug::In([0.0, 0.0, 0.3])));
        assert_eq!(look(&mut plugged), (first, false, Plug::Stays));
        station.wipe();
    }

    #[test]
    fn a_tip_that_jumps_stays_where_it_was_until_the_force_is_gone_and_one_that_is_silent_is_said_to_be() {
        let (station, life) = begun("plugged");
        let (hardware, page) = hardware_of(&station, 3);
        let mut plugged = Plugged::new(page, false);
        hardware.write(hardware::SAMPLE, &at(1, 0.05));
        assert_eq!(plugged.look(&life).unwrap(), HardwareSample::default(), "it has not said what it is");
        hardware.write(hardware::STATEMENT, &stated());
        assert_eq!(plugged.look(&life).unwrap(), at(1, 0.05));
        hardware.write(hardware::SAMPLE, &at(2, f32::NAN));
        assert_eq!((plugged.look(&life).unwrap(), plugged.is_silent()), (at(1, 0.05), false));
        // Back where it was, and then 3 cm from there in a tick: not believed before the force was let go.
        hardware.write(hardware::SAMPLE, &at(3, 0.05));
        assert_eq!(plugged.look(&life).unwrap(), at(3, 0.05));
        let refused: Vec<bool> = (4..=60)
            .map(|tick| {
                hardware.write(hardware::SAMPLE, &at(tick, 0.08));
                let is_refused = plugged.look(&life).unwrap() == at(3, 0.05);
                assert_eq!(is_refused && tick > 3 + u64::from(MOST_OLD_TICKS), plugged.is_silent(), "tick {tick}");
                is_refused
            })
            .collect();
        // Longer than the force needs to be held and ramped, and then believed for good.
        assert!((35..50).contains(&refused.iter().filter(|refused| **refused).count()), "{refused:?}");
        assert!(refused.is_sorted_by(|a, b| a >= b), "{refused:?}");
        for tick in 1..=MOST_OLD_TICKS + 1 {
            plugged.look(&life).unwrap();
            assert_eq!(plugged.is_silent(), tick > MOST_OLD_TICKS, "tick {tick} without a sample");
        }
        station.wipe();
    }

    #[test]
    fn a_device_of_little_damping_is_asked_for_less_stiffness_and_damping_and_one_that_states_none_for_what_it_states() {
        assert_eq!(carried(&stated()), stated().limits);
        assert_eq!(carried(&DeviceStatement::default()), DeviceLimits::default(), "it has not said what it is");
        let with = |device_damping_n_s_m: f32| carried(&DeviceStatement { device_damping_n_s_m, ..stated() });
        let ample = with(13.4);
        assert_eq!((ample.max_stiffness_n_m, ample.max_damping_n_s_m), (1_200.0, 1.0), "as much as the station asks for");
        let little = with(0.6);
        assert_eq!((little.max_force_n, little.max_damping_n_s_m), (3.3, 0.3));
        assert!((little.max_stiffness_n_m - 181.82).abs() < 0.1, "{little:?}"); // (0.6 − 0.3) / 1.65 ms
        // What the servos make of it is no stiffer than what is passive with the true damping.
        let servos = ServoParams::default().for_device(little.max_force_n, little.max_stiffness_n_m, little.max_damping_n_s_m);
        let true_n_m = ServoParams { device_damping_n_s_m: 0.6, ..servos }.coupling_limit_n_m(1e-3);
        assert!((servos.coupling_limit_n_m(1e-3) - true_n_m).abs() < 0.1, "{servos:?}");
        let soft = DeviceStatement { limits: DeviceLimits { max_stiffness_n_m: 90.0, ..stated().limits }, ..stated() };
        assert_eq!(carried(&DeviceStatement { device_damping_n_s_m: 0.6, ..soft }).max_stiffness_n_m, 90.0);
    }

    #[test]
    fn a_statement_that_cannot_be_used_is_refused_with_its_number() {
        let station = Station::named(&format!("t{}-stated", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        let slot = Slot::first(Role::Hardware);
        let hardware = station.create_slot(slot, 3).unwrap();
        let mut bad = stated();
        bad.limits.max_force_n = f32::NAN;
        hardware.write(hardware::STATEMENT, &bad);
        let mut plugged = Plugged::new(station.read_slot(slot, 3).unwrap(), false);
        let said = plugged.hear().unwrap_err();
        assert!(matches!(&said, Failure::Input(text) if text.contains("max_force_n is NaN")), "{said}");
        station.wipe();
    }
}
