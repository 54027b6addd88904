//! Whether an engine hangs, as a pure function of what the watching thread sees: its heartbeats, the time that counts, and what the kernel says
//! of its thread. It reads no clock and no file.
//!
//! Two things are kept apart. *Suspicion* is raised after three missed periods and said in the report; the spare has the role by then, so that
//! nothing depends on it. *Guilt* ends a process, and only time that the process itself is to blame for adds to it: a thread that is stopped,
//! that sleeps past its deadline, or that runs without a step. One that is ready to run but is not let, or waits for the disk or for memory, is
//! the machine's affair. Time counts only while the watching thread itself is punctual and another engine makes progress: if everybody stands
//! still, it is the host. Hosts stall by up to 34 ms; a bound on the clock alone would kill healthy engines then.

use hyst_engine::realtime;
use hyst_messages::Role;

/// Missed periods that make a suspect.
pub const MISSES: u64 = 3;
/// Missed periods after which the kernel is asked. A thread that it calls stopped is a suspect at once.
const MISSES_TO_ASK: u64 = 2;
/// Guilt that ends a real-time process. Healthy ones reached 14 ms at most in 3 minutes beside 4 spinning processes and compilers (`suspected` in the
/// report of `hystation run --headless`; load average 18 on a 2-core EPYC VM, 2026-11-21).
pub const GUILT_REAL_TIME_NS: u64 = 100_000_000;
/// The same for the device, whose work nobody does meanwhile: with its start it is back within 20 ms.
pub const GUILT_DEVICE_NS: u64 = 6_000_000;
/// The same for a device that is stopped: the force is gone for as long as it waits, so nobody looks at it with a debugger in earnest.
pub const GUILT_DEVICE_STOPPED_NS: u64 = 2_000_000;
/// Guilt that ends an ordinary process: they wait for disks and helpers of their own.
pub const GUILT_NS: u64 = 2_000_000_000;
/// The same for recorder and console: their steps take some milliseconds, and who waits for a disk or a binary are other threads of theirs. A recorder that spins
/// beside busy engines gets half a core: after 2 s of that, in 4.1 s, what it had not written was no longer in the device's ring.
pub const GUILT_LIGHT_NS: u64 = 700_000_000;
/// The same for one that waits for a driver: its first pictures compile shaders, for seconds if the driver is software.
pub const GUILT_DRIVER_NS: u64 = 10_000_000_000;
/// The same after its first pictures, when the shaders are there; what is drawn for the first time later needs one or two.
pub const GUILT_PICTURES_NS: u64 = 4_000_000_000;
/// For how long pictures are its first: so much time with pictures in it, of which one that comes late counts no more than the usual ones do.
const FIRST_PICTURES_NS: u64 = 10_000_000_000;
/// A stopped process is no matter of doubt, but somebody may look at it with a debugger for a moment.
pub const GUILT_STOPPED_NS: u64 = 500_000_000;
/// Silence that ends any process, whatever its reason: nothing waits for ever.
pub const SILENCE_NS: u64 = 20_000_000_000;
/// Longest interval between two beats that is learned as an engine's period: pictures of a software rasterizer on a busy machine.
const LONGEST_PERIOD_NS: u64 = 1_000_000_000;
/// The same for a real-time engine: the tissue's longest step.
const LONGEST_REAL_TIME_NS: u64 = 4_000_000;

/// What the kernel says of a process's first thread.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Thread {
    /// Stopped by a signal or a debugger.
    Stopped,
    /// Asleep, and may be woken.
    Sleeping,
    /// Running or ready to run; its processor time so far, ns.
    Running(u64),
    /// Waits for the disk or for memory.
    Waiting,
}

/// What is thought of an engine after a look.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Opinion {
    /// Nothing new.
    Same,
    /// It has become a suspect.
    Suspected,
    /// It was one, and beats again.
    Cleared,
    /// It hangs.
    Guilty,
    /// It goes on, and works too much to be in time.
    Slow,
}

/// What is remembered of an engine between two looks.
#[derive(Clone, Copy, Debug)]
pub struct Gauge {
    nominal_ns: u64,
    idle_ns: u64,
    real_time: bool,
    bound_ns: u64,
    stopped_bound_ns: u64,
    /// Who waits for a driver: time with pictures in it until the shorter bound counts, ns.
    first_left_ns: u64,
    beat_ns: u64,
    period_ns: u64,
    silent_ns: u64,
    asked_at_ns: u64,
    guilt_ns: u64,
    ran_ns: Option<u64>,
    suspected: bool,
    /// Most guilt of which it was cleared again, ns.
    pub most_cleared_ns: u64,
}

/// Whether a role has deadlines of a millisecond: those that the machine lets run first, where it grants that.
pub fn is_real_time(role: Role) -> bool {
    realtime::priority(role).is_some()
}

/// Shortest period of a role, and the longest sleep between two beats of one that has nothing to do. Pictures may come every 4 ms; but one of them
/// that goes to the disk takes tens of milliseconds, and a hang of theirs costs nobody anything: it is found within three of the usual ones as well.
const fn periods_ns(role: Role) -> (u64, u64) {
    match role {
        Role::Hardware | Role::Device | Role::Tissue => (1_000_000, 1_000_000),
        Role::Haptic => (1_000_000, 2_000_000),
        Role::CollisionWorker => (2_000_000, 2_000_000),
        _ => (33_000_000, 33_000_000),
    }
}

impl Gauge {
    /// An engine that has just been born.
    pub fn new(role: Role) -> Gauge {
        let (nominal_ns, idle_ns) = periods_ns(role);
        Gauge {
            nominal_ns,
            idle_ns,
            real_time: is_real_time(role),
            stopped_bound_ns: match role {
                Role::Device => GUILT_DEVICE_STOPPED_NS,
                _ if is_real_time(role) => GUILT_REAL_TIME_NS,
                _ => GUILT_STOPPED_NS,
            },
            bound_ns: match role {
                Role::Device => GUILT_DEVICE_NS,
                _ if is_real_time(role) => GUILT_REAL_TIME_NS,
                Role::Rendering => GUILT_PICTURES_NS,
                Role::Recorder | Role::Console => GUILT_LIGHT_NS,
                _ => GUILT_NS,
            },
            first_left_ns: if matches!(role, Role::Rendering) { FIRST_PICTURES_NS } else { 0 },
            beat_ns: 0,
            period_ns: nominal_ns,
            silent_ns: 0,
            asked_at_ns: 0,
            guilt_ns: 0,
            ran_ns: None,
            suspected: false,
            most_cleared_ns: 0,
        }
    }

    /// One in lock-step: nothing is real time there, and who waits for one that hangs waits for as long as it takes to find that out. Who is not let run, beside
    /// a station in real time on full cores, is no more to blame than elsewhere, however long it lasts.
    pub fn in_lockstep(role: Role) -> Gauge {
        let usual = Gauge::new(role);
        let period_ns = periods_ns(Role::Fluid).0;
        let bound_ns = usual.bound_ns.max(GUILT_NS);
        Gauge {
            nominal_ns: period_ns,
            idle_ns: period_ns,
            period_ns,
            real_time: false,
            bound_ns,
            stopped_bound_ns: GUILT_NS,
            ..usual
        }
    }

    /// Whether it has deadlines of a millisecond, as nobody has in lock-step: then its first thread alone tells what it does, and a device may work too much.
    pub fn is_real_time(&self) -> bool {
        self.real_time
    }

    /// Time for which it has been silent, as far as it counts, ns.
    pub fn silent_ns(&self) -> u64 {
        self.silent_ns
    }

    /// A look: the newest heartbeat, the time since the look before as far as it counts, and a way to ask the kernel.
    pub fn look(&mut self, beat_ns: u64, counted_ns: u64, ask: impl FnOnce() -> Option<Thread>) -> Opinion {
        if beat_ns != self.beat_ns {
            return self.beaten(beat_ns);
        }
        self.silent_ns += counted_ns;
        if self.silent_ns < MISSES_TO_ASK * self.period_ns || counted_ns == 0 {
            return Opinion::Same;
        }
        // An ordinary process is asked about a few times in a period, a real-time one at each look.
        let since_ns = self.silent_ns - self.asked_at_ns;
        if since_ns < self.nominal_ns / 4 {
            return Opinion::Same;
        }
        self.asked_at_ns = self.silent_ns;
        let Some(thread) = ask() else { return Opinion::Same }; // it is gone: its death is seen elsewhere
        let blamed = self.blame(thread, since_ns.min(self.period_ns));
        let bound_ns = match thread {
            Thread::Stopped => self.stopped_bound_ns,
            _ if self.first_left_ns > 0 => GUILT_DRIVER_NS,
            _ => self.bound_ns,
        };
        if self.guilt_ns >= bound_ns || self.silent_ns >= SILENCE_NS {
            return Opinion::Guilty;
        }
        let newly = blamed && !self.suspected;
        self.suspected |= blamed;
        if newly { Opinion::Suspected } else { Opinion::Same }
    }

    fn beaten(&mut self, beat_ns: u64) -> Opinion {
        if self.beat_ns != 0 {
            let longest_ns = if self.real_time { LONGEST_REAL_TIME_NS } else { LONGEST_PERIOD_NS };
            let interval_ns = beat_ns.saturating_sub(self.beat_ns).clamp(self.nominal_ns, longest_ns);
            // Pictures take now 30 ms, now 300: an ordinary engine's long periods are learned at once and forgotten slowly.
            let old = match (self.real_time, interval_ns < self.period_ns) {
                (true, _) => 7,
                (false, true) => 31,
                (false, false) => 1,
            };
            self.period_ns = (old * self.period_ns + interval_ns) / (old + 1);
        }
        let since_ns = beat_ns.saturating_sub(self.beat_ns).min(self.nominal_ns);
        self.first_left_ns = self.first_left_ns.saturating_sub(since_ns);
        self.beat_ns = beat_ns;
        self.most_cleared_ns = self.most_cleared_ns.max(self.guilt_ns);
        (self.silent_ns, self.asked_at_ns, self.guilt_ns, self.ran_ns) = (0, 0, 0, None);
        if std::mem::take(&mut self.suspected) { Opinion::Cleared } else { Opinion::Same }
    }

    /// Adds what the thread is to blame for; true if that makes it a suspect.
    fn blame(&mut self, thread: Thread, since_ns: u64) -> bool {
        let missed = |period_ns: u64| self.silent_ns >= MISSES * period_ns;
        match thread {
            Thread::Stopped => {
                self.guilt_ns += since_ns;
                true
            }
            Thread::Sleeping => {
                let overslept = missed(self.period_ns.max(self.idle_ns));
                self.guilt_ns += if overslept { since_ns } else { 0 };
                overslept
            }
            Thread::Running(ran_ns) => {
                let ran = self.ran_ns.replace(ran_ns).map_or(0, |before_ns| ran_ns.saturating_sub(before_ns));
                self.guilt_ns += ran.min(since_ns);
                missed(self.period_ns) && 2 * ran >= since_ns
            }
            Thread::Waiting => false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    /// Looks once a millisecond from a gauge that has seen 100 beats; gives the looks until each opinion.
    fn silence(role: Role, period_ns: u64, looks: u64, thread: impl FnMut(u64) -> Thread) -> Vec<(u64, Opinion)> {
        silence_after(100, role, period_ns, looks, thread)
    }

    fn silence_after(
        beats: u64,
        role: Role,
        period_ns: u64,
        looks: u64,
        mut thread: impl FnMut(u64) -> Thread,
    ) -> Vec<(u64, Opinion)> {
        let mut gauge = Gauge::new(role);
        let mut opinions = Vec::new();
        for beat in 1..=beats {
            for _ in 0..period_ns / MS {
                // Its period is learned from the first beats.
                let asked = || if beat > 30 { unreachable!("a healthy one is not asked about") } else { None };
                assert_eq!(gauge.look(beat * period_ns, MS, asked), Opinion::Same);
            }
        }
        for look in 1..=looks {
            let opinion = gauge.look(beats * period_ns, MS, || Some(thread(look)));
            if opinion != Opinion::Same {
                opinions.push((look, opinion));
            }
            if opinion == Opinion::Guilty {
                break;
            }
        }
        opinions
    }

    #[test]
    fn in_lockstep_two_seconds_of_its_own_end_a_process_and_none_in_which_it_is_not_let_run() {
        let ended_at = |role: Role, thread: fn(u64) -> Thread| {
            let mut gauge = Gauge::in_lockstep(role);
            assert_eq!(gauge.look(1, MS, || None), Opinion::Same);
            (1..=19_000).find(|look| gauge.look(1, MS, || Some(thread(*look))) == Opinion::Guilty)
        };
        for role in [Role::Device, Role::Haptic, Role::Tissue, Role::Fluid, Role::Recorder] {
            let stopped = ended_at(role, |_| Thread::Stopped);
            assert!(stopped.is_some_and(|look| (2_000..2_200).contains(&look)), "{role:?}: {stopped:?}");
            let spins = ended_at(role, |look| Thread::Running(look * MS));
            assert!(spins.is_some_and(|look| (2_000..2_200).contains(&look)), "{role:?}: {spins:?}");
            let sleeps = ended_at(role, |_| Thread::Sleeping);
            assert!(sleeps.is_some_and(|look| (2_000..2_300).contains(&look)), "{role:?}: {sleeps:?}");
            assert_eq!(ended_at(role, |_| Thread::Running(7)), None, "{role:?}: it is ready, and is not let");
            let [usual, here] = [Gauge::new(role), Gauge::in_lockstep(role)].map(|gauge| gauge.is_real_time());
            assert_eq!((usual, here), (is_real_time(role), false), "{role:?}");
        }
    }

    #[test]
    fn a_real_time_process_that_hangs_is_found_within_three_periods_and_ended_after_a_tenth_of_a_second() {
        let stopped = silence(Role::Haptic, MS, 500, |_| Thread::Stopped);
        assert!(matches!(stopped[..], [(2, Opinion::Suspected), (100..=103, Opinion::Guilty)]), "{stopped:?}");
        let spins = silence(Role::Tissue, MS, 500, |look| Thread::Running(look * MS));
        assert!(matches!(spins[..], [(3, Opinion::Suspected), (100..=104, Opinion::Guilty)]), "{spins:?}");
        let sleeps = silence(Role::Tissue, MS, 500, |_| Thread::Sleeping);
        assert!(matches!(sleeps[..], [(3, Opinion::Suspected), (100..=104, Opinion::Guilty)]), "{sleeps:?}");
        let slow = silence(Role::Tissue, 4 * MS, 500, |_| Thread::Stopped);
        assert!(matches!(slow[..], [(5..=8, Opinion::Suspected), (_, Opinion::Guilty)]), "two of its own periods: {slow:?}");
    }

    #[test]
    fn a_device_that_hangs_is_ended_sooner_and_one_that_is_stopped_at_once() {
        let stopped = silence(Role::Device, MS, 500, |_| Thread::Stopped);
        assert!(matches!(stopped[..], [(2, Opinion::Suspected), (3..=4, Opinion::Guilty)]), "{stopped:?}");
        let spins = silence(Role::Device, MS, 500, |look| Thread::Running(look * MS));
        assert!(matches!(spins[..], [(3, Opinion::Suspected), (7..=9, Opinion::Guilty)]), "{spins:?}");
        let sleeps = silence(Role::Device, MS, 500, |_| Thread::Sleeping);
        assert!(matches!(sleeps[..], [(3, Opinion::Suspected), (8..=9, Opinion::Guilty)]), "{sleeps:?}");
    }

    #[test]
    fn an_ordinary_process_is_found_within_three_frames() {
        let stopped = silence(Role::Fluid, 33 * MS, 3_000, |_| Thread::Stopped);
        assert!(matches!(stopped[..], [(34..=99, Opinion::Suspected), (400..=700, Opinion::Guilty)]), "{stopped:?}");
        let spins = silence(Role::Fluid, 33 * MS, 3_000, |look| Thread::Running(look * MS));
        assert!(matches!(spins[..], [(66..=110, Opinion::Suspected), (1_900..=2_200, Opinion::Guilty)]), "{spins:?}");
        // With a quarter of a core it is found while the device's ring of 4.1 s still holds what it has not written.
        let starved = silence(Role::Recorder, 33 * MS, 4_000, |look| Thread::Running(look * MS / 4));
        assert!(matches!(starved[..], [(2_700..=3_100, Opinion::Guilty)]), "{starved:?}");
    }

    #[test]
    fn who_waits_for_a_driver_has_longer_only_until_its_shaders_are_there() {
        // Of 13 s and of 12 s of pictures, as often as they come; not of 1.6 s of quick ones.
        for (beats, period_ms, guilty) in
            [(100, 33, 9_900..=10_200), (400, 33, 3_900..=4_200), (400, 4, 9_900..=10_200), (3_000, 4, 3_900..=4_200)]
        {
            let found = silence_after(beats, Role::Rendering, period_ms * MS, 30_000, |_| Thread::Sleeping);
            let [(suspected, Opinion::Suspected), (ended, Opinion::Guilty)] = found[..] else { panic!("{beats}: {found:?}") };
            assert!((66..=110).contains(&suspected) && guilty.contains(&ended), "{beats} every {period_ms} ms: {found:?}");
        }
    }

    #[test]
    fn pictures_at_any_rate_are_found_to_hang_within_three_of_the_usual_ones_and_one_that_is_written_to_the_disk_is_no_hang() {
        for period_ms in [4, 8, 16, 33] {
            let stopped = silence(Role::Rendering, period_ms * MS, 3_000, |_| Thread::Stopped);
            assert!(
                matches!(stopped[..], [(34..=99, Opinion::Suspected), (400..=700, Opinion::Guilty)]),
                "{period_ms} ms: {stopped:?}"
            );
            let written = silence(Role::Rendering, period_ms * MS, 60, |look| Thread::Running(look * MS));
            assert_eq!(written, [], "{period_ms} ms");
        }
    }

    #[test]
    fn one_that_is_not_let_run_or_waits_for_memory_is_not_to_blame() {
        assert_eq!(silence(Role::Haptic, MS, 10_000, |_| Thread::Running(7)), []);
        assert_eq!(silence(Role::Rendering, 33 * MS, 10_000, |_| Thread::Waiting), []);
        let never = silence(Role::Rendering, 33 * MS, 30_000, |_| Thread::Waiting);
        assert!(matches!(never[..], [(19_900..=20_100, Opinion::Guilty)]), "but nothing waits for ever: {never:?}");
    }

    #[test]
    fn time_in_which_nobody_moves_does_not_count_and_a_beat_clears() {
        let mut gauge = Gauge::new(Role::Haptic);
        gauge.look(MS, MS, || None);
        for _ in 0..10_000 {
            assert_eq!(gauge.look(MS, 0, || Some(Thread::Stopped)), Opinion::Same);
        }
        assert_eq!(gauge.look(MS, 2 * MS, || Some(Thread::Stopped)), Opinion::Suspected);
        assert_eq!(gauge.look(2 * MS, MS, || None), Opinion::Cleared);
        assert!(gauge.most_cleared_ns > 0 && gauge.silent_ns() == 0);
    }
}
