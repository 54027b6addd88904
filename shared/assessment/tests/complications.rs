//! The cases of a perforation and of an overload, as shipped: who brings the complication about and stops has less than who does the task without it.
#![allow(missing_docs)]

#[allow(dead_code)] // each test file uses its part
mod fixture;

use fixture::{bytes_of, fluid, record, tissue};
use hyst_assessment::{Scores, assess, scores};
use hyst_messages::FluidStatus;
use hyst_recording::{Block, Reader};
use hyst_scene::{Brief, find_case};
use std::io::Cursor;
use std::path::Path;

/// The pump's bit of a perforation.
const PERFORATION: u32 = 8;
/// When it goes wrong where it does, and how long after that the inflow is shut, ticks.
const WRONG_TICK: u64 = 2_000;
const STOP_TICKS: u64 = 500;
/// Ticks of a block, and how many blocks there are: ten seconds.
const BLOCK_TICKS: u64 = 200;
const BLOCKS: u64 = 50;
/// In so many of these ticks all that is taken off comes off, evenly.
const WORK_TICKS: f64 = 8_000.0;

fn brief(case: &str) -> Brief {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../../assets/cases/{case}.toml"));
    find_case(&path, None).unwrap_or_else(|error| panic!("{error}")).unwrap().brief
}

/// What a trainee does of a case.
#[derive(Clone, Copy)]
struct Story {
    /// Share of the pathology that is taken off in the end.
    removed: f64,
    /// Alarms of the pump, and the deficit, ml, from when it goes wrong on.
    alarms: u32,
    deficit_ml: f64,
    /// Whether the inflow is shut then.
    stops: bool,
}

const RESECTS: Story = Story { removed: 0.85, alarms: 0, deficit_ml: 20.0, stops: false };

/// The scores of a session of ten seconds in which the hand moves once.
fn told(case: &str, brief: &Brief, story: Story) -> Scores {
    let block = |first: u64| {
        let is_wrong = first >= WRONG_TICK;
        let applied = (first..first + BLOCK_TICKS).map(|tick| {
            let mut record = record(tick, [0.0, 0.0, if tick < 100 { 0.03 } else { 0.0312 }], 0.0);
            if story.stops && tick >= WRONG_TICK + STOP_TICKS {
                record.sample.controls.inflow_valve = 0.0;
            }
            record
        });
        let (alarms, deficit_ml) = if is_wrong { (story.alarms, story.deficit_ml) } else { (0, 20.0) };
        let removed = story.removed * (first as f64 / WORK_TICKS).min(1.0);
        Block {
            applied: applied.collect(),
            fluid: vec![FluidStatus { alarms, ..fluid(first, 70.0, deficit_ml) }],
            tissue: vec![tissue(first, 1, removed * brief.pathology_ml)],
            ..Block::default()
        }
    };
    let blocks: Vec<Block> = (0..BLOCKS).map(|index| block(BLOCK_TICKS * index)).collect();
    let text = serde_json::to_string(brief).unwrap();
    let bytes = bytes_of(case, &[("case", text.as_str())], &blocks);
    let assessment = assess(Reader::new(Cursor::new(&bytes), Path::new("session.mcap")).unwrap(), 1, |_| {});
    assert_eq!(assessment.unread, None);
    scores(&assessment.measured)
}

/// A metric's value and score.
fn metric(scores: &Scores, key: &str) -> (Option<f64>, Option<f64>) {
    let found = scores.metrics.iter().find(|metric| metric.definition.key == key).unwrap_or_else(|| panic!("no {key}"));
    (found.value, found.score)
}

#[test]
fn who_pierces_the_wall_has_no_full_safety_also_without_a_case() {
    let block = |first: u64| Block {
        applied: (first..first + BLOCK_TICKS).map(|tick| record(tick, [0.0, 0.0, 0.03], 0.0)).collect(),
        fluid: vec![FluidStatus { alarms: if first >= WRONG_TICK { PERFORATION } else { 0 }, ..fluid(first, 70.0, 0.0) }],
        ..Block::default()
    };
    let of = |name: &str, blocks: u64| {
        let blocks: Vec<Block> = (0..blocks).map(|index| block(BLOCK_TICKS * index)).collect();
        scores(&fixture::of_blocks(name, &blocks).measured)
    };
    let (whole, pierced) = (of("whole", 10), of("pierced", 11));
    assert_eq!(metric(&whole, "perforations"), (Some(0.0), Some(100.0)));
    assert_eq!(metric(&pierced, "perforations"), (Some(1.0), Some(0.0)));
    // Forces weigh 7 and are all at their best.
    let [of_whole, of_pierced] = [whole, pierced].map(|scores| scores.groups[2].unwrap());
    assert!((of_whole - 100.0).abs() < 1e-9 && (of_pierced - 100.0 * 7.0 / 11.0).abs() < 1e-9, "{of_whole} {of_pierced}");
}

#[test]
fn to_pierce_the_wall_at_once_and_to_stop_is_not_the_surest_way_through_the_case_of_a_perforation() {
    let brief = brief("perforation");
    let pierces = Story { removed: 0.0, alarms: PERFORATION, deficit_ml: 60.0, stops: true };
    let nearly = Story { removed: 0.79, ..RESECTS };
    let [resects, stops, nearly] = [RESECTS, pierces, nearly].map(|story| told("perforation", &brief, story));
    assert_eq!((resects.done, stops.done), (1.0, 1.0), "each has done what was asked for");
    assert!((nearly.done - 0.79 / 0.8).abs() < 1e-9, "{}", nearly.done);
    assert!(stops.total < nearly.total && nearly.total < resects.total, "{:?}: nearly all of it without a hole", nearly.total);
    assert_eq!((metric(&resects, "perforations").1, metric(&stops, "perforations").1), (Some(100.0), Some(0.0)));
    let [of_resects, of_stops] = [&resects, &stops].map(|scores| scores.total.unwrap());
    assert!(of_stops + 5.0 < of_resects, "{of_stops} of who pierces it, {of_resects} of who resects");
}

#[test]
fn to_be_overloaded_at_once_and_to_stop_is_not_the_surest_way_through_the_case_of_an_overload() {
    let brief = brief("fluid-overload");
    let floods = Story { removed: 0.0, alarms: 0, deficit_ml: 101.0, stops: true };
    let [resects, stops] = [RESECTS, floods].map(|story| told("fluid-overload", &brief, story));
    assert_eq!((resects.done, stops.done), (1.0, 1.0));
    assert_eq!(metric(&stops, "warnings"), (Some(0.0), Some(100.0)), "what everybody comes to who is to stop is a notice");
    let [of_resects, of_stops] = [&resects, &stops].map(|scores| scores.total.unwrap());
    assert!(of_stops + 5.0 < of_resects, "{of_stops} of who is overloaded, {of_resects} of who resects");
}
