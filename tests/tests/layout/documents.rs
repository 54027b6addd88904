//! The documents: each link of theirs to something beside them leads to a file that is there, and to a heading that this file has.

use crate::none;
use crate::tree::{entries, root, text_of};
use std::path::Path;

/// All documents, relative to the top, sorted.
fn documents() -> Vec<String> {
    let top = ["README.md", "ARCHITECTURE.md", "CONTRIBUTING.md"].map(String::from);
    let pages = entries(&root().join("docs")).into_iter().filter(|path| path.extension().is_some_and(|end| end == "md"));
    let pages = pages.filter_map(|path| Some(format!("docs/{}", path.file_name()?.to_str()?)));
    let mut all: Vec<String> = top.into_iter().chain(pages).collect();
    all.sort();
    all
}

/// What becomes of a heading in an address: its letters and digits in small, its hyphens, and a hyphen for each space.
fn anchor(heading: &str) -> String {
    let kept = heading.trim().chars().filter(|letter| letter.is_alphanumeric() || [' ', '-', '_'].contains(letter));
    kept.map(|letter| if letter == ' ' { '-' } else { letter }).flat_map(char::to_lowercase).collect()
}

/// The anchors of a document's headings, of which there are none in a block of code.
fn anchors(text: &str) -> Vec<String> {
    let lines = text.split("\n```").step_by(2).flat_map(str::lines);
    lines.filter(|line| line.starts_with('#')).map(|line| anchor(line.trim_start_matches('#'))).collect()
}

/// The links of a document that lead nowhere.
fn broken(document: &str) -> Vec<String> {
    let text = text_of(document);
    let folder = Path::new(document).parent().unwrap_or(Path::new(""));
    let leads = |link: &str| {
        let (file, heading) = link.split_once('#').map_or((link, None), |(file, heading)| (file, Some(heading)));
        let path = if file.is_empty() { Path::new(document).to_path_buf() } else { folder.join(file) };
        let has = |heading: &str| anchors(&text_of(&path.to_string_lossy())).iter().any(|anchor| anchor == heading);
        root().join(&path).exists() && heading.is_none_or(has)
    };
    let links = text.split("](").skip(1).filter_map(|rest| rest.split([')', ' ', '\n']).next());
    links.filter(|link| !link.contains("://")).filter(|&link| !leads(link)).map(|link| format!("{document}: {link}")).collect()
}

#[test]
fn each_link_of_a_document_leads_somewhere() {
    let documents = documents();
    assert!(documents.len() > 10, "{documents:?}");
    let wrong = documents.iter().flat_map(|document| broken(document)).collect();
    none(wrong, "Name the file as it lies from the document's folder, and the heading as an address has it.");
}

#[test]
fn a_heading_is_found_by_its_anchor_and_what_is_code_is_none() {
    let of = ["Keys of the window, a gamepad's and a 3D mouse's", " Who watches whom"].map(anchor);
    assert_eq!(of, ["keys-of-the-window-a-gamepads-and-a-3d-mouses", "who-watches-whom"]);
    assert_eq!(anchors("# A\ntext\n```\n# a comment\n```\n## B `c`: d\n"), ["a", "b-c-d"]);
}
