//! By whom a recording and its replay were made: where they differ, whoever asked for them to be compared has to know whether the programs or the machines do.

use hyst_recording::Session;

/// That another build made the recording than did it again, in words; `None` where it is the same, or one of them does not say it.
pub fn other_build(recorded: &Session, again: &Session) -> Option<String> {
    let version = |session: &Session| session.get("version").map_or_else(String::new, |version| format!("{version} "));
    let (was, is) = (recorded.get("build")?, again.get("build")?);
    (was != is).then(|| format!("recorded by build {}{was}, this is {}{is}", version(recorded), version(again)))
}

/// That another processor made it, in words, likewise. All that have AVX2 give the same bits, and those that lack it, among themselves.
pub fn other_processor(recorded: &Session, again: &Session) -> Option<String> {
    let (was, is) = (recorded.get("cpu")?, again.get("cpu")?);
    let words = || {
        format!(
            "recorded on {was}, done again on {is}: where one of them lacks AVX2 their states differ; what was recorded without it is done again with \
             --set isa=baseline"
        )
    };
    (was != is).then(words)
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

    /// What a machine without AVX2 had recorded differed from its first states on, and nothing said why.
    #[test]
    fn another_processor_is_named_with_what_makes_its_bits_the_same() {
        let (was, is, older) = (of(&[("cpu", "QEMU Virtual CPU")]), of(&[("cpu", "EPYC")]), of(&[]));
        let said = other_processor(&was, &is).unwrap();
        assert!(["QEMU Virtual CPU", "EPYC", "isa=baseline"].iter().all(|word| said.contains(word)), "{said}");
        assert_eq!(
            [other_processor(&was, &was), other_processor(&older, &is), other_processor(&was, &older)],
            [None, None, None]
        );
    }
}
