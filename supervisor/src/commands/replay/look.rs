//! What a replay knows of a recording before anything starts. One that is to be verified, or whose summary does not tell where it ends, is read to its end.
//! Of any other only what lies before the time that is asked for is read at once; the rest is while it is shown, some time ahead of what is shown, and the
//! station ends where something of it is missing.

use super::refuse;
use crate::cli::ReplayArgs;
use crate::remains;
use crate::settings::Refusal;
use hyst_exchange::{OwnedPage, Station, system};
use hyst_messages::page::station as layout;
use hyst_recording::{Block, Damage, Ending, Outline, ReadError, Reader, Session, TickRange, outline};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

/// Why a recording cannot be done again: there is nothing, or not what is needed.
const NO_TICK: &str = "holds no tick of a session; give one that was recorded for longer";
const TOO_OLD: &str =
    "does not say what each step was made from: it was recorded by an older version; `hystation report` reads it";

/// Ticks that are looked at ahead of what is shown: blocks are read much faster than they are shown, and all at once would take the engines' cores.
const AHEAD_TICKS: u64 = 60_000;
/// Between two looks at how far it is shown: fewer ticks than a block has, so that nothing of what follows one that is damaged is shown.
const LOOK_NS: u64 = 5_000_000;

/// What a recording says of itself.
pub struct Whole {
    /// The session's facts.
    pub session: Session,
    /// The last tick up to which nothing is missing, as far as is known.
    pub end_tick: u64,
    /// Why it ends there, if that is not its end.
    pub missing: Option<String>,
    /// The byte at which the file ends without having been closed.
    pub cut_at: Option<u64>,
    /// Whether all of it was looked at.
    pub is_seen: bool,
    /// Which share of its ticks is up to there, as far as is known.
    pub share: f64,
}

/// What was seen of it up to a block.
struct Seen {
    begin_tick: u64,
    last_tick: Option<u64>,
    /// The last tick before anything that is damaged.
    whole_tick: u64,
    first_lost: Option<TickRange>,
    has_steps: bool,
}

impl Seen {
    /// Nothing, from the tick on at which the replay begins.
    fn new(begin_tick: u64) -> Seen {
        // Who has checkpoints has steps, too.
        Seen { begin_tick, last_tick: None, whole_tick: 0, first_lost: None, has_steps: begin_tick > 0 }
    }

    fn follow(&mut self, block: &Block, is_undamaged: bool) {
        self.last_tick = block.applied.last().map(|record| record.tick).or(self.last_tick);
        if is_undamaged {
            self.whole_tick = self.last_tick.unwrap_or(0);
        }
        self.has_steps |= !block.steps.is_empty();
        self.lose(&block.lost);
    }

    fn lose(&mut self, ranges: &[TickRange]) {
        let lost = ranges.iter().filter(|range| range.last > self.begin_tick).copied();
        self.first_lost = lost.chain(self.first_lost).min_by_key(|range| range.first);
    }

    /// Whether a replay can begin, and comes to a tick.
    fn comes_to(&self, tick: u64) -> bool {
        self.has_steps && self.last_tick.is_some_and(|last| last >= tick)
    }

    /// What is missing, if anything is, and the last tick before it; `damage`: the first of it; `ended`: whether it could be read.
    fn end(&self, last_tick: u64, damage: Option<&Damage>, ended: Result<(), ReadError>) -> (Option<String>, u64) {
        match (self.first_lost, damage, ended) {
            (Some(TickRange { first, .. }), ..) => (Some(format!("tick {first} is lost")), first.saturating_sub(1)),
            (None, Some(damage), _) => (Some(format!("byte {} {}", damage.at, damage.reason)), self.whole_tick),
            (None, None, Err(error)) => (Some(error.to_string()), last_tick),
            (None, None, Ok(())) => (None, last_tick),
        }
    }
}

/// Looks at a recording from the tick at which the replay begins; it is shown from `from_tick` on.
pub fn look_through(args: &ReplayArgs, from_tick: u64, begin_tick: u64) -> Result<Whole, Refusal> {
    let refuse = |what: &str| refuse(args, what);
    let unread = |error: ReadError| Refusal::input(error.to_string());
    let mut reader = crate::commands::report::open(&args.file)?;
    let outline = if args.verify { None } else { outline(&args.file).map_err(unread)? };
    if begin_tick > 0 {
        reader.skip_to(begin_tick).map_err(unread)?;
    }
    let session = reader.session().clone();
    let mut seen = Seen::new(begin_tick);
    let ended = loop {
        let block = match reader.next_block() {
            Ok(Some(block)) => block,
            Ok(None) => break Ok(()),
            Err(error) => break Err(error),
        };
        seen.follow(&block, reader.damage().is_empty());
        if let Some(Outline { last_tick, lost }) = &outline
            && reader.damage().is_empty()
            && seen.comes_to(from_tick)
        {
            seen.lose(lost);
            let (missing, end_tick) = seen.end(*last_tick, None, Ok(()));
            return whole(args, Whole { session, end_tick, missing, cut_at: None, is_seen: false, share: 1.0 });
        }
    };
    let last_tick = seen.last_tick.ok_or_else(|| refuse(NO_TICK))?;
    if !seen.has_steps {
        return Err(refuse(TOO_OLD));
    }
    let (missing, end_tick) = seen.end(last_tick, reader.damage().first(), ended);
    let cut_at = match reader.ending() {
        Some(Ending::Cut { at }) if missing.is_none() => Some(at),
        _ => None,
    };
    let share = end_tick as f64 / last_tick.max(1) as f64;
    whole(args, Whole { session, end_tick, missing, cut_at, is_seen: true, share })
}

/// Refuses what has nothing before that which is missing.
fn whole(args: &ReplayArgs, whole: Whole) -> Result<Whole, Refusal> {
    if whole.end_tick == 0 {
        return Err(refuse(args, whole.missing.as_deref().unwrap_or(NO_TICK)));
    }
    Ok(whole)
}

/// Looks at what is shown, ahead of it, until it is over, and ends the station where something is missing. Gives what is, and the last tick before it.
pub fn look_ahead(station: &Station, file: &Path, begin_tick: u64, is_over: &AtomicBool) -> Option<(String, u64)> {
    let mut page = None;
    let (missing, end_tick) = find_missing(station, file, begin_tick, is_over, &mut page)?;
    while !is_over.load(Ordering::Relaxed) {
        if let Some(page) = own_page(station, &mut page)
            && page.load64(layout::ENDED_TICK) >= end_tick
        {
            page.store32_and_wake(layout::STOP, 1);
            page.bump_and_wake(layout::CHANGES);
            break;
        }
        system::sleep_ns(LOOK_NS);
    }
    Some((missing, end_tick))
}

fn find_missing(
    station: &Station,
    file: &Path,
    begin_tick: u64,
    is_over: &AtomicBool,
    page: &mut Option<OwnedPage>,
) -> Option<(String, u64)> {
    let mut seen = Seen::new(begin_tick);
    let told = |(missing, end_tick): (Option<String>, u64)| Some((missing?, end_tick));
    let mut reader = match Reader::open(file).and_then(|mut reader| reader.skip_to(begin_tick).map(|()| reader)) {
        Ok(reader) => reader,
        Err(error) => return told(seen.end(begin_tick, None, Err(error))),
    };
    while !is_over.load(Ordering::Relaxed) {
        let shown_tick = own_page(station, page).map_or(begin_tick, |page| page.load64(layout::ENDED_TICK));
        let last_tick = seen.last_tick.unwrap_or(begin_tick);
        if last_tick > shown_tick.max(begin_tick) + AHEAD_TICKS {
            system::sleep_ns(LOOK_NS);
            continue;
        }
        let (is_end, ended) = match reader.next_block() {
            Ok(Some(block)) => {
                seen.follow(&block, reader.damage().is_empty());
                (false, Ok(()))
            }
            Ok(None) => (true, Ok(())),
            Err(error) => (true, Err(error)),
        };
        let found = seen.end(seen.last_tick.unwrap_or(begin_tick), reader.damage().first(), ended);
        if is_end || found.0.is_some() {
            return told(found);
        }
    }
    None
}

/// The station's page, once this process keeps it: another's of that name, which is still to be refused, is none of a replay's.
pub fn own_page<'a>(station: &Station, page: &'a mut Option<OwnedPage>) -> Option<&'a OwnedPage> {
    if page.is_none() && remains::guardian(station).is_some_and(|guardian| guardian.pid == std::process::id()) {
        *page = station.open_for_keeping().ok();
    }
    page.as_ref()
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_messages::{AppliedRecord, StepRecord};

    fn block(ticks: std::ops::RangeInclusive<u64>) -> Block {
        let steps = vec![StepRecord { tick: *ticks.start(), ..StepRecord::default() }];
        Block {
            applied: ticks.map(|tick| AppliedRecord { tick, ..AppliedRecord::default() }).collect(),
            steps,
            ..Block::default()
        }
    }

    #[test]
    fn a_replay_ends_before_what_is_lost_or_damaged_whichever_way_that_was_learned() {
        let mut seen = Seen::new(0);
        assert!(!seen.comes_to(0), "nothing was seen");
        seen.follow(&block(1..=200), true);
        assert!(seen.comes_to(200) && !seen.comes_to(201));
        assert_eq!(seen.end(900, None, Ok(())), (None, 900));
        // A block that is damaged lies before the next.
        seen.follow(&block(401..=600), false);
        let damage = Damage { at: 77, reason: "is bad".into() };
        assert_eq!(seen.end(600, Some(&damage), Ok(())), (Some("byte 77 is bad".into()), 200));
        // What was lost before the tick at which the replay begins does not count; of the rest the first does.
        let range = |first, last| TickRange { first, last };
        let mut later = Seen::new(100);
        later.lose(&[range(300, 310), range(50, 60), range(250, 251)]);
        assert_eq!(later.end(900, None, Ok(())), (Some("tick 250 is lost".into()), 249));
    }
}
