//! Promise of the Flow Engine: a state is written in full, so that what an older message left in the loan is nowhere in it.

#[path = "../../../../shared/engine/tests/support/loans.rs"]
mod loans;

use super::*;
use hyst_exchange::Station;
use hyst_exchange::roster::Tenure;
use hyst_flow::{Alarms, PumpState, StepReport};
use hyst_messages::{PUMP_ALARMS, Slot};
use loans::written;

const STEPS: u64 = 3;

#[test]
fn each_alarm_of_the_pump_has_the_bit_of_its_name() {
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
        let bits = status_of(&report, &PumpState::default()).alarms;
        assert_eq!(PUMP_ALARMS.iter().find(|(_, known)| *known == name), Some(&(bits, name)));
    }
    let pump = PumpState { in_ml: 7.0, out_ml: 4.0, cavity_ml: 5.0, bled_ml: 2.0, ..PumpState::default() };
    let status = status_of(&StepReport::default(), &pump);
    assert_eq!((status.alarms, status.deficit_ml, status.cavity_volume_ml, status.bled_ml), (0, 3.0, 5.0, 2.0));
}

#[test]
fn states_have_the_same_bytes_whatever_lay_in_the_loan() {
    let station = Station::named(&format!("t{}-fluid-loans", std::process::id())).unwrap();
    station.wipe();
    station.found().unwrap();
    std::fs::write(station.settings(), "").unwrap();
    let slot = Slot::first(Role::Fluid);
    drop(station.create_slot(slot, 1).unwrap());
    let life = Life::begin(station.name(), slot, 1).unwrap();
    let mut engine = FlowEngine::new(&life).unwrap();
    let bytes = engine.message_bytes();
    let mut now = written(bytes, "the first state", |block| engine.initial(StreamHeader::default(), block).unwrap());
    for tick in 1..=STEPS {
        let context = StepContext {
            tick,
            next_tick: tick + 1,
            state_epoch: 1,
            state_writer: 1,
            step_ticks: 33,
            tenure: Tenure { epoch: 1, incarnation: 1 },
            holding: true,
            deadline_ns: 0,
        };
        let before = now.clone();
        let before: &[u8] = bytemuck::cast_slice(&before);
        now = written(bytes, &format!("state {tick}"), |block| engine.step(&context, &before[..bytes], block).unwrap());
    }
    drop(engine);
    station.wipe();
}
