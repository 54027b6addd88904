//! What may fall into whose recovery.

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
