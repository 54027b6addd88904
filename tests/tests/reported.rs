//! The report of a session in a real browser: pictures of what happened, which the recorder asked rendering for, are on the page and can be seen; nothing reaches
//! beyond the page; every text can be read by day, by night and on paper.

use serde_json::Value;
use station_tests::browser::{Browser, has_chromium};
use station_tests::shown::not_shown;
use station_tests::{Folder, START_LIMIT, hystation, run, wait_for};
use std::path::{Path, PathBuf};
use std::process::Stdio;

/// Colours by which a picture differs from an empty one.
const COLOURS: u64 = 100;
/// A rendering that made so many steps has had time for a picture.
const STEPS: u64 = 30;

/// The page once it is laid out: headings, pictures with their words and colours, drawings by their height, and how far anything reaches beyond the page.
const LOOK: &str = r"(() => {
    if (document.readyState !== 'complete') return null;
    const figures = [...document.querySelectorAll('.pictures figure')].map(figure => {
        const image = figure.querySelector('img');
        const pen = new OffscreenCanvas(image.naturalWidth || 1, image.naturalHeight || 1).getContext('2d', { willReadFrequently: true });
        pen.drawImage(image, 0, 0);
        const pixels = new Uint32Array(pen.getImageData(0, 0, pen.canvas.width, pen.canvas.height).data.buffer);
        return { words: figure.textContent, width: image.getBoundingClientRect().width, colours: new Set(pixels).size };
    });
    return {
        title: document.querySelector('h1').textContent, headings: [...document.querySelectorAll('h2')].map(heading => heading.textContent),
        figures, curves: [...document.querySelectorAll('svg')].map(curve => curve.getBoundingClientRect().height),
        beyond: document.documentElement.scrollWidth - document.documentElement.clientWidth,
    };
})()";

/// Texts of every kind that is there, each with its colour and that of its ground; the first is the page itself.
const TEXTS: &str = r"(() => {
    const channels = colour => colour.match(/[\d.]+/g).map(Number);
    const ground = element => {
        const colour = getComputedStyle(element).backgroundColor;
        return colour === 'rgba(0, 0, 0, 0)' ? ground(element.parentElement) : colour;
    };
    const kinds = ['body', 'h1', 'dt', 'dd', '.tile b', '.tile span', 'p.note', 'th', 'td', 'td.source', 'tr.group td', 'figcaption', 'figcaption b', 'svg text'];
    const found = kinds.map(kind => [kind, document.querySelector(kind)]).filter(([, element]) => element);
    return found.map(([kind, element]) => {
        const style = getComputedStyle(element);
        return [kind, channels(kind.startsWith('svg') ? style.fill : style.color), channels(ground(element))];
    });
})()";

/// Whom the report names.
const TRAINEE: &str = "Ana Müller";

fn polyp_case() -> String {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/cases/polyp.toml").display().to_string()
}

/// The polyp case from its start to its report, in real time by all processes of a station: the report for programs, and the page.
fn session(folder: &Folder) -> (Value, String) {
    let case = polyp_case();
    let (recording, page) = (folder.path("session.mcap"), folder.path("page.html"));
    let (station, trainee) = (format!("r{}", std::process::id()), format!("trainee={TRAINEE}"));
    let mut command = hystation();
    command.args(["--name", &station, "run", &case, "--headless", "--hand", "script:resects", "--until-end", "--for", "90s"]);
    let (code, _, said) = run(command.args(["--record", &recording, "--set", &trainee, "--set", "console_port=0"]));
    assert!(code == Some(0) && said.contains("the session is over"), "{said}");
    let (code, report, said) = run(hystation().args(["report", &recording, "--json", "-", "--html", &page]));
    assert_eq!(code, Some(0), "{said}");
    (serde_json::from_str(&report).expect("a report"), page)
}

#[test]
fn a_report_shows_in_a_browser_what_was_seen_when_something_happened() {
    let folder = Folder::new("reported");
    let (report, page) = session(&folder);
    let pictures = report["pictures"].as_array().expect("a list");
    println!("{pictures:#?}");
    assert_eq!(report["case"]["ended"]["by"], "goals", "{}", report["case"]);
    let goals = report["case"]["goals"].as_array().expect("a list");
    assert!(goals.len() == 3 && goals.iter().all(|goal| goal["state"] == "reached"), "{}", report["case"]);
    let session = &report["session"];
    assert!(
        session["trainee"] == TRAINEE && session["begun_utc"].as_str().is_some_and(|begun| begun.starts_with("20")),
        "{session}"
    );
    for fact in ["build", "cpu", "cores", "kernel"] {
        assert!(session[fact].as_str().is_some_and(|fact| !fact.is_empty()), "{fact}: {session}");
    }
    let steps = report["station"]["processes"]["rendering"]["steps"].as_u64().unwrap_or(0);
    let words: Vec<&str> = pictures.iter().filter_map(|picture| picture["words"].as_str()).collect();
    if std::env::var_os("HYSTATION_NO_GPU").is_some() {
        assert!(pictures.is_empty(), "nobody draws");
    } else if pictures.is_empty() && steps < STEPS {
        not_shown("pictures in a report: rendering was not there in time");
    } else {
        assert!(
            words.iter().any(|words| words.contains("the session begins") || words.contains("the session is over")),
            "{words:?}"
        );
    }
    for picture in pictures {
        let late = picture["tick"].as_u64().zip(picture["event_tick"].as_u64()).map(|(tick, event)| tick.checked_sub(event));
        assert!(late.flatten().is_some_and(|ticks| ticks < 5_000), "{picture}: of that moment, and not of another");
    }
    let text = folder.read("page.html");
    for class in ["organ", "pathology"] {
        assert_eq!(text.matches(&format!("class=\"{class}\"")).count(), 2, "the {class} behind the way, from two sides");
    }
    if !has_chromium() {
        return;
    }
    let mut browser = Browser::open("reported", &format!("file://{page}"));
    let look = browser.wait("a report", LOOK, |look| look["title"].is_string().then(|| look.clone()));
    assert!(
        look["title"].as_str().is_some_and(|title| title.starts_with("Training session") && title.ends_with(TRAINEE)),
        "{look:#}"
    );
    let figures = look["figures"].as_array().expect("a list");
    assert_eq!(figures.len(), words.len(), "{look:#}");
    for (figure, words) in figures.iter().zip(words) {
        assert!(figure["words"].as_str().is_some_and(|shown| shown.contains(words)), "{figure}");
        assert!(figure["width"].as_f64() >= Some(200.0) && figure["colours"].as_u64() >= Some(COLOURS), "{figure}");
    }
    let curves = look["curves"].as_array().expect("a list");
    assert!(curves.len() == 3 && curves.iter().all(|height| height.as_f64() >= Some(300.0)), "{look:#}");
    assert_eq!(look["beyond"], 0, "nothing reaches beyond the page");
    let grounds = [("screen", "light"), ("screen", "dark"), ("print", "dark")]
        .map(|(media, scheme)| browser.assert_readable(media, scheme, TEXTS));
    assert!(grounds[0] > 0.5 && grounds[1] < 0.1 && grounds[2] > 0.9, "by day, by night, on paper: {grounds:?}");
    let (_, colours) = browser.screenshot();
    assert!(colours >= 2 && browser.faults.is_empty(), "{:?}", browser.faults);
}

/// One that was ended by hand had no page, not even where a class's sessions have theirs.
#[test]
fn a_session_that_is_stopped_has_its_page_beside_its_recording_and_the_stop_waits_for_that() {
    let folder = Folder::new("stopped");
    let (sessions, station) = (folder.path("sessions/"), format!("q{}", std::process::id()));
    let mut command = hystation();
    command.args(["--name", &station, "run", &polyp_case(), "--headless", "--hand", "script:resects", "--for", "180s"]);
    command.args(["--roles", "hardware,device,haptic,tissue,fluid,collision-worker,recorder", "--record", &sessions]);
    let log = std::fs::File::create(folder.path("said")).expect("a file");
    let mut child = command.stdout(Stdio::null()).stderr(log).spawn().expect("hystation");
    let has_ticks = wait_for(START_LIMIT, || {
        let (_, status, _) = run(hystation().args(["--name", &station, "status", "--json"]));
        let status: Value = serde_json::from_str(&status).ok()?;
        status["recording"]["ticks"].as_u64().filter(|ticks| *ticks > 1_000)
    });
    let (code, _, told) = run(hystation().args(["--name", &station, "stop"]));
    let files = std::fs::read_dir(&sessions).into_iter().flatten().flatten().map(|entry| entry.path());
    let pages: Vec<PathBuf> = files.filter(|file| file.extension().is_some_and(|end| end == "html")).collect();
    child.wait().expect("hystation");
    let said = folder.read("said");
    assert!(has_ticks.is_some() && code == Some(0), "{code:?} {told}\n{said}");
    let [page] = &pages[..] else { panic!("{pages:?}: {said}") };
    assert!(said.contains(&format!("the report of the session is {}", page.display())), "{said}");
    assert!(std::fs::read_to_string(page).expect("a page").contains("Resection of a polyp"), "{}", page.display());
}
