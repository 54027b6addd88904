//! The helper process that compares what a newcomer makes with what it should be: its start, the lines that it says, and its end. One that could not be
//! started, or has ended, is started again. Of a recorder another one has noted before what the newcomer finds, which the first judge reads. Promise: that has an
//! end, and where there is nobody to judge it a newcomer is not to blame for that.

use super::Trial;
use crate::journal;
use crate::policy::{Cause, Exit, Reason};
use crate::spawn;
use crate::supervise::{Input, Supervisor};
use crate::swap::judge::Seen;
use hyst_exchange::{Station, system};
use hyst_messages::{Role, TICK_NS};
use rustix::process::Signal;
use std::io::{BufRead, BufReader};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::process::{Child, ExitStatus, Stdio};
use std::sync::mpsc::Sender;

/// How often one is started for a newcomer at most, and how long after the one before has ended or could not be had, ns.
const MOST_STARTS: u32 = 4;
const AGAIN_NS: u64 = 500_000_000;
/// How long one that was killed may take to end where nobody but this thread can wait for it, ns.
const REAPED_WITHIN_NS: u64 = 20_000_000;

/// What is next.
#[derive(Debug, PartialEq)]
enum Turn {
    /// Nothing, for now.
    Wait,
    /// One is to be started.
    Start,
    /// None lasts: why the swap ends.
    GiveUp(Reason),
}

/// The judge of one newcomer, once it needs one. It ends with this.
#[derive(Debug, Default)]
pub(super) struct Judging {
    judge: Option<Child>,
    witness: Option<Child>,
    /// When one is to be started, ns.
    due_ns: Option<u64>,
    starts: u32,
    /// Of those, how many have died of what they read.
    crashes: u32,
}

impl Judging {
    /// Has noted what its newcomer finds, before the old engine is ended. Without that it is not looked what becomes of it.
    pub(super) fn call_witness(&mut self, station: &Station) {
        let mut command = crate::proc::own_program();
        command.args(["witness", "--station", station.name()]).process_group(0);
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::null());
        self.witness = spawn::start_as_begun(station, &mut command, None).ok();
    }

    /// What was noted, for one judge.
    fn noted(&mut self) -> Stdio {
        self.witness.as_mut().and_then(|witness| witness.stdout.take()).map_or_else(Stdio::null, Stdio::from)
    }

    /// It needs one from now on.
    pub(super) fn begin(&mut self, now_ns: u64) {
        self.due_ns = Some(now_ns);
    }

    /// Its judge says nothing more.
    fn ended(&mut self, now_ns: u64) {
        self.due_ns = Some(now_ns + AGAIN_NS);
    }

    fn turn(&mut self, now_ns: u64) -> Turn {
        if self.due_ns.is_none_or(|due_ns| now_ns < due_ns) {
            return Turn::Wait;
        }
        self.due_ns = None;
        if self.judge.take().is_some_and(|judge| has_crashed(buried(judge))) {
            self.crashes += 1;
        }
        if self.starts >= MOST_STARTS {
            return Turn::GiveUp(self.reason());
        }
        self.starts += 1;
        Turn::Start
    }

    /// One was started, or could not be.
    fn take(&mut self, judge: Option<Child>, now_ns: u64) {
        if judge.is_none() {
            self.ended(now_ns);
        }
        self.judge = judge;
    }

    /// Why there is none. Each reader trusts what stands in memory that the newcomer writes: where every one has died of that, it is to blame.
    fn reason(&self) -> Reason {
        if self.crashes == self.starts {
            return Reason::new(Cause::NotCompared, "whoever compares it dies of what it says");
        }
        let text = "there is nobody to judge it: its judge could not be started, or has ended, again and again";
        Reason::new(Cause::NoTime, text)
    }
}

impl Drop for Judging {
    fn drop(&mut self) {
        [self.judge.take(), self.witness.take()].into_iter().flatten().for_each(end);
    }
}

impl Supervisor {
    /// Starts the judge that a newcomer needs; where none can be had, or none lasts, the swap ends.
    pub(super) fn tend_judge(&mut self, now_ns: u64) {
        let is_open = |trial: &&mut Trial| trial.record.cause.is_none() && !trial.record.proven;
        let Some(trial) = self.trial.as_mut().filter(is_open) else { return };
        let (role, incarnation) = (trial.role, trial.record.incarnation);
        match trial.judging.turn(now_ns) {
            Turn::Wait => {}
            Turn::Start => {
                let noted = trial.judging.noted();
                let judge = start(&self.station, role, incarnation, trial.drew, noted, self.tell_self.clone());
                if judge.is_none() {
                    journal::say(&self.station, &format!("the judge of {} cannot be started", trial.record.slot));
                }
                trial.judging.take(judge, now_ns);
            }
            Turn::GiveUp(reason) => self.doubt(incarnation, reason),
        }
    }

    /// The judge of a newcomer has ended by itself: nobody ends one before its swap is over.
    pub(in crate::supervise) fn judge_ended(&mut self, incarnation: u32) {
        let is_its_own = |trial: &&mut Trial| trial.record.incarnation == incarnation && !trial.record.proven;
        let Some(trial) = self.trial.as_mut().filter(is_its_own) else { return };
        journal::say(&self.station, &format!("the judge of {} has ended", trial.record.slot));
        trial.forget_compared();
        trial.judging.ended(system::now_ns());
    }
}

/// Starts the judge of a newcomer, which reads what was noted; what it says goes to `tell`, and that it has ended, too. `None` where the system gives no process
/// or no thread for it.
fn start(station: &Station, role: Role, guest: u32, draws: bool, noted: Stdio, tell: Sender<Input>) -> Option<Child> {
    let mut command = crate::proc::own_program();
    command.args(["judge", "--station", station.name(), "--role", role.name(), "--guest", &guest.to_string()]).process_group(0);
    command.args(draws.then_some("--draws"));
    command.stdin(noted).stdout(Stdio::piped()).stderr(Stdio::null());
    let mut child = spawn::start_as_begun(station, &mut command, None).ok()?;
    let lines = BufReader::new(child.stdout.take()?).lines();
    // Ends with the judge.
    let read = move || {
        for seen in lines.map_while(Result::ok).filter_map(|line| serde_json::from_str::<Seen>(&line).ok()) {
            if tell.send(Input::Judged { incarnation: guest, seen }).is_err() {
                return;
            }
        }
        let _ = tell.send(Input::JudgeEnded { incarnation: guest }); // if nobody is left to be told, nobody judges
    };
    if std::thread::Builder::new().name("judge".into()).spawn(read).is_err() {
        end(child); // nobody would read what it says
        return None;
    }
    Some(child)
}

/// Reaps a judge that says nothing more, if it has ended; gives how. One that has not is ended.
fn buried(mut judge: Child) -> Option<ExitStatus> {
    let status = judge.try_wait().ok().flatten();
    if status.is_none() {
        end(judge);
    }
    status
}

/// What a program ends with whose main thread has panicked.
const PANICKED: i32 = 101;

/// Whether it has read where there was nothing, or what cannot be: what a newcomer writes may be anything.
fn has_crashed(status: Option<ExitStatus>) -> bool {
    let Some(status) = status else { return false };
    let by = status.signal().and_then(Signal::from_named_raw);
    let crashes = [Signal::SEGV, Signal::BUS, Signal::ABORT, Signal::ILL, Signal::FPE];
    status.code() == Some(PANICKED) || by.is_some_and(|signal| crashes.contains(&signal))
}

/// Ends a judge, and reaps it: one that waits for a recording's disk ends when that answers, and nobody waits for it.
fn end(mut judge: Child) {
    let _ = judge.kill(); // gone is as good
    let pid = judge.id();
    if std::thread::Builder::new().name("judged".into()).spawn(move || judge.wait()).is_err() {
        reap_within(pid, REAPED_WITHIN_NS); // without another thread
    }
}

/// Waits for so long until a child that was killed has ended, ns; whether it has.
fn reap_within(pid: u32, within_ns: u64) -> bool {
    let until_ns = system::now_ns() + within_ns;
    while spawn::reap(pid) == Exit::Unknown {
        if system::now_ns() >= until_ns {
            return false;
        }
        system::sleep_ns(TICK_NS);
    }
    true
}

#[cfg(test)]
mod tests {
    use super::super::Spent;
    use super::*;
    use crate::swap::tests::record;
    use std::path::PathBuf;
    use std::process::Command;
    use std::time::Duration;

    /// How many judges are started, each of which becomes what is said, and for what cause the swap ends then.
    fn started(becomes: impl Fn(&mut Judging, u64)) -> (u32, Cause) {
        let (mut judging, mut now_ns) = (Judging::default(), 7);
        assert_eq!(judging.turn(now_ns), Turn::Wait, "it needs none yet");
        judging.begin(now_ns);
        for starts in 0..100 {
            match judging.turn(now_ns) {
                Turn::Wait => panic!("one is due"),
                Turn::Start => becomes(&mut judging, now_ns),
                Turn::GiveUp(reason) => return (starts, reason.cause),
            }
            assert_eq!(judging.turn(now_ns + AGAIN_NS - 1), Turn::Wait);
            now_ns += AGAIN_NS;
        }
        panic!("it never ends");
    }

    /// Half a minute later it was the newcomer's fault that nothing had been compared.
    #[test]
    fn a_judge_that_cannot_be_had_or_does_not_last_is_started_again_a_few_times_and_then_nobody_is_to_blame() {
        assert_eq!(started(|judging, now_ns| judging.take(None, now_ns)), (MOST_STARTS, Cause::NoTime));
        assert_eq!(started(|judging, now_ns| judging.ended(now_ns)), (MOST_STARTS, Cause::NoTime));
        let crashes = |first: u32| {
            started(|judging, now_ns| {
                judging.crashes += u32::from(judging.starts > first);
                judging.ended(now_ns);
            })
        };
        assert_eq!(crashes(1), (MOST_STARTS, Cause::NoTime), "all but the first");
        assert_eq!(crashes(0), (MOST_STARTS, Cause::NotCompared), "all of them, of what the newcomer wrote");
    }

    #[test]
    fn a_judge_that_died_of_what_it_read_is_told_from_one_that_was_killed_or_gave_up() {
        let ended = |status: i32| has_crashed(Some(ExitStatus::from_raw(status)));
        assert_eq!([11, 7, 6, PANICKED << 8].map(ended), [true; 4], "a signal, or a panic");
        assert_eq!([ended(9), ended(1 << 8), has_crashed(None)], [false; 3]);
        let judge = Command::new("sh").args(["-c", "kill -SEGV $$"]).spawn().unwrap();
        let until_ns = system::now_ns() + 60_000_000_000;
        while crate::proc::status_of_zombie(judge.id()).is_none() {
            assert!(system::now_ns() < until_ns, "it does not end");
            std::thread::yield_now();
        }
        assert!(has_crashed(buried(judge)));
    }

    #[test]
    fn that_a_judge_has_ended_is_told() {
        let station = Station::named(&format!("t{}-judge-ends", std::process::id())).unwrap();
        let (tell, inbox) = std::sync::mpsc::channel();
        // This very program, which is none of a station here, and refuses its arguments.
        let judge = start(&station, Role::Fluid, 7, false, Stdio::null(), tell).unwrap();
        let told = inbox.recv_timeout(Duration::from_secs(60)).unwrap();
        assert!(matches!(told, Input::JudgeEnded { incarnation: 7 }), "{told:?}");
        end(judge);
    }

    #[test]
    fn what_was_noted_is_read_by_the_first_judge_and_by_no_other() {
        let mut judging = Judging::default();
        let witness = Command::new("echo").arg("noted").stdout(Stdio::piped()).spawn().unwrap();
        assert!(judging.witness.replace(witness).is_none());
        let mut read = || Command::new("cat").stdin(judging.noted()).output().unwrap().stdout;
        assert_eq!([read(), read()], [b"noted\n".to_vec(), Vec::new()]);
    }

    #[test]
    fn what_a_judge_that_has_ended_had_compared_since_the_newcomer_has_the_role_proves_nothing() {
        let mut trial = Trial::begin(record(), Role::Fluid, Spent::default());
        (trial.proven, trial.agreed) = (5, (40, 12));
        assert_eq!(trial.agreed_on_probation(), 33);
        trial.forget_compared();
        assert_eq!(trial.agreed_on_probation(), 5, "what it was compared in before a pause stays");
    }

    /// Where no thread could be had for its lines, its process was left for as long as the supervisor lived.
    #[test]
    fn a_judge_is_reaped_with_another_thread_and_without_one() {
        const HANG_NS: u64 = 60_000_000_000;
        let start = || Command::new("sleep").arg("1000").spawn().unwrap();
        let of = |pid: u32| PathBuf::from(format!("/proc/{pid}"));
        let judge = start();
        let pid = judge.id();
        assert!(!reap_within(pid, 0) && of(pid).exists(), "it lives");
        end(judge);
        let until_ns = system::now_ns() + HANG_NS;
        while of(pid).exists() {
            assert!(system::now_ns() < until_ns, "it was not reaped");
            std::thread::yield_now();
        }
        let mut alone = start();
        alone.kill().unwrap();
        assert!(reap_within(alone.id(), HANG_NS) && alone.wait().is_err(), "nobody is left to be waited for");
    }
}
