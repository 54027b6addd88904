//! The judge of a newcomer whose state is a message: a helper process that reads the role's streams and compares, tick by tick, what the
//! newcomer computes with what the old engine computes, by the role's stated tolerance. It decides nothing and nobody waits for it: the
//! supervisor reads its lines. A helper, because a reader trusts offsets in memory that the newcomer writes.

mod inputs;
#[cfg(test)]
mod tests;
mod writer;

use hyst_engine::stateful::MOST_BEHIND_TICKS;
use hyst_exchange::{Links, ReadPage, Station, StationPage, Subscriber, system};
use hyst_messages::page::tissue;
use hyst_messages::tolerance::{Deviation, SHADOW_EPOCH, compare, compare_models};
use hyst_messages::{ContactModel, Kind, Message, Role, StreamHeader, kinds_of};
use inputs::Inputs;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::io::Write;

/// Between two looks at the streams, ns: a reader's buffer holds two messages.
const LOOK_NS: u64 = 1_000_000;
/// Between two lines, ns.
pub(super) const LINE_NS: u64 = 50_000_000;
/// Ticks of which a state waits for its counterpart.
const MOST_WAITING: usize = 8;
/// States of a real-time role are compared at every so many steps: 62 times a second at 1 kHz.
const EVERY: u64 = 16;
/// A role with a longer step is compared at every step, ticks.
const SHORT_STEP_TICKS: u32 = 4;

/// Ticks for which nothing is compared after one side has leapt over some: the time that it lost is missing in its state, and a tissue that is
/// moved takes some tens of ms to forget that. What floats in it does not. So it is after both have used inputs of other ticks for one.
pub const FORGET_TICKS: u64 = 250;
/// States that may be missing between two of the old engine's that are seen here: it leaps over more, and a look that is late loses fewer.
const LOST: u64 = 16;
/// States in a row of a newcomer whose step is of another length than the old engine's, or whose mesh is another one than that which the old engine makes of
/// the same state, after which it is said that there is nothing to compare.
const MOST_UNLIKE: u32 = 30;

/// Of so many pairs at least it is asked how many were out of tolerance.
const LEAST_OF: u64 = 30;
/// One pair of so many may be. A good newcomer has hardly any, for an input that was read at another moment: with one in ten it would have three in a row by
/// chance before long, and good ones do not.
const ONE_BAD_OF: u64 = 10;
/// Fewer are a moment's.
const FEW_BAD: u64 = 3;

/// Whether of so many pairs in all too many were out of tolerance.
pub fn are_too_many([bad, of]: [u64; 2]) -> bool {
    bad >= FEW_BAD && of >= LEAST_OF && bad.saturating_mul(ONE_BAD_OF) > of
}

/// What the judge has seen so far.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Seen {
    /// Pairs of states.
    pub compared: u64,
    /// Those that were within tolerance.
    pub good: u64,
    /// Pairs that were out of tolerance, and pairs in all, since the newcomer has the role, or since it has it no more.
    pub bad_of: [u64; 2],
    /// Pairs in a row, up to now, that were out of tolerance.
    pub outside: u64,
    /// Where the last pair was farthest apart, in parts of what is allowed.
    pub ratio: f64,
    /// The largest of all ratios.
    pub worst: f64,
    /// The last one in words.
    pub text: String,
    /// The last one that was out of tolerance.
    pub flaw: String,
    /// Pairs in a row, up to now, of a newcomer that has the role, whose meshes are not the same: of those nothing is compared.
    pub apart: u32,
    /// One side has lost ticks, or used another input, since both went on from one state: what is out of tolerance then may be what floats,
    /// which nothing pulls back to where it was.
    pub leapt: bool,
    /// Each of those that were out of tolerance in a row was so because nothing came of the newcomer: the machine may have kept it from its work.
    pub silent: bool,
    /// Nothing can be compared yet, and that is not the newcomer's doing.
    pub waits: bool,
}

impl Seen {
    /// One more comparison: how far apart, in parts of what is allowed, and in words.
    pub fn note(&mut self, (ratio, text): (f64, String)) {
        let is_good = ratio <= 1.0;
        self.compared += 1;
        self.good += u64::from(is_good);
        self.outside = if is_good { 0 } else { self.outside + 1 };
        self.silent = false;
        let [bad, of] = self.bad_of;
        self.bad_of = [bad + u64::from(!is_good), of + 1];
        if !is_good {
            self.flaw.clone_from(&text);
        }
        // JSON has no infinity.
        self.ratio = ratio.min(f64::MAX);
        self.worst = self.worst.max(self.ratio);
        self.text = text;
    }

    /// The same of a look to which nothing came that could be compared, for so long that this is out of tolerance.
    pub fn note_silence(&mut self, text: String) {
        let is_silent = self.silent || self.outside == 0;
        self.note((f64::INFINITY, text));
        self.silent = is_silent;
    }

    /// The same of a pair, and whether it `counts` among those of now.
    fn note_if(&mut self, counts: bool, found: (f64, String)) {
        let before = self.bad_of;
        self.note(found);
        if !counts {
            self.bad_of = before;
        }
    }

    /// Whether too many pairs were out of tolerance, although not in a row.
    pub fn has_too_many_bad(&self) -> bool {
        are_too_many(self.bad_of)
    }
}

/// One side's state of a tick.
struct State {
    is_shadow: bool,
    /// The version of its mesh; 0 of a state that has none.
    mesh: u32,
    bytes: Vec<u8>,
}

#[derive(Default)]
struct Pairs {
    waiting: BTreeMap<u64, [Option<State>; 2]>,
    seen: Seen,
    /// Epoch and tick of the role's newest state, tick of the old engine's newest beside it, and of the last one that was leapt to.
    role: (u32, u64),
    line: u64,
    leapt: Option<u64>,
    /// The newcomer wrote that state of the role.
    leads: bool,
    /// One side has leapt since both went on from one state, in the shadow or as the newcomer took the role; or the two have used other inputs since.
    has_leapt: bool,
    /// Of a tissue.
    inputs: Inputs,
    /// The newest steps of the old engine and of the newcomer, ticks; states of that in a row by which they differed; whether both had a state of one tick.
    steps: [u32; 2],
    unlike: u32,
    has_met: bool,
    /// The newest meshes of the old engine and of the newcomer; pairs in a row whose meshes were not the same, of a newcomer that has the role and of one in
    /// the shadow.
    meshes: [u32; 2],
    apart: [u32; 2],
    /// Contact models of ticks, and what was seen of them.
    models: BTreeMap<u64, [Option<ContactModel>; 2]>,
    felt: Seen,
    /// A tissue, which makes them: one that makes none agrees with nobody.
    has_models: bool,
}

impl Pairs {
    /// Takes a state that names its own writer; compares as soon as both sides have the tick and one of them is beside the role.
    fn take(&mut self, kind: Kind, bytes: &[u8], guest: u32) {
        let Ok(header) = Message::parse(bytes, kind).map(|message| *message.header()) else { return };
        self.follow(&header, guest);
        if kind == Kind::TissueState && self.has_other_input((&header).into(), guest) {
            return;
        }
        if self.leapt.is_some_and(|leapt| header.tick < leapt.saturating_add(FORGET_TICKS)) {
            return;
        }
        self.note_steps(&header, guest);
        let every = if header.step_ticks <= SHORT_STEP_TICKS { EVERY } else { 1 };
        if !(header.tick / u64::from(header.step_ticks.max(1))).is_multiple_of(every) {
            return;
        }
        let side = usize::from(header.incarnation == guest);
        let mesh = if kind == Kind::TissueState { header.topology_version } else { 0 };
        let state = State { is_shadow: header.is_shadow(), mesh, bytes: bytes.to_vec() };
        let pair = self.waiting.entry(header.tick).or_default();
        pair[side] = Some(state);
        if let [Some(old), Some(new)] = pair
            && old.is_shadow != new.is_shadow
        {
            let (is_alike, in_shadow) = (old.mesh == new.mesh, new.is_shadow);
            let found = is_alike.then(|| compare(kind, &old.bytes, &new.bytes));
            self.has_met = true;
            self.waiting.remove(&header.tick);
            if in_shadow && std::mem::take(&mut self.has_leapt) {
                (self.seen.outside, self.felt.outside) = (0, 0); // that was another line
            }
            match found {
                Some(found) => self.note(in_shadow, found.map(said)),
                None => self.note_apart(in_shadow),
            }
        }
        while self.waiting.len() > MOST_WAITING {
            self.waiting.pop_first();
        }
    }

    /// Two states of one tick have different meshes. In the shadow both are made of one state in one step, and a newcomer that makes another mesh of it again and
    /// again is out of tolerance. Who has the role goes on from his own: where something is cut he may have lost other ticks than the old engine, and have cut
    /// at another place.
    fn note_apart(&mut self, in_shadow: bool) {
        let apart = &mut self.apart[usize::from(in_shadow)];
        *apart += 1;
        if in_shadow && *apart >= MOST_UNLIKE {
            self.seen.note((f64::INFINITY, "the mesh that it makes of a state is another one than the old engine's".into()));
        }
    }

    /// Looks how long the steps of both sides are. Where they differ a newcomer may make states of other ticks than the old engine, and is out of tolerance
    /// then: however long it is waited for, there is nothing to compare.
    fn note_steps(&mut self, header: &StreamHeader, guest: u32) {
        let is_guest = header.incarnation == guest;
        if header.step_ticks == 0 || self.has_met {
            return; // nothing was computed for this tick, or they meet now and then
        }
        self.steps[usize::from(is_guest)] = header.step_ticks;
        let [old, new] = self.steps;
        if is_guest {
            self.unlike = if old == 0 || old == new { 0 } else { self.unlike + 1 };
        }
        if is_guest && self.unlike >= MOST_UNLIKE {
            let cure = "take the step of the state that it goes on from (`step_ticks` of its header)";
            let text =
                format!("its steps are of {new} ticks and the old engine's of {old}, and they have no tick in common; {cure}");
            self.seen.note((f64::INFINITY, text));
        }
    }

    /// Looks for leaps: an epoch of the newcomer's that does not begin with the next step, and a hole in what the old engine keeps beside it.
    fn follow(&mut self, header: &StreamHeader, guest: u32) {
        self.meshes[usize::from(header.incarnation == guest)] = header.topology_version;
        let step = u64::from(header.step_ticks);
        // Whoever begins an epoch goes on from what all have, and where he leaps they part.
        let begins = header.incarnation == guest && !header.is_shadow() && header.epoch > self.role.0;
        self.has_leapt = self.has_leapt && !begins;
        let leapt = match (header.incarnation == guest, header.is_shadow()) {
            (is_guest, false) => {
                // What an elder keeps beside the role begins anew after he has had it.
                self.line = if is_guest { self.line } else { 0 };
                let (epoch, tick) = self.role;
                let key = (header.epoch, header.tick);
                if key > self.role && is_guest != self.leads {
                    // Both go on from one state then.
                    (self.leads, self.seen.bad_of, self.felt.bad_of) = (is_guest, [0; 2], [0; 2]);
                }
                self.role = self.role.max(key);
                is_guest && epoch != 0 && header.epoch > epoch && header.tick > tick.saturating_add(step)
            }
            (false, true) => {
                let tick = self.line;
                self.line = tick.max(header.tick);
                let lost = LOST * step;
                let lost = if header.step_ticks <= SHORT_STEP_TICKS { lost.min(MOST_BEHIND_TICKS) } else { lost };
                tick != 0 && header.tick > tick.saturating_add(lost)
            }
            _ => false,
        };
        if leapt {
            self.part_at(header.tick);
        }
    }

    fn part_at(&mut self, tick: u64) {
        // An elder that is behind may tell of an older tick than what is waited for.
        (self.leapt, self.has_leapt) = (self.leapt.max(Some(tick)), true);
        self.waiting.clear();
    }

    /// Takes a contact model that was just read from the page of one side; compares as for states. Not each of them is seen: a page has the newest.
    fn take_model(&mut self, model: ContactModel, guest: u32) {
        let has_other_input = self.has_other_input((&model).into(), guest);
        if self.meshes[0] != self.meshes[1] {
            return self.models.clear(); // one side has cut, and the other one not yet
        }
        if has_other_input || self.leapt.is_some_and(|leapt| model.state_tick < leapt.saturating_add(FORGET_TICKS)) {
            return;
        }
        let pair = self.models.entry(model.state_tick).or_default();
        pair[usize::from(model.incarnation == guest)] = Some(model);
        if let [Some(old), Some(new)] = pair
            && (old.epoch == SHADOW_EPOCH) != (new.epoch == SHADOW_EPOCH)
        {
            let (found, in_shadow) = (compare_models(old, new), new.epoch == SHADOW_EPOCH);
            self.models.remove(&model.state_tick);
            self.felt.note_if(in_shadow != self.leads, said(found));
        }
        while self.models.len() > MOST_WAITING {
            self.models.pop_first();
        }
    }

    /// What was seen so far: as many pairs as there are of states, and of contact models too where there are any; and what is worse of both.
    fn seen(&self) -> Seen {
        let (states, felt) = (&self.seen, &self.felt);
        let worse = if (felt.outside, felt.ratio) > (states.outside, states.ratio) { felt } else { states };
        let of_both = |of: fn(&Seen) -> u64| if self.has_models { of(states).min(of(felt)) } else { of(states) };
        let (compared, good) = (of_both(|seen| seen.compared), of_both(|seen| seen.good));
        let mixed = if felt.has_too_many_bad() { felt } else { states };
        let (bad_of, flaw) = (mixed.bad_of, mixed.flaw.clone());
        let (worst, apart, leapt) = (states.worst.max(felt.worst), self.apart[0], self.has_leapt);
        Seen { compared, good, bad_of, flaw, worst, apart, leapt, ..worse.clone() }
    }

    /// One more pair, of a newcomer that is in the shadow or has the role: of those of before that changed nothing follows for what it does now.
    fn note(&mut self, in_shadow: bool, found: Result<(f64, String), hyst_messages::WireError>) {
        self.apart = [0; 2];
        let found = found.unwrap_or_else(|error| (f64::INFINITY, error.to_string()));
        self.seen.note_if(in_shadow != self.leads, found);
    }
}

/// How far apart two are, and in words.
fn said(found: Deviation) -> (f64, String) {
    (found.ratio(), format!("{} differ by {:.3e} {}, {:.3e} is allowed", found.what, found.by, found.unit, found.most))
}

/// The pages of a role's living incarnations, and how far each was read: the number of the contact model that was taken last, or the key after the last entry
/// of a ring.
#[derive(Default)]
pub(super) struct Pages(pub(super) BTreeMap<u32, (ReadPage, u64)>);

impl Pages {
    /// Opens those of newcomers, and drops those of the dead.
    pub(super) fn follow(&mut self, station: &Station, clock: &StationPage, role: Role) {
        let living: Vec<_> = clock.occupied(role).collect();
        self.0.retain(|incarnation, _| living.iter().any(|(_, lives)| lives == incarnation));
        for (slot, incarnation) in living {
            if !self.0.contains_key(&incarnation)
                && let Ok(page) = station.read_slot(slot, incarnation)
            {
                self.0.insert(incarnation, (page, 0));
            }
        }
    }

    /// The contact models that are new, each with its writer's own number in it.
    fn news(&mut self) -> impl Iterator<Item = ContactModel> + '_ {
        self.0.iter_mut().filter_map(|(incarnation, (page, seen))| {
            let number = page.cell_number(tissue::MODEL);
            let (number, model) = (number != *seen).then(|| page.cell(tissue::MODEL)).flatten()?;
            *seen = number;
            Some(ContactModel { incarnation: *incarnation, ..model })
        })
    }
}

/// Writes a line of what was seen; false if nobody reads it: the supervisor has gone, or needs no judge any more.
pub fn tell(seen: &Seen) -> Result<bool, String> {
    let line = serde_json::to_string(seen).map_err(|error| error.to_string())?;
    Ok(writeln!(std::io::stdout(), "{line}").and_then(|()| std::io::stdout().flush()).is_ok())
}

/// The helper itself: writes a line of JSON again and again until nobody reads it or the station stops.
pub fn judge(station: &Station, role: Role, guest: u32) -> Result<(), String> {
    // It takes a few hundredths of a core, and a state that it does not look at within two steps is lost to it. Refused: it compares fewer.
    system::be_nice(-19);
    let clock = station.open().map_err(|error| error.to_string())?;
    let links = Links::join(station, "judge").map_err(|error| error.to_string())?;
    let kind = *kinds_of(role).first().ok_or_else(|| format!("{} has no state", role.name()))?;
    let mut streams: BTreeMap<u32, Subscriber> = BTreeMap::new();
    let mut pairs = Pairs { has_models: role == Role::Tissue, ..Pairs::default() };
    let mut pages = Pages::default();
    let mut next_line_ns = 0;
    while !clock.stop_requested() {
        for stream in streams.values() {
            // Bounded by the reader's buffer; a stream that fails has lost its writer.
            while let Ok(Some(held)) = stream.next() {
                pairs.hear(kind, held.bytes(), stream.incarnation(), guest);
            }
        }
        if role == Role::Tissue {
            pages.news().for_each(|model| pairs.take_model(model, guest));
        }
        let now_ns = system::now_ns();
        if now_ns >= next_line_ns {
            next_line_ns = now_ns + LINE_NS;
            if !tell(&pairs.seen())? {
                return Ok(());
            }
            pages.follow(station, &clock, role);
            let living: Vec<u32> = clock.occupied(role).map(|(_, incarnation)| incarnation).collect();
            streams.retain(|incarnation, _| living.contains(incarnation));
            for incarnation in living {
                if !streams.contains_key(&incarnation)
                    && let Ok(stream) = links.subscriber(role, incarnation, kind)
                    && stream.connect().is_ok()
                {
                    streams.insert(incarnation, stream);
                }
            }
        }
        system::sleep_ns(LOOK_NS);
    }
    Ok(())
}
