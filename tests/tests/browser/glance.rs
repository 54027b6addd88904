//! What an operator takes from the page at a glance, and what it may not leave to be guessed: each asked of the page's own functions, while a station runs.

use serde_json::{Value, json};
use station_tests::browser::Browser;

/// What the page says of its connection, and whether a state still stands there in green: before it has heard anything, when it has, and of an address that has
/// become another station's.
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
    isLost = false;
    return { said: [before, connected, stranger].map(three => three.slice(0, 2)), isGreen: connected[2] !== stranger[2], after: told()[1] };
})()";

/// That nothing is called connected before it is, and that a page of a station that has ended says so, and shows nobody as well.
pub fn assert_connection_is_what_is_said(browser: &mut Browser) {
    let told = browser.evaluate(LINK).expect("what is said of the connection");
    let lost = "The station of this page has ended, and another one has its address";
    let said = json!([["connecting", false], ["connected", false], ["connection lost, trying again", lost]]);
    assert_eq!((&told["said"], &told["isGreen"], &told["after"]), (&said, &Value::Bool(true), &Value::Bool(false)), "{told}");
}
