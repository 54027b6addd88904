//! What is done in a running station beside a control that is as long, judged as the faults of a campaign are (docs/faults.md, "How it is judged"): by the
//! share of windows that lost more ticks than their control less the share that lost fewer, and by the mean of what they lost.

use crate::Station;
use crate::shown::not_shown;
use hyst_exchange::{ReadPage, machine};
use hyst_messages::page::hardware::LEDGER;
use hyst_messages::{Applied, Role};
use hystation::campaign::bounds::{Excess, least_faults};
use hystation::campaign::judge::pairs::{AFTERMATH_TICKS, DEFAULT_LIMIT, Window, of_pairs};
use hystation::campaign::judge::{Figures, Verdict};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

/// Time between two looks at the hardware's ledger, whose ring holds 16 s.
const LOOK: Duration = Duration::from_secs(2);

/// Counts the ticks of the hardware's ledger. A tick comes to that 64 ticks late, so that a window lies so much before what is done, and its control so much
/// before the quiet: what the window lacks at its end are the last of the ticks in which something may still come.
#[derive(Debug)]
pub struct Follower {
    page: ReadPage,
    next_key: u64,
    window: Window,
}

impl Follower {
    /// Of the ticks that come to the hardware's page from now on, which is this tick of the station.
    pub fn new(page: ReadPage, from_tick: u64) -> Follower {
        let next_key = page.ring_end(LEDGER);
        Follower { page, next_key, window: Window { from_tick, ..Window::default() } }
    }

    /// Counts those that have come.
    pub fn follow(&mut self) {
        let (end, window) = (self.page.ring_end(LEDGER), &mut self.window);
        for entry in (self.next_key..end).filter_map(|key| self.page.ring(LEDGER, key)) {
            window.count(entry.kind != Applied::Fresh as u32, entry.void != 0);
        }
        self.next_key = end;
    }

    /// What came until this tick of the station.
    pub fn until(mut self, to_tick: u64) -> Window {
        self.follow();
        Window { to_tick, ..self.window }
    }
}

/// What the ledger says of the ticks while something is done.
fn followed<T>(station: &Station, done: impl FnOnce() -> T) -> (Window, T) {
    let clock = station.clock();
    let mut follower = Follower::new(station.page(Role::Hardware), clock.present_tick());
    std::thread::scope(|scope| {
        // The thread ends when its sender is gone, which a panic takes, too.
        let (under_way, over) = channel::<()>();
        let following = scope.spawn(move || {
            while over.recv_timeout(LOOK) == Err(RecvTimeoutError::Timeout) {
                follower.follow();
            }
            follower
        });
        let result = done();
        let to_tick = clock.present_tick();
        drop(under_way);
        let follower = following.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        (follower.until(to_tick), result)
    })
}

/// What is done, until the station is whole and what may come of it later has come, and then as many quiet ticks.
pub(crate) fn beside_control<T>(station: &Station, done: impl FnOnce() -> T) -> ([Window; 2], T) {
    let (window, result) = followed(station, || {
        let result = done();
        station.recover();
        station.pass_ticks(AFTERMATH_TICKS);
        result
    });
    let (control, ()) = followed(station, || station.pass_ticks(window.to_tick - window.from_tick));
    ([window, control], result)
}

/// Judges these windows, each beside its control, of which each may cost so many ticks, and prints what they show.
pub fn judge(what: &str, pairs: &[[Window; 2]], allowed_misses: u64) -> Verdict {
    let figures = of_pairs(what, pairs, allowed_misses, DEFAULT_LIMIT);
    let words = words(&figures);
    match figures.verdict {
        Verdict::Held => println!("HELD: {words}"),
        Verdict::Broken => println!("BROKEN: {words}"),
        Verdict::Unknown | Verdict::Figures => not_shown(&words),
    }
    figures.verdict
}

/// How many count, how many are worse or better than their controls, and the bounds.
pub fn words(figures: &Figures) -> String {
    let Excess { faults, worse, better, mean, upper95, .. } = excess(figures);
    let (mean_ticks, bound_ticks) = (figures.mean_beyond_misses(), figures.mean_beyond_misses_upper95);
    let below = bound_ticks.map_or("nobody knows what".into(), |bound| format!("{bound:.3}"));
    let allowed = match figures.allowed_misses {
        0 => String::new(),
        ticks => format!(" and the {ticks} that each may cost"),
    };
    let (name, made, least, [lost, control_lost]) = (&figures.name, figures.planned, how_many(), figures.missed);
    let ([ticks, void], [control_ticks, control_void]) = (figures.window_ticks, figures.control_ticks);
    let reasons: String = figures.reasons.iter().map(|reason| format!("; {reason}")).collect();
    format!(
        "{name}: {made} made, {faults} count, {least}; {worse} worse than their controls, {better} better: a share of {mean:.3}, \
         with 95 % below {upper95:.3}; ticks beyond the control's{allowed}: {mean_ticks:.3} each, with 95 % below {below}; \
         lost {lost} of {ticks} ticks, and {void} void, their controls {control_lost} of {control_ticks}, \
         and {control_void}{reasons}"
    )
}

/// How many it takes.
pub fn how_many() -> String {
    let least = least_faults(DEFAULT_LIMIT).map_or("none".into(), |least| least.to_string());
    format!("{least} without a loss show {DEFAULT_LIMIT}")
}

fn excess(figures: &Figures) -> Excess {
    figures.excess.unwrap_or_else(|| Excess::of(0, 0, 0))
}

/// The last of these pairs, and what is known with it, for a run that may be cut off.
pub fn tally(pairs: &[[Window; 2]], allowed_misses: u64) -> String {
    let Some([window, control]) = pairs.last() else { return "none".into() };
    let figures = of_pairs("", pairs, allowed_misses, DEFAULT_LIMIT);
    let Excess { faults, worse, better, .. } = excess(&figures);
    let of = |window: &Window| format!("{} of {} ticks, and {} void", window.missed, window.ticks, window.voided);
    format!(
        "lost {}, its control {}; so far {faults} of {} count, {worse} worse, {better} better",
        of(window),
        of(control),
        figures.planned
    )
}

/// By which build, as a campaign's `begun.jsonl` names it, and on which machine a station runs.
pub fn origin(station: &Station) -> String {
    let build = std::fs::read_to_string(station.place().build()).unwrap_or_else(|_| "that nobody noted".into());
    let machine = machine::describe();
    let word = |key: &str| machine[key].as_str().unwrap_or("unknown").to_string();
    format!("build {}, {}, {} cores, Linux {}", build.trim(), word("cpu"), machine["cores"], word("kernel"))
}

/// Date and time now, UTC.
pub fn now() -> String {
    machine::utc_of(machine::now_unix_s())
}
