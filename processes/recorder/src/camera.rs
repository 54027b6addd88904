//! Pictures of what happened: rendering is asked for one, and the first that it drew since goes into the recording. Promise: nobody waits for a picture; where
//! none is drawn, there is none; and each says only what had happened by then.

use crate::gather::Gather;
use crate::moments::{Mark, Moments};
use hyst_assessment::Judge;
use hyst_engine::Life;
use hyst_exchange::{system, whole};
use hyst_messages::page::recorder as layout;
use hyst_recording::{Block, Judged, Picture};

/// For so long a picture is asked for, ns: one that comes later shows something else.
const PATIENCE_NS: u64 = 3_000_000_000;
/// A session that has run for so long is seen no more as it begins, ticks.
const BEGIN_TICKS: u64 = 10_000;
/// Most pictures of one recorder's life: some 15 kB each.
const MOST: usize = 200;

/// What a picture is wanted of.
#[derive(Debug)]
struct Wanted {
    tick: u64,
    words: Vec<String>,
    until_ns: u64,
}

/// The camera.
#[derive(Debug)]
pub struct Camera {
    moments: Moments,
    /// Nobody has seen the begin yet.
    is_new: bool,
    wanted: Option<Wanted>,
    taken: usize,
}

impl Camera {
    /// Of a session; in one that is `continued` what the recorder before has kept of its referee is known already.
    pub fn of(life: &Life, continued: bool) -> Camera {
        let brief = std::fs::read_to_string(life.station.brief()).ok();
        let moments = match brief {
            Some(brief) if continued => {
                let kept = std::fs::read_to_string(life.station.recorder_judged()).ok();
                Moments::going_on(&brief, kept.and_then(|text| serde_json::from_str::<Judged>(&text).ok()).as_ref())
            }
            brief => Moments::after(brief.and_then(|brief| Judge::read(&brief).ok())),
        };
        Camera { moments, is_new: !continued, wanted: None, taken: 0 }
    }

    /// Keeps what the referee knows for a recorder that follows; before what that is of goes to the disk, so that nothing in the file is judged by nobody.
    pub fn keep(&self, life: &Life) {
        let Some(text) = self.moments.judged().and_then(|judged| serde_json::to_string(&judged).ok()) else { return };
        // Refused, who follows knows that it has not seen all.
        let _ = whole::write(&life.station.recorder_judged(), text.as_bytes());
    }

    /// Asks for a picture of what is new in the block behind the mark; puts into it the one that came of what was before.
    pub fn look(&mut self, life: &Life, gather: &Gather, block: &mut Block, mark: Mark) {
        if gather.has_pictures() && std::mem::replace(&mut self.is_new, false) && life.tick() < BEGIN_TICKS {
            self.want(life, life.tick(), "the session begins".into());
        }
        for (tick, words) in self.moments.take(block, mark) {
            self.want(life, tick, words);
        }
        let Some(wanted) = &self.wanted else { return };
        let shown = gather.picture(life).filter(|(tick, _)| *tick >= wanted.tick);
        if shown.is_none() && system::now_ns() < wanted.until_ns {
            return;
        }
        life.page.store64(layout::PICTURES_UNTIL_NS, 0);
        if let (Some(wanted), Some((tick, jpeg))) = (self.wanted.take(), shown) {
            self.taken += 1;
            block.pictures.push(Picture { tick, event_tick: wanted.tick, words: wanted.words.join("; "), jpeg });
        }
    }

    /// What the session's case has come to, by all that was looked at.
    pub fn judged(&self) -> Option<Judged> {
        self.moments.judged()
    }

    fn want(&mut self, life: &Life, tick: u64, words: String) {
        if self.taken >= MOST {
            return;
        }
        let until_ns = system::now_ns() + PATIENCE_NS;
        let wanted = self.wanted.get_or_insert_with(|| Wanted { tick, words: Vec::new(), until_ns });
        wanted.tick = wanted.tick.max(tick);
        wanted.words.push(words);
        life.page.store64(layout::PICTURES_UNTIL_NS, wanted.until_ns);
    }
}
