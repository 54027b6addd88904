//! What becomes of the pictures where something is missing that they need: a driver, a display, or a display that was there. One line says it, the best that
//! is left is shown, and the hand feels none of it.

use hyst_messages::{Role, Slot, page::rendering::STATUS};
use station_tests::display::Display;
use station_tests::windows::Pairs;
use station_tests::{Ended, RECOVERY_LIMIT, Station, wait_for};

/// Takes the driver away from whoever looks for one.
const NO_DRIVER: [&str; 3] = ["env", "VK_DRIVER_FILES=/nowhere", "VK_ICD_FILENAMES=/nowhere"];
/// A display that nobody has.
const NOWHERE: &str = ":4711";
/// Ticks of a window, with and without what happens to the pictures.
const WINDOW_TICKS: u64 = 1_500;
/// Renderings that die where none can draw.
const DEATHS: usize = 3;
/// Pictures after which they come.
const PICTURES: u64 = 5;
/// Force that is felt, N.
const FELT_N: f64 = 0.05;

/// What all of a station's renderings have said.
fn log(station: &Station) -> String {
    std::fs::read_to_string(station.place().log(Slot::first(Role::Rendering))).unwrap_or_default()
}

/// The lines in which renderings have said something. None says it twice, and none panics.
fn said_once(station: &Station, what: &str) -> Vec<String> {
    let log = log(station);
    let of_life = |life: &str| life.lines().filter(|line| line.contains(what)).map(str::to_string).collect::<Vec<_>>();
    let lives: Vec<Vec<String>> = log.split("-- incarnation ").map(of_life).collect();
    assert!(lives.iter().all(|lines| lines.len() <= 1) && !log.contains("panicked"), "{log}");
    lives.concat()
}

/// Waits until a rendering has said something, and gives the line.
fn wait_for_line(station: &Station, what: &str) -> String {
    let line = wait_for(RECOVERY_LIMIT, || said_once(station, what).pop());
    line.unwrap_or_else(|| panic!("no line says {what:?}:\n{}\n{}", log(station), station.said()))
}

/// Incarnation of the rendering that there is, and the pictures that it has drawn.
fn drawn(station: &Station) -> Option<(u32, u64)> {
    let slot = Slot::first(Role::Rendering);
    let incarnation = station.clock().incarnation(slot);
    let page = station.place().read_slot(slot, incarnation).ok()?;
    Some((incarnation, page.cell(STATUS)?.1.frames))
}

/// Waits until more pictures were drawn from now on, by whomever.
fn wait_for_pictures(station: &Station) {
    let before = drawn(station).unwrap_or_default();
    let come = || {
        let (incarnation, count) = drawn(station)?;
        let of_before = if incarnation == before.0 { before.1 } else { 0 };
        (count >= of_before + PICTURES).then_some(())
    };
    assert!(wait_for(RECOVERY_LIMIT, come).is_some(), "no pictures:\n{}\n{}", log(station), station.said());
}

/// The hand was felt with until the end, and nobody was given up or held for it.
fn assert_well(station: Station) -> Ended {
    let felt = wait_for(RECOVERY_LIMIT, || (station.force_n() > FELT_N).then_some(()));
    assert!(felt.is_some(), "the hand feels nothing\n{}", station.said());
    station.recover();
    station.run_ticks(WINDOW_TICKS);
    let ended = station.stop();
    ended.assert_clean();
    ended.assert_recorded();
    assert_ne!(ended.code, Some(3), "{}", ended.said);
    ended
}

#[test]
fn without_a_driver_each_rendering_says_so_in_one_line_lives_without_pictures_and_costs_the_hand_nothing() {
    let station = Station::start_under(&NO_DRIVER, "undrawn", &["--hand", "script:press"]);
    let line = wait_for_line(&station, "no Vulkan adapter found");
    assert!(line.contains("install mesa-vulkan-drivers") && line.ends_with("; the station goes on without pictures"), "{line}");
    assert_eq!(drawn(&station).map(|(_, count)| count), Some(0), "{}", log(&station));
    let mut pairs = Pairs::default();
    for _ in 0..DEATHS {
        pairs.around(&station, WINDOW_TICKS, || {
            station.kill("rendering", true);
            station.run_ticks(WINDOW_TICKS);
        });
    }
    pairs.judge("renderings without a driver that die and come again", DEATHS, &station);
    let lines = said_once(&station, "no Vulkan adapter found");
    assert!(lines.len() > DEATHS, "each says it: {lines:#?}");
    let ended = assert_well(station);
    assert!(ended.died_unasked().len() >= DEATHS, "{}", ended.said);
}

#[test]
fn without_a_display_or_with_one_that_is_not_there_one_line_says_so_and_pictures_are_drawn_all_the_same() {
    let is_drawn = std::env::var_os("HYSTATION_NO_GPU").is_none();
    let of_none = "there is no display: the station runs headless";
    let gone = ["env", "-u", "DISPLAY", "-u", "WAYLAND_DISPLAY"];
    let station = Station::start_facing(&gone, "undisplayed", &["--hand", "script:press"]);
    let told = wait_for(RECOVERY_LIMIT, || station.said().contains(of_none).then_some(()));
    assert!(told.is_some(), "{}", station.said());
    assert_eq!(station.said().matches("headless").count(), 1, "{}", station.said());
    assert_eq!(said_once(&station, "headless").len(), 0, "it is said already:\n{}", log(&station));
    if is_drawn {
        wait_for_pictures(&station);
    }
    assert_well(station);

    let station = Station::start_shown(NOWHERE, "nowhere", &["--hand", "script:press"]);
    let line = wait_for_line(&station, "no display (");
    assert!(line.contains("set DISPLAY to a running X server") && line.ends_with("; headless"), "{line}");
    assert!(!station.said().contains(of_none), "{}", station.said());
    if is_drawn {
        wait_for_pictures(&station);
    }
    assert_well(station);
}

/// Whether rendering finds that out by itself or Xlib ends it for that (`window.rs`), the station shows what it can to whom else looks.
#[test]
fn a_display_that_goes_away_is_said_in_one_line_and_pictures_come_again_and_the_hand_does_not_feel_it() {
    let Some(mut display) = Display::start() else { return };
    let station = Station::start_shown(&display.name, "deserted", &["--hand", "script:press"]);
    display.window(&station);
    assert!(said_once(&station, "headless").is_empty(), "{}", log(&station));
    let (before, rendering) = (station.census(), station.pid("rendering", true));
    let mut pairs = Pairs::default();
    let line = pairs.around(&station, WINDOW_TICKS, || {
        display.end();
        let line = wait_for_line(&station, "headless");
        wait_for_pictures(&station);
        station.run_ticks(WINDOW_TICKS);
        line
    });
    assert!(line.ends_with("; headless"), "{line}");
    pairs.judge("a display that goes away", 1, &station);
    before.assert_untouched(&station, "a display that goes away", &[rendering]);
    assert_well(station);
}
