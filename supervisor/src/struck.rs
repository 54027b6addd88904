//! What came of asking for a fault: whom it hit, and when. The supervisor's answer, and how the command line says it.

use crate::doing::Doing;
use hyst_exchange::StationPage;
use hyst_messages::TICK_NS;
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// One process that was hit.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct Hit {
    /// Its place, as `status` names it.
    pub process: String,
    /// Its incarnation; 0 of those who keep the station.
    pub incarnation: u32,
    /// Its process id.
    pub pid: u32,
}

/// What was done. Whatever is missing in an answer an older build did not say, and what a newer one says beyond this is left out.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Struck {
    /// Whom it hit.
    pub victims: Vec<Hit>,
    /// In which tick of the station.
    pub tick: u64,
    /// How long after the tick had begun, µs, 0 to 999; 0 on a virtual clock.
    pub phase_us: u32,
    /// What the station was doing.
    pub doing: Option<Doing>,
    /// Why nothing may come of it.
    pub caution: Option<String>,
}

/// Why a fault was not done as it was asked for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NotDone {
    /// In words.
    pub reason: String,
    /// Some of those whom it was for were hit, and each of these has its fault; else nobody was.
    pub is_half: bool,
}

impl From<String> for NotDone {
    fn from(reason: String) -> NotDone {
        NotDone { reason, is_half: false }
    }
}

impl Struck {
    /// What was done at a time, ns.
    pub fn at(page: &StationPage, at_ns: u64, victims: Vec<Hit>) -> Struck {
        if page.is_lockstep() {
            return Struck { victims, tick: page.present_tick(), ..Struck::default() };
        }
        let tick = page.tick_at(at_ns);
        let in_tick_ns = at_ns.saturating_sub(page.start_of(tick)).min(TICK_NS - 1);
        Struck { victims, tick, phase_us: (in_tick_ns / 1_000) as u32, ..Struck::default() }
    }

    /// What a supervisor answers; `None` if it is of a build that says nothing of it.
    pub fn of_answer(answer: &Value) -> Option<Struck> {
        answer.get("victims")?;
        serde_json::from_value(answer.clone()).ok()
    }

    /// In words.
    pub fn line(&self, kind: &str) -> String {
        let name = |hit: &Hit| match hit.incarnation {
            0 => format!("{} (pid {})", hit.process, hit.pid),
            incarnation => format!("{} (incarnation {incarnation}, pid {})", hit.process, hit.pid),
        };
        let whom: Vec<String> = self.victims.iter().map(name).collect();
        format!("{kind}: {} at tick {}, {} us into it", whom.join(" and "), self.tick, self.phase_us)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn hit(process: &str, incarnation: u32) -> Hit {
        Hit { process: process.into(), incarnation, pid: 77 }
    }

    #[test]
    fn what_was_done_is_read_from_an_answer_and_an_older_build_that_says_nothing_did_not_hit_nobody_at_tick_0() {
        let struck = Struck {
            victims: vec![hit("tissue:1", 9)],
            tick: 1_234,
            phase_us: 301,
            doing: Some(Doing::default()),
            caution: Some("a spare".into()),
        };
        let mut answer = serde_json::to_value(&struck).unwrap();
        answer["weather"] = json!("fine");
        assert_eq!(Struck::of_answer(&answer), Some(struck.clone()), "a newer build says more");
        assert_eq!(Struck::of_answer(&json!({})), None);
        assert_eq!(struck.line("kill"), "kill: tissue:1 (incarnation 9, pid 77) at tick 1234, 301 us into it");
        let both = Struck { victims: vec![hit("guardian", 0), hit("supervisor", 0)], ..struck };
        assert!(both.line("stop").starts_with("stop: guardian (pid 77) and supervisor (pid 77) at"), "{}", both.line("stop"));
    }

    #[test]
    fn a_moment_is_a_tick_and_a_place_in_it() {
        let station = hyst_exchange::Station::named(&format!("t{}-struck", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        let page = station.open().unwrap();
        let at = |at_ns: u64| Struck::at(&page, at_ns, Vec::new());
        let struck = at(page.start_of(4_321) + 300_999);
        assert_eq!((struck.tick, struck.phase_us), (4_321, 300));
        let struck = at(page.start_of(4_322) - 1);
        assert_eq!((struck.tick, struck.phase_us), (4_321, 999));
        assert_eq!(page.start_of(u64::MAX), u64::MAX, "whoever asks for that tick is told that it is far ahead");
        station.wipe();
    }
}
