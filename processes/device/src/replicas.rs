//! The two servos as the device sees them: whose force is valid for this tick, which is selected, and which is not to be trusted.

use crate::hop;
use hyst_coupling::{
    ForceFault, ForceLimits, LastHopParams, ServoState, WatchInput, WatchParams, WatchState, WatchVerdict, choose, valid_force,
    watch_step,
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

/// The force of a record, if tissue is in it: none where all of it is the medium's, as the servo's state says. That does not follow the tip, so it may stay what
/// it was while the tip goes on.
fn touch_n(record: &ForceRecord) -> [f32; 3] {
    let state = ServoState::of_words(&record.servo_state);
    if state.medium_n.map(f32::to_bits) == record.force_n.map(f32::to_bits) { [0.0; 3] } else { record.force_n }
}

/// What a servo says of a tick, before any is taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Word {
    /// Nothing that may be chosen.
    Nothing,
    /// Its last force to the bit: it may stand still.
    Doubted,
    /// A force that may be chosen.
    Counts,
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
    /// One more than the index of whom it is; 0 if no servo has a valid one.
    pub followed: u16,
}

impl Chosen {
    /// The same where no servo counts.
    pub fn muted(self) -> Chosen {
        Chosen { force_n: None, lag: 0, followed: 0, ..self }
    }
}

/// The replicas, and the one that is followed.
#[derive(Default)]
pub struct Replicas {
    seats: [Option<Replica>; REPLICAS],
    selected: usize,
    last: Chosen,
    /// Whether less than the chosen force was applied in the tick before, or is in this one.
    withholds: bool,
    /// In a replay: whom the recorded device followed.
    recorded: Option<usize>,
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

    /// Says whether less than the chosen force is applied: then who is nearer to what was chosen last is followed, and not who is nearer to what was applied.
    pub fn withhold(&mut self, withholds: bool) {
        self.withholds = withholds;
    }

    /// In a replay: says whom the recorded device followed in this tick ([`Chosen::followed`]): the other's force is none to choose then, for it may have come
    /// too late, and have been another.
    pub fn follow(&mut self, followed: u16) {
        self.recorded = usize::from(followed).checked_sub(1).filter(|index| *index < REPLICAS);
    }

    /// Incarnation of the replica that is followed, 0 if it is not there.
    pub fn selected_incarnation(&self) -> u32 {
        self.seats[self.selected].as_ref().map_or(0, |replica| replica.incarnation)
    }

    /// Waits for the selected replica until the deadline, and chooses.
    pub fn choose(&mut self, life: &Life, input: &InputRecord, params: &LastHopParams, deadline_ns: u64) -> Chosen {
        self.wait_for(self.selected, life, input.tick, deadline_ns, false);
        let hash = input_hash(input);
        let words = [0, 1].map(|index| self.word(index, input.tick, hash, params));
        let other = 1 - self.selected;
        if words.contains(&Word::Counts) {
            // Who has it first is followed.
        } else if words[self.selected] == Word::Doubted {
            // Whether it stands still is seen beside the other's, if that comes in time as it did before.
            if self.seats[other].as_ref().is_some_and(|seat| seat.watch.seen == 1) {
                self.wait_for(other, life, input.tick, deadline_ns, false);
            }
        } else {
            // Both missed the tick before, or the selected one died or said nonsense in this tick: wait for whoever is expected to answer, in earnest.
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
            let page = &replica.page;
            let is_over =
                || !page.state().is_ready() || page.load64(header::TICK) >= input.tick || lockstep::is_lost(&life.clock, page);
            lockstep::wait_on(life, page, header::NEWS, is_over);
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
        if let Some(index) = self.recorded.filter(|index| records[*index].is_some()) {
            records[1 - index] = None;
        }
        let before_n = self.last.force_n.filter(|_| self.withholds).unwrap_or(input.applied_n);
        if let Some(standing) = self.standing(&records, before_n, params.max_slew_n_per_tick) {
            records[standing] = None;
            life.page.add64(header::FROZEN, 1);
        }
        self.note_standing(input.tick);
        for index in 0..REPLICAS {
            if self.seats[index].as_ref().is_some_and(|seat| seat.stood >= STOOD_TICKS) {
                self.distrust(index, life, Distrust::Frozen);
            }
        }
        let preferred = life.clock.page().load32(station::PREFERRED);
        let is_preferred = |index: &usize| self.seats[*index].as_ref().is_some_and(|seat| seat.incarnation == preferred);
        if let Some(index) = (0..REPLICAS).filter(|_| preferred != 0).find(is_preferred).filter(|index| records[*index].is_some())
        {
            self.selected = index; // it has the force of this tick as the other has: nothing else changes
        }
        let forces = records.map(|record| record.map(|record| record.force_n));
        let choice = choose(before_n, forces[0], forces[1], self.selected);
        if let Some(other) = choice.disagreement {
            self.distrust(other, life, Distrust::Differs);
        }
        self.selected = choice.index;
        let incarnation = self.selected_incarnation();
        if choice.force_n.is_some() {
            // The record's own stamp: whoever judges what was applied is not to take this process's word for it.
            let (tick, lag) = records[choice.index].map_or((0, 0), |record| (record.tick, record.lag()));
            self.last = Chosen { force_n: choice.force_n, tick, incarnation, lag, followed: choice.index as u16 + 1 };
        } else {
            self.last = self.last.muted();
        }
        let slot = Slot::new(Role::Haptic, self.selected).map_or(0, Slot::number);
        life.page.store64(layout::SELECTED, slot as u64);
        life.page.store64(layout::SELECTED_INCARNATION, incarnation as u64);
        self.last
    }

    /// Counts in how many ticks in a row a servo said its last force again although the other's changed, by what both have said of the tick before: of that
    /// both have answered, whoever is followed and whoever is first. A tick of which one has said nothing is no end of the row.
    fn note_standing(&mut self, tick: u64) {
        let said = |index: usize, back: u64| {
            let record = self.seats[index].as_ref()?.page.ring(haptic::FORCES, tick.checked_sub(back)?)?;
            (record.flags & FORCE_SHADOW == 0).then(|| record.force_n.map(f32::to_bits))
        };
        let words = [0, 1].map(|index| said(index, 1).zip(said(index, 2)));
        let [Some(a), Some(b)] = words else { return };
        let (a_stands, b_stands) = (a.0 == a.1, b.0 == b.1);
        for (seat, stands) in self.seats.iter_mut().zip([a_stands && !b_stands, b_stands && !a_stands]) {
            let Some(seat) = seat else { continue };
            seat.stood = if stands && a.0 != b.0 { seat.stood + 1 } else { 0 };
        }
    }

    /// Of two that differ, the one whose force is that of its tick before although the other's has changed: its output stands still.
    /// Only if the other's can be followed without a kick.
    fn standing(&self, records: &[Option<ForceRecord>; REPLICAS], before_n: [f32; 3], slew_n: f32) -> Option<usize> {
        let [Some(a), Some(b)] = records else { return None };
        let bits = |record: &ForceRecord| record.force_n.map(f32::to_bits);
        let stands = |index: usize| self.seats[index].as_ref().is_some_and(|seat| seat.same);
        let near = |record: &ForceRecord| {
            record.force_n.iter().zip(before_n).map(|(a, b)| (a - b) * (a - b)).sum::<f32>() <= slew_n * slew_n
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

    /// What the replica says of this tick: nothing that may be chosen is one from the shadow, one that is not a number, too large, or of another input. One that
    /// is its last to the bit is doubted; without touch both say zero, tick after tick, and only one that stood still before is.
    fn word(&self, index: usize, tick: u64, hash: u64, params: &LastHopParams) -> Word {
        let Some(replica) = &self.seats[index] else { return Word::Nothing };
        let Some((_, record)) = replica.page.cell(haptic::FORCE) else { return Word::Nothing };
        let is_valid = record.flags & FORCE_SHADOW == 0
            && record.input_hash == hash
            && valid_force(tick, record.tick, record.force_n, &limits(params)).is_ok();
        let may_stand = replica.stood > 0 || record.force_n != [0.0; 3];
        match is_valid {
            false => Word::Nothing,
            true if may_stand && replica.repeats(record.force_n) => Word::Doubted,
            true => Word::Counts,
        }
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
            force_n: touch_n(&record),
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
mod tests;
