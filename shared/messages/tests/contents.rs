//! docs/messages.md is what `messages::contents` says, and that is what the sources say: no stream, cell or ring is left out, and who reads what is read off the
//! interests that the engines give their ushers, and off the cells that they name.
#![allow(missing_docs)]

use hyst_messages::contents::{CONTENTS, Section, TOLD};
use hyst_messages::{Kind, Role, kinds_of};
use std::collections::BTreeSet;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Set to write the document anew instead of comparing it, as for the schemas.
const UPDATE: &str = "HYST_UPDATE_SCHEMA";
/// The line after which all of the document is written from here.
const MARK: &str =
    "<!-- What follows is written by shared/messages/tests/contents.rs from shared/messages/src/contents.rs. -->\n";
/// Those whose sources are looked through for what they read.
const ENGINES: [Role; 8] = [
    Role::Device,
    Role::Haptic,
    Role::Tissue,
    Role::Fluid,
    Role::Rendering,
    Role::Recorder,
    Role::Console,
    Role::CollisionWorker,
];

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn text_of(path: &str) -> String {
    std::fs::read_to_string(root().join(path)).unwrap_or_else(|error| panic!("{path}: {error}"))
}

fn names(roles: &[Role]) -> String {
    roles.iter().map(|role| role.name()).collect::<Vec<_>>().join(", ")
}

/// A cell or ring of a page, as the source has it: page, name, record, entries.
fn cells() -> Vec<[String; 4]> {
    let text = text_of("shared/messages/src/page.rs");
    let (mut page, mut found) = ("", Vec::new());
    for line in text.lines() {
        if let Some(name) = line.strip_prefix("pub mod ").and_then(|rest| rest.strip_suffix(" {")) {
            page = name;
        }
        let Some((name, rest)) = line.trim().strip_prefix("pub const ").and_then(|rest| rest.split_once(": ")) else { continue };
        let Some((kind, rest)) = rest.split_once('<') else { continue };
        let Some((record, value)) = rest.split_once('>') else { continue };
        let entries = match kind {
            "CellAt" => "1".to_string(),
            "RingAt" => value.rsplit(", ").next().unwrap_or("").trim_end_matches(");").replace('_', ""),
            _ => continue,
        };
        found.push([page.to_string(), name.to_string(), record.to_string(), entries]);
    }
    found
}

fn row(index: usize, section: &Section) -> String {
    let Section { record, source, bytes, count, what } = section;
    let record = if source.is_empty() { format!("`{record}`") } else { format!("[`{record}`](../{source})") };
    format!("| {index} | {record} | {bytes} | {count} | {what} |\n")
}

/// The part of the document that is written from here.
fn generated() -> String {
    let mut text = String::new();
    for content in &CONTENTS {
        let publisher = ENGINES.into_iter().find(|role| kinds_of(*role).contains(&content.kind)).expect("somebody offers it");
        let (kind, stream, readers) = (content.kind, content.kind.name(), names(content.readers));
        let (when, header, refused) = (content.when, content.header, content.refused);
        write!(
            text,
            "\n### {}: {stream}\n`Kind::{kind:?}`. Sent: {when}. Words of the header: {header}. Read by {readers}. Not taken: {refused}.\n\n\
             | section | record | bytes | how many | what |\n|---|---|---|---|---|\n",
            publisher.name()
        )
        .unwrap();
        content.sections.iter().enumerate().for_each(|(index, section)| text.push_str(&row(index, section)));
    }
    text.push_str("\n## Cells and rings\n| page | name | record | entries | written | read by | not taken |\n|---|---|---|---|---|---|---|\n");
    for (told, [_, _, record, entries]) in TOLD.iter().zip(cells()) {
        let (page, name, when, readers, refused) = (told.role.name(), told.name, told.when, names(told.readers), told.refused);
        writeln!(text, "| {page} | `{name}` | `{record}` | {entries} | {when} | {readers} | {refused} |").unwrap();
    }
    text
}

#[test]
fn the_document_of_the_messages_is_up_to_date() {
    let path = root().join("docs/messages.md");
    let document = text_of("docs/messages.md");
    let (head, _) = document.split_once(MARK).expect("the line after which it is written from here");
    let expected = format!("{head}{MARK}{}", generated());
    if std::env::var_os(UPDATE).is_some() {
        std::fs::write(&path, &expected).unwrap();
    }
    let committed = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(committed == expected, "{} is out of date: run the test with {UPDATE}=1 and commit it", path.display());
}

#[test]
fn no_stream_and_no_cell_is_left_out() {
    let offered: BTreeSet<u32> = ENGINES.iter().flat_map(|role| kinds_of(*role)).map(|kind| *kind as u32).collect();
    let said: BTreeSet<u32> = CONTENTS.iter().map(|content| content.kind as u32).collect();
    assert_eq!(said, offered);
    let told: Vec<[String; 2]> = TOLD.iter().map(|told| [told.role.name().to_string(), told.name.to_string()]).collect();
    let known: Vec<[String; 2]> = cells().into_iter().map(|[page, name, ..]| [page, name]).collect();
    assert_eq!(told, known);
}

#[test]
fn each_record_is_in_the_file_that_is_named() {
    for section in CONTENTS.iter().flat_map(|content| content.sections).filter(|section| !section.source.is_empty()) {
        let (record, source) = (section.record, section.source);
        assert!(text_of(source).contains(&format!("pub struct {record} {{")), "{record} in {source}");
    }
}

fn folder(role: Role) -> String {
    match role {
        Role::Hardware => "processes/device/src".into(),
        Role::Supervisor => "supervisor/src".into(),
        role => format!("processes/{}/src", role.name()),
    }
}

/// The sources of a folder without their tests.
fn code_of(folder: &Path) -> String {
    let mut code = String::new();
    for entry in std::fs::read_dir(folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display())).flatten() {
        let path = entry.path();
        if path.is_dir() && !path.ends_with("tests") {
            code += &code_of(&path);
        } else if path.extension().is_some_and(|ending| ending == "rs") && !path.ends_with("tests.rs") {
            let text = std::fs::read_to_string(&path).unwrap();
            code += text.split("\n#[cfg(test)]\nmod tests {").next().unwrap_or("");
        }
    }
    code
}

/// Whether a text names something by this path, and not one whose name only begins so.
fn has(code: &str, path: &str) -> bool {
    let goes_on = |rest: &str| rest.starts_with(|next: char| next.is_alphanumeric() || next == '_');
    code.match_indices(path).any(|(at, _)| !goes_on(&code[at + path.len()..]))
}

#[test]
fn who_reads_a_stream_asks_his_usher_for_it() {
    for role in ENGINES {
        let code = code_of(&root().join(folder(role)));
        let asks = |kind: Kind| {
            [format!("Wanted::Stream(Kind::{kind:?})"), format!("Wanted::Client(Kind::{kind:?})")]
                .iter()
                .any(|words| code.contains(words))
        };
        for content in &CONTENTS {
            assert_eq!(asks(content.kind), content.readers.contains(&role), "{:?} by {}", content.kind, role.name());
        }
    }
}

/// The functions of `hyst_engine` by which several engines read one cell, with the cell: who calls one of these reads that.
const SHARED_READS: [(&str, &str); 1] = [("said_of_pump", "fluid::STATUS")];

/// Whether an engine's sources read the cell of this path: they name it, or call what reads it for them.
fn reads(code: &str, path: &str) -> bool {
    has(code, path) || SHARED_READS.iter().any(|(function, read)| *read == path && has(code, function))
}

#[test]
fn a_shared_function_reads_the_cell_it_stands_for() {
    let code = code_of(&root().join("shared/engine/src"));
    for (function, path) in SHARED_READS {
        assert!(code.contains(&format!("pub fn {function}(")) && has(&code, path), "{function} and {path}");
    }
}

#[test]
fn who_reads_a_cell_names_it_and_nobody_else_does() {
    for told in &TOLD {
        let (page, name) = (told.role.name(), told.name);
        for reader in told.readers {
            let code = code_of(&root().join(folder(*reader)));
            let is_named = [page, "layout"].iter().any(|module| reads(&code, &format!("{module}::{name}")));
            assert!(is_named, "{} does not read {page}::{name}", reader.name());
        }
        let known: BTreeSet<String> = told.readers.iter().chain([&told.role]).map(|role| folder(*role)).collect();
        for role in ENGINES.into_iter().filter(|role| !known.contains(&folder(*role))) {
            let code = code_of(&root().join(folder(role)));
            assert!(!reads(&code, &format!("{page}::{name}")), "{} reads {page}::{name}", role.name());
        }
    }
}
