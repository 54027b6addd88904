//! What a process did since the recorder looked at it before.

use serde::{Deserialize, Serialize};

/// A process in some ticks.
#[derive(Clone, Debug, PartialEq)]
pub struct ProcessSpell {
    /// The last of the ticks.
    pub tick: u64,
    /// The process, such as `haptic:1`.
    pub process: String,
    /// Its incarnation.
    pub incarnation: u32,
    /// How many ticks.
    pub ticks: u64,
    /// Steps in them.
    pub steps: u64,
    /// Steps that ended after the next had to begin.
    pub overruns: u64,
    /// 99th percentile of its wake-up latencies, µs; NaN if it counted none.
    pub wakeup_p99_us: f32,
    /// Median of its loop latencies, µs; NaN if it counted none.
    pub loop_p50_us: f32,
    /// 99th percentile of them, µs.
    pub loop_p99_us: f32,
}

/// A figure of what was counted.
fn counted(us: f32) -> Option<f32> {
    us.is_finite().then_some(us)
}

/// Message of `/processes`; a figure of what was not counted is left out.
#[derive(Serialize, Deserialize)]
pub(crate) struct Process {
    tick: u64,
    process: String,
    incarnation: u32,
    ticks: u64,
    steps: u64,
    overruns: u64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    wakeup_p99_us: Option<f32>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    loop_p50_us: Option<f32>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    loop_p99_us: Option<f32>,
}

impl Process {
    pub(crate) fn of(spell: &ProcessSpell) -> Process {
        Process {
            tick: spell.tick,
            process: spell.process.clone(),
            incarnation: spell.incarnation,
            ticks: spell.ticks,
            steps: spell.steps,
            overruns: spell.overruns,
            wakeup_p99_us: counted(spell.wakeup_p99_us),
            loop_p50_us: counted(spell.loop_p50_us),
            loop_p99_us: counted(spell.loop_p99_us),
        }
    }
    pub(crate) fn spell(self) -> ProcessSpell {
        ProcessSpell {
            tick: self.tick,
            process: self.process,
            incarnation: self.incarnation,
            ticks: self.ticks,
            steps: self.steps,
            overruns: self.overruns,
            wakeup_p99_us: self.wakeup_p99_us.unwrap_or(f32::NAN),
            loop_p50_us: self.loop_p50_us.unwrap_or(f32::NAN),
            loop_p99_us: self.loop_p99_us.unwrap_or(f32::NAN),
        }
    }
}
