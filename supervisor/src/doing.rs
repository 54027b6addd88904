//! What a station is doing, as a tester names it, read from its pages: whoever asks for a fault in a state waits for it, and says whether the station was
//! still in it when the fault came.

use crate::campaign::cell::State;
use crate::plan::Plan;
use crate::policy;
use crate::swap::{self, Record};
use crate::view::Viewer;
use hyst_exchange::Station;
use hyst_messages::page::station as layout;
use hyst_messages::{Role, Slot};
use serde::{Deserialize, Serialize};

/// What a station does at a time.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct Doing {
    /// Each of its processes is there and warm or live.
    pub whole: bool,
    /// Somebody has died and is not back: not one whose place was given up, or is emptied by a swap, and nobody in a station that only starts.
    pub recovers: bool,
    /// Contacts of the tool; `None` if no tissue says it.
    pub contacts: Option<u32>,
    /// The electrode is out and its current on; for who has looked for a while ([`Strokes`]), it cuts tissue, too.
    pub cutting: bool,
    /// The role of the swap that is under way.
    pub swap: Option<String>,
    /// The roles that are handed over by themselves.
    pub handover: Vec<String>,
}

impl Doing {
    /// Of a station with these slots.
    pub fn of(station: &Station, slots: &[Slot], viewer: &mut Viewer) -> Doing {
        let swap = Record::read(station).filter(|record| record.promoted.is_none()).map(|record| record.role);
        let status = viewer.tissue_status();
        let ill: Vec<Slot> = slots.iter().copied().filter(|slot| !viewer.is_well(*slot)).collect();
        let is_swapped = |slot: &Slot| swap.as_deref() == Some(slot.role().name());
        Doing {
            whole: !slots.is_empty() && ill.is_empty(),
            recovers: ill.iter().any(|slot| !is_swapped(slot) && comes_back(*slot, viewer)),
            contacts: status.map(|status| status.contact_count),
            cutting: status.is_some_and(|status| status.is_cutting != 0),
            swap,
            handover: Role::REPLICATED
                .into_iter()
                .filter(|role| is_handed_over(*role, viewer))
                .map(|role| role.name().into())
                .collect(),
        }
    }

    /// The same for who looks again and again, and waits for a stroke that cuts.
    pub fn watched(station: &Station, slots: &[Slot], viewer: &mut Viewer, strokes: &mut Strokes) -> Doing {
        let doing = Doing::of(station, slots, viewer);
        let cuts = viewer.tissue_status().is_some_and(|status| strokes.cut(status.cuts, status.state_tick));
        Doing { cutting: doing.cutting && cuts, ..doing }
    }

    /// Of a station that one looks at only now; `None` if it cannot be looked at.
    pub fn now(station: &Station) -> Option<Doing> {
        let (plan, mut viewer) = (Plan::read(station).ok()?, Viewer::open(station).ok()?);
        Some(Doing::of(station, &plan.slots(), &mut viewer))
    }
}

/// Longest time between two cuts of a stroke, ticks: a loop that is drawn through tissue at 6 mm/s divides it anew within 0.1 s. A look that comes later
/// than that after the one before does not know when the cuts came that it sees.
const STROKE_TICKS: u64 = 150;

/// What a station's electrode has cut, for who looks again and again. A current that is on tells nothing: it may be on in the open medium.
#[derive(Clone, Copy, Debug, Default)]
pub struct Strokes {
    /// Cuts at the last look, and its tick.
    seen: Option<(u32, u64)>,
    cut_tick: Option<u64>,
}

impl Strokes {
    /// Whether the mesh was divided a moment ago: with so many cuts by this tick.
    pub fn cut(&mut self, cuts: u32, tick: u64) -> bool {
        let is_recent = |then: u64| tick.saturating_sub(then) <= STROKE_TICKS;
        if self.seen.is_some_and(|(before, at)| cuts > before && is_recent(at)) {
            self.cut_tick = Some(tick);
        }
        self.seen = Some((cuts, tick));
        self.cut_tick.is_some_and(is_recent)
    }
}

/// Whether a place that is not well has lost somebody, and another one is to come.
fn comes_back(slot: Slot, viewer: &Viewer) -> bool {
    let page = viewer.page();
    let has_lost = page.is_dead(slot) || page.page().load64(layout::SLOT_RESTARTS + slot.number()) > 0;
    has_lost && !record(slot, viewer).given_up
}

/// Whether who does a role's work is to be replaced, or was, and nobody is ready in its place yet. Of servos either of the two, and
/// until its successor is out of its shadow: the device takes nothing of that one before.
pub fn is_handed_over(role: Role, viewer: &Viewer) -> bool {
    let slots = (0..role.slots().1).filter_map(|index| Slot::new(role, index));
    slots.filter(|slot| !slot.is_guest()).any(|slot| record(slot, viewer).hands_over)
}

/// What the supervisor remembers of a place.
fn record(slot: Slot, viewer: &Viewer) -> policy::Record {
    policy::Record::of_word(viewer.page().page().load32(layout::SLOT_RECORD + slot.number()))
}

/// The state that a tester waits for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wanted {
    state: State,
    /// In a swap or a hand-over: of this role alone.
    role: Option<Role>,
}

impl Wanted {
    /// Reads `contact`, `swap`, `swap:fluid`, or `handover:tissue`.
    pub fn parse(text: &str) -> Result<Wanted, String> {
        match text.split_once(':') {
            Some(("swap", role)) => Ok(Wanted { state: State::Swap, role: Some(swap::role_of(role)?) }),
            Some(("handover", name)) => {
                let role = Role::REPLICATED.into_iter().find(|role| role.name() == name);
                let role = role.ok_or_else(|| format!("{name:?}: there is a hand-over of haptic, tissue or fluid"))?;
                Ok(Wanted { state: State::Handover, role: Some(role) })
            }
            _ => Ok(Wanted { state: State::parse(text)?, role: None }),
        }
    }

    /// Whether the station is in it.
    pub fn is_in(self, doing: &Doing) -> bool {
        match self.state {
            State::Any => true,
            State::Idle => doing.whole && doing.contacts == Some(0),
            State::Contact => doing.whole && doing.contacts.is_some_and(|contacts| contacts > 0),
            State::Cutting => doing.whole && doing.cutting,
            State::Recovery => doing.recovers,
            State::Swap => doing.swap.as_deref().is_some_and(|swapped| self.is_of(swapped)),
            State::Handover => doing.handover.iter().any(|handed| self.is_of(handed)),
        }
    }

    fn is_of(self, name: &str) -> bool {
        self.role.is_none_or(|role| role.name() == name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::faults::tests::begin;
    use hyst_messages::page::ProcessState;

    #[test]
    fn a_state_is_waited_for_by_its_name_and_a_swap_or_a_hand_over_by_its_role_too() {
        let is_in = |text: &str, doing: &Doing| Wanted::parse(text).unwrap().is_in(doing);
        let touches = Doing { whole: true, contacts: Some(2), swap: Some("fluid".into()), ..Doing::default() };
        let names = ["any", "idle", "contact", "cutting", "recovery", "swap", "swap:fluid", "swap:tissue"];
        let found = |doing: &Doing| names.map(|name| is_in(name, doing));
        assert_eq!(found(&touches), [true, false, true, false, false, true, true, false]);
        let hurt = Doing { recovers: true, whole: false, swap: None, ..touches };
        assert_eq!(found(&hurt), [true, false, false, false, true, false, false, false]);
        let silent = Doing { whole: true, ..Doing::default() };
        assert_eq!([is_in("idle", &silent), is_in("contact", &silent)], [false; 2], "no tissue has said anything");
        let names = ["handover", "handover:tissue", "handover:haptic", "recovery"];
        let handed = Doing { handover: vec!["fluid".into(), "tissue".into()], ..Doing::default() };
        assert_eq!(names.map(|name| is_in(name, &handed)), [true, true, false, false]);
        assert_eq!(names.map(|name| is_in(name, &hurt)), [false, false, false, true]);
        for bad in ["dancing", "swap:", "swap:liver", "swap:supervisor", "contact:fluid", "handover:", "handover:device"] {
            assert!(Wanted::parse(bad).is_err(), "{bad}");
        }
    }

    /// A campaign of cuts waited for the current alone, which the hand had on where the polyp had been: 168 faults met none.
    #[test]
    fn a_stroke_is_one_that_divides_the_mesh_now() {
        let mut strokes = Strokes::default();
        let mut cut = |cuts: u32, tick: u64| strokes.cut(cuts, tick);
        assert!(!cut(12, 1_000), "the first look does not know when they came");
        assert!(!cut(12, 1_005), "in the open medium");
        assert!(cut(13, 1_010) && cut(13, 1_010 + STROKE_TICKS));
        assert!(!cut(13, 1_011 + STROKE_TICKS), "it has come out of the tissue");
        assert!(!cut(14, 5_000), "nobody looked for a while");
        assert!(!cut(14, 5_010) && cut(15, 5_020));
    }

    /// A station that only started was taken for one in a recovery, and so was one with a place that had been given up, for good.
    #[test]
    fn who_starts_for_the_first_time_and_who_was_given_up_are_no_recovery() {
        let station = Station::named(&format!("t{}-doing", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        let page = station.open_for_keeping().unwrap();
        let slots = [0, 1].map(|index| Slot::new(Role::Tissue, index).unwrap());
        let own = slots.map(|slot| begin(&station, &page, slot, 1));
        let mut viewer = Viewer::open(&station).unwrap();
        let mut seen = || {
            let doing = Doing::of(&station, &slots, &mut viewer);
            (doing.whole, doing.recovers)
        };
        assert_eq!(seen(), (false, false), "they start");
        own.iter().for_each(|own| own.set_state(ProcessState::Live));
        assert_eq!(seen(), (true, false));
        let second = slots[1].number();
        page.store32(layout::SLOT_DEAD + second, 1);
        assert_eq!(seen(), (false, true));
        let remember = |record: policy::Record| page.store32(layout::SLOT_RECORD + second, record.word());
        remember(policy::Record { short_lives: 8, given_up: true, ..policy::Record::default() });
        assert_eq!(seen(), (false, false), "nobody is to come");
        let is_handed = || [Role::Haptic, Role::Tissue].map(|role| is_handed_over(role, &Viewer::open(&station).unwrap()));
        assert_eq!(is_handed(), [false; 2]);
        remember(policy::Record { short_lives: 8, hands_over: true, ..policy::Record::default() });
        assert_eq!((seen(), is_handed()), ((false, true), [false, true]), "who had the role is to come back");
        station.wipe();
    }
}
