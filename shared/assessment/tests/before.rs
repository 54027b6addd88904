//! What was judged before a replay begins: as much as a referee knew that had seen all of it.
#![allow(missing_docs)]

#[allow(dead_code)] // each test file uses its part
mod fixture;

use fixture::{busy, bytes_of};
use hyst_assessment::{EndedBy, Judge, judge_until};
use hyst_recording::{Block, Reader};
use hyst_scene::Brief;
use serde_json::json;
use std::io::Cursor;
use std::path::Path;

/// A case whose goals are so many millilitres removed each.
fn brief(removed_ml: &[f64]) -> Brief {
    let goals: Vec<_> = removed_ml.iter().map(|ml| json!({ "words": "take it", "is": { "removed": ml } })).collect();
    let end = json!({ "goals": true, "time_s": 100.0, "deficit_ml": null, "bled_ml": null, "perforation": false });
    let causes = [json!({ "bled_above": 0.1 }), json!({ "force_above": 0.8 })];
    let warnings: Vec<_> = causes.iter().map(|is| json!({ "words": "beware", "is": is })).collect();
    let brief = json!({
        "name": "A polyp", "rung": "polyp", "task": "Take it.", "seed": 3, "drawn": [], "pathology_ml": 2.0,
        "goals": goals, "end": end, "warnings": warnings, "score": {},
    });
    serde_json::from_value(brief).unwrap()
}

/// Three seconds in which 0.16 ml are removed after 1.61 s.
fn blocks() -> Vec<Block> {
    (0..15u64).map(|index| busy(5_000 + 200 * index, 200)).collect()
}

/// What comes after a tick, as it is seen live.
fn go_on(judge: &mut Judge, blocks: &[Block], tick: u64) {
    for record in blocks.iter().flat_map(|block| &block.applied).filter(|record| record.tick > tick) {
        for status in blocks.iter().flat_map(|block| &block.tissue).filter(|status| status.state_tick == record.tick) {
            judge.tissue(status);
        }
        for status in blocks.iter().flat_map(|block| &block.fluid).filter(|status| status.state_tick == record.tick) {
            judge.fluid(status);
        }
        judge.tick(record);
    }
}

#[test]
fn a_referee_goes_on_from_any_tick_of_a_recording_as_one_that_has_seen_what_was_before() {
    let (blocks, brief) = (blocks(), brief(&[0.05, 0.15, 1.5]));
    let bytes = bytes_of("before", &[("session", "test-1")], &blocks);
    let reader = || Reader::new(Cursor::new(&bytes), Path::new("session.mcap")).unwrap();
    let whole = judge_until(reader(), &brief, u64::MAX).unwrap();
    assert_eq!((whole.last_tick, whole.goals[1].reached_tick, whole.goals[2].reached_tick), (7_999, Some(6_610), None));
    assert!(whole.warnings.iter().all(|warning| warning.count > 0), "{:?}", whole.warnings);
    let text = serde_json::to_string(&brief).unwrap();
    for tick in [5_000, 5_850, 6_400, 6_610, 7_999] {
        let before = judge_until(reader(), &brief, tick).unwrap();
        assert_eq!(before.last_tick, tick);
        let kept = serde_json::to_string(&before).unwrap();
        let mut after = Judge::resume(&text, Some(&kept)).unwrap();
        assert_eq!(after, before, "{tick}");
        go_on(&mut after, &blocks, tick);
        assert_eq!(after, whole, "{tick}");
    }
}

#[test]
fn what_comes_after_the_end_of_a_session_is_not_read() {
    let bytes = bytes_of("over", &[("session", "test-1")], &blocks());
    let reader = Reader::new(Cursor::new(&bytes), Path::new("session.mcap")).unwrap();
    let judge = judge_until(reader, &brief(&[0.05, 0.15]), 7_999).unwrap();
    assert_eq!((judge.ended, judge.last_tick), (Some((EndedBy::Goals, 6_610)), 6_610));
}
