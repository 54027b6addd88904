//! What is read of the tissues: their states and topologies, and which of these can be.
//!
//! Promise: in use is the newest state that can be and whose topology is there; it has its topology until another one is used, whatever its source sends
//! meanwhile. One that cannot be, or whose topology cannot, is refused and counted, and the one before stays in use with its tick; no step waits for what was
//! refused.

#[cfg(test)]
mod tests;

use hyst_engine::{Failure, Life};
use hyst_exchange::usher::Departure;
use hyst_exchange::{Held, Horizon, Roster, Subscriber};
use hyst_messages::page::device::Distrust;
use hyst_messages::page::{header, station};
use hyst_messages::{Kind, Message, Role, topology_is_sound};

/// No node of a patient's organ is farther from the pivot, m.
const FARTHEST_M: f32 = 10.0;
/// Tissues whose streams are read: holder, spare and a newcomer on trial.
const TISSUES: usize = 3;

/// The tissues.
pub(super) struct Tissues {
    sources: [Source; TISSUES],
    /// Who holds their role, and how far its states can have come.
    roster: Roster,
    horizon: Horizon,
    in_use: Option<Held>,
    /// The topology of the state in use, where its source has sent another one since.
    kept: Option<Held>,
    /// A newer state, whose topology is not there yet.
    awaited: Option<Held>,
    /// The latest tick of which a state was not taken.
    refused_tick: Option<u64>,
}

/// The streams of one of them.
#[derive(Default)]
struct Source {
    states: Option<Subscriber>,
    topologies: Option<Subscriber>,
    /// Its newest topology that can be.
    topology: Option<Held>,
    refused: Refused,
}

/// What was refused of a tissue's topologies since the last that can be.
#[derive(Clone, Copy, Default)]
enum Refused {
    #[default]
    Nothing,
    /// One of this version.
    Version(u32),
    /// One that does not even say of which version it is.
    Unreadable,
}

/// What a state is to who has one in use.
enum Found {
    /// One to go over to, of this epoch and tick.
    Newer((u32, u64)),
    /// An older one, or one that was computed beside the role.
    Other,
    /// One of a later tick, this one, under an epoch before: nobody goes on from it.
    Fenced(u64),
    /// One that cannot be; its tick, where it says one that can.
    Unfit(Option<u64>),
}

impl Tissues {
    /// None yet.
    pub(super) fn new(life: &Life) -> Result<Tissues, Failure> {
        let (roster, horizon) = (Roster::open(&life.station)?, Horizon::open(&life.station, Role::Tissue)?);
        Ok(Tissues { sources: Default::default(), roster, horizon, in_use: None, kept: None, awaited: None, refused_tick: None })
    }

    /// Takes the stream of a new incarnation in a tissue's place; gives back the one before.
    pub(super) fn replace(&mut self, index: usize, kind: Kind, stream: Subscriber) -> Option<Departure> {
        let source = self.sources.get_mut(index)?;
        let place = if kind == Kind::TissueState { &mut source.states } else { &mut source.topologies };
        if kind == Kind::Topology {
            source.refused = Refused::Nothing; // that was another one's
        }
        place.replace(stream).map(Departure::Stream)
    }

    /// Takes the newest state and topology; `step_ticks` is the reader's step.
    pub(super) fn receive(&mut self, life: &Life, step_ticks: u64) {
        let (roster, horizon) = (&self.roster, &self.horizon);
        let is_ahead = |found: (u32, u64)| horizon.is_passed_by(found, step_ticks, &life.clock);
        let version_in_use = self.in_use.as_ref().and_then(version_of);
        let mut key = self.awaited.as_ref().or(self.in_use.as_ref()).and_then(key_of);
        for source in &mut self.sources {
            let newest = source.states.as_ref().and_then(|stream| Some((stream.incarnation(), stream.newest().ok()??)));
            if let Some((tissue, held)) = newest {
                match found(&held, key, &is_ahead) {
                    Found::Newer(newer) => (key, self.awaited) = (Some(newer), Some(held)),
                    Found::Other => {}
                    Found::Fenced(tick) => self.refused_tick = self.refused_tick.max(Some(tick)),
                    Found::Unfit(tick) => {
                        life.page.add64(header::INVALID, 1);
                        // Without a tick it is that of the holder's last step, which it has sent before the sequencer says its tick.
                        let is_holders = || tissue == roster.holder(Role::Tissue).incarnation;
                        let last_tick = || is_holders().then(|| life.clock.page().load64(station::TISSUE_TICK));
                        self.refused_tick = self.refused_tick.max(tick.or_else(last_tick));
                    }
                }
            }
            let before = source.take_topology(life);
            let is_in_use =
                |held: &Held| version_in_use.is_some_and(|version| Message::topology(held.bytes(), version).is_some());
            self.kept = before.filter(is_in_use).or(self.kept.take());
        }
        self.go_over();
    }

    /// Goes over to the newest state once its topology is there. One whose topology was refused is refused, too.
    fn go_over(&mut self) {
        let Some(held) = self.awaited.take() else { return };
        let Ok(state) = Message::parse(held.bytes(), Kind::TissueState) else { return };
        let header = *state.header();
        if self.topology_of(&state).is_some() {
            let is_its = |kept: &Held| Message::topology(kept.bytes(), header.topology_version).is_some();
            (self.in_use, self.kept) = (Some(held), self.kept.take().filter(is_its));
        } else if self.sources.iter().any(|source| source.has_refused(header.incarnation, header.topology_version)) {
            self.refused_tick = self.refused_tick.max(Some(header.tick));
        } else {
            self.awaited = Some(held);
        }
    }

    /// The state in use and its topology.
    pub(super) fn newest(&self) -> Option<(Message<'_>, Message<'_>)> {
        let state = Message::parse(self.in_use.as_ref()?.bytes(), Kind::TissueState).ok()?;
        Some((state, self.topology_of(&state)?))
    }

    /// The topology that a state is of, from whichever tissue has sent it.
    fn topology_of(&self, state: &Message<'_>) -> Option<Message<'_>> {
        let version = state.header().topology_version;
        let mut all = self.sources.iter().filter_map(|source| source.topology.as_ref()).chain(&self.kept);
        all.find_map(|held| Message::topology(held.bytes(), version))
    }

    /// Whether the state of a tick has come, whatever came of it: where it was refused none other comes for it, and the one before is in use.
    pub(super) fn have_reached(&self, tick: u64) -> bool {
        let in_use = self.in_use.as_ref().and_then(key_of).map(|(_, tick)| tick);
        in_use.max(self.refused_tick).is_some_and(|reached| reached >= tick)
    }
}

impl Source {
    /// Takes its newest topology, and gives the one before. One that cannot be is left, and who sent it is named: what is made of one (wounds, holes) stands
    /// until the next version. A stream keeps one alone, its newest, and lends three at a time: the one in use, the one before this, and this.
    fn take_topology(&mut self, life: &Life) -> Option<Held> {
        let newest = self.topologies.as_ref().and_then(|stream| Some((stream.incarnation(), stream.next().ok()??)));
        match newest {
            Some((_, held)) if topology_is_sound(held.bytes()) => {
                self.refused = Refused::Nothing;
                self.topology.replace(held)
            }
            Some((tissue, held)) => {
                let read = Message::parse(held.bytes(), Kind::Topology);
                self.refused = read.map_or(Refused::Unreadable, |read| Refused::Version(read.header().topology_version));
                life.refuse(tissue, Distrust::Invalid);
                None
            }
            None => None,
        }
    }

    /// Whether the topology of a version of this tissue's was refused.
    fn has_refused(&self, tissue: u32, version: u32) -> bool {
        let is_its = self.topologies.as_ref().is_some_and(|stream| stream.incarnation() == tissue);
        is_its
            && match self.refused {
                Refused::Nothing => false,
                Refused::Version(refused) => refused == version,
                Refused::Unreadable => true,
            }
    }
}

/// What a state is to who has one of this key, if any.
fn found(held: &Held, key: Option<(u32, u64)>, is_ahead: &impl Fn((u32, u64)) -> bool) -> Found {
    let Ok(state) = Message::parse(held.bytes(), Kind::TissueState) else { return Found::Unfit(None) };
    let (epoch, tick) = (state.header().epoch, state.header().tick);
    match () {
        () if state.header().is_shadow() => Found::Other,
        () if is_ahead((epoch, tick)) => Found::Unfit(None),
        () if key.is_some_and(|key| epoch < key.0 && tick > key.1) => Found::Fenced(tick),
        () if Some((epoch, tick)) <= key => Found::Other,
        () if !is_sane(&state) => Found::Unfit(Some(tick)),
        () => Found::Newer((epoch, tick)),
    }
}

/// Whether a state has what the walls are made of, and its nodes are where an organ can be.
fn is_sane(state: &Message<'_>) -> bool {
    let places = |index: usize| state.section::<[f32; 3]>(index);
    let is_near = |nodes_m: &[[f32; 3]]| nodes_m.as_flattened().iter().fold(true, |all, value| all & (value.abs() <= FARTHEST_M));
    places(1).is_ok_and(is_near) && places(2).is_ok() && places(3).is_ok()
}

/// Epoch and tick of a held state.
fn key_of(held: &Held) -> Option<(u32, u64)> {
    let header = *Message::parse(held.bytes(), Kind::TissueState).ok()?.header();
    Some((header.epoch, header.tick))
}

/// Version of the topology that a held state is of.
fn version_of(held: &Held) -> Option<u32> {
    Message::parse(held.bytes(), Kind::TissueState).ok().map(|state| state.header().topology_version)
}
