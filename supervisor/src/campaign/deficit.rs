//! Whether the deficit that a recording tells of goes on from status to status: a fault that loses a millilitre of it is found by its jump.

use super::outcome::MOST_DEFICIT_ML_PER_TICK;
use hyst_messages::FluidStatus;

/// A jump that is less than a drop is none, ml.
const MOST_JUMP_ML: f64 = 0.05;
/// Most jumps that are kept of one run.
const MOST_JUMPS: usize = 256;
/// Two statuses that are so far apart may have seen flows between them which neither of them names, ticks.
const NEAR_TICKS: u64 = 200;
/// Rounding, and flows that change between two statuses, ml.
const ROUNDING_ML: f64 = 0.02;
/// How many times what the statuses name a valve that opens between them lets go, at most: its flow falls with the pressure, and three of those of a scripted
/// hand let go some three times as much.
const PEAK: f64 = 5.0;
/// Time in which a figure may be taken back, ticks: a flow that lies is found in its next steps, and its successor says what was before the lie.
const TAKEN_BACK_TICKS: u64 = 150;

/// Follows the statuses in the order of the file.
#[derive(Debug, Default)]
pub struct Deficit {
    /// The newest that goes on from all before it.
    good: Option<FluidStatus>,
    /// A jump from there that has not been taken back, and the newest status since.
    doubt: Option<(Jump, FluidStatus)>,
    jumps: Vec<Jump>,
}

/// Its tick, and how far the deficit went, ml.
type Jump = (u64, f64);

impl Deficit {
    /// The next status. The two processes of the role lie in the file side by side: what is older tells nothing new.
    pub fn follow(&mut self, status: FluidStatus) {
        let Some(good) = self.good else {
            self.good = Some(status).filter(|status| status.deficit_ml.is_finite());
            return;
        };
        let newest = self.doubt.map_or(good, |(_, newest)| newest);
        if status.state_tick <= newest.state_tick {
            return;
        }
        let jump_ml = unexplained_ml(&good, &status);
        match &mut self.doubt {
            None if jump_ml <= MOST_JUMP_ML => self.good = Some(status),
            None => self.doubt = Some(((status.state_tick, jump_ml), status)),
            // It went back to where it would be without the jump: what was said in between was a lie that was found.
            Some((_, newest)) if jump_ml <= MOST_JUMP_ML && unexplained_ml(newest, &status) > MOST_JUMP_ML => {
                (self.good, self.doubt) = (Some(status), None);
            }
            Some((jump, _)) if status.state_tick > jump.0.saturating_add(TAKEN_BACK_TICKS) => {
                self.jumps.push(*jump);
                (self.good, self.doubt) = (Some(status).filter(|status| status.deficit_ml.is_finite()), None);
            }
            Some((_, newest)) => *newest = status,
        }
    }

    /// The jumps that nothing explains and nobody took back, the first of them.
    pub fn jumps(self) -> Vec<Jump> {
        let last = self.doubt.map(|(jump, _)| jump);
        self.jumps.into_iter().chain(last).take(MOST_JUMPS).collect()
    }
}

/// How far the deficit went from one status to the next beyond what the flows of either can have moved that way in that time, ml; finite. Where it went with
/// what is in the cavity it is no jump either, as far as [`PEAK`] allows: a valve that opens between two statuses lets most of its flow go where neither of them
/// names it. A flow that began anew has lost both at once, and fills the cavity again.
fn unexplained_ml(before: &FluidStatus, after: &FluidStatus) -> f64 {
    let ticks = (after.state_tick - before.state_tick) as f64;
    let gone_ml = after.deficit_ml - before.deficit_ml;
    let way = if gone_ml < 0.0 { -1.0 } else { 1.0 };
    let net_ml = |status: &FluidStatus| way * f64::from(status.inflow_ml_min - status.outflow_ml_min) / 60_000.0 * ticks;
    let named_ml = net_ml(before).max(net_ml(after)).max(0.0);
    let most_ml = if ticks > NEAR_TICKS as f64 { MOST_DEFICIT_ML_PER_TICK * ticks } else { named_ml };
    let kept_ml = after.cavity_volume_ml - before.cavity_volume_ml - (after.bled_ml - before.bled_ml);
    let with_cavity_ml = ((gone_ml - kept_ml).abs() - most_ml).max(gone_ml.abs() - PEAK * most_ml);
    let jump_ml = (gone_ml.abs() - most_ml).min(with_cavity_ml) - ROUNDING_ML;
    // JSON has no infinity, in which a result could be read again.
    if jump_ml.is_nan() || gone_ml.is_nan() { f64::MAX } else { jump_ml.clamp(0.0, f64::MAX) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(state_tick: u64, deficit_ml: f64) -> FluidStatus {
        FluidStatus { state_tick, deficit_ml, inflow_ml_min: 120.0, outflow_ml_min: 60.0, ..FluidStatus::default() }
    }

    fn jumps(told: &[(u64, f64)]) -> Vec<u64> {
        let mut deficit = Deficit::default();
        told.iter().for_each(|(tick, ml)| deficit.follow(at(*tick, *ml)));
        deficit.jumps().into_iter().map(|(tick, _)| tick).collect()
    }

    #[test]
    fn a_deficit_moves_with_the_flows_or_is_named() {
        let before = at(1_000, 40.0);
        assert_eq!(unexplained_ml(&before, &at(1_033, 40.033)), 0.0);
        assert!((unexplained_ml(&before, &at(1_033, 41.0)) - 0.947).abs() < 1e-6, "a millilitre more");
        assert!((unexplained_ml(&before, &at(1_033, 39.0)) - 0.98).abs() < 1e-6, "a millilitre less, against the flow");
        assert!(unexplained_ml(&before, &at(1_033, 0.0)) > 39.0);
        assert_eq!(unexplained_ml(&before, &at(3_000, 80.0)), 0.0, "nobody saw what flowed in two seconds");
        assert!(unexplained_ml(&before, &at(3_000, -40.0)) > 0.0);
        for never in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            assert_eq!(unexplained_ml(&before, &at(1_033, never)), f64::MAX);
        }
    }

    /// Three of the valves that a scripted hand opened in a campaign let 0.07 ml go before the first status that names their flow.
    #[test]
    fn what_leaves_the_cavity_between_two_statuses_is_no_jump_and_what_it_did_not_hold_is() {
        let out =
            |state_tick, deficit_ml| FluidStatus { inflow_ml_min: 60.0, outflow_ml_min: 120.0, ..at(state_tick, deficit_ml) };
        let before = FluidStatus { cavity_volume_ml: 3.0, bled_ml: 0.5, ..out(1_000, 40.0) };
        let after = |cavity_volume_ml, deficit_ml| FluidStatus { cavity_volume_ml, bled_ml: 0.51, ..out(1_066, deficit_ml) };
        assert_eq!(unexplained_ml(&before, &after(2.81, 39.8)), 0.0, "0.2 ml less, and a drop of blood");
        assert!((unexplained_ml(&before, &after(3.01, 39.8)) - 0.114).abs() < 1e-6, "0.066 ml by the flows, 0.02 rounding");
        assert!((unexplained_ml(&before, &after(2.0, 39.8)) - 0.114).abs() < 1e-6, "that the cavity lost more excuses nothing");
    }

    /// Six fluids that began anew in a campaign were taken for a valve that had opened: each had 1.08 ml less of both, and an inflow of 800 ml/min.
    #[test]
    fn a_flow_that_began_anew_lost_what_it_had_delivered_also_where_the_cavity_holds_all_of_that() {
        let before = FluidStatus { cavity_volume_ml: 1.5, inflow_ml_min: 83.1, outflow_ml_min: 83.2, ..at(8_000, 1.5) };
        let anew = FluidStatus { cavity_volume_ml: 0.42, inflow_ml_min: 800.0, outflow_ml_min: 36.5, ..at(8_170, 0.42) };
        assert!((unexplained_ml(&before, &anew) - 1.06).abs() < 0.005, "{}", unexplained_ml(&before, &anew));
    }

    #[test]
    fn what_is_lost_is_found_and_what_was_a_lie_is_not() {
        let steady: Vec<(u64, f64)> = (0..30).map(|step| (1_000 + step * 33, 40.0 + step as f64 * 0.033)).collect();
        assert!(jumps(&steady).is_empty());
        let mut less = steady.clone();
        less[10..].iter_mut().for_each(|(_, ml)| *ml -= 0.3);
        assert_eq!(jumps(&less), [1_330], "0.3 ml less from then on");
        assert_eq!(jumps(&less[..12]), [1_330], "also if it is among the last");
        for lie in [f64::NAN, 1e30, -7.0] {
            let mut lied = steady.clone();
            lied[10].1 = lie;
            lied[11].1 = lie;
            assert!(jumps(&lied).is_empty(), "{lie}, and taken back");
            lied[10..16].iter_mut().for_each(|(_, ml)| *ml = lie);
            assert_eq!(jumps(&lied).len(), 1 + usize::from(!lie.is_nan()), "{lie} for 200 ms: there, and back again");
        }
        let mut older = steady.clone();
        older.insert(12, (1_010, 3.0));
        assert!(jumps(&older).is_empty(), "of another process, from before");
    }
}
