//! How a station ended: its exit code, its report, its last words and its recording, and what holds of every one of them.

use crate::shown::{Promise, not_shown};
use hyst_messages::AppliedRecord;
use hyst_recording::{Continuity, Recording};
use serde_json::Value;

/// More than one tick of so many is held or void: the host took the cores.
const HOST_TOOK_ONE_OF: f64 = 200.0;
/// Of so many recorded ticks at most one may be lost: whoever makes them holds the last seconds, which a recorder's restart takes.
const LOST_AT_MOST: u64 = 1_000;

/// Share of faults that may lose more ticks than their controls, as `hystation run` promises.
const MOST_EXCESS: f64 = 0.05;

/// Ticks that a fault may lose beyond its control before it is a broken promise by itself: what the hardware bridges.
const MOST_LOST: f64 = 20.0;

/// Step of the force that is allowed beyond what fault-free ticks make, N, as a fault is judged by.
pub const STEP_MARGIN_N: f64 = 0.05;

/// Share of a window that may be void: those ticks tell nothing of a fault.
pub(crate) const MOST_VOID: f64 = 0.2;

/// Ticks that a fault of the device may cost, for which nobody stands in: what the hardware holds and ramps a force for.
pub const DEVICE_TICKS: f64 = 20.0;

/// Share of its ticks that a control is taken to have lost for which no quiet time was as long as the fault.
const LOST_WITHOUT_CONTROL: f64 = 0.01;

/// Misses of a window; `None` where a stall of the host has voided a good part of it.
fn missed(window: &Value) -> Option<f64> {
    let (ticks, voided) = (window["ticks"].as_f64()?, window["voided"].as_f64()?);
    window["missed"].as_f64().filter(|_| voided <= MOST_VOID * (ticks + voided))
}

/// How a station ended.
pub struct Ended {
    /// Exit code of `hystation run`.
    pub code: Option<i32>,
    /// Its report.
    pub report: Value,
    /// What it said on stderr.
    pub said: String,
    /// What it recorded, or why that cannot be read.
    pub recording: Result<Recording, String>,
}

impl Ended {
    /// A number of the report by its path (`device.ticks`).
    pub fn number(&self, path: &str) -> f64 {
        let found = path.split('.').fold(&self.report, |value, key| &value[key]);
        found.as_f64().unwrap_or_else(|| panic!("report has no number {path}: {found}"))
    }

    /// Misses of each fault of a target (`haptic:active` has `active` set) in its window less those in its control window. A fault of which a stall of the
    /// host has voided a good part of either window tells nothing, and is left out.
    pub fn excess(&self, role: &str, active: bool) -> Vec<f64> {
        let of_role = |fault: &&Value| {
            fault["target"].as_str().and_then(|name| name.split(':').next()) == Some(role) && fault["active"] == active
        };
        let excess = |fault: &Value| Some(missed(&fault["window"])? - missed(&fault["control"])?);
        self.report["faults"].as_array().map(|all| all.iter().filter(of_role).filter_map(excess).collect()).unwrap_or_default()
    }

    /// Most ticks that the control of a fault of this run lost.
    pub fn worst_control(&self) -> f64 {
        let all = self.report["faults"].as_array().map(Vec::as_slice).unwrap_or_default();
        all.iter().filter_map(|fault| fault["control"]["missed"].as_f64()).fold(0.0, f64::max)
    }

    /// Fails if a fault alone cost the hand more ticks beyond its control than it may and than the host explains.
    pub fn assert_cost(&self, fault: &Value) {
        let (window, control) = (&fault["window"], &fault["control"]);
        let without = || Some(LOST_WITHOUT_CONTROL * window["ticks"].as_f64()?);
        let allowed = if fault["target"] == "device" { DEVICE_TICKS } else { 0.0 };
        let what = format!("{} of {}, excess misses", fault["kind"], fault["target"]);
        match missed(window).zip(missed(control).or_else(without)) {
            Some((lost, quiet)) => {
                let promise = Promise::of_ticks(allowed, 1, self.worst_control());
                promise.assert_one(&what, lost - quiet, || format!("{fault:#}\n{}", self.said));
            }
            None => not_shown(&format!("{what}: it has no window of which a good part counts")),
        }
    }

    /// The faults of a kind (`nan`), whoever they hit; `external` for those that came from outside.
    pub fn faults(&self, kind: &str) -> Vec<&Value> {
        let all = self.report["faults"].as_array().map(Vec::as_slice).unwrap_or_default();
        all.iter().filter(|fault| fault["kind"] == kind).collect()
    }

    /// Processes that died by themselves, and not of a fault that was injected. One that hung and was killed is none of them: a busy machine makes some.
    pub fn died_unasked(&self) -> Vec<&Value> {
        self.faults("external")
            .into_iter()
            .filter(|fault| fault["detected_by"] == "pidfd" || fault["detected_by"] == "latch")
            .collect()
    }

    /// The recording holds each tick from its first to its last once, and what it has lost it names.
    pub fn assert_recorded(&self) {
        let recording = self.recording.as_ref().unwrap_or_else(|error| panic!("{error}\n{}", self.said));
        assert!(recording.damage.is_empty(), "{:?}", recording.damage);
        let continuity = Continuity::of(&recording.content);
        let (ticks, lost) = (continuity.ticks, continuity.lost());
        assert!(ticks > 1_000, "only {ticks} ticks were recorded\n{}", self.said);
        assert_eq!(continuity.repeated, 0, "ticks come twice or out of order");
        let (missing, unmade) = (continuity.missing(), continuity.unmade);
        assert_eq!(missing, 0, "ticks are not there, beyond {unmade} that were never made\n{}", self.said);
        let stale = |key: fn(&AppliedRecord) -> (u32, u64)| {
            let keys: Vec<(u32, u64)> = recording.applied().iter().map(key).filter(|key| *key != (0, 0)).collect();
            keys.windows(2).filter(|pair| pair[1] < pair[0]).count()
        };
        assert_eq!(stale(|it| (it.model_epoch, it.model_tick)), 0, "contact models older than the one before\n{}", self.said);
        assert_eq!(stale(|it| (it.medium_epoch, it.medium_tick)), 0, "media older than the one before\n{}", self.said);
        assert!(lost <= ticks / LOST_AT_MOST, "{lost} of {ticks} ticks are lost\n{}", self.said);
    }

    /// A good servo is passive by itself: the last hop withholds nothing of its forces. Where the host takes the cores again and again a force is applied for
    /// longer than its servo meant, and what the hop withholds then is what it is there for: 123 ticks of 133 247, of which 849 were held and 941 void.
    fn assert_passive(&self) {
        let [withheld, ticks, held, void] =
            ["withheld", "ticks", "held", "voided"].map(|key| self.number(&format!("device.{key}")));
        let taken = held + void;
        let most = if taken * HOST_TOOK_ONE_OF > ticks { taken } else { 0.0 };
        assert!(withheld <= most, "{withheld} ticks were withheld, {held} of {ticks} held, {void} void\n{}", self.said);
    }

    /// Nothing wrong was ever applied, nothing is left behind, and the exit code says what the report says.
    pub fn assert_clean(&self) {
        for path in ["invalid_applied", "stale_applied", "leftovers.processes", "leftovers.shared_memory", "leftovers.files"] {
            assert_eq!(self.number(path), 0.0, "{path}\n{}", self.said);
        }
        self.assert_passive();
        let any = |key: &str| self.report[key].as_array().is_some_and(|all| !all.is_empty());
        let broken = self.report["promises_broken"].as_array().map(Vec::as_slice).unwrap_or_default();
        let is_broken = !broken.is_empty();
        self.assert_broken_as_its_faults_say(broken);
        let unrecorded = self.report["recording"]["lost"].as_u64().unwrap_or(0);
        let is_lost = any("given_up") || any("held") || unrecorded > 0;
        let is_right = match self.code {
            Some(1) => is_broken,
            Some(0) => !is_broken && !is_lost,
            Some(3) => !is_broken && is_lost,
            _ => false,
        };
        assert!(
            is_right,
            "exit code {:?}: broken {broken:?}, given up {}, held {}, {unrecorded} ticks not recorded\n{}",
            self.code, self.report["given_up"], self.report["held"], self.said
        );
    }

    /// What its report calls broken, and has said, follows from the figures of its faults, and what these show beyond doubt it calls so.
    fn assert_broken_as_its_faults_say(&self, broken: &[Value]) {
        let all = self.report["faults"].as_array().map(Vec::as_slice).unwrap_or_default();
        // Beyond doubt: the lower bound.
        let lower95 = self.report["device"]["excess_per_fault"]["lower95"].as_f64();
        let is_wrong = |fault: &&Value| fault["window"]["wrong"].as_f64() > Some(0.0);
        let least = all.iter().filter(is_wrong).count() + usize::from(lower95.is_some_and(|lower95| lower95 > MOST_EXCESS));
        assert!(broken.len() >= least, "{least} at least are to be there: {broken:?}\n{}", self.said);
        let ticks = |fault: &Value, window: &str| fault[window]["missed"].as_f64().unwrap_or(0.0);
        let lost = |fault: &Value| ticks(fault, "window") + ticks(fault, "aftermath") - ticks(fault, "control");
        let shows = |fault: &&Value| is_wrong(fault) || fault["promise_held"] == false || lost(fault) > MOST_LOST;
        let of = |fault: &Value| format!("fault {} of {} at", text(&fault["kind"]), text(&fault["target"]));
        for line in broken.iter().map(text) {
            let is_of_one = all.iter().filter(shows).any(|fault| line.starts_with(&of(fault)));
            assert!(is_of_one || line.starts_with("of "), "{line}\n{}", self.said);
        }
        let is_said = self.said.contains("a promise was broken: ");
        assert_eq!(is_said, !broken.is_empty(), "{broken:?}\n{}", self.said);
    }
}

fn text(value: &Value) -> &str {
    value.as_str().unwrap_or_default()
}
