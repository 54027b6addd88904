//! The two servos as the device sees them: whose force is valid for this tick, which is selected, and which is not to be trusted.

use crate::hop;
use hyst_coupling::{
    ForceFault, ForceLimits, LastHopParams, WatchInput, WatchParams, WatchState, WatchVerdict, choose, valid_force, watch_step,
};
use hyst_engine::{Life, lockstep};
use hyst_exchange::{ReadPage, StationPage, system};
use hyst_messages::page::device::{self as layout, Distrust};
use hyst_messages::page::{haptic, header, station};
use hyst_messages::record::{FORCE_ASTRAY, FORCE_SHADOW};
use hyst_messages::{ForceRecord, InputRecord, Role, Slot, fnv_words};

/// Ticks in a row after which a servo whose force stands still while the other's changes is to be replaced: two that lost different ticks agree again
/// sooner.
const STOOD_TICKS: u32 = 10;
/// Replicas of the servo.
const REPLICAS: usize = 2;

struct Replica {
    page: ReadPage,
    incarnation: u32,
    watch: WatchState,
    /// Its newest force is that of the tick before, to the bit.
    same: bool,
    /// Ticks in a row in which it stood still although the other's force changed.
    stood: u32,
}

impl Replica {
    /// Whether a force is the last one that was looked at, to the bit.
    fn repeats(&self, force_n: [f32; 3]) -> bool {
        self.watch.force_n.map(f32::to_bits) == force_n.map(f32::to_bits)
    }
}

/// What the device takes in this tick.
#[derive(Clone, Copy, Debug, Default)]
pub struct Chosen {
    /// The force, N; `None` if no servo has a valid one.
    pub force_n: Option<[f32; 3]>,
    /// Tick that it was computed for.
    pub tick: u64,
    /// Whose it is.
    pub incarnation: u32,
    /// Its [`ForceRecord::lag`].
    pub lag: u32,
}

/// The replicas, and the one that is followed.
#[derive(Default)]
pub struct Replicas {
    seats: [Option<Replica>; REPLICAS],
    selected: usize,
    last: Chosen,
}

/// Hash of an input record; the servo sends it back, so that a force for another input is never applied.
pub fn input_hash(input: &InputRecord) -> u64 {
    fnv_words(0, hyst_exchange::cell::words_of(input))
}

/// What a force of this tick may be.
fn limits(params: &LastHopParams) -> ForceLimits {
    ForceLimits { max_force_n: params.max_force_n, max_age_ticks: 0 }
}

impl Replicas {
    /// Takes the page of a new incarnation; gives back the one before. Who sits where the one that was followed sat is not the one that was followed.
    pub fn seat(&mut self, index: usize, page: ReadPage, life: &Life) -> Option<ReadPage> {
        let incarnation = page.incarnation();
        let other = 1 - index.min(1);
        if index == self.selected && self.seats[index].is_some() && self.seats[other].is_some() && !self.is_gone(other, life) {
            self.selected = other;
        }
        match self.seats.get_mut(index) {
            Some(place) => {
                let newcomer = Replica { page, incarnation, watch: WatchState::default(), same: false, stood: 0 };
                place.replace(newcomer).map(|replica| replica.page)
            }
            None => Some(page),
        }
    }

    /// Incarnation of the replica that is followed, 0 if it is not there.
    pub fn selected_incarnation(&self) -> u32 {
        self.seats[self.selected].as_ref().map_or(0, |replica| replica.incarnation)
    }

    /// Waits for the selected replica until the deadline, and chooses.
    pub fn choose(&mut self, life: &Life, input: &InputRecord, params: &LastHopParams, deadline_ns: u64) -> Chosen {
        self.wait_for(self.selected, life, input.tick, deadline_ns, false);
        let hash = input_hash(input);
        if !(0..REPLICAS).any(|index| self.counts(index, input.tick, hash, params)) {
            // Both missed the tick before, or the selected one died or said nonsense in this tick: wait for whoever is expected to answer, in earnest.
            let other = 1 - self.selected;
            let still = |index: usize| self.seats[index].as_ref().map_or(u32::MAX, |replica| replica.watch.still);
            // Of one whose answer does not count there is nothing more to expect in this tick.
            let said = |index: usize| self.seats[index].as_ref().is_some_and(|seat| seat.page.load64(header::TICK) >= input.tick);
            let none_to_come = said(self.selected) || self.is_gone(self.selected, life);
            let hope = if none_to_come || still(other) < still(self.selected) { other } else { self.selected };
            self.wait_for(hope, life, input.tick, deadline_ns + hop::DEADLINE_NS / 2, true);
        }
        self.take(life, input, hash, params)
    }

    /// In lock-step: waits for every replica that is warm or live, until it has answered or is lost, and chooses.
    pub fn choose_from_all(&mut self, life: &Life, input: &InputRecord, params: &LastHopParams) -> Chosen {
        for replica in self.seats.iter().flatten() {
            let answers = || replica.page.state().is_ready();
            let over = || replica.page.load64(header::TICK) >= input.tick || lockstep::is_lost(&life.clock, &replica.page);
            lockstep::wait_for(life, || (!answers() || over()).then_some(()));
        }
        self.take(life, input, input_hash(input), params)
    }

    /// Whether every servo that lives in the station has its seat.
    pub fn are_all_seated(&self, clock: &StationPage) -> bool {
        let seated = |slot: Slot, incarnation: u32| {
            self.seats[slot.index()].as_ref().is_some_and(|replica| replica.incarnation == incarnation)
        };
        clock.occupied(Role::Haptic).all(|(slot, incarnation)| clock.is_dead(slot) || seated(slot, incarnation))
    }

    /// Chooses from what the replicas have said. Once a tick: the watch counts looks.
    fn take(&mut self, life: &Life, input: &InputRecord, hash: u64, params: &LastHopParams) -> Chosen {
        let said = [0, 1].map(|index| self.valid(index, life, input, hash, params));
        let mut records = said.map(|record| record.filter(|record| record.flags & FORCE_SHADOW == 0));
        if life.is_lockstep() && records == [None, None] {
            // No time is lost in lock-step, so a newborn may be alone before it was out of its shadow: one that has the other's state counts.
            records = said.map(|record| record.filter(|record| record.flags & FORCE_ASTRAY == 0));
        }
        if let Some(standing) = self.standing(&records, input.applied_n, params.max_slew_n_per_tick) {
            records[standing] = None;
            life.page.add64(header::FROZEN, 1);
            let stood = self.seats[standing].as_mut().map_or(0, |seat| {
                seat.stood += 1;
                seat.stood
            });
            if stood >= STOOD_TICKS {
                self.distrust(standing, life, Distrust::Frozen);
            }
        } else {
            self.seats.iter_mut().flatten().for_each(|seat| seat.stood = 0);
        }
        let preferred = life.clock.page().load32(station::PREFERRED);
        let is_preferred = |index: &usize| self.seats[*index].as_ref().is_some_and(|seat| seat.incarnation == preferred);
        if let Some(index) = (0..REPLICAS).filter(|_| preferred != 0).find(is_preferred).filter(|index| records[*index].is_some())
        {
            self.selected = index; // it has the force of this tick as the other has: nothing else changes
        }
        let forces = records.map(|record| record.map(|record| record.force_n));
        let choice = choose(input.applied_n, forces[0], forces[1], self.selected, params.max_slew_n_per_tick);
        if let Some(other) = choice.disagreement {
            self.distrust(other, life, Distrust::Differs);
        }
        self.selected = choice.index;
        let incarnation = self.selected_incarnation();
        if choice.force_n.is_some() {
            // The record's own stamp: whoever judges what was applied is not to take this process's word for it.
            let (tick, lag) = records[choice.index].map_or((0, 0), |record| (record.tick, record.lag()));
            self.last = Chosen { force_n: choice.force_n, tick, incarnation, lag };
        } else {
            (self.last.force_n, self.last.lag) = (None, 0);
        }
        let slot = Slot::new(Role::Haptic, self.selected).map_or(0, Slot::number);
        life.page.store64(layout::SELECTED, slot as u64);
        life.page.store64(layout::SELECTED_INCARNATION, incarnation as u64);
        self.last
    }

    /// Of two that differ, the one whose force is that of its tick before although the other's has changed: its output stands still.
    /// Only if the other's can be followed without a kick.
    fn standing(&self, records: &[Option<ForceRecord>; REPLICAS], applied_n: [f32; 3], slew_n: f32) -> Option<usize> {
        let [Some(a), Some(b)] = records else { return None };
        let bits = |record: &ForceRecord| record.force_n.map(f32::to_bits);
        let stands = |index: usize| self.seats[index].as_ref().is_some_and(|seat| seat.same);
        let near = |record: &ForceRecord| {
            record.force_n.iter().zip(applied_n).map(|(a, b)| (a - b) * (a - b)).sum::<f32>() <= slew_n * slew_n
        };
        match (bits(a) == bits(b), stands(0), stands(1)) {
            (false, true, false) if near(b) => Some(0),
            (false, false, true) if near(a) => Some(1),
            _ => None,
        }
    }

    /// Waits until the replica has answered this tick, the deadline has passed, or it is known to be dead; unless `patient`, one that has
    /// missed the tick before is not waited for.
    fn wait_for(&self, index: usize, life: &Life, tick: u64, deadline_ns: u64, patient: bool) {
        let Some(replica) = &self.seats[index] else { return };
        // Bounded by the deadline; the word changes once a tick.
        loop {
            let news = replica.page.load32(header::NEWS);
            if replica.page.load64(header::TICK) >= tick || system::now_ns() >= deadline_ns {
                return;
            }
            if self.is_gone(index, life) || (replica.watch.still >= 1 && !patient) {
                return;
            }
            replica.page.wait(header::NEWS, news, deadline_ns);
        }
    }

    /// Whether the replica is known to be dead.
    fn is_gone(&self, index: usize, life: &Life) -> bool {
        let seat = Slot::new(Role::Haptic, index).zip(self.seats[index].as_ref());
        seat.is_some_and(|(slot, replica)| life.clock.is_dead(slot) && life.clock.incarnation(slot) == replica.incarnation)
    }

    /// Whether the replica has a force for this tick that may be chosen: one in its shadow, one that is not a number, too large, or of another input is no
    /// reason not to wait for the other, nor is that of one that stood still in the tick before and stands still again.
    fn counts(&self, index: usize, tick: u64, hash: u64, params: &LastHopParams) -> bool {
        let Some(replica) = &self.seats[index] else { return false };
        replica.page.cell(haptic::FORCE).is_some_and(|(_, record)| {
            record.flags & FORCE_SHADOW == 0
                && !(replica.stood > 0 && replica.repeats(record.force_n))
                && record.input_hash == hash
                && valid_force(tick, record.tick, record.force_n, &limits(params)).is_ok()
        })
    }

    /// The replica's force for this tick, if nothing is wrong with it; it may still be one from the shadow.
    fn valid(
        &mut self,
        index: usize,
        life: &Life,
        input: &InputRecord,
        hash: u64,
        params: &LastHopParams,
    ) -> Option<ForceRecord> {
        let replica = self.seats[index].as_mut()?;
        let (_, record) = replica.page.cell(haptic::FORCE)?;
        let watched = WatchInput {
            record_tick: record.tick,
            force_n: record.force_n,
            position_m: input.sample.pose.position_m,
            digest: record.input_hash,
            expected_digest: if record.tick == input.tick { hash } else { record.input_hash },
        };
        replica.same = replica.watch.seen == 1 && replica.repeats(record.force_n);
        let (watch, verdict) = watch_step(&WatchParams::default(), &replica.watch, &watched);
        replica.watch = watch;
        let distrust = match (valid_force(input.tick, record.tick, record.force_n, &limits(params)), verdict) {
            (Err(ForceFault::NotFinite | ForceFault::TooLarge | ForceFault::FromFuture), _) | (_, WatchVerdict::WrongInput) => {
                life.page.add64(header::INVALID, 1);
                Some(Distrust::Invalid)
            }
            (_, WatchVerdict::OutputFrozen) => {
                life.page.add64(header::FROZEN, 1);
                Some(Distrust::Frozen)
            }
            (_, WatchVerdict::StampStill) => Some(Distrust::Still),
            (Err(ForceFault::Stale), _) => Some(Distrust::Missing),
            (Ok(()), WatchVerdict::Alive) => return Some(record),
        };
        if let Some(distrust) = distrust {
            self.distrust(index, life, distrust);
        }
        None
    }

    /// Tells the supervisor, through the page, which replica to restart and why.
    fn distrust(&self, index: usize, life: &Life, why: Distrust) {
        let Some(replica) = &self.seats[index] else { return };
        life.page.store64(layout::DISTRUSTED + index, (why as u64) << 32 | replica.incarnation as u64);
        life.distrust(replica.incarnation, why);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_exchange::{OwnedPage, Station};

    /// What the device takes in a tick if the servos say this: the force along y, and the flags; `None` says nothing in this tick.
    fn taken(
        life: &Life,
        replicas: &mut Replicas,
        pages: &[OwnedPage; 2],
        tick: u64,
        said: [Option<(f32, u32)>; 2],
    ) -> Option<f32> {
        let input = InputRecord { tick, ..InputRecord::default() };
        for (page, said) in pages.iter().zip(said) {
            let Some((newton, flags)) = said else { continue };
            say(page, &input, [0.0, newton, 0.0], flags);
        }
        replicas.choose(life, &input, &LastHopParams::default(), 0).force_n.map(|force_n| force_n[1])
    }

    /// A device and two servos, seated.
    fn seated(name: &str) -> (Station, Life, [OwnedPage; 2], Replicas) {
        let station = Station::named(&format!("t{}-{name}", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        std::fs::write(station.settings(), "").unwrap();
        drop(station.create_slot(slot(Role::Device, 0), 1).unwrap());
        let life = Life::begin(station.name(), slot(Role::Device, 0), 1).unwrap();
        let pages = [0, 1].map(|index| station.create_slot(slot(Role::Haptic, index), 2 + index as u32).unwrap());
        let mut replicas = Replicas::default();
        for index in 0..2 {
            let page = station.read_slot(slot(Role::Haptic, index), 2 + index as u32).unwrap();
            assert!(replicas.seat(index, page, &life).is_none());
        }
        (station, life, pages, replicas)
    }

    fn slot(role: Role, index: usize) -> Slot {
        Slot::new(role, index).unwrap()
    }

    fn say(page: &OwnedPage, input: &InputRecord, force_n: [f32; 3], flags: u32) {
        let record = ForceRecord { tick: input.tick, input_hash: input_hash(input), force_n, flags, ..Default::default() };
        page.write(haptic::FORCE, &record);
        page.store64(header::TICK, input.tick);
        page.bump_and_wake(header::NEWS);
    }

    #[test]
    fn nonsense_of_the_one_that_is_followed_is_no_reason_not_to_wait_for_the_other() {
        let (station, life, [liar, other], mut replicas) = seated("nonsense");
        let begun_ns = system::now_ns();
        for (tick, nonsense) in [(1, f32::NAN), (3, 9.9), (5, f32::INFINITY)] {
            let input = InputRecord { tick, ..InputRecord::default() };
            say(&liar, &input, [0.0, nonsense, 0.0], 0);
            let chosen = std::thread::scope(|scope| {
                scope.spawn(|| {
                    std::thread::sleep(std::time::Duration::from_millis(30)); // not a synchronization: the other takes its time
                    say(&other, &input, [0.0, 0.1, 0.0], 0);
                });
                replicas.choose(&life, &input, &LastHopParams::default(), system::now_ns() + 60_000_000_000)
            });
            assert_eq!((chosen.force_n, chosen.incarnation), (Some([0.0, 0.1, 0.0]), 3), "{nonsense}");
            // The liar is well again, and followed for a tick.
            let input = InputRecord { tick: tick + 1, ..InputRecord::default() };
            say(&liar, &input, [0.0, 0.1, 0.0], 0);
            say(&other, &input, [0.0, f32::NAN, 0.0], 0);
            let chosen = replicas.choose(&life, &input, &LastHopParams::default(), system::now_ns() + 60_000_000_000);
            assert_eq!(chosen.incarnation, 2);
        }
        assert!(system::now_ns() - begun_ns < 50_000_000_000, "one who answered is waited for");
        drop(replicas);
        station.wipe();
    }

    #[test]
    fn one_that_stands_still_is_no_reason_not_to_wait_for_the_other() {
        let (station, life, pages, mut replicas) = seated("stands");
        let here = |newton| Some((newton, 0));
        assert_eq!(taken(&life, &mut replicas, &pages, 1, [here(0.10), here(0.10)]), Some(0.10));
        assert_eq!(taken(&life, &mut replicas, &pages, 2, [here(0.10), here(0.11)]), Some(0.11), "the first stands");
        for (newton, counts) in [(0.10, false), (0.12, true)] {
            let input = InputRecord { tick: 3, ..InputRecord::default() };
            say(&pages[0], &input, [0.0, newton, 0.0], 0);
            assert_eq!(replicas.counts(0, 3, input_hash(&input), &LastHopParams::default()), counts, "{newton} N");
        }
        drop(replicas);
        station.wipe();
    }

    #[test]
    fn the_one_that_is_followed_stays_until_it_is_not_valid_and_a_newborn_counts_only_out_of_its_shadow() {
        let (station, life, pages, mut replicas) = seated("replicas");
        let distrusted = |index: usize| life.page.load64(layout::DISTRUSTED + index) >> 32;
        let mut take = |tick, said| {
            let force_n = taken(&life, &mut replicas, &pages, tick, said);
            (force_n, replicas.selected_incarnation())
        };
        let (here, shadow) = (|newton| Some((newton, 0)), |newton| Some((newton, FORCE_SHADOW)));
        assert_eq!(take(1, [here(0.10), here(0.10)]), (Some(0.10), 2), "the first is followed");
        assert_eq!(take(2, [here(0.11), shadow(0.30)]), (Some(0.11), 2));
        assert_eq!(distrusted(1), 0, "one in its shadow does not disagree with anybody");
        assert_eq!(take(3, [shadow(0.30), here(0.12)]), (Some(0.12), 3), "nor is it taken where it was followed before");
        assert_eq!(take(4, [here(0.13), here(0.13)]), (Some(0.13), 3), "the selection stays");
        assert_eq!(take(5, [here(0.14), here(f32::NAN)]), (Some(0.14), 2));
        assert_eq!(distrusted(1), Distrust::Invalid as u64);
        assert_eq!(take(6, [None, here(0.15)]), (Some(0.15), 3), "what is of another tick is not taken");
        assert_eq!(take(7, [shadow(0.16), shadow(0.16)]).0, None, "nobody is out of the shadow");
        assert_eq!(take(8, [here(9.9), None]).0, None, "beyond any motor");
        assert_eq!(take(9, [here(0.17), None]), (Some(0.17), 2));
        let mut born = |index: usize, incarnation: u32| {
            drop(station.create_slot(slot(Role::Haptic, index), incarnation).unwrap());
            let page = station.read_slot(slot(Role::Haptic, index), incarnation).unwrap();
            assert!(replicas.seat(index, page, &life).is_some());
            replicas.selected_incarnation()
        };
        assert_eq!(born(0, 9), 3, "who sits where the one that was followed sat is another");
        let keeping = station.open_for_keeping().unwrap();
        keeping.store32(station::SLOT_INCARNATION + slot(Role::Haptic, 0).number(), 9);
        keeping.store32(station::SLOT_DEAD + slot(Role::Haptic, 0).number(), 1);
        assert_eq!(born(1, 10), 10, "the other one is dead");
        drop(replicas);
        station.wipe();
    }
}
