//! What the strip of text says: time, pump with its alarms, pictures per second, the case, what is held still, and for some seconds which process was replaced.

use hyst_engine::{Life, Told};
use hyst_exchange::StationPage;
use hyst_messages::page::{header, station as layout};
use hyst_messages::{Controls, FluidStatus, PUMP_ALARMS, PUMP_NOTICES, Role, SLOTS, Shown, Slot};
use rendering::{ALARM, COLUMNS, Overlay};

/// How long the sign of a replaced process stays, ticks.
const SIGN_TICKS: u64 = 3_000;
/// Interval over which pictures are counted, ticks.
const COUNT_TICKS: u64 = 1_000;
/// Interval in which it is asked what is told of the case, ticks.
const HEAR_TICKS: u64 = 400;
/// The first line in a station in test mode, for as long as it runs.
const TEST_MODE: &str = "*** TEST MODE: faults may be injected ***";
/// What stands there while the loop cuts no finer, for some seconds after each sweep that met a limit.
const CUT_LIMIT: &str = "notice   no finer cut here: mesh at its limit";
/// What the fluid said longer ago is not known any more, ticks: with a holder and a spare gone another one is there by then, and the slowest flow has made eight steps.
const FRESH_TICKS: u64 = 2_000;
/// Valves below this are shut, of 0 to 1, as a report has it.
const SHUT: f32 = 0.05;
/// 1 mmHg, Pa.
const MMHG_PA: f64 = 133.322;

/// The line of an alarm, which is written in large letters; in short words, for there is room for half as many.
fn alarm(words: &str) -> String {
    format!("{ALARM}  {words}")
}

/// The strip's memory.
#[derive(Debug, Default)]
pub struct Strip {
    test_mode: bool,
    /// The clock is a virtual one, by which a rate says nothing.
    is_virtual: bool,
    lives: [u32; SLOTS],
    /// Who was replaced within the time of a sign.
    signed: Vec<Slot>,
    /// Roles whose state is held still, because no successor survives a step of it: of the tissue there is no force.
    held: Vec<&'static str>,
    shown: Shown,
    /// What stands beside the flow: which valves are shut.
    shut: &'static str,
    sign: String,
    sign_until: u64,
    counted_from: u64,
    frames: u64,
    rate_hz: f32,
    told: Option<Told>,
    heard_at: u64,
    /// Sweeps of the loop that met a limit so far.
    cut_limits: u32,
    limit_until: u64,
}

impl Strip {
    /// The strip of a station. Before the first picture of a process that follows one that died, that death is still to be signed.
    pub fn of(life: &Life) -> Strip {
        let mut strip = Strip { test_mode: life.clock.test_mode(), is_virtual: life.is_lockstep(), ..Strip::default() };
        let restarts = life.clock.page().load64(layout::SLOT_RESTARTS + life.slot.number());
        if restarts > 0 && life.page.load64(header::STEPS) == 0 {
            strip.follow_another(life.slot, life.incarnation);
        }
        strip
    }

    /// As if another life had been seen in a slot.
    fn follow_another(&mut self, slot: Slot, life: u32) {
        self.lives[slot.number()] = if life == 1 { 2 } else { 1 };
    }

    /// Counts a picture.
    pub fn count(&mut self, tick: u64) {
        self.frames += 1;
        if tick >= self.counted_from + COUNT_TICKS {
            self.rate_hz = self.frames as f32 * 1e3 / (tick - self.counted_from) as f32;
            (self.frames, self.counted_from) = (0, tick);
        }
    }

    /// Looks at the slots, where a life that follows another one is a replacement, and at what is held still.
    pub fn look(&mut self, clock: &StationPage, tick: u64) {
        for number in 0..SLOTS {
            if let Some(slot) = Slot::from_number(number) {
                self.note(slot, clock.incarnation(slot), tick);
            }
        }
        self.held.clear();
        self.held.extend(Role::ALL.into_iter().filter(|role| clock.is_held(*role)).map(Role::name));
    }

    /// Takes how the valves stand; a flow of nothing is not said to be anybody's doing where that is not known.
    pub fn turn(&mut self, controls: Option<&Controls>) {
        let are_shut =
            controls.map_or([false; 2], |controls| [controls.inflow_valve, controls.outflow_valve].map(|valve| valve < SHUT));
        self.shut = match are_shut {
            [true, true] => ", both shut",
            [true, false] => ", inflow shut",
            [false, true] => ", outflow shut",
            [false, false] => "",
        };
    }

    /// What is shown of what the newest of the fluids says: the pressure is the mean over a second, as on a pump's display.
    pub fn smooth(&mut self, fluid: Option<FluidStatus>) -> Option<FluidStatus> {
        fluid.map(|status| self.shown.show(&status))
    }

    /// Asks what is told of the case.
    pub fn hear(&mut self, life: &Life, tick: u64) {
        if tick >= self.heard_at + HEAR_TICKS {
            (self.told, self.heard_at) = (Told::read(&life.station, tick), tick);
        }
    }

    /// Takes how many sweeps of the loop met a limit so far.
    pub fn heed(&mut self, cut_limits: u32, tick: u64) {
        if cut_limits > self.cut_limits {
            self.limit_until = tick + SIGN_TICKS;
        }
        self.cut_limits = cut_limits;
    }

    /// Whether the session is over: then there is no current.
    pub fn is_over(&self) -> bool {
        self.told.as_ref().is_some_and(|told| told.over.is_some())
    }

    /// What is told of the case, under an empty line.
    pub fn case(&self) -> Vec<String> {
        let lines = self.told.iter().flat_map(|told| told.lines.iter().cloned());
        self.told.iter().map(|_| String::new()).chain(lines).collect()
    }

    fn note(&mut self, slot: Slot, life: u32, tick: u64) {
        let before = std::mem::replace(&mut self.lives[slot.number()], life);
        if before != 0 && life != before && life != 0 {
            if tick >= self.sign_until {
                self.signed.clear();
            }
            if !self.signed.contains(&slot) {
                self.signed.push(slot);
            }
            let names: Vec<String> = self.signed.iter().map(Slot::to_string).collect();
            let sign = format!("{} replaced", names.join(", "));
            self.sign = if sign.len() <= COLUMNS { sign } else { format!("{} processes replaced", names.len()) };
            self.sign_until = tick + SIGN_TICKS;
        }
    }

    /// The text of this tick; `set_pa`: the set pressure, where it is set from here.
    pub fn overlay(&self, tick: u64, fluid: Option<&FluidStatus>, set_pa: Option<f32>) -> Overlay {
        let seconds = tick / 1_000;
        let mut lines: Vec<String> = self.test_mode.then(|| TEST_MODE.to_string()).into_iter().collect();
        let rate = if self.is_virtual { String::new() } else { format!("   {:.0} pictures/s", self.rate_hz) };
        lines.push(format!("{:02}:{:02}{rate}", seconds / 60, seconds % 60));
        if let Some(fluid) = fluid {
            let is_known = tick <= fluid.state_tick.saturating_add(FRESH_TICKS);
            // Of a little less than nothing no minus is left.
            let figure = |value: f64| if is_known { format!("{:4.0}", value.round() + 0.0) } else { "   -".to_string() };
            let set = set_pa.map_or(String::new(), |set_pa| format!(", set {:.0}", f64::from(set_pa) / MMHG_PA));
            lines.push(format!("pressure {} mmHg{set}", figure(f64::from(fluid.pressure_pa) / MMHG_PA)));
            lines.push(format!("flow     {} ml/min{}", figure(fluid.inflow_ml_min.into()), self.shut));
            lines.push(format!("deficit  {} ml", figure(fluid.deficit_ml)));
            let said = PUMP_ALARMS.iter().filter(|(bit, _)| is_known && fluid.alarms & bit != 0);
            lines.extend(said.map(|(bit, name)| match bit & PUMP_NOTICES {
                0 => alarm(name),
                _ => format!("notice   {name}"),
            }));
        }
        lines.extend(self.held.iter().map(|role| alarm(&format!("{role} held still"))));
        if tick < self.limit_until {
            lines.push(CUT_LIMIT.to_string());
        }
        let sign = if tick < self.sign_until { self.sign.clone() } else { String::new() };
        Overlay { lines, sign }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_exchange::Station;
    use rendering::ALARM_COLUMNS;

    #[test]
    fn in_test_mode_the_first_line_says_so_for_ever_and_otherwise_there_is_none() {
        let tested = Strip { test_mode: true, ..Strip::default() };
        for tick in [0, 61_000, 36_000_000] {
            let (lines, plain) = (tested.overlay(tick, None, None).lines, Strip::default().overlay(tick, None, None).lines);
            assert_eq!(lines.split_first(), Some((&TEST_MODE.to_string(), &plain[..])));
        }
        assert!(TEST_MODE.len() <= rendering::COLUMNS);
    }

    /// The hand felt nothing any more, and the picture did not say why.
    #[test]
    fn a_role_that_is_held_still_is_an_alarm_for_as_long_as_it_is() {
        let station = Station::named(&format!("t{}-strip", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        let (keeper, clock) = (station.open_for_keeping().unwrap(), station.open().unwrap());
        let mut strip = Strip::default();
        let last = |held: u32| {
            keeper.store32(layout::HELD + Role::Tissue as usize, held);
            strip.look(&clock, 10);
            strip.overlay(10, Some(&FluidStatus::default()), None).lines.pop()
        };
        let told = [0, 1, 0].map(last);
        assert_eq!(
            told.each_ref().map(|line| line.as_deref() == Some("ALARM  tissue held still")),
            [false, true, false],
            "{told:?}"
        );
        station.wipe();
    }

    #[test]
    fn a_replaced_process_is_signed_for_three_seconds_and_a_first_life_is_not() {
        let mut strip = Strip::default();
        let haptic = Slot::new(Role::Haptic, 1).unwrap();
        strip.note(haptic, 4, 10);
        assert_eq!(strip.overlay(11, None, None).sign, "");
        strip.note(haptic, 9, 2_000);
        assert_eq!(strip.overlay(4_999, None, None).sign, "haptic:1 replaced");
        assert_eq!(strip.overlay(5_000, None, None).sign, "");
    }

    /// Of two that were replaced at once the picture named the one with the higher number, and never itself.
    #[test]
    fn those_that_are_replaced_at_once_are_signed_together_as_far_as_there_is_room_and_a_new_rendering_signs_itself() {
        let mut strip = Strip::default();
        let sign = |strip: &Strip, tick: u64| strip.overlay(tick, None, None).sign;
        let slots = [(Role::Haptic, 0), (Role::Tissue, 1), (Role::Fluid, 0), (Role::Recorder, 0), (Role::Console, 0)];
        let slots = slots.map(|(role, index)| Slot::new(role, index).unwrap());
        slots.iter().for_each(|slot| strip.note(*slot, 3, 0));
        for (slot, life, tick) in [(slots[0], 4, 1_000), (slots[1], 5, 3_999), (slots[1], 6, 4_000)] {
            strip.note(slot, life, tick);
        }
        assert_eq!(sign(&strip, 6_999), "haptic:0, tissue:1 replaced");
        strip.note(slots[2], 7, 7_000);
        assert_eq!(sign(&strip, 7_000), "fluid:0 replaced", "the signs of before are over");
        slots.iter().for_each(|slot| strip.note(*slot, 8, 7_001));
        assert_eq!(sign(&strip, 7_002), "5 processes replaced");
        let mut strip = Strip::default();
        let rendering = Slot::first(Role::Rendering);
        strip.follow_another(rendering, 1);
        strip.note(rendering, 1, 50);
        assert_eq!(sign(&strip, 60), "rendering replaced");
    }

    #[test]
    fn a_loop_that_cuts_no_finer_is_said_for_three_seconds_after_each_sweep_that_met_a_limit() {
        let mut strip = Strip::default();
        let is_said = |strip: &Strip, tick| strip.overlay(tick, None, None).lines.iter().any(|line| line == CUT_LIMIT);
        strip.heed(0, 10);
        assert!(!is_said(&strip, 10));
        for (cut_limits, tick) in [(1, 1_000), (3, 9_000)] {
            strip.heed(cut_limits, tick);
            strip.heed(cut_limits, tick + 500);
            assert!(is_said(&strip, tick + 2_999) && !is_said(&strip, tick + 3_000), "{cut_limits}");
        }
        assert!(CUT_LIMIT.len() <= rendering::COLUMNS);
    }

    #[test]
    fn the_case_stands_under_an_empty_line_and_its_end_is_known() {
        assert!(Strip::default().case().is_empty() && !Strip::default().is_over());
        let told = Told { tick: 1, over: Some("all goals".into()), lines: vec!["goals    2 of 2".into()], ..Told::default() };
        let strip = Strip { told: Some(told), ..Strip::default() };
        assert_eq!(strip.case(), ["", "goals    2 of 2"]);
        assert!(strip.is_over());
    }

    #[test]
    fn pressure_is_told_in_mmhg_and_pictures_per_second_by_the_stations_clock() {
        let mut strip = Strip::default();
        for frame in 1..=40 {
            strip.count(frame * 25);
        }
        let status = FluidStatus { pressure_pa: 9_333.0, inflow_ml_min: 120.4, deficit_ml: 12.6, ..FluidStatus::default() };
        let fluid = FluidStatus { state_tick: 60_990, ..status };
        let overlay = strip.overlay(61_000, Some(&fluid), None);
        assert_eq!(overlay.lines, ["01:01   40 pictures/s", "pressure   70 mmHg", "flow      120 ml/min", "deficit    13 ml"]);
        assert_eq!(strip.overlay(61_000, Some(&fluid), Some(9_999.0)).lines[1], "pressure   70 mmHg, set 75");
    }

    /// In lock-step the first picture of the README said five pictures a second, of thirty that had been drawn.
    #[test]
    fn on_a_virtual_clock_there_is_no_rate_beside_the_time() {
        let mut strip = Strip { is_virtual: true, ..Strip::default() };
        (1..=40).for_each(|frame| strip.count(frame * 200));
        assert_eq!(strip.overlay(61_000, None, None).lines, ["01:01"]);
    }

    #[test]
    fn each_alarm_fits_into_a_line_of_large_letters() {
        let alarms = PUMP_ALARMS.iter().map(|(_, name)| alarm(name));
        let held =
            Role::ALL.into_iter().filter(|role| role.is_stateful()).map(|role| alarm(&format!("{} held still", role.name())));
        for line in alarms.chain(held) {
            assert!(line.starts_with(ALARM) && line.len() <= ALARM_COLUMNS, "{line}");
        }
    }

    #[test]
    fn a_valve_that_is_shut_is_told_beside_the_flow_and_one_that_is_open_or_not_known_is_not() {
        let mut strip = Strip::default();
        let mut told = |valves: Option<[f32; 2]>| {
            let of = |[inflow_valve, outflow_valve]: [f32; 2]| Controls { inflow_valve, outflow_valve, ..Controls::default() };
            strip.turn(valves.map(of).as_ref());
            strip.overlay(0, Some(&FluidStatus::default()), None).lines.swap_remove(2)
        };
        assert_eq!(told(Some([0.0, 0.3])), "flow        0 ml/min, inflow shut");
        assert_eq!(told(Some([1.0, 0.0])), "flow        0 ml/min, outflow shut");
        assert_eq!(told(Some([0.0, 0.0])), "flow        0 ml/min, both shut");
        for valves in [Some([1.0, 0.3]), Some([f32::NAN; 2]), None] {
            assert_eq!(told(valves), "flow        0 ml/min", "{valves:?}");
        }
    }

    /// Of two fluids that had died the pressure stood there as if it were measured.
    #[test]
    fn what_no_fluid_has_said_for_two_seconds_is_no_figure_and_no_alarm() {
        let fluid = FluidStatus { state_tick: 500, pressure_pa: 9_333.0, alarms: 2, ..FluidStatus::default() };
        let of = |tick| Strip::default().overlay(tick, Some(&fluid), Some(9_999.0)).lines[1..].to_vec();
        assert_eq!(of(2_500), ["pressure   70 mmHg, set 75", "flow        0 ml/min", "deficit     0 ml", "ALARM  deficit"]);
        assert_eq!(of(2_501), ["pressure    - mmHg, set 75", "flow        - ml/min", "deficit     - ml"]);
    }

    #[test]
    fn the_pumps_alarms_stand_under_its_figures_while_they_sound() {
        let of = |alarms: u32| Strip::default().overlay(0, Some(&FluidStatus { alarms, ..FluidStatus::default() }), None).lines;
        assert_eq!(of(0).len(), 4);
        assert_eq!(of(2 | 8)[4..], ["ALARM  deficit", "ALARM  perforation"]);
        assert_eq!(of(16)[4..], ["notice   container change"], "it asks for nothing");
    }
}
