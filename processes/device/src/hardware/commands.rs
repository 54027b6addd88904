//! What the firmware takes from the device: commands that are finite, within what the motors can make, newer than the last one, not long past, and not
//! the same again and again while the tip moves against them, nor other ones than the servos are told of. Any other is as good as none: the last force is
//! kept, and the watchdog ramps it to zero.

use hyst_coupling::{ForceLimits, HardwareParams, WatchInput, WatchParams, WatchState, WatchVerdict, valid_force, watch_step};
use hyst_engine::Life;
use hyst_exchange::ReadPage;
use hyst_messages::page::device;
use hyst_messages::page::device::Distrust;
use hyst_messages::{Applied, ForceCommand};

/// Most ticks by which a command may be ahead of the clock: one that were taken would shut out all that come before its time.
const MOST_AHEAD_TICKS: u64 = 2;
/// Commands in a row after which a device that tells the servos of others is not followed: one that goes on from what the motors make tells of another once.
const UNLIKE_LIMIT: u32 = 3;

/// The newest command that was taken, and what was seen of its device.
#[derive(Default)]
pub struct Commands {
    /// The newest that was taken.
    pub newest: ForceCommand,
    seen: (u32, u64),
    /// The newest was taken for a tick that had passed: the device's cell may have it still.
    from_past: bool,
    watch: WatchState,
    /// The newest that was looked at, taken or not, and how many in a row the servos were told something else of.
    heard: ForceCommand,
    unlike: u32,
}

impl Commands {
    /// The command that has come since the last tick, if one has and may be followed; `tip_m` is where the tip is.
    pub fn new_one(&mut self, life: &Life, page: &ReadPage, tip_m: [f32; 3], max_force_n: f32) -> Option<ForceCommand> {
        let incarnation = page.incarnation();
        if (incarnation, page.cell_number(device::COMMAND)) == self.seen {
            return None;
        }
        // The number that belongs to this value: a newer one may have come since, and would look like the same again.
        let (number, command) = page.cell(device::COMMAND)?;
        if incarnation != self.seen.0 {
            (self.watch, self.unlike) = (WatchState::default(), 0);
        }
        self.seen = (incarnation, number);
        if self.has_had(&command) {
            return None;
        }
        let told_n = page.ring(device::INPUTS, command.tick).map(|input| input.applied_n);
        let present_tick = life.clock.present_tick();
        let verdict = self
            .judge(&command, present_tick, tip_m, max_force_n)
            .and_then(|()| if self.is_double_tongued(&command, told_n) { Err(Distrust::Frozen) } else { Ok(()) });
        if let Err(why) = verdict {
            life.refuse(incarnation, why);
            return None;
        }
        if is_over(&command, present_tick) {
            return None; // nobody is to blame
        }
        (self.newest, self.from_past) = (command, false);
        Some(command)
    }

    /// The command that had come by a station tick that has passed, if one had: the device goes on while the simulated hardware is not let run, and
    /// hardware outside of this machine would have had its commands.
    pub fn past_one(&mut self, page: &ReadPage, station_tick: u64, time_ns: u64, max_force_n: f32) -> Option<ForceCommand> {
        let record = page.ring(device::APPLIED, station_tick.checked_sub(1)?)?;
        let command = Some(record.command).filter(|_| record.sent_ns <= time_ns)?;
        self.is_next(&command, station_tick, max_force_n).then_some(command)
    }

    /// Takes a command that had come by a tick that has passed, if it may be followed.
    fn is_next(&mut self, command: &ForceCommand, station_tick: u64, max_force_n: f32) -> bool {
        let is_next = is_sound(command, station_tick.saturating_sub(1), max_force_n) && command.tick > self.newest.tick;
        if is_next {
            self.watch = WatchState::default(); // the tip stood still for the device, which had no newer sample
            (self.newest, self.from_past) = (*command, true);
        }
        is_next
    }

    /// Whether this is the very command that was taken for a tick that had passed: it is not new, and no reproach to the device.
    fn has_had(&self, command: &ForceCommand) -> bool {
        self.from_past && *command == self.newest
    }

    /// Whether the device has told the servos of other forces than it sent to the motors: `told_n` is what it told them, in the tick of this command, of the
    /// one before. In free motion a force of nothing is the true one, and only this tells it from one that stands still.
    fn is_double_tongued(&mut self, command: &ForceCommand, told_n: Option<[f32; 3]>) -> bool {
        let heard = std::mem::replace(&mut self.heard, *command);
        let is_next = command.tick == heard.tick + 1 && command.device_incarnation == heard.device_incarnation;
        if let Some(told_n) = told_n.filter(|_| is_next) {
            let is_alike = told_n.map(f32::to_bits) == heard.force_n.map(f32::to_bits);
            self.unlike = if is_alike { 0 } else { self.unlike.saturating_add(1) };
        }
        self.unlike >= UNLIKE_LIMIT
    }

    fn judge(&mut self, command: &ForceCommand, present_tick: u64, tip_m: [f32; 3], max_force_n: f32) -> Result<(), Distrust> {
        if !is_sound(command, present_tick + MOST_AHEAD_TICKS, max_force_n) {
            return Err(Distrust::Invalid);
        }
        if command.tick <= self.newest.tick {
            return Err(Distrust::Still);
        }
        // A force that is held or ramped was not computed for where the tip is.
        if command.kind != Applied::Fresh as u32 {
            self.watch = WatchState::default();
            return Ok(());
        }
        let seen =
            WatchInput { record_tick: command.tick, force_n: command.force_n, position_m: tip_m, digest: 0, expected_digest: 0 };
        let params = WatchParams { max_force_n, ..WatchParams::default() };
        let (watch, verdict) = watch_step(&params, &self.watch, &seen);
        self.watch = watch;
        if verdict == WatchVerdict::OutputFrozen { Err(Distrust::Frozen) } else { Ok(()) }
    }
}

/// Whether the motors can follow a command, of a tick up to the last that can be, whose force was computed for no later one.
fn is_sound(command: &ForceCommand, last_tick: u64, max_force_n: f32) -> bool {
    let limits = ForceLimits { max_force_n, max_age_ticks: 0 };
    command.tick <= last_tick
        && command.force_tick <= command.tick
        && valid_force(command.tick, command.tick, command.force_n, &limits).is_ok()
}

/// Whether a command is so old that whoever followed it then would be letting go of it: it is as good as none. The page of a device that has died or hangs
/// has its last one all the while, and motors that were just switched on would jump to it.
fn is_over(command: &ForceCommand, present_tick: u64) -> bool {
    present_tick > command.tick.saturating_add(u64::from(HardwareParams::default().watchdog_ticks))
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMIT_N: f32 = 3.3;

    fn command(tick: u64, newton: f32) -> ForceCommand {
        ForceCommand { tick, force_tick: tick, force_n: [0.0, newton, 0.0], ..ForceCommand::default() }
    }

    fn judged(commands: &mut Commands, command: ForceCommand, y_m: f32) -> Result<(), Distrust> {
        let verdict = commands.judge(&command, 10, [0.0, y_m, 0.0], LIMIT_N);
        if verdict.is_ok() {
            commands.newest = command;
        }
        verdict
    }

    #[test]
    fn what_no_motor_can_follow_and_what_is_old_is_not_followed() {
        let mut commands = Commands::default();
        assert_eq!(judged(&mut commands, command(5, 1.0), 0.0), Ok(()));
        assert_eq!(judged(&mut commands, command(6, f32::NAN), 0.0), Err(Distrust::Invalid));
        assert_eq!(judged(&mut commands, command(6, f32::INFINITY), 0.0), Err(Distrust::Invalid));
        assert_eq!(judged(&mut commands, command(6, 50.0), 0.0), Err(Distrust::Invalid));
        assert_eq!(judged(&mut commands, command(5, 1.1), 0.0), Err(Distrust::Still));
        assert_eq!(judged(&mut commands, command(4, 0.9), 0.0), Err(Distrust::Still));
        assert_eq!(judged(&mut commands, command(10 + MOST_AHEAD_TICKS + 1, 1.1), 0.0), Err(Distrust::Invalid));
        assert_eq!(judged(&mut commands, command(u64::MAX, 1.1), 0.0), Err(Distrust::Invalid));
        let of_later = ForceCommand { force_tick: 7, ..command(6, 1.1) };
        assert_eq!(judged(&mut commands, of_later, 0.0), Err(Distrust::Invalid));
        assert_eq!(judged(&mut commands, command(6, 1.1), 0.0), Ok(()), "nobody was shut out");
    }

    /// Hardware that began anew while its device was dead followed the last word of that, however old it was.
    #[test]
    fn a_command_is_over_when_the_watchdog_would_have_tripped_since() {
        let watchdog_ticks = u64::from(HardwareParams::default().watchdog_ticks);
        let is_over = |present_tick: u64| is_over(&command(5, 1.0), present_tick);
        assert!(!is_over(4) && !is_over(5) && !is_over(5 + watchdog_ticks));
        assert!(is_over(5 + watchdog_ticks + 1) && is_over(u64::MAX));
        assert!(!super::is_over(&command(u64::MAX, 1.0), 10));
    }

    #[test]
    fn of_ticks_that_have_passed_what_had_come_by_then_is_followed_and_nothing_else() {
        let mut commands = Commands::default();
        assert_eq!(judged(&mut commands, command(5, 1.0), 0.0), Ok(()));
        let mut past = |command: ForceCommand, tick: u64| commands.is_next(&command, tick, LIMIT_N);
        assert!(past(command(6, 1.0), 7) && !past(command(6, 1.0), 8), "each is followed once");
        assert!(!past(command(5, 1.0), 6) && !past(command(9, 1.0), 9), "an old one, and one that had not come");
        assert!(!past(command(7, f32::NAN), 8) && !past(command(7, 50.0), 8));
        assert!(!past(ForceCommand { force_tick: 9, ..command(7, 1.0) }, 8));
        assert!(commands.has_had(&command(6, 1.0)) && !commands.has_had(&command(7, 1.0)), "its cell has it still");
        assert_eq!(judged(&mut commands, command(7, 1.0), 0.0), Ok(()));
        commands.from_past = false; // as whoever takes it does
        assert!(!commands.has_had(&command(7, 1.0)), "the same under another number is a stamp that stands still");
        let mut past = |command: ForceCommand, tick: u64| commands.is_next(&command, tick, LIMIT_N);
        assert!(
            (8..40).all(|tick| past(command(tick, 1.0), tick + 1)),
            "the same all the while: the tip stood still for the device"
        );
    }

    #[test]
    fn a_device_that_tells_the_servos_of_other_forces_than_it_sends_is_not_followed_for_long() {
        // Its force grows; what the motors are told stays nothing. `told` is what the servos are told of the command before.
        let verdicts = |sent: fn(u64) -> f32, told: fn(u64) -> f32| -> Vec<bool> {
            let mut commands = Commands::default();
            let one = |tick: u64| commands.is_double_tongued(&command(tick, sent(tick)), Some([0.0, told(tick), 0.0]));
            (1..=9).map(one).collect()
        };
        let force = |tick: u64| tick.saturating_sub(3) as f32 * 0.1; // contact from the fourth tick on
        let before = |tick: u64| tick.saturating_sub(4) as f32 * 0.1;
        assert_eq!(verdicts(force, before), [false; 9]);
        let found = verdicts(|_| 0.0, before);
        assert_eq!(found.iter().position(|is_so| *is_so), Some(6), "in the third tick that tells of a force: {found:?}");
        assert!(found[6..].iter().all(|is_so| *is_so), "for as long as it does");
        let once = verdicts(force, |tick| if tick == 6 { 0.7 } else { tick.saturating_sub(4) as f32 * 0.1 });
        assert_eq!(once, [false; 9], "one that goes on from what the motors make");
    }

    #[test]
    fn the_same_force_while_the_tip_moves_against_it_is_not_followed_for_long() {
        let mut commands = Commands::default();
        let mut moved = |tick: u64| judged(&mut commands, command(tick, 1.0), tick as f32 * 1e-4);
        let verdicts: Vec<_> = (1..=6).map(&mut moved).collect();
        assert_eq!(verdicts.iter().filter(|verdict| verdict.is_ok()).count(), 3, "{verdicts:?}");
        let mut still = Commands::default();
        assert!((1..=9).all(|tick| judged(&mut still, command(tick, 1.0), 0.0).is_ok()), "rest is no suspicion");
        let held = ForceCommand { kind: Applied::Held as u32, ..command(10, 1.0) };
        assert!(judged(&mut commands, held, 1.0).is_ok(), "a force that is held is the same on purpose");
    }
}
