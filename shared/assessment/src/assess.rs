//! One pass over a recording, block by block: everything that the report says is summed up on the way.

use crate::anatomy::Anatomy;
use crate::conduct::Conduct;
use crate::curves::Curves;
use crate::electrode::Electrode;
use crate::force::{Force, length, touches};
use crate::in_view::InView;
use crate::judge::Judge;
use crate::medium::{HOLD_TICKS, Medium};
use crate::motion::{Motion, finite};
use crate::row::{Row, Rows, Statuses};
use hyst_messages::{AppliedRecord, FluidStatus, TissueStatus};
use hyst_recording::{Block, Damage, Ending, Picture, ReadError, Reader, Session};
use hyst_scene::Brief;
use std::io::{Read, Seek};

/// Most pictures that are shown; a recorder takes as many.
const MOST_PICTURES: usize = 200;
/// A status comes to the recorder at most so long after its tick, ticks: a fluid's step takes some tens.
const LATE_TICKS: u64 = 1_000;

/// What is summed up.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Measured {
    /// How the scope was moved.
    pub motion: Motion,
    /// The force on the hand.
    pub force: Force,
    /// The largest force that the device states of itself, N: the newest that is recorded.
    pub device_max_n: Option<f64>,
    /// The loop electrode.
    pub electrode: Electrode,
    /// Pressure, deficit, flow, valves, light.
    pub medium: Medium,
    /// Whether the pathology was in view.
    pub in_view: InView,
    /// The newest status of the tissue, of those before the end.
    pub tissue: Option<TissueStatus>,
    /// How much of the scene was to be removed, ml, if there was anything and the recording says it.
    pub pathology_ml: Option<f64>,
    /// The judgement by the session's case, if it has one.
    pub judge: Option<Judge>,
    /// What the station did.
    pub conduct: Conduct,
    /// What the page draws.
    pub curves: Curves,
    /// What was seen when something happened, in the order of the file.
    pub pictures: Vec<Picture>,
    /// The newest statuses.
    latest: Statuses,
}

/// What came of a recording.
#[derive(Clone, Debug, PartialEq)]
pub struct Assessment {
    /// The session's facts.
    pub session: Session,
    /// What was summed up.
    pub measured: Measured,
    /// What of the file was left out.
    pub damage: Vec<Damage>,
    /// How the file ends; `None` if it could not be read to its end.
    pub ending: Option<Ending>,
    /// Why it could not be read to its end.
    pub trouble: Option<String>,
    /// Why nothing is judged by the case that the recording names.
    pub unread: Option<String>,
    /// The scene behind the way of the tip, from who has loaded it.
    pub anatomy: Option<Anatomy>,
    /// Why there is none, from who has tried.
    pub undrawn: Option<String>,
}

/// Reads a recording to its end, with so many threads, and gives ten rows a second to `give`.
pub fn assess<R: Read + Seek>(mut reader: Reader<R>, threads: usize, mut give: impl FnMut(&Row)) -> Assessment {
    let judge = reader.session().get("case").map(|brief| Judge::read(brief));
    let (judge, unread) = judge.transpose().map_or_else(|error| (None, Some(error)), |judge| (judge, None));
    let pathology_ml = reader.session().get("pathology_ml").and_then(|ml| ml.parse::<f64>().ok());
    let pathology_ml = pathology_ml.filter(|ml| ml.is_finite() && *ml > 0.0);
    let mut measured = Measured { judge, pathology_ml, ..Measured::default() };
    let mut rows = Rows::default();
    let read = reader.each_block(threads, |block| measured.take(block, &mut rows, &mut give));
    rows.finish().iter().for_each(&mut give);
    Assessment {
        session: reader.session().clone(),
        measured,
        damage: reader.damage().to_vec(),
        ending: reader.ending(),
        trouble: read.err().map(|error| error.to_string()),
        unread,
        anatomy: None,
        undrawn: None,
    }
}

/// What a referee that has seen a recording from its beginning up to a tick says of it: what one goes on from that sees it from there on alone. It goes on from
/// what the recorder kept of one by then, where that is there and of this case, has so many threads decode what is to be read, and stops there, or where the
/// session is over.
///
/// # Errors
/// Why the recording cannot be read up to there.
pub fn judge_until<R: Read + Seek>(
    mut reader: Reader<R>,
    brief: &Brief,
    last_tick: u64,
    threads: usize,
) -> Result<Judge, ReadError> {
    let mut measured = Measured { judge: Some(Judge::new(brief.clone())), ..Measured::default() };
    let kept = reader.judged(last_tick)?;
    if let Some((judge, kept)) = kept.and_then(|kept| Some((Judge::of_kept(&kept, brief)?, kept))) {
        // What it has seen it does not take again.
        reader.skip_to(kept.tick.saturating_sub(LATE_TICKS))?;
        measured.judge = Some(judge);
        measured.latest.0 = Some(TissueStatus { state_tick: kept.tissue_tick, ..TissueStatus::default() });
    }
    let mut rows = Rows::default();
    let mut take = |mut block: Block| {
        let is_there = block.applied.last().is_some_and(|record| record.tick >= last_tick);
        block.applied.retain(|record| record.tick <= last_tick);
        block.tissue.retain(|status| status.state_tick <= last_tick);
        block.fluid.retain(|status| status.state_tick <= last_tick);
        block.pictures.clear(); // nobody looks at them
        measured.take(block, &mut rows, &mut |_: &Row| {});
        !is_there && !measured.is_over()
    };
    reader.each_block_while(threads, &mut take)?;
    Ok(measured.judge.unwrap_or_else(|| Judge::new(brief.clone())))
}

impl Assessment {
    /// Whether there is anything to tell of.
    pub fn is_empty(&self) -> bool {
        self.measured.conduct.ticks == 0
    }

    /// What is missing of the recording, a sentence each; nothing of one that is whole. Ticks that the device skipped are none of it: there was nothing
    /// to be recorded.
    pub fn missing(&self) -> Vec<String> {
        let mut sentences: Vec<String> = self.trouble.iter().chain(&self.unread).cloned().collect();
        for damage in &self.damage {
            sentences.push(format!("the record at byte {} was left out: {}", damage.at, damage.reason));
        }
        if let Some(Ending::Cut { at }) = self.ending {
            sentences.push(format!("the file ends at byte {at} without a summary: cut, or its recorder died or still writes"));
        }
        if self.measured.conduct.lost > 0 {
            sentences.push(format!("the recorder lost {} ticks, and said so", self.measured.conduct.lost));
        }
        sentences
    }
}

impl Measured {
    /// Takes a block; statuses and ticks in the order of their time.
    fn take(&mut self, block: Block, rows: &mut Rows, give: &mut impl FnMut(&Row)) {
        block.lost.iter().for_each(|range| self.conduct.lose(range));
        let mut tissue = block.tissue.iter().peekable();
        let mut fluid = block.fluid.iter().peekable();
        for record in &block.applied {
            let is_new = self.conduct.admit(record);
            while let Some(status) = tissue.next_if(|status| status.state_tick <= record.tick) {
                self.tissue(status);
            }
            while let Some(status) = fluid.next_if(|status| status.state_tick <= record.tick) {
                self.fluid(status);
            }
            if is_new {
                let when = (self.tick(record), self.is_of_session(record.tick));
                rows.tick(record, when, self.statuses(record.tick)).iter().for_each(&mut *give);
            }
        }
        tissue.for_each(|status| self.tissue(status));
        fluid.for_each(|status| self.fluid(status));
        block.processes.iter().for_each(|spell| self.conduct.processes.note(spell));
        let room = MOST_PICTURES.saturating_sub(self.pictures.len());
        self.pictures.extend(block.pictures.into_iter().take(room));
        block.events.into_iter().for_each(|event| self.conduct.note(event));
    }

    /// What is known at a tick: of the tissue counts so far, of the fluid what it has said within a second.
    fn statuses(&self, tick: u64) -> Statuses {
        let (tissue, fluid) = self.latest;
        (tissue, fluid.filter(|status| tick.saturating_sub(status.state_tick) <= HOLD_TICKS))
    }

    /// Whether the session is over: what comes now is told, and counts for nothing.
    fn is_over(&self) -> bool {
        self.judge.as_ref().is_some_and(|judge| judge.ended.is_some())
    }

    /// Time from the begin of the session to its end, or to that of the recording, ticks. One without a case begins with the first tick; so does one that
    /// has not begun when the recording ends.
    pub fn session_ticks(&self) -> u64 {
        let ended = self.judge.as_ref().and_then(|judge| judge.ended);
        let ticks = ended.map_or(self.conduct.length_ticks(), |(_, tick)| self.conduct.since_start(tick).saturating_add(1));
        ticks.saturating_sub(self.began_tick().map_or(0, |tick| self.conduct.since_start(tick)))
    }

    /// Percent of the pathology that is removed: by the case, or without one of what its scene had.
    pub fn removed_percent(&self) -> Option<f64> {
        if let Some(judge) = &self.judge {
            return judge.removed_percent();
        }
        let removed_ml = Some(self.tissue?.removed_volume_ml).filter(|ml| ml.is_finite())?;
        Some((100.0 * removed_ml / self.pathology_ml?).clamp(0.0, 100.0))
    }

    /// Whether a tick that was taken is one of the session; without a case each is.
    fn is_of_session(&self, tick: u64) -> bool {
        let Some(judge) = &self.judge else { return true };
        judge.began_tick().is_some_and(|began_tick| tick >= began_tick)
            && judge.ended.is_none_or(|(_, ended_tick)| tick <= ended_tick)
    }

    /// The tick with which the session of a case began, if it has.
    fn began_tick(&self) -> Option<u64> {
        self.judge.as_ref().and_then(Judge::began_tick)
    }

    /// The session begins with this tick: shares of the time, and how the scope was moved and pressed, are those of a trainee from here on alone. What was
    /// used, lost or alarmed of before stays, as it stays in the patient.
    fn begin(&mut self, tick: u64) {
        (self.motion, self.force, self.in_view) = (Motion::default(), Force::default(), InView::default());
        self.curves.peak_at_m = None;
        self.medium.begin(tick);
    }

    /// Takes a tick; answers how long after the first it is.
    fn tick(&mut self, record: &AppliedRecord) -> u64 {
        let sample = &record.sample;
        let since_ticks = self.conduct.since_start(record.tick);
        let force_n = finite(record.command.force_n).map(length);
        if let Some(force_n) = force_n {
            self.curves.force_n.add(since_ticks, force_n);
        }
        self.curves.insertion_m.add(since_ticks, f64::from(sample.pose.insertion_m));
        if sample.controls.has_current() {
            self.curves.current.add(since_ticks, 1.0);
        }
        self.curves.trace.add(sample.pose.position_m);
        let device_max_n = Some(f64::from(record.limits.max_force_n)).filter(|newton| newton.is_finite() && *newton > 0.0);
        self.device_max_n = device_max_n.or(self.device_max_n);
        if self.is_over() {
            return since_ticks;
        }
        let had_begun = self.began_tick().is_some();
        if let Some(judge) = &mut self.judge {
            judge.tick(record);
        }
        if let Some(began_tick) = self.began_tick().filter(|_| !had_begun) {
            self.begin(began_tick);
        }
        let is_touching = touches(record);
        if let Some(force_n) = force_n {
            if self.force.peak.is_none_or(|peak| force_n > peak.value) {
                self.curves.peak_at_m = finite(sample.pose.position_m).map(|_| sample.pose.position_m);
            }
            self.force.tick(record.tick, force_n, is_touching);
        }
        self.motion.tick(sample);
        self.medium.tick(&sample.controls);
        self.electrode.tick(record.tick, &sample.controls, is_touching);
        if let Some(judge) = &self.judge {
            self.in_view.tick(&judge.brief, sample);
        }
        since_ticks
    }

    fn tissue(&mut self, status: &TissueStatus) {
        if self.latest.0.is_some_and(|newest| status.state_tick < newest.state_tick) {
            return; // of a holder that was followed by another one
        }
        self.latest.0 = Some(*status);
        self.curves.removed_ml.add(self.conduct.since_start(status.state_tick), status.removed_volume_ml);
        if self.is_over() {
            return;
        }
        self.electrode.status(status);
        self.tissue = Some(*status);
        if let Some(judge) = &mut self.judge {
            judge.tissue(status);
        }
    }

    fn fluid(&mut self, status: &FluidStatus) {
        let since_ticks = self.conduct.since_start(status.state_tick);
        if self.latest.1.is_none_or(|newest| status.state_tick > newest.state_tick) {
            self.latest.1 = Some(*status);
        }
        self.curves.pressure_pa.add(since_ticks, f64::from(status.pressure_pa));
        self.curves.deficit_ml.add(since_ticks, status.deficit_ml);
        self.curves.transmittance.add(since_ticks, status.told_transmittance().map_or(f64::NAN, f64::from));
        if self.is_over() {
            return;
        }
        self.medium.status(status);
        if let Some(judge) = &mut self.judge {
            judge.fluid(status);
        }
    }
}
