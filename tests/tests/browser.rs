//! The operator's page in a real browser: what it shows of a station that runs, that it finds a new console by itself, that it is read and used by keys, and that a
//! warning is heard.

#[path = "browser/glance.rs"]
mod glance;
#[path = "browser/steady.rs"]
mod steady;

use serde_json::{Value, json};
use station_tests::browser::{Browser, has_chromium};
use station_tests::shown::not_shown;
use station_tests::{Folder, RECOVERY_LIMIT, Station, wait_for};
use std::cell::Cell;
use std::collections::BTreeSet;

/// Who makes a value in every tick, so that rate and age are numbers.
const EVERY_TICK: [&str; 4] = ["hardware", "device", "haptic:0", "haptic:1"];
/// Colours by which a picture differs from an empty one.
const COLOURS: u64 = 100;
/// Width of the line around what has the focus, CSS pixels.
const LEAST_OUTLINE_PX: f64 = 3.0;
/// Presses of Tab that lead once through the page, and more.
const MOST_TABS: usize = 40;

/// What a person reads on the page: the rows of the table by the names of their processes, each with its cells, and what stands around it.
const LOOK: &str = r"(() => {
    const text = id => document.getElementById(id).textContent;
    const cells = row => [...row.cells].slice(1).map(cell => [cell.className.split(' ')[0], cell.querySelector('span').textContent]);
    const rows = [...document.querySelectorAll('#processes tr')].map(row => [row.cells[0].textContent, Object.fromEntries(cells(row))]);
    return {
        rows: Object.fromEntries(rows), state: text('state'), link: text('link'), pressure: text('pump-pressure'), answer: text('answer'),
        events: [...document.querySelectorAll('#events li')].map(item => item.textContent),
        kinds: document.querySelectorAll('#fault:not([hidden]) #fault-kind option').length,
        banner: document.getElementById('banner').checkVisibility() ? text('banner') : null,
        lost: document.getElementById('lost').checkVisibility(),
    };
})()";

/// The live view: the tick of its picture and the number of its colours; null while it shows none.
const PICTURE: &str = r"(() => {
    const live = document.getElementById('live');
    if (live.hidden || live.naturalWidth === 0) return null;
    const pen = new OffscreenCanvas(live.naturalWidth, live.naturalHeight).getContext('2d', { willReadFrequently: true });
    pen.drawImage(live, 0, 0);
    const pixels = new Uint32Array(pen.getImageData(0, 0, live.naturalWidth, live.naturalHeight).data.buffer);
    return { tick: Number(live.dataset.tick), colours: new Set(pixels).size };
})()";

/// Texts of every kind, each with its colour and that of its ground; the first is the page itself.
const TEXTS: &str = r"(() => {
    showAlarms(['one']);
    showLines(document.getElementById('notices'), ['two']);
    const goals = [{ words: 'resect', state: 'open', called_for: false, called_off: true, progress: 0.3, at_s: null }];
    showCase({ name: 'A case', task: 'Do it.', ended: null, goals, warnings: [] });
    const channels = colour => colour.match(/[\d.]+/g).map(Number);
    const ground = element => {
        const colour = getComputedStyle(element).backgroundColor;
        return colour === 'rgba(0, 0, 0, 0)' ? ground(element.parentElement) : colour;
    };
    const kinds = ['body', '#clock', '#banner', '#alarms li', '#notices li', '#goals li.off .goal', 'dt', 'dd', 'thead th', 'tbody th', 'td.state', '#events li', 'label', 'input', 'button'];
    return kinds.map(kind => {
        const element = document.querySelector(kind);
        return [kind, channels(getComputedStyle(element).color), channels(ground(element))];
    });
})()";

/// What has the focus, and how wide the line around it is; null if nothing has.
const FOCUS: &str = r"(() => {
    const it = document.activeElement, style = getComputedStyle(it);
    const isSeen = it.matches(':focus-visible') && style.outlineStyle === 'solid';
    return it === document.body ? null : [it.id, isSeen ? parseFloat(style.outlineWidth) : 0];
})()";

/// An alarm that comes while another one stands: how it is read aloud, whether the one that stands is left alone, and what is shown then.
const ALARMS: &str = r"(() => {
    const list = document.getElementById('alarms');
    showAlarms(['one', 'two']);
    const [, two] = list.children;
    showAlarms(['two', 'three']);
    return [list.getAttribute('aria-live'), list.firstChild === two, [...list.children].map(item => item.textContent)];
})()";

/// What the page says of open goals while a session runs, and whether they are struck out: one that is called for, a stop that is not yet, and one whose
/// place a stop has taken. Then of the latter two when the session is over.
const GOALS: &str = r"(() => {
    const goal = (words, called_for, called_off) => ({ words, state: 'open', called_for, called_off, progress: 0.3, at_s: null });
    const goals = [goal('look', true, false), goal('stop', false, false), goal('resect', false, true)];
    const told = ended => {
        showCase({ name: 'A case', task: 'Do it.', ended, goals, warnings: [] });
        return [...document.querySelectorAll('#goals li')].map(item => {
            const isStruck = getComputedStyle(item.querySelector('.goal')).textDecorationLine === 'line-through';
            return [item.textContent, isStruck];
        });
    };
    return [told(null), told({ at_s: 9, words: 'the time was over' }).slice(1)];
})()";

/// Chooses the fault that is to be injected.
const CHOOSE: &str = r"(() => {
    const [kind, target] = [document.getElementById('fault-kind'), document.getElementById('fault-target')];
    kind.value = 'kill';
    kind.dispatchEvent(new Event('change'));
    target.value = 'recorder';
    return [kind.value, target.value];
})()";

/// A session with nothing to do, of which a warning falls once: when the page has long been open.
const CASE: &str = r#"version = 1
name = "A rest"
rung = "distension"
task = "Do nothing."
scene = "SCENE"
[[goal]]
removed = { percent = 100.0 }
[[warning]]
words = "you have rested for long"
time_above_s = 1.0 # of a session that a resting hand begins after 30 s
"#;

/// Counts the oscillators that the page's sound is made of.
const COUNT_SOUNDS: &str = r"(() => {
    const make = AudioContext.prototype.createOscillator;
    AudioContext.prototype.createOscillator = function () {
        document.body.dataset.sounds = String(Number(document.body.dataset.sounds ?? 0) + 1);
        return make.call(this);
    };
    return true;
})()";

/// Tones that were asked for, sounds that were made, whether this browser can be heard, and what is warned of.
const HEARD: &str = r"(() => ({
    tones: Number(document.body.dataset.tones ?? 0), sounds: Number(document.body.dataset.sounds ?? 0), isHeard: audio?.state === 'running',
    warned: [...document.querySelectorAll('#warnings li, #alarms li')].map(item => item.textContent),
    clock: document.getElementById('clock').textContent, task: document.getElementById('task').checkVisibility(),
}))()";

/// An alarm while the page may be heard, and another one while it is muted: the sounds of each, and how the button stands.
const MUTED: &str = r"(() => {
    const sounds = () => Number(document.body.dataset.sounds ?? 0), button = document.getElementById('sound');
    const before = sounds();
    showAlarms(['one more']);
    const loud = sounds();
    button.click();
    showAlarms(['one more', 'and another one']);
    return [loud - before, sounds() - loud, button.getAttribute('aria-pressed')];
})()";

/// A notice of the pump, and then an alarm beside it: the tones of each, and how the notice is read.
const NOTICE: &str = r"(() => {
    const tones = () => Number(document.body.dataset.tones ?? 0), list = document.getElementById('notices');
    const before = tones();
    showTold({ alarms: [], notices: ['container change'] }, []);
    const noticed = tones();
    showTold({ alarms: ['deficit'], notices: ['container change'] }, []);
    return [noticed - before, tones() - noticed, list.getAttribute('aria-live'), [...list.children].map(item => item.textContent)];
})()";

/// What the page says of the recording; and of one that stands still: whether there is a banner, and how the line is marked.
const RECORDING: &str = r"(() => {
    const line = document.getElementById('recording'), banner = document.getElementById('stands');
    const said = line.textContent;
    showRecording({ file: '/a.mcap', ticks: 7, lost: 3, bytes: 2000000, behind_ticks: 5, stands_still: 'no room' });
    const stands = [banner.checkVisibility(), banner.textContent, line.className, line.textContent];
    showRecording(null);
    return { said, stands, after: [banner.checkVisibility(), line.className, line.textContent] };
})()";

/// Of every text that the page may show the size of its letters, CSS pixels, the least first; and the least of the pump's figures.
const SIZES: &str = r"(() => {
    const size = element => parseFloat(getComputedStyle(element).fontSize);
    const texts = [...document.querySelectorAll('body *')].filter(element => [...element.childNodes].some(node => node.nodeType === 3 && node.data.trim()));
    const sizes = texts.filter(element => !element.closest('script, style, title, svg')).map(element => [size(element), element.id || element.tagName]);
    sizes.sort((a, b) => a[0] - b[0]);
    return [sizes[0], Math.min(...[...document.querySelectorAll('#pump-pressure, #pump-deficit')].map(size))];
})()";

/// What the page says of its pictures: of those that come, and of ones that are half as many as are aimed at. And how wide a plot of ten points is.
const PICTURING: &str = r"(() => {
    const line = document.getElementById('pictures');
    const said = [line.checkVisibility(), line.textContent];
    showPicturing({ period_s: 0.04, scale: 0.5, size_px: [640, 480] }, [{ name: 'rendering', rate_hz: 12.5 }]);
    const short = [line.className, line.textContent];
    const plot = makePlot('a plot');
    drawPlot(plot, Array.from({ length: 10 }, (_, index) => [index, null, null]), 0, value => value / 10);
    return { said, short, box: plot.getAttribute('viewBox'), points: plot.querySelector('polyline').getAttribute('points').split(' ').length, title: plot.querySelector('title').textContent };
})()";
/// Smallest letters, and smallest figures of the pump, CSS pixels: read at arm's length.
const LEAST_LETTERS_PX: f64 = 16.0;
/// See [`LEAST_LETTERS_PX`].
const LEAST_FIGURES_PX: f64 = 30.0;

/// What of the page is wider than its place, and where the live view ends, CSS pixels from the top.
const FITS: &str = r"(() => {
    const parts = [document.documentElement, ...document.querySelectorAll('header, section')];
    const wide = parts.filter(part => part.scrollWidth > part.clientWidth + 1).map(part => part.textContent.slice(0, 40));
    return [wide, Math.ceil(document.getElementById('live').getBoundingClientRect().bottom + scrollY)];
})()";
/// A screen of a laptop, CSS pixels.
const SCREEN: [u64; 2] = [1280, 800];

/// Opens the page of a station.
fn open(name: &str, station: &Station) -> Browser {
    let url = wait_for(RECOVERY_LIMIT, || station.status()["console"].as_str().map(str::to_string)).expect("a page");
    Browser::open(name, &url)
}

/// Waits for a picture of the live view that was drawn after a tick; gives its own.
fn picture(browser: &mut Browser, after: u64) -> u64 {
    browser.wait("a new picture", PICTURE, |picture| {
        let tick = picture["tick"].as_u64().filter(|tick| *tick > after)?;
        (picture["colours"].as_u64()? >= COLOURS).then_some(tick)
    })
}

/// Goes by Tab until an element has the focus, and sees that everything on the way shows that it has it; gives the names of all.
fn tab_to(browser: &mut Browser, id: &str) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    while names.len() < MOST_TABS && names.last().is_none_or(|name| name != id) {
        browser.press("Tab", 9, "");
        let focus = browser.evaluate(FOCUS).expect("what has the focus");
        let name = focus[0].as_str().unwrap_or("the browser itself").to_string();
        assert!(focus.is_null() || focus[1].as_f64() >= Some(LEAST_OUTLINE_PX), "{name} does not show its focus: {focus}");
        names.push(name);
    }
    assert!(names.last().is_some_and(|name| name == id), "{id} is not reached by Tab: {names:?}");
    names
}

/// A figure of the table's row of a process.
fn figure(look: &Value, process: &str, column: &str) -> Option<f64> {
    look["rows"][process][column].as_str()?.parse().ok()
}

/// Rates and ages of those who make a value in every tick; `None` while one of them is no number.
fn figures(look: &Value) -> Option<Vec<f64>> {
    EVERY_TICK.iter().flat_map(|name| [figure(look, name, "rate"), figure(look, name, "age")]).collect()
}

/// The processes that the table names.
fn named(look: &Value) -> BTreeSet<String> {
    look["rows"].as_object().map(|rows| rows.keys().cloned().collect()).unwrap_or_default()
}

#[test]
fn a_browser_shows_every_process_with_live_figures_and_pictures_and_finds_a_new_console_by_itself() {
    if !has_chromium() {
        return;
    }
    let station = Station::start("seen", &["--hand", "script:press"]);
    let mut browser = open("seen", &station);
    let all = || -> Option<BTreeSet<String>> {
        let status = station.status();
        status["processes"].as_array()?.iter().map(|process| Some(process["name"].as_str()?.to_string())).collect()
    };
    let names = browser.wait("every process", LOOK, |look| all().filter(|names| names.len() > 10 && *names == named(look)));
    assert!(EVERY_TICK.iter().chain(&["console", "recorder", "supervisor"]).all(|name| names.contains(*name)), "{names:?}");

    let first = browser.wait("figures that are numbers", LOOK, figures);
    let next = browser.wait("other figures", LOOK, |look| figures(look).filter(|next| *next != first));
    assert!(next.iter().all(|figure| figure.is_finite() && *figure >= 0.0), "{first:?}, then {next:?}");
    browser.wait("the device's rate", LOOK, |look| figure(look, "device", "rate").filter(|rate| *rate > 100.0));
    browser.wait("the pump", LOOK, |look| look["pressure"].as_str()?.parse::<f64>().ok());
    let is_said = |look: &Value| look["said"].as_str()?.starts_with("Recording /").then(|| look.clone());
    let recording = browser.wait("the recording", RECORDING, is_said);
    let line = "Recording /a.mcap: 7 ticks on disk, 2.0 MB, 5 ticks behind, 3 ticks are lost.";
    assert_eq!(recording["stands"], json!([true, "The recording stands still: no room", "bad", line]));
    assert_eq!(recording["after"], json!([false, "quiet", "Nothing is recorded."]));
    let is_connected = |look: &Value| look["link"] == "connected" && look["state"] == "running" && look["lost"] == false;
    let connected = |look: &Value| is_connected(look).then(|| look["banner"].clone());
    assert_eq!(browser.wait("that it is connected", LOOK, connected), Value::Null, "no banner of a test mode that is off");

    glance::assert_connection_is_what_is_said(&mut browser);
    let (is_drawn, mut tick) = (std::env::var_os("HYSTATION_NO_GPU").is_none(), 0);
    if is_drawn {
        let before = picture(&mut browser, 0);
        tick = picture(&mut browser, before);
    }
    let ([width, height], colours) = browser.screenshot();
    assert!(width >= 800 && height >= 600, "{width} × {height}");
    let least = if is_drawn { COLOURS } else { 2 };
    assert!(colours >= least, "the page is drawn in {colours} colours");
    assert!(browser.faults.is_empty(), "{:?}", browser.faults);
    glance::assert_fits_narrow_screens(&mut browser);
    steady::assert_steady(&mut browser);
    let [width, height] = SCREEN;
    glance::set_screen(&mut browser, SCREEN);
    let fits = browser.evaluate(FITS).expect("what fits");
    assert_eq!(fits[0], json!([]), "cropped at {width} × {height}");
    assert!(fits[1].as_u64().is_some_and(|bottom| bottom <= height), "the live view ends at {} of {height}", fits[1]);

    station.kill("console", true);
    let pid = station.pid("console", true).to_string();
    browser.wait("the new console", LOOK, |look| {
        (look["rows"]["console"]["pid"] == pid.as_str() && look["link"] == "connected").then_some(())
    });
    if is_drawn {
        picture(&mut browser, tick);
    }
    let ended = station.stop();
    let is_lost = |look: &Value| look["state"] == "not known" && look["pressure"] == "–" && look["lost"] == true;
    browser.wait("that nothing is known of a station that is gone", LOOK, |look| is_lost(look).then_some(()));
    drop(browser);
    ended.assert_clean();
}

#[test]
fn the_page_is_read_by_day_and_by_night_and_its_buttons_are_reached_and_pressed_by_keys() {
    if !has_chromium() {
        return;
    }
    let station = Station::start("typed", &["--hand", "script:press", "--test-mode"]);
    station.kill("collision-worker", true); // an event to be read
    let mut browser = open("typed", &station);
    let offered = |look: &Value| (look["kinds"].as_u64()? > 0 && !look["events"].as_array()?.is_empty()).then_some(());
    browser.wait("faults that it offers", LOOK, offered);
    browser.wait("the banner of the test mode", LOOK, |look| look["banner"].as_str()?.starts_with("Test mode: ").then_some(()));
    let [day, night] = ["light", "dark"].map(|scheme| browser.assert_readable("screen", scheme, TEXTS));
    assert!(day > 0.5 && night < 0.1, "the ground is {day:.2} bright by day and {night:.2} by night");
    glance::assert_page_says_what_there_is(&mut browser);
    let sizes = browser.evaluate(SIZES).expect("the sizes of all letters");
    let [least, figures] = [&sizes[0][0], &sizes[1]].map(|size| size.as_f64().unwrap_or(0.0));
    assert!(least >= LEAST_LETTERS_PX && figures >= LEAST_FIGURES_PX, "not to be read at arm's length: {sizes}");
    if std::env::var_os("HYSTATION_NO_GPU").is_none() {
        let is_said = |it: &Value| it["said"][1].as_str()?.contains("pictures a second of").then(|| it.clone());
        let picturing = browser.wait("how pictures are made", PICTURING, is_said);
        let words = "12.5 pictures a second of 25 that it aims at, drawn at 0.50 of 640 × 480. The machine is too slow for more.";
        assert_eq!(picturing["short"], json!(["bad", words]));
        let plot = [&picturing["box"], &picturing["points"], &picturing["title"]];
        assert_eq!(plot, [&json!("0 0 29 100"), &json!(10), &json!("0.0 to 9.0")]);
    }
    assert_eq!(browser.evaluate(ALARMS), Some(json!(["assertive", true, ["two", "three"]])));
    let called_off = json!(["– resect – not called for any more", true]);
    let runs = json!([["○ look – 30 %", false], ["○ stop – not called for yet", false], called_off]);
    let over = json!([["○ stop – not called for", false], called_off]);
    assert_eq!(browser.evaluate(GOALS), Some(json!([runs, over])));

    let before = station.pid("recorder", true).to_string();
    assert_eq!(browser.evaluate(CHOOSE), Some(json!(["kill", "recorder"])));
    let names = tab_to(&mut browser, "fault-do");
    for field in ["events", "swap-role", "swap-binary", "swap-do", "fault-kind", "fault-target"] {
        assert!(names.iter().any(|name| name == field), "{field} is not reached by Tab: {names:?}");
    }
    browser.press("Enter", 13, "\r");
    browser.wait("that it was done", LOOK, |look| look["answer"].as_str()?.starts_with("Done").then_some(()));
    let died = |line: &Value| line.as_str().is_some_and(|line| line.contains("recorder") && line.contains("died"));
    browser.wait("the event", LOOK, |look| look["events"].as_array()?.iter().any(died).then_some(()));
    browser.wait("the new recorder", LOOK, |look| {
        let pid = look["rows"]["recorder"]["pid"].as_str()?;
        (pid != before && pid != "0" && look["rows"]["recorder"]["restarts"] == "1").then_some(())
    });
    assert!(browser.faults.is_empty(), "{:?}", browser.faults);
    drop(browser);
    station.recover();
    station.stop().assert_clean();
}

#[test]
fn a_warning_is_a_tone_when_it_comes_and_none_before_or_while_it_stands_or_when_it_is_muted() {
    if !has_chromium() {
        return;
    }
    let folder = Folder::new("browser-case");
    let case = folder.write("case.toml", &CASE.replace("SCENE", &folder.scene()));
    let station = Station::start("heard", &[&case, "--hand", "idle"]);
    let mut browser = open("heard", &station);
    browser.wait("the task", HEARD, |heard| (heard["task"] == true).then_some(()));
    assert_eq!(browser.evaluate(COUNT_SOUNDS), Some(json!(true)));
    browser.press("Tab", 9, ""); // until somebody has touched it a browser lets no page sound
    let was_quiet = Cell::new(false);
    let of = |heard: &Value, key: &str| heard[key].as_u64().unwrap_or(0);
    let fallen = browser.wait("the warning", HEARD, |heard| {
        let warned = heard["warned"].as_array()?;
        if warned.is_empty() {
            assert_eq!((of(heard, "tones"), of(heard, "sounds")), (0, 0), "a tone of nothing: {heard}");
            was_quiet.set(true);
        }
        let is_it = |line: &Value| line.as_str().is_some_and(|line| line.starts_with("you have rested for long (first at "));
        warned.iter().any(is_it).then(|| heard.clone())
    });
    assert!(of(&fallen, "tones") >= 1, "nothing is heard of the warning: {fallen}");
    if !was_quiet.get() {
        not_shown("whether the page is quiet before a warning: the machine opened it too late");
    }
    let later = browser.wait("the clock", HEARD, |heard| (heard["clock"] != fallen["clock"]).then(|| heard.clone()));
    if later["warned"] == fallen["warned"] {
        assert_eq!(of(&later, "tones"), of(&fallen, "tones"), "a warning that stands is not heard again: {later}");
    }
    // Of a machine without any sound a browser may have none to give.
    if later["isHeard"] == true && was_quiet.get() {
        assert_eq!(of(&later, "sounds"), of(&later, "tones"), "each tone is a sound: {later}");
        assert_eq!(browser.evaluate(MUTED), Some(json!([1, 0, "true"])));
    } else {
        not_shown("whether a tone sounds: this browser makes no sound");
    }
    assert_eq!(browser.evaluate(NOTICE), Some(json!([0, 1, "polite", ["Pump: container change"]])));
    assert!(browser.faults.is_empty(), "{:?}", browser.faults);
    drop(browser);
    station.stop().assert_clean();
}
