//! A gamepad or a 3D mouse as the hand that holds the simulated device: a thread reads it, and each tick takes what it says now.
//!
//! Promise: the tick never waits for it; one that is let go of leaves the scope where it is; so does one that is pulled out, which also takes the finger off
//! the current; it goes on as soon as it is there again. Meanwhile it complains, for the operator.

#[cfg_attr(not(feature = "pads"), allow(dead_code))] // nobody says an event there
mod make;
#[cfg(not(feature = "pads"))]
#[path = "pad/absent.rs"]
mod reader;
#[cfg(feature = "pads")]
mod reader;

use hyst_coupling::Pose4;
use hyst_engine::Failure;
use hyst_exchange::system;
use hyst_messages::controls::WINDOW_COAGULATION;
use hyst_messages::{BUTTON_COAGULATING, BUTTON_ENERGIZED, BUTTON_EXTENDED, Controls};
use make::{Deflections, Event, Ranges};
use std::io;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

pub use make::{Make, SWITCHES};

/// Speed at full deflection: pitch, yaw, roll, rad/s; insertion, m/s.
const SPEEDS: [f32; 4] = [0.7, 0.7, 1.6, 0.04];
/// Speed of the camera head under a button, rad/s.
const HEAD_RAD_S: f32 = 0.8;
/// How far a target may be from the scope: rad, rad, rad, m. Nothing is wound up while the tissue or the workspace holds it.
const REACH: [f32; 4] = [0.25, 0.25, 0.6, 0.012];
/// Share of the deflection in which nothing moves: a stick that is let go of does not come to rest in its middle.
const DEAD: f32 = 0.08;
/// Between two looks for one that was pulled out.
const LOOK: Duration = Duration::from_millis(500);

/// What the thread has read: written by it alone, read by the tick.
#[derive(Debug, Default)]
struct Said {
    /// Deflections about pitch, yaw, roll and along the insertion, as bits of an `f32` from -1 to 1.
    along: [AtomicU32; 4],
    /// The buttons of the currents that the finger is on, as bits of [`Controls::buttons`].
    current: AtomicU32,
    /// How often each of [`SWITCHES`] was pressed.
    presses: [AtomicU32; SWITCHES.len()],
    /// Which way the camera head is turned, -1, 0 or 1, as bits of an `f32`.
    head: AtomicU32,
    /// 1 while there is none.
    is_gone: AtomicU32,
}

impl Said {
    fn take(&self, now: &Deflections, pressed: Option<usize>) {
        for (to, value) in self.along.iter().zip(now.along()) {
            to.store(value.to_bits(), Ordering::Relaxed);
        }
        self.current.store(now.current(), Ordering::Relaxed);
        self.head.store(now.head().to_bits(), Ordering::Relaxed);
        if let Some(count) = pressed.and_then(|index| self.presses.get(index)) {
            count.fetch_add(1, Ordering::Relaxed);
        }
    }
}

/// The hand's side of it.
#[derive(Debug, Default)]
pub struct Pad {
    /// What it has no button for, and the window's keys set instead: bits of [`WINDOW_ALL`](hyst_messages::controls::WINDOW_ALL).
    pub lacks: u32,
    /// What is said while it is gone.
    gone: &'static str,
    said: Arc<Said>,
    seen: [u32; SWITCHES.len()],
    target: Option<[f32; 4]>,
}

impl Pad {
    /// Opens what `--hand` names: the first of its make, or the one at the path.
    pub fn open(make: Make, path: Option<&str>) -> Result<Pad, Failure> {
        let pad = Pad { lacks: make.lacks(), gone: make.gone(), ..Pad::default() };
        let said = Arc::clone(&pad.said);
        let path = path.map(PathBuf::from);
        let find = move || reader::find(make, path.as_ref());
        let first = find().map_err(Failure::Input)?;
        let pause = || {
            std::thread::sleep(LOOK);
            true
        };
        let read = move || follow(make, &said, first, || find().ok(), pause, system::now_ns);
        let thread = std::thread::Builder::new().name("pad".into()).spawn(read);
        thread.map(|_| pad).map_err(|error| Failure::Broken(format!("cannot start a thread: {error}")))
    }

    /// What the operator is to be told of it; nothing while it is there.
    pub fn complaint(&self) -> &'static str {
        if self.said.is_gone.load(Ordering::Relaxed) == 0 { "" } else { self.gone }
    }

    /// Speed at which the camera head is turned on the scope, rad/s.
    pub fn head_rad_s(&self) -> f32 {
        f32::from_bits(self.said.head.load(Ordering::Relaxed)) * HEAD_RAD_S
    }

    /// Where the hand wants the scope in this tick, from where it is; sets valves, pressure, light and focus, and gives the buttons.
    pub fn step(&mut self, at: &Pose4, controls: &mut Controls, tick_s: f32) -> (Pose4, u32) {
        let at = [at.pitch_rad, at.yaw_rad, at.roll_rad, at.insertion_m];
        let target = self.target.get_or_insert(at);
        for axis in 0..4 {
            let deflection = f32::from_bits(self.said.along[axis].load(Ordering::Relaxed));
            let wanted = target[axis] + eased(deflection) * SPEEDS[axis] * tick_s;
            if wanted.is_finite() && at[axis].is_finite() {
                target[axis] = wanted.clamp(at[axis] - REACH[axis], at[axis] + REACH[axis]);
            }
        }
        // What it has no button for the window has pressed before.
        let foreign = if self.lacks & WINDOW_COAGULATION != 0 { BUTTON_COAGULATING } else { 0 };
        controls.buttons &= BUTTON_EXTENDED | foreign;
        for (index, (_, switch)) in SWITCHES.iter().enumerate() {
            let presses = self.said.presses[index].load(Ordering::Relaxed);
            for _ in 0..presses.wrapping_sub(self.seen[index]).min(8) {
                controls.turn(*switch);
            }
            self.seen[index] = presses;
        }
        let current = self.said.current.load(Ordering::Relaxed) & (BUTTON_ENERGIZED | BUTTON_COAGULATING);
        let [pitch_rad, yaw_rad, roll_rad, insertion_m] = *target;
        (Pose4 { pitch_rad, yaw_rad, roll_rad, insertion_m }, controls.buttons | current)
    }
}

/// Nothing near the middle, then slowly at first: a small movement is a fine one.
fn eased(deflection: f32) -> f32 {
    let size = ((deflection.abs() - DEAD) / (1.0 - DEAD)).clamp(0.0, 1.0);
    if size.is_finite() { size * size * deflection.signum() } else { 0.0 }
}

/// One that can be read, until it is gone.
trait Source {
    /// The ranges of its axes.
    fn ranges(&self) -> Ranges;
    /// Waits for what it says next, until a time, ns, if there is one: nothing has come by then.
    fn next(&mut self, until_ns: Option<u64>) -> io::Result<Vec<Event>>;
}

/// Reads one after the other, as long as the pause between two looks says that it is to go on; by this clock, ns.
fn follow<S: Source>(
    make: Make,
    said: &Said,
    first: S,
    mut find: impl FnMut() -> Option<S>,
    mut pause: impl FnMut() -> bool,
    mut clock_ns: impl FnMut() -> u64,
) {
    let mut source = Some(first);
    loop {
        let Some(mut present) = source.take().or_else(&mut find) else {
            if !pause() {
                return;
            }
            continue;
        };
        said.is_gone.store(0, Ordering::Relaxed);
        let ranges = present.ranges();
        let mut now = Deflections::default();
        let why = loop {
            let events = match present.next(now.rests_at_ns()) {
                Ok(events) => events,
                Err(error) => break error,
            };
            // What has come counts before silence does: this thread may have been late itself.
            let read_ns = clock_ns();
            for event in &events {
                let pressed = now.take(make, &ranges, event, read_ns);
                said.take(&now, pressed);
            }
            now.rest(read_ns);
            said.take(&now, None);
        };
        said.take(&Deflections::default(), None);
        said.is_gone.store(1, Ordering::Relaxed);
        eprintln!("hardware: {} ({why})", make.gone());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_messages::Switch;
    use hyst_messages::controls::{DIM, OUTFLOW, PRESSURE_PA};
    use std::cell::RefCell;
    use std::collections::VecDeque;

    const AT: Pose4 = Pose4 { pitch_rad: 0.1, yaw_rad: -0.1, roll_rad: 0.3, insertion_m: 0.04 };

    fn deflected(along: [f32; 4]) -> Pad {
        let pad = Pad::default();
        for (to, value) in pad.said.along.iter().zip(along) {
            to.store(value.to_bits(), Ordering::Relaxed);
        }
        pad
    }

    #[test]
    fn a_deflection_is_a_speed_and_the_target_leads_the_scope_by_no_more_than_a_hand_does() {
        let mut controls = Controls::default();
        let mut pad = deflected([1.0, -1.0, 0.05, 0.5]);
        let (first, _) = pad.step(&AT, &mut controls, 1e-3);
        assert!((first.pitch_rad - AT.pitch_rad - 0.7e-3).abs() < 1e-6 && (first.yaw_rad - AT.yaw_rad + 0.7e-3).abs() < 1e-6);
        assert_eq!(first.roll_rad, AT.roll_rad, "a stick that is let go of");
        let slow = (first.insertion_m - AT.insertion_m) / 0.04e-3;
        assert!(slow > 0.1 && slow < 0.3, "a small movement is a fine one: {slow}");
        let last = (0..5_000).map(|_| pad.step(&AT, &mut controls, 1e-3).0).last().unwrap();
        assert!(
            (last.pitch_rad - AT.pitch_rad - REACH[0]).abs() < 1e-6
                && (last.insertion_m - AT.insertion_m - REACH[3]).abs() < 1e-6
        );
        let nowhere = Pose4 { insertion_m: f32::NAN, ..AT };
        assert_eq!(pad.step(&nowhere, &mut controls, 1e-3).0.insertion_m, last.insertion_m);
        assert_eq!(eased(f32::NAN), 0.0);
    }

    #[test]
    fn a_press_counts_once_and_sets_what_a_hand_sets() {
        let mut controls =
            Controls { inflow_valve: 1.0, outflow_valve: 0.0, set_pressure_pa: 9_333.0, light: 1.0, ..Controls::default() };
        let mut pad = Pad::default();
        let mut after = |switch: Switch, times: u32| {
            let index = SWITCHES.iter().position(|(_, known)| *known == switch).unwrap();
            pad.said.presses[index].fetch_add(times, Ordering::Relaxed);
            for _ in 0..3 {
                controls.buttons = pad.step(&AT, &mut controls, 1e-3).1;
            }
            controls
        };
        assert_eq!(after(Switch::Inflow, 1).inflow_valve, 0.0);
        assert_eq!(after(Switch::Inflow, 2).inflow_valve, 0.0, "twice is as before");
        assert_eq!(after(Switch::Outflow, 1).outflow_valve, OUTFLOW);
        assert_eq!(after(Switch::Light, 1).light, DIM);
        assert_eq!(after(Switch::Loop, 1).buttons, BUTTON_EXTENDED);
        assert!((after(Switch::PressureUp, 1).set_pressure_pa - 9_999.6).abs() < 1.0);
        assert!(
            (after(Switch::FocusNear, 1).focus_m - 0.0174).abs() < 1e-4
                && (after(Switch::FocusFar, 2).focus_m - 0.023).abs() < 1e-4
        );
        let lowest = (0..10).map(|_| after(Switch::PressureDown, 8).set_pressure_pa).last();
        assert_eq!(lowest, Some(PRESSURE_PA[0]));
    }

    /// The deflection about yaw, the current, and whether there is none.
    type Look = (f32, u32, u32);

    fn look(said: &Said) -> Look {
        let [current, is_gone] = [&said.current, &said.is_gone].map(|word| word.load(Ordering::Relaxed));
        (f32::from_bits(said.along[1].load(Ordering::Relaxed)), current, is_gone)
    }

    /// One that says what it is given, and is pulled out then; it notes what is said before each word of its own, and until when it was to be waited for, ns.
    struct Fake<'a> {
        words: VecDeque<Vec<Event>>,
        said: &'a Said,
        seen: &'a RefCell<Vec<Look>>,
        waits: &'a RefCell<Vec<Option<u64>>>,
    }

    impl Source for Fake<'_> {
        fn ranges(&self) -> Ranges {
            Ranges::new([(0, 0, 255)].into_iter())
        }

        fn next(&mut self, until_ns: Option<u64>) -> io::Result<Vec<Event>> {
            self.seen.borrow_mut().push(look(self.said));
            self.waits.borrow_mut().push(until_ns);
            self.words.pop_front().ok_or_else(|| io::Error::from_raw_os_error(19))
        }
    }

    #[test]
    fn one_that_is_pulled_out_lets_go_of_everything_and_goes_on_when_it_is_there_again() {
        let current = Event { kind: 1, code: 0x130, value: 1 };
        let left = Event { kind: 3, code: 0, value: 0 };
        let (said, seen, waits) = (Said::default(), RefCell::default(), RefCell::default());
        let words_of = |words: &[Event]| -> VecDeque<Vec<Event>> { words.iter().map(|word| vec![*word]).collect() };
        let fake = |words: &[Event]| Fake { words: words_of(words), said: &said, seen: &seen, waits: &waits };
        let (mut later, mut looks) = (vec![None, Some(fake(&[left])), None], 0);
        let pause = || {
            seen.borrow_mut().push(look(&said));
            looks += 1;
            looks < 2
        };
        let find = || later.pop().flatten();
        follow(Make::Gamepad, &said, fake(&[current, left]), find, pause, || 0);
        let (free, gone) = ((0.0, 0, 0), (0.0, 0, 1));
        assert_eq!(*seen.borrow(), [free, (0.0, 1, 0), (1.0, 1, 0), gone, free, (1.0, 0, 0), gone]);
        assert_eq!(*waits.borrow(), [None; 5], "it is waited for as long as it takes");
    }

    /// The scope went on, for the kernel says nothing of it; and whoever waits for its next word waits for ever.
    #[test]
    fn a_knob_that_is_let_go_of_is_at_rest_once_it_has_been_silent_and_not_before() {
        const MS: u64 = 1_000_000;
        let aside = Event { kind: 2, code: 4, value: 350 };
        let (said, seen, waits) = (Said::default(), RefCell::default(), RefCell::default());
        // It says so twice; then nothing has come, and nothing again. This thread reads at these times.
        let words = [vec![aside], vec![aside], vec![], vec![]].into();
        let mut times_ns = [0, 16, 65, 66].map(|ms| ms * MS).into_iter();
        let knob = Fake { words, said: &said, seen: &seen, waits: &waits };
        follow(Make::SpaceMouse, &said, knob, || None, || false, || times_ns.next().unwrap_or(u64::MAX));
        let (rests, goes) = ((0.0, 0, 0), (1.0, 0, 0));
        assert_eq!(*seen.borrow(), [rests, goes, goes, goes, rests]);
        assert_eq!(*waits.borrow(), [None, Some(50 * MS), Some(66 * MS), Some(66 * MS), None]);
    }

    /// It stood in the log of the hardware alone, which no trainee reads: the scope stood still, and nobody said why.
    #[test]
    fn one_that_is_gone_complains_until_it_is_there_again() {
        for (make, word) in [(Make::Gamepad, "the gamepad is gone"), (Make::SpaceMouse, "the 3D mouse is gone")] {
            let pad = Pad { gone: make.gone(), ..Pad::default() };
            let complaint_of = |is_gone: u32| {
                pad.said.is_gone.store(is_gone, Ordering::Relaxed);
                pad.complaint()
            };
            assert!(complaint_of(0).is_empty() && complaint_of(1).starts_with(word) && complaint_of(0).is_empty());
        }
    }
}
