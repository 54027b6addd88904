//! Bad input: one clear error (what, where, what to do) and exit code 2; nothing is left behind; never a half-started station.

use station_tests::{Folder, Station, hystation, run, wait_for};

/// The scripted hand touches the tissue once in each round of 2 s.
const TOUCH_LIMIT: std::time::Duration = std::time::Duration::from_secs(60);

/// A block of 4 × 4 × 4 cubes of five tets each, 4 cm wide, as a Gmsh 2.2 file.
fn block() -> String {
    let n = 4usize;
    let node = |i: usize, j: usize, k: usize| 1 + i + (n + 1) * (j + (n + 1) * k);
    let mut nodes = String::new();
    for k in 0..=n {
        for j in 0..=n {
            for i in 0..=n {
                nodes += &format!("{} {} {} {}\n", node(i, j, k), i as f64 * 0.01, j as f64 * 0.01, k as f64 * 0.01);
            }
        }
    }
    let mut tets = Vec::new();
    for k in 0..n {
        for j in 0..n {
            for i in 0..n {
                let c = |bits: usize| node(i + (bits & 1), j + (bits >> 1 & 1), k + (bits >> 2));
                let even = [[0, 1, 2, 4], [3, 1, 7, 2], [5, 1, 4, 7], [6, 2, 7, 4], [1, 2, 4, 7]];
                let odd = [[1, 0, 5, 3], [2, 0, 3, 6], [4, 0, 6, 5], [7, 3, 5, 6], [0, 3, 6, 5]];
                let chosen = if (i + j + k) % 2 == 0 { even } else { odd };
                tets.extend(chosen.map(|tet| tet.map(c)));
            }
        }
    }
    let count = tets.len();
    let rows: String =
        tets.iter().enumerate().map(|(at, t)| format!("{} 4 2 0 1 {} {} {} {}\n", at + 1, t[0], t[1], t[2], t[3])).collect();
    let all = (n + 1).pow(3);
    format!("$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{all}\n{nodes}$EndNodes\n$Elements\n{count}\n{rows}$EndElements\n")
}

fn refused(arguments: &[&str], must_say: &[&str]) {
    let name = format!("bad-{}", std::process::id());
    let (code, _, said) = run(hystation().args(["--name", &name, "run", "--headless", "--for", "1s"]).args(arguments));
    assert_eq!(code, Some(2), "{arguments:?}: {said}");
    for word in must_say {
        assert!(said.contains(word), "{arguments:?} does not say {word:?}: {said}");
    }
    assert!(!said.contains("panicked"), "{said}");
    let left = hyst_exchange::Station::named(&name).unwrap().leftovers();
    assert!(left.is_empty(), "{arguments:?} left {left:?}");
}

#[test]
fn a_scene_that_cannot_be_used_is_refused_before_anything_starts() {
    let folder = Folder::new("input-scene");
    let mesh = block();
    folder.write("block.msh", &mesh);
    folder.write("short.msh", &mesh[..mesh.len() / 2]);
    folder.write("nan.msh", &mesh.replacen("0.01 0 0\n", "nan 0 0\n", 1));
    let out_of_range = mesh.replacen("1 4 2 0 1 ", "1 4 2 0 1 9999", 1);
    folder.write("range.msh", &out_of_range);
    let scene = |mesh: &str, more: &str| {
        format!(
            "version = 1\nname = \"x\"\n[[deformable]]\nname = \"organ\"\nmesh = \"{mesh}\"\n{more}\n[[rigid]]\nname = \"scope\"\n"
        )
    };
    let cases = [
        ("missing.toml", scene("nowhere.msh", ""), "nowhere.msh"),
        ("short.toml", scene("short.msh", ""), "short.msh"),
        ("nan.toml", scene("nan.msh", ""), "nan.msh"),
        ("range.toml", scene("range.msh", ""), "range.msh"),
        ("unknown.toml", scene("block.msh", "colour = 3"), "colour"),
        ("absurd.toml", scene("block.msh", "scale_to_m = 1000.0"), "scale"),
        ("rigid.toml", "version = 1\nname = \"x\"\n[[deformable]]\nname = \"organ\"\nmesh = \"block.msh\"\n".into(), "rigid"),
        ("soft.toml", "version = 1\nname = \"x\"\n[[rigid]]\nname = \"scope\"\n".into(), "deformable"),
    ];
    for (name, text, word) in cases {
        refused(&[&folder.write(name, &text)], &[word]);
    }
    refused(&["/nowhere/at-all.toml"], &["/nowhere/at-all.toml"]);
}

#[test]
fn a_case_that_cannot_be_done_is_refused_before_anything_starts() {
    let folder = Folder::new("input-case");
    let assets = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets");
    let scene = assets.join("scenes/default.toml").display().to_string();
    let good = std::fs::read_to_string(assets.join("cases/polyp.toml")).unwrap().replace("../scenes/default.toml", &scene);
    for (from, to, words) in [
        ("percent = 80.0", "percent = 180.0", ["percent", "0.1 to 100 %"]),
        ("object = \"uterus\"", "object = \"ovary\"", ["ovary", "uterus, polyp"]),
        ("energy = \"bipolar\"", "energy = \"monopolar\"", ["goal[1].biopsy", "saline conducts"]),
        ("deficit_above_ml = 1_000.0", "deficit_above_ml = 2_500.0", ["deficit_above_ml", "ends before"]),
        (&scene, "nowhere.toml", ["scene", "nowhere.toml"]),
    ] {
        assert!(good.contains(from), "{from}");
        refused(&[&folder.write("case.toml", &good.replace(from, to))], &[&["case.toml:"], &words[..]].concat());
    }
    let case = folder.write("case.toml", &good);
    refused(&[&case, "--set", "seed=-1"], &["seed=-1", "whole number"]);
    refused(&[&case, "--set", "seed=1.5"], &["seed=1.5", "whole number"]);
    refused(&["--set", "seed=1"], &["seed=1", "a case alone has a seed"]);
    refused(&[&case], &["a case needs somebody's hand", "--hand gamepad", "--driver FILE"]);
    refused(&[&case, "--lockstep"], &["a case needs somebody's hand"]);
}

#[test]
fn arguments_that_mean_nothing_are_refused() {
    refused(&["--set", "colour=red"], &["colour", "realtime"]);
    refused(&["--set", "isa=mmx"], &["isa"]);
    refused(&["--set", "picture_size=7x7"], &["picture_size", "1920x1080"]);
    refused(&["--set", "picture_hz=50"], &["picture_hz=50", "30, 60, 120 or 240"]);
    refused(&["--set", "focus_mm=2"], &["focus_mm=2", "3 to 100"]);
    refused(&["--hand", "script:juggle"], &["juggle"]);
    refused(&["--hand", "gamepad:/dev/null"], &["/dev/null", "no input device"]);
    refused(&["--workers", "1000"], &["workers"]);
    let (code, _, said) = run(hystation().args(["--name", "No Name", "run", "--headless", "--for", "1s"]));
    assert_eq!(code, Some(2), "{said}");
}

#[test]
fn two_stations_of_one_name_do_not_meet_and_two_of_different_names_do_not_either() {
    // Without a driver for pictures: beside two stations at real time on two cores, software rasterizers get next to no time.
    let start =
        |name| Station::start_under(&["env", "VK_DRIVER_FILES=/nowhere", "VK_ICD_FILENAMES=/nowhere"], name, &["--hand", "idle"]);
    let first = start("twin");
    let (code, _, said) = run(hystation().args(["--name", first.name(), "run", "--headless", "--for", "1s"]));
    assert_eq!(code, Some(2), "{said}");
    assert!(said.contains(first.name()), "{said}");
    let second = start("other");
    second.run_ticks(200);
    // Two stations on two cores may each replace a process that got no time; both come back to their full number.
    first.recover();
    second.recover();
    let (of_first, of_second) = (first.pids(), second.pids());
    assert!(of_first.is_disjoint(&of_second), "{of_first:?} and {of_second:?} share a process");
    second.stop().assert_clean();
    first.recover();
    first.run_ticks(200);
    first.stop().assert_clean();
}

#[test]
fn somebody_elses_mesh_is_touched_and_one_with_inverted_tets_is_repaired_and_said() {
    let folder = Folder::new("input-organ");
    // Every tet turned inside out: swaps the last two nodes of each element line.
    let turned: String = block()
        .lines()
        .map(|line| match line.split(' ').collect::<Vec<_>>().as_slice() {
            [id, "4", a, b, c, n1, n2, n3, n4] => format!("{id} 4 {a} {b} {c} {n1} {n2} {n4} {n3}\n"),
            _ => format!("{line}\n"),
        })
        .collect();
    let mesh = folder.write("turned.msh", &turned);
    let (code, text, said) = run(hystation().args(["check", &mesh]));
    assert_eq!(code, Some(0), "{said}");
    assert!(text.contains("inverted"), "{text}");
    let station = Station::start("organ", &[mesh.as_str(), "--hand", "script:press"]);
    let felt = wait_for(TOUCH_LIMIT, || Some(station.force_n()).filter(|force_n| *force_n > 0.05));
    assert!(felt.is_some(), "the hand has felt nothing\n{}", station.said());
    station.stop().assert_clean();
}

#[test]
fn without_real_time_the_station_runs_and_says_so() {
    let station = Station::start("ordinary", &["--set", "realtime=off", "--hand", "idle"]);
    station.run_ticks(500);
    station.stop().assert_clean();
}

#[test]
fn a_scene_whose_files_are_edited_or_gone_is_nothing_to_a_station_that_runs_it() {
    let folder = Folder::new("input-edited");
    let mesh = block();
    let path = folder.write("block.msh", &mesh);
    let station = Station::start("edited", &[&path, "--hand", "script:press"]);
    for engine in ["fluid", "tissue"] {
        folder.write("block.msh", &mesh.replacen("0.01 0 0\n", "0.011 0 0\n", 1));
        station.kill(engine, true);
        std::fs::remove_file(&path).expect("it is there");
        station.kill(engine, true);
    }
    let (_, before) = station.deficit();
    station.run_ticks(500);
    assert!(station.deficit().1 > before, "the flow goes on");
    let felt = wait_for(TOUCH_LIMIT, || Some(station.force_n()).filter(|force_n| *force_n > 0.05));
    assert!(felt.is_some(), "the hand feels nothing any more\n{}", station.said());
    station.stop().assert_clean();
}

/// A try of an engine that is refused takes a second on an idle machine, and the next one comes within seconds.
const REFUSAL_LIMIT: std::time::Duration = std::time::Duration::from_secs(60);

/// A mesh that is named by its whole path would not be found in a copy: the station says so, and what is edited is refused.
#[test]
fn a_scene_that_cannot_be_copied_and_is_edited_is_refused_by_a_restarted_engine_and_the_station_goes_on() {
    let folder = Folder::new("input-whole");
    let mesh = block();
    let path = folder.write("block.msh", &mesh);
    let scene = format!(
        "version = 1\nname = \"a block\"\n[[deformable]]\nname = \"organ\"\nmesh = {path:?}\nplace = \"auto\"\n\
         [[rigid]]\nname = \"hysteroscope\"\n"
    );
    let scene = folder.write("scene.toml", &scene);
    let station = Station::start("whole", &[&scene, "--hand", "script:press"]);
    assert!(station.said().contains("the station has no copy of its scene"), "{}", station.said());
    folder.write("block.msh", &mesh.replacen("0.01 0 0\n", "0.011 0 0\n", 1));
    station.signal(station.pid("fluid", false), rustix::process::Signal::KILL);
    let root = hyst_exchange::Station::named(station.name()).unwrap();
    let logs = || {
        let slots = [0, 1].map(|index| hyst_messages::Slot::new(hyst_messages::Role::Fluid, index).unwrap());
        slots.map(|slot| std::fs::read_to_string(root.log(slot)).unwrap_or_default()).concat()
    };
    let refused = wait_for(REFUSAL_LIMIT, || logs().contains("was changed since the station started").then_some(()));
    assert!(refused.is_some(), "not refused: {}\n{}", logs(), station.said());
    let (_, before) = station.deficit();
    station.run_ticks(500);
    assert!(station.deficit().1 > before, "the other one goes on");
    folder.write("block.msh", &mesh);
    station.recover();
    station.stop().assert_clean();
}

/// Starts an engine by hand, as nobody should; gives its exit code and what it said.
fn start_by_hand(station: &Station, slot: hyst_messages::Slot, incarnation: u32) -> (Option<i32>, String) {
    let mut engine = std::process::Command::new(station_tests::binaries().join(slot.role().name()));
    engine.stdin(std::process::Stdio::null());
    let (slot, incarnation) = (slot.to_string(), incarnation.to_string());
    engine.args(["--station", station.name(), "--slot", &slot, "--incarnation", &incarnation]);
    let (code, _, said) = run(&mut engine);
    (code, said)
}

/// An engine of another build finds a page whose words lie elsewhere, a second one of the same life a page that is written: each says one line, ends with
/// code 2, and disturbs nobody.
#[test]
fn an_engine_of_another_version_or_of_a_life_that_is_lived_is_refused_by_the_page_and_the_station_goes_on() {
    use hyst_messages::{Role, Slot, page::header};
    let station = Station::start("version", &["--hand", "script:press"]);
    let root = hyst_exchange::Station::named(station.name()).unwrap();
    let of_roles = || {
        ["collision-worker", "tissue", "haptic", "fluid"]
            .map(|role| station.processes(role).iter().map(|of| of["pid"].clone()).collect::<Vec<_>>())
    };
    let before = of_roles();
    for (role, index) in [(Role::CollisionWorker, 5), (Role::Tissue, 1), (Role::Haptic, 1), (Role::Fluid, 1)] {
        let slot = Slot::new(role, index).unwrap();
        let page = root.create_slot(slot, 900_000).unwrap();
        page.store64(header::MAGIC, hyst_exchange::page::magic() ^ 1); // that of another layout
        let (code, said) = start_by_hand(&station, slot, 900_000);
        std::fs::remove_file(root.slot_page(slot, 900_000)).unwrap();
        assert_eq!(code, Some(2), "{slot}: {said}");
        assert!(said.contains("another version") && said.contains("rebuild all binaries"), "{slot}: {said}");
        assert_eq!(said.trim().lines().count(), 1, "{said}");
    }
    for process in ["device", "haptic", "tissue", "fluid", "collision-worker"].iter().flat_map(|role| station.processes(role)) {
        let slot = Slot::parse(process["name"].as_str().unwrap()).unwrap();
        let (code, said) = start_by_hand(&station, slot, process["incarnation"].as_u64().unwrap() as u32);
        if station.processes(slot.role().name()).iter().all(|now| now["pid"] != process["pid"]) {
            continue; // a busy machine had it replaced meanwhile
        }
        assert_eq!(code, Some(2), "{slot}: {said}");
        assert!(said.contains(&format!("is the life of process {}", process["pid"])), "{slot}: {said}");
        assert_eq!(said.trim().lines().count(), 1, "{said}");
    }
    station.run_ticks(500);
    station.recover();
    assert_eq!(of_roles(), before, "nobody was disturbed\n{}", station.said());
    station.stop().assert_clean();
}

/// Exit code, and the lines that `doctor` says with the cure after each, of a program in a folder and an environment.
fn doctor(program: &std::path::Path, environment: (&str, &str)) -> (Option<i32>, Vec<String>) {
    let mut command = std::process::Command::new(program);
    let (code, told, said) = run(command.arg("doctor").env(environment.0, environment.1));
    assert!(said.is_empty(), "{said}");
    (code, told.replace("\n       ", " ").lines().map(str::to_string).collect())
}

#[test]
fn doctor_names_the_cure_of_what_is_missing_and_only_what_no_station_starts_without_is_its_exit_code() {
    let line = |lines: &[String], what: &str| {
        let found = lines.iter().find(|line| line.get(6..).is_some_and(|text| text.starts_with(what)));
        found.unwrap_or_else(|| panic!("no {what}: {lines:#?}")).clone()
    };
    let whole = station_tests::binaries().join("hystation");
    let (code, lines) = doctor(&whole, ("VK_DRIVER_FILES", "/nowhere/icd.json"));
    let pictures = line(&lines, "Vulkan");
    // A machine without even a loader says that first.
    let words = if pictures.contains("no loader") { "apt install" } else { "/nowhere/icd.json: No such file" };
    assert!(pictures.starts_with("weak") && pictures.contains(words) && pictures.contains("cure: "), "{pictures}");
    for what in ["cores", "real time", "/dev/shm", "disk", "programs"] {
        line(&lines, what);
    }
    let is_bad = |lines: &[String]| lines.iter().any(|line| line.starts_with("bad "));
    assert_eq!(code, Some(i32::from(is_bad(&lines))), "{lines:#?}");
    assert!(lines.iter().all(|line| line.starts_with("good") != line.contains("cure: ")), "{lines:#?}");

    let folder = Folder::new("doctor");
    let alone = folder.as_path().join("hystation");
    std::fs::copy(&whole, &alone).expect("a copy");
    let (code, lines) = doctor(&alone, ("VK_DRIVER_FILES", ""));
    let programs = line(&lines, "programs");
    assert!(programs.starts_with("bad ") && programs.contains("tissue") && programs.contains("./station build"), "{programs}");
    assert_eq!(code, Some(1), "{lines:#?}");

    let (code, told, said) = run(std::process::Command::new(&alone).args(["doctor", "--json"]));
    let found: Vec<serde_json::Value> = serde_json::from_str(&told).unwrap_or_else(|error| panic!("{error}: {told}{said}"));
    let programs = found.iter().find(|finding| finding["what"] == "programs").expect("the programs");
    assert_eq!((code, programs["state"].as_str()), (Some(1), Some("bad")), "{programs}");
    assert!(found.iter().all(|finding| (finding["state"] == "good") == finding["cure"].is_null()), "{told}");
}
