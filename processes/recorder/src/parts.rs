//! A block of what waited for the disk, in parts that the file takes one after the other. Promise: a recorder that dies between two of them loses nothing of
//! what it had noted, and who goes on after the ticks of the first does not write again what came with them.

use crate::said::SLACK_TICKS;
use hyst_recording::Block;
use std::collections::VecDeque;
use std::mem::{replace, take};

/// Ticks in one block of the file.
pub const BLOCK_TICKS: usize = 1_000;

/// The ticks in some parts, the first with the statuses, each with what is noted of its ticks; then each checkpoint, file and picture by itself, so that one
/// that is damaged costs no ticks.
pub fn parts(mut block: Block) -> VecDeque<Block> {
    let (checkpoints, pictures, scene) = (take(&mut block.checkpoints), take(&mut block.pictures), take(&mut block.scene));
    let judged = take(&mut block.judged);
    let mut parts = VecDeque::new();
    while block.applied.len() > BLOCK_TICKS {
        let mut later = Block { applied: block.applied.split_off(BLOCK_TICKS), ..Block::default() };
        leave(&mut block, &mut later);
        parts.push_back(replace(&mut block, later));
    }
    parts.push_back(block);
    parts.extend(checkpoints.into_iter().map(|checkpoint| Block { checkpoints: vec![checkpoint], ..Block::default() }));
    parts.extend(judged.into_iter().map(|judged| Block { judged: vec![judged], ..Block::default() }));
    parts.extend(scene.into_iter().map(|file| Block { scene: vec![file], ..Block::default() }));
    parts.extend(pictures.into_iter().map(|picture| Block { pictures: vec![picture], ..Block::default() }));
    parts
}

/// Leaves to what comes later what is noted of ticks behind a part's last. Ticks that are not there are named with the one behind them, and an event comes with
/// the ticks that it has waited for.
fn leave(part: &mut Block, later: &mut Block) {
    let last_tick = part.applied.last().map_or(0, |record| record.tick);
    later.events = part.events.extract_if(.., |event| event.tick.saturating_add(SLACK_TICKS) > last_tick).collect();
    later.processes = part.processes.extract_if(.., |spell| spell.tick > last_tick).collect();
    later.lost = part.lost.extract_if(.., |range| range.last >= last_tick).collect();
    later.unmade = part.unmade.extract_if(.., |range| range.last >= last_tick).collect();
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_messages::{AppliedRecord, Role};
    use hyst_recording::{Checkpoint, Event, Level, Picture, ProcessSpell, Reader, Session, TickRange, Writer};

    fn block(ticks: impl Iterator<Item = u64>) -> Block {
        Block { applied: ticks.map(|tick| AppliedRecord { tick, ..Default::default() }).collect(), ..Block::default() }
    }

    fn range(first: u64, last: u64) -> TickRange {
        TickRange { first, last }
    }

    fn event(tick: u64) -> Event {
        let (kind, process, text) = ("died".into(), "tissue:0".into(), String::new());
        Event { tick, level: Level::Warning, kind, process, incarnation: 4, text }
    }

    fn spell(tick: u64) -> ProcessSpell {
        let [wakeup_p99_us, loop_p50_us, loop_p99_us] = [1.0; 3];
        let process = "tissue:0".into();
        ProcessSpell {
            tick,
            process,
            incarnation: 4,
            ticks: 1_000,
            steps: 1_000,
            overruns: 0,
            wakeup_p99_us,
            loop_p50_us,
            loop_p99_us,
        }
    }

    /// A disk had stood still for a minute, and a recorder died half-way through what had waited: the names of the ticks that were lost, and what had happened
    /// in those that were written, were with the last of them, and came into no file.
    #[test]
    fn what_is_noted_of_a_tick_is_written_with_it_and_not_with_the_last_of_what_waited() {
        let whole = Block {
            events: vec![event(300), event(990), event(2_400), event(9_000)],
            processes: vec![spell(1_000), spell(2_000), spell(3_000)],
            // What was dropped from the old end while the disk stood still is named last.
            lost: vec![range(1_001, 1_003), range(1, 4)],
            unmade: vec![range(500, 501), range(2_502, 2_503)],
            ..block((5..500).chain(502..1_001).chain(1_004..2_502).chain(2_504..2_600))
        };
        let (events, spells) = (whole.events.len(), whole.processes.len());
        let parts = parts(whole);
        let noted = |part: &Block| {
            let last_tick = part.applied.last().map(|record| record.tick);
            let events: Vec<u64> = part.events.iter().map(|event| event.tick).collect();
            let spells: Vec<u64> = part.processes.iter().map(|spell| spell.tick).collect();
            (last_tick, events, spells, part.lost.clone(), part.unmade.clone())
        };
        let found: Vec<_> = parts.iter().map(noted).collect();
        let expected = [
            (Some(1_009), vec![300], vec![1_000], vec![range(1_001, 1_003), range(1, 4)], vec![range(500, 501)]),
            (Some(2_009), vec![990], vec![2_000], vec![], vec![]),
            (Some(2_599), vec![2_400, 9_000], vec![3_000], vec![], vec![range(2_502, 2_503)]),
        ];
        assert_eq!(found, expected);
        let sum = |count: fn(&Block) -> usize| parts.iter().map(count).sum::<usize>();
        assert_eq!((sum(|part| part.events.len()), sum(|part| part.processes.len())), (events, spells));
        // Between two parts: who goes on after the first names what lies there.
        let between = Block { lost: vec![range(1_001, 1_003)], ..block((1..1_001).chain(1_004..1_100)) };
        let named: Vec<usize> = super::parts(between).iter().map(|part| part.lost.len()).collect();
        assert_eq!(named, [0, 1]);
    }

    #[test]
    fn a_checkpoint_or_a_picture_comes_by_itself_behind_the_ticks() {
        let path = std::env::temp_dir().join(format!("hyst-parts-{}.mcap", std::process::id()));
        let mut writer = Writer::open(&path, &Session::from([("session".into(), "s".into())])).unwrap();
        let checkpoint = |tick| Checkpoint { role: Role::Tissue, tick, state: vec![1; 8] };
        let picture = Picture { tick: 2_000, event_tick: 1_990, words: String::new(), jpeg: vec![0xff, 0xd8, 0xff, 0xd9] };
        let (checkpoints, pictures) = (vec![checkpoint(2_400), checkpoint(2_450)], vec![picture]);
        let whole = Block { checkpoints, pictures, lost: vec![range(2_490, 2_499)], ..block((1..2_490).chain([2_500])) };
        parts(whole).iter().for_each(|part| writer.append(part).unwrap());
        drop(writer);
        let mut reader = Reader::open(&path).unwrap();
        let mut parts = Vec::new();
        while let Some(block) = reader.next_block().unwrap() {
            parts.push((block.applied.len(), block.lost.len(), block.checkpoints.len(), block.pictures.len()));
        }
        assert_eq!(
            parts,
            [(1_000, 0, 0, 0), (1_000, 0, 0, 0), (490, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 1, 0), (0, 0, 0, 1)]
        );
        std::fs::remove_file(&path).unwrap();
    }
}
