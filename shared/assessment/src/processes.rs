//! What each process did in a session, summed from its seconds.

use crate::markup::plain;
use hyst_recording::ProcessSpell;
use std::collections::BTreeMap;

/// Most processes that are told apart; a station has some thirty slots at most.
const MOST_PROCESSES: usize = 64;

/// A process of all its seconds, whatever its incarnations.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ProcessSum {
    /// How many incarnations were seen.
    pub incarnations: u64,
    /// Steps, of which so many were late.
    pub steps: u64,
    /// See above.
    pub overruns: u64,
    /// Largest 99th percentile of a second: wake-up and loop, µs; `None` if none was counted.
    pub wakeup_p99_us: Option<f64>,
    /// See above.
    pub loop_p99_us: Option<f64>,
    incarnation: u32,
    ticks: u64,
    /// Medians of the loop, each times its ticks, and those ticks.
    loop_p50: (f64, u64),
}

impl ProcessSum {
    fn add(&mut self, spell: &ProcessSpell) {
        if std::mem::replace(&mut self.incarnation, spell.incarnation) != spell.incarnation {
            self.incarnations += 1;
        }
        self.steps = self.steps.saturating_add(spell.steps);
        self.overruns = self.overruns.saturating_add(spell.overruns);
        self.ticks = self.ticks.saturating_add(spell.ticks);
        let raise = |most: &mut Option<f64>, value: f32| {
            if value.is_finite() && most.is_none_or(|most| f64::from(value) > most) {
                *most = Some(f64::from(value));
            }
        };
        raise(&mut self.wakeup_p99_us, spell.wakeup_p99_us);
        raise(&mut self.loop_p99_us, spell.loop_p99_us);
        if spell.loop_p50_us.is_finite() {
            self.loop_p50.0 += f64::from(spell.loop_p50_us) * spell.ticks as f64;
            self.loop_p50.1 = self.loop_p50.1.saturating_add(spell.ticks);
        }
    }

    /// Steps a second; `None` if no time was seen.
    pub fn rate_hz(&self) -> Option<f64> {
        (self.ticks > 0).then(|| self.steps as f64 * 1e3 / self.ticks as f64)
    }

    /// Mean of the seconds' medians of the loop, µs.
    pub fn loop_p50_us(&self) -> Option<f64> {
        let (sum, ticks) = self.loop_p50;
        (ticks > 0).then(|| sum / ticks as f64)
    }
}

/// All processes by their names.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Processes(BTreeMap<String, ProcessSum>);

impl Processes {
    /// Adds a second of a process.
    pub fn note(&mut self, spell: &ProcessSpell) {
        let name = plain(&spell.process);
        if self.0.len() < MOST_PROCESSES || self.0.contains_key(&name) {
            self.0.entry(name).or_default().add(spell);
        }
    }

    /// Each with its name, in their order.
    pub fn all(&self) -> impl Iterator<Item = (&str, &ProcessSum)> {
        self.0.iter().map(|(name, sum)| (name.as_str(), sum))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_seconds_of_a_process_are_summed_across_its_incarnations() {
        let spell = |incarnation, ticks, steps, wakeup_p99_us, loop_p50_us| ProcessSpell {
            tick: 0,
            process: "tissue:0".into(),
            incarnation,
            ticks,
            steps,
            overruns: 1,
            wakeup_p99_us,
            loop_p50_us,
            loop_p99_us: 2.0 * loop_p50_us,
        };
        let mut processes = Processes::default();
        processes.note(&spell(4, 1_000, 1_000, 90.0, 500.0));
        processes.note(&spell(4, 1_000, 900, 40.0, 600.0));
        processes.note(&spell(9, 500, 500, f32::NAN, f32::NAN));
        processes.note(&ProcessSpell { process: "fluid:0".into(), ..spell(5, 0, 0, f32::NAN, f32::NAN) });
        let all: Vec<_> = processes.all().collect();
        assert_eq!(all.iter().map(|(name, _)| *name).collect::<Vec<_>>(), ["fluid:0", "tissue:0"]);
        let (fluid, tissue) = (all[0].1, all[1].1);
        assert_eq!((fluid.rate_hz(), fluid.loop_p50_us(), fluid.wakeup_p99_us), (None, None, None));
        assert_eq!((tissue.incarnations, tissue.steps, tissue.overruns, tissue.rate_hz()), (2, 2_400, 3, Some(960.0)));
        assert_eq!((tissue.wakeup_p99_us, tissue.loop_p50_us(), tissue.loop_p99_us), (Some(90.0), Some(550.0), Some(1_200.0)));
        (0..100).for_each(|index| processes.note(&ProcessSpell { process: format!("p{index}"), ..spell(1, 1, 1, 1.0, 1.0) }));
        assert_eq!(processes.all().count(), MOST_PROCESSES, "a damaged file names no more");
    }
}
