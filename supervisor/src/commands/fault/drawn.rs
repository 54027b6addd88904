//! What `--seed` draws of a fault's moment where nobody says it: with the generator of a campaign's plan, and from the same ranges.

use crate::campaign::draw::{Draw, GAP_TICKS};
use crate::cli::InjectArgs;
use crate::faultfile::FaultKind;
use crate::settings::Refusal;
use serde::Serialize;

/// What was drawn. A seed has one tick and one phase: its phase is the same where the tick is said.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub(super) struct Drawn {
    /// From what.
    pub seed: u64,
    /// So many ticks after it was asked for; none where the tick, or a state, is said.
    pub ahead_ticks: Option<u64>,
    /// Which tick of the station that is, once it is known.
    pub tick: Option<u64>,
    /// Place in the tick, µs.
    pub phase_us: u32,
}

impl Drawn {
    /// What is to be drawn for a command; `None` if nothing is. The seed of `corrupt` is that of its bytes. One that nothing is drawn from is refused.
    pub(super) fn of(args: &InjectArgs, kind: FaultKind) -> Result<Option<Drawn>, Refusal> {
        let Some(seed) = args.seed.filter(|_| kind != FaultKind::Corrupt) else { return Ok(None) };
        if args.phase_us.is_some() {
            // A phase comes with a tick or a state: the moment is said.
            return Err(nothing_to_draw(args, seed, kind));
        }
        let is_said = args.tick.is_some() || args.state.is_some();
        let (ahead_ticks, phase_us) = Draw::new(seed).moment(GAP_TICKS);
        Ok(Some(Drawn { seed, ahead_ticks: (!is_said).then_some(ahead_ticks), tick: None, phase_us }))
    }

    /// The drawn tick as `--tick` takes it.
    pub(super) fn tick_words(self) -> Option<String> {
        self.ahead_ticks.map(|ticks| format!("+{ticks}"))
    }

    /// In words, after what else is said of the fault: with which options it comes at the same moment again.
    pub(super) fn line(self) -> String {
        let Drawn { seed, phase_us, .. } = self;
        let ahead = self.tick_words().map(|words| format!("--tick {words} ")).unwrap_or_default();
        let tick = self.tick.map(|tick| format!(" (tick {tick})")).unwrap_or_default();
        format!("; drawn from seed {seed}: {ahead}--phase {phase_us}{tick}")
    }
}

fn nothing_to_draw(args: &InjectArgs, seed: u64, kind: FaultKind) -> Refusal {
    let said = if args.tick.is_some() { "--tick" } else { "--state" };
    Refusal::input(format!(
        "--seed {seed}: {said} and --phase say the moment, and of {} nothing else is drawn; leave out --phase, or --seed",
        kind.name()
    ))
}

#[cfg(test)]
mod tests {
    use super::super::injection;
    use super::*;
    use crate::cli::{Cli, Command, FaultCommand};
    use clap::Parser;
    use std::collections::BTreeSet;

    fn args(words: &str) -> InjectArgs {
        let line = format!("hystation fault inject {words}");
        match Cli::try_parse_from(line.split_whitespace()).map(|cli| cli.command) {
            Ok(Command::Fault { command: FaultCommand::Inject(args) }) => *args,
            other => panic!("{words}: {other:?}"),
        }
    }

    fn drawn(words: &str) -> Result<Option<Drawn>, Refusal> {
        let args = args(words);
        Drawn::of(&args, FaultKind::from_name(&args.kind).unwrap())
    }

    #[test]
    fn a_seed_draws_one_moment_and_others_draw_others_and_without_one_nothing_is_drawn() {
        for words in ["", "--tick +9", "--tick +9 --phase 300", "--state idle", "--state idle --phase 0"] {
            assert_eq!(drawn(&format!("kill tissue {words}")), Ok(None), "{words}");
        }
        let moment = |seed: u64| {
            let drawn = drawn(&format!("kill tissue --seed {seed}")).unwrap().unwrap();
            assert_eq!((drawn.seed, drawn.tick), (seed, None));
            (drawn.ahead_ticks.unwrap(), drawn.phase_us)
        };
        assert_eq!([moment(7), moment(8), moment(7)], [(912, 16), (1_095, 611), (912, 16)]);
        let all: Vec<(u64, u32)> = (0..200).map(moment).collect();
        assert_eq!(all.iter().collect::<BTreeSet<_>>().len(), 200);
        assert!(all.iter().all(|(ticks, phase_us)| (GAP_TICKS[0]..=GAP_TICKS[1]).contains(ticks) && *phase_us < 1_000));
        // Both come from everywhere in their range.
        assert!((6..14).all(|hundred| all.iter().any(|(ticks, _)| ticks / 100 == hundred)), "{all:?}");
        assert!((0..10).all(|hundred| all.iter().any(|(_, phase_us)| phase_us / 100 == hundred)), "{all:?}");
    }

    #[test]
    fn what_is_said_of_the_moment_is_not_drawn_and_a_seed_for_nothing_is_refused() {
        let phase_alone = Drawn { seed: 7, ahead_ticks: None, tick: None, phase_us: 16 };
        for words in ["--tick +9", "--tick 90000", "--state cutting", "--state swap:fluid --within 5m"] {
            assert_eq!(drawn(&format!("kill tissue --seed 7 {words}")), Ok(Some(phase_alone)), "{words}");
        }
        for (said, word) in [("--tick", "+9"), ("--state", "idle")] {
            let refusal = drawn(&format!("kill tissue --seed 7 {said} {word} --phase 0")).unwrap_err();
            let is_clear = refusal.message.starts_with(&format!("--seed 7: {said} and --phase say the moment, and of kill"));
            assert!(refusal.code == 2 && is_clear, "{refusal:?}");
        }
        for moment in ["", "--tick +9", "--tick +9 --phase 0", "--state idle"] {
            assert_eq!(drawn(&format!("corrupt tissue --where page --seed 7 {moment}")), Ok(None), "its bytes are drawn");
        }
        for words in ["--phase 5 --seed 7", "--seed", "--seed -1", "--seed 1.5", "--tick +9 --state idle --seed 7"] {
            let line = format!("hystation fault inject kill tissue {words}");
            assert!(Cli::try_parse_from(line.split_whitespace()).is_err(), "{words}");
        }
    }

    /// Of any other kind a seed was refused.
    #[test]
    fn corrupt_flips_the_bytes_of_its_seed_and_no_other_kind_is_asked_for_with_one() {
        let asked = |words: &str| {
            let injection = injection(&args(words)).unwrap();
            assert!(injection.check().is_ok(), "{words}: {:?}", injection.check());
            (injection.seed, injection.tick, injection.phase_us)
        };
        for moment in ["", "--tick +9", "--tick +9 --phase 5", "--state idle"] {
            assert_eq!(asked(&format!("corrupt tissue --where page --seed 7 {moment}")), (Some(7), 0, 0), "{moment}");
        }
        assert_eq!(asked("kill tissue --seed 7"), (None, 0, 0));
        assert_eq!(asked("stop guardian --seed 7 --for 1s"), (None, 0, 0));
    }

    #[test]
    fn what_was_drawn_is_told_in_the_options_with_which_it_comes_again() {
        let both = Drawn { seed: 7, ahead_ticks: Some(912), tick: Some(12_345), phase_us: 16 };
        assert_eq!(both.line(), "; drawn from seed 7: --tick +912 --phase 16 (tick 12345)");
        assert_eq!(Drawn { ahead_ticks: None, tick: None, ..both }.line(), "; drawn from seed 7: --phase 16");
        let again = args("kill tissue --tick +912 --phase 16");
        assert_eq!((again.tick, again.phase_us), (both.tick_words(), Some(16)));
    }
}
