//! What of the page stands still: its rows while figures come and go, and its pictures for who is ill of motion; and that what nobody knows is no figure.

use crate::glance::set_screen;
use serde_json::{Value, json};
use station_tests::browser::Browser;

/// Screens on which units stand below their figures, CSS pixels: what a laptop's screen is when it is enlarged four times, phones, half a
/// screen, a projector, and what is just no laptop's any more.
const NARROW: [[u64; 2]; 6] = [[320, 256], [360, 740], [390, 844], [870, 800], [1024, 768], [1270, 800]];
/// How long a picture stands at least where less motion is asked for, ms; a page's clock is no finer than a tenth of one.
const LEAST_STAND_MS: f64 = 1_999.0;
/// Askings for a picture that are looked at.
const LEAST_ASKED: usize = 4;

/// How high the pump's figures are, CSS pixels, and which of their units is of two lines: with short figures, with long ones and both
/// valves shut, and with none.
const ROWS: &str = r"(() => {
    const list = document.querySelector('section[aria-labelledby=pump-title] dl');
    const limit = document.getElementById('pump-deficit-limit');
    const steps = { step_ms: 1, scene_step_ms: 1, halvings: 0 };
    const few = { pressure_mmhg: 7, set_mmhg: 70, inflow_ml_min: 8, outflow_ml_min: 0, shut: [false, false], deficit_ml: 2,
        cavity_ml: 1.2, bled_ml: 0, transmittance: 0.04, open_vessels: 0, sealed_vessels: 0, ...steps };
    const many = { pressure_mmhg: 137, set_mmhg: 150, inflow_ml_min: 812, outflow_ml_min: 799, shut: [true, true], deficit_ml: -2499,
        cavity_ml: 12.3, bled_ml: 123.4, transmittance: 1, open_vessels: 12, sealed_vessels: 120, ...steps };
    const before = limit.textContent;
    limit.textContent = ', at most 2500';
    const high = pump => {
        showPump(pump);
        const isLong = unit => unit.getBoundingClientRect().height > 1.9 * parseFloat(getComputedStyle(unit).fontSize);
        return [list.getBoundingClientRect().height, [...list.querySelectorAll('small')].filter(isLong).map(unit => unit.textContent)];
    };
    const [short, long, none] = [few, many, null].map(high);
    limit.textContent = before;
    return { heights: [short[0], long[0], none[0]], long: [...short[1], ...long[1], ...none[1]] };
})()";

/// The age that the page tells of a process that does its role's work, and of one that is a spare; and how it is read that no fluid says anything.
const UNKNOWN: &str = r"(() => {
    const age = state => {
        showProcesses(said.processes.map(process => process.name === 'fluid:1' ? { ...process, state, age_ms: 9680.5 } : process));
        return document.querySelector('#process-fluid-1 td.age span').textContent;
    };
    return [age('live'), age('spare'), document.getElementById('pump-unknown').getAttribute('role')];
})()";

/// How many lines the plots of a process have: of its rate, its wake-ups and its loop.
const PLOTS: &str =
    "[...document.querySelectorAll('#process-device svg.plot')].map(plot => plot.querySelectorAll('polyline').length)";

/// Notes when the page asks for pictures; gives what it says of them.
const CALM: &str = r"(() => {
    const usual = window.fetch;
    window.picturesAsked = [];
    window.fetch = (path, how) => {
        if (String(path).startsWith('/picture.jpg')) picturesAsked.push(performance.now());
        return usual.call(window, path, how);
    };
    showPicturing({ period_s: 0.04, scale: 1, size_px: [640, 480] }, [{ name: 'rendering', rate_hz: 25 }]);
    return [calm.matches, document.getElementById('pictures').textContent];
})()";

/// All of this, of a page that has shown a station's processes.
pub fn assert_steady(browser: &mut Browser) {
    for screen in NARROW {
        set_screen(browser, screen);
        let rows = browser.evaluate(ROWS).expect("how high the rows are");
        let heights = &rows["heights"];
        assert!(
            heights[0].as_f64() > Some(0.0) && heights[0] == heights[1] && heights[0] == heights[2],
            "rows that jump at {screen:?}: {rows}"
        );
        assert_eq!(rows["long"], json!([]), "units of two lines at {screen:?}");
    }
    let are_drawn = |plots: &Value| {
        plots.as_array()?.iter().all(|lines| lines.as_u64() >= Some(1)).then(|| plots.as_array().map_or(0, Vec::len))
    };
    assert_eq!(browser.wait("a line in each plot of the device", PLOTS, are_drawn), 3);
    assert_eq!(browser.evaluate(UNKNOWN), Some(json!(["9680.5", "–", "status"])));
    assert_less_motion_is_heeded(browser);
}

/// That a live view which whoever is ill of motion cannot look away from is a series of stills.
fn assert_less_motion_is_heeded(browser: &mut Browser) {
    let less = json!([{ "name": "prefers-reduced-motion", "value": "reduce" }]);
    browser.ask("Emulation.setEmulatedMedia", json!({ "media": "screen", "features": less }));
    let words = "25.0 pictures a second of 25 that it aims at, drawn at 640 × 480. One in two seconds is shown, for this browser asks for less motion.";
    assert_eq!(browser.evaluate(CALM), Some(json!([true, words])));
    let asked = browser.wait("that pictures are asked for", "picturesAsked", |asked| {
        let asked: Vec<f64> = asked.as_array()?.iter().filter_map(Value::as_f64).collect();
        (asked.len() >= LEAST_ASKED).then_some(asked)
    });
    assert!(asked.windows(2).all(|two| two[1] - two[0] >= LEAST_STAND_MS), "a picture stands for too short: {asked:?} ms");
    browser.ask("Emulation.setEmulatedMedia", json!({ "media": "screen", "features": [] }));
}
