//! The table of the metrics: what is shown and scored where no case says otherwise, and where that comes from.

use crate::clarity::CLEAR_SHARE;
use crate::force::LIMIT_N;
use crate::judge::Judge;
use crate::medium::{BLEEDS_ML_MIN, HIGH_PA, LOW_PA, PARTED_PA};
use crate::metric::{Definition, Group, scale, share, shown};
use hyst_messages::PA_PER_MMHG;

const ASSUMED: &str = "assumed";
const HEAD_HELD: &str = "assumed; nothing where the scope is not turned, or the head is kept level for it";

/// The defaults. The groups, and that path length, time and camera alignment separate novices from experts best (so they weigh 2), are Bajka et al. 2010.
/// The pressures are those of `medium` (WOM's manual; ACOG Committee Opinion 800), the limit of the deficit is ACOG's for hypotonic media, which is
/// the strictest (1 000 ml; 2 500 ml for isotonic saline), the loss of 300 ml/min is the pump's alarm, 3.3 N is the most that the station commands. What is
/// marked as assumed has no published figure: it is this station's guess at a short diagnostic or polyp case, and a course will want its own.
pub static METRICS: [Definition; 42] = [
    Definition {
        group: Group::Visualisation,
        key: "distended",
        name: "time with the walls parted (40 mmHg or more)",
        unit: "%",
        scale: scale(95.0, 50.0, 2.0),
        value: |m| share(m.medium.parted_ticks, m.medium.known_ticks),
        source: "walls part at a median of 40 mmHg, in the mean of 1 s; shares assumed",
    },
    Definition {
        group: Group::Visualisation,
        key: "dark",
        name: "time without light",
        unit: "%",
        scale: scale(0.0, 10.0, 1.0),
        value: |m| share(m.medium.dark_ticks, m.medium.valve_ticks),
        source: ASSUMED,
    },
    Definition {
        group: Group::Visualisation,
        key: "outflow_shut",
        name: "time with the outflow shut: nothing rinses",
        unit: "%",
        scale: scale(5.0, 50.0, 1.0),
        value: |m| share(m.medium.shut_ticks, m.medium.valve_ticks),
        source: ASSUMED,
    },
    Definition {
        group: Group::Visualisation,
        key: "bleeding",
        name: "time while it bled faster than 1 ml/min",
        unit: "%",
        scale: scale(5.0, 50.0, 1.0),
        value: |m| share(m.medium.bleeding_ticks, m.medium.bled_known_ticks),
        source: "1 ml/min: the case of a bleeding; shares assumed",
    },
    Definition {
        group: Group::Visualisation,
        key: "clear_view",
        name: "time with a clear view (half of the light)",
        unit: "%",
        scale: scale(95.0, 50.0, 1.0),
        value: |m| share(m.medium.clarity.clear_ticks, m.medium.clarity.known_ticks),
        source: "light through the blood, over 20 mm or to the wall; shares assumed",
    },
    shown(Group::Visualisation, "view_lost", "longest time without a clear view", "s", |m| {
        m.medium.clarity.longest_known_ticks().map(|ticks| ticks as f64 * 1e-3)
    }),
    shown(Group::Visualisation, "transmittance", "light that comes through the blood, mean", "%", |m| {
        m.medium.clarity.mean_share().map(|share| 100.0 * share)
    }),
    Definition {
        group: Group::Visualisation,
        key: "landmarks",
        name: "landmarks of the case that were looked at",
        unit: "%",
        scale: scale(100.0, 0.0, 2.0),
        value: |m| m.judge.as_ref().and_then(Judge::landmarks_percent),
        source: ASSUMED,
    },
    Definition {
        group: Group::Visualisation,
        key: "in_view",
        name: "time under current with pathology in view",
        unit: "%",
        scale: scale(90.0, 30.0, 2.0),
        value: |m| share(m.in_view.counted().0, m.in_view.counted().1),
        source: "in the picture, within 25 mm; of less than 1 s of current the whole time; shares assumed",
    },
    Definition {
        group: Group::Ergonomics,
        key: "time",
        name: "time",
        unit: "s",
        scale: scale(120.0, 600.0, 2.0),
        value: |m| m.conduct.first_tick.map(|_| m.session_ticks() as f64 * 1e-3),
        source: ASSUMED,
    },
    Definition {
        group: Group::Ergonomics,
        key: "path",
        name: "path of the tip",
        unit: "m",
        scale: scale(0.5, 3.0, 2.0),
        value: |m| m.motion.path_m(),
        source: ASSUMED,
    },
    Definition {
        group: Group::Ergonomics,
        key: "economy",
        name: "economy: what the path spans, by its length",
        unit: "%",
        scale: scale(8.4, 1.4, 1.0),
        value: |m| m.motion.economy().map(|economy| 100.0 * economy),
        source: "of 42 mm, what a way through the cavity spans, by the two paths: assumed",
    },
    shown(Group::Ergonomics, "speed_mean", "mean speed of the tip", "mm/s", |m| {
        m.motion.speed_m_s().map(|speed_m_s| 1e3 * speed_m_s)
    }),
    Definition {
        group: Group::Ergonomics,
        key: "speed_peak",
        name: "highest speed of the tip",
        unit: "mm/s",
        scale: scale(60.0, 250.0, 1.0),
        value: |m| m.motion.fastest_m_s().map(|speed_m_s| 1e3 * speed_m_s),
        source: ASSUMED,
    },
    Definition {
        group: Group::Ergonomics,
        key: "idle",
        name: "time at rest (below 1 mm/s)",
        unit: "%",
        scale: scale(20.0, 70.0, 1.0),
        value: |m| share(m.motion.idle_ticks().0, m.motion.idle_ticks().1),
        source: ASSUMED,
    },
    Definition {
        group: Group::Ergonomics,
        key: "camera_turned",
        name: "turning of the camera head, in all",
        unit: "°",
        scale: scale(180.0, 1_440.0, 1.0),
        value: |m| m.motion.turned_rad().map(f64::to_degrees),
        source: HEAD_HELD,
    },
    Definition {
        group: Group::Ergonomics,
        key: "horizon_tilt",
        name: "camera alignment: mean tilt of the horizon",
        unit: "°",
        scale: scale(10.0, 45.0, 2.0),
        value: |m| m.motion.tilt_rad().map(f64::to_degrees),
        source: HEAD_HELD,
    },
    Definition {
        group: Group::Safety,
        key: "touching",
        name: "time in which the tool touches",
        unit: "%",
        scale: scale(30.0, 90.0, 1.0),
        value: |m| share(m.force.touching_ticks, m.force.ticks),
        source: "from 0.05 N on that the medium alone does not make; shares assumed",
    },
    Definition {
        group: Group::Safety,
        key: "force_peak",
        name: "largest force",
        unit: "N",
        scale: scale(1.0, 3.3, 2.0),
        value: |m| m.force.peak.map(|peak| peak.value),
        source: "0 % at the most that the station commands; 1 N assumed",
    },
    Definition {
        group: Group::Safety,
        key: "force_p95",
        name: "force exceeded for 5 % of the time at most",
        unit: "N",
        scale: scale(0.5, 2.0, 2.0),
        value: |m| m.force.percentile_n(0.95),
        source: ASSUMED,
    },
    Definition {
        group: Group::Safety,
        key: "force_above_limit",
        name: "time above 1.65 N",
        unit: "%",
        scale: scale(0.0, 5.0, 2.0),
        value: |m| share(m.force.above_ticks, m.force.ticks),
        source: "half of the most that the station commands; shares assumed",
    },
    Definition {
        group: Group::Safety,
        key: "perforations",
        name: "alarms of a perforation of the wall",
        unit: "",
        scale: scale(0.0, 1.0, 4.0),
        value: |m| m.medium.newest().map(|_| m.medium.perforation_count() as f64),
        source: "one is one too many; weight assumed",
    },
    shown(Group::Safety, "energised", "time with the current that cuts in the loop", "s", |m| {
        (m.conduct.ticks > 0).then_some(m.electrode.energised_ticks as f64 * 1e-3)
    }),
    Definition {
        group: Group::Safety,
        key: "energised_free",
        name: "cutting current with nothing touched or cut",
        unit: "%",
        scale: scale(20.0, 80.0, 2.0),
        value: |m| share(m.electrode.free_ticks, m.electrode.energised_ticks),
        source: ASSUMED,
    },
    shown(Group::Safety, "coagulated", "time with the coagulating current", "s", |m| {
        (m.conduct.ticks > 0).then_some(m.electrode.coagulating_ticks as f64 * 1e-3)
    }),
    shown(Group::Safety, "cuts", "strokes of the loop that cut", "", |m| m.tissue.map(|status| f64::from(status.cuts))),
    shown(Group::Safety, "healthy_removed", "volume of healthy tissue taken off", "ml", |m| {
        m.tissue.map(|status| status.healthy_removed_ml)
    }),
    Definition {
        group: Group::Fluid,
        key: "pressure_low",
        name: "time below 35 mmHg (mean of 1 s)",
        unit: "%",
        scale: scale(5.0, 50.0, 1.0),
        value: |m| share(m.medium.low_ticks, m.medium.known_ticks),
        source: "35 mmHg: WOM's manual; shares assumed",
    },
    Definition {
        group: Group::Fluid,
        key: "pressure_high",
        name: "time above 100 mmHg (mean of 1 s)",
        unit: "%",
        scale: scale(0.0, 10.0, 2.0),
        value: |m| share(m.medium.high_ticks, m.medium.known_ticks),
        source: "mean arterial pressure: ACOG; shares assumed",
    },
    Definition {
        group: Group::Fluid,
        key: "pressure_peak",
        name: "highest pressure (mean of 1 s)",
        unit: "mmHg",
        scale: scale(100.0, 150.0, 1.0),
        value: |m| m.medium.highest.map(|peak| peak.value / PA_PER_MMHG),
        source: "mean arterial pressure: ACOG; the pump's range: WOM's manual",
    },
    Definition {
        group: Group::Fluid,
        key: "deficit",
        name: "deficit at the end",
        unit: "ml",
        scale: scale(100.0, 1_000.0, 2.0),
        value: |m| m.medium.deficit_ml,
        source: "1 000 ml: ACOG, hypotonic media; 100 ml assumed",
    },
    Definition {
        group: Group::Fluid,
        key: "deficit_rate",
        name: "steepest rise of the deficit, over 10 s",
        unit: "ml/min",
        scale: scale(50.0, 300.0, 1.0),
        value: |m| m.medium.steepest.map(|peak| peak.value),
        source: "300 ml/min: the pump's alarm; 50 assumed",
    },
    shown(Group::Fluid, "inflow", "medium used", "ml", |m| m.medium.inflow_ml),
    shown(Group::Fluid, "bled", "blood that came into the cavity", "ml", |m| m.medium.bled_ml),
    shown(Group::Fluid, "sealed", "vessels that were coagulated at the end", "", |m| {
        m.medium.newest().map(|status| f64::from(status.sealed_vessels))
    }),
    Definition {
        group: Group::Fluid,
        key: "alarm",
        name: "time with an alarm of the pump",
        unit: "%",
        scale: scale(0.0, 10.0, 1.0),
        value: |m| share(m.medium.alarm_ticks, m.medium.known_ticks),
        source: ASSUMED,
    },
    Definition {
        group: Group::Fluid,
        key: "alarms",
        name: "alarms of the pump",
        unit: "",
        scale: None,
        value: |m| m.medium.newest().map(|_| m.medium.alarm_count() as f64),
        source: "shown, not scored: its time is; the notice of a container that is to be changed counts in neither",
    },
    Definition {
        group: Group::Task,
        key: "goals",
        name: "goals of the case, by what they weigh",
        unit: "%",
        scale: scale(100.0, 0.0, 3.0),
        value: |m| m.judge.as_ref().and_then(Judge::done_percent),
        source: ASSUMED,
    },
    shown(Group::Task, "pathology", "pathology removed", "%", |m| m.removed_percent()),
    shown(Group::Task, "removed", "volume of pathology removed", "ml", |m| m.tissue.map(|status| status.removed_volume_ml)),
    shown(Group::Task, "brought_out", "volume of pieces brought out of the cavity", "ml", |m| {
        m.tissue.map(|status| f64::from(status.washed_out_ml) + f64::from(status.taken_out_ml))
    }),
    Definition {
        group: Group::Task,
        key: "warnings",
        name: "warnings of the case",
        unit: "",
        scale: scale(0.0, 5.0, 1.0),
        value: |m| m.judge.as_ref().map(|judge| judge.warning_count() as f64),
        source: "assumed; notices, and that time has passed, count in none",
    },
];

/// What is good only where the task is done, by the keys of its metrics: who does nothing is quick, and has a short way.
pub const OF_THE_TASK: [&str; 4] = ["time", "path", "economy", "camera_turned"];

// The names in the table say these numbers.
const _: () = assert!(LOW_PA == 35.0 * PA_PER_MMHG && PARTED_PA == 40.0 * PA_PER_MMHG);
const _: () = assert!(HIGH_PA == 100.0 * PA_PER_MMHG && LIMIT_N == 1.65);
const _: () = assert!(BLEEDS_ML_MIN == 1.0 && CLEAR_SHARE == 0.5);
