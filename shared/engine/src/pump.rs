//! What is shown of the pump: the figures of the newest of the fluids that can be.

use hyst_exchange::{Horizon, ReadPage, StationPage};
use hyst_messages::page::fluid;
use hyst_messages::{FluidStatus, MAX_FLUID_STEP_TICKS};

/// What the newest of the fluids says of the pump, by their pages and the horizon of their role; one of which a figure cannot be, or that is ahead of its time,
/// says nothing.
pub fn said_of_pump(fluids: &[Option<ReadPage>], horizon: &Horizon, clock: &StationPage) -> Option<FluidStatus> {
    let said = fluids.iter().flatten().filter_map(|page| page.cell(fluid::STATUS)).map(|(_, status)| status);
    FluidStatus::newest_of(said, |key| horizon.is_passed_by(key, MAX_FLUID_STEP_TICKS, clock))
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_exchange::{Roster, Station};
    use hyst_messages::page::station as layout;
    use hyst_messages::{PUMP_ALARMS, Role, Slot};

    /// The window showed a pressure of `NaN` mmHg, one of 39 digits, and like the page, in place of the good figures and alarms, those of a fluid that was a
    /// hundred seconds ahead.
    #[test]
    fn a_pump_that_is_no_number_out_of_range_or_ahead_of_its_time_is_not_shown_and_hides_no_good_one() {
        let station = Station::named(&format!("t{}-pump", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        station.open_for_keeping().unwrap().store64(layout::NEXT_INCARNATION, 9);
        let lives = [(Slot::new(Role::Fluid, 0).unwrap(), 3), (Slot::new(Role::Fluid, 1).unwrap(), 4)];
        let pages = lives.map(|(slot, life)| station.create_slot(slot, life).unwrap());
        let fluids = lives.map(|(slot, life)| station.read_slot(slot, life).ok());
        let roster = Roster::open(&station).unwrap();
        let epoch = roster.promote(Role::Fluid, roster.holder(Role::Fluid), 3).unwrap().epoch;
        let (horizon, clock) = (Horizon::open(&station, Role::Fluid).unwrap(), station.open().unwrap());
        let said =
            |fluids: &[Option<ReadPage>]| said_of_pump(fluids, &horizon, &clock).map(|status| (status.state_tick, status.alarms));
        let good = FluidStatus { epoch, state_tick: 33, pressure_pa: 9_000.0, deficit_ml: 3.0, ..FluidStatus::default() };
        let next = FluidStatus { state_tick: 66, alarms: PUMP_ALARMS[3].0, ..good };
        pages[0].write(fluid::STATUS, &good);
        assert_eq!(said(&fluids), Some((33, 0)), "the other one has said nothing yet");
        for lie in [
            FluidStatus { pressure_pa: f32::NAN, ..next },
            FluidStatus { deficit_ml: f64::NAN, ..next },
            FluidStatus { pressure_pa: 1e9, ..next },
            FluidStatus { deficit_ml: 1e9, ..next },
            FluidStatus { epoch: epoch + 1_000, state_tick: 100_066, ..next },
            FluidStatus { state_tick: 100_066, ..next },
        ] {
            pages[1].write(fluid::STATUS, &lie);
            assert_eq!((said(&fluids), said(&fluids[1..])), (Some((33, 0)), None), "{lie:?}");
        }
        pages[1].write(fluid::STATUS, &next);
        assert_eq!(said(&fluids), Some((66, PUMP_ALARMS[3].0)));
        station.wipe();
    }
}
