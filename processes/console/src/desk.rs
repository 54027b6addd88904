//! What lies between those who find things out and those who show them to browsers. Promise: nobody waits at it, what lies there is bounded, and a
//! browser that does not keep up is left behind.

use crate::look::{History, Look, Pictures, Status, Swapping, Tissue};
use crate::outcomes::Outcome;
use crate::picture::Picture;
use crate::pump::Pump;
use axum::body::Bytes;
use hyst_engine::Address;
use hyst_engine::journal::Line;
use hyst_exchange::{Station, system};
use serde::Serialize;
use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::{Semaphore, broadcast, watch};

/// Events that a browser gets that comes anew.
const KEPT_LINES: usize = 100;
/// News that wait for a browser; one that has more to take is left behind, and comes again.
const WAITING_NEWS: usize = 256;
/// Binaries that are verified at the same time, for a swap: one that hangs takes 10 s.
pub const VERIFIERS: usize = 2;
/// So long after one look the next is told at the latest, ns, whoever is silent: a little longer than from one answer of the supervisor to the next, so that
/// looks go with those as long as they come.
const MOST_QUIET_NS: u64 = 1_250_000_000;
/// How long pictures are made after a browser has asked for one, ns: until it asks again.
const PICTURES_FOR_NS: u64 = 2_000_000_000;

/// The desk.
#[derive(Debug)]
pub struct Desk {
    /// Where the page is.
    pub address: Address,
    /// Faults may be injected.
    pub test_mode: bool,
    station: Station,
    known: Mutex<Known>,
    news: broadcast::Sender<Bytes>,
    pictures: watch::Sender<Option<Arc<Picture>>>,
    pictures_until_ns: AtomicU64,
    verifying: Arc<Semaphore>,
}

/// What is known now.
#[derive(Debug, Default)]
struct Known {
    look: Look,
    /// The supervisor has answered, or did not in time: before that a console that follows a dead one knows less than the browsers of that one.
    may_tell: bool,
    /// What does not wait has come: an answer of the supervisor, or other alarms than before.
    is_news: bool,
    /// When a look was told last, at first when the desk was made.
    told_ns: u64,
    history: History,
    lines: VecDeque<Line>,
    /// The newest message about the case, if the station has one.
    case: Option<Bytes>,
}

/// A message of a stream of events (WHATWG HTML, server-sent events). JSON in one line has no line break.
fn message<T: Serialize>(event: &str, id: Option<u64>, value: &T) -> Bytes {
    let id = id.map_or(String::new(), |id| format!("id: {id}\n"));
    let json = serde_json::to_string(value).unwrap_or_else(|_| "null".into());
    Bytes::from(format!("event: {event}\n{id}data: {json}\n\n"))
}

impl Desk {
    /// An empty desk.
    pub fn new(address: Address, test_mode: bool, station: Station) -> Desk {
        let status = Status { test_mode, ..Status::default() };
        let look = Look { status, silence: Some("the supervisor has not answered yet".into()), ..Look::default() };
        let known = Mutex::new(Known { look, told_ns: system::now_ns(), ..Known::default() });
        let (news, pictures) = (broadcast::Sender::new(WAITING_NEWS), watch::Sender::new(None));
        let verifying = Arc::new(Semaphore::new(VERIFIERS));
        Desk { address, test_mode, station, known, news, pictures, pictures_until_ns: AtomicU64::new(0), verifying }
    }

    /// Whoever panicked with it has ended the process.
    fn known(&self) -> MutexGuard<'_, Known> {
        self.known.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The supervisor's socket.
    pub fn control(&self) -> PathBuf {
        self.station.control_socket()
    }

    /// The station.
    pub fn station(&self) -> &Station {
        &self.station
    }

    /// The turns of those who have a binary verified.
    pub fn verifying(&self) -> &Arc<Semaphore> {
        &self.verifying
    }

    /// What the supervisor said, or why it said nothing.
    pub fn note(&self, answer: Result<Status, String>) {
        let mut known = self.known();
        (known.may_tell, known.is_news) = (true, true);
        match answer {
            Ok(status) => {
                known.history.note(&status.processes);
                (known.look.status, known.look.silence) = (status, None);
            }
            Err(reason) => {
                known.history.note(&[]); // a line through that time would say what nobody knows
                known.look.silence = Some(reason);
            }
        }
    }

    /// What the pump does.
    pub fn note_pump(&self, pump: Option<Pump>) {
        let mut known = self.known();
        let has_turned = known.look.pump.as_ref().map(|pump| &pump.alarms) != pump.as_ref().map(|pump| &pump.alarms);
        known.is_news |= has_turned;
        known.look.pump = pump;
    }

    /// What the tissue says.
    pub fn note_tissue(&self, tissue: Option<Tissue>) {
        self.known().look.tissue = tissue;
    }

    /// What rendering draws.
    pub fn note_pictures(&self, pictures: Option<Pictures>) {
        self.known().look.pictures = pictures;
    }

    /// Which swaps are under way.
    pub fn note_swaps(&self, swaps: Vec<Swapping>) {
        self.known().look.swaps = swaps;
    }

    /// What came of the newest faults.
    pub fn note_faults(&self, faults: Vec<Outcome>) {
        self.known().look.faults = faults;
    }

    /// Who trains, and which recording is shown again.
    pub fn introduce(&self, trainee: Option<String>, replay: Option<String>) {
        let mut known = self.known();
        (known.look.trainee, known.look.replay) = (trainee, replay);
    }

    /// Tells those who look what is known, if something of it does not wait, or none was told for long. Nobody's answer is waited for.
    pub fn tell_look(&self, now_ns: u64) {
        let mut known = self.known();
        let is_quiet = now_ns.saturating_sub(known.told_ns) >= MOST_QUIET_NS;
        let is_due = is_quiet || (known.is_news && known.may_tell);
        if is_due {
            (known.may_tell, known.is_news, known.told_ns) = (true, false, now_ns);
            let _ = self.news.send(message("look", None, &known.look)); // nobody looks
        }
    }

    /// Case and judgement.
    pub fn note_case(&self, told: &serde_json::Value) {
        let case = message("case", None, told);
        self.known().case = Some(case.clone());
        let _ = self.news.send(case); // nobody looks
    }

    /// Tells those who look that the station ends.
    pub fn end(&self) {
        let _ = self.news.send(message("ended", None, &true)); // nobody looks
    }

    /// What happened.
    pub fn tell(&self, lines: Vec<Line>) {
        let mut known = self.known();
        for line in lines {
            let _ = self.news.send(message("said", Some(line.id), &line.text)); // nobody looks
            known.lines.push_back(line);
        }
        let surplus = known.lines.len().saturating_sub(KEPT_LINES);
        known.lines.drain(..surplus);
    }

    /// For a browser that has read the events up to `after`: what it is to be sent first, and then the news. No event comes twice, and none is left out
    /// that is kept.
    pub fn subscribe(&self, after: u64) -> (VecDeque<Bytes>, broadcast::Receiver<Bytes>) {
        let known = self.known(); // who sends news holds it too
        // Whoever has read further than there is has read a file that was shortened since.
        let after = if known.lines.back().is_some_and(|line| line.id < after) { 0 } else { after };
        let lines = known.lines.iter().filter(|line| line.id > after);
        let mut first = VecDeque::from([Bytes::from_static(b"retry: 500\n\n")]);
        first.extend(known.may_tell.then(|| message("look", None, &known.look)));
        first.extend(known.case.clone());
        first.extend(lines.map(|line| message("said", Some(line.id), &line.text)));
        (first, self.news.subscribe())
    }

    /// What is known now.
    pub fn look(&self) -> Look {
        self.known().look.clone()
    }

    /// The last minutes.
    pub fn history(&self) -> History {
        self.known().history.clone()
    }

    /// A new picture.
    pub fn show(&self, picture: Picture) {
        self.pictures.send_replace(Some(Arc::new(picture)));
    }

    /// The pictures to come, and the newest; asked for by this.
    pub fn pictures(&self) -> watch::Receiver<Option<Arc<Picture>>> {
        self.pictures_until_ns.store(system::now_ns() + PICTURES_FOR_NS, Ordering::Relaxed);
        self.pictures.subscribe()
    }

    /// Until when pictures are asked for, CLOCK_MONOTONIC ns.
    pub fn pictures_until_ns(&self) -> u64 {
        self.pictures_until_ns.load(Ordering::Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::look::Process;

    fn desk() -> Desk {
        Desk::new(Address { port: 1, token: String::new() }, false, Station::named("desk").unwrap())
    }

    fn line(id: u64) -> Line {
        Line { id, text: format!("line\n{id}\r\"") }
    }

    fn text(bytes: &Bytes) -> String {
        String::from_utf8_lossy(bytes).into_owned()
    }

    #[test]
    fn a_browser_that_comes_again_gets_what_it_missed_once() {
        let desk = desk();
        desk.note(Ok(Status::default()));
        desk.tell((1..=3).map(line).collect());
        let (first, mut news) = desk.subscribe(2);
        let first: Vec<String> = first.iter().map(text).collect();
        assert_eq!(first.len(), 3);
        assert!(first[0].starts_with("retry: ") && first[1].starts_with("event: look\ndata: {"), "{first:?}");
        assert_eq!(first[2], "event: said\nid: 3\ndata: \"line\\n3\\r\\\"\"\n\n");
        assert!(news.try_recv().is_err());
        desk.tell(vec![line(4)]);
        assert!(text(&news.try_recv().unwrap()).contains("id: 4\n"));
        let (all, _) = desk.subscribe(0);
        assert_eq!(all.len(), 2 + 4);
    }

    #[test]
    fn what_lies_there_is_bounded_and_who_does_not_keep_up_is_left_behind() {
        let desk = desk();
        let (_, mut news) = desk.subscribe(0);
        desk.tell((1..=10 * WAITING_NEWS as u64).map(line).collect());
        assert_eq!(desk.subscribe(0).0.len(), 1 + KEPT_LINES);
        assert!(matches!(news.try_recv(), Err(broadcast::error::TryRecvError::Lagged(_))));
    }

    #[test]
    fn a_supervisor_that_is_silent_is_said_beside_what_it_said_last() {
        let desk = desk();
        let status = Status { tick: 7, ..Status::default() };
        desk.note(Ok(status.clone()));
        desk.note(Err("no supervisor answers".into()));
        let look = desk.look();
        assert_eq!((look.status, look.silence.as_deref()), (status.clone(), Some("no supervisor answers")));
        desk.note(Ok(status));
        assert_eq!(desk.look().silence, None);
    }

    /// A page emptied its table, and took the banner of the test mode away, for as long as the next console had not heard its supervisor.
    #[test]
    fn a_console_that_has_asked_nobody_yet_tells_no_look() {
        let desk = desk();
        let looks = || desk.subscribe(0).0.iter().filter(|message| text(message).starts_with("event: look\n")).count();
        assert_eq!(looks(), 0);
        desk.note(Err("no supervisor answers".into()));
        assert_eq!(looks(), 1);
    }

    /// Pump and alarms stood on the page for as long as the supervisor took to answer, up to six seconds, and the page called itself connected.
    #[test]
    fn pump_and_alarms_are_told_whether_the_supervisor_answers_or_not() {
        let desk = Desk::new(Address { port: 1, token: String::new() }, true, Station::named("desk").unwrap());
        let (_, mut news) = desk.subscribe(0);
        let mut told = |deficit_ml: f64, alarms: &[&str], now_ns: u64| {
            let alarms = alarms.iter().map(|name| name.to_string()).collect();
            desk.note_pump(Some(Pump { deficit_ml, alarms, ..Pump::default() }));
            desk.tell_look(now_ns);
            let look = news.try_recv().ok()?;
            let look: serde_json::Value = serde_json::from_str(text(&look).strip_prefix("event: look\ndata: ")?).unwrap();
            Some((look["pump"]["deficit_ml"].as_f64()?, look["pump"]["alarms"].as_array()?.len(), look["test_mode"] == true))
        };
        let first_ns = system::now_ns() + MOST_QUIET_NS;
        assert_eq!(told(1.0, &["deficit"], 0), None, "it has not had the time to answer yet");
        assert_eq!(told(2.0, &["deficit"], first_ns), Some((2.0, 1, true)), "what the console knows by itself");
        assert_eq!(told(3.0, &["deficit"], first_ns + MOST_QUIET_NS - 1), None, "nothing that does not wait");
        assert_eq!(told(4.0, &["deficit", "perforation"], first_ns + 1), Some((4.0, 2, true)), "an alarm is told at once");
        assert_eq!(told(5.0, &["deficit"], first_ns + 2), Some((5.0, 1, true)), "and its end");
        assert_eq!(told(6.0, &["deficit"], first_ns + 2 + MOST_QUIET_NS), Some((6.0, 1, true)), "figures go on");
    }

    /// A page that was loaded later drew a line through a time of which nobody knows anything.
    #[test]
    fn while_the_supervisor_is_silent_the_plots_have_a_gap() {
        let desk = desk();
        let process = |rate_hz| Process { name: "device".into(), rate_hz: Some(rate_hz), ..Process::default() };
        let said = |rate_hz| Ok(Status { processes: vec![process(rate_hz)], ..Status::default() });
        for answer in [said(999.0), Err("no supervisor answers".to_string()), said(1_000.0)] {
            desk.note(answer);
        }
        let history = serde_json::to_value(desk.history()).unwrap();
        let rates: Vec<Option<f64>> = history["device"].as_array().unwrap().iter().map(|point| point[0].as_f64()).collect();
        assert_eq!(rates, [Some(999.0), None, Some(1_000.0)]);
    }

    #[test]
    fn an_end_is_told_to_who_looks() {
        let desk = desk();
        let (_, mut news) = desk.subscribe(0);
        desk.end();
        assert_eq!(text(&news.try_recv().unwrap()), "event: ended\ndata: true\n\n");
    }

    #[test]
    fn who_trains_what_is_shown_again_and_what_is_swapped_is_told_in_every_look() {
        let desk = desk();
        desk.introduce(Some("Ana Müller".into()), Some("/a.mcap".into()));
        desk.note_swaps(vec![Swapping { role: "fluid", stage: "on probation" }]);
        desk.note_faults(vec![Outcome { kind: "kill".into(), ..Outcome::default() }]);
        let (_, mut news) = desk.subscribe(0);
        desk.note(Ok(Status::default()));
        desk.tell_look(0);
        let told = text(&news.try_recv().unwrap());
        for said in [
            "\"trainee\":\"Ana Müller\"",
            "\"replay\":\"/a.mcap\"",
            "{\"role\":\"fluid\",\"stage\":\"on probation\"}",
            "\"faults\":[{\"kind\":\"kill\",",
        ] {
            assert!(told.contains(said), "{said}: {told}");
        }
    }

    #[test]
    fn pictures_are_asked_for_as_long_as_somebody_looks() {
        let desk = desk();
        assert_eq!(desk.pictures_until_ns(), 0);
        desk.pictures();
        assert!(desk.pictures_until_ns() > system::now_ns());
    }
}
