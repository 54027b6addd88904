//! What a station looks like from outside, read from its pages alone: it needs no supervisor, and works while that is dead.

mod epoch;
mod flow;
mod told;

use crate::recording::{self, RecordingView};
use hyst_engine::Address;
use hyst_exchange::{ReadPage, Roster, Station, StationError, StationPage, system};
use hyst_messages::page::{header, station as layout, tissue};
use hyst_messages::{LATENCY_BUCKETS, Role, SLOTS, Slot, TissueStatus, counted_since, percentile_ns};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use epoch::epoch_of;
use flow::{on_scope_mn_of, steps_of, transmittance_of};

pub use flow::StepView;
pub use told::{CuttingView, RegisterView};

/// One process.
#[derive(Clone, Debug, Serialize, Default)]
pub struct ProcessView {
    /// Slot's name.
    pub name: String,
    /// Process id.
    pub pid: u32,
    /// Epoch in which it holds its role, 0 if it holds none with a state; of the supervisor, how often one was started.
    pub epoch: u32,
    /// `starting`, `warming`, `spare`, `live`, `stopping`, `failed` or `dead`.
    pub state: &'static str,
    /// It does its role's work: holder in the roster, the servo that the device has selected, or the only process of its role.
    pub active: bool,
    /// Incarnation.
    pub incarnation: u32,
    /// Restarts of the slot after faults.
    pub restarts: u64,
    /// Steps per second since the look before; `None` at the first look.
    pub rate_hz: Option<f64>,
    /// 99th percentile of the wake-up latency since its start, µs.
    pub wakeup_p99_us: Option<f64>,
    /// The same since the look before; `None` at the first look, and without a wake-up since.
    pub recent_wakeup_p99_us: Option<f64>,
    /// 99th percentile of the loop latency since its start, µs.
    pub loop_p99_us: Option<f64>,
    /// The same since the look before.
    pub recent_loop_p99_us: Option<f64>,
    /// Age of its newest value, ms.
    pub age_ms: Option<f64>,
    /// Its newest tick.
    pub tick: u64,
    /// The binary that it runs; `None` if the system does not say.
    pub binary: Option<std::path::PathBuf>,
    /// What is registered with its Site Manager; of a tissue only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub registered: Option<RegisterView>,
    /// The steps of its flow; of a fluid only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub steps: Option<StepView>,
    /// What the medium does to scope and loop, as a force at the tip, mN along x, y, z; of a fluid only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub on_scope_mn: Option<[f32; 3]>,
    /// Share of the light that comes through the blood before the lens, above 0 to 1; of a fluid that says it only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub transmittance: Option<f32>,
    /// Length of its steps, ms; of a tissue only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub step_ms: Option<u32>,
    /// What it says of cutting; of a tissue only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cutting: Option<CuttingView>,
    /// What its steps had to mend, 0 in a healthy session; of a tissue only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub corrections: Option<u32>,
}

type Histogram = [u64; LATENCY_BUCKETS];

/// What was seen of a process at the look before.
#[derive(Debug)]
struct Before {
    incarnation: u32,
    steps: u64,
    at_ns: u64,
    /// Of its wake-ups and its loops.
    histograms: [Histogram; 2],
}

/// 99th percentile, µs; `None` if nothing was counted.
fn p99_us(counts: &Histogram) -> Option<f64> {
    let p99_ns = percentile_ns(counts, 0.99);
    (p99_ns != 0).then_some(p99_ns as f64 * 1e-3)
}

/// The station.
#[derive(Clone, Debug, Serialize, Default)]
pub struct StationView {
    /// Name.
    pub station: String,
    /// Tick.
    pub tick: u64,
    /// `running`, `stopping` or `dead`.
    pub state: &'static str,
    /// Faults may be injected.
    pub test_mode: bool,
    /// Roles that are held still, because no successor survives a step of them.
    pub held: Vec<&'static str>,
    /// Processes in slot order.
    pub processes: Vec<ProcessView>,
    /// The recording, where there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub recording: Option<RecordingView>,
    /// Where the operator's page is, token and all; only for whoever has the right to ask for it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub console: Option<String>,
}

/// Looks at a station again and again.
#[derive(Debug)]
pub struct Viewer {
    station: Station,
    page: StationPage,
    roster: Roster,
    pages: BTreeMap<Slot, (u32, ReadPage)>,
    before: BTreeMap<Slot, Before>,
    /// The file that was to be recorded into.
    record: Option<PathBuf>,
}

impl Viewer {
    /// Opens a station; an error if there is none.
    pub fn open(station: &Station) -> Result<Viewer, StationError> {
        Ok(Viewer {
            station: station.clone(),
            page: station.open()?,
            roster: Roster::open(station)?,
            pages: BTreeMap::new(),
            before: BTreeMap::new(),
            record: recording::file_of(station),
        })
    }

    /// The station's page.
    pub fn page(&self) -> &StationPage {
        &self.page
    }

    /// The incarnation that holds a role with a spare, 0 if none does.
    pub fn holder(&self, role: Role) -> u32 {
        self.roster.holder(role).incarnation
    }

    fn is_active(&mut self, slot: Slot) -> bool {
        let incarnation = self.page.incarnation(slot);
        let device = Slot::first(Role::Device);
        let _ = self.slot_page(device); // maps the page of the present device
        let device = self.pages.get(&device).map(|(_, page)| page);
        match slot.role() {
            Role::CollisionWorker => true,
            role => crate::active::active_now(&self.station, &self.roster, device, role) == incarnation,
        }
    }

    /// The page of the slot's present incarnation.
    pub fn slot_page(&mut self, slot: Slot) -> Option<&ReadPage> {
        let incarnation = self.page.incarnation(slot);
        if incarnation == 0 {
            return None;
        }
        if self.pages.get(&slot).is_none_or(|(known, _)| *known != incarnation) {
            self.pages.remove(&slot);
            let page = self.station.read_slot(slot, incarnation).ok()?;
            self.pages.insert(slot, (incarnation, page));
        }
        self.pages.get(&slot).map(|(_, page)| page)
    }

    /// Whether the page of a slot's process says that it is warm or live.
    pub fn says_ready(&mut self, slot: Slot) -> bool {
        self.slot_page(slot).is_some_and(|page| page.state().is_ready())
    }
    /// Whether a slot has a living process that is warm or live.
    pub fn is_well(&mut self, slot: Slot) -> bool {
        self.page.pid(slot) != 0 && !self.page.is_dead(slot) && self.says_ready(slot)
    }
    /// What the newest tissue says of itself, whoever wrote it; the last slot is a guest's, who has the role in the midst of a swap.
    pub fn tissue_status(&mut self) -> Option<TissueStatus> {
        let slots = (0..Role::Tissue.slots().1).filter_map(|index| Slot::new(Role::Tissue, index));
        let found = slots.filter_map(|slot| self.slot_page(slot)?.cell(tissue::STATUS));
        found.map(|(_, status)| status).max_by_key(|status| status.state_tick)
    }
    /// Looks, and says where the operator's page is.
    pub fn look_all(&mut self) -> StationView {
        let console = Address::read(&self.station).map(|address| address.url());
        StationView { console, ..self.look() }
    }
    /// Looks.
    pub fn look(&mut self) -> StationView {
        let mut processes = Vec::new();
        for slot in (0..SLOTS).filter_map(Slot::from_number) {
            if self.page.pid(slot) != 0 {
                processes.push(self.process(slot));
            }
        }
        let alive = processes.iter().any(|process| process.state != "dead");
        let state = match (alive, self.page.stop_requested()) {
            (false, _) => "dead",
            (true, true) => "stopping",
            (true, false) => "running",
        };
        StationView {
            station: self.station.name().to_string(),
            tick: self.page.present_tick(),
            state,
            test_mode: self.page.test_mode(),
            held: Role::ALL.into_iter().filter(|role| self.page.is_held(*role)).map(Role::name).collect(),
            processes,
            recording: self.recording(),
            console: None,
        }
    }

    fn recording(&mut self) -> Option<RecordingView> {
        let (recorder, file) = (Slot::first(Role::Recorder), self.record.clone()?);
        let newest_tick = recording::newest_tick(self.slot_page(Slot::first(Role::Device)));
        let has_recorder = self.page.incarnation(recorder) != 0;
        let free_bytes = recording::free_bytes(&self.station);
        has_recorder.then(|| RecordingView::of(&file, self.slot_page(recorder), newest_tick).with_room(free_bytes))
    }

    fn process(&mut self, slot: Slot) -> ProcessView {
        let alive = crate::remains::slot_alive(&self.page, slot.number()).is_some();
        let mut view = ProcessView {
            name: slot.to_string(),
            pid: self.page.pid(slot),
            epoch: epoch_of(&self.page, &self.roster, slot),
            state: if alive { "live" } else { "dead" },
            active: self.is_active(slot),
            incarnation: self.page.incarnation(slot),
            restarts: self.page.page().load64(layout::SLOT_RESTARTS + slot.number()),
            binary: crate::supervise::trial::binary_of(self.page.pid(slot))
                .filter(|_| alive)
                .map(|path| crate::swap::kept::name_of(&path)),
            ..ProcessView::default()
        };
        if slot.role() == Role::Supervisor {
            view.restarts = (view.epoch as u64).saturating_sub(1);
        }
        let before = self.before.remove(&slot).filter(|before| before.incarnation == view.incarnation);
        let Some(page) = self.slot_page(slot) else {
            return view;
        };
        let now_ns = system::now_ns();
        if slot.role() == Role::Tissue {
            told::of_tissue(page, &mut view);
        }
        view.steps = if slot.role() == Role::Fluid { steps_of(page) } else { None };
        view.on_scope_mn = if slot.role() == Role::Fluid { on_scope_mn_of(page) } else { None };
        view.transmittance = if slot.role() == Role::Fluid { transmittance_of(page) } else { None };
        view.tick = page.load64(header::TICK);
        if alive {
            view.state = page.state().name();
        }
        let value_ns = page.load64(header::VALUE_NS);
        view.age_ms = (value_ns != 0).then(|| now_ns.saturating_sub(value_ns) as f64 * 1e-6);
        let histograms = [header::WAKEUP, header::LOOP].map(|at| {
            let mut counts = [0u64; LATENCY_BUCKETS];
            page.load64s(at, &mut counts);
            counts
        });
        [view.wakeup_p99_us, view.loop_p99_us] = histograms.each_ref().map(p99_us);
        let steps = page.load64(header::STEPS);
        if let Some(before) = before.filter(|before| now_ns > before.at_ns) {
            view.rate_hz = Some(steps.saturating_sub(before.steps) as f64 * 1e9 / (now_ns - before.at_ns) as f64);
            let recent = |which: usize| p99_us(&counted_since(&histograms[which], &before.histograms[which]));
            (view.recent_wakeup_p99_us, view.recent_loop_p99_us) = (recent(0), recent(1));
        }
        self.before.insert(slot, Before { incarnation: view.incarnation, steps, at_ns: now_ns, histograms });
        view
    }
}

/// What whoever looks at a station in test mode is told first.
pub const TEST_MODE: &str = "*** TEST MODE: faults may be injected into this station; not for training ***";

/// The table of a look, as lines of plain text.
pub fn table(view: &StationView) -> String {
    let mut text = format!(
        "{}station {}  {}  tick {}{}{}\n{:<19} {:>6} {:>7} {:>8} {:>5} {:>8} {:>11} {:>8}  {}\n",
        if view.test_mode { format!("{TEST_MODE}\n") } else { String::new() },
        view.station,
        view.state,
        view.tick,
        view.held.iter().map(|role| format!("  {role} is held still")).collect::<String>(),
        view.console.as_ref().map_or(String::new(), |url| format!("\noperator's page {url}")),
        "process",
        "incarn",
        "pid",
        "state",
        "epoch",
        "rate/Hz",
        "p99 wake/us",
        "age/ms",
        "binary"
    );
    let number = |value: Option<f64>, digits: usize| value.map_or("-".to_string(), |value| format!("{value:.digits$}"));
    for process in &view.processes {
        text.push_str(&format!(
            "{:<19} {:>6} {:>7} {:>8} {:>5} {:>8} {:>11} {:>8}  {}\n",
            process.name,
            process.incarnation,
            process.pid,
            process.state,
            process.epoch,
            number(process.rate_hz, 1),
            number(process.wakeup_p99_us, 0),
            number(process.age_ms, 1),
            process.binary.as_deref().unwrap_or(Path::new("-")).display()
        ));
    }
    if let Some(steps) = view.processes.iter().filter(|process| process.active).find_map(|process| process.steps) {
        text.push_str(&slow_flow(&steps));
    }
    let step_ms = view.processes.iter().filter(|process| process.active).find_map(|process| process.step_ms);
    if let Some(ms) = step_ms.filter(|ms| *ms > 1) {
        text.push_str(&format!("the tissue is computed every {ms} ms: for every millisecond this machine is too slow\n"));
    }
    let cutting = view.processes.iter().filter(|process| process.active).find_map(|process| process.cutting.as_ref());
    text.extend(cutting.and_then(CuttingView::line));
    text.extend(view.recording.iter().map(RecordingView::line));
    text
}

/// What of the scene's flow the machine does not afford, a line each.
fn slow_flow(steps: &StepView) -> String {
    let StepView { ms, scene_ms, halvings } = steps;
    let mut text = String::new();
    if ms != scene_ms {
        text.push_str(&format!("the flow is computed every {ms} ms: for the scene's {scene_ms} ms this machine is too slow\n"));
    }
    if *halvings > 0 {
        let part = 1u64 << (*halvings).min(u32::BITS - 1);
        text.push_str(&format!(
            "the flow has 1/{part} of the scene's cells along each axis: for more this machine is too slow\n"
        ));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flow(steps: StepView) -> StationView {
        let fluid = ProcessView { name: "fluid:0".into(), active: true, steps: Some(steps), ..ProcessView::default() };
        StationView { processes: vec![fluid], ..StationView::default() }
    }

    #[test]
    fn a_station_in_test_mode_says_so_in_a_line_of_its_own_above_the_table_and_no_other_does() {
        let text = table(&StationView { test_mode: true, ..StationView::default() });
        assert_eq!(text.lines().next(), Some(TEST_MODE), "{text}");
        let plain = table(&StationView::default());
        assert_eq!(text.strip_prefix(&format!("{TEST_MODE}\n")), Some(plain.as_str()));
    }

    #[test]
    fn a_recording_has_a_line_under_the_table_and_a_station_without_one_has_none() {
        let recording = RecordingView { stands_still: Some("no room".into()), ..RecordingView::default() };
        let text = table(&StationView { recording: Some(recording), ..StationView::default() });
        assert!(text.lines().last().is_some_and(|line| line.starts_with("THE RECORDING STANDS STILL")), "{text}");
        assert!(!table(&StationView::default()).contains("RECORDING"));
    }

    #[test]
    fn a_flow_that_is_computed_more_rarely_or_coarsely_than_the_scene_asks_for_is_said() {
        let slow = table(&flow(StepView { ms: 66, scene_ms: 33, halvings: 0 }));
        assert!(slow.contains("every 66 ms") && slow.contains("33 ms") && !slow.contains("cells"), "{slow}");
        let coarse = table(&flow(StepView { ms: 33, scene_ms: 33, halvings: 2 }));
        assert!(coarse.contains("1/4 of the scene's cells along each axis") && !coarse.contains("every"), "{coarse}");
        assert!(!table(&flow(StepView { ms: 33, scene_ms: 33, halvings: 0 })).contains("the flow"));
        let tissue = |step_ms| {
            let tissue = ProcessView { name: "tissue:0".into(), active: true, step_ms, ..ProcessView::default() };
            table(&StationView { processes: vec![tissue], ..StationView::default() })
        };
        assert!(tissue(Some(2)).contains("the tissue is computed every 2 ms"), "{}", tissue(Some(2)));
        assert!(!tissue(Some(1)).contains("the tissue is computed") && !tissue(None).contains("the tissue is computed"));
    }
}
