//! The plan of a campaign, drawn from a seed: which fault comes when, at which phase of its tick, in which station. The same file and seed
//! give the same plan on every machine; so a seed and an index name one fault for ever.
//!
//! The generator is splitmix64 (Steele, Lea, Flood: "Fast splittable pseudorandom number generators", OOPSLA 2014): a few fixed lines, and
//! good enough to shuffle.

use super::cell::{Cell, State};
use super::file::Campaign;
use super::stage::Place;
use crate::faultfile::{FaultKind, Injection};
use crate::ledger::STEADY_TICKS;
use crate::moment::MOST_PHASE_US;
use crate::suspicion::is_real_time;
use hyst_messages::Role;
use serde::{Deserialize, Serialize};

/// Fewest and most ticks from what was before a fault to that fault, where nobody says it.
pub const GAP_TICKS: [u64; 2] = [600, 1_400];
/// First tick at which a fresh station may be hurt: it is whole after some 2 s, and from its first fresh force [`STEADY_TICKS`] have passed, and as many more as
/// hold a control for its first fault.
pub(super) const FIRST_TICK: u64 = STEADY_TICKS + 3_000;
/// Longest wait between the other fault, once it can have come about, and the one that falls into its recovery, ticks.
const MOST_WITH_TICKS: u64 = 40;
/// The same if the other is a servo's, whose successor is warm after 12 ticks where it takes the least; one that comes late has no verdict.
const MOST_WITH_SERVO_TICKS: u64 = 8;
/// A file system that is filled is full after 87 to 162 ms (of 180, 2026-11-29, two cores): what is to come while it is comes after so many ticks.
const FULL_TICKS: u64 = 200;
/// Least time in which growth, or a helper that stands still, is found, ticks.
const SLOWLY_FOUND_TICKS: u64 = 6_000;

/// One fault of the plan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Entry {
    /// Its number in the plan, from 0.
    pub index: usize,
    /// Number of the station it is for, from 0.
    pub station: usize,
    /// Arm's name.
    pub arm: String,
    /// Cell's name.
    pub cell: String,
    /// Tick of the station, counted from the station's start.
    pub tick: u64,
    /// Place in the tick, µs.
    pub phase_us: u32,
    /// Ticks after the other fault, for one that falls into its recovery; after its hand-over was seen, for one that falls into that.
    pub with_ticks: u64,
    /// Where in its swap it comes, for one that falls into one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub in_swap: Option<Place>,
}

/// The whole plan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    /// Campaign's name.
    pub campaign: String,
    /// Seed.
    pub seed: u64,
    /// Hash of the campaign's file.
    pub file_hash: String,
    /// The faults, in their order.
    pub faults: Vec<Entry>,
}

/// splitmix64.
#[derive(Clone, Debug)]
pub struct Draw(u64);

impl Draw {
    /// A generator.
    pub fn new(seed: u64) -> Draw {
        Draw(seed)
    }
    /// The next 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }
    /// A number from `least` to `most`, both included; a bias of less than 2⁻³² for ranges below 2³².
    pub fn between(&mut self, least: u64, most: u64) -> u64 {
        let span = (most.saturating_sub(least) as u128) + 1;
        least + ((u128::from(self.bits()) * span) >> 64) as u64
    }
    /// When a fault comes: so many ticks after what was before it, and at which place of its tick, µs.
    pub fn moment(&mut self, [least, most]: [u64; 2]) -> (u64, u32) {
        (self.between(least, most), self.between(0, u64::from(MOST_PHASE_US)) as u32)
    }
    /// Fisher and Yates.
    pub fn shuffle<T>(&mut self, items: &mut [T]) {
        for at in (1..items.len()).rev() {
            items.swap(at, self.between(0, at as u64) as usize);
        }
    }
}

/// FNV-1a.
pub fn hash(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3))
}

/// Draws the plan.
pub fn plan(campaign: &Campaign, seed: u64) -> Plan {
    let mut draw = Draw::new(seed);
    let mut laps: Vec<(usize, Vec<&Cell>)> = Vec::new();
    for (arm, this) in campaign.arms.iter().enumerate() {
        let mut cells: Vec<&Cell> = campaign.cells.iter().flat_map(|cell| std::iter::repeat_n(cell, this.count(cell))).collect();
        draw.shuffle(&mut cells);
        // What damaged memory brings about may come long after: it is to be no other fault's doing.
        let (damaging, others): (Vec<&Cell>, Vec<&Cell>) = cells.into_iter().partition(|cell| cell.leaves_damage());
        for cells in [others, damaging] {
            laps.extend(cells.chunks(campaign.faults_per_station).map(|lap| (arm, lap.to_vec())));
        }
    }
    draw.shuffle(&mut laps);
    let mut faults = Vec::new();
    for (station, (arm, lap)) in laps.into_iter().enumerate() {
        let mut tick = FIRST_TICK;
        for cell in lap {
            let (gap_ticks, phase_us) = draw.moment(campaign.gap_ticks);
            tick += gap_ticks;
            faults.push(Entry {
                index: faults.len(),
                station,
                arm: campaign.arms[arm].name.clone(),
                cell: cell.name.clone(),
                tick,
                phase_us,
                with_ticks: draw_with_ticks(cell, &mut draw),
                in_swap: cell.swap.map(|role| Place::draw(role, cell.is_of_newcomer(), &mut draw)),
            });
            tick += room_ticks(cell);
        }
    }
    Plan { campaign: campaign.name.clone(), seed, file_hash: format!("{:016x}", campaign.hash), faults }
}

/// How long after the other fault one comes that falls into its recovery. Who is to do wrong itself does it in its next step, and that may have begun: it
/// has two of them for it, or nothing had happened yet that the second fault could fall into. A file system takes its time to be full, and a hand-over is waited
/// for.
fn draw_with_ticks(cell: &Cell, draw: &mut Draw) -> u64 {
    let role = cell.with.as_ref().and_then(|with| Role::from_name(Role::name_in(&with.target)));
    let is_asked =
        |with: &Injection| cell.state != State::Handover && with.kind.mischief().is_some() && with.kind.signal().is_none();
    let least = match &cell.with {
        Some(with) if matches!(with.kind, FaultKind::DiskFull | FaultKind::ShmFull) => FULL_TICKS,
        Some(with) if is_asked(with) => 2 * role.map_or(0, period_ticks),
        _ => 0,
    };
    let most = if role == Some(Role::Haptic) && least < FULL_TICKS { MOST_WITH_SERVO_TICKS } else { least + MOST_WITH_TICKS };
    draw.between(least.max(1), most)
}

/// Longest step of a role on a machine that is not hopeless, ticks; a plan is drawn where no station runs that could be asked. A tissue and a fluid take longer
/// steps where the machine affords no shorter ones: 4, and twice the 33 of the default scene's.
fn period_ticks(role: Role) -> u64 {
    match role {
        Role::Hardware | Role::Device | Role::Haptic => 1,
        Role::Tissue | Role::CollisionWorker => 4,
        Role::Fluid => 66,
        Role::Rendering | Role::Recorder | Role::Console | Role::Supervisor | Role::Guardian => 33,
    }
}

/// Ticks that the recovery from a fault takes at least beyond the gap. Not what it may take: a fault whose tick has passed comes as soon as the
/// station is whole and has been quiet, and a plan that leaves more room than is needed costs that room each time.
fn room_ticks(cell: &Cell) -> u64 {
    let is_slow = !Role::from_name(cell.role()).is_some_and(is_real_time);
    match cell.injection.kind {
        _ if cell.state == State::Handover => SLOWLY_FOUND_TICKS,
        // Growth and a helper that stands still are found after some seconds, a start that hangs after many, and the control window is as long as that.
        FaultKind::LeakMemory | FaultKind::LeakFiles => SLOWLY_FOUND_TICKS,
        FaultKind::Block if cell.injection.thread.is_some() => SLOWLY_FOUND_TICKS,
        FaultKind::HangStart => cell.injection.for_s.map_or(60_000, |for_s| (for_s * 2e3) as u64),
        FaultKind::Slow | FaultKind::NoFiles => cell.injection.for_s.map_or(0, |for_s| (for_s * 1e3) as u64),
        _ if is_slow => 300,
        _ => 0,
    }
}

impl Plan {
    /// The plan for people: a line for each fault.
    pub fn text(&self) -> String {
        let stations = self.faults.last().map_or(0, |last| last.station + 1);
        let mut text = format!(
            "campaign {}, seed {}, {} faults in {stations} stations\n{:>6} {:>7} {:>8} {:>5}  {:<12} fault\n",
            self.campaign,
            self.seed,
            self.faults.len(),
            "index",
            "station",
            "tick",
            "us",
            "arm"
        );
        for entry in &self.faults {
            text.push_str(&format!(
                "{:>6} {:>7} {:>8} {:>5}  {:<12} {}\n",
                entry.index, entry.station, entry.tick, entry.phase_us, entry.arm, entry.cell
            ));
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::campaign::file::parse;
    use std::collections::BTreeMap;

    const TEXT: &str = "faults_per_station = 7\n[[arm]]\nname = \"a\"\n[[arm]]\nname = \"b\"\nshare = 0.5\n[arm.set]\nspares = \"off\"\n\
                        [[cell]]\nkinds = [\"kill\", \"stop\"]\ntargets = [\"haptic:active\", \"tissue:active\"]\ncount = 5\n";

    #[test]
    fn the_generator_is_splitmix64() {
        // The first outputs for the seed 1234567, as its authors' C code gives them.
        let mut draw = Draw::new(1_234_567);
        assert_eq!([draw.bits(), draw.bits()], [6_457_827_717_110_365_317, 3_203_168_211_198_807_973]);
        let drawn: Vec<u64> = (0..1_000).map(|_| draw.between(3, 6)).collect();
        assert!((3..=6).all(|value| drawn.contains(&value)) && drawn.iter().all(|value| (3..=6).contains(value)));
        assert_eq!(hash(b"a"), 0xaf63_dc4c_8601_ec8c, "FNV-1a of \"a\"");
    }

    /// A plan is drawn from the same numbers by every build: with others nobody could go on with the results of an older one.
    #[test]
    fn a_moment_is_drawn_as_the_gap_before_it_and_then_its_phase() {
        assert_eq!([7, 8].map(|seed| Draw::new(seed).moment(GAP_TICKS)), [(912, 16), (1_095, 611)]);
        let mut draw = Draw::new(1);
        let drawn: Vec<(u64, u32)> = (0..20_000).map(|_| draw.moment([3, 5])).collect();
        assert!((3..=5).all(|gap| drawn.iter().any(|(ticks, _)| *ticks == gap)));
        assert!((0..=MOST_PHASE_US).all(|place| drawn.iter().any(|(_, phase_us)| *phase_us == place)));
        assert!(drawn.iter().all(|(ticks, phase_us)| (3..=5).contains(ticks) && *phase_us < 1_000));
    }

    #[test]
    fn a_seed_gives_one_plan_and_another_seed_another() {
        let campaign = parse("t", TEXT).unwrap();
        assert_eq!(plan(&campaign, 1), plan(&campaign, 1));
        assert_ne!(plan(&campaign, 1).faults, plan(&campaign, 2).faults);
    }

    #[test]
    fn what_leaves_damage_has_stations_of_its_own() {
        let text = format!("{TEXT}[[cell]]\nkinds = [\"corrupt\"]\ntargets = [\"fluid:active\"]\ncount = 9\nwhere = \"link\"\n");
        let campaign = parse("t", &text).unwrap();
        let plan = plan(&campaign, 3);
        let mut stations: BTreeMap<usize, Vec<bool>> = BTreeMap::new();
        for entry in &plan.faults {
            stations.entry(entry.station).or_default().push(entry.cell.starts_with("corrupt"));
        }
        assert!(stations.values().all(|lap| lap.iter().all(|damages| *damages == lap[0])), "{stations:?}");
        assert!(stations.values().all(|lap| lap.len() <= 7) && stations.values().any(|lap| lap[0]));
    }

    /// `kill fluid:active` from `poison fluid:active` came 1 to 40 ticks after a request that is heeded in a step of 33.
    #[test]
    fn who_is_asked_to_do_wrong_has_two_steps_for_it_before_the_next_fault() {
        let drawn = |with: &str| {
            let cell = format!(
                "[[cell]]\nkinds = [\"kill\"]\ntargets = [\"fluid:active\"]\nstates = [\"recovery\"]\nwith = \"{with}\"\ncount = 400\n"
            );
            let campaign = parse("t", &format!("[[arm]]\nname = \"a\"\n{cell}")).unwrap();
            let ticks = plan(&campaign, 1).faults.into_iter().map(|entry| entry.with_ticks);
            ticks.fold((u64::MAX, 0), |(least, most), ticks| (least.min(ticks), most.max(ticks)))
        };
        assert_eq!([drawn("poison fluid:active for=0.5"), drawn("poison tissue:active for=0.5")], [(132, 172), (8, 48)]);
        assert_eq!(drawn("nan haptic:active for=0.5"), (2, 8));
        let at_once = ["kill tissue:active", "crash-loop tissue:active", "no-files device for=0.5"];
        assert_eq!(at_once.map(drawn), [(1, 40); 3]);
        assert_eq!(drawn("kill haptic:active"), (1, 8));
        assert_eq!(["shm-full console for=1.0", "shm-full haptic:active for=1.0"].map(drawn), [(200, 240); 2]);
    }

    /// A hand-over comes 1 to 16 s after its fault: a second one 40 ticks after that met nobody who handed anything over.
    #[test]
    fn a_fault_in_a_hand_over_comes_so_long_after_that_is_seen_and_the_next_leaves_room_for_it() {
        let drawn = |with: &str| {
            let cell = format!(
                "[[cell]]\nkinds = [\"kill\"]\ntargets = [\"supervisor\"]\nstates = [\"handover\"]\nwith = '{with}'\ncount = 200\n"
            );
            let faults = plan(&parse("t", &cell).unwrap(), 1).faults;
            let is_roomy =
                |pair: &[Entry]| pair[1].station != pair[0].station || pair[1].tick > pair[0].tick + SLOWLY_FOUND_TICKS;
            assert!(faults.windows(2).all(is_roomy), "{with}");
            let ticks = faults.into_iter().map(|entry| entry.with_ticks);
            ticks.fold((u64::MAX, 0), |(least, most), ticks| (least.min(ticks), most.max(ticks)))
        };
        assert_eq!(["block fluid:active thread=\"keeper\"", "leak-memory tissue:both"].map(drawn), [(1, 40); 2]);
        assert_eq!(drawn("leak-files haptic:active"), (1, 8));
    }

    #[test]
    fn every_cell_has_its_count_in_every_arm_and_ticks_ascend_in_every_station() {
        let campaign = parse("t", TEXT).unwrap();
        let plan = plan(&campaign, 3);
        let mut counts: BTreeMap<(&str, &str), usize> = BTreeMap::new();
        for entry in &plan.faults {
            *counts.entry((&entry.arm, &entry.cell)).or_default() += 1;
            assert!(entry.phase_us < 1_000);
        }
        assert_eq!(counts.len(), 8);
        for ((arm, _), count) in counts {
            assert_eq!(count, if arm == "a" { 5 } else { 3 }, "half of 5, rounded up");
        }
        assert_eq!(plan.faults.iter().map(|entry| entry.index).collect::<Vec<_>>(), (0..32).collect::<Vec<_>>());
        for pair in plan.faults.windows(2) {
            assert!(pair[1].station == pair[0].station + 1 || pair[1].tick >= pair[0].tick + campaign.gap_ticks[0]);
            assert!(pair[1].station != pair[0].station || pair[1].arm == pair[0].arm);
        }
        assert!(plan.text().lines().count() == 34 && plan.text().contains("seed 3"));
    }
}
