//! Each fault of a scene gives one error that says where, what and what to do.
#![allow(missing_docs)]

use hyst_scene::{Scene, SceneError, SceneErrorKind as Kind};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;

const GOOD: &str = r#"version = 1
name = "test"
[[deformable]]
name = "organ"
mesh = "builtin:uterus.msh"
scale_to_m = 0.001
[deformable.material]
youngs_modulus_pa = 3e4
[[rigid]]
name = "scope"
[workspace]
insertion_m = [0.0, 0.06]
[fluid]
grid = [32, 32, 18]
[hand.mine]
from = { insertion_m = 0.01 }
into = { pitch_deg = 3.0, insertion_m = 0.03 }
period_s = 2.0
"#;

fn parse(text: &str) -> Result<Scene, SceneError> {
    Scene::parse(text, "scene.toml")
}

/// Replacement in the good scene, and the kind, the line (0 for none) and the key of the error that it must give.
const CASES: [(&str, &str, Kind, usize, &str); 64] = [
    ("version = 1", "version = 2", Kind::Version, 1, "version"),
    ("version = 1\n", "", Kind::Version, 0, "version"),
    ("name = \"test\"", "nme = \"test\"", Kind::UnknownKey, 2, "nme"),
    ("scale_to_m", "scale_m", Kind::UnknownKey, 6, "deformable[0].scale_m"),
    ("mesh = \"builtin:uterus.msh\"\n", "", Kind::Incomplete, 3, "deformable[0]"),
    ("scale_to_m = 0.001", "scale_to_m = \"mm\"", Kind::Syntax, 6, "deformable[0].scale_to_m"),
    ("scale_to_m = 0.001", "scale_to_m = = 1", Kind::Syntax, 6, ""),
    ("scale_to_m = 0.001", "scale_to_m = 0.0", Kind::Range, 6, "deformable[0].scale_to_m"),
    ("scale_to_m = 0.001", "translate_m = [0.0, nan, 0.0]", Kind::Range, 6, "deformable[0].translate_m[1]"),
    ("scale_to_m = 0.001", "translate_m = [0.0, -inf, 0.0]", Kind::Range, 6, "deformable[0].translate_m[1]"),
    ("scale_to_m = 0.001", "scale_to_m = 1e999", Kind::Range, 6, "deformable[0].scale_to_m"),
    ("scale_to_m = 0.001", "attach_to = \"liver\"", Kind::Name, 6, "deformable[0].attach_to"),
    ("scale_to_m = 0.001", "attach_to = \"organ\"", Kind::Name, 6, "deformable[0].attach_to"),
    ("scale_to_m = 0.001", "fixed = [{ globe = 1 }]", Kind::UnknownKey, 6, "deformable[0].fixed[0].globe"),
    ("scale_to_m = 0.001", "fixed = [{ outer_shell = 0.9 }]", Kind::Range, 6, "deformable[0].fixed[0].outer_shell"),
    ("scale_to_m = 0.001", "kind = \"tumour\"", Kind::UnknownKey, 6, "deformable[0].kind"),
    ("youngs_modulus_pa = 3e4", "youngs_modulus_pa = 0.0", Kind::Range, 8, "deformable[0].material.youngs_modulus_pa"),
    ("youngs_modulus_pa = 3e4", "youngs_modulus_pa = 0.999", Kind::Range, 8, "deformable[0].material.youngs_modulus_pa"),
    ("youngs_modulus_pa = 3e4", "youngs_modulus_pa = -5.0", Kind::Range, 8, "deformable[0].material.youngs_modulus_pa"),
    ("youngs_modulus_pa = 3e4", "youngs_modulus_pa = 1.1e9", Kind::Range, 8, "deformable[0].material.youngs_modulus_pa"),
    ("youngs_modulus_pa = 3e4", "poisson_ratio = 0.5", Kind::Range, 8, "deformable[0].material.poisson_ratio"),
    ("youngs_modulus_pa = 3e4", "poisson_ratio = -0.1", Kind::Range, 8, "deformable[0].material.poisson_ratio"),
    ("name = \"scope\"", "name = \"organ\"", Kind::Name, 10, "rigid[0].name"),
    ("name = \"scope\"", "name = \"\"", Kind::Name, 10, "rigid[0].name"),
    ("name = \"scope\"", "name = \"s\"\npoints = 1000000", Kind::Range, 11, "rigid[0].points"),
    ("name = \"scope\"", "name = \"s\"\nloop = { reach_m = -0.1 }", Kind::Range, 11, "rigid[0].loop.reach_m"),
    ("name = \"scope\"", "name = \"s\"\nloop = { wire_m = 0.0 }", Kind::Range, 11, "rigid[0].loop.wire_m"),
    ("name = \"scope\"", "name = \"s\"\n[rigid.loop]\nradius_m = 0.0001", Kind::Range, 12, "rigid[0].loop.radius_m"),
    ("name = \"scope\"", "name = \"s\"\nloop = { radius_m = inf }", Kind::Range, 11, "rigid[0].loop.radius_m"),
    ("name = \"scope\"", "name = \"s\"\nloop = { size_m = 0.002 }", Kind::UnknownKey, 11, "rigid[0].loop.size_m"),
    ("name = \"scope\"", "name = \"s\"\nscale_to_m = nan", Kind::Range, 11, "rigid[0].scale_to_m"),
    (
        "name = \"scope\"",
        "name = \"s\"\njaws = { mesh = \"j.obj\", opening_m = 0.5 }",
        Kind::Range,
        11,
        "rigid[0].jaws.opening_m",
    ),
    ("name = \"scope\"", "name = \"s\"\njaws = { mesh = \"j.obj\", points = 3 }", Kind::Range, 11, "rigid[0].jaws.points"),
    ("insertion_m = [0.0, 0.06]", "insertion_m = [0.06, 0.0]", Kind::Range, 12, "workspace.insertion_m"),
    ("grid = [32, 32, 18]", "grid = [0, 32, 18]", Kind::Range, 14, "fluid.grid"),
    ("grid = [32, 32, 18]", "grid = [1000000000, 32, 18]", Kind::Range, 14, "fluid.grid"),
    ("grid = [32, 32, 18]", "grid = [512, 512, 512]", Kind::Range, 14, "fluid.grid"),
    ("grid = [32, 32, 18]", "box_min_m = [0.0, 0.0, 0.0]", Kind::Incomplete, 13, "fluid"),
    ("grid = [32, 32, 18]", "change = [{ inflow_valve = 0.5 }]", Kind::Incomplete, 14, "fluid.change[0]"),
    ("grid = [32, 32, 18]", "change = [{ at_s = 1.0, valve = 0.5 }]", Kind::UnknownKey, 14, "fluid.change[0].valve"),
    ("grid = [32, 32, 18]", "change = [{ at_s = 2.0 }, { at_s = 1.0 }]", Kind::Range, 14, "fluid.change[1].at_s"),
    ("grid = [32, 32, 18]", "change = [{ at_s = nan }]", Kind::Range, 14, "fluid.change[0].at_s"),
    ("grid = [32, 32, 18]", "change = [{ at_s = 1.0, inflow_valve = 1.5 }]", Kind::Range, 14, "fluid.change[0].inflow_valve"),
    ("grid = [32, 32, 18]", "change = [{ at_s = 1.0, outflow_valve = -0.1 }]", Kind::Range, 14, "fluid.change[0].outflow_valve"),
    ("grid = [32, 32, 18]", "change = [{ at_s = 1, set_pressure_pa = inf }]", Kind::Range, 14, "fluid.change[0].set_pressure_pa"),
    (
        "grid = [32, 32, 18]",
        "change = [{ at_s = 1.0, after = { alarm = \"bell\" } }]",
        Kind::UnknownKey,
        14,
        "fluid.change[0].after.alarm",
    ),
    (
        "grid = [32, 32, 18]",
        "change = [{ at_s = 1.0, after = { bell = true } }]",
        Kind::UnknownKey,
        14,
        "fluid.change[0].after.bell",
    ),
    ("grid = [32, 32, 18]", "change = [{ at_s = 1.0, after = {  } }]", Kind::Incomplete, 14, "fluid.change[0].after"),
    (
        "grid = [32, 32, 18]",
        "change = [{ at_s = 1.0, after = { alarm = \"deficit\", bled_above_ml = 5.0 } }]",
        Kind::Range,
        14,
        "fluid.change[0].after.bled_above_ml",
    ),
    (
        "grid = [32, 32, 18]",
        "change = [{ at_s = 1.0, after = { deficit_above_ml = 0.0 } }]",
        Kind::Range,
        14,
        "fluid.change[0].after.deficit_above_ml",
    ),
    (
        "grid = [32, 32, 18]",
        "change = [{ at_s = 1.0, after = { pressure_above_pa = 2e5 } }]",
        Kind::Range,
        14,
        "fluid.change[0].after.pressure_above_pa",
    ),
    ("[hand.mine]", "[vessels]\nspacing_m = 0.0\n[hand.mine]", Kind::Range, 16, "vessels.spacing_m"),
    ("[hand.mine]", "[vessels]\npressure_pa = nan\n[hand.mine]", Kind::Range, 16, "vessels.pressure_pa"),
    ("[hand.mine]", "[vessels]\nconductance_ml_s_pa = 1.0\n[hand.mine]", Kind::Range, 16, "vessels.conductance_ml_s_pa"),
    ("[hand.mine]", "[vessels]\npressure = 1.0\n[hand.mine]", Kind::UnknownKey, 16, "vessels.pressure"),
    ("insertion_m = 0.03", "insertion_m = 0.3", Kind::Range, 17, "hand.mine.into.insertion_m"),
    ("period_s = 2.0\n", "", Kind::Incomplete, 15, "hand.mine"),
    ("period_s = 2.0", "period_s = 2.0\nlike = \"press\"", Kind::Contradiction, 15, "hand.mine"),
    ("[hand.mine]", "[hand.other]\nonce = true\n[hand.mine]", Kind::Incomplete, 15, "hand.other"),
    (
        "[hand.mine]",
        "[hand.a]\nleg = [{ to = { insertion_m = 0.3 }, time_s = 1.0 }]\n[hand.mine]",
        Kind::Range,
        16,
        "hand.a.leg[0].to.insertion_m",
    ),
    (
        "[hand.mine]",
        "[hand.a]\nleg = [{ to = { insertion_m = 0.03 }, time_s = 0.0 }]\n[hand.mine]",
        Kind::Range,
        16,
        "hand.a.leg[0].time_s",
    ),
    (
        "[hand.mine]",
        "[hand.a]\nlike = \"press\"\nchange = [{ at_s = nan }]\n[hand.mine]",
        Kind::Range,
        17,
        "hand.a.change[0].at_s",
    ),
    ("period_s = 2.0", "period_s = 0.0", Kind::Range, 18, "hand.mine.period_s"),
    ("period_s = 2.0", "period_s = 2.0\ntarget = \"myoma\"", Kind::Name, 19, "hand.mine.target"),
];

/// The error after one replacement in a good scene.
fn error_with(old: &str, new: &str) -> SceneError {
    assert!(GOOD.contains(old), "{old}");
    let error = parse(&GOOD.replace(old, new)).expect_err(new);
    let text = error.to_string();
    assert!(text.starts_with("scene.toml") && !error.what.is_empty() && !error.cure.is_empty() && !text.contains('\n'), "{text}");
    error
}

#[test]
fn the_good_scene_is_good() {
    parse(GOOD).unwrap_or_else(|error| panic!("{error}"));
}

#[test]
fn whole_numbers_do_where_a_length_or_a_modulus_is_asked() {
    let scene = parse(&GOOD.replace("3e4", "30000").replace("2.0", "2")).unwrap();
    assert_eq!(scene.deformable[0].material.youngs_modulus_pa, 30e3);
    assert_eq!(scene.hand["mine"].period_s, Some(2.0));
}

#[test]
fn each_fault_has_its_kind_its_line_and_its_key() {
    for (old, new, kind, line, key) in CASES {
        let error = error_with(old, new);
        assert_eq!((error.kind, error.key.as_str()), (kind, key), "{new}: {error}");
        assert_eq!(error.line_column.map_or(0, |(line, _)| line), line, "{new}: {error}");
    }
}

/// Tables and keys of fluid, pump and vessels, and what none of them may be beside no number and no end.
const FIGURES: [(&str, &str, &[&str]); 22] = [
    ("fluid", "rate_hz", &["0.0", "-30.0", "3.9", "1001.0", "1e30"]),
    ("fluid", "set_pressure_pa", &["-1.0", "20000.1", "1e30"]),
    ("fluid", "container_ml", &["0.0", "-3000.0", "99.9", "20001", "1e30"]),
    ("fluid", "viscosity_pa_s", &["0.0", "-1e-3", "1.1", "1e30"]),
    ("fluid", "density_kg_m3", &["0.0", "-1000.0", "99.0", "1e30"]),
    ("fluid", "margin_m", &["-0.001", "0.11", "1e30"]),
    ("fluid", "box_min_m", &["[0.0, 1e30, 0.0]\nbox_max_m = [1.0, 1.0, 1.0]", "[1.0, 1.0, 1.0]\nbox_max_m = [1.0, 1.0, 1.0]"]),
    ("vessels", "spacing_m", &["0.0", "-0.004", "0.0004", "0.051", "1e30"]),
    ("vessels", "pressure_pa", &["-1.0", "40000.1", "1e30"]),
    ("vessels", "conductance_ml_s_pa", &["-1e-9", "0.0011", "1e30"]),
    ("fluid.pump", "max_flow_ml_min", &["-1.0", "3000.1", "1e30"]),
    ("fluid.pump", "inflow_ml_s_pa", &["-1e-9", "0.011", "1e30"]),
    ("fluid.pump", "outflow_ml_s_pa", &["-1e-9", "0.011", "1e30"]),
    ("fluid.pump", "suction_pa", &["-1.0", "50000.1", "1e30"]),
    ("fluid.pump", "leak_ml_s_pa", &["-1e-9", "0.011", "1e30"]),
    ("fluid.cavity", "volume_ml", &["0.0", "-8.0", "0.59", "50.1", "1e30"]),
    ("fluid.cavity", "parting_pa", &["-1.0", "15000.1", "1e30"]),
    ("fluid.cavity", "parting_ml", &["0.0", "-0.5", "0.009", "10.1", "1e30"]),
    ("[fluid.change]", "at_s", &["-1.0", "86401.0", "1e30"]),
    ("[fluid.change]", "set_pressure_pa", &["-1.0", "20000.1", "1e30"]),
    ("[fluid.change]", "inflow_valve", &["-0.1", "1.1", "1e30"]),
    ("[fluid.change]", "outflow_valve", &["-0.1", "1.1", "1e30"]),
];

#[test]
fn no_figure_of_fluid_pump_and_vessels_may_be_nonsense() {
    for (table, key, bad) in FIGURES {
        for value in bad.iter().chain(&["nan", "inf", "-inf", "1e999"]).filter(|value| key != "box_min_m" || value.contains('['))
        {
            let time = if table == "[fluid.change]" && key != "at_s" { "at_s = 1.0\n" } else { "" };
            let lines = format!("[{table}]\n{time}{key} = {value}\n");
            let text = match table {
                "fluid" => GOOD.replace("[fluid]\n", &lines),
                _ => format!("{GOOD}{lines}"),
            };
            let error = parse(&text).expect_err(&lines);
            let named = table.replace("[fluid.change]", "fluid.change[0]");
            let said = error.to_string();
            let found = error.key.strip_prefix(&named).and_then(|key| key.strip_prefix('.')).unwrap_or_default();
            assert!(error.kind == Kind::Range && found.starts_with(key), "{lines}{error}");
            let wrong_line = text.lines().nth(error.line_column.unwrap_or_default().0.saturating_sub(1)).unwrap();
            assert!(wrong_line.starts_with(key), "{said}: {wrong_line}");
            assert!(said.starts_with("scene.toml:") && !error.cure.is_empty() && !said.contains('\n'), "{said}");
        }
    }
}

#[test]
fn a_seed_and_a_grid_are_whole_and_changes_of_the_pump_are_bounded() {
    let kind_of = |bad: &str| if bad.contains("nan") { Kind::Range } else { Kind::Syntax };
    for bad in ["seed = -1", "seed = 1.5", "seed = nan", "seed = \"x\""] {
        let error = parse(&format!("{GOOD}[vessels]\n{bad}\n")).expect_err(bad);
        assert_eq!((error.kind, error.key.as_str()), (kind_of(bad), "vessels.seed"), "{bad}: {error}");
    }
    for bad in ["[-1, 32, 18]", "[32.5, 32, 18]", "[nan, 32, 18]", "[32, 32]", "[5000000000, 32, 18]"] {
        let error = error_with("grid = [32, 32, 18]", &format!("grid = {bad}"));
        assert!(error.kind == kind_of(bad) && error.key.starts_with("fluid.grid"), "{bad}: {error}");
    }
    // What waits for something stands in no order with the others.
    let waits = "[[fluid.change]]\nat_s = 2.0\n[[fluid.change]]\nat_s = 0.5\nafter = { alarm = \"perforation\" }\n[[fluid.change]]\nat_s = 2.0\n";
    let fluid = parse(&format!("{GOOD}{waits}")).unwrap_or_else(|error| panic!("{error}")).fluid;
    assert!(fluid.change[1].after.is_some_and(|after| after.alarm.is_some()) && fluid.change[2].after.is_none());
    let changes = |count: usize| format!("{GOOD}{}", "[[fluid.change]]\nat_s = 1.0\n".repeat(count));
    assert_eq!(parse(&changes(1_000)).unwrap().fluid.change.len(), 1_000);
    let error = parse(&changes(1_001)).unwrap_err();
    assert_eq!((error.kind, error.key.as_str()), (Kind::Range, "fluid.change"), "{error}");
}

#[test]
fn a_range_error_names_what_is_allowed_and_an_unknown_key_what_there_is() {
    assert!(error_with("3e4", "2e9").to_string().contains("allowed is 1 to 1000000000 Pa"));
    let text = error_with("scale_to_m", "scale").to_string();
    assert!(text.contains("`scale`") && text.contains("`scale_to_m`"), "{text}");
}

#[test]
fn a_scene_without_a_deformable_or_without_a_rigid_says_so() {
    let without = |table: &str| parse(&format!("version = 1\nname = \"x\"\n{table}")).unwrap_err();
    let error = without("[[rigid]]\nname = \"scope\"\n");
    assert_eq!((error.kind, error.key.as_str()), (Kind::Incomplete, "deformable"));
    let error = without("[[deformable]]\nname = \"organ\"\nmesh = \"a.msh\"\n");
    assert_eq!((error.kind, error.key.as_str()), (Kind::Incomplete, "rigid"));
}

#[test]
fn a_circle_of_attachments_is_refused() {
    let link = |name: &str, to: &str| format!("[[deformable]]\nname = \"{name}\"\nmesh = \"a.msh\"\nattach_to = \"{to}\"\n");
    let text =
        format!("version = 1\nname = \"x\"\n{}{}{}[[rigid]]\nname = \"s\"\n", link("a", "b"), link("b", "c"), link("c", "a"));
    let error = parse(&text).unwrap_err();
    assert_eq!((error.kind, error.line_column), (Kind::Name, Some((6, 1))), "{error}");
}

#[test]
fn a_scene_as_large_as_a_mesh_is_refused_before_it_is_parsed() {
    let error = parse(&"# x\n".repeat(300_000)).unwrap_err();
    assert_eq!(error.kind, Kind::TooLarge);
}

proptest! {
    #![proptest_config(ProptestConfig { rng_seed: RngSeed::Fixed(41), failure_persistence: None, ..ProptestConfig::default() })]

    /// No text makes the parser panic: any cut and any exchanged byte of a good scene is read or refused with one line.
    #[test]
    fn damaged_scenes_are_read_or_refused(cut in 0..GOOD.len(), at in 0..GOOD.len(), byte in 32u8..127) {
        let mut bytes = GOOD.as_bytes().to_vec();
        bytes[at] = byte;
        for text in [&GOOD.as_bytes()[..cut], &bytes[..]] {
            if let Err(error) = parse(std::str::from_utf8(text).unwrap()) {
                prop_assert!(!error.to_string().contains('\n'), "{error}");
            }
        }
    }

    #[test]
    fn any_text_is_read_or_refused(text in "[a-z=\\[\\]{}\"'.0-9\n #+-]{0,200}") {
        let _ = parse(&text).map_err(|error| error.to_string());
    }
}
