//! What the pump says, as who stands before it sees it: the newest status of a fluid. Only a scripted hand that waits for something looks.

use hyst_exchange::ReadPage;
use hyst_messages::FluidStatus;
use hyst_messages::page::fluid;

/// Fluids whose pages are read: holder, spare and a newcomer on trial.
const FLUIDS: usize = 3;
/// A status that is farther from the tick than this is of another time, ticks; the longest step of a fluid takes a quarter of it.
const HOLD_TICKS: u64 = 1_000;

/// The pages of the fluids.
#[derive(Default)]
pub struct Pump {
    pages: [Option<ReadPage>; FLUIDS],
}

impl Pump {
    /// Takes the page of a new incarnation of the fluid; gives back the one before.
    pub fn seat(&mut self, index: usize, page: ReadPage) -> Option<ReadPage> {
        match self.pages.get_mut(index) {
            Some(place) => place.replace(page),
            None => Some(page),
        }
    }

    /// What it says at a tick; `None` if nobody has said anything of that time.
    pub fn says(&self, tick: u64) -> Option<FluidStatus> {
        newest(self.pages.iter().flatten().filter_map(|page| page.cell(fluid::STATUS)).map(|(_, status)| status), tick)
    }
}

/// The status of the latest life of the role that is of this time. A newcomer on trial has no life yet: its epoch is the lowest.
fn newest(statuses: impl Iterator<Item = FluidStatus>, tick: u64) -> Option<FluidStatus> {
    let of_this_time = statuses.filter(|status| status.state_tick > 0 && status.state_tick.abs_diff(tick) <= HOLD_TICKS);
    of_this_time.max_by_key(|status| (status.epoch, status.state_tick))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_latest_life_speaks_and_no_status_of_another_time_counts() {
        let status = |epoch: u32, state_tick: u64| FluidStatus { epoch, state_tick, ..FluidStatus::default() };
        let all = [status(1, 5_030), status(2, 5_000), status(0, 5_040), status(9, 0)];
        let said = |tick: u64| newest(all.into_iter(), tick).map(|status| (status.epoch, status.state_tick));
        assert_eq!(said(5_050), Some((2, 5_000)));
        assert_eq!(said(6_025), Some((1, 5_030)), "a life that has gone silent is no longer heard");
        assert_eq!((said(6_041), said(3_000), said(0)), (None, None, None));
    }
}
