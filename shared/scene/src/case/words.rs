//! A case in words: as `hystation check` shows it, what ends its session, and the pump's alarms.

use super::brief::{Brief, Warned};
use super::file::{Alarm, End};
use std::fmt;

impl fmt::Display for Brief {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(out, "case: {}", self.task.trim().replace('\n', " "))?;
        writeln!(out, "  seed {}, {:.3} ml of pathology to be removed", self.seed, self.pathology_ml)?;
        self.drawn.iter().try_for_each(|drawn| writeln!(out, "  drawn: {drawn}"))?;
        self.goals.iter().try_for_each(|goal| writeln!(out, "  goal: {}", goal.words))?;
        self.end.words().iter().try_for_each(|end| writeln!(out, "  ends: {end}"))?;
        let told = |warned: &Warned| if warned.is_notice() { "tells" } else { "warns" };
        self.warnings.iter().try_for_each(|warned| writeln!(out, "  {}: {}", told(warned), warned.words))
    }
}

impl End {
    /// What ends the session, in words.
    pub fn words(&self) -> Vec<String> {
        let ends = [
            self.goals.then(|| "all goals are reached".to_owned()),
            self.time_s.map(|time_s| format!("after {time_s} s")),
            self.deficit_ml.map(|ml| format!("at a deficit of {ml} ml")),
            self.bled_ml.map(|ml| format!("at {ml} ml of blood")),
            self.perforation.then(|| "when the wall is pierced".to_owned()),
        ];
        ends.into_iter().flatten().collect()
    }
}

impl Alarm {
    /// Its name, as the pump shows it.
    pub const fn name(self) -> &'static str {
        match self {
            Alarm::Pressure => "pressure",
            Alarm::Deficit => "deficit",
            Alarm::AbnormalLoss => "abnormal loss",
            Alarm::Perforation => "perforation",
            Alarm::ContainerChange => "container change",
        }
    }
}
