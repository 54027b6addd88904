//! What a haptic device states of itself before anything of it counts: who made it, what its motors and encoders can do, how far it reaches. The `device`
//! engine reads it, and commands nothing beyond it.
//!
//! Promise: a statement that [`DeviceStatement::check`] lets pass has no number that is not finite, zero where that means nothing, or absurd.

use crate::controls::{MOST_SET_PRESSURE_PA, WINDOW_ALL, WINDOW_HEAD_FREE};
use crate::record::HardwareSample;
use bytemuck::{Pod, Zeroable};

/// Version of the statement.
pub const STATEMENT_VERSION: u32 = 1;
/// How far beyond what it states a device may be, rad and m: stops of rubber.
const BEYOND_RAD: f32 = 0.1;
const BEYOND_M: f32 = 0.005;
/// No tip is farther from the origin, m, wherever a scene has its pivot.
const MOST_DISTANCE_M: f32 = 2.0;
/// No hand is faster, m/s.
const MOST_SPEED_M_S: f32 = 10.0;
/// What a tip may have moved between two samples: so much, m, and so much for the time between them, m/s. A hand makes 1 m/s.
const JUMP_M: f32 = 0.005;
const JUMP_M_S: f32 = 3.0;
/// Physical damping that a device can state, N·s/m: below it no coupling that is passive can be felt, and above it no hand moves it.
const DEVICE_DAMPING_N_S_M: [f32; 2] = [0.05, 100.0];
/// Bytes of a text in a statement, UTF-8, zero-padded.
pub const STATEMENT_TEXT: usize = 32;

/// What the device can do at most; what is 0 is not stated, and then the station's own bound holds.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct DeviceLimits {
    /// Largest force, N.
    pub max_force_n: f32,
    /// Largest stiffness that it can make stably, N/m.
    pub max_stiffness_n_m: f32,
    /// Largest damping that it can make stably, N·s/m.
    pub max_damping_n_s_m: f32,
}

/// The statement.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct DeviceStatement {
    /// [`STATEMENT_VERSION`].
    pub version: u32,
    /// Degrees of freedom that are measured, 3 to 7: pitch, yaw and insertion at least.
    pub measured_dof: u32,
    /// Degrees of freedom that have motors, 1 to 6.
    pub driven_dof: u32,
    /// Samples in a second, Hz.
    pub rate_hz: f32,
    /// What it can do at most; the force for short.
    pub limits: DeviceLimits,
    /// Largest force for any time, N.
    pub continuous_force_n: f32,
    /// Smallest motion of the tip that it measures, m; 0 if that is not known.
    pub resolution_m: f32,
    /// Physical damping of the device in the hand that holds it most lightly, N·s/m: what the passivity of the coupling rests on; 0 if that is not known.
    pub device_damping_n_s_m: f32,
    /// Least and greatest pitch, rad.
    pub pitch_rad: [f32; 2],
    /// Least and greatest yaw, rad.
    pub yaw_rad: [f32; 2],
    /// Least and greatest roll, rad.
    pub roll_rad: [f32; 2],
    /// Least and greatest insertion, m.
    pub insertion_m: [f32; 2],
    /// Who made it.
    pub maker: [u8; STATEMENT_TEXT],
    /// What it is called.
    pub name: [u8; STATEMENT_TEXT],
}

/// A text as a statement has it, cut to what fits.
pub fn statement_text(text: &str) -> [u8; STATEMENT_TEXT] {
    let mut bytes = [0; STATEMENT_TEXT];
    let fits = (0..STATEMENT_TEXT).rev().find(|end| text.is_char_boundary(*end)).unwrap_or(0); // beyond its end there is none
    bytes[..fits].copy_from_slice(&text.as_bytes()[..fits]);
    bytes
}

fn read_text(bytes: &[u8; STATEMENT_TEXT]) -> Option<&str> {
    let end = bytes.iter().position(|byte| *byte == 0)?;
    std::str::from_utf8(&bytes[..end]).ok().filter(|text| !text.is_empty() && !text.contains(char::is_control))
}

impl DeviceStatement {
    /// Maker and name.
    pub fn title(&self) -> String {
        let text = |bytes| read_text(bytes).unwrap_or("?");
        format!("{} {}", text(&self.maker), text(&self.name))
    }

    /// All of it in words: who made it and what it is called, what it can do, how far it reaches.
    pub fn words(&self) -> String {
        let DeviceStatement { measured_dof, driven_dof, rate_hz, limits, continuous_force_n, .. } = self;
        let DeviceLimits { max_force_n, max_stiffness_n_m, max_damping_n_s_m } = limits;
        let own_n_s_m = self.device_damping_n_s_m;
        let own =
            if own_n_s_m > 0.0 { format!("{own_n_s_m} N·s/m of its own") } else { "how much of its own is not known".into() };
        let ranges = [("pitch", self.pitch_rad), ("yaw", self.yaw_rad), ("roll", self.roll_rad)];
        let ranges = ranges.map(|(what, [from, to])| format!("{what} {from:.2} to {to:.2} rad")).join(", ");
        let [from, to] = self.insertion_m;
        format!(
            "{}: {measured_dof} degrees of freedom, {driven_dof} driven, {rate_hz:.0} Hz, {max_force_n} N ({continuous_force_n} N for any time), \
             {max_stiffness_n_m:.0} N/m, {max_damping_n_s_m} N·s/m, {own}; {ranges}, insertion {from:.3} to {to:.3} m",
            self.title()
        )
    }

    /// Whether the station can work with what is stated; the error names the first number that it cannot use, and what is allowed.
    pub fn check(&self) -> Result<(), String> {
        if self.version != STATEMENT_VERSION {
            return Err(format!("version {} of the statement; it must be {STATEMENT_VERSION}", self.version));
        }
        for (what, bytes) in [("maker", &self.maker), ("name", &self.name)] {
            if read_text(bytes).is_none() {
                return Err(format!(
                    "{what} is empty or no text; it must be 1 to {} bytes of UTF-8 and a zero",
                    STATEMENT_TEXT - 1
                ));
            }
        }
        let limits = &self.limits;
        let numbers = [
            ("measured_dof", self.measured_dof as f32, 3.0, 7.0),
            ("driven_dof", self.driven_dof as f32, 1.0, 6.0),
            ("rate_hz", self.rate_hz, 500.0, 10_000.0),
            ("max_force_n", limits.max_force_n, 0.1, 100.0),
            ("max_stiffness_n_m", limits.max_stiffness_n_m, 10.0, 100_000.0),
            ("max_damping_n_s_m", limits.max_damping_n_s_m, 0.01, 1_000.0),
            ("continuous_force_n", self.continuous_force_n, 0.05, limits.max_force_n),
            ("resolution_m", self.resolution_m, 0.0, 1e-3),
        ];
        for (what, value, least, most) in numbers {
            if !(least..=most).contains(&value) {
                return Err(format!("{what} is {value}; it must be {least} to {most}"));
            }
        }
        let (damping_n_s_m, [least, most]) = (self.device_damping_n_s_m, DEVICE_DAMPING_N_S_M);
        if damping_n_s_m != 0.0 && !(least..=most).contains(&damping_n_s_m) {
            return Err(format!(
                "device_damping_n_s_m is {damping_n_s_m}; it must be {least} to {most}, or 0 if it is not known"
            ));
        }
        let ranges = [
            ("pitch_rad", self.pitch_rad, -1.6, 1.6, 0.0),
            ("yaw_rad", self.yaw_rad, -1.6, 1.6, 0.0),
            ("roll_rad", self.roll_rad, -7.0, 7.0, 0.0),
            ("insertion_m", self.insertion_m, 0.0, 1.0, 1e-4),
        ];
        for (what, [from, to], least, most, width) in ranges {
            let is_range = from >= least && to <= most && to - from >= width; // not with a NaN
            if !is_range {
                return Err(format!(
                    "{what} goes from {from} to {to}; it must lie within {least} to {most}, {width} wide at least"
                ));
            }
        }
        Ok(())
    }

    /// Whether each number of a sample can be, of a device that states this of itself; the error names what cannot.
    pub fn admits(&self, sample: &HardwareSample) -> Result<(), &'static str> {
        let (pose, controls) = (&sample.pose, &sample.controls);
        let within = |value: f32, [from, to]: [f32; 2], beyond: f32| (from - beyond..=to + beyond).contains(&value);
        let length = |vector: &[f32]| vector.iter().map(|c| c * c).sum::<f32>().sqrt();
        let shares = [controls.inflow_valve, controls.outflow_valve, controls.light];
        // Written so that NaN counts as wrong.
        let can_be = [
            ("pitch_rad", within(pose.pitch_rad, self.pitch_rad, BEYOND_RAD)),
            ("yaw_rad", within(pose.yaw_rad, self.yaw_rad, BEYOND_RAD)),
            ("roll_rad", within(pose.roll_rad, self.roll_rad, BEYOND_RAD)),
            ("insertion_m", within(pose.insertion_m, self.insertion_m, BEYOND_M)),
            ("camera_roll_rad", pose.camera_roll_rad.is_finite()),
            ("orientation", (0.99..=1.01).contains(&length(&pose.orientation))),
            ("position_m", pose.position_m.iter().all(|c| c.abs() <= MOST_DISTANCE_M)),
            ("velocity_m_s", length(&sample.velocity_m_s) <= MOST_SPEED_M_S),
            ("force_n", length(&sample.force_n) <= self.limits.max_force_n * 1.1),
            ("a valve or the light", shares.iter().all(|share| (0.0..=1.0).contains(share))),
            ("set_pressure_pa", (0.0..=MOST_SET_PRESSURE_PA).contains(&controls.set_pressure_pa)),
            ("focus_m", controls.has_focus_in_range()),
            ("loop_extension_m", (-0.01..=0.1).contains(&controls.loop_extension_m)),
            ("from_window", sample.from_window & !(WINDOW_ALL | WINDOW_HEAD_FREE) == 0),
        ];
        can_be.iter().find(|(_, can_be)| !can_be).map_or(Ok(()), |(what, _)| Err(*what))
    }
}

impl HardwareSample {
    /// Whether it is newer than another, and the tip no farther from there than a hand can have moved it.
    pub fn goes_on_from(&self, before: &HardwareSample) -> bool {
        let passed_s = self.time_ns.saturating_sub(before.time_ns) as f32 * 1e-9;
        let moved = self.pose.position_m.iter().zip(before.pose.position_m).map(|(a, b)| (a - b) * (a - b));
        self.hardware_tick > before.hardware_tick && moved.sum::<f32>().sqrt() <= JUMP_M + JUMP_M_S * passed_s
    }
}

#[cfg(test)]
#[path = "../tests/support/stated.rs"]
pub(crate) mod stated;

#[cfg(test)]
mod tests {
    use super::stated::stated;
    use super::*;
    use crate::{Pose, TICK_NS};

    #[test]
    fn a_statement_with_a_number_that_is_none_zero_or_absurd_is_refused_and_the_number_named() {
        assert_eq!((stated().check(), stated().title().as_str()), (Ok(()), "Nobody Nothing"));
        type Change = fn(&mut DeviceStatement);
        for damping_n_s_m in [0.0, 0.05, 3.0, 100.0] {
            assert_eq!(DeviceStatement { device_damping_n_s_m: damping_n_s_m, ..stated() }.check(), Ok(()), "{damping_n_s_m}");
        }
        let changes: [(Change, &str); 16] = [
            (|it| it.version = 2, "version"),
            (|it| it.measured_dof = 0, "measured_dof"),
            (|it| it.driven_dof = 9, "driven_dof"),
            (|it| it.rate_hz = f32::NAN, "rate_hz"),
            (|it| it.limits.max_force_n = 0.0, "max_force_n"),
            (|it| it.limits.max_force_n = f32::INFINITY, "max_force_n"),
            (|it| it.limits.max_stiffness_n_m = 1e9, "max_stiffness_n_m"),
            (|it| it.limits.max_damping_n_s_m = f32::NAN, "max_damping_n_s_m"),
            (|it| it.device_damping_n_s_m = f32::NAN, "device_damping_n_s_m"),
            (|it| it.device_damping_n_s_m = -1.0, "device_damping_n_s_m"),
            (|it| it.device_damping_n_s_m = 0.001, "device_damping_n_s_m"),
            (|it| it.device_damping_n_s_m = 1e9, "device_damping_n_s_m"),
            (|it| it.continuous_force_n = 5.0, "continuous_force_n"),
            (|it| it.insertion_m = [0.0, 70.0], "insertion_m"),
            (|it| it.pitch_rad = [0.6, -0.6], "pitch_rad"),
            (|it| it.name = [0; STATEMENT_TEXT], "name"),
        ];
        for (change, what) in changes {
            let mut bad = stated();
            change(&mut bad);
            let said = bad.check().unwrap_err();
            assert!(said.starts_with(what), "{what}: {said}");
        }
    }

    #[test]
    fn a_statement_in_words_says_which_device_it_is_what_it_can_do_and_how_far_it_reaches() {
        let words = DeviceStatement { device_damping_n_s_m: 0.5, ..stated() }.words();
        let does = "Nobody Nothing: 4 degrees of freedom, 3 driven, 1000 Hz, 3.3 N (0.9 N for any time), 1200 N/m, 2 N·s/m";
        let reaches = "pitch -0.60 to 0.60 rad, yaw -0.60 to 0.60 rad, roll -3.00 to 3.00 rad, insertion 0.000 to 0.100 m";
        assert_eq!(words, format!("{does}, 0.5 N·s/m of its own; {reaches}"));
        assert!(stated().words().contains("1200 N/m, 2 N·s/m, how much of its own is not known"), "{}", stated().words());
    }

    #[test]
    fn a_text_is_cut_between_two_letters() {
        assert_eq!(read_text(&statement_text(&"ü".repeat(40))), Some("ü".repeat(15).as_str()));
        assert_eq!(read_text(&statement_text("Touch")), Some("Touch"));
        assert_eq!((read_text(&[b'x'; STATEMENT_TEXT]), read_text(&statement_text("a\nb"))), (None, None));
    }

    /// At rest, so deep.
    fn at(tick: u64, insertion_m: f32) -> HardwareSample {
        let pose =
            Pose { position_m: [0.0, 0.0, insertion_m], orientation: [0.0, 0.0, 0.0, 1.0], insertion_m, ..Pose::default() };
        HardwareSample { hardware_tick: tick, time_ns: tick * TICK_NS, pose, ..HardwareSample::default() }
    }

    #[test]
    fn a_sample_that_cannot_be_is_refused() {
        let mut focused = at(1, 0.05);
        focused.controls.focus_m = 0.008;
        assert_eq!((stated().admits(&at(1, 0.05)), stated().admits(&focused)), (Ok(()), Ok(())), "a focus need not be stated");
        let free = HardwareSample { from_window: WINDOW_ALL | WINDOW_HEAD_FREE, ..at(1, 0.05) };
        assert_eq!(stated().admits(&free), Ok(()), "the window's hand with a camera head that goes along with the scope");
        type Change = fn(&mut HardwareSample);
        let changes: [(Change, &str); 12] = [
            (|sample| sample.pose.position_m[1] = f32::NAN, "position_m"),
            (|sample| sample.pose.insertion_m = 50.0, "insertion_m"), // millimetres
            (|sample| sample.pose.pitch_rad = 35.0, "pitch_rad"),     // degrees
            (|sample| sample.pose.orientation = [0.0; 4], "orientation"),
            (|sample| sample.velocity_m_s[0] = f32::INFINITY, "velocity_m_s"),
            (|sample| sample.velocity_m_s[2] = 300.0, "velocity_m_s"),
            (|sample| sample.force_n[1] = f32::NAN, "force_n"),
            (|sample| sample.force_n[1] = 5.0, "force_n"),
            (|sample| sample.controls.outflow_valve = -1.0, "a valve or the light"),
            (|sample| sample.controls.focus_m = f32::NAN, "focus_m"),
            (|sample| sample.controls.focus_m = 20.0, "focus_m"), // millimetres
            (|sample| sample.from_window = 1 << 30, "from_window"),
        ];
        for (change, what) in changes {
            let mut bad = at(1, 0.05);
            change(&mut bad);
            assert_eq!(stated().admits(&bad), Err(what), "{bad:?}");
        }
    }

    #[test]
    fn a_tip_goes_on_as_far_as_a_hand_moves_it_in_the_time() {
        let from = at(10, 0.05);
        for (tick, insertion_m, goes_on) in
            [(11, 0.057, true), (11, 0.06, false), (21, 0.08, true), (10, 0.05, false), (11, f32::NAN, false)]
        {
            assert_eq!(at(tick, insertion_m).goes_on_from(&from), goes_on, "tick {tick}, {insertion_m} m");
        }
    }
}
