//! Promise of the Flow Engine: a state is written in full, so that what an older message left in the loan is nowhere in it.

#[path = "../../../../shared/engine/tests/support/loans.rs"]
mod loans;

use super::*;
use hyst_exchange::Station;
use hyst_exchange::roster::Tenure;
use hyst_messages::Slot;
use loans::written;

const STEPS: u64 = 3;

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
