//! The repository as the layout test sees it: its sources, and the dependencies that its manifests name.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Folders that hold packages of ours, each directly or one below.
pub const CODE: [&str; 4] = ["shared", "processes", "supervisor", "tests"];

/// The top of the repository. Asked at run time: a target folder that two checkouts share keeps the path of the first in the program.
pub fn root() -> PathBuf {
    let manifest = std::env::var("CARGO_MANIFEST_DIR").unwrap_or_else(|_| env!("CARGO_MANIFEST_DIR").to_string());
    Path::new(&manifest).parent().map(Path::to_path_buf).unwrap_or_default()
}

/// Text of a file of the repository.
pub fn text_of(path: &str) -> String {
    let path = root().join(path);
    std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// All Rust sources of ours, relative to the top, sorted.
pub fn sources() -> Vec<String> {
    let mut found = Vec::new();
    for folder in CODE {
        collect(&root().join(folder), &mut found);
    }
    found.sort();
    assert!(found.len() > 50, "only {} sources were found: the test looks in the wrong place", found.len());
    found
}

fn collect(folder: &Path, found: &mut Vec<String>) {
    for path in entries(folder) {
        if path.is_dir() {
            if path.file_name().is_some_and(|name| name != "target") {
                collect(&path, found);
            }
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            let relative = path.strip_prefix(root()).unwrap_or(&path);
            found.push(relative.to_string_lossy().into_owned());
        }
    }
}

/// What lies in a folder.
pub fn entries(folder: &Path) -> Vec<PathBuf> {
    let listed = std::fs::read_dir(folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    listed.flatten().map(|entry| entry.path()).collect()
}

/// One package of ours.
#[derive(Debug)]
pub struct Package {
    /// Folder relative to the top, `shared/mesh`.
    pub folder: String,
    /// What it names, of any kind: normal, build, dev, for any target.
    pub named: BTreeSet<String>,
    /// What its programs link: normal dependencies alone.
    pub linked: BTreeSet<String>,
}

/// All packages of ours by name.
pub fn packages() -> BTreeMap<String, Package> {
    let mut folders = vec!["supervisor".to_string(), "tests".to_string()];
    for parent in ["shared", "processes"] {
        for path in entries(&root().join(parent)) {
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            folders.push(format!("{parent}/{name}"));
        }
    }
    folders.into_iter().map(package).collect()
}

fn package(folder: String) -> (String, Package) {
    let manifest = format!("{folder}/Cargo.toml");
    let table: toml::Table = text_of(&manifest).parse().unwrap_or_else(|error| panic!("{manifest}: {error}"));
    let name = table["package"]["name"].as_str().unwrap_or_default().to_string();
    let mut package = Package { folder, named: BTreeSet::new(), linked: BTreeSet::new() };
    read_dependencies(&table, &mut package);
    for target in table.get("target").and_then(toml::Value::as_table).into_iter().flat_map(toml::Table::values) {
        read_dependencies(target.as_table().unwrap_or(&toml::Table::new()), &mut package);
    }
    (name, package)
}

fn read_dependencies(table: &toml::Table, package: &mut Package) {
    for kind in ["dependencies", "dev-dependencies", "build-dependencies"] {
        let Some(entries) = table.get(kind).and_then(toml::Value::as_table) else { continue };
        for (key, value) in entries {
            // A renamed dependency is what it is renamed from.
            let name = value.get("package").and_then(toml::Value::as_str).unwrap_or(key).to_string();
            if kind == "dependencies" {
                package.linked.insert(name.clone());
            }
            package.named.insert(name);
        }
    }
}

/// Everything that a package links, through packages of ours.
pub fn reach(packages: &BTreeMap<String, Package>, from: &str) -> BTreeSet<String> {
    let mut reached = BTreeSet::new();
    let mut open = vec![from.to_string()];
    while let Some(name) = open.pop() {
        for linked in packages.get(&name).into_iter().flat_map(|package| &package.linked) {
            if reached.insert(linked.clone()) {
                open.push(linked.clone());
            }
        }
    }
    reached
}
