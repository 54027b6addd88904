//! What is known of the station now, for a monitor: the text format of OpenMetrics 1.0. Promise: one exposition, ended by `# EOF`; what is not known is
//! left out.

use crate::look::Look;
use hyst_messages::{PUMP_ALARMS, Slot};
use prometheus_client::encoding::text::encode;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::registry::Registry;
use std::sync::atomic::AtomicU64;

/// The media type of [`text`].
pub const CONTENT_TYPE: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";

type Labels = Vec<(&'static str, String)>;
type Figure = Gauge<f64, AtomicU64>;
type Figures = Family<Labels, Figure>;

/// The whole text.
pub fn text(look: &Look) -> String {
    let mut registry = Registry::with_prefix("hystation");
    station(look, &mut registry);
    processes(look, &mut registry);
    pump(look, &mut registry);
    let mut text = String::new();
    match encode(&mut text, &registry) {
        Ok(()) => text,
        Err(_) => "# EOF\n".into(), // a string takes everything
    }
}

fn figure(registry: &mut Registry, name: &str, help: &str, value: f64) {
    let figure = Figure::default();
    figure.set(value);
    registry.register(name, help, figure);
}

fn station(look: &Look, registry: &mut Registry) {
    let is = |value: bool| f64::from(u8::from(value));
    figure(registry, "tick", "The station's present tick, one in each millisecond", look.status.tick as f64);
    figure(registry, "running", "Whether the station runs", is(look.status.state == "running"));
    figure(registry, "test_mode", "Whether faults may be injected", is(look.status.test_mode));
    figure(registry, "roles_held", "Roles that are held still", look.status.held.len() as f64);
    figure(registry, "supervisor_answers", "Whether the supervisor answered when it was last asked", is(look.silence.is_none()));
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
            Some(f64::from(u8::from(is_up))),
            Some(f64::from(u8::from(process.active))),
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
        registry.register(name, help, figures);
    }
    registry.register("process_restarts", "Restarts of its slot after faults", restarts);
}

fn pump(look: &Look, registry: &mut Registry) {
    let Some(pump) = &look.pump else { return };
    figure(registry, "pump_pressure_mmhg", "Pressure in the cavity, mmHg", pump.pressure_mmhg);
    figure(registry, "pump_inflow_milliliters_per_minute", "Flow into the cavity", pump.inflow_ml_min);
    figure(registry, "pump_outflow_milliliters_per_minute", "Flow out of the cavity", pump.outflow_ml_min);
    figure(registry, "pump_deficit_milliliters", "Volume in minus volume out since the start", pump.deficit_ml);
    figure(registry, "pump_cavity_milliliters", "Volume of the cavity", pump.cavity_ml);
    figure(registry, "pump_bled_milliliters", "Blood that has come into the cavity since the start", pump.bled_ml);
    let alarms = Figures::default();
    for (_, name) in PUMP_ALARMS {
        let is_on = pump.alarms.iter().any(|alarm| alarm == name);
        alarms.get_or_create(&vec![("alarm", name.to_string())]).set(f64::from(u8::from(is_on)));
    }
    registry.register("pump_alarm", "Alarms of the pump", alarms);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::look::{Process, Pump, Status};

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
        let status = Status { tick: 1_234, state: "running".into(), processes: vec![process], ..Status::default() };
        let pump = Pump { deficit_ml: 12.5, bled_ml: 1.5, alarms: vec!["deficit".into()], ..Pump::default() };
        let text = text(&Look { status, silence: None, pump: Some(pump) });
        for line in [
            "hystation_tick 1234.0",
            "hystation_supervisor_answers 1.0",
            "hystation_process_up{process=\"haptic:1\",role=\"haptic\"} 1.0",
            "hystation_process_active{process=\"haptic:1\",role=\"haptic\"} 0.0",
            "hystation_process_rate_hertz{process=\"haptic:1\",role=\"haptic\"} 999.5",
            "hystation_process_restarts_total{process=\"haptic:1\",role=\"haptic\"} 3",
            "hystation_pump_deficit_milliliters 12.5",
            "hystation_pump_bled_milliliters 1.5",
            "hystation_pump_alarm{alarm=\"deficit\"} 1.0",
            "hystation_pump_alarm{alarm=\"pressure\"} 0.0",
        ] {
            assert!(text.lines().any(|found| found == line), "{line}\n{text}");
        }
        let wakeup = text.lines().find_map(|line| line.strip_prefix("hystation_process_wakeup_p99_seconds{")).unwrap();
        let value: f64 = wakeup.rsplit(' ').next().unwrap().parse().unwrap();
        assert!((value - 50e-6).abs() < 1e-12, "{wakeup}");
        assert!(!text.contains("process_loop_p99_seconds{"), "it is not known\n{text}");
        assert!(text.ends_with("# EOF\n") && text.matches("# EOF").count() == 1);
    }

    #[test]
    fn a_station_of_which_nothing_is_known_has_a_text_too() {
        let text = text(&Look { silence: Some("no supervisor answers".into()), ..Look::default() });
        assert!(text.contains("hystation_supervisor_answers 0.0\n") && text.ends_with("# EOF\n"), "{text}");
    }
}
