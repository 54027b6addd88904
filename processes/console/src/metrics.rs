//! What is known of the station now, for a monitor: the text format of OpenMetrics 1.0. Promise: one exposition, ended by `# EOF`; what is not known is
//! left out, as what a supervisor said that is silent by now, and what has a unit in its name says it in a line of its own.

use crate::look::Look;
use hyst_messages::{PICTURE_PASSES, PUMP_ALARMS, Slot};
use prometheus_client::encoding::text::encode;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::registry::{Metric, Registry, Unit};
use std::sync::atomic::AtomicU64;

/// The media type of [`text`].
pub const CONTENT_TYPE: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";

/// Units that names end with; what is per minute before what is not.
const UNITS: [&str; 9] =
    ["milliliters_per_minute", "milliliters", "mmhg", "seconds", "hertz", "pixels", "bytes", "ratio", "ticks"];

type Labels = Vec<(&'static str, String)>;
type Figure = Gauge<f64, AtomicU64>;
type Figures = Family<Labels, Figure>;

/// The whole text.
pub fn text(look: &Look) -> String {
    let mut registry = Registry::with_prefix("hystation");
    figure(
        &mut registry,
        "supervisor_answers",
        "Whether the supervisor answered when it was last asked",
        is(look.silence.is_none()),
    );
    if look.silence.is_none() {
        station(look, &mut registry);
        processes(look, &mut registry);
        recording(look, &mut registry);
    }
    pump(look, &mut registry);
    tissue(look, &mut registry);
    pictures(look, &mut registry);
    let mut text = String::new();
    match encode(&mut text, &registry) {
        Ok(()) => text,
        Err(_) => "# EOF\n".into(), // a string takes everything
    }
}

/// Registers a metric under its name, of which the end may be a unit.
fn register(registry: &mut Registry, name: &str, help: &str, metric: impl Metric) {
    let unit = UNITS.iter().find_map(|unit| Some((name.strip_suffix(unit)?.strip_suffix('_')?, *unit)));
    match unit {
        Some((front, unit)) => registry.register_with_unit(front, help, Unit::Other(unit.into()), metric),
        None => registry.register(name, help, metric),
    }
}

fn figure(registry: &mut Registry, name: &str, help: &str, value: f64) {
    let figure = Figure::default();
    figure.set(value);
    register(registry, name, help, figure);
}

fn is(value: bool) -> f64 {
    f64::from(u8::from(value))
}

fn station(look: &Look, registry: &mut Registry) {
    figure(registry, "tick", "The station's present tick, one in each millisecond", look.status.tick as f64);
    figure(registry, "running", "Whether the station runs", is(look.status.state == "running"));
    figure(registry, "test_mode", "Whether faults may be injected", is(look.status.test_mode));
    figure(registry, "roles_held", "Roles that are held still", look.status.held.len() as f64);
}

fn processes(look: &Look, registry: &mut Registry) {
    let names = [
        ("process_up", "Whether the process lives and does its work, or could at once"),
        ("process_active", "Whether it does its role's work"),
        ("process_incarnation", "Number of its life"),
        ("process_rate_hertz", "Steps in a second"),
        ("process_wakeup_p99_seconds", "99th percentile of the wake-up latency since it was last looked at"),
        ("process_loop_p99_seconds", "99th percentile of the loop latency since it was last looked at"),
        ("process_value_age_seconds", "Age of its newest value"),
    ];
    let figures = names.map(|_| Figures::default());
    let restarts = Family::<Labels, Counter>::default();
    for process in &look.status.processes {
        let role = Slot::parse(&process.name).map_or("", |slot| slot.role().name());
        let labels: Labels = vec![("process", process.name.clone()), ("role", role.into())];
        let is_up = matches!(process.state.as_str(), "live" | "spare");
        let values = [
            Some(is(is_up)),
            Some(is(process.active)),
            Some(f64::from(process.incarnation)),
            process.rate_hz,
            process.recent_wakeup_p99_us.map(|us| us * 1e-6),
            process.recent_loop_p99_us.map(|us| us * 1e-6),
            process.age_ms.map(|ms| ms * 1e-3),
        ];
        for (figures, value) in figures.iter().zip(values) {
            if let Some(value) = value {
                figures.get_or_create(&labels).set(value);
            }
        }
        restarts.get_or_create(&labels).inc_by(process.restarts);
    }
    for ((name, help), figures) in names.into_iter().zip(figures) {
        register(registry, name, help, figures);
    }
    register(registry, "process_restarts", "Restarts of its slot after faults", restarts);
}

fn pump(look: &Look, registry: &mut Registry) {
    let Some(pump) = &look.pump else { return };
    figure(registry, "pump_pressure_mmhg", "Pressure in the cavity, mmHg, mean of 1 s", pump.pressure_mmhg);
    figure(registry, "pump_inflow_milliliters_per_minute", "Flow into the cavity", pump.inflow_ml_min);
    figure(registry, "pump_outflow_milliliters_per_minute", "Flow out of the cavity", pump.outflow_ml_min);
    figure(registry, "pump_deficit_milliliters", "Volume in minus volume out since the start", pump.deficit_ml);
    figure(registry, "pump_cavity_milliliters", "Volume of the cavity", pump.cavity_ml);
    figure(registry, "pump_bled_milliliters", "Blood that has come into the cavity since the start", pump.bled_ml);
    figure(registry, "pump_open_vessels", "Vessels that wounds have opened and nothing has shut", pump.open_vessels.into());
    figure(registry, "pump_sealed_vessels", "Vessels that are coagulated", pump.sealed_vessels.into());
    if let Some(share) = pump.transmittance {
        figure(registry, "view_transmittance_ratio", "Share of the light that comes through the blood before the lens", share);
    }
    let alarms = Figures::default();
    for (_, name) in PUMP_ALARMS {
        let is_on = pump.alarms.iter().chain(&pump.notices).any(|alarm| alarm == name);
        alarms.get_or_create(&vec![("alarm", name.to_string())]).set(is(is_on));
    }
    register(registry, "pump_alarm", "Alarms of the pump", alarms);
}

fn tissue(look: &Look, registry: &mut Registry) {
    let Some(tissue) = &look.tissue else { return };
    figure(registry, "tissue_substeps", "Substeps of the last step", f64::from(tissue.substeps));
    let counts = [
        ("tissue_cut_limits", "Sweeps of the loop that met a limit of the mesh, or were refused", tissue.cut_limits),
        ("tissue_corrections", "What the steps had to mend: nothing in a healthy session", tissue.corrections),
        ("tissue_hits_dropped", "Hits of the intersection test that found no room", tissue.hits_dropped),
    ];
    for (name, help, value) in counts {
        let count = Counter::<u64, AtomicU64>::default();
        count.inc_by(u64::from(value));
        register(registry, name, help, count);
    }
}

fn pictures(look: &Look, registry: &mut Registry) {
    let Some(pictures) = &look.pictures else { return };
    let count = Counter::<u64, AtomicU64>::default();
    count.inc_by(pictures.count);
    register(registry, "rendering_pictures", "Pictures that this life of rendering has drawn", count);
    figure(registry, "rendering_picture_age_seconds", "Age of the newest picture", pictures.age_s);
    if pictures.period_s > 0.0 {
        figure(registry, "rendering_aim_hertz", "Pictures in a second that it aims at", 1.0 / pictures.period_s);
    }
    figure(registry, "rendering_frame_seconds", "Time that the newest picture took", pictures.frame_s);
    figure(registry, "rendering_scale_ratio", "Share of its width and height at which it was drawn", pictures.scale);
    let [width, height] = pictures.size_px.map(f64::from);
    figure(registry, "rendering_width_pixels", "Width of the picture", width);
    figure(registry, "rendering_height_pixels", "Height of the picture", height);
    figure(registry, "rendering_upload_bytes", "Bytes handed to the graphics device for it", pictures.upload_bytes as f64);
    let passes = Figures::default();
    for (name, time_s) in PICTURE_PASSES.into_iter().zip(pictures.passes_s).filter(|(_, time_s)| *time_s > 0.0) {
        passes.get_or_create(&vec![("pass", name.to_string())]).set(time_s);
    }
    register(registry, "rendering_pass_seconds", "Time of each of its passes, where the device keeps it", passes);
}

fn recording(look: &Look, registry: &mut Registry) {
    let Some(recording) = &look.status.recording else { return };
    let stands = is(recording.stands_still.is_some());
    figure(registry, "recorder_stands_still", "Whether nothing is written of what is to be recorded", stands);
    figure(registry, "recorder_lost_ticks", "Ticks of the session that will not be in the recording", recording.lost as f64);
    figure(registry, "recorder_behind_ticks", "Ticks made since the newest on disk", recording.behind_ticks as f64);
    figure(registry, "recorder_ticks", "Ticks on disk", recording.ticks as f64);
    figure(registry, "recorder_bytes", "Bytes on disk", recording.bytes as f64);
    if let Some(bytes) = recording.free_bytes {
        figure(registry, "recorder_free_bytes", "Bytes that the disk of the recording has left", bytes as f64);
    }
    if let Some(time_s) = recording.lasts_s {
        figure(registry, "recorder_room_seconds", "How long they last at the rate of the recording", time_s);
    }
}

#[cfg(test)]
mod strict;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::look::{Pictures, Process, Recording, Status, Tissue};
    use crate::pump::Pump;

    #[test]
    fn the_text_has_each_figure_that_is_known_and_ends_once() {
        let process = Process {
            name: "haptic:1".into(),
            state: "live".into(),
            incarnation: 4,
            restarts: 3,
            rate_hz: Some(999.5),
            recent_wakeup_p99_us: Some(50.0),
            ..Process::default()
        };
        let recording = Some(Recording::default());
        let status = Status { tick: 1_234, state: "running".into(), processes: vec![process], recording, ..Status::default() };
        let (alarms, notices) = (vec!["deficit".into()], vec!["container change".into()]);
        let pump = Pump { deficit_ml: 12.5, bled_ml: 1.5, transmittance: Some(0.25), alarms, notices, ..Pump::default() };
        let pictures = Pictures {
            count: 9_000,
            age_s: 0.25,
            period_s: 0.04,
            scale: 0.75,
            size_px: [640, 480],
            passes_s: [0.0, 0.5, 0.0, 0.0, 0.0],
            ..Pictures::default()
        };
        let text = text(&Look { status, pump: Some(pump), pictures: Some(pictures), ..Look::default() });
        for line in [
            "hystation_tick 1234.0",
            "hystation_supervisor_answers 1.0",
            "hystation_process_up{process=\"haptic:1\",role=\"haptic\"} 1.0",
            "hystation_process_active{process=\"haptic:1\",role=\"haptic\"} 0.0",
            "hystation_process_rate_hertz{process=\"haptic:1\",role=\"haptic\"} 999.5",
            "hystation_process_restarts_total{process=\"haptic:1\",role=\"haptic\"} 3",
            "hystation_pump_deficit_milliliters 12.5",
            "hystation_pump_bled_milliliters 1.5",
            "hystation_view_transmittance_ratio 0.25",
            "hystation_pump_alarm{alarm=\"deficit\"} 1.0",
            "hystation_pump_alarm{alarm=\"pressure\"} 0.0",
            "hystation_pump_alarm{alarm=\"container change\"} 1.0",
            "hystation_rendering_pictures_total 9000",
            "hystation_rendering_picture_age_seconds 0.25",
            "hystation_rendering_aim_hertz 25.0",
            "hystation_rendering_scale_ratio 0.75",
            "hystation_rendering_width_pixels 640.0",
            "hystation_rendering_height_pixels 480.0",
            "hystation_rendering_pass_seconds{pass=\"scene\"} 0.5",
            "# TYPE hystation_rendering_pictures counter",
            "# TYPE hystation_rendering_scale_ratio gauge",
            "# UNIT hystation_rendering_scale_ratio ratio",
            "# UNIT hystation_rendering_picture_age_seconds seconds",
            "# HELP hystation_rendering_picture_age_seconds Age of the newest picture.",
            "# UNIT hystation_process_rate_hertz hertz",
            "# UNIT hystation_pump_deficit_milliliters milliliters",
            "# UNIT hystation_pump_inflow_milliliters_per_minute milliliters_per_minute",
        ] {
            assert!(text.lines().any(|found| found == line), "{line}\n{text}");
        }
        let wakeup = text.lines().find_map(|line| line.strip_prefix("hystation_process_wakeup_p99_seconds{")).unwrap();
        let value: f64 = wakeup.rsplit(' ').next().unwrap().parse().unwrap();
        assert!((value - 50e-6).abs() < 1e-12, "{wakeup}");
        assert!(!text.contains("process_loop_p99_seconds{"), "it is not known\n{text}");
        assert!(!text.contains("pass=\"glow\""), "the device keeps no time of it\n{text}");
        // Every name that ends with a unit says it, and no other has one.
        for name in text.lines().filter_map(|line| line.strip_prefix("# TYPE ")?.split(' ').next()) {
            let unit = UNITS.iter().find(|unit| name.ends_with(&format!("_{unit}")));
            let said = text.lines().find_map(|line| line.strip_prefix(&format!("# UNIT {name} ")));
            assert_eq!(said, unit.copied(), "{name}\n{text}");
        }
        assert!(text.ends_with("# EOF\n") && text.matches("# EOF").count() == 1);
    }

    #[test]
    fn a_tissue_has_what_it_counts() {
        let tissue = Tissue { cut_limits: 3, substeps: 8, corrections: 5, ..Tissue::default() };
        let text = text(&Look { tissue: Some(tissue), ..Look::default() });
        for line in [
            "hystation_tissue_cut_limits_total 3",
            "hystation_tissue_corrections_total 5",
            "hystation_tissue_hits_dropped_total 0",
            "hystation_tissue_substeps 8.0",
        ] {
            assert!(text.lines().any(|found| found == line), "{line}\n{text}");
        }
    }

    #[test]
    fn a_recording_that_stands_still_has_what_it_holds_and_what_is_lost() {
        let stands_still = Some("no room".to_string());
        let room = Recording { free_bytes: Some(9_000), lasts_s: Some(4.5), ..Recording::default() };
        let recording = Recording { ticks: 900, lost: 70, bytes: 5_000, behind_ticks: 334, stands_still, ..room };
        let status = |recording| Status { recording: Some(recording), ..Status::default() };
        let text_of = |recording| text(&Look { status: status(recording), ..Look::default() });
        let text = text_of(recording);
        for line in [
            "hystation_recorder_stands_still 1.0",
            "hystation_recorder_lost_ticks 70.0",
            "hystation_recorder_behind_ticks 334.0",
            "hystation_recorder_ticks 900.0",
            "hystation_recorder_bytes 5000.0",
            "hystation_recorder_free_bytes 9000.0",
            "hystation_recorder_room_seconds 4.5",
            "# UNIT hystation_recorder_lost_ticks ticks",
            "# UNIT hystation_recorder_bytes bytes",
            "# UNIT hystation_recorder_room_seconds seconds",
        ] {
            assert!(text.lines().any(|found| found == line), "{line}\n{text}");
        }
        let unknown = text_of(Recording::default());
        assert!(unknown.contains("hystation_recorder_stands_still 0.0\n") && !unknown.contains("recorder_free"), "{unknown}");
    }

    /// Rates and ages of processes stood there for as long as their supervisor was gone, as if they were measured.
    #[test]
    fn what_a_supervisor_said_that_is_silent_by_now_is_not_said_again_and_what_engines_say_is() {
        let process = Process { name: "device".into(), state: "live".into(), rate_hz: Some(1_000.0), ..Process::default() };
        let status = Status { processes: vec![process], recording: Some(Recording::default()), ..Status::default() };
        let heard = Look { status, pump: Some(Pump::default()), ..Look::default() };
        let silent = Look { silence: Some("no supervisor answers".into()), ..heard.clone() };
        let [heard, silent] = [heard, silent].map(|look| text(&look));
        for (words, is_of_supervisor) in
            [("_running ", true), ("process_up{", true), ("recorder_ticks ", true), ("pump_deficit", false)]
        {
            assert_eq!((heard.contains(words), silent.contains(words)), (true, !is_of_supervisor), "{words}\n{silent}");
        }
    }

    #[test]
    fn a_station_of_which_nothing_is_known_has_a_text_too() {
        let text = text(&Look { silence: Some("no supervisor answers".into()), ..Look::default() });
        assert!(text.contains("hystation_supervisor_answers 0.0\n") && text.ends_with("# EOF\n"), "{text}");
        assert!(!text.contains("hystation_running") && !text.contains("hystation_tick"), "nobody was asked\n{text}");
        assert!(!text.contains("rendering_"), "nobody draws\n{text}");
        assert!(!text.contains("recorder_"), "nobody records\n{text}");
        assert!(!text.contains("tissue_"), "nobody computes\n{text}");
    }
}
