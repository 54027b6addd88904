//! A swap under way: what the policy says is done here, and what speaks against a newcomer is gathered here: the judge's lines, the other
//! servo's force, what its readers say of it, and whether it makes its steps.

mod current;
mod effort;
mod forces;
mod guest;
mod judge;
mod newcomer;
mod room;
mod verdict;

use super::Supervisor;
use crate::journal;
use crate::mischief::Charge;
use crate::policy::{self, Action, Cause, Event, Left, Reason};
use crate::swap::{AGREES, DONE, HAS_THE_ROLE, IN_PLACE, Record, first_slot, kept, line_of_step, role_of};
use effort::{Effort, KEPT_OFF_FOR_LATE, Leaps, Spent, Tenures};
use forces::Forces;
use hyst_exchange::system;
use hyst_messages::page::device::Distrust;
use hyst_messages::page::{Stage, Swap, device, rendering, station as layout};
use hyst_messages::{Role, Slot};
use judge::Judging;
use room::Room;
use std::path::{Path, PathBuf};

/// How long a newcomer is compared at least before it may have the role, ns.
const SHADOW_NS: u64 = 1_000_000_000;
/// States that must have agreed by then: a third of a second of the slowest role. A holder that leaps over ticks leaves none to compare.
const LEAST_COMPARED: u64 = 10;
/// The same on its probation. A judge that is hardly let run sees too little of what the hand does: an engine that felt nothing was promoted after 11.
const LEAST_PROVEN: u64 = 30;
/// States in a row out of tolerance after which the newcomer goes: one may come from an input that was read at another moment.
const MOST_OUTSIDE: u64 = 3;
/// A newcomer that does not answer in time for so long is too slow, ns.
const LATE_NS: u64 = 200_000_000;

/// What is said of a newcomer that the station has no copy of.
const UNKEPT: &str = ", of which the station has no copy: what is built over it runs after the next restart";

/// What is said of one that passed in the open.
const UNTOUCHED: &str = "; nothing was touched meanwhile, so that what is felt through it was not tried";

/// What is known of the swap that is under way.
#[derive(Debug)]
pub struct Trial {
    record: Record,
    role: Role,
    stage: Stage,
    since_ns: u64,
    judging: Judging,
    /// Pairs of states that agreed, as the judge says, and how many of them before the newcomer had the role; and how many while it had it before a pause.
    agreed: (u64, u64),
    proven: u64,
    /// It gives the role back because its state and that of the old engine have parted.
    has_parted: bool,
    forces: Forces,
    /// What is out of tolerance is that nothing came of it, and whether a thread of it waited for a disk, or for memory, then.
    silent: bool,
    at_disk: bool,
    room: Room,
    /// When there was nothing that could be compared last, for no fault of its own, ns; 0 if there was all the time.
    waits_ns: u64,
    /// Looks at which the hand felt something on this probation.
    felt: u32,
    /// When there was current in the electrode last, ns; 0 if there was none since it has been ready.
    current_ns: u64,
    /// What the old engine spent; nothing if that is not known.
    old: Spent,
    /// The old rendering drew pictures.
    drew: bool,
    /// What the newcomer spends, and who had the role before, where that one works beside it.
    effort: Option<Effort>,
    beside: Option<Effort>,
    tenures: Tenures,
    leaps: Leaps,
    /// When its rate was last looked at, ns; looks at which it was too slow.
    looked_ns: u64,
    slow: u32,
}

impl Trial {
    /// One of which nothing is known but what the old engine did.
    fn begin(record: Record, role: Role, old: Spent) -> Trial {
        Trial {
            record,
            role,
            stage: Stage::None,
            since_ns: system::now_ns(),
            judging: Judging::default(),
            agreed: (0, 0),
            proven: 0,
            has_parted: false,
            forces: Forces::default(),
            silent: false,
            at_disk: false,
            room: Room::default(),
            waits_ns: 0,
            felt: 0,
            current_ns: 0,
            old,
            drew: false,
            effort: None,
            beside: None,
            tenures: Tenures::default(),
            leaps: Leaps::default(),
            looked_ns: 0,
            slow: 0,
        }
    }
}

impl Supervisor {
    /// Begins a swap that was asked for; gives its number, or why it is refused. The report tells of either.
    pub(super) fn begin_swap(&mut self, role: &str, binary: &Path) -> Result<u64, String> {
        let begun = self.begin_unless_refused(role, binary);
        begun.inspect_err(|reason| self.faults.swap_refused(role, binary, reason))
    }

    fn begin_unless_refused(&mut self, role: &str, binary: &Path) -> Result<u64, String> {
        let role = role_of(role)?;
        if self.permit.is_some() {
            return Err("a station in lock-step has no time to shadow in; swap in a station on the real clock".into());
        }
        if !binary.is_file() {
            return Err(format!("{} is no file", binary.display()));
        }
        let slot = first_slot(role, self.viewer.slot_page(Slot::first(Role::Device)));
        self.policy.may_swap(slot)?;
        let incumbent = match self.faults.active_incarnation(role) {
            0 => self.viewer.page().incarnation(Slot::first(role)),
            active => active,
        };
        let number = Record::read(&self.station).map_or(1, |record| record.number + 1);
        let mut record = Record {
            number,
            role: role.name().into(),
            slot: slot.to_string(),
            binary: binary.to_path_buf(),
            before: self.spawner.plan().binary(role),
            incarnation: 0,
            incumbent,
            proven: false,
            promoted: None,
            cause: None,
            reason: String::new(),
            begun_ns: system::now_ns(),
            steps: Vec::new(),
        };
        let name = kept::name_of(binary);
        let of_whom = if kept::is_copy(binary) { "" } else { UNKEPT };
        let what = format!("{slot} is to run {}{of_whom}", name.display());
        record.note(&what);
        if !record.write(&self.station) {
            return Err("the station's root takes no more files; look at `df /dev/shm`".into());
        }
        self.faults.swap_asked(&record);
        self.spawner.mortality.pass("swap-declared");
        journal::say(&self.station, &line_of_step(number, role.name(), &what));
        self.spawner.candidate = Some((slot, binary.to_path_buf()));
        let old = self.spent_by(slot);
        let mut trial = Trial::begin(record, role, old);
        trial.drew = self.draws(slot);
        if role == Role::Recorder {
            trial.judging.call_witness(&self.station);
        }
        self.trial = Some(trial);
        let actions = policy::step(system::now_ns(), Event::SwapAsked { slot, incumbent }, &mut self.policy);
        self.act(actions);
        Ok(number)
    }

    /// Whether a rendering says that it has drawn a picture: where there is no driver it has drawn none.
    fn draws(&mut self, slot: Slot) -> bool {
        let page = if slot.role() == Role::Rendering { self.viewer.slot_page(slot) } else { None };
        page.and_then(|page| page.cell(rendering::STATUS)).is_some_and(|(_, status)| status.frames > 0)
    }

    /// Does what the policy says of a swap.
    pub(super) fn act_on_swap(&mut self, action: Action) {
        match action {
            Action::Told { role, stage, incarnation } => self.tell(role, stage, incarnation),
            Action::Adopt { role } => {
                let Some(trial) = &mut self.trial else { return };
                trial.record.proven = true;
                let binary = trial.record.binary.clone();
                let agreed = trial.agreed_on_probation();
                let pairs = if role.is_stateful() { format!(" ({agreed} states agreed)") } else { String::new() };
                let in_touch = self.policy.swap().is_none_or(policy::Swap::was_tried_in_touch);
                let untried = if in_touch { "" } else { UNTOUCHED };
                self.note_step(&format!("its probation is over: the role is its own{pairs}{untried}"));
                if let Err(error) = self.spawner.adopt_binary(role, binary) {
                    journal::say(&self.station, &format!("a supervisor that is restarted will not know the new binary: {error}"));
                }
                self.spawner.mortality.pass("swap-adopted");
            }
            Action::Retreat { role, to, reason } => {
                self.spawner.candidate = None;
                if role == Role::Haptic {
                    self.page.store32(layout::PREFERRED, to);
                }
                let guest = self.trial.as_ref().map_or(0, |trial| trial.record.incarnation);
                if role.is_stateful() {
                    let undone = Swap { stage: Stage::Undone, guest };
                    self.page.store64(layout::SWAP + role as usize, undone.word());
                }
                let Reason { cause, text } = self.trial.as_ref().map_or(reason.clone(), |trial| trial.weighed(reason));
                if let Some(trial) = &mut self.trial {
                    (trial.record.cause, trial.record.reason) = (Some(cause), text.clone());
                }
                self.note_step(&format!("rolled back: {text}"));
                if let Some(slot) = self.trial.as_ref().and_then(|trial| trial.record.slot()) {
                    self.faults.look_at_the_dead(slot, guest, &mut self.viewer);
                }
                self.faults.doubted(guest, cause, system::now_ns());
                self.spawner.mortality.pass("swap-undone");
            }
            Action::EndSwap { role, promoted } => self.end_swap(role, promoted),
            _ => {}
        }
    }

    fn tell(&mut self, role: Role, stage: Stage, incarnation: u32) {
        if role.is_stateful() || role == Role::Rendering {
            self.page.store64(layout::SWAP + role as usize, Swap { stage, guest: incarnation }.word());
        }
        if role == Role::Haptic && stage == Stage::Trial {
            self.page.store32(layout::PREFERRED, incarnation);
        }
        self.spawner.mortality.pass("swap-told");
        let in_place = !role.is_replicated();
        let is_again = stage == Stage::Shadow && self.trial.as_ref().is_some_and(|trial| trial.stage == Stage::Trial);
        if let Some(trial) = &mut self.trial {
            trial.note_leader();
            trial.forces.begin();
            trial.proven = match is_again {
                true if std::mem::take(&mut trial.has_parted) => 0, // pairs that disagreed prove nothing
                true => trial.agreed_on_probation(),
                false => trial.proven,
            };
            (trial.stage, trial.since_ns, trial.record.incarnation, trial.felt) = (stage, system::now_ns(), incarnation, 0);
            let begins = stage == if role.is_stateful() { Stage::Shadow } else { Stage::Trial } && !is_again;
            if begins && policy::is_judged(role) {
                trial.judging.begin(trial.since_ns);
            }
        }
        self.tend_judge(system::now_ns());
        let text = match stage {
            Stage::Shadow if is_again => "in the shadow again, beside the old engine",
            Stage::Shadow => "ready, and in the shadow of the old engine",
            Stage::Trial if in_place => IN_PLACE,
            Stage::Trial => AGREES,
            Stage::Settled | Stage::Undone | Stage::None => return,
        };
        self.note_step(text);
    }

    fn end_swap(&mut self, role: Role, promoted: bool) {
        self.page.store64(layout::SWAP + role as usize, 0);
        self.page.store32(layout::PREFERRED, 0);
        self.spawner.candidate = None;
        if let Some(guest) = Slot::guest(role) {
            self.end_of_guest(guest, promoted);
        }
        self.faults.swap_ended(system::now_ns());
        self.spawner.mortality.pass("swap-cleared");
        if let Some(trial) = &mut self.trial {
            trial.record.promoted = Some(promoted);
        }
        self.note_step(if promoted { DONE } else { "over: the old engine has the role" });
        self.trial = None;
        self.cleaner.ask(system::now_ns());
    }

    fn note_step(&mut self, text: &str) {
        let Some(trial) = &mut self.trial else { return };
        trial.record.note(text);
        journal::say(&self.station, &line_of_step(trial.record.number, &trial.record.role, text));
        trial.record.write(&self.station); // a full disk costs what is said, not the swap
        self.faults.swap_went_on(&trial.record);
    }

    /// Somebody else has the role: said, if one of the two is the newcomer.
    pub(super) fn note_tenure(&mut self, role: Role, now: u32, before: u32) {
        if self.is_newcomer(now) {
            if let Some(trial) = &mut self.trial {
                trial.agreed.1 = trial.agreed.0;
            }
            self.note_step(HAS_THE_ROLE);
            self.note_role(true);
            self.note_hold(true);
        } else if self.is_newcomer(before) {
            self.note_hold(false);
            match &mut self.trial {
                Some(trial) if self.policy.swap().is_some_and(policy::Swap::is_given_back) => trial.tenures.give_back(),
                _ => self.note_role(false),
            }
            self.note_step(&format!("{} went from it to incarnation {now}", role.name()));
        }
    }

    pub(super) fn doubt(&mut self, incarnation: u32, reason: Reason) {
        let actions = policy::step(system::now_ns(), Event::Doubted { incarnation, reason }, &mut self.policy);
        self.act(actions);
    }

    /// What the readers of the newcomer's output say of it.
    pub(super) fn heed_newcomer(&mut self, charge: &Charge, is_grave: bool, now_ns: u64) {
        // Who is not ready yet answers nobody; of those with a state the elders and their leaps tell whether they are in time.
        let counts = |trial: &&Trial| trial.stage == Stage::Trial && !trial.role.is_stateful();
        let trial_ns = self.trial.as_ref().filter(counts).map_or(u64::MAX, |trial| trial.since_ns);
        let late = charge.is(Distrust::Missing)
            && charge.last_ns.saturating_sub(charge.since_ns.max(trial_ns)) > LATE_NS
            && now_ns.saturating_sub(charge.last_ns) < LATE_NS;
        if is_grave {
            let text = format!("{} refuses what it says{}", charge.by, self.refused_in_words(charge));
            self.doubt(charge.incarnation, Reason::new(Cause::Refused, text));
        } else if late
            && !self.trial.as_ref().is_some_and(|trial| trial.is_excused(now_ns.saturating_sub(LATE_NS), KEPT_OFF_FOR_LATE))
        {
            self.doubt(charge.incarnation, Reason::new(Cause::Late, format!("{} has no answer from it in time", charge.by)));
        }
    }

    /// Looks how the newcomer does.
    pub(super) fn tend_swap(&mut self, now_ns: u64) {
        self.note_followed(now_ns);
        self.note_room(now_ns);
        let Some(trial) = &self.trial else { return };
        let (role, stage, incarnation) = (trial.role, trial.stage, trial.record.incarnation);
        if incarnation == 0 || trial.record.proven {
            return;
        }
        self.tend_judge(now_ns);
        if role == Role::Haptic {
            self.compare_forces(now_ns);
        }
        self.note_touch(now_ns);
        self.note_current(now_ns);
        self.note_effort(now_ns);
        match stage {
            Stage::Trial if role.is_stateful() => self.look_at_leaps(now_ns),
            Stage::Trial => self.look_at_rate(now_ns),
            _ => {}
        }
    }

    /// The policy is told which servo the device follows.
    fn note_followed(&mut self, now_ns: u64) {
        if self.trial.as_ref().is_none_or(|trial| trial.role != Role::Haptic) {
            return;
        }
        let page = self.viewer.slot_page(Slot::first(Role::Device));
        let followed = page.map_or(0, |page| page.load64(device::SELECTED_INCARNATION) as u32);
        let actions = policy::step(now_ns, Event::Holds { role: Role::Haptic, incarnation: followed }, &mut self.policy);
        self.act(actions);
    }

    /// What a supervisor before this one left of a swap: finished if it was proven, else undone. The guest of a swap that is over, or that nobody knows, goes
    /// too.
    pub(super) fn resume_swap(&mut self) {
        let left = Record::read(&self.station).filter(|record| record.promoted.is_none());
        let of = |record: Record| Some((record.slot()?, Role::from_name(&record.role)?, record));
        let left = left.and_then(of);
        self.dismiss_guests_but(left.as_ref().map(|(_, role, _)| *role));
        let Some((slot, role, record)) = left else {
            return self.faults.swap_ended(system::now_ns());
        };
        self.faults.swap_asked(&record);
        let binary = std::fs::canonicalize(&record.binary).ok();
        let runs = |slot: Slot| binary.is_some() && binary_of(self.viewer.page().pid(slot)) == binary;
        let alive = |slot: &Slot| self.viewer.page().pid(*slot) != 0 && !self.viewer.page().is_dead(*slot);
        let incarnation = if alive(&slot) && (slot.is_guest() || runs(slot)) { self.viewer.page().incarnation(slot) } else { 0 };
        let others = self.slots.iter().copied().filter(|other| other.role() == role && *other != slot && alive(other));
        let old = others.filter(|other| !runs(*other)).map(|other| (other, self.viewer.page().incarnation(other))).collect();
        let left = Left { slot, incarnation, incumbent: record.incumbent, proven: record.proven, old };
        let now_ns = system::now_ns();
        if record.proven && self.spawner.plan().binary(role) != record.binary {
            let _ = self.spawner.adopt_binary(role, record.binary.clone()); // refused: said when it was tried first
        }
        self.trial = Some(Trial::begin(record, role, Spent::default()));
        self.note_step("the supervisor died and another goes on");
        let actions = policy::step(now_ns, Event::SwapLeft(left), &mut self.policy);
        self.act(actions);
    }
}

/// The binary that a process runs; `None` if the system does not say.
pub fn binary_of(pid: u32) -> Option<PathBuf> {
    std::fs::read_link(format!("/proc/{pid}/exe")).ok()
}
