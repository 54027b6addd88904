//! The curves of the page over time with goals, warnings, alarms, current and the station's events, as SVG in plain text. Every coordinate is rounded to a
//! tenth of a pixel; what is drawn has a bound, whatever the length of the recording.

use crate::assess::Measured;
use crate::clarity::CLEAR_SHARE;
use crate::columns::{Column, number, seconds, word};
use crate::curves::{Curves, Series};
use crate::force::LIMIT_N;
use crate::markup::{escape, plain, wide};
use crate::medium::{HIGH_PA, LOW_PA};
use hyst_messages::{PA_PER_MMHG, PUMP_ALARMS};
use hyst_recording::{SAID, STATED};
use std::fmt::Write;

/// Width of the curves, and left and right of them, px.
const WIDTH: f64 = 960.0;
const LEFT: f64 = 58.0;
const RIGHT: f64 = 14.0;
/// Height of a curve, of its title above it, and of the axis below the last, px.
const HEIGHT: f64 = 96.0;
const TITLE: f64 = 24.0;
const FOOT: f64 = 38.0;
/// Height of the bars on the axis that say when there was current, px.
const BAR: f64 = 6.0;
/// Most events of the station that are marked.
const MOST_MARKS: usize = 300;
/// Statuses come some twenty times a second; the curve goes on over a second without one, and is interrupted then, ticks.
const STATUS_TICKS: u64 = 1_000;
/// One of the curves.
struct Curve<'a> {
    title: &'static str,
    class: &'static str,
    series: &'a Series,
    /// From the series' unit to the shown one.
    factor: f64,
    /// It goes on over so many ticks without a value.
    bridge_ticks: u64,
    /// Whether the axis has the zero.
    from_zero: bool,
    /// A range that is to be kept, in the shown unit.
    band: Option<[f64; 2]>,
    /// A value that is not to be exceeded, in the shown unit.
    limit: Option<f64>,
}

/// The curves of a session over its time, one below the other, with what the trainee did and was told, and the faults and takeovers.
pub(crate) fn curves(column: &Column) -> String {
    let measured = &column.assessment.measured;
    let curves: Vec<Curve<'_>> = all(&measured.curves).into_iter().filter(|curve| curve.series.range().is_some()).collect();
    if curves.is_empty() {
        return "<p class=\"note\">Nothing that could be drawn over time is recorded.</p>\n".into();
    }
    let length_ticks = measured.conduct.length_ticks().max(1);
    let bottom = curves.len() as f64 * (TITLE + HEIGHT);
    let mut svg = String::new();
    times(&mut svg, seconds(length_ticks), bottom);
    for (at, curve) in curves.iter().enumerate() {
        draw(&mut svg, curve, at as f64 * (TITLE + HEIGHT) + TITLE, length_ticks);
    }
    marks(&mut svg, column, length_ticks, bottom);
    current(&mut svg, &measured.curves.current, length_ticks, bottom);
    let height = bottom + FOOT;
    let told: Vec<String> = curves.iter().filter_map(told).collect();
    format!(
        "{}<svg class=\"over-time\" viewBox=\"0 0 {WIDTH} {height}\" role=\"img\" aria-label=\"over {:.0} s: {}\">{svg}</svg></div>\n",
        wide("Curves over time"),
        seconds(length_ticks),
        told.join("; ")
    )
}

/// What a curve says to whoever does not see it.
fn told(curve: &Curve) -> Option<String> {
    let [least, largest] = curve.series.range()?.map(|value| number(value * curve.factor));
    Some(format!("{} from {least} to {largest}", curve.title))
}

fn all(curves: &Curves) -> [Curve<'_>; 6] {
    let plain = |title, class, series| Curve {
        title,
        class,
        series,
        factor: 1.0,
        bridge_ticks: STATUS_TICKS,
        from_zero: true,
        band: None,
        limit: None,
    };
    let to_mmhg = PA_PER_MMHG.recip();
    [
        Curve { bridge_ticks: 0, limit: Some(LIMIT_N), ..plain("force on the hand, N", "force", &curves.force_n) },
        Curve { bridge_ticks: 0, factor: 1e3, from_zero: false, ..plain("insertion, mm", "insertion", &curves.insertion_m) },
        Curve {
            factor: to_mmhg,
            band: Some([LOW_PA * to_mmhg, HIGH_PA * to_mmhg]),
            ..plain("pressure in the cavity, mmHg, with the roller's beat", "pressure", &curves.pressure_pa)
        },
        Curve {
            factor: 100.0,
            band: Some([100.0 * CLEAR_SHARE, 100.0]),
            ..plain("light that comes through the blood, %", "light", &curves.transmittance)
        },
        plain("deficit, ml", "deficit", &curves.deficit_ml),
        plain("volume removed, ml", "removed", &curves.removed_ml),
    ]
}

/// The place of a time, ticks.
fn x_of(ticks: f64, length_ticks: u64) -> f64 {
    LEFT + (ticks / length_ticks as f64).clamp(0.0, 1.0) * (WIDTH - LEFT - RIGHT)
}

/// The axis of the time, through all curves.
fn times(svg: &mut String, length_s: f64, bottom: f64) {
    for time_s in steps(0.0, length_s, 8) {
        let x = LEFT + time_s / length_s * (WIDTH - LEFT - RIGHT);
        let _ = write!(
            svg,
            "<line x1=\"{x:.1}\" y1=\"{TITLE}\" x2=\"{x:.1}\" y2=\"{bottom:.1}\" class=\"grid\"/>\
             <text x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
            bottom + 15.0,
            tidy(time_s)
        );
    }
    let (x, y) = (0.5 * (LEFT + WIDTH - RIGHT), bottom + 31.0);
    let _ = write!(
        svg,
        "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"middle\">seconds since the first tick of the recording</text>"
    );
}

fn draw(svg: &mut String, curve: &Curve, top: f64, length_ticks: u64) {
    let Some([least, largest]) = curve.series.range().map(|range| range.map(|value| value * curve.factor)) else { return };
    let low = if curve.from_zero { least.min(0.0) } else { least };
    let high = curve.band.map_or(largest, |band| largest.max(band[1]));
    let high = if high - low < 1e-9 { low + 1.0 } else { high };
    let y_of = |value: f64| top + HEIGHT - ((value - low) / (high - low)).clamp(0.0, 1.0) * HEIGHT;
    let right = WIDTH - RIGHT;
    let _ = write!(svg, "<text x=\"{LEFT}\" y=\"{:.1}\" class=\"title\">{}</text>", top - 7.0, curve.title);
    if let Some([from, to]) = curve.band.map(|band| band.map(y_of)) {
        let (width, height) = (right - LEFT, from - to);
        let _ = write!(svg, "<rect x=\"{LEFT}\" y=\"{to:.1}\" width=\"{width:.1}\" height=\"{height:.1}\" class=\"band\"/>");
    }
    for value in steps(low, high, 4) {
        let y = y_of(value);
        let _ = write!(
            svg,
            "<line x1=\"{LEFT}\" y1=\"{y:.1}\" x2=\"{right}\" y2=\"{y:.1}\" class=\"grid\"/>\
             <text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
            LEFT - 6.0,
            y + 4.0,
            tidy(value)
        );
    }
    if let Some(limit) = curve.limit.filter(|limit| (low..=high).contains(limit)) {
        let y = y_of(limit);
        let _ = write!(
            svg,
            "<line x1=\"{LEFT}\" y1=\"{y:.1}\" x2=\"{right}\" y2=\"{y:.1}\" class=\"limit\"><title>stay below {limit}: {}</title></line>",
            curve.title
        );
    }
    let span_ticks = curve.series.span_ticks();
    let middle = |at: usize| x_of((at as f64 + 0.5) * span_ticks as f64, length_ticks);
    let bridge = (curve.bridge_ticks / span_ticks) as usize + 1;
    let _ = write!(svg, "<path class=\"curve {}\" d=\"{}\"/>", curve.class, area(curve, bridge, middle, y_of));
    let _ = write!(svg, "<rect x=\"{LEFT}\" y=\"{top:.1}\" width=\"{:.1}\" height=\"{HEIGHT}\" class=\"frame\"/>", right - LEFT);
}

/// What lies between the least and the largest values; interrupted where spans are further apart than the bridge.
fn area(curve: &Curve, bridge: usize, x_of: impl Fn(usize) -> f64, y_of: impl Fn(f64) -> f64) -> String {
    let mut runs: Vec<Vec<(usize, [f64; 2])>> = Vec::new();
    for (at, span) in curve.series.spans() {
        match runs.last_mut() {
            Some(run) if run.last().is_some_and(|(last, _)| at - last <= bridge) => run.push((at, span)),
            _ => runs.push(vec![(at, span)]),
        }
    }
    let mut path = String::new();
    for run in runs {
        let upper = run.iter().map(|(at, span)| (*at, span[1]));
        let lower = run.iter().rev().map(|(at, span)| (*at, span[0]));
        for (index, (at, value)) in upper.chain(lower).enumerate() {
            let command = if index == 0 { 'M' } else { 'L' };
            let _ = write!(path, "{command}{:.1} {:.1}", x_of(at), y_of(value * curve.factor));
        }
        path.push('Z');
    }
    path
}

/// What is marked: when, which class, in which words.
type Mark = (u64, &'static str, String);

/// What the trainee did and was told, and the faults and takeovers, through all curves.
fn marks(svg: &mut String, column: &Column, length_ticks: u64, bottom: f64) {
    let conduct = &column.assessment.measured.conduct;
    // What the supervisor says of them stands in the table, and which device it was.
    let faults = conduct.events.iter().filter(|event| ![SAID, STATED].contains(&event.kind.as_str()));
    let faults = faults.map(|event| (event.tick, word(event.level), event.text.clone()));
    for (tick, class, words) in of_session(&column.assessment.measured).into_iter().chain(faults.take(MOST_MARKS)) {
        let since_ticks = conduct.since_start(tick);
        let x = x_of(since_ticks as f64, length_ticks);
        let _ = write!(
            svg,
            "<line x1=\"{x:.1}\" y1=\"{TITLE}\" x2=\"{x:.1}\" y2=\"{bottom:.1}\" class=\"mark {class}\"><title>{:.3} s: {}</title></line>",
            seconds(since_ticks),
            escape(&plain(&words))
        );
    }
}

/// Goals that were reached, warnings of the case, alarms and notices of the pump: each list has its bound.
fn of_session(measured: &Measured) -> Vec<Mark> {
    let mut marks = Vec::new();
    if let Some(judge) = &measured.judge {
        let goals = judge.brief.goals.iter().zip(&judge.goals);
        marks.extend(goals.filter_map(|(goal, state)| Some((state.reached_tick?, "goal", format!("reached: {}", goal.words)))));
        let warned = |(index, tick): &(usize, u64)| {
            let warned = judge.brief.warnings.get(*index)?;
            Some((*tick, "warned", format!("{}: {}", warned.kind(), warned.words)))
        };
        marks.extend(judge.told.iter().filter_map(warned));
    }
    let alarm = |index: usize| PUMP_ALARMS.get(index).map_or("", |(_, name)| *name);
    marks.extend(measured.medium.told.iter().map(|(index, tick)| (*tick, "alarm", format!("the pump: {}", alarm(*index)))));
    marks
}

/// When there was current in the loop, as bars on the axis of the time.
fn current(svg: &mut String, current: &Series, length_ticks: u64, bottom: f64) {
    let span_ticks = current.span_ticks();
    let mut runs: Vec<[usize; 2]> = Vec::new();
    for (at, _) in current.spans() {
        match runs.last_mut() {
            Some([_, end]) if *end == at => *end = at + 1,
            _ => runs.push([at, at + 1]),
        }
    }
    for run in runs {
        let [from, to] = run.map(|at| (at as u64).saturating_mul(span_ticks).min(length_ticks));
        let [left, right] = [from, to].map(|ticks| x_of(ticks as f64, length_ticks));
        let _ = write!(
            svg,
            "<rect x=\"{left:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{BAR}\" class=\"current\"><title>current from {:.1} s to {:.1} s</title></rect>",
            bottom - BAR,
            (right - left).max(1.0),
            seconds(from),
            seconds(to)
        );
    }
}

/// Round numbers from `low` to `high`: 1, 2 or 5 times a power of ten apart, at most `most` steps.
pub(crate) fn steps(low: f64, high: f64, most: u32) -> Vec<f64> {
    let raw = (high - low) / f64::from(most);
    if !raw.is_finite() || raw <= 0.0 {
        return Vec::new();
    }
    let power = 10f64.powf(raw.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].map(|factor| factor * power).into_iter().find(|step| *step >= raw).unwrap_or(10.0 * power);
    let first = (low / step).ceil();
    (0..=most).map(|index| (first + f64::from(index)) * step).filter(|value| *value <= high + 1e-9 * step).collect()
}

/// A round number as people write it.
pub(crate) fn tidy(value: f64) -> String {
    let rounded = (value * 1e6).round() / 1e6;
    if rounded == 0.0 { "0".into() } else { rounded.to_string() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_round_and_few() {
        assert_eq!(steps(0.0, 61.2, 8), [0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0]);
        assert_eq!(steps(-3.0, 11.0, 4).into_iter().map(tidy).collect::<Vec<_>>(), ["0", "5", "10"]);
        assert_eq!(steps(0.0, 0.3, 4).into_iter().map(tidy).collect::<Vec<_>>(), ["0", "0.1", "0.2", "0.3"]);
        assert!(steps(1.0, 1.0, 4).is_empty() && steps(f64::NAN, 1.0, 4).is_empty() && steps(0.0, 1e300, 8).len() <= 9);
    }

    #[test]
    fn a_curve_is_interrupted_where_nothing_is_known() {
        let mut series = Series::default();
        [0, 1, 5, 6].iter().for_each(|tick| series.add(*tick, *tick as f64));
        let (title, class, band) = ("", "", None);
        let curve = Curve { title, class, series: &series, factor: 2.0, bridge_ticks: 0, from_zero: true, band, limit: None };
        let path = area(&curve, 1, |at| at as f64, |value| value);
        assert_eq!(path, "M0.0 0.0L1.0 2.0L1.0 2.0L0.0 0.0ZM5.0 10.0L6.0 12.0L6.0 12.0L5.0 10.0Z");
        assert_eq!(area(&curve, 4, |at| at as f64, |value| value).matches('M').count(), 1);
    }
}
