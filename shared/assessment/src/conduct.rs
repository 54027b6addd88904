//! What the station itself did while the trainee worked: its ticks and where some are missing, what the last hop applied, faults, takeovers.
//! Each tick counts once; one that comes again or late is counted and left out.

use crate::force::length;
use crate::markup::plain;
use crate::motion::{difference, finite};
use crate::processes::Processes;
use hyst_messages::{Applied, AppliedRecord};
use hyst_recording::{Event, Level, SAID, STATED, TickRange};
use std::collections::BTreeMap;

/// Most events that are told one by one; a station that says more is told by their number.
const MOST_EVENTS: usize = 1_000;
/// Most roles whose holders are followed; a station has eleven.
const MOST_ROLES: usize = 64;

/// A largest value and the first tick that had it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Peak {
    /// The value.
    pub value: f64,
    /// The tick.
    pub tick: u64,
}

impl Peak {
    /// Takes another value.
    pub(crate) fn raise(peak: &mut Option<Peak>, value: f64, tick: u64) {
        if peak.is_none_or(|peak| value > peak.value) {
            *peak = Some(Peak { value, tick });
        }
    }
}

/// The station so far.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Conduct {
    /// First tick of the recording.
    pub first_tick: Option<u64>,
    /// Newest tick.
    pub last_tick: u64,
    /// Ticks in the recording.
    pub ticks: u64,
    /// Of them by [`Applied`]: fresh, held, ramped, zero; and those of no known kind.
    pub kinds: [u64; 5],
    /// Ticks between the first and the last that are not there.
    pub missing: u64,
    /// Places at which some are missing.
    pub gaps: u64,
    /// The longest such place.
    pub longest_gap: Option<TickRange>,
    /// Ticks that the recorder says it has lost.
    pub lost: u64,
    /// Ticks that came again or late, and were left out.
    pub repeated: u64,
    /// Ticks whose pose, velocity or force is no number.
    pub not_finite: u64,
    /// Largest change of the force from one tick to the next, N.
    pub largest_step: Option<Peak>,
    /// Events of level warning and above, takeovers and what the supervisor said, in the order of their ticks; their texts are one line each.
    pub events: Vec<Event>,
    /// Such events beyond those.
    pub events_left_out: u64,
    /// What the processes did.
    pub processes: Processes,
    /// Events of level warning.
    pub warnings: u64,
    /// Events of level error.
    pub errors: u64,
    /// Changes of a role's holder.
    pub takeovers: u64,
    /// Changes of the servo whose force was applied: two compute each tick, and the device takes the other's when one is late, wrong or dead.
    pub servo_changes: u64,
    /// The incarnation of the last one, 0 before the first.
    servo: u32,
    force_n: Option<[f64; 3]>,
    holders: BTreeMap<String, u32>,
}

impl Conduct {
    /// Takes a tick; `false` if it came before.
    pub fn admit(&mut self, record: &AppliedRecord) -> bool {
        let tick = record.tick;
        match self.first_tick {
            None => self.first_tick = Some(tick),
            Some(_) if tick <= self.last_tick => {
                self.repeated += 1;
                return false;
            }
            Some(_) if tick - self.last_tick > 1 => self.skip(TickRange { first: self.last_tick + 1, last: tick - 1 }),
            Some(_) => {}
        }
        self.last_tick = tick;
        self.ticks += 1;
        let kind = (record.command.kind as usize).min(Applied::Zero as usize + 1);
        self.kinds[kind] += 1;
        let servo = record.command.source_incarnation;
        if kind == Applied::Fresh as usize && servo != 0 {
            let before = std::mem::replace(&mut self.servo, servo);
            self.servo_changes += u64::from(before != 0 && before != servo);
        }
        let force_n = finite(record.command.force_n);
        // A device whose hardware has died goes on from no force: what it commands no more is taken from nobody.
        let is_unplugged = record.before_n == [0.0; 3] && record.command.force_n == [0.0; 3];
        if let (Some(before_n), Some(force_n)) = (self.force_n.filter(|_| !is_unplugged), force_n) {
            Peak::raise(&mut self.largest_step, length(difference(force_n, before_n)), tick);
        }
        self.force_n = force_n;
        let (sample, pose) = (&record.sample, &record.sample.pose);
        let angles = [pose.pitch_rad, pose.yaw_rad, pose.roll_rad, pose.insertion_m, pose.camera_roll_rad];
        let is_finite = force_n.is_some()
            && [pose.position_m, sample.velocity_m_s].into_iter().all(|vector| finite(vector).is_some())
            && angles.iter().chain(&pose.orientation).all(|part| part.is_finite());
        self.not_finite += u64::from(!is_finite);
        true
    }

    fn skip(&mut self, gap: TickRange) {
        self.gaps += 1;
        self.missing = self.missing.saturating_add(gap.count());
        if self.longest_gap.is_none_or(|longest| gap.count() > longest.count()) {
            self.longest_gap = Some(gap);
        }
        self.force_n = None;
    }

    /// Takes a range of ticks that the recorder says are lost.
    pub fn lose(&mut self, range: &TickRange) {
        self.lost = self.lost.saturating_add(range.count());
    }

    /// Takes an event; of those of level info only takeovers, the supervisor's own words and what a device says of itself are kept.
    pub fn note(&mut self, event: Event) {
        let is_takeover = event.kind == "promoted" && self.is_other_holder(&event);
        self.takeovers += u64::from(is_takeover);
        self.warnings += u64::from(event.level == Level::Warning);
        self.errors += u64::from(event.level == Level::Error);
        if event.level == Level::Info && !is_takeover && ![SAID, STATED].contains(&event.kind.as_str()) {
            return;
        }
        if self.events.len() == MOST_EVENTS {
            self.events_left_out += 1;
            return;
        }
        // The supervisor's words come a little later than what the recorder itself saw.
        let at = self.events.partition_point(|before| before.tick <= event.tick);
        let event = Event { kind: plain(&event.kind), process: plain(&event.process), text: plain(&event.text), ..event };
        self.events.insert(at, event);
    }

    /// Whether the role of a promotion was somebody else's before. The first holder took nothing over, and a recorder that is started again says
    /// once more who holds what.
    fn is_other_holder(&mut self, event: &Event) -> bool {
        if let Some(holder) = self.holders.get_mut(&event.process) {
            return std::mem::replace(holder, event.incarnation) != event.incarnation;
        }
        if self.holders.len() < MOST_ROLES {
            self.holders.insert(event.process.clone(), event.incarnation);
        }
        false
    }

    /// Ticks from the first tick of the recording to this one; 0 for what was before.
    pub fn since_start(&self, tick: u64) -> u64 {
        tick.saturating_sub(self.first_tick.unwrap_or(tick))
    }

    /// Time from the first tick to the end of the last, ticks.
    pub fn length_ticks(&self) -> u64 {
        self.first_tick.map_or(0, |first| self.last_tick.saturating_sub(first).saturating_add(1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_messages::ForceCommand;

    fn record(tick: u64, force_n: [f32; 3], kind: Applied) -> AppliedRecord {
        AppliedRecord { tick, command: ForceCommand { force_n, kind: kind as u32, ..Default::default() }, ..Default::default() }
    }

    fn event(level: Level, kind: &str, process: &str, incarnation: u32) -> Event {
        Event { tick: 7, level, kind: kind.into(), process: process.into(), incarnation, text: "a\nb".into() }
    }

    #[test]
    fn gaps_kinds_and_steps_of_seven_ticks_by_hand() {
        let mut conduct = Conduct::default();
        let nan = [f32::NAN, 0.0, 0.0];
        for (tick, force_n, kind) in [
            (10, [0.0; 3], Applied::Fresh),
            (11, [0.3, 0.4, 0.0], Applied::Fresh), // a step of 0.5 N
            (14, [3.0, 0.0, 0.0], Applied::Held),  // over a gap: no step
            (15, nan, Applied::Ramped),
            (16, [0.0; 3], Applied::Zero),
            (20, [0.0; 3], Applied::Fresh),
        ] {
            assert!(conduct.admit(&record(tick, force_n, kind)));
        }
        assert!(!conduct.admit(&record(20, [9.0, 0.0, 0.0], Applied::Fresh)) && !conduct.admit(&record(3, nan, Applied::Fresh)));
        assert_eq!((conduct.ticks, conduct.kinds, conduct.repeated, conduct.not_finite), (6, [3, 1, 1, 1, 0], 2, 1));
        assert_eq!((conduct.missing, conduct.gaps, conduct.length_ticks()), (5, 2, 11));
        assert_eq!(conduct.longest_gap, Some(TickRange { first: 17, last: 19 }));
        let step = conduct.largest_step.unwrap();
        assert!((step.value - 0.5).abs() < 1e-7 && step.tick == 11);
    }

    /// The force that a device had commanded when its driver died stood as the largest step of the session.
    #[test]
    fn a_force_that_is_gone_because_the_hardware_has_died_is_no_step_and_one_that_is_let_go_is() {
        let largest_n = |before_n: [f32; 3]| {
            let mut conduct = Conduct::default();
            conduct.admit(&record(10, [0.0, 0.0, 1.5], Applied::Fresh));
            conduct.admit(&AppliedRecord { before_n, ..record(11, [0.0; 3], Applied::Held) });
            conduct.largest_step.map(|step| step.value)
        };
        assert_eq!([[0.0; 3], [0.0, 0.0, 1.5]].map(largest_n), [None, Some(1.5)]);
    }

    #[test]
    fn a_force_of_another_servo_is_a_change_and_one_that_was_held_is_nobodys() {
        let mut conduct = Conduct::default();
        let of = |tick: u64, kind: Applied, source_incarnation: u32| {
            let mut record = record(tick, [0.0; 3], kind);
            record.command.source_incarnation = source_incarnation;
            record
        };
        use Applied::{Fresh, Held};
        for (tick, kind, servo) in
            [(1, Fresh, 0), (2, Fresh, 3), (3, Held, 4), (4, Fresh, 3), (5, Fresh, 4), (6, Held, 3), (7, Fresh, 4), (8, Fresh, 9)]
        {
            conduct.admit(&of(tick, kind, servo));
        }
        assert_eq!(conduct.servo_changes, 2, "3 to 4, 4 to 9");
    }

    #[test]
    fn ticks_at_the_end_of_time_overflow_nothing() {
        let mut conduct = Conduct::default();
        let mut odd = record(u64::MAX, [0.0; 3], Applied::Fresh);
        odd.command.kind = u32::MAX;
        assert!(conduct.admit(&record(0, [0.0; 3], Applied::Fresh)) && conduct.admit(&odd));
        (0..3).for_each(|_| conduct.lose(&TickRange { first: 0, last: u64::MAX }));
        assert_eq!((conduct.length_ticks(), conduct.missing, conduct.lost), (u64::MAX, u64::MAX - 1, u64::MAX));
        assert_eq!(conduct.kinds, [1, 0, 0, 0, 1]);
    }

    #[test]
    fn faults_and_takeovers_are_kept_and_the_first_holder_took_nothing_over() {
        let mut conduct = Conduct::default();
        conduct.note(event(Level::Info, "started", "tissue:0", 4));
        conduct.note(event(Level::Info, "promoted", "tissue", 4));
        conduct.note(event(Level::Info, "promoted", "tissue", 4)); // said again by another recorder
        conduct.note(event(Level::Warning, "died", "tissue:0", 4));
        conduct.note(event(Level::Info, "promoted", "tissue", 5));
        conduct.note(event(Level::Error, "lost", "recorder", 0));
        let kinds: Vec<&str> = conduct.events.iter().map(|event| event.kind.as_str()).collect();
        assert_eq!(kinds, ["died", "promoted", "lost"]);
        assert_eq!((conduct.takeovers, conduct.warnings, conduct.errors), (1, 1, 1));
        assert_eq!(conduct.events[0].text, "a\u{fffd}b");
        conduct.note(Event { tick: 6, ..event(Level::Info, SAID, "supervisor", 0) });
        assert_eq!(
            (conduct.events[0].kind.as_str(), conduct.events.len(), conduct.warnings),
            (SAID, 4, 1),
            "what was said before"
        );
        conduct.note(Event { tick: 5, ..event(Level::Info, STATED, "hardware", 3) });
        assert_eq!((conduct.events[0].kind.as_str(), conduct.events.len()), (STATED, 5), "which device it was");
        (0..MOST_EVENTS).for_each(|_| conduct.note(event(Level::Warning, "died", "fluid:0", 1)));
        assert_eq!((conduct.events.len(), conduct.events_left_out), (MOST_EVENTS, 5));
    }
}
