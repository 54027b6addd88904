//! The judge of a device on probation: a helper process that compares what the motors made, by the hardware's ledger, with what the followed servo said for
//! that tick, by its page. Neither is the device's own word. A device ramps what returns after a pause, does not leave zero before the hand has been free
//! once, and changes the force by no more than its slew limit: what these may have done to a force counts for nothing. One that goes on from a force has
//! left zero with its first tick, and is compared under whatever load there is. Of one that waits for a free hand, as each does where the motors have made no
//! force yet, there is nothing to compare before the hand lets go.

use super::judge::{LINE_NS, Pages, Seen, tell};
use super::stated::{MOTORS_FORCE_N, MOTORS_FORCE_SHARE};
use bytemuck::Pod;
use hyst_exchange::{ReadPage, Station, system};
use hyst_messages::page::{RingAt, haptic, hardware};
use hyst_messages::{Applied, ForceRecord, LedgerEntry, Role};
use std::collections::BTreeMap;

/// Between two looks, ns: a servo's page has its last 8 ticks.
const LOOK_NS: u64 = 2_000_000;
/// Ticks of which a force is kept: the ledger says what the motors made some 64 ticks later.
const KEPT_TICKS: u64 = 512;
/// Fresh forces in a row after which one is no longer on its way back: the last hop takes 50 ticks for that.
const SETTLED_TICKS: u32 = 64;
/// What the last hop lets through before the first contact, N, and changes a force by in a tick, N.
const GATE_N: f64 = 0.2;
const SLEW_N: f64 = 0.5;

/// What the servos said, and what was seen of the motors.
#[derive(Debug, Default)]
struct Felt {
    /// Forces, N, by tick and incarnation.
    said_n: BTreeMap<(u64, u32), [f32; 3]>,
    /// What the motors made last, N.
    before_n: [f32; 3],
    /// The hand has been free since the newcomer's first tick, or has felt something of it.
    is_open: bool,
    /// Fresh forces in a row since then.
    fresh: u32,
    seen: Seen,
}

fn length_n(a: [f32; 3], b: [f32; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (f64::from(*a) - f64::from(b)).powi(2)).sum::<f64>().sqrt()
}

impl Felt {
    /// What a servo said.
    fn hear(&mut self, incarnation: u32, said: &ForceRecord) {
        self.said_n.insert((said.tick, incarnation), said.force_n);
        while self.said_n.first_key_value().is_some_and(|((tick, _), _)| tick.saturating_add(KEPT_TICKS) < said.tick) {
            self.said_n.pop_first();
        }
    }

    /// What the motors made.
    fn take(&mut self, entry: &LedgerEntry) {
        let before_n = std::mem::replace(&mut self.before_n, entry.force_n);
        if entry.kind != Applied::Fresh as u32 {
            self.fresh = 0;
            return;
        }
        self.fresh += 1;
        let Some(said_n) = self.said_n.get(&(entry.force_tick, entry.source_incarnation)).copied() else { return };
        let strength_n = length_n(said_n, [0.0; 3]);
        if !self.is_open {
            self.is_open = strength_n <= GATE_N || length_n(entry.force_n, [0.0; 3]) > 0.0;
            self.seen.waits = !self.is_open;
            self.fresh = 0;
        }
        if self.fresh < SETTLED_TICKS || entry.void != 0 {
            return;
        }
        let by_n = length_n(entry.force_n, said_n);
        let left_n = (length_n(said_n, before_n) - SLEW_N).max(0.0);
        let most_n = MOTORS_FORCE_N + MOTORS_FORCE_SHARE * strength_n + left_n;
        let ratio = if by_n.is_finite() { by_n / most_n } else { f64::INFINITY };
        self.seen.note((ratio, format!("the motors' force differs by {by_n:.2} N from the servo's {strength_n:.2} N")));
    }
}

/// The helper itself: writes a line of JSON again and again until nobody reads it or the station stops.
pub fn feel(station: &Station) -> Result<(), String> {
    // What it does not look at within 8 ticks is lost to it. Refused: it compares fewer.
    system::be_nice(-19);
    let clock = station.open().map_err(|error| error.to_string())?;
    let (mut servos, mut motors, mut felt) = (Pages::default(), Pages::default(), Felt::default());
    // What the motors made before was told them by the old device.
    let first_tick = clock.present_tick();
    let mut next_line_ns = 0;
    while !clock.stop_requested() {
        let now_ns = system::now_ns();
        if now_ns >= next_line_ns {
            next_line_ns = now_ns + LINE_NS;
            if !tell(&felt.seen)? {
                return Ok(());
            }
            servos.follow(station, &clock, Role::Haptic);
            motors.follow(station, &clock, Role::Hardware);
        }
        for (incarnation, (page, read)) in &mut servos.0 {
            news(page, haptic::FORCES, read).for_each(|said| felt.hear(*incarnation, &said));
        }
        for (page, read) in motors.0.values_mut() {
            news(page, hardware::LEDGER, read).filter(|made| made.station_tick > first_tick).for_each(|made| felt.take(&made));
        }
        system::sleep_ns(LOOK_NS);
    }
    Ok(())
}

/// The entries of a ring that are new since it was read up to a key, which becomes that after the newest.
fn news<T: Pod>(page: &ReadPage, ring: RingAt<T>, read: &mut u64) -> impl Iterator<Item = T> {
    let end = page.ring_end(ring);
    let from = end.saturating_sub(ring.entries as u64).max(std::mem::replace(read, end));
    (from..end).filter_map(move |key| page.ring(ring, key))
}

#[cfg(test)]
mod tests {
    use super::*;

    const SERVO: u32 = 5;

    /// What is seen of a device if the servo says one force and the motors make another, along y, N, in each of so many ticks from this one on.
    fn tell(felt: &mut Felt, from: u64, ticks: u64, said_n: f32, made_n: f32, kind: Applied) {
        for tick in from..from + ticks {
            felt.hear(SERVO, &ForceRecord { tick, force_n: [0.0, said_n, 0.0], ..ForceRecord::default() });
            let made = LedgerEntry {
                station_tick: tick,
                force_tick: tick,
                force_n: [0.0, made_n, 0.0],
                kind: kind as u32,
                source_incarnation: SERVO,
                ..LedgerEntry::default()
            };
            felt.take(&made);
        }
    }

    #[test]
    fn motors_that_make_what_the_servo_says_agree_and_half_of_it_is_out_of_tolerance() {
        let mut felt = Felt::default();
        tell(&mut felt, 1, 100, 0.0, 0.0, Applied::Fresh);
        assert_eq!((felt.seen.compared, felt.seen.worst), (36, 0.0), "it is open with the first, and has settled after 64 more");
        tell(&mut felt, 101, 20, 1.0, 1.0, Applied::Fresh);
        assert_eq!((felt.seen.compared, felt.seen.worst), (56, 0.0));
        tell(&mut felt, 121, 2, 1.0, 0.5, Applied::Fresh);
        // 0.5 N, where 0.05 N and 15 % of 1 N are allowed.
        assert!(felt.seen.outside == 2 && (felt.seen.ratio - 2.5).abs() < 1e-6, "{:?}", felt.seen);
        assert_eq!(felt.seen.text, "the motors' force differs by 0.50 N from the servo's 1.00 N");
        tell(&mut felt, 123, 1, 1.0, f32::NAN, Applied::Fresh);
        assert_eq!(felt.seen.outside, 3);
        let mut gone = Felt::default();
        tell(&mut gone, 1, 100, 0.0, 0.0, Applied::Fresh);
        tell(&mut gone, 101, 1, 1.0, 0.5, Applied::Fresh);
        assert_eq!(gone.seen.outside, 0, "it is at its slew limit: {:?}", gone.seen);
        tell(&mut gone, 102, 3, 1.4, 0.0, Applied::Fresh);
        assert_eq!(gone.seen.outside, 3, "it follows no further");
    }

    #[test]
    fn one_that_goes_on_from_a_force_is_compared_under_a_hand_that_never_lets_go() {
        let mut felt = Felt::default();
        tell(&mut felt, 1, 50, 1.0, 0.5, Applied::Fresh);
        assert_eq!((felt.seen.compared, felt.seen.waits), (0, false), "it rises");
        tell(&mut felt, 51, 50, 1.0, 1.0, Applied::Fresh);
        assert_eq!((felt.seen.compared, felt.seen.outside), (36, 0));
        tell(&mut felt, 101, 3, 1.0, 0.3, Applied::Fresh);
        assert_eq!(felt.seen.outside, 3, "{:?}", felt.seen);
    }

    #[test]
    fn what_comes_back_after_a_pause_is_not_compared_nor_what_waits_for_a_free_hand_nor_what_nobody_said() {
        let mut felt = Felt::default();
        tell(&mut felt, 1, 500, 1.0, 0.0, Applied::Fresh);
        assert_eq!((felt.seen.compared, felt.seen.waits), (0, true), "it was never free");
        tell(&mut felt, 501, 65, 0.1, 0.1, Applied::Fresh);
        assert_eq!((felt.seen.compared, felt.seen.waits), (1, false));
        tell(&mut felt, 566, 1, 1.0, 0.6, Applied::Ramped);
        tell(&mut felt, 567, 63, 1.0, 0.6, Applied::Fresh);
        assert_eq!(felt.seen.compared, 1, "it rises");
        let unknown = LedgerEntry { force_tick: 9_999, kind: Applied::Fresh as u32, force_n: [3.0; 3], ..LedgerEntry::default() };
        felt.take(&unknown);
        assert_eq!((felt.seen.compared, felt.said_n.len()), (1, 513), "of that tick nothing is known, and not all is kept");
    }
}
