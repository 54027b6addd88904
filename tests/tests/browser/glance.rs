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
    assert_a_swap_is_asked_for_twice(browser);
    assert_a_picture_that_goes_moves_nothing(browser);
    assert_alarms_and_swaps_stand_above_everything(browser);
    assert_head_says_whose_session_it_is_and_whether_it_is_recorded(browser);
    assert_one_glance_tells_whether_all_are_well(browser);
    assert_another_console_takes_nothing_away(browser);
    assert_what_is_read_aloud_is_what_is_new(browser);
    assert_faults_are_asked_for_as_they_can_be_and_told_of(browser);
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
    let perforation = "Pump: perforation – 60 ml/min more than all veins and the sheath could take are lost – current off, inflow shut, \
                       at once";
    let held = "fluid is held still: nobody knows pressure, flow and deficit – it is tried again by itself; if it does not come back, \
                end the session and start anew";
    let alarms = json!([perforation, held]);
    let swap = "recorder is swapped: the newcomer has the role, on probation.";
    assert_eq!(told["told"], json!([alarms, true, true, swap]));
    assert_eq!((&told["isSeen"], &told["after"]), (&Value::Bool(true), &json!([[], false, false, ""])));
}

/// Whether something is recorded, who trains and what is shown again, and what is agreed on of a case, in the head of the page and under its task; and of the pump
/// which valve is shut.
const HEAD: &str = r"(() => {
    const text = id => document.getElementById(id).checkVisibility() && document.getElementById(id).textContent;
    const recorded = stands_still => {
        showRecording({ file: '/a.mcap', ticks: 7, lost: 0, bytes: 2000000, behind_ticks: 5, stands_still, free_bytes: null, lasts_s: null });
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
    const unseen = [0, 12.34].map(unseen_s => {
        showCase({ ...told, unseen_s });
        return text('unseen');
    });
    showCase(told);
    showLeft(10001);
    return { recording, who, terms, pump, left, limit, unseen };
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
    let unseen = "For 12.3 s this page was gone and judged nothing: goals and warnings of that time may be missing here. The report has them.";
    assert_eq!(told["unseen"], json!([false, unseen]));
}

/// What of the page is wider than its place: the page itself, its parts, and the table, which alone may be moved sideways, on a phone.
const WIDE: &str = r"(() => {
    const isWide = part => part.scrollWidth > part.clientWidth + 1;
    const parts = [document.documentElement, ...document.querySelectorAll('header, section:not([aria-labelledby=processes-title])')];
    const table = document.querySelector('section[aria-labelledby=processes-title]');
    return [parts.filter(isWide).map(part => part.textContent.slice(0, 40)), isWide(table)];
})()";

/// Screens, CSS pixels: the narrowest of a projector or an old laptop, on which the table is seen as a whole; half a screen, just above and below where both columns
/// have room; a phone; and what a laptop's screen is when it is enlarged four times (WCAG 2.2, 1.4.10).
const PROJECTOR: [u64; 2] = [1024, 768];
const NARROW: [[u64; 2]; 4] = [[870, 800], [820, 800], [390, 844], [320, 256]];

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

/// What is asked of the console, and what is said, when a swap is pressed once, then of another binary, then of that by a double click, and a second later.
const SWAP: &str = r"(() => {
    const usual = window.fetch, [role, binary] = ['swap-role', 'swap-binary'].map(id => document.getElementById(id));
    const answer = document.getElementById('answer'), chosen = role.value, posted = [];
    window.fetch = (path, how) => {
        posted.push([path, how.body]);
        return Promise.reject(new Error('nobody is there'));
    };
    const press = () => {
        document.getElementById('swap').requestSubmit();
        return [posted.length, answer.textContent];
    };
    [role.value, binary.value] = ['device', '/a'];
    const first = press();
    binary.value = '/b';
    const told = [first, press(), press()];
    asked.at -= 1000;
    told.push(press());
    window.fetch = usual;
    [role.value, binary.value] = [chosen, ''];
    return { told, posted };
})()";

/// That a swap which was pressed in passing changes nothing, and what it costs is said before.
fn assert_a_swap_is_asked_for_twice(browser: &mut Browser) {
    let told = browser.evaluate(SWAP).expect("what comes of a swap");
    let said = |binary: &str| {
        let cost = "The hand feels it: for some 10 ms nobody commands the motors.";
        format!("device is to be replaced by {binary}. {cost} If that is meant, press Swap once more within ten seconds.")
    };
    assert_eq!(told["told"], json!([[0, said("/a")], [0, said("/b")], [0, said("/b")], [1, "…"]]));
    assert_eq!(told["posted"], json!([["/swap", "{\"role\":\"device\",\"binary\":\"/b\"}"]]));
}

/// Where what follows the live view begins, CSS pixels, with a picture and without one; and how a figure is shown that is nearly nothing.
const STEADY: &str = r"(() => {
    const live = document.getElementById('live'), was = live.hidden;
    const top = isHidden => {
        live.hidden = isHidden;
        document.getElementById('live-note').hidden = !isHidden;
        return document.getElementById('processes').getBoundingClientRect().top;
    };
    const [without, withOne] = [top(true), top(false)];
    top(was);
    return [without === withOne, [-0.3, -0.04, -1.2, 3].map(value => number(value, 1)), number(-0.4)];
})()";

/// That the page stands still while rendering is replaced, and no figure has a sign that means nothing.
fn assert_a_picture_that_goes_moves_nothing(browser: &mut Browser) {
    assert_eq!(browser.evaluate(STEADY), Some(json!([true, ["-0.3", "0.0", "-1.2", "3.0"], "0"])));
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

/// What the head of the page says of processes that are well, on their way and gone; and whether one that stays gone is said above everything.
const HEALTH: &str = r"(() => {
    const ill = document.getElementById('ill');
    const told = (...states) => {
        showHealth(states.map((state, index) => ({ name: `fluid:${index}`, state })));
        return [document.getElementById('health').textContent, ill.checkVisibility()];
    };
    const all = [told('live', 'spare'), told('live', 'warming'), told('live', 'dead')];
    illSince.set('fluid:1', performance.now() - 2 * ILL_MS);
    all.push(told('live', 'dead'));
    const words = ill.textContent;
    all.push(told('live', 'live'));
    showHealth(null);
    return { all, words };
})()";

/// That nobody has to read a table to know whether something is wrong with a process, and what is to be done.
fn assert_one_glance_tells_whether_all_are_well(browser: &mut Browser) {
    let told = browser.evaluate(HEALTH).expect("what is said of the processes");
    let well = json!(["all 2 processes are well", false]);
    let gone = |is_said: bool| json!(["not well: fluid:1 (dead)", is_said]);
    assert_eq!(told["all"], json!([well, ["1 of 2 processes are ready", false], gone(false), gone(true), well]));
    let words = told["words"].as_str().unwrap_or_default();
    assert!(words.starts_with("fluid:1 is gone") && words.contains("`hystation logs fluid:1`"), "{words}");
}

/// What is left of the page when a console comes that has not heard its supervisor: the rows of its table, the banner of the test mode, and what is said of it.
const UNLED_LOOK: &str = r"(() => {
    const rows = () => document.querySelectorAll('#processes tr').length, before = rows();
    const nothing = { station: '', tick: 0, state: '', test_mode: false, held: [], processes: [], recording: null };
    showLook({ ...nothing, silence: 'no supervisor answers', pump: null, tissue: null, pictures: null, swaps: [], faults: [] });
    const [banner, trouble] = ['banner', 'trouble'].map(id => document.getElementById(id));
    return [rows() === before && before > 10, banner.checkVisibility(), trouble.textContent, document.getElementById('pump-unknown').checkVisibility()];
})()";

/// The table was emptied, and the banner of the test mode gone, under a line that said that they stood as they were last known.
fn assert_another_console_takes_nothing_away(browser: &mut Browser) {
    let told = browser.evaluate(UNLED_LOOK).expect("what is left of the page");
    assert_eq!([&told[0], &told[1], &told[3]], [&Value::Bool(true); 3], "{told}");
    let words = told[2].as_str().unwrap_or_default();
    assert!(
        words.contains("as they were last known: no supervisor answers. ") && words.contains("`hystation status`"),
        "{words}"
    );
}

/// A warning that falls after another one, and stands before it in the case: whether the other keeps its line, and what both say. Then with neither, and what is said
/// of a goal on its way and of one that is reached.
const WARNINGS: &str = r"(() => {
    const told = (...counts) => {
        const warnings = counts.map((count, index) => ({ words: `warning ${index}`, count, stands: false, at_s: count ? [3] : [] }));
        showCase({ name: 'A case', task: 'Do it.', ended: null, goals: [], warnings });
        return [...document.querySelectorAll('#warnings li')];
    };
    const [before] = told(0, 1);
    const after = told(2, 1);
    const goal = (state, progress) => {
        const goals = [{ words: 'look', state, called_for: true, called_off: false, progress, at_s: state === 'open' ? null : 4 }];
        showCase({ name: 'A case', task: 'Do it.', ended: null, goals, warnings: [] });
        return document.getElementById('come').textContent;
    };
    const goals = [goal('open', 0.3), goal('open', 0.6), goal('reached', 1), goal('reached', 1)];
    return [after[1] === before, after.map(item => item.textContent), told(0, 0).length, document.querySelectorAll('#goals li').length, goals];
})()";

/// That events which were there before the page are not read aloud, later ones are, of two warnings only the one that is new, and of a goal that it is reached.
fn assert_what_is_read_aloud_is_what_is_new(browser: &mut Browser) {
    let live = "document.getElementById('said').getAttribute('aria-live')";
    browser.wait("that events are read aloud from now on", live, |live| (live == "polite").then_some(()));
    let lines = json!(["warning 0 (first at 3.0 s, 2 times)", "warning 1 (first at 3.0 s)"]);
    let goals = json!(["", "", "look: reached at 4.0 s", "look: reached at 4.0 s"]);
    assert_eq!(browser.evaluate(WARNINGS), Some(json!([true, lines, 0, 0, goals])));
}

/// Which fields the form of the faults has by kind, and whom it names: one that was chosen and cannot be meant any more leaves nobody, so that nothing is sent.
/// Then what the page says of a fault that is judged, and of one that is not.
const FAULTS: &str = r"(() => {
    const [kind, target] = ['fault-kind', 'fault-target'].map(id => document.getElementById(id));
    const choose = name => {
        kind.value = name;
        kind.dispatchEvent(new Event('change'));
        return [['for', 'factor', 'where'].filter(option => document.getElementById(`fault-${option}`).checkVisibility()), target.value];
    };
    target.value = 'haptic:active';
    const forms = ['kill', 'corrupt', 'disk-full', 'slow'].map(choose), isValid = target.checkValidity();
    choose('kill');
    target.value = 'haptic:active';
    const judged = { kind: 'kill', target: 'tissue:1', active: true, tick: 12345, manifested: true, detected_by: 'pidfd', detected_us: 310,
        recovered_us: 211000, promise_held: true, window: { ticks: 232, missed: 0 }, control: { ticks: 232, missed: 1 } };
    const fresh = { kind: 'external', target: 'recorder', active: false, tick: 20, manifested: false, detected_us: null, recovered_us: null,
        promise_held: null, window: null, control: null };
    const hit = hitBy({ victims: [{ process: 'recorder', incarnation: 3, pid: 9 }], tick: 1500, phase_us: 1 });
    const idle = hitBy({ victims: [{ process: 'tissue:1', incarnation: 4, pid: 8 }], tick: 2000, phase_us: 1, caution: 'it is a spare' });
    const outcomes = [judged, { ...judged, promise_held: false }, fresh].map(outcomeOf);
    return { forms, isValid, outcomes, hits: [hit, idle, hitBy({})] };
})()";

/// That a tester is offered what can be, and reads what came of it.
fn assert_faults_are_asked_for_as_they_can_be_and_told_of(browser: &mut Browser) {
    let told = browser.evaluate(FAULTS).expect("the form of the faults");
    let (hit, nobody) = ("haptic:active", "");
    assert_eq!(told["forms"], json!([[[], hit], [["where"], hit], [["for"], nobody], [["for", "factor"], nobody]]));
    assert_eq!(told["isValid"], false, "nobody is chosen: {told}");
    let judged = "12.345 s, kill: tissue:1, at work – found by pidfd after 0.3 ms; over after 211 ms; 0 of 232 ticks without a fresh \
                  force, 1 in its control; ";
    let [held, broken] = ["the promise held", "THE PROMISE IS BROKEN"].map(|verdict| format!("{judged}{verdict}"));
    let fresh = "0.020 s, from outside: recorder – not shown so far; found by nobody so far; not over yet; no verdict yet";
    assert_eq!(told["outcomes"], json!([[held, "good"], [broken, "bad"], [fresh, ""]]));
    let [hit, idle] = ["recorder (life 3, pid 9) at 1.500 s", "tissue:1 (life 4, pid 8) at 2.000 s (it is a spare)"];
    assert_eq!(told["hits"], json!([format!("Done to {hit}"), format!("Done to {idle}"), "Done"]));
}
