//! A recording as the hand's score: read on an ordinary thread, ahead of the ticks that need it, so that no read of a disk meets the 1 kHz.

use hyst_engine::Failure;
use hyst_messages::{HardwareSample, StepRecord};
use hyst_recording::{Moment, Playback};
use std::path::Path;
use std::sync::mpsc::{Receiver, sync_channel};

/// Ticks that are read ahead: the disk may stall this long.
const AHEAD: usize = 4_096;

/// The moments of a recording in the order of their ticks, from its first on.
pub struct Score {
    moments: Receiver<(Moment, Vec<StepRecord>)>,
    first_tick: u64,
    /// The tick that comes next.
    next_tick: u64,
    /// On a virtual clock the hand waits for the reader.
    pub waits: bool,
    sample: HardwareSample,
}

impl Score {
    /// Opens a recording and begins to read, from the tick after `begin_tick` on.
    pub fn open(path: &Path, begin_tick: u64) -> Result<Score, Failure> {
        let input = |error: hyst_recording::ReadError| Failure::Input(error.to_string());
        let mut playback = Playback::open(path).map_err(input)?;
        if begin_tick > 0 {
            playback.skip_to(begin_tick + 1).map_err(input)?;
        }
        let first_tick = playback.first_tick().map_err(input)?;
        let first_tick = first_tick.ok_or_else(|| Failure::Input(format!("recording {}: holds no tick", path.display())))?;
        let first_tick = if begin_tick > 0 { first_tick.max(begin_tick + 1) } else { first_tick };
        let sample = playback.first_applied().map_err(input)?.map(|applied| applied.sample).unwrap_or_default();
        let (to, moments) = sync_channel(AHEAD);
        let read = move || {
            // What cannot be read any more ends the score, as the end of the file does.
            let mut tick = first_tick;
            while let Ok(Some(moment)) = playback.at(tick) {
                if to.send((moment, playback.due(tick))).is_err() {
                    return; // the hand has gone
                }
                tick += 1;
            }
        };
        let reader = std::thread::Builder::new().name("score".into()).spawn(read);
        reader.map_err(|error| Failure::Broken(format!("a thread for the recording: {error}")))?;
        Ok(Score { moments, first_tick, next_tick: first_tick, waits: false, sample })
    }

    /// The hand in the tick after the one before; where the device made none, and after the end, as it was. A reader that is late holds it up, but no tick.
    pub fn next_sample(&mut self) -> HardwareSample {
        let next = if self.waits { self.moments.recv().ok() } else { self.moments.try_recv().ok() };
        if let Some((moment, _)) = next {
            self.take(&moment);
        }
        self.sample
    }

    /// What happened in a tick, and the tissue's steps that come before what the device did in it, waiting for the reader: for a clock that is virtual. Asked for
    /// ascending ticks; empty before the first and after the last.
    pub fn at(&mut self, tick: u64) -> (Moment, Vec<StepRecord>) {
        let mut found = Default::default();
        while tick >= self.first_tick && self.next_tick <= tick {
            let Ok(next) = self.moments.recv() else { return Default::default() };
            self.take(&next.0);
            found = next;
        }
        found
    }

    /// The hand as it was in the last tick that was asked for; before any, in the first.
    pub fn sample(&self) -> HardwareSample {
        self.sample
    }

    fn take(&mut self, moment: &Moment) {
        self.next_tick += 1;
        self.sample = moment.applied.map_or(self.sample, |applied| applied.sample);
    }
}
