//! What the station promises of its speed, memory and load, and whether a run held it.

use super::arm::{Arm, Kind};
use super::probe::{Spell, Window};
use hyst_messages::{Role, percentile_ns};
use serde_json::{Value, json};
use std::fmt;

/// What counts as 1 kHz, Hz: the host takes the rest by itself (it stalls for 15 to 34 ms now and then).
const KILOHERTZ: f64 = 990.0;
/// The Main Loop's rate on any machine, Hz: 250, less the same hundredth.
const LEAST_TISSUE_HZ: f64 = 247.5;
/// Flow on the default grid, Hz.
const LEAST_FLUID_HZ: f64 = 30.0;
/// Pictures at 640×480 on lavapipe, Hz, where they come every so many ticks: 30, less the same hundredth. Of those that come more often as large a share
/// must be there.
const LEAST_PICTURES_HZ: f64 = 29.7;
const PICTURE_TICKS: f64 = 33.0;
/// From the hardware's sample to the picture that shows it, 95th percentile, in times from one picture to the next.
const MOST_MOTION: f64 = 2.0;
/// From the death of rendering to its successor's first picture, s.
const MOST_PICTURES_BACK_S: f64 = 0.5;
/// What the station takes of the machine's memory, MiB: the resident memory of its processes would count each segment as often as it is mapped.
const MOST_MEMORY_MIB: f64 = 1_536.0;
/// The Main Loop as a process over the Main Loop as a thread.
const MOST_RATIO: f64 = 1.05;
/// Rates that differ more than this are of steps of 1, 2 or 4 ms; what the host takes differs less.
const MOST_RATE_RATIO: f64 = 1.4;
/// Doubt that is left at both ends of an interval together.
const DOUBT: f64 = 0.05;
/// Engines whose step must allocate nothing; rendering is an ordinary process that a driver shares.
const ALLOCATE_NOTHING: [&str; 6] = ["hardware", "device", "haptic", "tissue", "collision-worker", "fluid"];

/// One promise.
#[derive(Clone, Debug, PartialEq)]
pub struct Target {
    /// What.
    pub name: String,
    /// Figure; `None` if it could not be had.
    pub value: Option<f64>,
    /// Limit.
    pub limit: f64,
    /// The figure must not be below the limit; else it must not be above.
    pub at_least: bool,
    /// Whether it is held; `None` if there is nothing to judge here.
    pub held: Option<bool>,
}

impl Target {
    /// A figure and its limit.
    pub fn new(name: String, value: Option<f64>, limit: f64, at_least: bool) -> Target {
        let held = value.map(|value| if at_least { value >= limit } else { value <= limit });
        Target { name, value, limit, at_least, held }
    }
    /// A figure that must be there.
    pub fn required(mut self) -> Target {
        self.held = Some(self.held == Some(true));
        self
    }
    /// As the rows have it.
    pub fn json(&self) -> Value {
        let bound = if self.at_least { "at least" } else { "at most" };
        json!({ "arm": "target", "name": self.name, "value": self.value, "bound": bound, "limit": self.limit, "held": self.held })
    }
}

impl fmt::Display for Target {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let value = self.value.map_or("-".to_string(), |value| format!("{value:.3}"));
        let bound = if self.at_least { "at least" } else { "at most" };
        let held = self.held.map_or("not judged", |held| if held { "held" } else { "NOT HELD" });
        write!(f, "{:<72} {value:>10}  {bound} {:>7}  {held}", self.name, self.limit)
    }
}

/// The middle of some figures, or the mean of the two in the middle.
pub fn median(mut figures: Vec<f64>) -> Option<f64> {
    figures.sort_by(f64::total_cmp);
    let count = figures.len();
    let at = |index: usize| figures.get(index).copied();
    Some((at(count.checked_sub(1)? / 2)? + at(count / 2)?) / 2.0)
}

/// Between which of some figures the median lies of whatever they are drawn from, with at most 5 % doubt: of so many fair coins rarely so few show one side
/// (the sign test; Conover, "Practical Nonparametric Statistics", 3.2). `None` of fewer than six, which tell nothing.
pub fn interval95(mut figures: Vec<f64>) -> Option<[f64; 2]> {
    figures.sort_by(f64::total_cmp);
    let count = figures.len();
    // The chance that as many coins as `left_out` show it, and that fewer do.
    let (mut chance, mut fewer, mut left_out) = (0.5f64.powi(count as i32), 0.0, 0);
    while 2 * left_out < count && 2.0 * (fewer + chance) <= DOUBT {
        fewer += chance;
        left_out += 1;
        chance *= (count + 1 - left_out) as f64 / left_out as f64;
    }
    let lowest = left_out.checked_sub(1)?;
    Some([*figures.get(lowest)?, *figures.get(count - 1 - lowest)?])
}

/// A figure of each window's spell of one name.
pub fn figures(arm: &Arm, name: &str, figure: impl Fn(&Spell) -> Option<f64>) -> Vec<f64> {
    arm.windows.iter().filter_map(|window| window.spells.get(name).and_then(&figure)).collect()
}

fn median_rate_hz(arm: &Arm, name: &str) -> Option<f64> {
    median(figures(arm, name, Spell::rate_hz))
}

/// What pictures are held to, Hz: of the lowest rate that rendering had chosen at the end of a window.
fn least_pictures_hz(arm: &Arm) -> f64 {
    let ticks = |spell: &Spell| spell.picture.map(|picture| f64::from(picture.period_ticks[0])).filter(|ticks| *ticks > 0.0);
    let ticks = figures(arm, "rendering", ticks).into_iter().reduce(f64::max);
    LEAST_PICTURES_HZ * PICTURE_TICKS / ticks.unwrap_or(PICTURE_TICKS)
}

/// How old the hardware's sample is in the picture that shows it: 95th percentile over all windows, in times from one picture to the next at the rate that was
/// chosen last.
fn motion_periods(arm: &Arm) -> Option<f64> {
    let spells: Vec<&Spell> = arm.windows.iter().filter_map(|window| window.spells.get("rendering")).collect();
    let period_ns = 1e6 * f64::from(spells.iter().rev().find_map(|spell| spell.picture)?.period_ticks[0]);
    let mut motion = Vec::new();
    spells.iter().for_each(|spell| add(&mut motion, &spell.motion));
    (period_ns > 0.0 && motion.iter().any(|count| *count > 0)).then(|| percentile_ns(&motion, 0.95) as f64 / period_ns)
}

/// Adds two histograms.
pub fn add(sum: &mut Vec<u64>, counts: &[u64]) {
    sum.resize(sum.len().max(counts.len()), 0);
    for (sum, count) in sum.iter_mut().zip(counts) {
        *sum += count;
    }
}

/// Steps per second that the active tissue made itself, without those that its spare made for it; `None` if the role changed its holder.
fn own_rate_hz(window: &Window) -> Option<f64> {
    let (active, spare) = (window.spells.get("tissue:active").filter(|_| window.quiet)?, window.spells.get("tissue:spare"));
    let substitutes = spare.map_or(0, |spare| spare.substitutes) as f64;
    Some(active.rate_hz()? * (1.0 - substitutes / active.steps.filter(|steps| *steps > 0)? as f64).max(0.0))
}

/// Median step of the active tissue in a window, µs; `None` if the role changed its holder in it.
pub fn step_us(window: &Window) -> Option<f64> {
    let spell = window.spells.get("tissue:active").filter(|_| window.quiet)?;
    let step_us = percentile_ns(&spell.looping, 0.5) as f64 * 1e-3;
    (step_us > 0.0).then_some(step_us)
}

/// The Main Loop's median step as a process over that as a thread, for each pair of windows that are neighbours in time and whose steps are as
/// long: a station that chose steps of 2 ms at its start computes twice as much in one.
pub fn ratios(processes: &Arm, threads: &Arm) -> Vec<f64> {
    let rate_hz = |window: &Window| window.spells.get("tissue:active").and_then(Spell::rate_hz);
    let alike = |process: &Window, thread: &Window| {
        let ratio = rate_hz(process)? / rate_hz(thread)?;
        Some((1.0 / MOST_RATE_RATIO..=MOST_RATE_RATIO).contains(&ratio))
    };
    let pairs = processes.windows.iter().zip(&threads.windows).filter(|pair| alike(pair.0, pair.1) == Some(true));
    pairs.filter_map(|(process, thread)| Some(step_us(process)? / step_us(thread)?)).collect()
}

/// The Main Loop at 1 kHz, where the machine allows it: where the tissue itself chose steps of a millisecond at its start. Where it did not, the row says
/// so and is not judged; where the role changed its holder in every window, nothing is known, and it is not held.
fn kilohertz(arm: &Arm) -> Target {
    let rate_hz = median(arm.windows.iter().filter_map(own_rate_hz).collect());
    let longest = arm.windows.iter().map(|window| window.tissue_step_ticks).max().unwrap_or(0);
    match longest {
        2.. => {
            let name = format!("tissue, Hz (this machine: steps of {longest} ms), {}", arm.name());
            Target { held: None, ..Target::new(name, rate_hz, KILOHERTZ, true) }
        }
        _ => Target::new(format!("tissue, Hz, {}", arm.name()), rate_hz, KILOHERTZ, true).required(),
    }
}

/// All targets of a run; those that hold for the default scene alone only `on_default`.
pub fn judge(arms: &[Arm], on_default: bool) -> Vec<Target> {
    let mut targets = Vec::new();
    let stations = || arms.iter().filter(|arm| arm.kind == Kind::Processes);
    for arm in stations() {
        let named = |what: &str| format!("{what}, {}", arm.name());
        for name in ["device", "haptic:active", "haptic:spare"] {
            targets.push(Target::new(named(&format!("{name}, Hz")), median_rate_hz(arm, name), KILOHERTZ, true).required());
        }
        let least = figures(arm, "tissue:active", Spell::rate_hz).into_iter().reduce(f64::min);
        targets.push(Target::new(named("tissue in its slowest window, Hz"), least, LEAST_TISSUE_HZ, true).required());
        targets.push(kilohertz(arm));
    }
    for arm in stations().filter(|arm| arm.workers > 0) {
        if on_default {
            let rate_hz = median_rate_hz(arm, "fluid:active");
            targets.push(Target::new("fluid, Hz".into(), rate_hz, LEAST_FLUID_HZ, true).required());
        }
        // Without a Vulkan driver there are no pictures, and nothing to judge.
        let draws = |spell: &Spell| spell.rate_hz().filter(|_| spell.picture.is_some());
        let rate_hz = median(figures(arm, "rendering", draws));
        targets.push(Target::new("pictures, Hz".into(), rate_hz, least_pictures_hz(arm), true));
        targets.push(Target::new("motion to picture, p95, periods".into(), motion_periods(arm), MOST_MOTION, false));
        let back_s = median(arm.windows.iter().filter_map(|window| window.pictures_back_s).collect());
        targets.push(Target::new("rendering killed: to a picture again, s".into(), back_s, MOST_PICTURES_BACK_S, false));
        for threads in arms.iter().filter(|other| other.kind == Kind::Threads && other.workers == arm.workers) {
            let ratio = median(ratios(arm, threads));
            targets.push(Target::new("Main Loop, process / thread".into(), ratio, MOST_RATIO, false).required());
        }
    }
    let memory_mib = stations().flat_map(|arm| &arm.windows).map(|window| window.proportional_mib).reduce(f64::max);
    targets.push(Target::new("memory, what is shared once, MiB".into(), memory_mib, MOST_MEMORY_MIB, false).required());
    let spells = || stations().flat_map(|arm| &arm.windows).flat_map(|window| &window.spells);
    for engine in ALLOCATE_NOTHING {
        let of_engine = spells().filter(|(name, _)| Role::name_in(name) == engine).map(|(_, spell)| spell);
        let (allocations, steps) =
            of_engine.fold((0, 0), |(all, steps), spell| (all + spell.allocations, steps + spell.steps.unwrap_or(0)));
        let each = (steps > 0).then(|| allocations as f64 / steps as f64);
        targets.push(Target::new(format!("allocations per step, {engine}"), each, 0.0, false).required());
    }
    targets
}

#[cfg(test)]
mod tests {
    use super::super::arm::PICTURE_NS;
    use super::*;
    use hyst_messages::{LATENCY_BUCKETS, RenderingStatus, bucket_of_ns};

    fn window(rate_hz: f64, step_us: u64, quiet: bool) -> Window {
        let mut looping = vec![0; LATENCY_BUCKETS];
        looping[bucket_of_ns(step_us * 1_000)] = 1_000;
        let spell = Spell { seconds: 2.0, steps: Some((2.0 * rate_hz) as u64), looping, ..Spell::default() };
        let names = ["device", "haptic:active", "haptic:spare", "tissue:active", "fluid:active", "rendering"];
        let spells = names.into_iter().map(|name| (name.to_string(), spell.clone())).collect();
        Window { spells, quiet, ..Window::default() }
    }

    fn arm(kind: Kind, windows: Vec<Window>) -> Arm {
        Arm { windows, ..Arm::new(kind, 2) }
    }

    fn held(targets: &[Target], name: &str) -> Option<bool> {
        targets.iter().find(|target| target.name.starts_with(name)).unwrap_or_else(|| panic!("no target {name}")).held
    }

    #[test]
    fn medians_by_hand() {
        assert_eq!(median(vec![3.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(median(vec![4.0, 1.0]), Some(2.5));
        assert_eq!(median(Vec::new()), None);
    }

    #[test]
    fn the_interval_of_a_median_is_that_of_the_tables() {
        let of = |count: u32| interval95((1..=count).rev().map(f64::from).collect());
        // Ranks of the two ends for so many figures, from tables of the binomial distribution.
        for (count, ends) in [(6, [1.0, 6.0]), (7, [1.0, 7.0]), (9, [2.0, 8.0]), (20, [6.0, 15.0]), (40, [14.0, 27.0])] {
            assert_eq!(of(count), Some(ends), "{count}");
        }
        assert_eq!((of(0), of(1), of(5)), (None, None, None));
    }

    #[test]
    fn one_bad_window_is_forgiven_except_where_every_window_counts() {
        let windows = vec![window(1_000.0, 400, true), window(200.0, 400, true), window(1_000.0, 400, true)];
        let threads = arm(Kind::Threads, vec![window(1_000.0, 400, true); 3]);
        let targets = judge(&[arm(Kind::Processes, windows), threads], true);
        assert_eq!(held(&targets, "device"), Some(true));
        assert_eq!(held(&targets, "tissue in its slowest window"), Some(false));
        assert_eq!(held(&targets, "Main Loop"), Some(true));
        assert_eq!(held(&targets, "pictures"), None, "a process that draws nothing is not judged by its pictures");
    }

    #[test]
    fn pictures_are_held_to_the_rate_that_was_chosen() {
        let drawn = |rate_hz: f64, ticks: u32| {
            let mut window = window(rate_hz, 400, true);
            let picture = RenderingStatus { frames: 9, period_ticks: [ticks, 4], ..RenderingStatus::default() };
            window.spells.get_mut("rendering").unwrap().picture = Some(picture);
            window
        };
        let pictures = |windows: Vec<Window>| held(&judge(&[arm(Kind::Processes, windows)], true), "pictures");
        assert_eq!(pictures(vec![drawn(30.0, 33); 3]), Some(true));
        assert_eq!(pictures(vec![drawn(29.0, 33); 3]), Some(false));
        assert_eq!(pictures(vec![drawn(247.0, 4); 3]), Some(true), "as large a share of 250");
        assert_eq!(pictures(vec![drawn(200.0, 4); 3]), Some(false), "periods are skipped");
        assert_eq!(pictures(vec![drawn(125.0, 4), drawn(125.0, 8), drawn(125.0, 4)]), Some(true), "it gave way");
    }

    #[test]
    fn a_picture_may_be_two_periods_old_and_rendering_half_a_second_away() {
        let drawn = |motion_ms: u64, back_s: Option<f64>| {
            let mut window = Window { pictures_back_s: back_s, ..window(30.0, 400, true) };
            let spell = window.spells.get_mut("rendering").unwrap();
            spell.picture = Some(RenderingStatus { frames: 9, period_ticks: [33, 4], ..RenderingStatus::default() });
            spell.motion = vec![0; LATENCY_BUCKETS];
            spell.motion[bucket_of_ns(motion_ms * 1_000_000)] = 60;
            window
        };
        let of = |name: &str, motion_ms: u64, back_s: Option<f64>| {
            held(&judge(&[arm(Kind::Processes, vec![drawn(motion_ms, back_s); 3])], true), name)
        };
        assert_eq!((of("motion", 40, None), of("motion", 80, None)), (Some(true), Some(false)));
        let back = |back_s: Option<f64>| of("rendering killed", 40, back_s);
        assert_eq!((back(Some(0.4)), back(Some(0.6)), back(None)), (Some(true), Some(false), None));
        assert_eq!(back(Some(PICTURE_NS as f64 * 1e-9)), Some(false), "it never came back");
    }

    #[test]
    fn the_ratio_is_that_of_neighbours_and_needs_quiet_windows() {
        let processes = arm(Kind::Processes, vec![window(1e3, 800, true), window(1e3, 400, false), window(1e3, 400, true)]);
        let threads = arm(Kind::Threads, vec![window(1e3, 400, true); 3]);
        let found = ratios(&processes, &threads);
        assert!(found.len() == 2 && (found[0] - 2.0).abs() < 0.05 && (found[1] - 1.0).abs() < 1e-9, "{found:?}");
        let none = judge(&[arm(Kind::Processes, vec![window(1e3, 400, false)]), threads], true);
        assert_eq!(held(&none, "Main Loop"), Some(false), "a ratio that could not be measured is not held");
    }

    #[test]
    fn windows_with_steps_of_different_length_make_no_pair() {
        let processes = arm(Kind::Processes, vec![window(500.0, 800, true), window(980.0, 420, true), window(500.0, 800, true)]);
        let threads = arm(Kind::Threads, vec![window(1e3, 400, true), window(1e3, 400, true), window(250.0, 1_600, true)]);
        let found = ratios(&processes, &threads);
        assert!(found.len() == 1 && (0.99..1.1).contains(&found[0]), "{found:?}");
    }

    #[test]
    fn the_tissue_makes_a_kilohertz_where_it_chose_to_and_nothing_hides_that_it_does_not() {
        let tissue_hz = |windows: Vec<Window>| held(&judge(&[arm(Kind::Processes, windows)], true), "tissue, Hz");
        assert_eq!(tissue_hz(vec![window(998.0, 640, true); 3]), Some(true), "however long a step takes on the clock");
        assert_eq!(tissue_hz(vec![window(500.0, 900, true); 3]), Some(false));
        assert_eq!(tissue_hz(vec![window(998.0, 640, false); 3]), Some(false), "nobody kept the role");
        let long = |rate_hz: f64| Window { tissue_step_ticks: 4, ..window(rate_hz, 2_000, true) };
        assert_eq!(tissue_hz(vec![long(250.0); 3]), None, "the machine does not allow it");
        let mut helped = window(998.0, 640, true);
        helped.spells.insert("tissue:spare".into(), Spell { substitutes: 1_000, ..Spell::default() });
        assert_eq!(tissue_hz(vec![helped; 3]), Some(false), "its spare makes half of the steps");
    }

    #[test]
    fn one_allocation_is_one_too_many() {
        let mut one = window(1_000.0, 400, true);
        one.spells.get_mut("device").unwrap().allocations = 1;
        let targets = judge(&[arm(Kind::Processes, vec![one])], true);
        assert_eq!(held(&targets, "allocations per step, device"), Some(false));
        assert_eq!(held(&targets, "allocations per step, tissue"), Some(true));
    }
}
