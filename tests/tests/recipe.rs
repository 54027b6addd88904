//! The recipe of docs/engine.md for an engine outside of the workspace: its commands and its manifest are taken from the page as they stand there, and what comes
//! of it conforms. And the examples are as short as the documents say.

use station_tests::shown::not_shown;
use station_tests::{binaries, hystation, run};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The top of the repository. Asked at run time: a target folder that two checkouts share keeps the path of the first in the program.
fn root() -> PathBuf {
    let manifest = std::env::var("CARGO_MANIFEST_DIR").unwrap_or_else(|_| env!("CARGO_MANIFEST_DIR").to_string());
    Path::new(&manifest).parent().map(Path::to_path_buf).unwrap_or_default()
}

fn text_of(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// The first block of code of a page that begins so.
fn block<'a>(page: &'a str, begins: &str) -> &'a str {
    let rest = page.split_once(begins).map(|(_, rest)| rest).unwrap_or_else(|| panic!("no {begins:?} in docs/engine.md"));
    rest.split_once("\n```").map_or(rest, |(block, _)| block)
}

/// Names and versions of the packages that a lock file has.
fn locked(path: &Path) -> BTreeSet<String> {
    let lock: toml::Table = text_of(path).parse().expect("a lock file");
    let packages = lock["package"].as_array().expect("packages");
    packages.iter().map(|package| format!("{} {}", package["name"], package["version"])).collect()
}

/// What the packages of others are compiled to is kept beside the station's own, so that only the first time takes long.
#[test]
fn the_recipe_of_an_engine_outside_of_the_workspace_conforms_as_it_stands_in_the_document() {
    let page = text_of(&root().join("docs/engine.md"));
    let folder = binaries().parent().expect("the target folder").join("recipe");
    let (engine, station) = (folder.join("my-fluid"), folder.join("station"));
    let _ = std::fs::remove_dir_all(&engine); // of the time before
    let _ = std::fs::remove_file(&station); // of a time that was cut off
    std::fs::create_dir_all(&folder).expect("a folder");
    std::os::unix::fs::symlink(root(), &station).expect("the station's folder beside it");
    let commands = block(&page, "\n```\n");
    let (code, _, said) = run(Command::new("sh").args(["-e", "-c", commands]).current_dir(&folder));
    std::fs::remove_file(&station).expect("the link is ours"); // who follows links would go round in it
    assert_eq!(code, Some(0), "{commands}\n{said}");
    // By the whole path: cargo tells the packages of two checkouts apart by that.
    let manifest = block(&page, "\n```toml\n").replace("\"../station/", &format!("\"{}/", root().display()));
    std::fs::write(engine.join("Cargo.toml"), manifest).expect("a manifest");
    let mut cargo = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    cargo.args(["build", "--offline", "--release"]).current_dir(&engine).env("CARGO_TARGET_DIR", folder.join("target"));
    let (code, _, said) = run(&mut cargo);
    assert_eq!(code, Some(0), "{said}");
    assert!(!said.contains("warning:"), "{said}");
    // Both sides of a stream are of the same versions.
    let (own, ours) = (locked(&engine.join("Cargo.lock")), locked(&root().join("Cargo.lock")));
    let others: Vec<&String> = own.difference(&ours).collect();
    assert!(own.len() > 20 && others.iter().all(|package| package.starts_with("\"my-fluid\"")), "{others:?}");
    // The page's own words for what comes next.
    std::os::unix::fs::symlink(folder.join("target"), engine.join("target")).expect("what was built, where it is looked for");
    let line =
        page.lines().find_map(|line| line.strip_prefix("hystation ").filter(|words| words.starts_with("conformance fluid")));
    let words = line.and_then(|line| line.split('#').next()).expect("a command").split_whitespace();
    let (code, told, said) = run(hystation().args(words).current_dir(&engine));
    if code == Some(3) {
        not_shown("whether the recipe's engine conforms: the machine was too busy");
        return;
    }
    assert_eq!(code, Some(0), "{told}\n{said}");
}

#[test]
fn the_examples_of_engines_are_as_short_as_the_documents_say() {
    for example in ["example-engine", "example-picture"] {
        let lines = text_of(&root().join(format!("tests/src/bin/{example}.rs"))).lines().count();
        assert!((50..100).contains(&lines), "{example}: {lines} lines");
        assert!(text_of(&root().join("docs/engine.md")).contains(&format!("tests/src/bin/{example}.rs")), "{example}");
    }
    for document in ["README.md", "docs/engine.md"] {
        assert!(text_of(&root().join(document)).contains("under a hundred lines"), "{document}");
    }
}

/// The example without a state needs nothing of the station but what every engine is made of, and its short manifest names that, each where it lies.
#[test]
fn the_example_of_a_rendering_links_no_engine_and_no_solver() {
    let text = text_of(&root().join("tests/src/bin/example-picture.rs"));
    let used = text.lines().filter_map(|line| line.strip_prefix("use ")?.split("::").next()).collect::<BTreeSet<_>>();
    assert_eq!(used, BTreeSet::from(["hyst_engine", "hyst_exchange", "hyst_messages"]));
    let page = text_of(&root().join("docs/engine.md"));
    let manifest: toml::Table = block(&page, "\n```toml\n# my-picture/Cargo.toml\n").parse().expect("a manifest");
    let dependencies = manifest["dependencies"].as_table().expect("dependencies");
    let named: BTreeSet<String> = dependencies.keys().map(|name| name.replace('-', "_")).collect();
    assert!(named.iter().map(String::as_str).eq(used), "{named:?}");
    for (name, place) in dependencies {
        let path = place["path"].as_str().and_then(|path| path.strip_prefix("../station/")).expect("a path beside the station's");
        let crate_of_it: toml::Table = text_of(&root().join(path).join("Cargo.toml")).parse().expect("a manifest");
        assert_eq!(crate_of_it["package"]["name"].as_str(), Some(name.as_str()), "{path}");
    }
}
