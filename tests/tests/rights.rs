//! A machine that refuses: real time, locked memory, shared memory. What cannot be had is said once and done without, or refused with one error.

use station_tests::{Folder, Station, binaries, run};
use std::fmt::Write;
use std::process::Command;

fn is_root() -> bool {
    rustix::process::geteuid().is_root()
}

/// How often a text stands in another.
fn count(text: &str, part: &str) -> usize {
    text.matches(part).count()
}

#[test]
fn without_the_right_to_real_time_and_locked_memory_the_station_runs_and_says_so_once() {
    let limits = ["prlimit", "--rtprio=0", "--memlock=0"];
    // The limits bind an ordinary user; root's rights have to be taken away too.
    let bounds = ["setpriv", "--bounding-set=-sys_nice,-ipc_lock", "--inh-caps=-sys_nice,-ipc_lock"];
    let wrapper: Vec<&str> = if is_root() { bounds.into_iter().chain(limits).collect() } else { limits.to_vec() };
    let station = Station::start_under(&wrapper, "rights", &["--hand", "script:press"]);
    station.run_ticks(1_500);
    station.kill("haptic", true); // who comes later is refused too, and that is no news
    station.run_ticks(500);
    let (fresh, _) = station.ledger();
    assert!(fresh > 1_000, "{}", station.said());
    let ended = station.stop();
    ended.assert_clean();
    assert_eq!(count(&ended.said, "real time was refused"), 1, "{}", ended.said);
    assert_eq!(count(&ended.said, "locking the memory was refused"), 1, "{}", ended.said);
    assert!(ended.said.contains("doctor"), "the cure: {}", ended.said);
}

#[test]
fn with_the_rights_nothing_is_said_of_them() {
    let station = Station::start("granted", &["--hand", "idle"]);
    station.run_ticks(200);
    let ended = station.stop();
    ended.assert_clean();
    let granted = run(Command::new("chrt").args(["-f", "1", "true"])).0 == Some(0);
    assert_eq!(count(&ended.said, "real time was refused"), usize::from(!granted), "{}", ended.said);
}

/// In a namespace of its own, so that nobody else's memory is full. One that is too small is bad input; one that others fill may be free the next time, and a
/// service was ended by it for good.
#[test]
fn a_full_shared_memory_is_one_error_and_leaves_nothing() {
    let (code, _, said) = run(Command::new("unshare").args(["-m", "true"]));
    assert!(code == Some(0) || !is_root(), "root may not unshare: {said}");
    if code != Some(0) {
        println!("not tried: this user may not make a mount namespace ({})", said.trim());
        return;
    }
    let folder = Folder::new("full");
    let large = folder.write("large.msh", &block(14));
    // The third one has room for a station, but not for one of this organ; of the last one others have the half.
    let cases = [("16m", "", "1", 2), ("96m", "", "1", 2), ("640m", large.as_str(), "1", 2), ("768m", "", "256M", 1)];
    for (size, scene, others, expected) in cases {
        let program = binaries().join("hystation");
        let script = format!(
            "mount -t tmpfs -o size={size} full /dev/shm && fallocate -l {others} /dev/shm/others && \
             {{ \"{}\" --name full-{} run {scene} --headless --for 1s --set tissue_step_ticks=4; code=$?; \
             echo \"left $(ls -A /dev/shm | wc -l)\"; exit $code; }}",
            program.display(),
            std::process::id()
        );
        let (code, text, said) = run(Command::new("unshare").args(["-m", "sh", "-c", &script]));
        assert_eq!(code, Some(expected), "{size}: {said}");
        assert_eq!(text.trim(), "left 1", "{size}: the file of the others alone: {said}");
        let errors = said.lines().filter(|line| line.contains("MiB free")).count();
        assert!(errors == 1 && (!scene.is_empty() || said.lines().count() == 1), "{size}: {said}");
        assert!(said.contains("/dev/shm") && said.contains("remount"), "{size}: {said}");
    }
}

/// A block of cells of 4 mm, five tets each, as a file of Gmsh 2.2.
fn block(cells: usize) -> String {
    let node = |[i, j, k]: [usize; 3]| 1 + i + (cells + 1) * (j + (cells + 1) * k);
    let grid = |count: usize| (0..count).flat_map(move |k| (0..count).flat_map(move |j| (0..count).map(move |i| [i, j, k])));
    let mut text = format!("$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{}\n", (cells + 1).pow(3));
    grid(cells + 1).for_each(|at| writeln!(text, "{} {} {} {}", node(at), 4 * at[0], 4 * at[1], 4 * at[2]).unwrap());
    write!(text, "$EndNodes\n$Elements\n{}\n", 5 * cells.pow(3)).unwrap();
    let corner = |at: [usize; 3], bits: usize| node([at[0] + (bits & 1), at[1] + (bits >> 1 & 1), at[2] + (bits >> 2)]);
    let mut tag = 0;
    for at in grid(cells) {
        // Corners by the bits of their place; neighbours are mirror images, so that their faces fit.
        let mirrored = if at.iter().sum::<usize>() % 2 == 0 { 0 } else { 1 };
        for tet in [[0, 1, 2, 4], [3, 1, 2, 7], [5, 1, 4, 7], [6, 2, 4, 7], [1, 2, 4, 7]] {
            tag += 1;
            let nodes = tet.map(|bits| corner(at, bits ^ mirrored));
            writeln!(text, "{tag} 4 2 1 1 {} {} {} {}", nodes[0], nodes[1], nodes[2], nodes[3]).unwrap();
        }
    }
    text + "$EndElements\n"
}
