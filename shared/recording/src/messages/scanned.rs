//! The messages of each tick, read as they are written: the fields in their order, each number there.

use super::{Force, Number, PoseMessage, Time, Tool, WORLD, Xyz, Xyzw};
use crate::scan::Scan;

impl Xyz {
    fn scan(scan: &mut Scan) -> Option<Xyz> {
        let x = Number(scan.number(br#"{"x":"#)?);
        let y = Number(scan.number(br#","y":"#)?);
        let z = Number(scan.number(br#","z":"#)?);
        scan.past(b"}")?;
        Some(Xyz { x, y, z })
    }
}

impl Xyzw {
    fn scan(scan: &mut Scan) -> Option<Xyzw> {
        let x = Number(scan.number(br#"{"x":"#)?);
        let y = Number(scan.number(br#","y":"#)?);
        let z = Number(scan.number(br#","z":"#)?);
        let w = Number(scan.number(br#","w":"#)?);
        scan.past(b"}")?;
        Some(Xyzw { x, y, z, w })
    }
}

impl Tool {
    /// Of a message as [`Tool::of`] makes it.
    pub(crate) fn scan(data: &[u8]) -> Option<Tool> {
        let mut scan = Scan::of(data);
        let sec = scan.count(br#"{"timestamp":{"sec":"#)?;
        let nsec = scan.count(br#","nsec":"#)?;
        scan.past(br#"},"frame_id":"world","pose":{"position":"#)?;
        let position = Xyz::scan(&mut scan)?;
        scan.past(br#","orientation":"#)?;
        let orientation = Xyzw::scan(&mut scan)?;
        let tick = scan.count(br#"},"tick":"#)?;
        let hardware_tick = scan.count(br#","hardware_tick":"#)?;
        let time_ns = scan.count(br#","time_ns":"#)?;
        let pitch_rad = Number(scan.number(br#","pitch_rad":"#)?);
        let yaw_rad = Number(scan.number(br#","yaw_rad":"#)?);
        let roll_rad = Number(scan.number(br#","roll_rad":"#)?);
        let insertion_m = Number(scan.number(br#","insertion_m":"#)?);
        let camera_roll_rad = Number(scan.number(br#","camera_roll_rad":"#)?);
        scan.past(br#","velocity_m_s":"#)?;
        let velocity_m_s = Xyz::scan(&mut scan)?;
        scan.end(b"}")?;
        Some(Tool {
            timestamp: Time { sec, nsec },
            frame_id: WORLD,
            pose: PoseMessage { position, orientation },
            tick,
            hardware_tick,
            time_ns,
            pitch_rad,
            yaw_rad,
            roll_rad,
            insertion_m,
            camera_roll_rad,
            velocity_m_s,
        })
    }
}

impl Force {
    /// Of a message as [`Force::of`] makes it.
    pub(crate) fn scan(data: &[u8]) -> Option<Force> {
        let mut scan = Scan::of(data);
        let tick = scan.count(br#"{"tick":"#)?;
        scan.past(br#","force_n":"#)?;
        let force_n = Xyz::scan(&mut scan)?;
        scan.past(br#","motor_n":"#)?;
        let motor_n = Xyz::scan(&mut scan)?;
        let force = Force {
            tick,
            force_n,
            motor_n,
            kind: scan.small(br#","kind":"#)?,
            force_tick: scan.count(br#","force_tick":"#)?,
            source_incarnation: scan.small(br#","source_incarnation":"#)?,
            device_incarnation: scan.small(br#","device_incarnation":"#)?,
            model_tick: scan.count(br#","model_tick":"#)?,
            model_epoch: scan.small(br#","model_epoch":"#)?,
            model_incarnation: scan.small(br#","model_incarnation":"#)?,
            medium_tick: scan.count(br#","medium_tick":"#)?,
            medium_epoch: scan.small(br#","medium_epoch":"#)?,
        };
        scan.end(b"}").map(|()| force)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::again::Step;
    use hyst_messages::{AppliedRecord, StepRecord};
    use serde_json::Value;

    fn record() -> AppliedRecord {
        let mut record = AppliedRecord { tick: 1_800_123, model_tick: u64::MAX / 2, ..AppliedRecord::default() };
        record.medium_epoch = u32::MAX;
        record.command.force_n = [1.0 / 3.0, -0.0, 1e-20];
        record.sample.pose.position_m = [0.0123, -7e-9, 0.05];
        record.sample.pose.orientation = [0.1, 0.2, 0.3, 0.9];
        record.sample.velocity_m_s = [f32::MAX, f32::MIN_POSITIVE, 1e-45];
        record
    }

    #[test]
    fn a_message_of_each_tick_is_read_as_it_stands_and_is_what_any_json_would_be() {
        let record = record();
        let (tool, force) = (serde_json::to_vec(&Tool::of(&record)).unwrap(), serde_json::to_vec(&Force::of(&record)).unwrap());
        // Each number is written as its bits, a negative zero as one: what is written again is the same if they are.
        let again = Tool::scan(&tool).expect("a tool's message is read as it stands");
        assert_eq!(serde_json::to_vec(&again).unwrap(), tool);
        let again = Force::scan(&force).expect("a force's message is read as it stands");
        assert_eq!(serde_json::to_vec(&again).unwrap(), force);
        let step = StepRecord { tick: 7, state_hash: 0xfe, input_tick: 6, from_tick: 5, epoch: 4, ..StepRecord::default() };
        assert_eq!(Step::scan(&serde_json::to_vec(&Step::of(&step)).unwrap()), Some(step));
    }

    #[test]
    fn what_stands_otherwise_is_not_read_here() {
        let tool = serde_json::to_string(&Tool::of(&record())).unwrap();
        for (from, to) in [("world", "other"), ("}}", "} }"), ("\"tick\"", "\"tock\""), ("{\"x\"", "{ \"x\"")] {
            let other = tool.replacen(from, to, 1);
            assert!(other != tool && Tool::scan(other.as_bytes()).is_none(), "{other}");
        }
        assert!(Tool::scan(format!("{tool} ").as_bytes()).is_none());
        assert!((0..tool.len()).all(|length| Tool::scan(&tool.as_bytes()[..length]).is_none()));
        // A number that is not finite is left out; a field that is nobody's is passed over by who reads any JSON.
        let mut record = record();
        record.sample.pose.yaw_rad = f32::NAN;
        assert!(Tool::scan(&serde_json::to_vec(&Tool::of(&record)).unwrap()).is_none());
        let mut force = serde_json::to_value(Force::of(&record)).unwrap();
        force["more"] = Value::from(1);
        assert!(Force::scan(force.to_string().as_bytes()).is_none());
    }
}
