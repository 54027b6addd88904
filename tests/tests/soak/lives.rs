//! What the processes of a station have, sample by sample, and whether one life of them grows.

use station_tests::Station;
use std::collections::BTreeMap;
use std::path::Path;
use std::time::{Duration, Instant};

/// Looks at a process, and the pause between two of them: connections that come or go are no growth, so the least counts.
const LOOKS: u64 = 3;
const BETWEEN_LOOKS: Duration = Duration::from_millis(7);
/// A life's own warm-up, and the deaths that it must have seen by then: it may keep the last message of each writer that died.
const YOUNG_MIN: f64 = 20.0 / 60.0;
const YOUNG_DEATHS: usize = 8;
/// Parts of a life whose medians are compared, the first against the last, and the samples that each must hold.
const PARTS: usize = 5;
const LEAST: usize = 3;

/// What a process has.
#[derive(Clone, Copy, Debug, Default)]
struct Use {
    files: f64,
    mappings: f64,
    resident_mib: f64,
}

impl Use {
    fn least(self, other: Use) -> Use {
        Use {
            files: self.files.min(other.files),
            mappings: self.mappings.min(other.mappings),
            resident_mib: self.resident_mib.min(other.resident_mib),
        }
    }
}

fn use_of(pid: i32) -> Option<Use> {
    let folder = Path::new("/proc").join(pid.to_string());
    let pages = std::fs::read_to_string(folder.join("statm")).ok()?;
    let pages: f64 = pages.split_whitespace().nth(1)?.parse().ok()?;
    Some(Use {
        files: std::fs::read_dir(folder.join("fd")).ok()?.count() as f64,
        mappings: std::fs::read_to_string(folder.join("maps")).ok()?.lines().count() as f64,
        resident_mib: pages * rustix::param::page_size() as f64 / f64::from(1 << 20),
    })
}

/// What a life may have more in its end than after its warm-up, whatever its length, and for each minute of it: files, mappings, MiB. A connection or an
/// arena may be on its way when the last samples are taken. In the kept ones nothing but the memory grew at all, by 2.0 MiB at most, once (40 deaths in 1.6
/// minutes, 2-core VM with other work, 2026-11-22).
const ONCE: [f64; 3] = [2.0, 8.0, 4.0];
const EACH_MINUTE: [f64; 3] = [0.0, 0.1, 0.05];
/// Rendering keeps the last topology of a tissue that died until it has another one: the files of that writer's service.
const TOPOLOGY_FILES: f64 = 5.0;
/// The supervisor keeps 40 s of the hardware's ledger, which a new one has not got, and all faults of the run, MiB.
const HISTORY_MIB: f64 = 4.0;

fn most(name: &str, minutes: f64) -> [f64; 3] {
    let mut most = [0, 1, 2].map(|figure| ONCE[figure] + EACH_MINUTE[figure] * minutes);
    most[0] += if name == "rendering" { TOPOLOGY_FILES } else { 0.0 };
    most[2] += if name == "supervisor" { HISTORY_MIB } else { 0.0 };
    most
}

/// One life: its samples, with the time since the first look.
struct Life {
    name: String,
    samples: Vec<(f64, Use)>,
}

/// What is taken of a sample.
type Figure = fn(&(f64, Use)) -> f64;

/// Growth of a life in files, mappings and MiB, and the minutes that it took.
struct Growth {
    minutes: f64,
    from: [f64; 3],
    by: [f64; 3],
}

fn median(mut figures: Vec<f64>) -> f64 {
    figures.sort_by(f64::total_cmp);
    figures[figures.len() / 2]
}

impl Life {
    /// `None` if it was too short to say.
    fn growth(&self, since_min: f64) -> Option<Growth> {
        let old = |(index, (at, _)): &(usize, &(f64, Use))| {
            *index >= YOUNG_DEATHS && *at >= self.samples[0].0 + YOUNG_MIN && *at >= since_min
        };
        let grown: Vec<(f64, Use)> = self.samples.iter().enumerate().filter(old).map(|(_, sample)| *sample).collect();
        let part = (grown.len() / PARTS).max(LEAST);
        if grown.len() < 2 * part {
            return None;
        }
        let (first, last) = (&grown[..part], &grown[grown.len() - part..]);
        let of = |samples: &[(f64, Use)], figure: Figure| median(samples.iter().map(figure).collect());
        let figures: [Figure; 3] = [|(_, has)| has.files, |(_, has)| has.mappings, |(_, has)| has.resident_mib];
        let minutes = of(last, |(at, _)| *at) - of(first, |(at, _)| *at);
        Some(Growth {
            minutes,
            from: figures.map(|figure| of(first, figure)),
            by: figures.map(|figure| of(last, figure) - of(first, figure)),
        })
    }
}

/// All lives of a run.
pub struct Lives {
    lives: BTreeMap<(i32, u64), Life>,
    first_look: Instant,
    begin_min: f64,
}

impl Lives {
    pub fn new() -> Lives {
        Lives { lives: BTreeMap::new(), first_look: Instant::now(), begin_min: 0.0 }
    }

    /// The station's warm-up is over.
    pub fn begin(&mut self) -> Instant {
        self.begin_min = self.first_look.elapsed().as_secs_f64() / 60.0;
        Instant::now()
    }

    /// Looks at everybody.
    pub fn sample(&mut self, station: &Station) {
        use hyst_messages::Role;
        let keepers = [Role::Supervisor, Role::Guardian].into_iter().filter_map(|role| station.keeper(role));
        for process in station.engines().into_iter().chain(keepers) {
            let looks = (0..LOOKS).filter_map(|look| {
                if look > 0 {
                    std::thread::park_timeout(BETWEEN_LOOKS);
                }
                use_of(process.pid)
            });
            let Some(now) = looks.reduce(Use::least) else { continue };
            let life = self.lives.entry((process.pid, process.start));
            let life = life.or_insert_with(|| Life { name: process.name, samples: Vec::new() });
            life.samples.push((self.first_look.elapsed().as_secs_f64() / 60.0, now));
        }
    }

    /// Minutes that are known of the slot's process that lived longest.
    pub fn longest_min(&self, name: &str) -> f64 {
        let of_name = self.lives.values().filter(|life| life.name == name);
        of_name.filter_map(|life| Some(life.growth(self.begin_min)?.minutes)).fold(0.0, f64::max)
    }

    /// What is wrong, life by life.
    pub fn verdicts(&self) -> Vec<String> {
        let mut wrong = Vec::new();
        for life in self.lives.values() {
            let Some(Growth { minutes, from, by }) = life.growth(self.begin_min) else { continue };
            let most = most(&life.name, minutes);
            let text = format!(
                "{}: in {minutes:.1} min {:+.0} files, {:+.0} mappings, {:+.2} MiB (from {:.0}, {:.0}, {:.1}; at most {:.0}, {:.0}, {:.2})",
                life.name, by[0], by[1], by[2], from[0], from[1], from[2], most[0], most[1], most[2]
            );
            println!("{text}");
            if by.iter().zip(most).any(|(by, most)| *by > most) {
                wrong.push(text);
            }
        }
        wrong
    }
}
