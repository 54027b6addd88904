//! Tidiness as a test: the layout, the directions of the dependencies, and the house rules that a machine can check. It builds nothing of
//! ours and takes a second, so `./station test` begins with it. Every failure names the file and says what to do.

mod documents;
mod source;
mod tree;

use std::collections::BTreeMap;
use tree::{Package, entries, packages, reach, root, sources, text_of};

const PURE: [&str; 5] = ["hyst-mesh", "hyst-tissue", "hyst-contact", "hyst-flow", "hyst-coupling"];
const LINK: [&str; 2] = ["hyst-messages", "hyst-exchange"];
const OTHER_SHARED: [&str; 4] = ["hyst-scene", "hyst-engine", "hyst-recording", "hyst-assessment"];
const PROCESSES: [&str; 8] = ["device", "haptic", "tissue", "collision-worker", "fluid", "rendering", "recorder", "console"];
const SIMULATION: [&str; 4] = ["hyst-tissue", "hyst-contact", "hyst-flow", "hyst-coupling"];
const GRAPHICS: [&str; 2] = ["wgpu", "winit"];
/// What the tests may name of the supervisor: how a campaign judges.
const JUDGES: [&str; 2] = ["campaign::bounds::", "campaign::judge::"];
/// What the top of the repository may hold, beside what git ignores.
const TOP: [&str; 18] = [
    "Cargo.toml",
    "Cargo.lock",
    "processes",
    "shared",
    "assets",
    "supervisor",
    "tests",
    "README.md",
    "ARCHITECTURE.md",
    "CONTRIBUTING.md",
    "LICENSE",
    "station",
    "rustfmt.toml",
    "docs",
    ".cargo",
    ".ci",
    ".git",
    ".gitignore",
];
/// The only sources of the station itself that may be unsafe, each block with its proof.
const UNSAFE: [&str; 5] = [
    "shared/exchange/src/page.rs",
    "shared/exchange/src/system.rs",
    "shared/exchange/src/allocation.rs",
    "shared/exchange/src/latch.rs",
    "shared/exchange/src/loan.rs",
];
const MOST_LINES: usize = 400;
const MOST_LINES_OF_MAIN: usize = 60;
const MOST_LINES_OF_A_FUNCTION: usize = 70;
const MOST_LINES_OF_ARCHITECTURE: usize = 200;

/// Fails with all that was found, and what to do about it.
fn none(found: Vec<String>, cure: &str) {
    assert!(found.is_empty(), "\n  {}\n{cure}", found.join("\n  "));
}

/// The edges from packages chosen by `from` to names chosen by `to`, of any kind.
fn edges(from: impl Fn(&str, &Package) -> bool, to: impl Fn(&str) -> bool) -> Vec<String> {
    let packages = packages();
    let chosen = packages.iter().filter(|(name, package)| from(name, package));
    chosen
        .flat_map(|(_, package)| {
            package.named.iter().filter(|named| to(named)).map(|named| format!("{}/Cargo.toml names {named}", package.folder))
        })
        .collect()
}

fn is_ours(packages: &BTreeMap<String, Package>, name: &str) -> bool {
    packages.contains_key(name)
}

#[test]
fn every_package_has_its_place() {
    let wrong = packages().into_iter().filter_map(|(name, package)| {
        let is_known = match package.folder.split_once('/') {
            Some(("shared", folder)) => {
                name == format!("hyst-{folder}")
                    && [&PURE[..], &LINK, &OTHER_SHARED].iter().any(|list| list.contains(&name.as_str()))
            }
            Some(("processes", folder)) => name == folder && PROCESSES.contains(&folder),
            _ => ["hystation", "station-tests"].contains(&name.as_str()),
        };
        (!is_known).then(|| format!("{} holds the package {name}", package.folder))
    });
    none(
        wrong.collect(),
        "A crate is named hyst-FOLDER, a process as its folder. If a new one earns its place, add it to the lists at the head of this test \
         and to ARCHITECTURE.md; there is no utils, common or core.",
    );
}

#[test]
fn pure_crates_name_nothing_of_ours_but_the_mesh() {
    let packages = packages();
    none(
        edges(|name, _| PURE.contains(&name), |to| is_ours(&packages, to) && to != "hyst-mesh"),
        "A pure crate computes from its arguments. Pass what it needs as plain slices and numbers, and let the process translate.",
    );
    none(
        edges(|name, _| name == "hyst-mesh", |to| is_ours(&packages, to)),
        "The mesh crate is the bottom: it names nothing of ours.",
    );
}

#[test]
fn link_crates_name_no_pure_crate() {
    none(
        edges(|name, _| LINK.contains(&name), |to| PURE.contains(&to)),
        "What crosses a process border is plain numbers. Translate in the process that owns the meaning.",
    );
}

#[test]
fn no_process_depends_on_a_process() {
    // The one exception: the program that runs the engines as threads of one process, to show what the border between them costs.
    none(
        edges(|name, _| name != "station-tests", |to| PROCESSES.contains(&to) || to == "hystation" || to == "station-tests"),
        "Processes meet through messages alone. Move what both need into a crate under shared/.",
    );
    none(
        edges(|name, _| name == "station-tests", |to| ["rendering", "recorder", "console"].contains(&to)),
        "The tests see these as a user does: start their programs.",
    );
}

#[test]
fn the_tests_name_of_the_supervisor_how_a_campaign_judges_and_nothing_else() {
    let is_other = |rest: &str| !JUDGES.iter().any(|path| rest.starts_with(path));
    let wrong = sources().into_iter().filter(|path| path.starts_with("tests/")).filter(|path| {
        let code = source::code_of(&text_of(path));
        code.split("hystation::").skip(1).any(is_other)
    });
    none(wrong.collect(), "The tests see the supervisor as a user does: start its program.");
}

#[test]
fn the_supervisor_links_no_simulation_and_no_graphics() {
    let reached = reach(&packages(), "hystation");
    let wrong = reached.iter().filter(|name| SIMULATION.contains(&name.as_str()) || GRAPHICS.contains(&name.as_str()));
    none(
        wrong.map(|name| format!("supervisor reaches {name}")).collect(),
        "What can crash lives in an engine. Start a process for it, or ask an engine through its page.",
    );
}

#[test]
fn only_exchange_names_iceoryx2_and_only_rendering_names_graphics() {
    none(
        edges(|name, _| name != "hyst-exchange", |to| to.starts_with("iceoryx2")),
        "Use hyst-exchange's streams and rendezvous; what is missing there is added there.",
    );
    none(
        edges(|name, _| name != "rendering", |to| GRAPHICS.contains(&to)),
        "Graphics is heavy to build and may crash in a driver: it stays in processes/rendering.",
    );
}

#[test]
fn the_top_level_is_what_was_given() {
    let ignored = ["target", "out"];
    let names = entries(&root()).into_iter().map(|path| path.file_name().unwrap_or_default().to_string_lossy().into_owned());
    none(
        names
            .filter(|name| !TOP.contains(&name.as_str()) && !ignored.contains(&name.as_str()) && !name.ends_with(".profraw"))
            .collect(),
        "The top level is fixed. Put code under shared/, processes/, supervisor/ or tests/, and what a run writes under out/, which git ignores.",
    );
}

#[test]
fn unsafe_stays_where_its_proofs_are() {
    let wrong = sources().into_iter().filter(|path| {
        let text = text_of(path);
        let may = UNSAFE.contains(&path.as_str()) || (is_test(path) && has_reasoned_allowance(&text));
        !may && source::has_word(&source::code_of(&text), "unsafe")
    });
    none(
        wrong.collect(),
        "Use a safe, well-kept crate. A test that must (a counting allocator) opens with `#![allow(unsafe_code)] // and the reason`.",
    );
}

fn is_test(path: &str) -> bool {
    path.starts_with("tests/") || path.contains("/tests/")
}

/// `#![allow(unsafe_code)]` with a comment on the line or the one above it.
fn has_reasoned_allowance(text: &str) -> bool {
    let lines: Vec<&str> = text.lines().collect();
    let at = lines.iter().position(|line| line.starts_with("#![allow(unsafe_code)]"));
    at.is_some_and(|at| lines[at].contains("//") || (at > 0 && lines[at - 1].trim_start().starts_with("//")))
}

#[test]
fn files_and_functions_are_small() {
    let mut wrong = Vec::new();
    for path in sources() {
        let text = text_of(&path);
        let (lines, most) = (text.lines().count(), if path.ends_with("src/main.rs") { MOST_LINES_OF_MAIN } else { MOST_LINES });
        if lines > most {
            wrong.push(format!("{path}: {lines} lines, at most {most}"));
        }
        for function in source::functions(&source::code_of(&text)) {
            if function.lines > MOST_LINES_OF_A_FUNCTION {
                let (line, name, lines) = (function.line, function.name, function.lines);
                wrong.push(format!("{path}:{line}: fn {name} has {lines} lines, at most {MOST_LINES_OF_A_FUNCTION}"));
            }
        }
    }
    none(wrong, "Find the part that has a name of its own, and give it its own function or file.");
}

#[test]
fn every_source_says_what_it_is() {
    let wrong = sources().into_iter().filter(|path| !text_of(path).starts_with("//! "));
    none(wrong.collect(), "Open the file with `//!`: what it is, what it promises, which paper it follows.");
}

#[test]
fn nothing_is_left_for_later() {
    let marks = [
        concat!("TO", "DO"),
        concat!("FIX", "ME"),
        concat!("unimple", "mented!"),
        concat!("to", "do!("),
        concat!("#[", "ignore"),
    ];
    let wrong = sources().into_iter().flat_map(|path| {
        let text = text_of(&path);
        let marked = |line: &str| marks.iter().any(|mark| line.contains(mark));
        let lines: Vec<String> = text
            .lines()
            .enumerate()
            .filter(|(_, line)| marked(line))
            .map(|(at, line)| format!("{path}:{}: {}", at + 1, line.trim()))
            .collect();
        lines
    });
    none(wrong.collect(), "Do it, or take it out and open an issue. A test that cannot pass is not a test.");
}

#[test]
fn no_test_sleeps_to_synchronize() {
    let sleep = concat!("thread::", "sleep");
    let wrong = sources().into_iter().filter(|path| is_test(path)).flat_map(|path| {
        let text = text_of(&path);
        let lines: Vec<String> = text
            .lines()
            .enumerate()
            .filter(|(_, line)| line.contains(sleep) && !line.contains("not a synchronization"))
            .map(|(at, line)| format!("{path}:{}: {}", at + 1, line.trim()))
            .collect();
        lines
    });
    none(
        wrong.collect(),
        "Wait for what the test needs (a word, a child's end, a line of output) with a deadline. A pause between two looks bears the comment \
         `// not a synchronization: …` with its reason.",
    );
}

#[test]
fn the_map_is_whole_and_short() {
    let map = text_of("ARCHITECTURE.md");
    let lines = map.lines().count();
    assert!(
        lines <= MOST_LINES_OF_ARCHITECTURE,
        "ARCHITECTURE.md has {lines} lines, at most {MOST_LINES_OF_ARCHITECTURE}: say less"
    );
    let missing = packages().into_values().map(|package| package.folder).filter(|folder| !map.contains(&format!("`{folder}`")));
    none(missing.collect(), "Give each package its line in ARCHITECTURE.md's code map, with its folder in backquotes.");
}

#[test]
fn the_handbook_has_each_case() {
    let handbook = text_of("docs/handbook.md");
    let cases = entries(&root().join("assets/cases")).into_iter();
    let names: Vec<String> = cases.filter_map(|path| Some(path.file_stem()?.to_str()?.to_string())).collect();
    assert!(names.len() > 5, "{names:?}");
    none(
        names.into_iter().filter(|name| !handbook.contains(&format!("`{name}`"))).collect(),
        "Give each case its line in the handbook.",
    );
}

#[test]
fn the_way_from_hand_to_force_links_no_iceoryx2() {
    let test = std::env::current_exe().unwrap_or_default();
    let Some(device) = test.parent().and_then(|deps| deps.parent()).map(|folder| folder.join("device")) else { return };
    let Ok(program) = std::fs::read(&device) else { return }; // not built yet: the whole-station tests come here again
    let symbols =
        symbol_names(&program).unwrap_or_else(|| panic!("{}: no symbol table; build it with --release", device.display()));
    let mut found: Vec<String> = symbols.into_iter().filter(|name| name.contains("iceoryx2")).collect();
    found.truncate(10);
    none(found, "`device` reads and writes station pages alone: use exchange::usher::page_usher, and no stream or rendezvous.");
}

/// The names of the functions and data in the symbol table of a 64-bit little-endian ELF file (System V ABI, chapter 4); `None` if it is
/// none or has no such table.
fn symbol_names(program: &[u8]) -> Option<Vec<String>> {
    let number = |at: usize, bytes: usize| {
        let mut word = [0u8; 8];
        word[..bytes].copy_from_slice(program.get(at..at + bytes)?);
        usize::try_from(u64::from_le_bytes(word)).ok()
    };
    let (table, length, count) = (number(0x28, 8)?, number(0x3a, 2)?, number(0x3c, 2)?);
    let section = |index: usize| table + index * length;
    let symbols = (0..count).map(section).find(|at| number(at + 4, 4) == Some(2))?; // SHT_SYMTAB
    let strings = section(number(symbols + 40, 4)?); // sh_link
    let (begin, size) = (number(symbols + 24, 8)?, number(symbols + 32, 8)?);
    let text = program.get(number(strings + 24, 8)?..)?;
    let mut names = Vec::new();
    for at in (begin..begin + size).step_by(24) {
        let is_defined = number(at + 6, 2)? != 0; // SHN_UNDEF
        if is_defined && number(at + 4, 1)? & 0xf != 4 {
            // Not STT_FILE, which names every object that the linker looked into.
            let name = text.get(number(at, 4)?..)?.split(|byte| *byte == 0).next()?;
            names.push(String::from_utf8_lossy(name).into_owned());
        }
    }
    Some(names)
}

#[test]
fn the_symbol_table_is_read() {
    let test = std::fs::read(std::env::current_exe().unwrap_or_default()).unwrap_or_default();
    let names = symbol_names(&test).unwrap_or_default();
    assert!(names.iter().any(|name| name.contains("symbol_names")), "{} names", names.len());
    assert_eq!(symbol_names(&test[..100]), None);
}
