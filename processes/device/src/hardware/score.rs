//! A recording as the hand's score: read on an ordinary thread, ahead of the ticks that need it, so that no read of a disk meets the 1 kHz.

use hyst_engine::Failure;
use hyst_messages::{BUTTONS_CURRENT, HardwareSample, StepRecord};
use hyst_recording::{Moment, Playback};
use std::path::Path;
use std::sync::mpsc::{Receiver, TryRecvError, sync_channel};

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

    /// The hand in the tick after the one before. Where the device made none, and after the end, it stands still where it was, and at the end it lets go of the
    /// current: a recording that was cut may end in a stroke. A reader that is late holds it up, but no tick.
    pub fn next_sample(&mut self) -> HardwareSample {
        let next = if self.waits { self.moments.recv().map_err(TryRecvError::from) } else { self.moments.try_recv() };
        let moves = match &next {
            Ok((moment, _)) => {
                self.take(moment);
                moment.applied.is_some()
            }
            Err(_) => false,
        };
        if !moves {
            self.sample.velocity_m_s = [0.0; 3]; // the servos would damp a movement that is none
        }
        if matches!(next, Err(TryRecvError::Disconnected)) {
            self.sample.controls.buttons &= !BUTTONS_CURRENT;
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

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_messages::{AppliedRecord, BUTTON_ENERGIZED, BUTTON_EXTENDED};

    /// A tick in which the hand moves, and cuts.
    fn cutting(tick: u64) -> Moment {
        let mut sample = HardwareSample { hardware_tick: tick, velocity_m_s: [0.0, 0.0, 0.02], ..HardwareSample::default() };
        sample.controls.buttons = BUTTON_ENERGIZED | BUTTON_EXTENDED;
        Moment { applied: Some(AppliedRecord { tick, sample, ..AppliedRecord::default() }), ..Moment::default() }
    }

    /// It went on to say its last velocity beside a place that stood still, and to cut, for as long as the new station ran.
    #[test]
    fn a_hand_whose_recording_ends_in_a_stroke_stands_still_without_current() {
        for waits in [false, true] {
            let (to, moments) = sync_channel(AHEAD);
            let mut score = Score { moments, first_tick: 1, next_tick: 1, waits, sample: HardwareSample::default() };
            let mut next = || {
                let sample = score.next_sample();
                (sample.hardware_tick, sample.velocity_m_s[2], sample.controls.buttons)
            };
            let cuts = BUTTON_ENERGIZED | BUTTON_EXTENDED;
            to.send((cutting(1), Vec::new())).unwrap();
            to.send((Moment::default(), Vec::new())).unwrap();
            to.send((cutting(3), Vec::new())).unwrap();
            // The device made no second tick.
            assert_eq!([next(), next(), next()], [(1, 0.02, cuts), (1, 0.0, cuts), (3, 0.02, cuts)]);
            if !waits {
                assert_eq!(next(), (3, 0.0, cuts), "the reader is late");
            }
            drop(to);
            assert_eq!([next(), next()], [(3, 0.0, BUTTON_EXTENDED); 2]);
        }
    }
}
