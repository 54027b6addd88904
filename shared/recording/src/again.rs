//! The JSON messages by which a session can be done again: what a tick's input says beside the sample, what answers of the servos went on from, and what each
//! step of the tissue was made from.

use crate::messages::{Number, Xyz};
use crate::scan::Scan;
use hyst_messages::{AppliedRecord, DeviceLimits, MAX_PIECES, OriginRecord, PieceFlow, StepRecord};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

#[derive(Serialize, Deserialize)]
struct Piece {
    object: u32,
    velocity_m_s: Xyz,
}

/// Message of `/input`. What is left out is as ever: the force of the tick before was the one recorded for it, the servo went on from there.
#[derive(Serialize, Deserialize)]
pub(crate) struct Input {
    pub(crate) tick: u64,
    #[serde(default, skip_serializing_if = "Number::is_none")]
    pressure_pa: Number,
    pieces: Vec<Piece>,
    /// What the medium did to the scope; not there if that is nothing, and in older recordings, whose servos were not told.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    on_scope_n: Option<Xyz>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    before_n: Option<Xyz>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    lag: Option<u16>,
    /// The index of the servo that the device follows from this tick on; not there if it follows none, and in older recordings.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    followed: Option<u16>,
    /// What the device on the desk states of itself; not there if that is nothing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    device_limits: Option<Limits>,
    /// What was heard of answers since the block before, of this tick and others: in the first message of a block, which is always there.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) origins: Vec<Origin>,
}

/// What an answer of a servo went on from, where that was not the usual.
#[derive(Serialize, Deserialize)]
pub(crate) struct Origin {
    tick: u64,
    servo: u32,
    from_tick: u64,
    from_servo: u32,
}

impl Origin {
    pub(crate) fn of(record: &OriginRecord) -> Origin {
        let OriginRecord { tick, servo, from_tick, from_servo } = *record;
        Origin { tick, servo, from_tick, from_servo }
    }

    pub(crate) fn record(self) -> OriginRecord {
        let Origin { tick, servo, from_tick, from_servo } = self;
        OriginRecord { tick, servo, from_tick, from_servo }
    }
}

#[derive(Default, Serialize, Deserialize)]
#[serde(default)]
struct Limits {
    #[serde(skip_serializing_if = "Number::is_none")]
    max_force_n: Number,
    #[serde(skip_serializing_if = "Number::is_none")]
    max_stiffness_n_m: Number,
    #[serde(skip_serializing_if = "Number::is_none")]
    max_damping_n_s_m: Number,
}

impl Limits {
    fn of(limits: &DeviceLimits) -> Option<Limits> {
        let numbers = [limits.max_force_n, limits.max_stiffness_n_m, limits.max_damping_n_s_m];
        let [max_force_n, max_stiffness_n_m, max_damping_n_s_m] = numbers.map(Number);
        (*limits != DeviceLimits::default()).then_some(Limits { max_force_n, max_stiffness_n_m, max_damping_n_s_m })
    }
    fn limits(&self) -> DeviceLimits {
        let numbers = [&self.max_force_n, &self.max_stiffness_n_m, &self.max_damping_n_s_m];
        let [max_force_n, max_stiffness_n_m, max_damping_n_s_m] = numbers.map(|number| number.0);
        DeviceLimits { max_force_n, max_stiffness_n_m, max_damping_n_s_m }
    }
}

/// The usual lag of a servo.
const USUAL_LAG: u16 = 1;

impl Input {
    /// The message of a record after the one before, `None` if that says it all.
    pub(crate) fn of(record: &AppliedRecord, before: Option<&AppliedRecord>) -> Option<Input> {
        let bits = |force_n: [f32; 3]| force_n.map(f32::to_bits);
        let is_usual = before.is_some_and(|before| bits(before.command.force_n) == bits(record.before_n));
        let lag = Some(record.lag).filter(|lag| *lag != USUAL_LAG);
        let given = |it: &AppliedRecord| (it.pressure_pa.to_bits(), it.pieces, it.limits, bits(it.on_scope_n), it.followed);
        let is_told = before.is_some_and(|before| given(before) == given(record));
        if is_usual && is_told && lag.is_none() {
            return None;
        }
        // A piece may have the number 0, which says that there is none where the medium stands still.
        let pieces = record.pieces.iter().filter(|piece| piece.object != 0 || bits(piece.velocity_m_s) != [0; 3]);
        Some(Input {
            tick: record.tick,
            pressure_pa: Number(record.pressure_pa),
            pieces: pieces.map(|piece| Piece { object: piece.object, velocity_m_s: Xyz::of(piece.velocity_m_s) }).collect(),
            on_scope_n: (bits(record.on_scope_n) != [0; 3]).then(|| Xyz::of(record.on_scope_n)),
            before_n: (!is_usual).then(|| Xyz::of(record.before_n)),
            lag,
            followed: record.followed.checked_sub(1),
            device_limits: Limits::of(&record.limits),
            origins: Vec::new(),
        })
    }

    /// Completes the records of a block by its messages of this kind, by tick.
    pub(crate) fn complete(records: &mut [AppliedRecord], inputs: &BTreeMap<u64, Input>) {
        let mut before_n = [0.0; 3];
        for record in records {
            if let Some((tick, input)) = inputs.range(..=record.tick).next_back() {
                record.pressure_pa = input.pressure_pa.0;
                record.on_scope_n = input.on_scope_n.as_ref().map(Xyz::array).unwrap_or_default();
                record.limits = input.device_limits.as_ref().map(Limits::limits).unwrap_or_default();
                record.followed = input.followed.map_or(0, |index| index.saturating_add(1));
                for (to, piece) in record.pieces.iter_mut().zip(input.pieces.iter().take(MAX_PIECES)) {
                    *to = PieceFlow { object: piece.object, velocity_m_s: piece.velocity_m_s.array() };
                }
                let own = Some(input).filter(|_| *tick == record.tick);
                before_n = own.and_then(|own| own.before_n.as_ref()).map_or(before_n, Xyz::array);
                record.lag = own.and_then(|own| own.lag).unwrap_or(USUAL_LAG);
            }
            record.before_n = before_n;
            before_n = record.command.force_n;
        }
    }
}

/// Message of `/steps`.
#[derive(Serialize, Deserialize)]
pub(crate) struct Step {
    tick: u64,
    /// Hexadecimal, because readers in JavaScript have 53 bits.
    state_hash: String,
    input_tick: u64,
    from_tick: u64,
    from_incarnation: u32,
    epoch: u32,
    incarnation: u32,
    step_ticks: u32,
}

impl Step {
    pub(crate) fn of(record: &StepRecord) -> Step {
        Step {
            tick: record.tick,
            state_hash: format!("{:016x}", record.state_hash),
            input_tick: record.input_tick,
            from_tick: record.from_tick,
            from_incarnation: record.from_incarnation,
            epoch: record.epoch,
            incarnation: record.incarnation,
            step_ticks: record.step_ticks,
        }
    }

    /// The record of a message as [`Step::of`] makes it.
    pub(crate) fn scan(data: &[u8]) -> Option<StepRecord> {
        let mut scan = Scan::of(data);
        let record = StepRecord {
            tick: scan.count(br#"{"tick":"#)?,
            state_hash: scan.hash(br#","state_hash":""#)?,
            input_tick: scan.count(br#"","input_tick":"#)?,
            from_tick: scan.count(br#","from_tick":"#)?,
            from_incarnation: scan.small(br#","from_incarnation":"#)?,
            epoch: scan.small(br#","epoch":"#)?,
            incarnation: scan.small(br#","incarnation":"#)?,
            step_ticks: scan.small(br#","step_ticks":"#)?,
        };
        scan.end(b"}").map(|()| record)
    }

    pub(crate) fn record(&self) -> Result<StepRecord, String> {
        let hash = u64::from_str_radix(&self.state_hash, 16);
        Ok(StepRecord {
            tick: self.tick,
            state_hash: hash.map_err(|_| format!("has a step whose hash is {:?}", self.state_hash))?,
            input_tick: self.input_tick,
            from_tick: self.from_tick,
            from_incarnation: self.from_incarnation,
            epoch: self.epoch,
            incarnation: self.incarnation,
            step_ticks: self.step_ticks,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_older_recording_says_neither_whom_the_device_followed_nor_what_answers_went_on_from() {
        let older: Input = serde_json::from_str(r#"{"tick":7,"pressure_pa":9000.0,"pieces":[],"lag":5}"#).unwrap();
        assert!(older.origins.is_empty());
        let mut records = [7, 8].map(|tick| AppliedRecord { tick, ..Default::default() });
        Input::complete(&mut records, &BTreeMap::from([(7, older)]));
        assert_eq!(records.map(|record| (record.lag, record.followed)), [(5, 0), (1, 0)]);
    }

    #[test]
    fn the_flow_at_every_piece_is_done_again_also_where_the_first_object_is_one() {
        for (object, velocity_m_s) in [(0, [0.1, -0.0, 1.0 / 3.0]), (0, [0.0; 3]), (3, [0.0; 3])] {
            let mut pieces = [PieceFlow::default(); MAX_PIECES];
            pieces[0] = PieceFlow { object, velocity_m_s };
            pieces[1] = PieceFlow { object: 4, velocity_m_s: [0.2; 3] };
            let record = AppliedRecord { tick: 7, pieces, ..Default::default() };
            let inputs = BTreeMap::from([(7, Input::of(&record, None).expect("the first record of a recording"))]);
            let mut again = [AppliedRecord { tick: 7, ..Default::default() }];
            Input::complete(&mut again, &inputs);
            let told = |pieces: &[PieceFlow]| pieces.iter().map(|flow| (flow.object, flow.velocity_m_s)).collect::<Vec<_>>();
            let mut expected = told(&pieces);
            // A piece of that number in a medium at rest is as good as none.
            expected.retain(|(object, velocity_m_s)| *object != 0 || *velocity_m_s != [0.0; 3]);
            assert_eq!(told(&again[0].pieces)[..expected.len()], expected, "object {object}");
        }
    }
}
