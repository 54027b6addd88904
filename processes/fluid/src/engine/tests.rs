//! Promise of the Flow Engine: a state is written in full, so that what an older message left in the loan is nowhere in it.

#[path = "../../../../shared/engine/tests/support/loans.rs"]
mod loans;

use super::*;
use crate::afford::{at_rest, tissue_at_rest};
use crate::heard::stated::stated;
use crate::removed::tests::gone_ml;
use crate::wounds::Vessel;
use glam::{IVec3, Vec3};
use hyst_exchange::roster::Tenure;
use hyst_exchange::{OwnedPage, Station};
use hyst_flow::{Alarms, BloodSource, Capsule, PumpState, StepReport};
use hyst_messages::page::hardware;
use hyst_messages::{FLOW_FLAWS, HardwareSample, PUMP_ALARMS, SAMPLE_KEPT, Slot};
use loans::written;

const STEPS: u64 = 3;

#[test]
fn each_alarm_of_the_pump_and_each_flaw_has_the_bit_of_its_name() {
    type Place = fn(&mut Alarms) -> &mut bool;
    let set: [(Place, &str); 5] = [
        (|alarms| &mut alarms.pressure, "pressure"),
        (|alarms| &mut alarms.deficit, "deficit"),
        (|alarms| &mut alarms.abnormal_loss, "abnormal loss"),
        (|alarms| &mut alarms.perforation, "perforation"),
        (|alarms| &mut alarms.container, "container change"),
    ];
    for (alarm, name) in set {
        let mut report = StepReport::default();
        *alarm(&mut report.pump.alarms) = true;
        let status = status_of(&report, &PumpState::default());
        assert_eq!(PUMP_ALARMS.iter().find(|(_, known)| *known == name), Some(&(status.alarms, name)));
        assert_eq!(alarms_of(&status), report.pump.alarms, "{name}");
    }
    type Flaw = fn(&mut StepReport);
    let flaws: [(Flaw, &str); 5] = [
        (|report| report.neutralised = 1, "input replaced"),
        (|report| report.wild = 1, "wild speed"),
        (|report| report.slowed = true, "slowed"),
        (|report| report.unconverged = true, "not converged"),
        (|report| report.blind_ports = 1, "port without cells"),
    ];
    for (flaw, name) in flaws {
        let mut report = StepReport::default();
        flaw(&mut report);
        let bits = status_of(&report, &PumpState::default()).flaws;
        assert_eq!(FLOW_FLAWS.iter().find(|(_, known)| *known == name), Some(&(bits, name)));
    }
    let of_engine = [
        (flaws_of(1, false), "input replaced"),
        (flaws_of(0, true), "walls open"),
        (WALLS_KEPT, "walls kept"),
        (SAMPLE_KEPT, "sample kept"),
    ];
    for (bits, name) in of_engine {
        assert_eq!(FLOW_FLAWS.iter().find(|(_, known)| *known == name), Some(&(bits, name)));
    }
    assert_eq!((flaws_of(0, false), flaws_of(7, true)), (0, WALLS_REPLACED | WALLS_OPEN));
    let pump = PumpState { in_ml: 7.0, out_ml: 4.0, cavity_ml: 5.0, bled_ml: 2.0, ..PumpState::default() };
    let status = status_of(&StepReport::default(), &pump);
    assert_eq!((status.alarms, status.deficit_ml, status.cavity_volume_ml, status.bled_ml), (0, 3.0, 5.0, 2.0));
}

/// An engine of a station of its own. It computes alone: then a step is measured by its own time, and is no longer where other tests have the cores.
fn in_a_station(name: &str, body: impl FnOnce(FlowEngine<'_>)) {
    let station = Station::named(&format!("t{}-fluid-{name}", std::process::id())).unwrap();
    station.wipe();
    station.found().unwrap();
    std::fs::write(station.settings(), "[set]\nfluid_threads = \"1\"\n").unwrap();
    let slot = Slot::first(Role::Fluid);
    drop(station.create_slot(slot, 1).unwrap());
    let life = Life::begin(station.name(), slot, 1).unwrap();
    body(FlowEngine::new(&life).unwrap());
    station.wipe();
}

/// The hardware's page, with a statement and a first sample of the default scene's hand at rest, which the engine hears.
fn plugged(engine: &mut FlowEngine<'_>) -> (OwnedPage, HardwareSample) {
    let (station, slot) = (&engine.life.station, Slot::first(Role::Hardware));
    let page = station.create_slot(slot, 3).unwrap();
    assert!(engine.heard.replace(station.read_slot(slot, 3).unwrap()).is_none());
    page.write(hardware::STATEMENT, &stated());
    let rest = at_rest(&load_scene(None).unwrap());
    let sample = HardwareSample { hardware_tick: 1, time_ns: system::now_ns(), ..rest };
    page.write(hardware::SAMPLE, &sample);
    (page, sample)
}

fn context(tick: u64, step_ticks: u64) -> StepContext {
    StepContext {
        tick,
        next_tick: tick + step_ticks,
        state_epoch: 1,
        state_writer: 1,
        step_ticks,
        tenure: Tenure { epoch: 1, incarnation: 1 },
        holding: true,
        deadline_ns: 0,
    }
}

#[test]
fn whoever_goes_on_from_a_state_takes_its_step_and_says_that_the_scene_asks_for_another() {
    in_a_station("steps", |mut engine| {
        let scene_ticks = engine.scene_ticks;
        let bytes = engine.message_bytes();
        let mut first = vec![0u64; bytes / 8];
        engine.initial(StreamHeader::default(), bytemuck::cast_slice_mut(&mut first)).unwrap();
        let found = hyst_messages::contents::check(bytemuck::cast_slice(&first), Kind::FluidState);
        assert_eq!(found, Ok(()), "as docs/messages.md says");
        let stepped = |engine: &mut FlowEngine<'_>, now: &[u64], step_ticks: u64| {
            let mut next = vec![0u64; bytes / 8];
            let context = context(100, step_ticks);
            engine.step(&context, bytemuck::cast_slice(now), bytemuck::cast_slice_mut(&mut next)).unwrap();
            hyst_messages::stream::change_header(bytemuck::cast_slice_mut(&mut next), |header| {
                (header.tick, header.step_ticks) = (context.next_tick, step_ticks as u32);
            });
            next
        };
        engine.step_ticks.set(scene_ticks);
        let long = stepped(&mut engine, &first, 2 * scene_ticks);
        let head: Head = Message::parse(bytemuck::cast_slice(&long), Kind::FluidState).unwrap().record(0).unwrap();
        assert_eq!(u64::from(head.status.step_ticks), 2 * scene_ticks);
        assert_eq!(u64::from(head.status.scene_step_ticks), scene_ticks);
        assert!(engine.accepts(bytemuck::cast_slice(&long)));
        assert_eq!(Stateful::step_ticks(&engine), scene_ticks, "whoever only looks at it keeps his own");
        engine.take_step(2 * scene_ticks);
        assert_eq!(Stateful::step_ticks(&engine), 2 * scene_ticks);
        // The time of the pump and of the flow goes on by as much.
        let next = stepped(&mut engine, &long, 2 * scene_ticks);
        let block: &[u8] = Message::parse(bytemuck::cast_slice(&next), Kind::FluidState).unwrap().section(1).unwrap();
        let time_s = StateView::new(block).unwrap().time().1;
        assert!((time_s - 4e-3 * scene_ticks as f64).abs() < 1e-6, "{time_s} s");
        // A bit that flips makes no other step of it.
        engine.take_step(2 * scene_ticks + 1);
        assert_eq!(Stateful::step_ticks(&engine), 2 * scene_ticks);
    });
}

/// It went on by a single period, and what the pump would have moved meanwhile was in no deficit.
#[test]
fn a_step_after_periods_that_were_skipped_moves_pump_and_flow_by_all_of_them() {
    in_a_station("skips", |mut engine| {
        let _hardware = plugged(&mut engine);
        let bytes = engine.message_bytes();
        let mut first = vec![0u64; bytes / 8];
        engine.initial(StreamHeader::default(), bytemuck::cast_slice_mut(&mut first)).unwrap();
        let mut made = |now: &[u64], next_tick: u64| {
            let tick = Message::parse(bytemuck::cast_slice(now), Kind::FluidState).unwrap().header().tick;
            let mut next = vec![0u64; bytes / 8];
            let context = StepContext { next_tick, ..context(tick, 33) };
            engine.step(&context, bytemuck::cast_slice(now), bytemuck::cast_slice_mut(&mut next)).unwrap();
            hyst_messages::stream::change_header(bytemuck::cast_slice_mut(&mut next), |header| {
                (header.tick, header.step_ticks) = (next_tick, 33);
            });
            next
        };
        let told = |state: &[u64]| {
            let block: &[u8] = Message::parse(bytemuck::cast_slice(state), Kind::FluidState).unwrap().section(1).unwrap();
            let view = StateView::new(block).unwrap();
            (*view.pump(), view.time().1)
        };
        let founded = made(&first, 1_000);
        let first_s = told(&founded).1;
        assert!((first_s - 0.033).abs() < 1e-6, "{first_s} s: nothing flowed before the role was founded");
        let before = made(&founded, 1_250);
        let mut in_periods = before.clone();
        for tick in [1_283, 1_316, 1_349, 1_382] {
            in_periods = made(&in_periods, tick);
        }
        let at_once = made(&before, 1_382);
        let ((from, from_s), (each, each_s), (all, all_s)) = (told(&before), told(&in_periods), told(&at_once));
        assert!((all_s - each_s).abs() < 1e-6 && (all_s - from_s - 0.132).abs() < 1e-6, "{from_s} s, {each_s} s, {all_s} s");
        for (from_ml, each_ml, all_ml) in [(from.in_ml, each.in_ml, all.in_ml), (from.out_ml, each.out_ml, all.out_ml)] {
            let (went_ml, went_at_once_ml) = (each_ml - from_ml, all_ml - from_ml);
            assert!(went_ml > 0.05 && (went_at_once_ml / went_ml - 1.0).abs() < 0.02, "{went_ml} ml, at once {went_at_once_ml}");
        }
        let mut moved_s = |next_tick: u64| told(&made(&before, next_tick)).1 - from_s;
        let wanted_s = [(1_283, 0.033), (1_200, 0.033), (1_499, 0.249), (1_501, 0.25), (61_250, 0.25)];
        for (next_tick, wanted_s) in wanted_s {
            let found_s = moved_s(next_tick);
            assert!((found_s - wanted_s).abs() < 1e-6, "to tick {next_tick}: {found_s} s");
        }
    });
}

#[test]
fn what_is_coagulated_is_in_the_state_and_whoever_goes_on_from_it_has_it() {
    in_a_station("seals", |mut engine| {
        let bytes = engine.message_bytes();
        let mouth = BloodSource { position_m: [0.0; 3], opening: 1.0 };
        let vessel = Vessel { cube: IVec3::ZERO, rest_m: Vec3::ZERO, area_m2: 1e-6, mouth };
        let wire = Capsule { radius_m: 1e-4, ..Capsule::default() };
        (0..40).for_each(|_| engine.seals.touch(&[vessel], &[wire], 0.033));
        let (mut now, mut next) = (vec![0u64; bytes / 8], vec![0u64; bytes / 8]);
        engine.write(StreamHeader::default(), FluidStatus::default(), bytemuck::cast_slice_mut(&mut now)).unwrap();
        engine.seals.clear(); // as a successor begins
        engine.step(&context(33, 33), bytemuck::cast_slice(&now), bytemuck::cast_slice_mut(&mut next)).unwrap();
        let message = Message::parse(bytemuck::cast_slice(&next), Kind::FluidState).unwrap();
        let head: Head = message.record(0).unwrap();
        let seals: &[SealRecord] = message.section(seals::SECTION).unwrap();
        assert_eq!((head.status.sealed_vessels, seals[0].share, seals.len()), (1, 1.0, MAX_SEALS));
        assert!(seals[1..].iter().all(|seal| *seal == SealRecord::default()));
        // The role founded anew has none.
        engine.initial(StreamHeader::default(), bytemuck::cast_slice_mut(&mut next)).unwrap();
        let head: Head = Message::parse(bytemuck::cast_slice(&next), Kind::FluidState).unwrap().record(0).unwrap();
        assert_eq!(head.status.sealed_vessels, 0);
    });
}

/// One that stood still under a stamp that went on was said to have a number that is none.
#[test]
fn a_state_that_is_refused_is_refused_for_what_is_wrong_with_it() {
    in_a_station("refused", |mut engine| {
        let mut state = vec![0u64; engine.message_bytes() / 8];
        let header = StreamHeader { tick: 500, step_ticks: 33, ..StreamHeader::default() };
        let cases = [
            (500, 9_000.0, None),
            (467, 9_000.0, Some(Refusal::OtherTick)),
            (500, f32::NAN, Some(Refusal::Numbers)),
            (467, f32::INFINITY, Some(Refusal::Numbers)),
        ];
        for (state_tick, pressure_pa, why) in cases {
            let status = FluidStatus { state_tick, pressure_pa, ..FluidStatus::default() };
            engine.write(header, status, bytemuck::cast_slice_mut(&mut state)).unwrap();
            let bytes: &[u8] = bytemuck::cast_slice(&state);
            let found = (!engine.accepts(bytes)).then(|| engine.why_refused(bytes));
            assert_eq!(found, why, "state {state_tick} with {pressure_pa} Pa under the stamp of 500");
        }
    });
}

#[test]
fn dry_steps_that_find_the_pace_leave_the_flow_as_the_scene_has_it() {
    in_a_station("dry", |mut engine| {
        let state = |engine: &FlowEngine<'_>| {
            let mut block = vec![0u64; engine.crew.solver().state_bytes() / 8];
            engine.crew.solver().store(bytemuck::cast_slice_mut(&mut block)).unwrap();
            block
        };
        let scene = load_scene(None).unwrap();
        let fresh = Solver::new(model_of(&scene, scene.fluid.grid.map(|count| count as usize)).unwrap(), 1).unwrap();
        let mut first = vec![0u64; fresh.state_bytes() / 8];
        fresh.store(bytemuck::cast_slice_mut(&mut first)).unwrap();
        assert!(state(&engine) == first);
        engine.choose_step(&scene).unwrap().unwrap();
        assert!(state(&engine) == first && engine.cavity.mask().iter().all(|cell| *cell == 0));
    });
}

#[test]
fn whoever_comes_to_a_role_that_goes_on_takes_its_step_without_a_dry_one() {
    in_a_station("follows", |mut engine| {
        let (life, scene) = (engine.life, load_scene(None).unwrap());
        let other = Slot::new(Role::Fluid, 1).unwrap();
        let page = life.station.create_slot(other, 2).unwrap();
        life.station.open_for_keeping().unwrap().store32(station::SLOT_INCARNATION + other.number(), 2);
        let founded = hyst_exchange::Roster::open(&life.station).unwrap().promote(Role::Fluid, Tenure::default(), 2).unwrap();
        let mut chosen = |step_ticks: u64| {
            page.write(
                fluid::STATUS,
                &FluidStatus { epoch: founded.epoch, step_ticks: step_ticks as u32, ..FluidStatus::default() },
            );
            engine.step_ticks.set(1);
            engine.choose_step(&scene).unwrap().unwrap();
            Stateful::step_ticks(&engine)
        };
        // Longer than any machine needs for the default scene, so that no dry step finds it.
        assert_eq!(chosen(4 * scene.fluid.period_ticks()), 4 * scene.fluid.period_ticks());
        assert_eq!(chosen(7), scene.fluid.period_ticks(), "what is no step of the scene is not taken");
    });
}

#[test]
fn a_sample_that_the_device_refuses_moves_neither_valves_nor_scope_and_is_counted_and_named() {
    in_a_station("sample", |mut engine| {
        let (life, (page, sample)) = (engine.life, plugged(&mut engine));
        let good = engine.inputs(0.03);
        assert!(good.pump.inflow_valve == 1.0 && good.tools[0].radius_m > 0.0, "{good:?}");
        assert_eq!((life.page.load64(header::INVALID), engine.flaws), (0, 0));
        let mut bad = HardwareSample { hardware_tick: 2, time_ns: sample.time_ns + 1_000_000, ..sample };
        (bad.pose.position_m[0], bad.controls.set_pressure_pa) = (f32::NAN, 1e6);
        page.write(hardware::SAMPLE, &bad);
        assert_eq!(engine.inputs(0.03), good);
        assert_eq!(engine.inputs(0.03), good, "and again");
        assert_eq!((life.page.load64(header::INVALID), engine.flaws), (1, SAMPLE_KEPT));
    });
}

#[test]
fn a_state_says_how_much_light_comes_through_before_the_lens_and_one_that_founds_the_role_says_nothing() {
    in_a_station("sight", |mut engine| {
        let _hardware = plugged(&mut engine);
        let bytes = engine.message_bytes();
        let told = |state: &[u64]| {
            let message = Message::parse(bytemuck::cast_slice(state), Kind::FluidState).unwrap();
            message.record::<Head>(0).unwrap().status.transmittance
        };
        let (mut now, mut next) = (vec![0u64; bytes / 8], vec![0u64; bytes / 8]);
        engine.initial(StreamHeader::default(), bytemuck::cast_slice_mut(&mut now)).unwrap();
        engine.step(&context(33, 33), bytemuck::cast_slice(&now), bytemuck::cast_slice_mut(&mut next)).unwrap();
        assert_eq!((told(&now), told(&next), engine.status.transmittance), (0.0, 1.0, 1.0), "there is no blood");
        engine.initial(StreamHeader::default(), bytemuck::cast_slice_mut(&mut next)).unwrap();
        assert_eq!(told(&next), 0.0);
    });
}

#[test]
fn what_the_scope_takes_of_the_cavitys_room_and_what_is_gone_leaves_of_it_is_told_to_the_pump() {
    in_a_station("room", |mut engine| {
        let (scene, (_page, sample)) = (load_scene(None).unwrap(), plugged(&mut engine));
        let scope_ml = engine.inputs(0.03).pump.displaced_ml;
        assert!(scope_ml > 0.0 && scope_ml == Instrument::of(&scene).inputs(&sample, 0.03).pump.displaced_ml, "{scope_ml} ml");
        // Without the polyp, the scene's last object.
        let (rest_m, tets) = tissue_at_rest(&scene);
        let left = tets.len() - scene.objects.last().unwrap().mesh.tets.len();
        let polyp_ml = gone_ml(&mut engine.removed, 1, &tets[..left], Some(&rest_m[..]));
        assert!(polyp_ml > 0.3, "{polyp_ml} ml");
        assert_eq!(engine.inputs(0.03).pump.displaced_ml, scope_ml - polyp_ml);
    });
}

/// Whether an alarm stood is in the state, so that whoever goes on from it ends it where the one before would have.
#[test]
fn an_alarm_of_the_pressure_ends_3_mmhg_below_its_limit_whoever_goes_on_from_the_state() {
    in_a_station("alarm", |mut engine| {
        let (page, mut sample) = plugged(&mut engine);
        let bytes = engine.message_bytes();
        let (mut now, mut next) = (vec![0u64; bytes / 8], vec![0u64; bytes / 8]);
        engine.initial(StreamHeader::default(), bytemuck::cast_slice_mut(&mut now)).unwrap();
        for tick in 1..=3 {
            engine.step(&context(100 * tick, 100), bytemuck::cast_slice(&now), bytemuck::cast_slice_mut(&mut next)).unwrap();
            std::mem::swap(&mut now, &mut next);
        }
        let displaced_ml = engine.inputs(0.03).pump.displaced_ml;
        let (pump, model) = (engine.crew.solver().counters().unwrap().0, engine.crew.solver().model().pump);
        let held_pa = model.distended_pa(pump.cavity_ml, displaced_ml);
        assert!(held_pa > 4_000.0, "{held_pa} Pa");
        // All is shut, and the alarm's limit so far above the cavity's pressure.
        let mut alarms = |stood: u32, above_pa: f64| {
            (sample.hardware_tick, sample.time_ns) = (sample.hardware_tick + 1, sample.time_ns + 1_000_000);
            (sample.controls.inflow_valve, sample.controls.outflow_valve) = (0.0, 0.0);
            sample.controls.set_pressure_pa = (held_pa - model.pressure_alarm_pa + above_pa) as f32;
            page.write(hardware::SAMPLE, &sample);
            let status = FluidStatus { alarms: stood, ..FluidStatus::default() };
            engine.write(StreamHeader::default(), status, bytemuck::cast_slice_mut(&mut now)).unwrap();
            engine.step(&context(400, 33), bytemuck::cast_slice(&now), bytemuck::cast_slice_mut(&mut next)).unwrap();
            let head: Head = Message::parse(bytemuck::cast_slice(&next), Kind::FluidState).unwrap().record(0).unwrap();
            head.status.alarms
        };
        assert_eq!([alarms(0, -10.0), alarms(0, 10.0)], [1, 0], "it begins at its limit");
        assert_eq!([alarms(1, 10.0), alarms(1, 390.0), alarms(1, 410.0)], [1, 1, 0]);
    });
}

#[test]
fn states_have_the_same_bytes_whatever_lay_in_the_loan() {
    in_a_station("loans", |mut engine| {
        let bytes = engine.message_bytes();
        let mut now = written(bytes, "the first state", |block| engine.initial(StreamHeader::default(), block).unwrap());
        for tick in 1..=STEPS {
            let before = now.clone();
            let before: &[u8] = bytemuck::cast_slice(&before);
            let step = |block: &mut [u8]| engine.step(&context(33 * tick, 33), &before[..bytes], block).unwrap();
            now = written(bytes, &format!("state {tick}"), step);
        }
    });
}

/// The hydrometra and the pump are the scene's: what is set there is what the model has, and what is not is what the model has by itself.
#[test]
fn pump_and_cavity_are_those_of_the_scene() {
    let mut scene = load_scene(None).unwrap();
    let cells = scene.fluid.grid.map(|count| count as usize);
    let own = hyst_flow::PumpModel { container_ml: scene.fluid.container_ml.into(), ..Default::default() };
    let model = model_of(&scene, cells).unwrap().pump;
    assert_eq!(model, own, "the default scene says nothing of it");
    scene.fluid.pump = hyst_scene::Pump { max_flow_ml_min: 300.0, leak_ml_s_pa: 1e-4, suction_pa: 2e4, ..scene.fluid.pump };
    scene.fluid.deficit_alarm_ml = Some(1_500.0);
    scene.fluid.cavity = hyst_scene::CavityCurve { volume_ml: 3.0, ..scene.fluid.cavity };
    let model = model_of(&scene, cells).unwrap().pump;
    let set = hyst_flow::PumpModel { max_flow_ml_s: 5.0, leak_ml_s_pa: 1e-4, suction_pa: 2e4, volume_150_mmhg_ml: 3.0, ..own };
    let set = hyst_flow::PumpModel { deficit_alarm_ml: Some(1_500.0), ..set };
    assert_eq!(model, set);
    // A smaller cavity is at a higher pressure with as much in it, and 150 mmHg with 3 ml.
    assert!(
        model.pressure_pa(2.0) > own.pressure_pa(2.0) && (model.pressure_pa(3.0) - 150.0 * hyst_flow::PA_PER_MMHG).abs() < 1.0
    );
    let inputs = Instrument::of(&scene).inputs(&hyst_messages::HardwareSample::default(), 0.01);
    assert_eq!(inputs.pump.flow_limit_ml_min, 300.0);
}
