//! By whom a recording and its replay were made: where they differ, whoever asked for them to be compared has to know whether the programs or the machines do.

use crate::swap;
use hyst_messages::Role;
use hyst_recording::{Event, SAID, Session};
use std::collections::BTreeMap;

/// Roles whose engines make what is compared.
const COMPARED: [Role; 5] = [Role::Device, Role::Haptic, Role::Tissue, Role::CollisionWorker, Role::Fluid];

/// That another build made the recording than did it again, in words; `None` where it is the same, or one of them does not say it.
pub fn other_build(recorded: &Session, again: &Session) -> Option<String> {
    let version = |session: &Session| session.get("version").map_or_else(String::new, |version| format!("{version} "));
    let (was, is) = (recorded.get("build")?, again.get("build")?);
    (was != is).then(|| format!("recorded by build {}{was}, this is {}{is}", version(recorded), version(again)))
}

/// That another processor made it, in words, likewise. All that have AVX2 give the same bits, and those that lack it, among themselves.
pub fn other_processor(recorded: &Session, again: &Session) -> Option<String> {
    let (was, is) = (recorded.get("cpu")?, again.get("cpu")?);
    let words = || {
        format!(
            "recorded on {was}, done again on {is}: where one of them lacks AVX2 their states differ; what was recorded without it is done again with \
             --set isa=baseline"
        )
    };
    (was != is).then(words)
}

/// That in the session other engines did such a role's work than it began with, in words; `None` where none was swapped in. By what its supervisor said.
pub fn other_engines(events: &[Event]) -> Option<String> {
    let mut since_ticks = BTreeMap::new();
    for event in events.iter().filter(|event| event.kind == SAID) {
        if let Some(role) = swap::taken_over(&event.text).filter(|role| COMPARED.contains(role)) {
            since_ticks.entry(role.name()).or_insert(event.tick);
        }
    }
    let told = |(role, tick): (&&str, &u64)| format!("{role} from {:.1} s on", *tick as f64 * 1e-3);
    let told: Vec<String> = since_ticks.iter().map(told).collect();
    let what = "a replay has this station's own engine, and what another one made otherwise is not the same";
    (!told.is_empty()).then(|| format!("swapped in the session: {}; {what}", told.join(", ")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_recording::Level;

    fn of(facts: &[(&str, &str)]) -> Session {
        facts.iter().map(|(name, value)| (name.to_string(), value.to_string())).collect()
    }

    #[test]
    fn another_build_is_named_and_the_same_one_or_one_that_is_not_known_is_not() {
        let (older, was) = (of(&[("version", "0.1.0")]), of(&[("version", "0.1.0"), ("build", "f00")]));
        let is = of(&[("version", "0.2.0"), ("build", "bad")]);
        assert_eq!(other_build(&was, &is).as_deref(), Some("recorded by build 0.1.0 f00, this is 0.2.0 bad"));
        assert_eq!([other_build(&was, &was), other_build(&older, &is), other_build(&was, &older)], [None, None, None]);
    }

    /// What a machine without AVX2 had recorded differed from its first states on, and nothing said why.
    #[test]
    fn another_processor_is_named_with_what_makes_its_bits_the_same() {
        let (was, is, older) = (of(&[("cpu", "QEMU Virtual CPU")]), of(&[("cpu", "EPYC")]), of(&[]));
        let said = other_processor(&was, &is).unwrap();
        assert!(["QEMU Virtual CPU", "EPYC", "isa=baseline"].iter().all(|word| said.contains(word)), "{said}");
        assert_eq!(
            [other_processor(&was, &was), other_processor(&older, &is), other_processor(&was, &older)],
            [None, None, None]
        );
    }

    /// A session in which an engine was swapped differed from there on, and nothing said why.
    #[test]
    fn engines_that_were_swapped_in_are_named_with_their_times_and_those_that_make_nothing_that_is_compared_are_not() {
        let said = |tick: u64, role: Role, step: &str| {
            let text = swap::line_of_step(3, role.name(), step);
            Event { tick, level: Level::Info, kind: SAID.into(), process: "supervisor".into(), incarnation: 0, text }
        };
        let tried =
            [said(900, Role::Tissue, "ready, and in the shadow of the old engine"), said(950, Role::Console, swap::IN_PLACE)];
        assert_eq!(other_engines(&tried), None);
        assert_eq!(other_engines(&[said(960, Role::Fluid, swap::AGREES)]), None, "it was undone before it had the role");
        let swapped = [
            said(1_200, Role::Tissue, swap::HAS_THE_ROLE),
            said(4_000, Role::Tissue, swap::DONE),
            said(5_000, Role::Haptic, swap::AGREES),
        ];
        let words = other_engines(&swapped).unwrap();
        assert!(words.starts_with("swapped in the session: haptic from 5.0 s on, tissue from 1.2 s on; a replay has"), "{words}");
        // What another process says in such words is no swap.
        assert_eq!(other_engines(&[Event { kind: "died".into(), ..swapped[0].clone() }]), None);
    }
}
