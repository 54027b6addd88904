//! What an operator takes from the page at a glance, and what it may not leave to be guessed: each asked of the page's own functions, while a station runs.

use serde_json::{Value, json};
use station_tests::browser::Browser;

/// What the page says of its connection, and whether a state still stands there in green: before it has heard anything, when it has, of an address that has become
/// another station's, and of a station that was stopped.
const LINK: &str = r"(() => {
    const link = document.getElementById('link'), lost = document.getElementById('lost');
    const state = document.querySelector('td.state.good') ?? document.createElement('td');
    const told = () => {
        showLink();
        return [link.textContent, lost.checkVisibility() && lost.textContent.split(':')[0], getComputedStyle(state).color];
    };
    heard = performance.now();
    hasHeard = false;
    const before = told();
    hasHeard = true;
    const connected = told();
    isStranger = true;
    const stranger = told();
    isStranger = false;
    hasEnded = true;
    const ended = told();
    hasEnded = false;
    isLost = false;
    return { said: [before, connected, stranger, ended].map(three => three.slice(0, 2)), isGreen: connected[2] !== stranger[2], after: told()[1] };
})()";

/// That nothing is called connected before it is, and that a page of a station that has ended says so, and shows nobody as well.
pub fn assert_connection_is_what_is_said(browser: &mut Browser) {
    let told = browser.evaluate(LINK).expect("what is said of the connection");
    let lost = "The station of this page has ended, and another one has its address";
    let [connecting, connected] = ["connecting", "connected"].map(|link| json!([link, false]));
    let ended = ["the station has ended", "The station has ended"];
    let said = json!([connecting, connected, ["connection lost, trying again", lost], ended]);
    assert_eq!((&told["said"], &told["isGreen"], &told["after"]), (&said, &Value::Bool(true), &Value::Bool(false)), "{told}");
}

/// All of the following, of a page that has shown a station's processes.
pub fn assert_page_says_what_there_is(browser: &mut Browser) {
    assert_newcomers_alarm_nobody(browser);
    assert_missing_pictures_are_explained(browser);
    assert_buttons_say_what_they_do(browser);
    assert_alarms_and_swaps_stand_above_everything(browser);
    assert_head_says_whose_session_it_is_and_whether_it_is_recorded(browser);
}

/// What stands above everything else: alarms, each with what it means, with their count in the name of the tab, and a swap; then nothing of it.
const ABOVE: &str = r"(() => {
    const alarms = document.getElementById('alarms'), swaps = document.getElementById('swaps');
    const texts = () => [[...alarms.children].map(item => item.textContent), document.title.startsWith('(2) Hyst'), swaps.checkVisibility(), swaps.textContent];
    showTold({ alarms: ['perforation'], notices: [] }, ['fluid']);
    showSwaps([{ role: 'recorder', stage: 'the newcomer has the role, on probation' }]);
    const told = texts();
    scrollTo(0, document.documentElement.scrollHeight);
    const { top, bottom } = alarms.getBoundingClientRect();
    const isSeen = top >= 0 && bottom <= innerHeight && scrollY > 0;
    scrollTo(0, 0);
    showTold(null, []);
    showSwaps([]);
    return { told, isSeen, after: texts() };
})()";

/// That alarms and swaps stand above everything, wherever the page is scrolled to, and mean something to who has no handbook.
fn assert_alarms_and_swaps_stand_above_everything(browser: &mut Browser) {
    let told = browser.evaluate(ABOVE).expect("what stands above everything");
    let perforation = "Pump: perforation – 60 ml/min more than all veins and the sheath could take are lost";
    let alarms = json!([perforation, "fluid is held still: nobody knows pressure, flow and deficit"]);
    let swap = "recorder is swapped: the newcomer has the role, on probation.";
    assert_eq!(told["told"], json!([alarms, true, true, swap]));
    assert_eq!((&told["isSeen"], &told["after"]), (&Value::Bool(true), &json!([[], false, false, ""])));
}

/// Whether something is recorded, who trains and what is shown again, and what is agreed on of a case, in the head of the page and under its task; and of the pump
/// which valve is shut.
const HEAD: &str = r"(() => {
    const text = id => document.getElementById(id).checkVisibility() && document.getElementById(id).textContent;
    const recorded = stands_still => {
        showRecording({ file: '/a.mcap', ticks: 7, lost: 0, bytes: 2000000, behind_ticks: 5, stands_still });
        return text('recorded');
    };
    const recording = [recorded(null), recorded('no room')];
    showRecording({ file: '/a.mcap', ticks: 7, lost: 0, bytes: 2000000, behind_ticks: 5, stands_still: null, free_bytes: 61500000, lasts_s: 61.5 });
    recording.push(text('recorded'), document.getElementById('recorded').className);
    showRecording({ file: '/a.mcap', ticks: 7, lost: 0, bytes: 2000000, behind_ticks: 5, stands_still: null, free_bytes: 9e9, lasts_s: 9000 });
    recording.push(text('recorded'), document.getElementById('recording').textContent.split('. ').pop());
    showRecording(null);
    recording.push(text('recorded'));
    showWho('Ana Müller', null);
    const who = [text('who')];
    showPump({ inflow_ml_min: 85.4, outflow_ml_min: 0, shut: [false, true] });
    const pump = ['inflow', 'outflow'].map(port => document.getElementById(`pump-${port}`).parentElement.textContent);
    showWho('Ana Müller', '/b.mcap');
    who.push(text('who'));
    showWho(null, null);
    who.push(text('who'));
    const told = { name: 'A case', task: 'Do it.', ended: null, goals: [], warnings: [], seed: 7, ends: ['all goals are reached', 'after 600 s'] };
    const terms = [null, 12.34].map(began_s => {
        showCase({ ...told, began_s });
        return text('terms');
    });
    showCase({ ...told, deficit_limit_ml: 1000 });
    const limit = document.getElementById('pump-deficit-limit').textContent;
    const left = [null, 71000].map(until_tick => {
        showCase({ ...told, until_tick });
        showLeft(10001);
        return text('left');
    });
    showCase(told);
    showLeft(10001);
    return { recording, who, terms, pump, left, limit };
})()";

/// That one sees at the page's head whether anything is recorded and whose session it is, under the task what was agreed on, and at the pump a valve that is shut.
fn assert_head_says_whose_session_it_is_and_whether_it_is_recorded(browser: &mut Browser) {
    let told = browser.evaluate(HEAD).expect("what the head of the page says");
    let short = ["recording, its disk lasts 1 min 01 s more", "bad"];
    let long = ["recording", "Its disk lasts 2.5 h more."];
    assert_eq!(
        told["recording"],
        json!(["recording", "recording stands still", short[0], short[1], long[0], long[1], "not recorded"])
    );
    assert_eq!(told["who"], json!(["trainee: Ana Müller", "replay of /b.mcap, trainee: Ana Müller", false]));
    let terms = |began: &str| format!("Seed 7. It ends: all goals are reached; after 600 s. {began}");
    let began = [terms("The time has not begun to count."), terms("The time counts from 12.3 s.")];
    assert_eq!(told["terms"], json!(began));
    assert_eq!(told["limit"], ", at most 1000");
    assert_eq!(told["left"], json!([false, "Time left: 1 min 01 s"]));
    assert_eq!(told["pump"], json!(["85 ml/min", "0 ml/min, shut"]));
}

/// What of the page is wider than its place: the page itself, its parts, and the table, which alone may be moved sideways, on a phone.
const WIDE: &str = r"(() => {
    const isWide = part => part.scrollWidth > part.clientWidth + 1;
    const parts = [document.documentElement, ...document.querySelectorAll('header, section:not([aria-labelledby=processes-title])')];
    const table = document.querySelector('section[aria-labelledby=processes-title]');
    return [parts.filter(isWide).map(part => part.textContent.slice(0, 40)), isWide(table)];
})()";

/// Screens, CSS pixels: the narrowest of a projector or an old laptop, on which the table is seen as a whole; half a screen, just above and below where both columns
/// have room; a phone.
const PROJECTOR: [u64; 2] = [1024, 768];
const NARROW: [[u64; 2]; 3] = [[870, 800], [820, 800], [390, 844]];

/// Shows the page on a screen, CSS pixels.
pub fn set_screen(browser: &mut Browser, [width, height]: [u64; 2]) {
    let screen = json!({ "width": width, "height": height, "deviceScaleFactor": 1, "mobile": false });
    browser.ask("Emulation.setDeviceMetricsOverride", screen);
}

/// That nothing is cropped on screens that are narrower than a laptop's.
pub fn assert_fits_narrow_screens(browser: &mut Browser) {
    set_screen(browser, PROJECTOR);
    assert_eq!(browser.evaluate(WIDE), Some(json!([[], false])), "cropped at {PROJECTOR:?}");
    for screen in NARROW {
        set_screen(browser, screen);
        let wide = browser.evaluate(WIDE).expect("what is too wide");
        assert_eq!(wide[0], json!([]), "cropped at {screen:?}");
    }
}

/// What the buttons at the page's head are called, and what they do: that of the sound while it is muted, and that of the shade twice.
const BUTTONS: &str = r"(() => {
    const [sound, shade] = ['sound', 'shade'].map(id => document.getElementById(id));
    const wasMuted = isMuted;
    isMuted = true;
    nameSound();
    const muted = [sound.textContent, sound.getAttribute('aria-pressed')];
    isMuted = wasMuted;
    nameSound();
    nameShade();
    const told = () => [shade.textContent, getComputedStyle(document.body).backgroundColor, localStorage.getItem('shade')];
    const [first, second, third] = [0, 1, 1].map(clicks => {
        if (clicks) shade.click();
        return told();
    });
    delete document.documentElement.dataset.shade;
    localStorage.removeItem('shade');
    return { muted, names: [first[0], second[0]].sort(), isOther: first[1] !== second[1], isBack: first[1] === third[1] && first[0] === third[0],
        kept: [second[2], third[2]].sort() };
})()";

/// That a page can be dark in a dark room whatever the desktop is, and that a muted one says so to eye and ear alike.
fn assert_buttons_say_what_they_do(browser: &mut Browser) {
    let told = browser.evaluate(BUTTONS).expect("what the buttons do");
    let names = json!(["Dark page", "Light page"]);
    let all = json!({ "muted": ["Warnings are muted", "true"], "names": names, "isOther": true, "isBack": true, "kept": ["dark", "light"] });
    assert_eq!(told, all);
}

/// That a process which is on its way is shown neither as well nor as ill, and names its program.
fn assert_newcomers_alarm_nobody(browser: &mut Browser) {
    let kinds = browser.evaluate("['live', 'spare', 'starting', 'warming', 'failed', 'dead'].map(kindOf)");
    assert_eq!(kinds, Some(json!(["good", "good", "quiet", "quiet", "bad", "bad"])));
    let program = browser.evaluate("document.querySelector('#process-device th').title.split('/').pop()");
    assert_eq!(program, Some(json!("device")));
}

/// What stands in the place of the live view: of a station that has drawn nothing, of one that draws, and of one that drew.
const NO_PICTURE: &str = r"(() => {
    const note = (pictures, isFirst) => {
        showPicturing(pictures, []);
        return noteOf(isFirst).split('.')[0];
    };
    const pictures = { period_s: 0.04, scale: 1, size_px: [640, 480] };
    return [note(null, true), note(pictures, true), note(null, false)];
})()";

/// That a station which draws nothing is not waited for as one whose first picture is under way.
fn assert_missing_pictures_are_explained(browser: &mut Browser) {
    let told = browser.evaluate(NO_PICTURE);
    assert_eq!(told, Some(json!(["Nothing is drawn so far", "There is no picture yet", "No new picture comes"])));
}
