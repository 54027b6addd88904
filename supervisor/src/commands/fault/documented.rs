//! What README, handbook and the pages about faults, engines and drivers show of this program is what it takes.

use super::{Drawn, Place, injection};
use crate::campaign;
use crate::cli::{Cli, Command, FaultCommand, InjectArgs};
use crate::doing::Wanted;
use crate::faultfile::Injection;
use clap::Parser;
use std::path::{Path, PathBuf};

/// The documents, from the repository's root.
const DOCUMENTS: [&str; 9] = [
    "README.md",
    "docs/driver.md",
    "docs/engine.md",
    "docs/faults.md",
    "docs/handbook.md",
    "docs/limits.md",
    "docs/scenes.md",
    "docs/sessions.md",
    "docs/speed.md",
];
/// The hands that do nothing to be hurt at.
const NEVER_CUT: [&str; 3] = ["script:press", "script:idle", "idle"];

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// The blocks of a document, each of them the lines in it that call this program, without what is said of them.
fn blocks(text: &str) -> Vec<Vec<String>> {
    let inside = text.split("\n```").skip(1).step_by(2);
    let call = |line: &str| {
        let line = line.split(" #").next().unwrap_or_default();
        line.starts_with("hystation ").then(|| line.trim_end().to_string())
    };
    inside.map(|block| block.lines().filter_map(call).collect()).collect()
}

/// Whether a campaign's file lies in the repository, or is one that the document itself shows: a block that names it in its first line.
fn is_a_campaign(file: &Path, text: &str) -> bool {
    let head = format!("toml\n# {}\n", file.display());
    let shown = text.split("\n```").find_map(|block| block.strip_prefix(&head));
    shown.map_or_else(|| root().join(file).is_file(), |shown| campaign::file::parse("shown", shown).is_ok())
}

fn is_a_fault(args: &InjectArgs) -> bool {
    let is_place = args.place.as_deref().is_none_or(|place| Place::from_name(place).is_some());
    let is_state = args.state.as_deref().is_none_or(|word| Wanted::parse(word).is_ok());
    let is_good = |injection: Injection| injection.check().is_ok() && Drawn::of(args, injection.kind).is_ok();
    is_place && is_state && injection(args).is_ok_and(is_good)
}

/// README's own example of a fault was refused.
#[test]
fn each_command_that_the_documents_show_is_taken() {
    let mut seen = 0;
    for name in DOCUMENTS {
        let text = std::fs::read_to_string(root().join(name)).unwrap_or_else(|error| panic!("{name}: {error}"));
        for block in blocks(&text) {
            let mut hand = None;
            for line in block {
                let cli = Cli::try_parse_from(line.split_whitespace()).unwrap_or_else(|error| panic!("{name}: {line}\n{error}"));
                seen += 1;
                match cli.command {
                    Command::Run(args) => hand = args.hand,
                    Command::Fault { command: FaultCommand::Inject(args) } => {
                        assert!(is_a_fault(&args), "{name}: {line}");
                        let never =
                            args.state.as_deref() == Some("cutting") && hand.as_deref().is_some_and(|it| NEVER_CUT.contains(&it));
                        assert!(!never, "{name}: {line}: the hand of that block cuts nothing");
                    }
                    Command::Fault { command: FaultCommand::Campaign(args) } => {
                        assert!(is_a_campaign(&args.file, &text), "{name}: {line}: there is no such file");
                    }
                    _ => {}
                }
            }
        }
    }
    assert!(seen > 40, "only {seen} commands were found");
}

#[test]
fn a_block_is_what_lies_between_its_fences() {
    let text = "a\n```\nhystation status   # who\nls\n```\nhystation dance\n```toml\nx\n```\n";
    assert_eq!(blocks(text), [vec!["hystation status".to_string()], Vec::new()]);
}

#[test]
fn a_campaign_is_one_of_the_repository_or_one_that_the_document_shows_and_that_is_read() {
    let shown = |count: &str| {
        format!("a\n```toml\n# out/own.toml\n[[cell]]\nkinds = [\"kill\"]\ntargets = [\"fluid\"]\ncount = {count}\n```\nb\n")
    };
    let is = |file: &str, text: &str| is_a_campaign(Path::new(file), text);
    assert_eq!(
        [is("out/own.toml", &shown("3")), is("out/own.toml", &shown("none")), is("out/own.toml", "a\n")],
        [true, false, false]
    );
    assert_eq!([is("assets/campaigns/quick.toml", "a\n"), is("out/other.toml", &shown("3"))], [true, false]);
}
