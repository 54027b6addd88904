//! Whether a station on a virtual clock still goes on. There a tick lasts until everybody has done his part of it, and who waits in vain for what another is
//! to make waits for [`PATIENCE_NS`] of wall time, again in each tick: with one engine that makes nothing more, seconds of a replay take days.
//!
//! Promise: a pure function of what is seen. Where steps are made nothing stands still, however slow the machine is; and every station that stands still is
//! found within minutes.

use hyst_engine::Silence;
use hyst_engine::lockstep::PATIENCE_NS;
use hyst_messages::{Role, fnv_words};

/// Of the time between two looks at most so much counts, ns: they come ten times a second, and a longer pause is the whole machine's.
const MOST_BETWEEN_NS: u64 = 1_000_000_000;
/// A silence of all who step that counts, ns: somebody waits for his whole patience, of which a judge on a busy machine may see a part. No step, and no
/// start of a successor, takes so long.
const SILENT_NS: u64 = PATIENCE_NS / 3 * 2;
/// So long such silences last together before the station stands still, ns: one of them may be the end of an engine, from which its successor goes on.
const MOST_SILENT_NS: u64 = 4 * SILENT_NS;
/// After so many ticks without one those before count no longer: a flow that waits in vain does so in each of its periods, which are some tens of ticks.
const FORGOTTEN_TICKS: u64 = 1_000;

/// What is seen of a station at a look.
#[derive(Clone, Copy, Debug, Default)]
pub struct Seen {
    /// The tick that was ended last.
    pub tick: u64,
    /// Steps of all who step by the virtual clock.
    pub steps: u64,
    /// Whether the sequencer may begin another tick; while it holds, that has a bound of its own.
    pub may_go_on: bool,
    /// The role that is held still, if one is.
    pub held: Option<Role>,
}

/// Why a station is to end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Standstill {
    /// In a replay: no state of this role comes any more that could be the recorded one.
    Held(Role),
    /// Nobody has made a step for so long, ns, in all.
    Silent(u64),
}

/// How a station gets on.
#[derive(Clone, Copy, Debug)]
pub struct Progress {
    is_replay: bool,
    silence: Silence,
    /// How long the silences lasted that are over and count, ns, and the tick of the last.
    over: (u64, u64),
}

impl Progress {
    /// Of a station, from a time on.
    pub fn new(is_replay: bool, now_ns: u64) -> Progress {
        Progress { is_replay, silence: Silence::new(now_ns, MOST_BETWEEN_NS), over: (0, 0) }
    }

    /// Whether the station does a recording again.
    pub fn is_replay(&self) -> bool {
        self.is_replay
    }

    /// Looks; gives why the station is to end, if it is.
    pub fn look(&mut self, now_ns: u64, seen: &Seen) -> Option<Standstill> {
        if let Some(role) = seen.held.filter(|_| self.is_replay) {
            return Some(Standstill::Held(role));
        }
        let before_ns = self.silence.ns();
        let silent_ns = self.silence.look(now_ns, fnv_words(0, [seen.tick, seen.steps]));
        if silent_ns < before_ns && before_ns >= SILENT_NS {
            self.over = (self.over.0 + before_ns, seen.tick);
        } else if seen.tick > self.over.1 + FORGOTTEN_TICKS {
            self.over = (0, seen.tick);
        }
        if !seen.may_go_on {
            self.silence = Silence::new(now_ns, MOST_BETWEEN_NS);
            return None;
        }
        let all_ns = self.over.0 + if silent_ns >= SILENT_NS { silent_ns } else { 0 };
        (all_ns >= MOST_SILENT_NS).then_some(Standstill::Silent(all_ns))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: u64 = 1_000_000_000;
    /// Between two looks, ns.
    const LOOK_NS: u64 = S / 10;

    /// Looks for so long at a station of which this is seen after so many ns; gives what was found, and after how many s.
    fn watch(is_replay: bool, for_s: u64, look_ns: u64, seen: impl Fn(u64) -> Seen) -> Option<(Standstill, u64)> {
        let mut progress = Progress::new(is_replay, 7 * S);
        (0..for_s * S / look_ns).find_map(|look| {
            let passed_ns = look * look_ns;
            progress.look(7 * S + passed_ns, &seen(passed_ns)).map(|found| (found, passed_ns / S))
        })
    }

    fn at(tick: u64) -> Seen {
        Seen { tick, steps: 5 * tick, may_go_on: true, held: None }
    }

    /// Its states are those that it had: nobody says what the recording says.
    #[test]
    fn a_replay_of_which_a_role_is_held_still_ends_at_once_and_a_run_goes_on() {
        let held = |ns: u64| Seen { held: (ns >= 3 * S).then_some(Role::Tissue), ..at(ns / 1_000_000) };
        assert_eq!(watch(true, 60, LOOK_NS, held), Some((Standstill::Held(Role::Tissue), 3)));
        assert_eq!(watch(false, 600, LOOK_NS, held), None);
    }

    #[test]
    fn ticks_that_each_wait_in_vain_end_the_station_and_so_does_one_that_never_ends() {
        let in_vain = |ticks: u64| move |ns: u64| at(100 + ticks * (ns / PATIENCE_NS));
        for (what, found) in [
            ("a device, in each tick", watch(true, 600, LOOK_NS, in_vain(1))),
            ("a flow, in each of its periods", watch(false, 600, LOOK_NS, in_vain(33))),
            ("none ends", watch(true, 600, LOOK_NS, in_vain(0))),
        ] {
            let (stands, after_s) = found.unwrap_or_else(|| panic!("{what}: it waits for ever"));
            assert!(matches!(stands, Standstill::Silent(ns) if ns >= MOST_SILENT_NS), "{what}: {stands:?}");
            assert!((MOST_SILENT_NS / S..150).contains(&after_s), "{what}: after {after_s} s");
        }
    }

    #[test]
    fn a_slow_machine_a_paused_one_a_sequencer_that_holds_and_single_long_silences_end_nothing() {
        let slow = |ns: u64| at(ns / (15 * S));
        assert_eq!(watch(true, 6_000, LOOK_NS, slow), None, "a tick takes 15 s");
        let one_by_one = |ns: u64| Seen { steps: ns / (15 * S), ..at(4) };
        assert_eq!(watch(true, 600, LOOK_NS, one_by_one), None, "one tick, in which a step is made each 15 s");
        assert_eq!(watch(true, 3_600, 60 * S, |_| at(4)), None, "nobody was let run, nor was who looks");
        let holds = |_| Seen { may_go_on: false, ..at(4) };
        assert_eq!(watch(true, 600, LOOK_NS, holds), None, "it waits until all are ready");
        // A hang, from which somebody goes on, each 2 000 ticks.
        let hangs = |ns: u64| at(2_000 * (ns / (32 * S)) + (ns % (32 * S)).min(2 * S) * 1_000 / S);
        assert_eq!(watch(true, 3_600, LOOK_NS, hangs), None);
    }
}
