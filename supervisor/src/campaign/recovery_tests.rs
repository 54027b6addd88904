//! What may fall into whose recovery, and into whose hand-over.

use super::*;

#[test]
fn a_fault_in_a_recovery_has_another_beside_it() {
    let text = "[[cell]]\nkinds = [\"kill\"]\ntargets = [\"tissue:active\", \"fluid\"]\nstates = [\"recovery\"]\ncount = 1\n";
    let campaign = parse("t", text).unwrap();
    let with = |index: usize| campaign.cells[index].with.as_ref().map(|with| with.target.as_str());
    assert_eq!((with(0), with(1)), (Some("haptic:active"), Some("tissue:active")));
    let own = parse("t", &format!("{text}with = \"segfault device\"\n")).unwrap();
    assert_eq!(own.cells[0].with.as_ref().map(|with| with.kind.name()), Some("segfault"));
    assert!(parse("t", &format!("{text}with = \"kill\"\n")).unwrap_err().contains("KIND TARGET"));
    let keeper = |name: &str| parse("t", &text.replace("\"fluid\"", &format!("\"{name}\"")));
    assert_eq!(keeper("supervisor").unwrap().cells[1].with.as_ref().map(|with| with.target.as_str()), Some("tissue:active"));
    assert!(keeper("supervisor+guardian").unwrap_err().contains("take supervisor or guardian"));
    assert!(parse("t", &format!("{text}with = \"kill guardian\"\n")).unwrap_err().contains("take an engine's"));
    let own_misses = parse("t", &format!("{text}with = \"kill device allowed_misses=5\"\n")).unwrap_err();
    assert!(own_misses.contains("a cell says once whom it hurts and what that may cost"), "{own_misses}");
}

#[test]
fn both_of_a_role_may_die_beside_a_damaged_checkpoint_and_beside_nothing_else() {
    let text = "[[cell]]\nkinds = [\"kill\"]\ntargets = [\"tissue:both\"]\nstates = [\"recovery\"]\ncount = 1\nwith = 'corrupt tissue:active where=\"checkpoint\" seed=2'\n";
    let cell = parse("t", text).unwrap().cells.remove(0);
    assert_eq!((cell.faults(), cell.with.unwrap().seed), (2, Some(2)));
    assert!(parse("t", &text.replace("checkpoint", "page")).unwrap_err().contains("take state any for :both"));
    let both = text.replace("tissue:active where", "tissue:both where").replace("[\"tissue:both\"]", "[\"tissue:active\"]");
    assert!(parse("t", &both).is_err(), "one is damaged");
}

#[test]
fn a_fault_in_a_hand_over_has_the_one_beside_it_for_which_a_role_is_handed_over() {
    let text = "[[cell]]\nkinds = [\"kill\"]\ntargets = [\"fluid:active\", \"supervisor\"]\nstates = [\"handover\"]\ncount = 1\n";
    let campaign = parse("t", text).unwrap();
    let names: Vec<&str> = campaign.cells.iter().map(|cell| cell.name.as_str()).collect();
    assert_eq!(names, ["kill fluid:active in a hand-over", "kill supervisor in a hand-over"]);
    let beside = |cell: &Cell| cell.with.as_ref().map(|with| (with.kind.name(), with.target.clone(), with.thread.is_some()));
    let usher = |target: &str| Some(("block", target.to_string(), true));
    assert_eq!([0, 1].map(|index| beside(&campaign.cells[index])), ["fluid:active", "tissue:active"].map(usher));
    let with = |words: &str| parse("t", &format!("{text}with = '{words}'\n"));
    let both = with("leak-memory haptic:both rate=64.0").unwrap().cells.remove(0);
    assert_eq!((both.faults(), both.faults_beside(), both.with.unwrap().rate), (1, 2, Some(64.0)));
    assert_eq!(both.name, "kill fluid:active in a hand-over from leak-memory haptic:both rate=64.0");
    for words in [
        "kill tissue:active",
        "block tissue:active",
        "leak-memory device",
        "leak-files tissue:spare",
        "leak-memory fluid:active for=2.0",
    ] {
        assert!(with(words).unwrap_err().contains("nobody hands a role over for that"), "{words}");
    }
    assert!(with("leak-memory guardian").unwrap_err().contains("take an engine's"));
    assert!(parse("t", &text.replace("\"fluid:active\"", "\"fluid:both\"")).unwrap_err().contains("take state any for :both"));
    assert!(parse("t", &format!("{}with = 'leak-files fluid:active'\n", text.replace("handover", "any"))).is_err());
}
