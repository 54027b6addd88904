//! What a campaign's file may say, and what it is told when it cannot be.

use super::*;
use crate::campaign::cell::{May, State};
use crate::faultfile::{FaultKind, Injection, Place};
use hyst_messages::Role;
use std::collections::BTreeSet;

/// Who can be hurt through the supervisor.
const ROLES: [Role; 8] = [
    Role::Device,
    Role::Haptic,
    Role::Tissue,
    Role::CollisionWorker,
    Role::Fluid,
    Role::Rendering,
    Role::Recorder,
    Role::Console,
];

const GOOD: &str = "seed = 4\n[[pool]]\nname = \"others\"\nlimit_upper95 = 0.02\n\
                    [[arm]]\nname = \"spares\"\n[[arm]]\nname = \"alone\"\nshare = 0.1\njudged = false\n[arm.set]\nspares = \"off\"\n\
                    [[cell]]\nkinds = [\"kill\", \"stop\"]\ntargets = [\"haptic:active\"]\nstates = [\"idle\", \"contact\"]\ncount = 15\n\
                    [[cell]]\nkinds = [\"stop\"]\ntargets = [\"fluid\"]\ncount = 1\npool = \"others\"\nfor = 0.5\n\
                    [[cell]]\nkinds = [\"kill\"]\ntargets = [\"supervisor\", \"device\"]\ncount = 2\n";

fn refusal(change: &str, by: &str) -> String {
    assert!(GOOD.contains(change), "{change}");
    parse("t", &GOOD.replace(change, by)).unwrap_err()
}

#[test]
fn every_kind_meets_every_target_in_every_state() {
    let campaign = parse("t", GOOD).unwrap();
    let names: Vec<&str> = campaign.cells.iter().map(|cell| cell.name.as_str()).collect();
    let expected = [
        "kill haptic:active idle",
        "kill haptic:active in contact",
        "stop haptic:active idle",
        "stop haptic:active in contact",
        "stop fluid for=0.5",
        "kill supervisor",
        "kill device",
    ];
    assert_eq!(names, expected);
    let fluid = &campaign.cells[4];
    assert_eq!((fluid.injection.for_s, fluid.limit_upper95, fluid.pool.as_deref()), (Some(0.5), None, Some("others")));
    assert_eq!((campaign.cells[0].limit_upper95, campaign.cells[0].state), (Some(0.05), State::Idle));
    assert_eq!((campaign.cells[6].allowed_misses, campaign.cells[5].allowed_misses), (20, 0));
    // 4 × 15 + 1 + 2 × 2, and a tenth of it, rounded up for each cell: 4 × 2 + 1 + 2 × 1.
    assert_eq!(campaign.faults(), 65 + 11);
    assert_eq!(campaign.set(&campaign.arms[1])["spares"], "off");
}

#[test]
fn a_cell_that_cannot_be_is_refused_with_what_there_is() {
    for (change, by, words) in [
        ("\"haptic:active\"", "\"heptic\"", "heptic"),
        ("\"haptic:active\"", "\"hardware\"", "hardware"),
        ("\"haptic:active\"", "\"collision-worker:7\"", "collision-worker:1"),
        ("\"haptic:active\"", "\"tissue:spare\"", "\"alone\""),
        ("[\"kill\", \"stop\"]", "[\"melt\"]", "segfault"),
        ("[\"kill\", \"stop\"]", "[\"cont\"]", "for = SECONDS"),
        ("[\"kill\", \"stop\"]", "[\"undo\"]", "nothing is"),
        ("[\"kill\", \"stop\"]", "[]", "empty"),
        ("[\"idle\", \"contact\"]", "[\"swap\"]\nswap = \"hardware\"", "is not swapped"),
        ("[\"idle\", \"contact\"]", "[\"asleep\"]", "idle, contact"),
        ("count = 15", "count = 0", "0"),
        ("count = 15", "count = 15\ncolour = 3", "colour"),
        ("count = 15", "count = 15\ntick = 3", "drawn"),
        ("count = 15", "count = 200000", "at most"),
        ("count = 15", "count = 9223372036854775807", "at most"), // four cells of these are more than can be counted
        ("count = 15", "count = 15\nlimit_upper95 = nan", "limit"),
        ("count = 15", "count = 15\nfound_ms = nan", "found_ms"),
        ("count = 15", "count = 15\nfound_ms = 0.0", "found_ms"),
        ("count = 15", "count = 15\nwith = \"kill tissue:active\"", "recovery"),
        ("for = 0.5", "for = -1.0", "3600"),
        ("pool = \"others\"", "pool = \"other\"", "no [[pool]]"),
        ("\"supervisor\", \"device\"", "\"device\", \"device\"", "twice"),
        ("count = 2\n", "count = 2\nfor = 1.0\n", "without options"),
        ("for = 0.5", "for = 0.5\nbytes = 3", "belong to corrupt"),
        ("kinds = [\"stop\"]", "kinds = [\"kill\"]", "takes no duration"),
        ("share = 0.1", "share = 0.0", "share"),
        ("spares = \"off\"", "spares = \"of\"", "on or off"),
        ("name = \"alone\"", "name = \"spares\"", "twice"),
        ("seed = 4", "gap_ticks = [10, 20]", "gap_ticks"),
        ("seed = 4", "most_void = 2.0", "most_void"),
        ("seed = 4", "faults_per_station = 0", "faults_per_station"),
        ("seed = 4", "sead = 4", "sead"),
        ("seed = 4", "[station]\nhand = \"idle\"", "never touches"),
        ("seed = 4", "[station]\nworkers = 99", "workers"),
    ] {
        let reason = refusal(change, by);
        assert!(reason.contains(words), "{by}: {reason}");
    }
    assert!(parse("t", "").unwrap_err().contains("injects nothing"));
    let text = "[station]\nrecord = false\n[[cell]]\nkinds = [\"kill\"]\ntargets = [\"recorder\"]\ncount = 1\n";
    assert!(parse("t", text).unwrap_err().contains("no recorder"));
    let text = "[station]\nrecord = false\n[[cell]]\nkinds = [\"kill\"]\ntargets = [\"fluid\"]\nstates = [\"swap\"]\nswap = \"recorder\"\ncount = 1\n";
    assert!(parse("t", text).unwrap_err().contains("have no recorder"));
    assert!(parse("t", &text.replace("record = false", "")).is_ok());
}

/// They were accepted, and each of their faults was refused by a station that had been started for it.
#[test]
fn a_cell_of_a_process_or_a_swap_that_its_stations_do_not_have_is_refused() {
    let swap = |station: &str, role: &str| {
        let cell = "[[cell]]\nkinds = [\"kill\"]\ntargets = [\"tissue:active\"]\nstates = [\"swap\"]\ncount = 1\n";
        parse("t", &format!("[station]\n{station}\n{cell}swap = {role:?}\n")).map(|_| ())
    };
    let (alone, dark) = ("set = { spares = \"off\" }", "set = { console = \"off\" }");
    for (station, role, words) in [
        ("workers = 0", "collision-worker", "no collision-worker"),
        (dark, "console", "no console"),
        (alone, "haptic", "take out spares"),
    ] {
        assert!(swap(station, role).unwrap_err().contains(words), "{station}: {role}");
        assert_eq!(swap("", role), Ok(()), "{role}");
    }
    assert_eq!([swap(alone, "fluid"), swap(alone, "device")], [Ok(()), Ok(())], "each has a place for its newcomer");
    let text = format!("[station]\n{dark}\n[[cell]]\nkinds = [\"kill\"]\ntargets = [\"console\"]\ncount = 1\n");
    assert!(parse("t", &text).unwrap_err().contains("the station has no console"));
}

/// Both were accepted, and had no recovery that could be judged.
#[test]
fn a_fault_after_which_nobody_comes_back_by_design_is_refused() {
    let cell = |keys: &str| parse("t", &format!("[[cell]]\ncount = 1\n{keys}\n"));
    let loops = |target: &str, times: u32, more: &str| {
        cell(&format!("kinds = [\"crash-loop\"]\ntargets = [\"{target}\"]\ntimes = {times}\n{more}"))
    };
    assert!(loops("rendering", 7, "").is_ok() && loops("recorder", 14, "").is_ok());
    for (target, times) in [("rendering", 8), ("recorder", 15), ("device", 20)] {
        assert!(loops(target, times, "").unwrap_err().contains("given up by design"), "{target}");
        assert!(loops(target, times, "may = [\"station-ends\"]").is_ok(), "{target}");
    }
    for kind in ["hang-start", "crash-loop"] {
        let newcomer = |role: &str| {
            cell(&format!("kinds = [\"{kind}\"]\ntargets = [\"{role}:newcomer\"]\nstates = [\"swap\"]\nswap = \"{role}\""))
        };
        for role in ["tissue", "fluid"] {
            assert!(newcomer(role).unwrap_err().contains("no successor"), "{kind} {role}");
        }
        assert!(newcomer("rendering").is_ok(), "{kind}: the old engine comes back in its place");
    }
    let beside =
        "kinds = [\"kill\"]\ntargets = [\"haptic:active\"]\nstates = [\"recovery\"]\nwith = \"crash-loop tissue:active times=9\"";
    assert!(cell(beside).unwrap_err().contains("given up by design"));
}

#[test]
fn both_of_a_role_and_those_who_keep_the_station_are_targets_too() {
    let text = "[[cell]]\nkinds = [\"kill\", \"abort\"]\ntargets = [\"haptic:both\", \"guardian\", \"supervisor+guardian\"]\ncount = 2\n";
    let campaign = parse("t", text).unwrap();
    assert_eq!(campaign.cells.iter().map(Cell::faults).collect::<Vec<_>>(), [2, 1, 1, 2, 1, 1]);
    for (change, by, words) in [
        ("\"abort\"", "\"stop\"", "duration"),
        ("\"abort\"", "\"spin\"", "kill, stop"),
        ("\"abort\"", "\"no-files\"", "duration"),
        ("\"haptic:both\"", "\"rendering:both\"", "rendering:both"),
        ("count = 2", "states = [\"recovery\"]\ncount = 2", "any"),
    ] {
        let reason = parse("t", &text.replace(change, by)).unwrap_err();
        assert!(reason.contains(words), "{by}: {reason}");
    }
}

/// Faults of a kind by each of its options; of the kind as a whole twenty are to show.
const LEAST_OF_AN_OPTION: usize = 8;

/// The files that hold every kind of fault together, but for what is slow to be found and file systems that are full.
const OF_EVERY_KIND: [&str; 4] = ["corrupt", "ends", "lies", "station"];
const FOUND_SLOWLY: [&str; 4] = ["handovers", "helpers", "leaks", "starts"]; // what is slow to be found

/// All that come with the station.
pub(super) fn shipped() -> Vec<Campaign> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/campaigns");
    let files = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    files.map(|file| read(&file).unwrap_or_else(|e| panic!("{}", e.message))).collect()
}

#[test]
fn the_campaigns_that_come_with_the_station_can_be() {
    let campaigns = shipped();
    for campaign in &campaigns {
        assert_eq!(campaign.cannot_show(), Vec::<String>::new(), "{}", campaign.name);
    }
    let of = |names: &[&str]| -> Vec<&Campaign> { campaigns.iter().filter(|it| names.contains(&&*it.name)).collect() };
    let set = of(&[&OF_EVERY_KIND[..], &FOUND_SLOWLY].concat());
    assert!(set.iter().flat_map(|it| &it.pools).all(|pool| pool.limit_upper95 == 0.05));
    assert!(set.iter().flat_map(|it| &it.cells).all(|cell| cell.pool.is_some()));
    let faults = |names: &[&str]| -> BTreeSet<usize> { of(names).iter().map(|it| it.faults()).collect() };
    assert_eq!(faults(&OF_EVERY_KIND), [544, 1_176, 1_714, 2_413].into(), "as their heads say");
    assert_eq!(faults(&FOUND_SLOWLY), [168, 264, 312, 528].into(), "as their heads say");
    assert_eq!(faults(&["full", "cutting", "states"]), [204, 480, 1_272].into(), "as their heads say");
    let names = [&OF_EVERY_KIND[..], &FOUND_SLOWLY, &["full"]].concat();
    let together: Vec<&Cell> = of(&names).into_iter().flat_map(|it| &it.cells).collect();
    let count = |whom: &str, what: &Injection| -> usize {
        let is_meant = |cell: &&&Cell| cell.role() == whom && variant(&cell.injection) == variant(what);
        together.iter().filter(is_meant).map(|cell| cell.count).sum()
    };
    for whom in ROLES.map(Role::name).into_iter().chain(["supervisor", "guardian", "supervisor+guardian"]) {
        for what in FaultKind::ALL.into_iter().flat_map(|(kind, _, _)| variants(kind, whom)) {
            let (count, can) = (count(whom, &what), what.check().is_ok() && !is_left_out(&what));
            assert_eq!(count >= LEAST_OF_AN_OPTION, can, "{} {whom} of {:?}: {count}", variant(&what), what);
        }
    }
}

/// What a fault is called whose options make another fault of it.
fn variant(injection: &Injection) -> String {
    let option = match injection {
        Injection { factor: Some(_), .. } => "by a factor",
        Injection { jitter: Some(_), .. } => "by a time that varies",
        Injection { extra_s: Some(_), .. } => "by a fixed time",
        Injection { kind: FaultKind::Stop, for_s: Some(_), .. } => "and continue",
        Injection { place: Some(place), .. } => place.name(),
        _ => "",
    };
    format!("{} {option}", injection.kind.name())
}

/// A fault of a kind by each of its options that makes another fault of it.
fn variants(kind: FaultKind, whom: &str) -> Vec<Injection> {
    let lasting = Injection { for_s: Some(0.5).filter(|_| kind.takes_duration()), ..Injection::now(kind, whom) };
    let fixed = Injection { extra_s: Some(0.1), ..lasting.clone() };
    match kind {
        FaultKind::Slow => {
            vec![Injection { factor: Some(5.0), ..lasting.clone() }, fixed.clone(), Injection { jitter: Some(1.0), ..fixed }]
        }
        FaultKind::Stop => vec![Injection::now(kind, whom), lasting],
        FaultKind::Corrupt => Place::ALL.map(|(place, _)| Injection { place: Some(place), ..lasting.clone() }).into(),
        _ => vec![lasting],
    }
}

/// What no campaign has, although it can be: what ends other faults; what is one and the same whoever is named, and is there under one name; a device that is
/// stopped is ended before it could be continued; a checkpoint that nobody reads, since that is damaged beside a kill of both who hold the state; pictures, of
/// which nobody can know; and what docs/faults.md says of the keepers' memory and files.
fn is_left_out(what: &Injection) -> bool {
    let whom = what.target.as_str();
    match what {
        Injection { kind: FaultKind::Cont | FaultKind::Undo, .. } => true,
        Injection { kind: FaultKind::ShmFull, .. } => whom != "recorder",
        Injection { kind: FaultKind::Stop, for_s: Some(_), .. } => whom == "device",
        Injection { place: Some(Place::Station | Place::Roster), .. } => whom != "tissue",
        Injection { place: Some(Place::Stream), .. } => whom == "rendering",
        Injection { place: Some(Place::Checkpoint), .. } => true,
        Injection { kind: FaultKind::Oom, .. } => whom.contains("supervisor") || whom == "guardian",
        Injection { kind: FaultKind::NoFiles, .. } => whom.contains("guardian"),
        _ => false,
    }
}

#[test]
fn a_limit_that_so_few_faults_cannot_show_is_named() {
    let said = |text: &str| parse("t", text).unwrap().cannot_show();
    let few = "[[cell]]\nkinds = [\"kill\"]\ntargets = [\"fluid\"]\ncount = 58\n";
    assert!(said(few)[0].contains("58 faults cannot show a limit of 0.05, 59 can"), "{:?}", said(few));
    assert_eq!(
        said(&few.replace("58", "59")).len() + said(&few.replace("58", "1\nlimit_upper95 = 0.0")).len(),
        0,
        "0 is meant to fail"
    );
    let pooled = format!("[[pool]]\nname = \"a\"\nlimit_upper95 = 0.02\n{few}pool = \"a\"\n");
    assert!(said(&pooled)[0].contains("pool a: 58 faults"), "{:?}", said(&pooled));
    // What a pool asks of more faults than it has, or of none, nobody can hold; and what nobody judges holds nothing.
    let wide = pooled.replace("0.02", "0.5");
    assert_eq!(said(&wide), Vec::<String>::new());
    let asks = said(&wide.replace("0.5\n", "0.5\nleast = 59\n"));
    assert!(asks.len() == 1 && asks[0].contains("pool a: 58 faults, and at least 59"), "{asks:?}");
    let empty = said(&format!("[[pool]]\nname = \"b\"\nlimit_upper95 = 0.5\n{wide}"));
    assert!(empty.len() == 1 && empty[0].contains("pool b: no cell is in it"), "{empty:?}");
    let silent = said(&format!("[[arm]]\nname = \"x\"\njudged = false\n{few}"));
    assert!(silent.len() == 1 && silent[0].contains("no arm is judged"), "{silent:?}");
    let idle = said("[[cell]]\nkinds = [\"nan\", \"block\"]\ntargets = [\"fluid:spare\", \"haptic:spare\"]\ncount = 59\n");
    assert!(idle.len() == 1 && idle[0].contains("cell nan fluid:spare: a spare makes only"), "{idle:?}");
}

#[test]
fn what_a_cell_may_bring_about_is_one_of_three() {
    let cell =
        |may: &str| parse("t", &format!("[[cell]]\nkinds = [\"kill\"]\ntargets = [\"fluid\"]\ncount = 1\nmay = [{may}]\n"));
    let all = cell("\"begin-anew\", \"others-die\", \"station-ends\"").unwrap();
    assert_eq!(all.cells[0].may, [May::BeginAnew, May::OthersDie, May::StationEnds]);
    assert!(cell("\"explode\"").unwrap_err().contains("others-die"));
}

#[test]
fn a_file_that_is_missing_no_text_or_no_file_is_refused() {
    assert_eq!(read(Path::new("/nowhere/x.toml")).unwrap_err().code, 2);
    assert_eq!(read(Path::new("/proc/self/exe")).unwrap_err().code, 2);
    let device = read(Path::new("/dev/null")).unwrap_err();
    assert!(device.code == 2 && device.message.contains("it is a pipe or a device, not a file"), "{}", device.message);
}

#[test]
fn a_fault_may_fall_into_a_swap_of_any_engine() {
    let text = |more: &str| format!("[[cell]]\nkinds = [\"kill\"]\ntargets = [\"tissue:active\"]\ncount = 2\n{more}\n");
    let cell = |more: &str| parse("t", &text(more)).map(|campaign| campaign.cells[0].clone());
    let swapped = cell("states = [\"swap\"]").unwrap();
    assert_eq!(
        (swapped.swap, swapped.name.as_str()),
        (Some(hyst_messages::Role::Fluid), "kill tissue:active in a swap of fluid")
    );
    assert_eq!(cell("states = [\"swap\"]\nswap = \"haptic\"").unwrap().swap, Some(hyst_messages::Role::Haptic));
    assert!(cell("swap = \"haptic\"").unwrap_err().contains("only a cell with state"));
    let newcomer = |keys: &str| {
        parse("t", &format!("[[cell]]\nkinds = [\"nan\"]\ntargets = [\"fluid:newcomer\"]\ncount = 1\n{keys}\n"))
            .map(|campaign| campaign.cells)
    };
    assert!(newcomer("states = [\"swap\"]\nswap = \"fluid\"").unwrap()[0].is_of_newcomer() && !swapped.is_of_newcomer());
    for without in ["", "states = [\"swap\"]\nswap = \"tissue\"", "states = [\"recovery\"]"] {
        assert!(newcomer(without).unwrap_err().contains("only a swap of its role brings one"), "{without}");
    }
    assert!(cell("states = [\"swap\"]\nswap = \"hardware\"").unwrap_err().contains("no engine"));
    // The old device ends for its swap, and another one for its fault.
    let misses = |swap: &str| cell(&format!("states = [\"swap\"]\nswap = \"{swap}\"")).unwrap().allowed_misses;
    assert_eq!((misses("console"), misses("device")), (0, 20));
    let both = newcomer("states = [\"swap\"]\nswap = \"device\"").unwrap_err(); // of the fluid
    assert!(both.contains("only a swap of its role"), "{both}");
}

/// What docs/faults.md and the heads of the files say of them: twenty of each kind and role are to show, of which a few may not.
#[test]
fn the_campaigns_of_every_kind_draw_enough_of_each_and_can_show_their_limits() {
    let campaigns: Vec<Campaign> = shipped().into_iter().filter(|it| OF_EVERY_KIND.contains(&&*it.name)).collect();
    let mut pairs = BTreeMap::<(&str, &str), usize>::new();
    for cell in campaigns.iter().flat_map(|campaign| &campaign.cells) {
        for what in std::iter::once(&cell.injection).chain(&cell.with) {
            *pairs.entry((what.kind.name(), Role::name_in(&what.target))).or_default() += cell.count;
        }
    }
    let few: Vec<_> = pairs.iter().filter(|(_, count)| **count < 24).collect();
    assert!(few.is_empty(), "{few:?}");
    // What is said by one output alone is counted apart.
    let alone = campaigns.iter().flat_map(|campaign| &campaign.cells).filter(|cell| cell.injection.output.is_some());
    let few: Vec<_> = alone.filter(|cell| cell.count < 24).map(|cell| &cell.name).collect();
    assert!(few.is_empty(), "{few:?}");
    for campaign in &campaigns {
        assert_eq!(campaign.cannot_show(), Vec::<String>::new(), "{}", campaign.name);
        let most = campaign.cells.iter().map(|cell| cell.allowed_misses).max().unwrap();
        assert!(most < 2_000, "{}: a limit that can fail: {most}", campaign.name);
    }
    for name in ["no files", "corrupt"] {
        let pool = campaigns.iter().flat_map(|campaign| &campaign.pools).find(|pool| pool.name == name).unwrap();
        assert!(pool.least >= 60 && least_faults(pool.limit_upper95).unwrap() <= pool.least, "{name}");
    }
}

/// The file of what fills allowed 0.2 and that of the cuts 0.1, and of just 20 of a kind or 60 of a pool one without a verdict was one too few. What the device may
/// cost, which it alone may, hid in the pool of the cuts what the others did.
#[test]
fn the_other_campaigns_are_as_strict_and_bear_some_faults_without_a_verdict() {
    let others = [&FOUND_SLOWLY[..], &["full", "cutting", "states"]].concat();
    for campaign in shipped().into_iter().filter(|it| others.contains(&&*it.name)) {
        let mut pairs = BTreeMap::<(&str, &str), usize>::new();
        for cell in &campaign.cells {
            *pairs.entry((cell.injection.kind.name(), cell.role())).or_default() += cell.count;
        }
        assert!(pairs.values().all(|count| *count >= 24), "{}: {pairs:?}", campaign.name);
        // In a full /dev/shm nobody wants room by himself.
        let in_full = |cell: &&Cell| cell.with.as_ref().is_some_and(|with| with.kind == FaultKind::ShmFull);
        let wanting: usize = campaign.cells.iter().filter(in_full).map(|cell| cell.count).sum();
        assert!(campaign.name != "full" || wanting >= 66, "{wanting}");
        for pool in &campaign.pools {
            let own = campaign.cells.iter().filter(|cell| cell.pool.as_deref() == Some(&pool.name));
            let (count, allowed) = (own.clone().map(|cell| cell.count).sum::<usize>(), own.map(|cell| cell.allowed_misses));
            assert_eq!(allowed.collect::<BTreeSet<u64>>().len(), 1, "{}, {}", campaign.name, pool.name);
            assert!(pool.limit_upper95 <= 0.05 && count >= 66, "{}, {}: {count}", campaign.name, pool.name);
        }
    }
}

/// Of 16 bytes that flip in a page or in a segment of megabytes nobody reads one.
#[test]
fn what_is_corrupted_in_a_campaign_is_enough_to_be_read() {
    let all = shipped();
    let flips = all.iter().find(|it| it.name == "corrupt").unwrap();
    let bytes = |cell: &Cell| (cell.injection.place.map(Place::name), cell.injection.bytes.unwrap_or(0));
    let corrupt: Vec<_> = flips.cells.iter().filter(|cell| cell.injection.kind == FaultKind::Corrupt).map(bytes).collect();
    let least = |place: &str| corrupt.iter().filter(|(at, _)| *at == Some(place)).map(|(_, bytes)| *bytes).min();
    assert_eq!(["page", "stream", "link", "roster"].map(least), [4_096, 4_096, 64, 2_048].map(Some));
    assert!(flips.cells.iter().all(|cell| cell.injection.check().is_ok()));
    // Whichever file it stands in: the device's stood in another one.
    let both = |cell: &Cell| [Some(cell.injection.clone()), cell.with.clone()];
    let injections = all.iter().flat_map(|it| &it.cells).flat_map(both).flatten();
    let pages: Vec<(String, u32)> = injections
        .filter(|injection| injection.place == Some(Place::Page))
        .map(|injection| (injection.target, injection.bytes.unwrap_or(0)))
        .collect();
    assert!(pages.iter().all(|(_, bytes)| *bytes >= 4_096), "{pages:?}");
    let hit: BTreeSet<&str> = pages.iter().map(|(target, _)| target.split(':').next().unwrap()).collect();
    assert_eq!(hit, ROLES.map(Role::name).into(), "each role's page");
}
