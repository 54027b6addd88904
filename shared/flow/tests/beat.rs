//! The roller's beat against hand arithmetic, and that it leaves alone what is counted, regulated and given alarm by.

mod scene;

use hyst_flow::{Beat, FlowError, PA_PER_MMHG, PumpInput, PumpModel, PumpReport, PumpState, Solver, StateView};

/// Pump and cavity with their beat.
#[derive(Default)]
struct Run {
    state: PumpState,
    beat_ml: f32,
}

impl Run {
    fn step(&mut self, model: &PumpModel, input: &PumpInput, dt_s: f64) -> PumpReport {
        let from = self.state;
        let mean = model.step(&mut self.state, input, true, 0.0, dt_s);
        let beat = model.beat(&mut self.beat_ml, input, &from, &self.state, dt_s);
        PumpReport { beat, ..mean }
    }

    /// After a minute, in which the cavity has come to rest but for the beat.
    fn at_rest(model: &PumpModel, input: &PumpInput, dt_s: f64) -> Run {
        let mut run = Run::default();
        for _ in 0..(60.0 / dt_s) as usize {
            run.step(model, input, dt_s);
        }
        run
    }
}

fn open(set_pa: f32, flow_limit_ml_min: f32) -> PumpInput {
    PumpInput { set_pa, flow_limit_ml_min, inflow_valve: 1.0, outflow_valve: 1.0, ..Default::default() }
}

/// Half of what lies between the largest and the least.
fn amplitude(values: &[f64]) -> f64 {
    let (low, high) = values.iter().fold((f64::MAX, f64::MIN), |(low, high), value| (low.min(*value), high.max(*value)));
    0.5 * (high - low)
}

#[test]
fn the_mean_flow_of_a_pump_that_beats_is_the_set_flow_in_short_and_long_steps() {
    // 200 ml/min are 3.3333 ml/s, and a roller passes every 1.2 s.
    let (model, input) = (PumpModel::default(), open(15_000.0, 200.0));
    for (dt_s, steps) in [(0.01, 120), (1.0 / 30.0, 36), (0.2, 6)] {
        let mut run = Run::at_rest(&model, &input, dt_s);
        let flows: Vec<[f64; 2]> = (0..steps)
            .map(|_| run.step(&model, &input, dt_s))
            .map(|report| [report.in_ml_s + report.beat.in_ml_s, report.out_ml_s + report.beat.out_ml_s])
            .collect();
        for way in 0..2 {
            let mean_ml_s = flows.iter().map(|flow| flow[way]).sum::<f64>() / flows.len() as f64;
            assert!((mean_ml_s / (200.0 / 60.0) - 1.0).abs() < 0.005, "{dt_s} s, way {way}: {mean_ml_s} ml/s");
        }
        // The dip of 2 · 0.34/4 = 17 % that the tube lets 0.69 of through.
        let inward: Vec<f64> = flows.iter().map(|flow| flow[0]).collect();
        let share = amplitude(&inward) / (200.0 / 60.0);
        assert!(share > 0.09 && share < 0.15, "{dt_s} s: ± {share}");
    }
}

/// By hand, at 8 kPa with both valves open: 7.61905 kPa and 3.80952 ml/s as without a beat (`pump.rs`), a stroke of 4 ml in 1.05 s, ω = 5.984 1/s.
/// The roller displaces ± 0.34/π = 0.10823 ml. Tube: 1e-4/5e-4 = 0.2 s, 1/√(1 + (5.984·0.2)²) = 0.6412. Cavity: 1.4178 ml, where the curve's slope is
/// 1 833.2 + 5 332.9/0.5·e^(−1.4178/0.5) = 2 459 Pa/ml; through the outflow 2 459·5e-4 = 1.2295 1/s and by the pump 1 1/s, together 2.2295 1/s, which leaves
/// 5.984/√(5.984² + 2.2295²) = 0.9371. ± 0.10823·0.6412·0.9371 = 0.06503 ml, ± 159.9 Pa.
#[test]
fn the_ripple_at_the_cavity_is_that_of_tube_and_outflow_by_hand_and_the_mean_pressure_the_one_without_it() {
    let (model, input) = (PumpModel::default(), open(8_000.0, 600.0));
    for (dt_s, steps) in [(0.01, 105), (1.0 / 30.0, 63), (0.005, 210)] {
        let mut run = Run::at_rest(&model, &input, dt_s);
        let pressures_pa: Vec<f64> = (0..steps)
            .map(|_| run.step(&model, &input, dt_s))
            .map(|report| report.pressure_pa + report.beat.pressure_pa)
            .collect();
        let found_pa = amplitude(&pressures_pa);
        assert!((found_pa / 159.9 - 1.0).abs() < 0.1, "{dt_s} s: ± {found_pa} Pa");
        let mean_pa = pressures_pa.iter().sum::<f64>() / pressures_pa.len() as f64;
        assert!((mean_pa - 7_619.05).abs() < 0.1, "{dt_s} s: {mean_pa} Pa");
    }
}

#[test]
fn a_valve_that_is_nearly_shut_keeps_the_beat_in_the_tube() {
    // 1 ml/s, ω = 2π/4 s: through the open valve 1/√(1 + (0.2·1.5708)²) = 0.9540 of the beat, through a tenth of it 1/√(1 + (2·1.5708)²) = 0.3033.
    let model = PumpModel::default();
    let [wide, narrow] = [1.0, 0.1].map(|inflow_valve| {
        let input = PumpInput { inflow_valve, ..open(15_000.0, 60.0) };
        let mut run = Run::at_rest(&model, &input, 0.01);
        let pressures_pa: Vec<f64> = (0..400).map(|_| run.step(&model, &input, 0.01).beat.pressure_pa).collect();
        amplitude(&pressures_pa)
    });
    assert!((narrow / wide / 0.3179 - 1.0).abs() < 0.02, "{narrow} Pa and {wide} Pa");
}

#[test]
fn without_flow_there_is_no_ripple() {
    let (model, input) = (PumpModel::default(), open(8_000.0, 600.0));
    let mut run = Run::at_rest(&model, &input, 0.01);
    (0..30).for_each(|_| {
        run.step(&model, &input, 0.01);
    });
    assert!(run.beat_ml != 0.0);
    // All shut: what is in the cavity stays there, and the pressure with it.
    let shut = PumpInput { inflow_valve: 0.0, outflow_valve: 0.0, ..input };
    let first = run.step(&model, &shut, 0.01);
    for _ in 0..200 {
        assert_eq!(run.step(&model, &shut, 0.01), first);
    }
    // It leaves through the outflow, and is nothing at last.
    let draining = PumpInput { inflow_valve: 0.0, ..input };
    for _ in 0..3_000 {
        run.step(&model, &draining, 0.01);
    }
    assert_eq!((run.beat_ml, run.step(&model, &draining, 0.01).beat), (0.0, Beat::default()));
    // Nor is there any in a pump that does not beat.
    let even = PumpModel { lift_ml: 0.0, ..model };
    let mut run = Run::at_rest(&even, &input, 0.01);
    assert_eq!((run.beat_ml, run.step(&even, &input, 0.01).beat.pressure_pa), (0.0, 0.0));
}

#[test]
fn an_alarm_does_not_follow_the_beat() {
    // 10·(8 − p) = 0.025·p, p = 7.980 kPa: 20 Pa below an alarm that has no margin, and the beat is some 70 Pa.
    let model = PumpModel { pressure_alarm_pa: 0.0, ..PumpModel::default() };
    let input = PumpInput { outflow_valve: 0.05, ..open(8_000.0, 600.0) };
    let mut run = Run::at_rest(&model, &input, 0.01);
    let (mut crossings, mut was_above) = (0, false);
    for step in 0..6_000 {
        let report = run.step(&model, &input, 0.01);
        assert!(!report.alarms.pressure, "step {step}: {report:?}");
        let is_above = report.pressure_pa + report.beat.pressure_pa > 8_000.0;
        crossings += u32::from(is_above && !was_above);
        was_above = is_above;
    }
    assert!(crossings >= 2, "{crossings}: the beat itself is above");
}

/// Gives the checksum that the writer would have given.
fn signed(block: &mut [u64], solver: &Solver) {
    let Err(FlowError::State { field: "checksum", want, .. }) = solver.load(bytemuck::cast_slice(block)) else {
        panic!("the checksum was good before")
    };
    block[1] = want;
}

#[test]
fn the_rollers_place_and_its_beat_are_in_the_state_and_one_that_knows_of_none_begins_without() {
    let (solver, spare) = (scene::cavity([8, 8, 6], 1), Solver::new(scene::model([8, 8, 6]), 2).unwrap());
    (0..100).for_each(|step| {
        solver.step_serial(&scene::inputs(step)).unwrap();
    });
    let block = scene::state(&solver);
    let view = StateView::new(bytemuck::cast_slice(&block)).unwrap();
    let pump = &solver.model().pump;
    let phase = pump.roller_phase(view.pump().in_ml);
    assert!(view.beat_ml() != 0.0 && phase > 0.0 && phase < 1.0, "{} ml, {phase}", view.beat_ml());
    spare.load(bytemuck::cast_slice(&block)).unwrap();
    for step in 100..130 {
        let (a, b) = (solver.step_serial(&scene::inputs(step)).unwrap(), spare.step_serial(&scene::inputs(step)).unwrap());
        assert_eq!((a.pump.beat, a.pump.pressure_pa), (b.pump.beat, b.pump.pressure_pa), "step {step}");
        assert!(a.pump.beat != Beat::default());
    }
    // The beat lies in the high half of the ninth word, where older engines wrote 0.
    let with = |beat_ml: f32| {
        let mut other = block.clone();
        other[8] = other[8] & 0xffff_ffff | u64::from(beat_ml.to_bits()) << 32;
        signed(&mut other, &spare);
        other
    };
    let old = with(0.0);
    spare.load(bytemuck::cast_slice(&old)).unwrap();
    let stored = scene::state(&spare);
    let view = StateView::new(bytemuck::cast_slice(&stored)).unwrap();
    assert_eq!((view.beat_ml(), pump.roller_phase(view.pump().in_ml)), (0.0, phase));
    for bad in [f32::NAN, f32::INFINITY, 50.1, -50.1] {
        let found = spare.load(bytemuck::cast_slice(&with(bad)));
        assert!(matches!(found, Err(FlowError::StateValue { field: "beat", .. })), "{bad}: {found:?}");
    }
}

#[test]
fn what_comes_in_and_does_not_go_out_is_in_the_cavity_whatever_moves_in_it() {
    let model = PumpModel { leak_ml_s_pa: 5e-5, ..PumpModel::default() };
    let mut run = Run::default();
    let mut known_ml = 0.0;
    for step in 0..4_000 {
        let time_s = f64::from(step) * 0.01;
        let input = PumpInput {
            outflow_valve: if step % 700 < 350 { 1.0 } else { 0.1 },
            inflow_valve: if step % 900 < 800 { 1.0 } else { 0.0 },
            open_veins: 0.5,
            perforation: 0.01,
            // A scope that goes in and out, and half a millilitre of tissue that is gone at last.
            displaced_ml: (0.4 - 0.4 * time_s.cos()) as f32 - if step > 2_000 { 0.5 } else { 0.0 },
            ..open(9_000.0, 300.0)
        };
        let report = run.step(&model, &input, 0.01);
        let inward = report.in_ml_s + report.beat.in_ml_s;
        let outward = report.out_ml_s + report.beat.out_ml_s;
        known_ml += 0.01 * (inward - outward - report.intravasation_ml_s - report.leak_ml_s - report.perforation_ml_s);
        let held_ml = run.state.cavity_ml + f64::from(run.beat_ml);
        assert!((known_ml - held_ml).abs() < 1e-9, "step {step}: {held_ml} ml are in the cavity of {known_ml}");
    }
    assert!(run.state.imbalance_ml().abs() < 1e-9 && run.state.in_ml > 20.0, "{:?}", run.state);
}

/// With the outflow shut the pump has nothing to deliver once the pressure is the set one, and so nothing by which it could take out what its last stroke
/// brought: the ports, through which nothing flows backwards, would have let out less than went missing.
#[test]
fn what_the_last_stroke_brought_into_a_shut_cavity_stays_there_until_it_can_leave() {
    let model = PumpModel::default();
    let mut most_left_ml = 0.0f32;
    for shut_at in [300, 330, 360, 390, 420] {
        let (mut run, mut ports_ml) = (Run::default(), 0.0);
        for step in 0..900 {
            let is_shut = (shut_at..700).contains(&step);
            let input = PumpInput { outflow_valve: if is_shut { 0.0 } else { 1.0 }, ..open(8_000.0, 600.0) };
            let report = run.step(&model, &input, 0.01);
            let flows = [report.in_ml_s + report.beat.in_ml_s, report.out_ml_s + report.beat.out_ml_s];
            assert!(flows.iter().all(|flow_ml_s| *flow_ml_s > -1e-5), "shut at {shut_at}, step {step}: {flows:?} ml/s");
            ports_ml += 0.01 * (flows[0].max(0.0) - flows[1].max(0.0));
            let held_ml = run.state.cavity_ml + f64::from(run.beat_ml);
            assert!((ports_ml - held_ml).abs() < 1e-6, "shut at {shut_at}, step {step}: {held_ml} ml of {ports_ml}");
            most_left_ml = if step == 699 { most_left_ml.max(run.beat_ml) } else { most_left_ml };
        }
    }
    // By hand (above) the beat is ± 0.065 ml while medium flows.
    assert!(most_left_ml > 0.03, "{most_left_ml} ml");
}

#[test]
fn an_instrument_takes_of_the_room_in_the_cavity_and_tissue_that_is_gone_leaves_some() {
    let model = PumpModel::default();
    // By hand, with 2 ml in it and all shut. 0.3·(1 − e^(−2/0.5)) = 0.2945 ml more: 5 332.9·(1 − e^(−2.2945/0.5)) + 1 833.2·2.2945 = 9 484.9 Pa.
    // 0.5·(1 − e^(−4)) = 0.4908 ml less: 5 332.9·(1 − e^(−1.5092/0.5)) + 1 833.2·1.5092 = 7 838.8 Pa.
    for (displaced_ml, expected_pa) in [(0.0, 8_901.6), (0.3, 9_484.9), (-0.5, 7_838.8)] {
        let mut state = PumpState { cavity_ml: 2.0, ..Default::default() };
        let input = PumpInput { displaced_ml, ..Default::default() };
        let found_pa = model.step(&mut state, &input, true, 0.0, 0.01).pressure_pa;
        assert!((found_pa - expected_pa).abs() < 2.0, "{displaced_ml} ml: {found_pa} Pa");
        assert_eq!(state.cavity_ml, 2.0);
    }
    for displaced_ml in [-3.0, -0.2, 0.2, 3.0] {
        assert_eq!(model.distended_pa(0.0, displaced_ml), 0.0, "without medium nothing presses");
        let at = |n: u32| model.distended_pa(f64::from(n) * 0.01, displaced_ml);
        assert!((1..800).all(|n| at(n) >= at(n - 1)) && at(799) > 40.0 * PA_PER_MMHG, "{displaced_ml} ml");
    }
    // With the pump on the pressure stays as it is regulated, and as much goes out as comes in beside it.
    let input = open(8_000.0, 600.0);
    let Run { state: before, .. } = Run::at_rest(&model, &input, 0.01);
    let mut state = before;
    let mut report = PumpReport::default();
    for step in 1..=3_000u16 {
        let input = PumpInput { displaced_ml: 0.3 * f32::from(step.min(100)) / 100.0, ..input };
        report = model.step(&mut state, &input, true, 0.0, 0.01);
    }
    assert!((report.pressure_pa - 7_619.05).abs() < 0.1, "{report:?}");
    let between = 1.0 - (-state.cavity_ml / 0.5).exp();
    assert!((state.cavity_ml + 0.3 * between - before.cavity_ml).abs() < 1e-5, "{} of {} ml", state.cavity_ml, before.cavity_ml);
    // V + 0.3·(1 − e^(−V/0.5)) = 1.4178: V = 1.1480, 0.2698 less.
    let went_ml = before.deficit_ml() - state.deficit_ml();
    assert!((went_ml - (before.cavity_ml - state.cavity_ml)).abs() < 1e-9, "{went_ml} ml");
    assert!((went_ml - 0.269_80).abs() < 1e-4, "{went_ml} ml");
}
