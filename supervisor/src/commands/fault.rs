//! `hystation fault`: faults on purpose, in a station in test mode.
//!
//! Exit codes of `inject`: 0 it was done, 1 it was begun, or may have been, and not as it was asked for, or the state that it waits for did not come, 2 it was
//! refused and nobody is hurt, 3 it was interrupted and has ended before its time.

#[cfg(test)]
mod documented;
mod drawn;
mod list;
mod state;

use super::INTERRUPTED;
use crate::cli::{FaultCommand, InjectArgs};
use crate::control::{self, NoAnswer, Request};
use crate::doing::Wanted;
use crate::faultfile::{Aim, FaultKind, Helper, Injection, Output, Place, Target, Which};
use crate::plan::Plan;
use crate::settings::Refusal;
use crate::struck::Struck;
use crate::swap::Record;
use crate::{keepers, neighbours, shortage, warn};
use drawn::Drawn;
use hyst_exchange::{Station, StationPage, system};
use serde_json::json;

/// Lists the kinds, injects one, or many by a campaign, or compares two of these.
pub fn fault(station: &Station, command: FaultCommand) -> Result<u8, Refusal> {
    match command {
        FaultCommand::List { json: true } => {
            println!("{:#}", list::json());
            Ok(0)
        }
        FaultCommand::List { json: false } => {
            print!("{}", list::text());
            Ok(0)
        }
        FaultCommand::Campaign(args) => crate::campaign::run(station.name(), &args),
        FaultCommand::Compare(args) => crate::campaign::compare::run(&args),
        FaultCommand::Inject(args) => inject(station, &args),
    }
}

/// A fault is asked for this long before its tick, ns: less than the supervisor waits for one.
const ASK_AHEAD_NS: u64 = 40_000_000;
/// Between two looks whether the station still runs, ns.
const LOOK_NS: u64 = 100_000_000;
/// Most ticks that are waited for: an hour.
const MOST_AHEAD_TICKS: u64 = 3_600_000;

fn inject(station: &Station, args: &InjectArgs) -> Result<u8, Refusal> {
    let mut injection = injection(args)?;
    let wanted = args.state.as_deref().map(state::named).transpose()?;
    let mut drawn = Drawn::of(args, injection.kind)?;
    let aim = injection.check().map_err(Refusal::input)?;
    if !station.root().is_dir() {
        return Err(super::no_station(station));
    }
    if let Ok(plan) = Plan::read(station) {
        injection.check_in(&plan.slots()).map_err(Refusal::input)?;
    }
    let may_fill = shortage::check(station, injection.kind).and_then(|()| neighbours::check_for(station, injection.kind));
    may_fill.map_err(Refusal::input)?;
    if station.open().is_ok_and(|page| !page.test_mode()) {
        return Err(Refusal::input(keepers::OUTSIDE_OF_TEST_MODE));
    }
    if let Some(words) = &args.tick {
        injection.tick = wait_for_tick(station, "--tick", words)?;
    }
    if let Some(drawn) = &mut drawn
        && let Some(words) = drawn.tick_words()
    {
        injection.tick = wait_for_tick(station, "--seed", &words)?;
        drawn.tick = Some(injection.tick);
    }
    let phase_us = args.phase_us.or(drawn.map(|drawn| drawn.phase_us));
    if let Some(wanted) = wanted {
        let option = if args.phase_us.is_some() { "--phase" } else { "--seed" };
        let page = phase_us.map(|_| page_of(station, option)).transpose()?;
        state::wait_for(station, wanted, args.within_s)?;
        injection.tick = page.map_or(0, |page| first_to_ask_for(&page, system::now_ns()));
    }
    injection.phase_us = phase_us.unwrap_or(0);
    if let Aim::Engines(Target { role, which: Which::Newcomer }) = aim
        && Record::under_way(station, role).is_none()
    {
        return Err(Refusal::input(format!(
            "no swap of {0} is under way; begin one with `hystation swap {0} BINARY`",
            role.name()
        )));
    }
    let done = match aim {
        Aim::Keepers(keepers) => keepers::inject(station, keepers, &injection).map(|(struck, lasted)| (Some(struck), lasted)),
        Aim::Engines(_) => {
            control::ask_once(station, &Request::Fault(injection)).map(|answer| (Struck::of_answer(&answer), true))
        }
    };
    let (struck, has_lasted) = done.map_err(not_done)?;
    struck.iter().filter_map(|struck| struck.caution.as_ref()).for_each(|line| warn(line));
    println!("{}", told(args, wanted, drawn, struck.as_ref()));
    if has_lasted {
        return Ok(0);
    }
    warn(&format!("interrupted: {} of {} was ended before its time was over", args.kind, args.target));
    Ok(INTERRUPTED)
}

/// What was done, in words or as JSON; of a supervisor of an older build nobody knows more than that it was.
fn told(args: &InjectArgs, wanted: Option<Wanted>, drawn: Option<Drawn>, struck: Option<&Struck>) -> String {
    let held = wanted.and_then(|wanted| state::held(wanted, struck?.doing.as_ref()));
    if args.json {
        let InjectArgs { kind, target, state, .. } = args;
        let told = json!({ "kind": kind, "target": target, "struck": struck, "state": state, "held": held, "drawn": drawn });
        return format!("{told:#}");
    }
    let older = || {
        format!(
            "{} of {}: it was done; this supervisor is of an older build, and does not say to whom and when",
            args.kind, args.target
        )
    };
    let line = struck.map_or_else(older, |struck| struck.line(&args.kind));
    let state = args.state.as_deref().zip(held).map(|(state, held)| {
        if held { format!("; in state {state}") } else { format!("; by then the station was no longer in state {state}") }
    });
    line + &state.unwrap_or_default() + &drawn.map(Drawn::line).unwrap_or_default()
}

/// One that was refused hurt nobody, as one that cannot be; of any other it is not known, or it was begun.
fn not_done(why: NoAnswer) -> Refusal {
    match why {
        NoAnswer::Refused(reason) => Refusal::input(reason),
        NoAnswer::Unanswered(reason) | NoAnswer::Half(reason) => Refusal::failed(reason),
    }
}

/// The page of a station whose ticks can be waited for.
fn page_of(station: &Station, option: &str) -> Result<StationPage, Refusal> {
    let page = station.open().map_err(|error| Refusal::failed(error.to_string()))?;
    if page.is_lockstep() {
        return Err(Refusal::input(format!("{option}: a station in lock-step takes faults with a tick from its --faults FILE")));
    }
    Ok(page)
}

/// The first tick of which each phase can still be asked for.
fn first_to_ask_for(page: &StationPage, now_ns: u64) -> u64 {
    page.tick_at(now_ns + ASK_AHEAD_NS) + 1
}

/// Waits until shortly before the tick that the words of an option name, in the station's own time; gives the tick.
fn wait_for_tick(station: &Station, option: &str, words: &str) -> Result<u64, Refusal> {
    let page = page_of(station, option)?;
    let tick =
        tick_of(words, page.tick_at(system::now_ns())).map_err(|why| Refusal::input(format!("{option} {words}: {why}")))?;
    let ask_ns = page.start_of(tick).saturating_sub(ASK_AHEAD_NS);
    loop {
        let now_ns = system::now_ns();
        if now_ns >= ask_ns {
            return Ok(tick);
        }
        if page.stop_requested() {
            return Err(Refusal::failed(format!("the station stopped before its tick {tick}")));
        }
        system::sleep_ns((ask_ns - now_ns).min(LOOK_NS));
    }
}

/// The tick that the words name, where it is `now`.
fn tick_of(words: &str, now: u64) -> Result<u64, String> {
    let number = words.strip_prefix('+').unwrap_or(words);
    let number: u64 = number.parse().map_err(|_| "a tick is a number, or +N for N ticks from now".to_string())?;
    let tick = if words.starts_with('+') { now.saturating_add(number) } else { number };
    match tick.checked_sub(now) {
        None | Some(0) => Err(format!("it has passed; it is {now} now")),
        Some(1..=MOST_AHEAD_TICKS) => Ok(tick),
        Some(_) => Err(format!("it is more than an hour ahead; it is {now} now")),
    }
}

/// What the arguments say.
fn injection(args: &InjectArgs) -> Result<Injection, Refusal> {
    let InjectArgs { for_s, factor, extra_s, jitter, rate, times, bytes, seed, .. } = *args;
    let kind = FaultKind::from_name(&args.kind)
        .ok_or_else(|| Refusal::input(format!("{:?} is no kind of fault; see `hystation fault list`", args.kind)))?;
    let place = args.place.as_deref().map(|name| {
        let places: Vec<&str> = Place::ALL.iter().map(|(_, name)| *name).collect();
        Place::from_name(name).ok_or_else(|| Refusal::input(format!("--where {name}: there are {}", places.join(", "))))
    });
    let place = place.transpose()?;
    let output = args.output.as_deref().map(|name| {
        let outputs: Vec<&str> = Output::ALL.iter().map(|(_, name)| *name).collect();
        Output::from_name(name).ok_or_else(|| Refusal::input(format!("--output {name}: there are {}", outputs.join(", "))))
    });
    let output = output.transpose()?;
    let thread = args.thread.as_deref().map(|name| {
        let threads: Vec<&str> = Helper::ALL.iter().map(|(_, name)| *name).collect();
        Helper::from_name(name).ok_or_else(|| Refusal::input(format!("--thread {name}: there are {}", threads.join(", "))))
    });
    let thread = thread.transpose()?;
    let seed = seed.filter(|_| kind == FaultKind::Corrupt); // of any other kind the moment alone is drawn
    let now = Injection::now(kind, &args.target);
    Ok(Injection { for_s, factor, extra_s, jitter, rate, times, output, thread, place, bytes, seed, ..now })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::Cli;
    use crate::doing::Doing;
    use crate::moment::MOST_AHEAD_NS;
    use clap::Parser;
    use hyst_messages::TICK_NS;
    use serde_json::Value;

    #[test]
    fn a_tick_is_a_number_that_comes_or_a_distance_and_anything_else_is_refused() {
        assert_eq!(tick_of("1500", 1_000), Ok(1_500));
        assert_eq!(tick_of("+500", 1_000), Ok(1_500));
        assert_eq!(tick_of("+3600000", 7), Ok(3_600_007));
        for words in
            ["1000", "999", "0", "+0", "", "+", "-5", "1.5", "1e6", "soon", "18446744073709551615", "+18446744073709551615"]
        {
            assert!(tick_of(words, 1_000).is_err(), "{words}");
        }
        assert!(tick_of("999", 1_000).unwrap_err().contains("it is 1000 now"));
    }

    /// It printed nothing: whom `:active` meant and when it came one found in the events.
    #[test]
    fn whom_a_fault_hit_and_when_is_told_in_words_and_as_json() {
        let args = |words: &str| match Cli::parse_from(words.split_whitespace()).command {
            crate::cli::Command::Fault { command: FaultCommand::Inject(args) } => args,
            other => panic!("{other:?}"),
        };
        let plain = args("hystation fault inject kill tissue:active");
        let hit = crate::struck::Hit { process: "tissue:1".into(), incarnation: 9, pid: 77 };
        let struck = Struck { victims: vec![hit], tick: 1_234, phase_us: 301, ..Struck::default() };
        assert_eq!(told(&plain, None, None, Some(&struck)), struck.line("kill"));
        let older = told(&plain, None, None, None);
        assert!(older.contains("kill of tissue:active: it was done") && older.contains("older build"), "{older}");
        let programs = args("hystation fault inject kill tissue:active --json");
        let found: Value = serde_json::from_str(&told(&programs, None, None, Some(&struck))).unwrap();
        assert_eq!((&found["struck"]["victims"][0]["process"], &found["struck"]["tick"]), (&json!("tissue:1"), &json!(1_234)));
        let older: Value = serde_json::from_str(&told(&programs, None, None, None)).unwrap();
        assert!(older["struck"].is_null() && older["target"] == "tissue:active" && older["drawn"].is_null(), "{older}");
        // A moment that was drawn is told, too.
        let drawn = Some(Drawn { seed: 7, ahead_ticks: Some(912), tick: Some(1_234), phase_us: 300 });
        let line = struck.line("kill") + "; drawn from seed 7: --tick +912 --phase 300 (tick 1234)";
        assert_eq!(told(&plain, None, drawn, Some(&struck)), line);
        let found: Value = serde_json::from_str(&told(&programs, None, drawn, Some(&struck))).unwrap();
        assert_eq!(found["drawn"], json!({ "seed": 7, "ahead_ticks": 912, "tick": 1_234, "phase_us": 300 }));
        // A state that was waited for may have gone when the fault came.
        let waits = args("hystation fault inject kill tissue:active --state contact --within 5s");
        let wanted = waits.state.as_deref().map(|word| state::named(word).unwrap());
        let came = |contacts: u32| {
            let doing = Some(Doing { whole: true, contacts: Some(contacts), ..Doing::default() });
            told(&waits, wanted, None, Some(&Struck { doing, ..struck.clone() }))
        };
        assert!(came(2).ends_with("us into it; in state contact"), "{}", came(2));
        assert!(came(0).ends_with("no longer in state contact"), "{}", came(0));
        assert_eq!(told(&waits, wanted, None, Some(&struck)), struck.line("kill"), "nobody says what the station was doing");
    }

    /// What the supervisor refuses ended with 1, as what failed.
    #[test]
    fn what_is_refused_ends_with_another_code_than_what_is_not_known() {
        assert_eq!(not_done(NoAnswer::Refused("no such spare".into())).code, 2);
        assert_eq!(not_done(NoAnswer::Half("one of two".into())).code, 1);
        let unknown = not_done(NoAnswer::Unanswered("the supervisor is busy".into()));
        assert_eq!((unknown.code, unknown.message.as_str()), (1, "the supervisor is busy"));
    }

    /// `--state cutting --phase 300` was refused: a phase took a tick, and a state took none.
    #[test]
    fn a_phase_goes_with_a_tick_or_a_state_and_the_tick_after_a_state_is_neither_too_near_nor_too_far() {
        let is_taken =
            |words: &str| Cli::try_parse_from(format!("hystation fault inject kill tissue {words}").split_whitespace()).is_ok();
        assert!(is_taken("--tick +9 --phase 300") && is_taken("--state cutting --phase 300") && is_taken("--state idle"));
        assert!(!is_taken("--phase 300") && !is_taken("--tick +9 --state idle") && !is_taken("--state idle --phase 1000"));
        let station = Station::named(&format!("t{}-phase", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        let (page, now_ns) = (station.open().unwrap(), system::now_ns());
        let ahead_ns = page.start_of(first_to_ask_for(&page, now_ns)) - now_ns;
        assert!(
            (ASK_AHEAD_NS..ASK_AHEAD_NS + 2 * TICK_NS).contains(&ahead_ns) && ahead_ns + TICK_NS < MOST_AHEAD_NS,
            "{ahead_ns}"
        );
        station.wipe();
    }
}
