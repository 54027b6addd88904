//! The report for programs. Numbers are not rounded; what is not recorded is `null`.

use crate::absent::ABSENT;
use crate::columns::{Column, Sessions, seconds, word};
use crate::judge::Judge;
use crate::losses::losses;
use crate::markup::plain;
use crate::metric::{Group, Metric};
use crate::processes::ProcessSum;
use crate::table::OF_THE_TASK;
use hyst_messages::{FLOW_FLAWS, PUMP_ALARMS};
use hyst_recording::{Event, Picture};
use serde_json::{Map, Value, json};

/// Number of this form of a report: what is added leaves it, what is renamed or means something else raises it. In form 1 no score knew of the goals, the
/// alarms of the pump stood under `station`, and what the loop burnt of the wall was `removed`, too. In form 2 the time of a case's session, and shares of
/// it, counted from the first tick. In form 3 goals weighed alike and nothing counted of one that was open, notices and time were warnings, one tick of current
/// was enough to judge the view by, and a camera head that was kept level had a score. In form 4 the volume that was `removed` was one of safety, as if to
/// remove what is to be removed were a harm, and the pump's roller beat in the shares and the peak of the pressure. In form 5 the force of the medium on the
/// scope was one of touching.
const FORMAT: u32 = 6;

/// The session that is reported, and under `compared` the earlier ones.
pub fn json(sessions: &Sessions) -> Value {
    let mut value = session(&sessions.reported);
    value["format"] = json!(FORMAT);
    let absent = ABSENT.iter().map(|(group, what, why)| json!({"group": group.name(), "what": what, "why": why}));
    value["absent"] = absent.collect();
    let compared = |column: &Column| {
        let mut value = session(column);
        value["is_of_same_anatomy"] = json!(column.is_of_same_anatomy(&sessions.reported));
        value["is_of_same_device"] = json!(column.is_of_same_device(&sessions.reported));
        value["is_judged_alike"] = json!(column.is_judged_alike(&sessions.reported));
        value
    };
    value["compared"] = sessions.earlier.iter().map(compared).collect();
    value
}

fn session(column: &Column) -> Value {
    let assessment = &column.assessment;
    let scores = &column.scores;
    let groups: Map<String, Value> =
        Group::ALL.iter().zip(scores.groups).map(|(group, score)| (group.name().to_string(), json!(score))).collect();
    json!({
        "file": column.file,
        "session": assessment.session,
        "length_s": seconds(assessment.measured.conduct.length_ticks()),
        "is_whole": assessment.missing().is_empty(),
        "missing": assessment.missing(),
        "case": assessment.measured.judge.as_ref().map(Judge::json),
        "score": scores.total,
        "goals_share": scores.done,
        "groups": groups,
        "costs_most": losses(scores).iter().map(|loss| json!({"key": loss.metric.definition.key, "of_100": loss.points})).collect::<Value>(),
        "metrics": scores.metrics.iter().map(metric).collect::<Value>(),
        "pictures": assessment.measured.pictures.iter().map(|picture| of_picture(column, picture)).collect::<Value>(),
        "pump_alarms": counts(&PUMP_ALARMS, &assessment.measured.medium.alarms),
        "pump_alarmed": assessment.measured.medium.told.iter().map(|alarm| alarmed(column, *alarm)).collect::<Value>(),
        "station": station(column),
    })
}

fn metric(metric: &Metric) -> Value {
    let definition = metric.definition;
    let scale = metric.scale;
    json!({
        "key": definition.key,
        "name": definition.name,
        "group": definition.group.name(),
        "unit": definition.unit,
        "value": metric.value,
        "score": metric.score,
        "full_at": scale.map(|scale| scale.full),
        "zero_at": scale.map(|scale| scale.none),
        "weight": scale.map(|scale| scale.weight),
        "source": metric.source,
        "times_goals_share": OF_THE_TASK.contains(&definition.key),
    })
}

/// When a picture was drawn and what for; the picture itself is in the recording and on the page.
fn of_picture(column: &Column, picture: &Picture) -> Value {
    json!({
        "tick": picture.tick,
        "event_tick": picture.event_tick,
        "time_s": seconds(column.assessment.measured.conduct.since_start(picture.event_tick)),
        "words": plain(&picture.words),
        "bytes": picture.jpeg.len(),
    })
}

/// An alarm or a notice of the pump, and when it came up.
fn alarmed(column: &Column, (index, tick): (usize, u64)) -> Value {
    let time_s = seconds(column.assessment.measured.conduct.since_start(tick));
    json!({ "alarm": PUMP_ALARMS.get(index).map(|(_, name)| name), "tick": tick, "time_s": time_s })
}

fn station(column: &Column) -> Value {
    let measured = &column.assessment.measured;
    let conduct = &measured.conduct;
    let [fresh, held, ramped, zero, unknown] = conduct.kinds;
    let event = |event: &Event| {
        json!({
            "tick": event.tick,
            "time_s": seconds(conduct.since_start(event.tick)),
            "level": word(event.level),
            "kind": event.kind,
            "process": event.process,
            "incarnation": event.incarnation,
            "text": event.text,
        })
    };
    let flaws = counts(&FLOW_FLAWS, &measured.medium.flaws);
    let processes: Map<String, Value> =
        conduct.processes.all().map(|(name, process)| (name.to_string(), process_json(process))).collect();
    json!({
        "first_tick": conduct.first_tick,
        "last_tick": conduct.first_tick.map(|_| conduct.last_tick),
        "ticks": conduct.ticks,
        "missing": conduct.missing,
        "gaps": conduct.gaps,
        "longest_gap": conduct.longest_gap.map(|gap| json!({"first": gap.first, "last": gap.last})),
        "lost": conduct.lost,
        "repeated": conduct.repeated,
        "not_finite": conduct.not_finite,
        "kinds": {"fresh": fresh, "held": held, "ramped": ramped, "zero": zero, "unknown": unknown},
        "device_max_force_n": measured.device_max_n,
        "force_step_max_n": conduct.largest_step.map(|step| step.value),
        "force_step_max_tick": conduct.largest_step.map(|step| step.tick),
        "takeovers": conduct.takeovers,
        "servo_changes": conduct.servo_changes,
        "warnings": conduct.warnings,
        "errors": conduct.errors,
        "flow_flaws": flaws,
        "processes": processes,
        "events": conduct.events.iter().map(event).collect::<Value>(),
        "events_left_out": conduct.events_left_out,
    })
}

/// Counts by their names.
fn counts(names: &[(u32, &str)], counts: &[u64]) -> Map<String, Value> {
    names.iter().zip(counts).map(|((_, name), count)| (name.to_string(), json!(count))).collect()
}

fn process_json(process: &ProcessSum) -> Value {
    json!({
        "incarnations": process.incarnations,
        "steps": process.steps,
        "overruns": process.overruns,
        "rate_hz": process.rate_hz(),
        "wakeup_p99_us_largest": process.wakeup_p99_us,
        "loop_p50_us_mean": process.loop_p50_us(),
        "loop_p99_us_largest": process.loop_p99_us,
    })
}
