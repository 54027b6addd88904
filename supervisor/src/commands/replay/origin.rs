//! By whom a recording and its replay were made: where they differ, whoever asked for them to be compared has to know whether the programs do.

use hyst_recording::Session;

/// That another build made the recording than did it again, in words; `None` where it is the same, or one of them does not say it.
pub fn other_build(recorded: &Session, again: &Session) -> Option<String> {
    let version = |session: &Session| session.get("version").map_or_else(String::new, |version| format!("{version} "));
    let (was, is) = (recorded.get("build")?, again.get("build")?);
    (was != is).then(|| format!("recorded by build {}{was}, this is {}{is}", version(recorded), version(again)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(facts: &[(&str, &str)]) -> Session {
        facts.iter().map(|(name, value)| (name.to_string(), value.to_string())).collect()
    }

    #[test]
    fn another_build_is_named_and_the_same_one_or_one_that_is_not_known_is_not() {
        let (older, was) = (of(&[("version", "0.1.0")]), of(&[("version", "0.1.0"), ("build", "f00")]));
        let is = of(&[("version", "0.2.0"), ("build", "bad")]);
        assert_eq!(other_build(&was, &is).as_deref(), Some("recorded by build 0.1.0 f00, this is 0.2.0 bad"));
        assert_eq!([other_build(&was, &was), other_build(&older, &is), other_build(&was, &older)], [None, None, None]);
    }
}
