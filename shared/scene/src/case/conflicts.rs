//! Goals, warnings and ends of a case that cannot all be kept: pressures of which everybody is warned who holds them, those that exclude each other for longer
//! than the session lasts, and what never comes because the session, or a stop, comes first.
//!
//! Refused is only what can never be. A goal that has landmarks looked at asks for a pressure, too: from some pressure on the walls are apart.

use super::brief::{MAX_PRESSURE_PA, deficit_limit_ml};
use super::checks::wrong;
use super::file::{Alarm, Case, Goal};
use crate::error::SceneErrorKind as Kind;
use crate::fluid::{Medium, PA_PER_MMHG};
use crate::validate::Checked;

/// From this pressure on a landmark counts as looked at, Pa: the walls part at a median of 40 mmHg.
pub const LOOKS_FROM_PA: f64 = 40.0 * PA_PER_MMHG;

/// What a goal asks of the pressure.
struct Band {
    /// Which goal it is.
    index: usize,
    /// What it is, as the file has it.
    name: &'static str,
    /// Lowest and highest.
    pa: [f64; 2],
    /// For so long without a break.
    for_s: f64,
}

/// Whether goals, warnings and ends go together, in a medium.
pub(crate) fn compatible(case: &Case, medium: Medium) -> Checked {
    let bands: Vec<Band> = case.goal.iter().enumerate().filter_map(band).collect();
    unwarned(case, &bands)?;
    in_turn(case, bands)?;
    alarmed(case, medium)?;
    staunched(case)
}

fn band((index, goal): (usize, &Goal)) -> Option<Band> {
    match (&goal.pressure, &goal.look) {
        (Some(held), _) => Some(Band { index, name: "pressure", pa: [held.from_pa, held.to_pa], for_s: held.for_s }),
        (None, Some(survey)) => Some(Band { index, name: "look", pa: [LOOKS_FROM_PA, f64::INFINITY], for_s: survey.for_s }),
        (None, None) => None,
    }
}

/// Whether what goals ask of the pressure can be kept by who is warned of nothing, by the rules and by all warnings together. A notice costs nothing.
fn unwarned(case: &Case, bands: &[Band]) -> Checked {
    let mut above = (case.rules.max_pressure_pa.unwrap_or(MAX_PRESSURE_PA), "rules.max_pressure_pa".to_owned());
    let mut below = (0.0, String::new());
    for (index, warning) in case.warning.iter().enumerate().filter(|(_, warning)| !warning.notice) {
        if let Some(pa) = warning.pressure_above_pa.filter(|pa| *pa < above.0) {
            above = (pa, format!("warning[{index}].pressure_above_pa"));
        }
        if let Some(pa) = warning.pressure_below_pa.filter(|pa| *pa > below.0) {
            below = (pa, format!("warning[{index}].pressure_below_pa"));
        }
    }
    for Band { name, pa: [from_pa, to_pa], .. } in bands {
        if from_pa.max(below.0) < to_pa.min(above.0) {
            continue;
        }
        let which = match *name {
            "look" => format!("at which a goal has landmarks looked at, {from_pa:.0} Pa and more"),
            _ => format!("that a goal has held, {from_pa} to {to_pa} Pa"),
        };
        let (key, beside) = match (above.0 <= *from_pa, below.0 < *to_pa) {
            (true, _) => (above.1, String::new()),
            (false, false) => (below.1, String::new()),
            (false, true) => (below.1, format!("beside {} ", above.1)),
        };
        let what = format!("{beside}warns of all pressures {which}");
        return wrong(Kind::Contradiction, key, what, "warn of others, set notice = true, or ask for other pressures");
    }
    Ok(())
}

/// Whether the session is long enough for goals whose pressures exclude each other: they are held one after the other.
fn in_turn(case: &Case, mut bands: Vec<Band>) -> Checked {
    let Some(time_s) = case.end.time_s else { return Ok(()) };
    bands.sort_by(|one, other| one.pa[1].total_cmp(&other.pa[1]));
    // Of all that no two of which overlap and of which this band is the highest: the longest time, s, and the last goal in the file.
    let mut longest: Vec<(f64, &Band)> = Vec::new();
    for highest in &bands {
        let lower = longest.iter().zip(&bands).filter(|(_, lower)| lower.pa[1] < highest.pa[0]).map(|(found, _)| *found);
        let (before_s, last) = lower.max_by(|one, other| one.0.total_cmp(&other.0)).unwrap_or((0.0, highest));
        longest.push((before_s + highest.for_s, if last.index > highest.index { last } else { highest }));
    }
    match longest.into_iter().max_by(|one, other| one.0.total_cmp(&other.0)) {
        Some((for_s, last)) if for_s >= time_s => {
            let what = format!(
                "takes {for_s} s with the other goals whose pressures exclude this one, and the session ends after end.time_s = {time_s}"
            );
            let key = format!("goal[{}].{}.for_s", last.index, last.name);
            wrong(Kind::Contradiction, key, what, "ask for less time, or let the session end later")
        }
        _ => Ok(()),
    }
}

/// Whether the pump's alarm of the deficit comes, where somebody is to heed it: it stands in the same moment as the end by the deficit, so a goal, and a hand
/// that waits, need it before, and a warning may fall with it.
fn alarmed(case: &Case, medium: Medium) -> Checked {
    let alarm_ml = case.rules.max_deficit_ml.unwrap_or(deficit_limit_ml(medium));
    let ends_ml = case.end.deficit_ml.unwrap_or(f64::INFINITY);
    let is_it = |alarm: Option<Alarm>| alarm == Some(Alarm::Deficit);
    let mut waiting = Vec::new();
    for (index, goal) in case.goal.iter().enumerate() {
        if goal.stop.as_ref().is_some_and(|stop| is_it(stop.alarm)) && ends_ml <= alarm_ml {
            waiting.push(format!("goal[{index}].stop.alarm"));
        }
    }
    for (index, warning) in case.warning.iter().enumerate() {
        if is_it(warning.alarm) && ends_ml < alarm_ml {
            waiting.push(format!("warning[{index}].alarm"));
        }
    }
    for (name, hand) in &case.hand {
        let waits = hand.change.iter().position(|change| change.after.is_some_and(|after| is_it(after.alarm)));
        if let Some(index) = waits.filter(|_| ends_ml <= alarm_ml) {
            waiting.push(format!("hand.{name}.change[{index}].after.alarm"));
        }
    }
    match waiting.into_iter().next() {
        Some(key) => {
            let what = format!("the pump gives this alarm at {alarm_ml} ml, and the session ends at end.deficit_ml = {ends_ml}");
            wrong(Kind::Contradiction, key, what, "let the session end later, or set a lower rules.max_deficit_ml")
        }
        None => Ok(()),
    }
}

/// Whether a bleeding that is to be staunched may come: a stop that is called for by less blood takes the place of all goals that are open.
fn staunched(case: &Case) -> Checked {
    let Some(stop_ml) = case.goal.iter().filter_map(|goal| goal.stop.as_ref()?.bled_ml).reduce(f64::min) else { return Ok(()) };
    let late = case.goal.iter().position(|goal| goal.staunch.as_ref().is_some_and(|staunch| staunch.after_ml >= stop_ml));
    match late {
        Some(index) => {
            let what =
                format!("another goal has everything stopped at {stop_ml} ml of blood, and this one is not called for any more");
            wrong(Kind::Contradiction, format!("goal[{index}].staunch.after_ml"), what, "give less, or stop at more blood")
        }
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The key of what is refused.
    fn refused(text: &str) -> Option<String> {
        let head = "version = 1\nname = \"x\"\nrung = \"bleeding\"\ntask = \"x\"\nscene = \"x\"";
        let case: Case = toml::from_str(&format!("{head}\n{text}\n")).unwrap();
        compatible(&case, Medium::Saline).err().map(|error| error.key)
    }

    fn held(from_pa: f64, to_pa: f64, for_s: f64) -> String {
        format!("[[goal]]\npressure = {{ from_pa = {from_pa:.1}, to_pa = {to_pa:.1}, for_s = {for_s:.1} }}\n")
    }

    fn warned(of: &[(&str, f64)]) -> String {
        of.iter().map(|(name, pa)| format!("[[warning]]\n{name} = {pa:.1}\n")).collect()
    }

    /// Two warnings, of which each left something of the band, were accepted though they left nothing together.
    #[test]
    fn warnings_that_leave_no_pressure_of_a_goal_together_are_refused_and_the_lower_one_is_named() {
        let (above, below) = ("pressure_above_pa", "pressure_below_pa");
        let of = |warnings: &[(&str, f64)]| refused(&(held(5_000.0, 9_000.0, 10.0) + &warned(warnings)));
        assert_eq!(of(&[(above, 6_000.0), (below, 8_000.0)]).as_deref(), Some("warning[1].pressure_below_pa"));
        assert_eq!(
            of(&[(below, 8_000.0), (above, 8_000.0)]).as_deref(),
            Some("warning[0].pressure_below_pa"),
            "a single pressure"
        );
        assert_eq!(of(&[(above, 8_000.0), (below, 6_000.0)]), None, "6 to 8 kPa are left");
        assert_eq!(of(&[(above, 9_500.0), (above, 4_000.0)]).as_deref(), Some("warning[1].pressure_above_pa"));
        assert_eq!(of(&[(above, 6_000.0)]), None);
        let noticed = held(5_000.0, 9_000.0, 10.0) + &warned(&[(above, 6_000.0), (below, 8_000.0)]) + "notice = true\n";
        assert_eq!(refused(&noticed), None, "a notice costs nothing");
    }

    /// Below 40 mmHg the walls lie together, and nothing counts as seen.
    #[test]
    fn landmarks_are_looked_at_only_where_the_walls_may_be_apart() {
        let look = "[[goal]]\nlook = { places = [\"fundus\"] }\n";
        let ruled = |most_pa: f64| refused(&format!("{look}[rules]\nmax_pressure_pa = {most_pa:.1}\n"));
        assert_eq!(ruled(5_000.0).as_deref(), Some("rules.max_pressure_pa"));
        assert_eq!(ruled(6_000.0), None);
        let warned = |pa: f64| refused(&format!("{look}[[warning]]\npressure_above_pa = {pa:.1}\n"));
        assert_eq!([warned(4_000.0).as_deref(), warned(8_000.0).as_deref()], [Some("warning[0].pressure_above_pa"), None]);
    }

    /// 20 s at 3 kPa, 30 at 7, 60 at anything up to 8, which goes with these two, and 40 at 11: 100 s in turn.
    #[test]
    fn pressures_that_exclude_each_other_take_their_times_one_after_the_other() {
        let bands = held(10_500.0, 11_500.0, 40.0)
            + &held(2_500.0, 3_500.0, 20.0)
            + &held(1_000.0, 8_000.0, 60.0)
            + &held(6_500.0, 7_500.0, 30.0);
        let of = |more: &str, time_s: f64| refused(&format!("{bands}{more}[end]\ntime_s = {time_s:.1}\n"));
        // Of 40 + 60 s the last goal is the third, of 40 + 20 + 30 s the fourth.
        assert_eq!(of("", 100.0).as_deref(), Some("goal[2].pressure.for_s"));
        assert_eq!(of("", 101.0), None);
        // A look of 50 s goes with all but the lowest: with that one and nothing else it takes 70 s.
        let look = "[[goal]]\nlook = { places = [\"fundus\"], for_s = 50.0 }\n";
        assert_eq!(of(look, 101.0), None);
        let low = held(2_500.0, 3_500.0, 20.0) + look;
        let of_low = |time_s: f64| refused(&format!("{low}[end]\ntime_s = {time_s:.1}\n"));
        assert_eq!((of_low(70.0).as_deref(), of_low(71.0)), (Some("goal[1].look.for_s"), None));
        assert_eq!(refused(&bands), None, "time ends nothing");
    }

    #[test]
    fn an_alarm_of_the_deficit_comes_before_the_end_where_somebody_is_to_heed_it() {
        let stop = "[[goal]]\nstop = { alarm = \"deficit\", within_s = 10.0 }\n";
        let warning = "[[goal]]\nremoved = { percent = 5.0 }\n[[warning]]\nalarm = \"deficit\"\n";
        let hand = "[[goal]]\nremoved = { percent = 5.0 }\n[hand.waits]\nlike = \"polyp\"\n\
                    change = [{ at_s = 1.0 }, { at_s = 1.0, after = { alarm = \"deficit\" } }]\n";
        let of = |text: &str, ends_ml: f64, rules: &str| {
            refused(&format!("{text}[end]\ndeficit_ml = {ends_ml:.1}\n[rules]\n{rules}\n"))
        };
        let keys = [(stop, "goal[0].stop.alarm"), (warning, "warning[0].alarm"), (hand, "hand.waits.change[1].after.alarm")];
        for (text, key) in keys {
            assert_eq!(of(text, 2_499.0, "").as_deref(), Some(key), "saline: 2 500 ml");
            assert_eq!([of(text, 2_501.0, ""), of(text, 800.0, "max_deficit_ml = 750.0")], [None, None], "{key}");
            assert_eq!(refused(text), None, "{key}: no deficit ends it");
        }
        let at_once = keys.map(|(text, _)| of(text, 2_500.0, "").is_some());
        assert_eq!(at_once, [true, false, true], "a warning may fall with the end");
    }

    /// A stop takes the place of the goals that are open: a bleeding that had to begin with more could not be staunched.
    #[test]
    fn a_bleeding_is_staunched_before_another_goal_has_everything_stopped() {
        let with = |stop_ml: f64| {
            let staunch = "[[goal]]\nstaunch = { after_ml = 20.0, below_ml_min = 1.0, for_s = 5.0 }\n";
            refused(&format!("{staunch}[[goal]]\nstop = {{ bled_ml = {stop_ml:.1}, within_s = 5.0 }}\n"))
        };
        assert_eq!(
            [10.0, 20.0].map(with),
            [Some("goal[0].staunch.after_ml".to_owned()), Some("goal[0].staunch.after_ml".to_owned())]
        );
        assert_eq!(with(21.0), None);
    }
}
