//! The two servos as the device sees them: whose force is valid for this tick, which is selected, and which is not to be trusted.

use crate::hop;
use hyst_coupling::{
    ForceFault, ForceLimits, LastHopParams, WatchInput, WatchParams, WatchState, WatchVerdict, choose, valid_force, watch_step,
};
use hyst_engine::Life;
use hyst_exchange::{ReadPage, system};
use hyst_messages::page::device::{self as layout, Distrust};
use hyst_messages::page::{haptic, header};
use hyst_messages::record::FORCE_SHADOW;
use hyst_messages::{ForceRecord, InputRecord, Role, Slot, fnv_words};

/// Replicas of the servo.
const REPLICAS: usize = 2;

struct Replica {
    page: ReadPage,
    incarnation: u32,
    watch: WatchState,
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

impl Replicas {
    /// Takes the page of a new incarnation; gives back the one before.
    pub fn seat(&mut self, index: usize, page: ReadPage) -> Option<ReadPage> {
        let incarnation = page.incarnation();
        match self.seats.get_mut(index) {
            Some(place) => place.replace(Replica { page, incarnation, watch: WatchState::default() }).map(|replica| replica.page),
            None => Some(page),
        }
    }

    /// Waits for the selected replica until the deadline, and chooses.
    pub fn choose(
        &mut self,
        life: &Life,
        input: &InputRecord,
        applied_n: [f32; 3],
        params: &LastHopParams,
        deadline_ns: u64,
    ) -> Chosen {
        let hash = input_hash(input);
        self.wait_for(self.selected, life, input.tick, deadline_ns, false);
        if !(0..REPLICAS).any(|index| self.has_answered(index, input.tick)) {
            // Both missed the tick before, or the selected one died in this tick: wait for whoever is expected to answer, in earnest.
            let other = 1 - self.selected;
            let still = |index: usize| self.seats[index].as_ref().map_or(u32::MAX, |replica| replica.watch.still);
            let hope = if still(other) < still(self.selected) { other } else { self.selected };
            self.wait_for(hope, life, input.tick, deadline_ns + hop::DEADLINE_NS / 2, true);
        }
        // Once a tick: the watch counts looks.
        let records = [0, 1].map(|index| self.valid(index, life, input, hash, params));
        let forces = records.map(|record| record.map(|record| record.force_n));
        let choice = choose(applied_n, forces[0], forces[1], self.selected, params.max_slew_n_per_tick);
        if let Some(other) = choice.disagreement {
            self.distrust(other, life, Distrust::Differs);
        }
        self.selected = choice.index;
        let incarnation = self.seats[choice.index].as_ref().map_or(0, |replica| replica.incarnation);
        if choice.force_n.is_some() {
            self.last = Chosen { force_n: choice.force_n, tick: input.tick, incarnation };
        } else {
            self.last.force_n = None;
        }
        let slot = Slot::new(Role::Haptic, self.selected).map_or(0, Slot::number);
        life.page.store64(layout::SELECTED, slot as u64);
        life.page.store64(layout::SELECTED_INCARNATION, incarnation as u64);
        self.last
    }

    /// Waits until the replica has answered this tick, the deadline has passed, or it is known to be dead; unless `patient`, one that has
    /// missed the tick before is not waited for.
    fn wait_for(&self, index: usize, life: &Life, tick: u64, deadline_ns: u64, patient: bool) {
        let Some(replica) = &self.seats[index] else { return };
        let slot = Slot::new(Role::Haptic, index);
        // Bounded by the deadline; the word changes once a tick.
        loop {
            let news = replica.page.load32(header::NEWS);
            if replica.page.load64(header::TICK) >= tick || system::now_ns() >= deadline_ns {
                return;
            }
            let dead = slot.is_some_and(|slot| life.clock.is_dead(slot) && life.clock.incarnation(slot) == replica.incarnation);
            if dead || (replica.watch.still >= 1 && !patient) {
                return;
            }
            replica.page.wait(header::NEWS, news, deadline_ns);
        }
    }

    /// Whether the replica has a force for this tick that may be chosen: one in its shadow is no reason not to wait for the other.
    fn has_answered(&self, index: usize, tick: u64) -> bool {
        let record = self.seats[index].as_ref().and_then(|replica| replica.page.cell(haptic::FORCE));
        record.is_some_and(|(_, record)| record.tick == tick && record.flags & FORCE_SHADOW == 0)
    }

    /// The replica's force for this tick, if it may be applied.
    fn valid(
        &mut self,
        index: usize,
        life: &Life,
        input: &InputRecord,
        hash: u64,
        params: &LastHopParams,
    ) -> Option<ForceRecord> {
        let limits = ForceLimits { max_force_n: params.max_force_n, max_age_ticks: 0 };
        let replica = self.seats[index].as_mut()?;
        let (_, record) = replica.page.cell(haptic::FORCE)?;
        let watched = WatchInput {
            record_tick: record.tick,
            force_n: record.force_n,
            position_m: input.sample.pose.position_m,
            digest: record.input_hash,
            expected_digest: if record.tick == input.tick { hash } else { record.input_hash },
        };
        let (watch, verdict) = watch_step(&WatchParams::default(), &replica.watch, &watched);
        replica.watch = watch;
        let shadow = record.flags & FORCE_SHADOW != 0;
        let distrust = match (valid_force(input.tick, record.tick, record.force_n, &limits), verdict) {
            (Err(ForceFault::NotFinite | ForceFault::TooLarge | ForceFault::FromFuture), _) | (_, WatchVerdict::WrongInput) => {
                life.page.add64(header::INVALID, 1);
                Some(Distrust::Invalid)
            }
            (_, WatchVerdict::OutputFrozen) => {
                life.page.add64(header::FROZEN, 1);
                Some(Distrust::Frozen)
            }
            (_, WatchVerdict::StampStill) => Some(Distrust::Still),
            (Err(ForceFault::Stale), _) => None,
            (Ok(()), WatchVerdict::Alive) => return (!shadow).then_some(record),
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
    }
}
