//! Which graphics device draws: the fastest, or the one in software where that gives no device, or devices were lost too often.
//!
//! Promise: the choice is a pure function of what was lost; losses are kept in the station's root, from one process to the next, and what is no such file is
//! none.

use hyst_engine::{Failure, Life};
use hyst_exchange::{Station, system};
use rendering::{Prefer, RenderError};
use std::path::PathBuf;

/// Two devices that were lost within this time were not lost by chance, ns.
const OFTEN_NS: u64 = 60_000_000_000;
/// Losses that are kept.
const MOST: usize = 8;

fn file(station: &Station) -> PathBuf {
    station.root().join("device-losses")
}

/// When devices were lost in this station, CLOCK_MONOTONIC ns.
pub fn lost_ns(station: &Station) -> Vec<u64> {
    let text = std::fs::read_to_string(file(station)).unwrap_or_default();
    text.lines().filter_map(|line| line.trim().parse().ok()).collect()
}

/// Keeps that a device was lost. Refused, it is forgotten: the next process tries the fastest again.
fn keep(station: &Station, now_ns: u64) {
    let mut all = lost_ns(station);
    all.push(now_ns);
    let text: String = all[all.len().saturating_sub(MOST)..].iter().map(|lost_ns| format!("{lost_ns}\n")).collect();
    let next = file(station).with_extension("next");
    let _ = std::fs::write(&next, text).and_then(|()| std::fs::rename(&next, file(station)));
}

/// The end of the process by an error of the graphics; a device that was lost is remembered.
pub fn broken(life: &Life, error: &RenderError) -> Failure {
    if matches!(error, RenderError::DeviceLost(_)) {
        keep(&life.station, system::now_ns());
    }
    Failure::Broken(error.to_string())
}

/// In which order adapters are tried after such losses, ns.
pub fn order(lost_ns: &[u64]) -> [Prefer; 2] {
    let are_often = lost_ns.windows(2).any(|pair| pair[1].saturating_sub(pair[0]) <= OFTEN_NS);
    if are_often { [Prefer::Software, Prefer::Fastest] } else { [Prefer::Fastest, Prefer::Software] }
}

/// What the first adapter gives, or the second one where the first is none or gives no device, which is said. Where neither does it is the first one's error.
pub fn first_of<T>(
    [first, second]: [Prefer; 2],
    mut open: impl FnMut(Prefer) -> Result<T, RenderError>,
    say: impl FnOnce(&str),
) -> Result<T, RenderError> {
    let error = match open(first) {
        Err(error @ (RenderError::NoVulkan(_) | RenderError::NoDevice { .. })) => error,
        opened => return opened,
    };
    let Ok(opened) = open(second) else { return Err(error) };
    let other = if second == Prefer::Software { "the adapter in software" } else { "the fastest adapter" };
    say(&format!("{error}; {other} draws"));
    Ok(opened)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND_NS: u64 = 1_000_000_000;

    /// What comes of adapters of which some fail, and what is said.
    fn opened(order: [Prefer; 2], fail: &[Prefer], error: fn() -> RenderError) -> (Result<Prefer, String>, String) {
        let mut said = String::new();
        let open = |prefer: Prefer| if fail.contains(&prefer) { Err(error()) } else { Ok(prefer) };
        let found = first_of(order, open, |text| said = text.to_string());
        (found.map_err(|error| error.to_string()), said)
    }

    /// A GPU whose driver gave no device was taken for a machine without pictures, beside a software driver that could draw.
    #[test]
    fn where_the_first_adapter_gives_no_device_the_other_one_draws_and_it_is_said() {
        let (usual, both) = (order(&[]), [Prefer::Fastest, Prefer::Software]);
        let none = || RenderError::NoDevice { adapter: "a GPU".into(), reason: "out of memory".into() };
        assert_eq!(opened(usual, &[], none), (Ok(Prefer::Fastest), String::new()));
        let (found, said) = opened(usual, &[Prefer::Fastest], none);
        assert!(found == Ok(Prefer::Software) && said.contains("a GPU") && said.ends_with("in software draws"), "{said}");
        let (found, said) = opened(usual, &both, none);
        assert!(found.is_err_and(|error| error.contains("a GPU")) && said.is_empty(), "{said}");
        let (found, said) = opened(order(&[1, 2]), &[Prefer::Software], || RenderError::NoVulkan("x".into()));
        assert!(found == Ok(Prefer::Fastest) && said.ends_with("the fastest adapter draws"), "{said}");
        let (found, said) = opened(usual, &[Prefer::Fastest], || RenderError::NoDisplay("gone".into()));
        assert!(found.is_err() && said.is_empty(), "no adapter is to blame for that: {said}");
    }

    #[test]
    fn two_devices_that_are_lost_within_a_minute_make_the_software_first_for_good() {
        let first = |seconds: &[u64]| order(&seconds.iter().map(|second| second * SECOND_NS).collect::<Vec<_>>())[0];
        let (seldom, often): ([&[u64]; 4], [&[u64]; 3]) =
            ([&[], &[5], &[5, 66], &[5, 66, 200]], [&[5, 65], &[5, 66, 126], &[5, 6, 9_000]]);
        assert!(seldom.into_iter().all(|seconds| first(seconds) == Prefer::Fastest));
        assert!(often.into_iter().all(|seconds| first(seconds) == Prefer::Software));
    }

    #[test]
    fn losses_are_kept_for_the_next_process_and_nonsense_is_none() {
        let station = Station::named(&format!("t{}-lost", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        assert!(lost_ns(&station).is_empty());
        (1..=10).for_each(|second| keep(&station, second * SECOND_NS));
        let seconds: Vec<u64> = lost_ns(&station).iter().map(|lost_ns| lost_ns / SECOND_NS).collect();
        assert_eq!(seconds, [3, 4, 5, 6, 7, 8, 9, 10]);
        std::fs::write(file(&station), "x\n\n-3\n7 8\n9\n").unwrap();
        assert_eq!(lost_ns(&station), [9]);
        station.wipe();
    }
}
