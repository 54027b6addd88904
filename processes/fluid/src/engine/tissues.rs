//! What is read of the tissues: their states and topologies, and which of these can be.

use hyst_engine::Life;
use hyst_exchange::{Held, Subscriber};
use hyst_messages::page::device::Distrust;
use hyst_messages::{Kind, Message, topology_is_sound};

/// No node of a patient's organ is farther from the pivot, m.
const FARTHEST_M: f32 = 10.0;
/// Tissues whose streams are read: holder, spare and a newcomer on trial.
pub(super) const TISSUES: usize = 3;

/// The streams of one of them.
#[derive(Default)]
pub(super) struct TissueSource {
    pub(super) states: Option<Subscriber>,
    pub(super) topologies: Option<Subscriber>,
    /// Its newest topology.
    pub(super) topology: Option<Held>,
}

impl TissueSource {
    /// Takes its newest topology. One that cannot be is left, and who sent it is named: what is made of one (wounds, holes) stands until the next version.
    pub(super) fn take_topology(&mut self, life: &Life) {
        let newest = self.topologies.as_ref().and_then(|stream| Some((stream.incarnation(), stream.newest().ok()??)));
        match newest {
            Some((_, held)) if topology_is_sound(held.bytes()) => self.topology = Some(held),
            Some((tissue, _)) => life.refuse(tissue, Distrust::Invalid),
            None => {}
        }
    }
}

/// The topology that a state of the tissue is of, from whichever tissue has sent it.
pub(super) fn topology_of<'a>(sources: &'a [TissueSource], state: &Message<'_>) -> Option<Message<'a>> {
    let version = state.header().topology_version;
    let mut all = sources.iter().filter_map(|source| source.topology.as_ref());
    all.find_map(|held| Message::topology(held.bytes(), version))
}

/// Whether a tissue's nodes are where an organ can be; the walls stay as they are until they are again.
pub(super) fn positions_are_sane(held: &Held) -> bool {
    let message = Message::parse(held.bytes(), Kind::TissueState);
    let positions = message.and_then(|message| message.section::<f32>(1));
    positions.is_ok_and(|values| values.iter().fold(true, |all, value| all & (value.abs() <= FARTHEST_M)))
}

/// Epoch and tick of a held state, if it is one of the role's.
pub(super) fn key_of(held: &Held) -> Option<(u32, u64)> {
    let header = *Message::parse(held.bytes(), Kind::TissueState).ok()?.header();
    (!header.is_shadow()).then_some((header.epoch, header.tick))
}
