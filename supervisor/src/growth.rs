//! Whether a process grows without end, in memory or in open files, as a pure function of its samples: it is replaced in good time, its spare
//! first, before the system kills whatever it likes.
//!
//! A leak crosses one mark after the other; a load that comes once (a mesh, a shader) crosses many at a time and becomes the new base. What comes as
//! a load again and again is a leak too, however fast or in however large pieces.

use hyst_messages::{Role, Slot};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Marks between the base and the bound.
const MARKS: u64 = 8;
/// Samples on which new marks must have been crossed.
const CROSSINGS: u32 = 5;
/// Loads in a life that become the new base; what comes after them crosses marks like anything else.
const MOST_LOADS: u32 = 2;
/// Bounds beyond the first base at which more loads than that are told at once: it would not take [`CROSSINGS`] of them to exhaust the machine.
const MOST_BOUNDS: u64 = 3;
/// Samples after it was ready that do not count: caches fill, locked memory is touched.
const WARM_UP: u32 = 3;
/// Open files beyond the base. An engine has some dozens for each process that it is connected to.
const MOST_FILES: u64 = 256;
/// Mapped memory that is shared, beyond the base, MiB, or so many times what there was at first. Readers map what others write: in a swap, and where one dies after
/// the other, a process has the segments of five tissues for a while, of 160 MiB each in the default scene (776 MiB of a fluid, 719 of a worker were seen).
const MOST_SHARED_MIB: u64 = 1024;
const MOST_SHARED_TIMES: u64 = 4;

/// Between two looks at what the device uses, and a newcomer on trial, ns: four for one at anybody else.
const OFTEN_NS: u64 = 250_000_000;

/// Resident memory of its own beyond the base, MiB: several times what any engine was seen to add in ten minutes after its warm-up. Of a device, which has 8,
/// less: the system takes 0.15 ms for each MiB of a process that ends, and until then nobody has the hand (18 to 34 ticks were lost with 170 MiB, 2-core VM,
/// `leak-memory device`, 2026-11-28).
const fn most_mib(role: Role) -> u64 {
    match role {
        Role::Device => 24,
        Role::Rendering => 512,
        Role::Recorder | Role::Fluid => 256,
        _ => 96,
    }
}

/// What a process uses.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Use {
    /// Resident memory that nobody else has, MiB.
    pub own_mib: u64,
    /// Resident memory that others may have, too, files and what is in `/dev/shm`, MiB.
    pub shared_mib: u64,
    /// Open files.
    pub files: u64,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Rise {
    /// Where the life began, and where marks are counted from.
    first: u64,
    base: u64,
    crossed: u64,
    crossings: u32,
    loads: u32,
    /// Base, marks and crossings before the last load.
    before: (u64, u64, u32),
}

impl Rise {
    /// True once the value has risen beyond the bound, steadily or by one load after the other, and has not been given back.
    fn sample(&mut self, value: u64, bound: u64) -> bool {
        self.give_back(value, bound);
        let marks = value.saturating_sub(self.base) * MARKS / bound;
        let is_load = marks >= self.crossed + MARKS / 2;
        self.loads += u32::from(is_load);
        if is_load && self.loads <= MOST_LOADS {
            *self = Rise { base: value, crossed: 0, crossings: 0, before: (self.base, self.crossed, self.crossings), ..*self };
        } else if marks > self.crossed {
            self.crossed = marks;
            self.crossings += 1;
        }
        let is_fast = self.loads > MOST_LOADS && value.saturating_sub(self.first) > MOST_BOUNDS * bound;
        is_fast || self.crossed >= MARKS && self.crossings >= CROSSINGS
    }

    /// Forgets a load that is gone again: a reader has the segments of one that died beside those of its successor for a moment, each time.
    fn give_back(&mut self, value: u64, bound: u64) {
        if value + bound / 2 <= self.base {
            // At least two, if that is less than there was before the last.
            let ((base, crossed, crossings), loads) = if self.before.0 <= value { (self.before, 1) } else { ((value, 0, 0), 2) };
            *self = Rise { base, crossed, crossings, loads: self.loads.saturating_sub(loads), ..*self };
        }
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Record {
    incarnation: u32,
    samples: u32,
    memory: Rise,
    shared: Rise,
    files: Rise,
    /// Not kept: one who told and died may not have replaced it.
    #[serde(skip)]
    told: bool,
}

/// All processes, by the numbers of their slots. A supervisor that is restarted goes on from what the one before it has seen: a leak that it adopts does
/// not begin anew.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Growth {
    records: BTreeMap<usize, Record>,
    /// When those are looked at next at whom one looks often, ns.
    #[serde(skip)]
    often_ns: u64,
}

impl Growth {
    /// Whether those at whom one looks often are to be looked at again, and then not before [`OFTEN_NS`].
    pub fn is_due_often(&mut self, now_ns: u64) -> bool {
        let is_due = now_ns >= self.often_ns;
        if is_due {
            self.often_ns = now_ns + OFTEN_NS;
        }
        is_due
    }

    /// A sample of a process that is ready; a text the first time that it has grown beyond its bound.
    pub fn sample(&mut self, slot: Slot, incarnation: u32, used: Use) -> Option<String> {
        let record = self.records.entry(slot.number()).or_default();
        if record.incarnation != incarnation {
            *record = Record { incarnation, ..Record::default() };
        }
        record.samples += 1;
        let Record { memory, shared, files, .. } = record;
        if record.samples <= WARM_UP {
            for (rise, value) in [(memory, used.own_mib), (shared, used.shared_mib), (files, used.files)] {
                (rise.first, rise.base) = (value, value);
            }
            return None;
        }
        let most_shared_mib = MOST_SHARED_MIB.max(MOST_SHARED_TIMES * shared.first);
        let rises = [
            (memory, used.own_mib, most_mib(slot.role()), "memory has", " MiB"),
            (shared, used.shared_mib, most_shared_mib, "shared memory has", " MiB"),
            (files, used.files, MOST_FILES, "open files have", ""),
        ];
        let mut text = None;
        for (rise, value, bound, what, unit) in rises {
            if rise.sample(value, bound) {
                text = text.or_else(|| Some(format!("its {what} grown from {} to {value}{unit}", rise.first)));
            }
        }
        text.filter(|_| !std::mem::replace(&mut record.told, true))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told(samples: impl IntoIterator<Item = (u64, u64)>) -> Option<usize> {
        let mut growth = Growth::default();
        let slot = Slot::first(Role::Haptic);
        samples.into_iter().position(|(own_mib, files)| growth.sample(slot, 7, Use { own_mib, shared_mib: 0, files }).is_some())
    }

    #[test]
    fn a_leak_is_told_soon_after_its_bound_and_once() {
        for mib_per_sample in [1, 5, 20] {
            let at = told((0..400).map(|n| (50 + n * mib_per_sample, 30))).unwrap() as u64;
            let grown = (at + 1 - WARM_UP as u64) * mib_per_sample;
            assert!((90..=150).contains(&grown), "{mib_per_sample}: after {grown} MiB");
        }
        assert!(told((0..400).map(|n| (50, 30 + 2 * n))).is_some(), "files");
        let mut growth = Growth::default();
        let slot = Slot::first(Role::Haptic);
        let tellings =
            (0..400).filter(|n| growth.sample(slot, 7, Use { own_mib: 5 * n, shared_mib: 0, files: 0 }).is_some()).count();
        assert_eq!(tellings, 1);
        assert_eq!(
            growth.sample(slot, 8, Use { own_mib: 9_000, shared_mib: 0, files: 0 }),
            None,
            "a successor has a base of its own"
        );
    }

    /// It lost the hand for longer than a death may cost it: with so much memory it took the system 20 ms to end it.
    #[test]
    fn a_device_that_leaks_is_told_before_its_end_takes_long() {
        let grown = |mib_per_sample: u64| {
            let mut growth = Growth::default();
            let mut used = |n: u64| {
                growth.sample(Slot::first(Role::Device), 7, Use { own_mib: 8 + n * mib_per_sample, shared_mib: 0, files: 30 })
            };
            (0..400).find(|n| used(*n).is_some()).unwrap() * mib_per_sample
        };
        // At a mebibyte a second and at `default_rate`, four samples a second, and where each sample looks like a load.
        assert!(grown(1) <= 32 && grown(8) <= 64 && grown(16) <= 112, "{} {} {}", grown(1), grown(8), grown(16));
    }

    /// A trial is over in three seconds, and a look in each tells of a leak in eight: such a newcomer had the role by then.
    #[test]
    fn a_guest_that_leaks_fast_is_told_within_its_trial() {
        let (mut growth, mut told_ns) = (Growth::default(), None);
        for now_ns in (0..5_000_000_000).step_by(5_000_000) {
            // 100 MiB a second.
            let used = Use { own_mib: 60 + now_ns / 10_000_000, shared_mib: 0, files: 30 };
            if growth.is_due_often(now_ns) && growth.sample(Slot::guest(Role::Tissue).unwrap(), 7, used).is_some() {
                told_ns = Some(now_ns);
            }
        }
        assert!(told_ns.is_some_and(|told_ns| told_ns < 2_500_000_000), "{told_ns:?}");
    }

    #[test]
    fn a_leak_is_told_as_soon_by_supervisors_that_die_all_the_time() {
        let slot = Slot::first(Role::Haptic);
        let mut growth = Growth::default();
        let at = (0..400).position(|n| {
            growth = serde_json::from_str(&serde_json::to_string(&growth).unwrap()).unwrap();
            growth.sample(slot, 7, Use { own_mib: 50 + 5 * n, shared_mib: 0, files: 30 }).is_some()
        });
        assert_eq!(at, told((0..400).map(|n| (50 + 5 * n, 30))));
    }

    /// Half a bound in each sample looked like a load that came at once, each time.
    #[test]
    fn a_leak_that_is_so_fast_that_each_sample_looks_like_a_load_is_told() {
        for mib_per_sample in [47, 48, 49, 64, 96, 200, 1_000] {
            let at = told((0..400).map(|n| (50 + n * mib_per_sample, 30))).unwrap() as u64;
            let grown = (at + 1 - WARM_UP as u64) * mib_per_sample;
            let most = (MOST_BOUNDS * 96 + mib_per_sample).max((u64::from(MOST_LOADS) + 1) * mib_per_sample);
            assert!(grown <= most, "{mib_per_sample}: after {grown} MiB");
        }
        for files_per_sample in [127, 128, 200, 300] {
            let at = told((0..400).map(|n| (50, 30 + n * files_per_sample))).unwrap() as u64;
            let opened = (at + 1 - WARM_UP as u64) * files_per_sample;
            assert!(
                opened <= (MOST_BOUNDS * MOST_FILES + files_per_sample).max(3 * files_per_sample),
                "{files_per_sample}: {opened}"
            );
        }
        // In large pieces, each of which stays for a while.
        assert!(told((0..4_000).map(|n| (50 + 60 * (n / 100), 30))).is_some());
        let mut growth = Growth::default();
        let mut text = None;
        for n in 0..40 {
            text = text.or(growth.sample(Slot::first(Role::Haptic), 7, Use { own_mib: 50 + 100 * n, shared_mib: 0, files: 0 }));
        }
        assert!(text.as_ref().is_some_and(|text| text.contains("from 250 to ")), "where it began: {text:?}");
    }

    #[test]
    fn what_comes_at_once_or_goes_up_and_down_is_no_leak() {
        // Two loads, and then what any engine adds.
        assert_eq!(told((0..1_000).map(|n| (50 + 200 * (n / 100).min(2) + n / 20, 30))), None);
        assert_eq!(told((0..1_000).map(|n| (if n < 500 { 50 } else { 400 }, 30))), None);
        assert_eq!(told((0..1_000).map(|n| (50 + 40 * (n % 2), 30 + 50 * (n % 3)))), None);
        assert_eq!(told((0..1_000).map(|_| (50, 30))), None);
    }

    /// A fluid was ended, and two workers were, in a campaign whose tissues were killed, swapped and swapped back.
    #[test]
    fn what_readers_map_of_others_is_no_leak_until_it_is_more_than_any_station_has() {
        let told = |first_mib: u64, more_mib: &dyn Fn(u64) -> u64| {
            let mut growth = Growth::default();
            let used = |n: u64| Use { own_mib: 60, shared_mib: first_mib + more_mib(n), files: 30 };
            (0..400).position(|n| growth.sample(Slot::first(Role::CollisionWorker), 7, used(n)).is_some())
        };
        assert_eq!(told(360, &|n| 70 * n.min(10)), None, "segments of five tissues, one after the other");
        assert_eq!(told(2_000, &|n| 500 * n.min(12)), None, "of a large scene");
        assert!(told(360, &|n| 20 * n).is_some_and(|at| (50..100).contains(&at)), "{:?}", told(360, &|n| 20 * n));
    }

    /// A worker was ended in a campaign whose tissues died a hundred times: now and then a sample found segments of the dead and the living.
    #[test]
    fn what_is_there_for_a_moment_and_given_back_is_no_leak_and_hides_none() {
        let for_a_moment = |n: u64| if n % 40 == 39 { 316 } else { 0 };
        assert_eq!(told((0..1_000).map(|n| (329 + for_a_moment(n), 30 + for_a_moment(n + 7)))), None);
        assert_eq!(told((0..1_000).map(|n| (329 + 100 * (n / 50 % 3), 30))), None, "two loads, given back together");
        let leaks = |mib: u64| told((0..1_000).map(|n| (329 + mib * n + for_a_moment(n), 30)));
        assert!(leaks(1).is_some_and(|at| at <= 160) && leaks(5).is_some_and(|at| at <= 60), "{:?} {:?}", leaks(1), leaks(5));
    }
}
