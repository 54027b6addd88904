//! docs/driver.md says what a device may state, and the check of a statement lets pass just that, to the ends of each range.

use hyst_messages::DeviceStatement;
use support::stated;

#[path = "../../../shared/messages/tests/support/stated.rs"]
mod support;

const DOCUMENT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/driver.md");

type Set = fn(&mut DeviceStatement, f32);
const NUMBERS: [(&str, Set); 6] = [
    ("rate_hz", |it, value| it.rate_hz = value),
    ("max_force_n", |it, value| (it.limits.max_force_n, it.continuous_force_n) = (value, 0.05)),
    ("max_stiffness_n_m", |it, value| it.limits.max_stiffness_n_m = value),
    ("max_damping_n_s_m", |it, value| it.limits.max_damping_n_s_m = value),
    ("resolution_m", |it, value| it.resolution_m = value),
    ("device_damping_n_s_m", |it, value| it.device_damping_n_s_m = value),
];

type SetRange = fn(&mut DeviceStatement, [f32; 2]);
const RANGES: [(&str, SetRange); 4] = [
    ("pitch_rad", |it, range| it.pitch_rad = range),
    ("yaw_rad", |it, range| it.yaw_rad = range),
    ("roll_rad", |it, range| it.roll_rad = range),
    ("insertion_m", |it, range| it.insertion_m = range),
];

/// What the table allows in the row of a field.
fn allowed(document: &str, field: &str) -> String {
    let head = format!("| `{field}`");
    let row = document.lines().find(|line| line.starts_with(&head)).unwrap_or_else(|| panic!("no row of {field}"));
    row.split('|').nth(3).unwrap_or_else(|| panic!("{row}")).trim().to_owned()
}

fn number(text: &str) -> f32 {
    text.replace(' ', "").parse().unwrap_or_else(|_| panic!("{text:?} is no number"))
}

/// `0.1 to 100`, also after what stands for a number that is not known.
fn ends(text: &str) -> [f32; 2] {
    let known = text.replace("(not known)", "");
    let range = known.rsplit(", or ").next().unwrap_or_default();
    let (least, most) = range.split_once(" to ").unwrap_or_else(|| panic!("{text:?} is no range"));
    [number(least), number(most)]
}

#[test]
fn a_device_may_state_what_the_document_allows_and_nothing_beyond() {
    let document = std::fs::read_to_string(DOCUMENT).expect("the document");
    for (name, set) in NUMBERS {
        let [least, most] = ends(&allowed(&document, name));
        let checked = |value: f32| {
            let mut it = stated();
            set(&mut it, value);
            it.check()
        };
        assert_eq!([checked(least), checked(most)], [Ok(()), Ok(())], "{name}: {least} and {most}");
        for value in [0.99 * least - 1e-9, 1.01 * most, f32::NAN] {
            assert!(checked(value).is_err_and(|why| why.starts_with(name)), "{name}: {value}");
        }
    }
    // One row has all four.
    let widest = allowed(&document, RANGES[0].0);
    let widest: Vec<[f32; 2]> = (widest.split(", "))
        .map(|text| text.strip_prefix('±').map_or_else(|| ends(text), |most| [-number(most), number(most)]))
        .collect();
    assert_eq!(widest.len(), RANGES.len(), "{widest:?}");
    for ((name, set), [least, most]) in RANGES.into_iter().zip(widest) {
        let checked = |range: [f32; 2]| {
            let mut it = stated();
            set(&mut it, range);
            it.check()
        };
        assert_eq!(checked([least, most]), Ok(()), "{name}: {least} to {most}");
        for range in [[least - 0.01, most], [least, most + 0.01], [most, least], [f32::NAN, most], [least, f32::NAN]] {
            assert!(checked(range).is_err_and(|why| why.starts_with(name)), "{name}: {range:?}");
        }
    }
}
