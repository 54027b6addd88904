//! A session in which both servos lost ticks at once is done again to the bit, too.

use super::{record, same, verify};
use hyst_recording::Recording;
use station_tests::Folder;
use std::collections::BTreeSet;
use std::path::Path;

/// From this tick on.
const HELD_TICK: u32 = 2_000;

/// Nobody had written down whose state each of the two went on from: seven of sixteen sessions in which both cores were taken away had other forces.
#[test]
fn a_session_in_which_both_servos_were_held_up_at_once_is_done_again_to_the_bit() {
    let folder = Folder::new("replay-servos");
    let file = folder.path("session.mcap");
    // Somewhere in a tick, for 2 to 20 ms: one of them has answered it, both have, or neither.
    let stops = (0..25).map(|n: u32| {
        let (tick, phase_us, for_s) = (HELD_TICK + 150 * n, 37 * n % 300, f64::from(2 + 7 * n % 19) * 1e-3);
        let when = format!("tick = {tick}\nphase_us = {phase_us}\nfor = {for_s}");
        format!("[[fault]]\nkind = \"stop\"\ntarget = \"haptic:both\"\n{when}\n")
    });
    let faults = folder.write("faults.toml", &format!("seed = 1\n{}", stops.collect::<String>()));
    record("held", &file, &["--for", "6500ms", "--hand", "script:press", "--test-mode", "--faults", &faults]);
    let origins = Recording::read(Path::new(&file)).unwrap().content.origins;
    let held = origins.iter().filter(|origin| origin.tick > u64::from(HELD_TICK));
    let servos: BTreeSet<u32> = held.map(|origin| origin.servo).collect();
    assert_eq!(servos, BTreeSet::from([0, 1]), "not both lost ticks: {origins:?}");

    let (code, said, complained) = verify("held", &file, &[]);
    // 3: this machine did not let the device of the replay run.
    assert!(matches!(code, Some(0 | 3)), "{code:?} {said}{complained}");
    assert!(same(&said).0 > 4_000, "{said}");
}
