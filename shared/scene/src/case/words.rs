//! A case in words: as `hystation check` shows it, what is doubtful in its scores and stays, what ends its session, and the pump's alarms.

use super::brief::{Aim, Asked, Brief, Named, Region, Warned};
use super::file::{Alarm, End, Score};
use std::fmt;

impl fmt::Display for Brief {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(out, "case: {}", self.task.trim().replace('\n', " "))?;
        writeln!(out, "  seed {}, {:.3} ml of pathology to be removed", self.seed, self.pathology_ml)?;
        self.drawn.iter().try_for_each(|drawn| writeln!(out, "  drawn: {drawn}"))?;
        let counts = |goal: &Asked| if goal.weight == 1.0 { String::new() } else { format!(" (counts {})", goal.weight) };
        self.goals.iter().try_for_each(|goal| writeln!(out, "  goal: {}{}", goal.words, counts(goal)))?;
        self.end.words().iter().try_for_each(|end| writeln!(out, "  ends: {end}"))?;
        let told = |warned: &Warned| if warned.is_notice() { "tells" } else { "warns" };
        self.warnings.iter().try_for_each(|warned| writeln!(out, "  {}: {}", told(warned), warned.words))?;
        self.score.iter().try_for_each(|(key, score)| writeln!(out, "  score: {key} {}", score.words()))
    }
}

impl Brief {
    /// What its scores ask for that its session lets nobody have, or leaves to everybody, stays for which it has no time, and a session that may never end,
    /// one sentence each.
    pub fn doubts(&self) -> Vec<String> {
        let weighed = |key: &str| self.score.get(key).filter(|score| score.weight != Some(0.0));
        let scale = |key: &str| weighed(key).and_then(|score| score.full.zip(score.none));
        let percent = |aim: &Aim| if let Aim::Removed(ml) = aim { Some(100.0 * ml / self.pathology_ml) } else { None };
        let most_percent = self.goals.iter().filter_map(|goal| percent(&goal.is)).reduce(f64::max);
        let mut doubts = Vec::new();
        if let (Some((full, _)), Some(percent)) = (scale("pathology"), most_percent)
            && self.end.goals
            && full > percent + 1e-6
        {
            doubts.push(format!("score.pathology is full at {full} %, and the session ends with its goals, at {percent:.1} %"));
        }
        if let (Some((full, none)), Some(time_s)) = (scale("time"), self.end.time_s)
            && none > time_s.max(full)
        {
            doubts.push(format!(
                "score.time is 0 at {none} s, and the session ends at {time_s} s: who is out of time has some of it"
            ));
        }
        if weighed("landmarks").is_some() && !self.goals.iter().any(|goal| matches!(goal.is, Aim::Look { .. })) {
            doubts.push("score.landmarks has no value: no goal has landmarks looked at".to_owned());
        }
        let stays_s = self.stays_s();
        if let Some(time_s) = self.end.time_s.filter(|time_s| stays_s >= *time_s) {
            doubts.push(format!(
                "the stays that goals ask for, in places that lie apart, take {stays_s} s, and the session ends at {time_s} s"
            ));
        }
        let waits = |asked: &Asked| matches!(asked.is, Aim::Stop { .. } | Aim::Staunch { .. });
        if self.goals.iter().all(waits) && self.end.time_s.is_none() {
            doubts.push("every goal waits for what may never come, and no time ends the session: give [end] a time_s".to_owned());
        }
        doubts
    }

    /// The time of stays that can only be made one after the other, s: of the goals whose places lie apart from those of each of these before it.
    fn stays_s(&self) -> f64 {
        let (mut apart, mut ticks): (Vec<&Named<Region>>, u64) = (Vec::new(), 0);
        for goal in &self.goals {
            let Aim::Visit { places, stay_ticks } = &goal.is else { continue };
            if places.iter().all(|place| apart.iter().all(|other| are_apart(&place.is, &other.is))) {
                apart.extend(places);
                ticks += stay_ticks * places.len() as u64;
            }
        }
        ticks as f64 * 1e-3
    }
}

/// Whether no tip is in both; of a ball and a range of the insertion that is not asked.
fn are_apart(one: &Region, other: &Region) -> bool {
    match (one, other) {
        (Region::Ball(one_m, one_radius_m), Region::Ball(other_m, other_radius_m)) => {
            let square_m2: f64 = one_m.iter().zip(other_m).map(|(one_m, other_m)| (one_m - other_m).powi(2)).sum();
            square_m2.sqrt() > one_radius_m + other_radius_m
        }
        (Region::Insertion([from_m, to_m]), Region::Insertion([other_from_m, other_to_m])) => {
            to_m < other_from_m || other_to_m < from_m
        }
        _ => false,
    }
}

impl Score {
    /// What it says, in words.
    fn words(&self) -> String {
        let weight = self.weight.map(|weight| if weight == 0.0 { "not at all".to_owned() } else { format!("weighs {weight}") });
        let scale = self.full.zip(self.none).map(|(full, none)| format!("100 % at {full}, 0 % at {none}"));
        weight.into_iter().chain(scale).collect::<Vec<_>>().join(", ")
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

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn brief(case: &str) -> Brief {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../../assets/cases/{case}.toml"));
        crate::find_case(&path, None).unwrap().unwrap().brief
    }

    #[test]
    fn a_case_says_what_its_goals_count_and_its_scores_weigh() {
        let said = brief("polyp").to_string();
        for line in [
            "  goal: remove 80 % of the pathology (counts 3)",
            "  score: energised_free weighs 3",
            "  score: pathology weighs 4, 100 % at 80, 0 % at 0",
            "  score: time 100 % at 300, 0 % at 900",
        ] {
            assert!(said.lines().any(|found| found == line), "{line}: {said}");
        }
        assert!(brief("access").to_string().contains("  score: in_view not at all\n"));
    }

    #[test]
    fn a_score_that_nobody_can_have_or_that_is_left_to_who_is_out_of_time_is_doubted() {
        let good = brief("polyp");
        assert_eq!(good.doubts(), Vec::<String>::new());
        let with = |key: &str, score: Score| {
            let mut brief = good.clone();
            brief.score.insert(key.to_owned(), score);
            brief.doubts()
        };
        let of = |full: f64, none: f64| Score { weight: Some(2.0), full: Some(full), none: Some(none) };
        for (key, doubtful, certain) in
            [("pathology", of(90.0, 0.0), of(80.0, 0.0)), ("time", of(300.0, 901.0), of(300.0, 900.0))]
        {
            let doubts = with(key, doubtful);
            assert!(doubts.len() == 1 && doubts[0].starts_with(&format!("score.{key} ")), "{doubts:?}");
            assert_eq!(with(key, certain), Vec::<String>::new(), "{key}");
            assert_eq!(with(key, Score { weight: Some(0.0), ..doubtful }), Vec::<String>::new(), "{key} weighs nothing");
        }
        let unseen = with("landmarks", Score { weight: Some(2.0), ..Score::default() });
        assert!(unseen.len() == 1 && unseen[0].contains("no goal has landmarks looked at"), "{unseen:?}");
    }

    /// Who makes no mistake has nothing to reach.
    #[test]
    fn a_session_of_goals_that_wait_for_a_mishap_needs_a_time() {
        let mut waits = brief("fluid-overload");
        waits.goals.truncate(1);
        assert_eq!(waits.doubts(), Vec::<String>::new(), "its time ends it");
        waits.end.time_s = None;
        let doubts = waits.doubts();
        assert!(doubts.len() == 1 && doubts[0].contains("give [end] a time_s"), "{doubts:?}");
    }

    /// A case was accepted without a word whose goals have the tip stay in two places for longer than its session lasts.
    #[test]
    fn stays_in_places_that_lie_apart_take_their_times_one_after_the_other() {
        let good = brief("polyp");
        let of = |regions: [Region; 2], stay_ticks: u64| {
            let goal = |is: Region| {
                let places = vec![Named { words: "there".to_owned(), is }];
                Asked { words: "go there".to_owned(), is: Aim::Visit { places, stay_ticks }, weight: 1.0 }
            };
            Brief { goals: regions.map(goal).to_vec(), ..good.clone() }.doubts()
        };
        let balls = |x_m: f64| [0.0, x_m].map(|x_m| Region::Ball([x_m, 0.0, 0.04], 0.004));
        let ranges = |from_m: f64| [0.02, from_m].map(|from_m| Region::Insertion([from_m, from_m + 0.01]));
        assert_eq!(good.end.time_s, Some(900.0));
        for apart in [balls(0.009), ranges(0.031)] {
            let doubts = of(apart, 450_000);
            assert!(doubts.len() == 1 && doubts[0].contains("take 900 s, and the session ends at 900 s"), "{doubts:?}");
            assert_eq!(of(apart, 449_000), Vec::<String>::new(), "there is time");
        }
        for together in [balls(0.007), ranges(0.029), [balls(0.0)[0], ranges(0.05)[0]]] {
            assert_eq!(of(together, 450_000), Vec::<String>::new(), "{together:?}: one stay may be both");
        }
    }

    #[test]
    fn no_case_that_comes_with_the_station_has_a_doubtful_score() {
        let cases = [
            "access",
            "biopsy",
            "bleeding",
            "distension",
            "fluid-overload",
            "myoma",
            "navigation",
            "perforation",
            "retrieval",
            "septum",
        ];
        for case in cases {
            assert_eq!(brief(case).doubts(), Vec::<String>::new(), "{case}");
        }
    }
}
