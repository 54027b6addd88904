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
    let whole = judge_until(reader(), &brief, u64::MAX, 2).unwrap();
    assert_eq!((whole.last_tick, whole.goals[1].reached_tick, whole.goals[2].reached_tick), (7_999, Some(6_610), None));
    assert!(whole.warnings.iter().all(|warning| warning.count > 0), "{:?}", whole.warnings);
    let text = serde_json::to_string(&brief).unwrap();
    for tick in [5_000, 5_850, 6_400, 6_610, 7_999] {
        let before = judge_until(reader(), &brief, tick, 1).unwrap();
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
    let judge = judge_until(reader, &brief(&[0.05, 0.15]), 7_999, 2).unwrap();
    assert_eq!((judge.ended, judge.last_tick), (Some((EndedBy::Goals, 6_610)), 6_610));
}

/// All blocks before a time were read, states and all, however late it was.
#[test]
fn what_was_kept_of_a_referee_is_gone_on_from_and_nothing_before_it_is_read() {
    let (mut blocks, brief) = (blocks(), brief(&[0.05, 0.15, 1.5]));
    let plain = bytes_of("kept-plain", &[("session", "test-1")], &blocks);
    let judged = |bytes: &[u8], case: &Brief, tick: u64| {
        judge_until(Reader::new(Cursor::new(bytes), Path::new("session.mcap")).unwrap(), case, tick, 2).unwrap()
    };
    // As a recorder keeps it every five seconds, here twice in three.
    for index in [4, 9] {
        let tick = blocks[index].applied.last().unwrap().tick;
        let kept = judged(&plain, &brief, tick).kept(blocks[index].tissue[0].state_tick).unwrap();
        assert_eq!(kept.tick, tick);
        blocks[index].judged.push(kept);
    }
    let whole = bytes_of("kept-whole", &[("session", "test-1")], &blocks);
    for tick in [5_000, 5_850, 5_999, 6_000, 6_400, 6_610, 6_999, 7_000, 7_999] {
        assert_eq!(judged(&whole, &brief, tick), judged(&plain, &brief, tick), "{tick}");
    }
    // What was before it is not there any more: the light came on, and the first goal was reached there.
    let rest = bytes_of("kept-rest", &[("session", "test-1")], &blocks[9..]);
    assert_eq!(judged(&rest, &brief, 7_999), judged(&plain, &brief, 7_999));
    assert_eq!(judged(&rest[..rest.len() - 1], &brief, 7_999), judged(&plain, &brief, 7_999), "without a summary, too");
    // Of another case nothing is taken; nor what no referee of this build has written.
    let other = self::brief(&[0.1]);
    assert_eq!(judged(&whole, &other, 7_999), judged(&plain, &other, 7_999));
    blocks[9].judged[0].judge = "{}".into();
    let spoilt = bytes_of("kept-spoilt", &[("session", "test-1")], &blocks);
    assert_eq!(judged(&spoilt, &brief, 7_999), judged(&plain, &brief, 7_999));
}
