//! Many lives leave nothing: no files in /dev/shm, no file descriptors.

use crate::support::*;
use hyst_exchange::rendezvous::Client;
use hyst_exchange::{Links, Station};
use hyst_messages::{Kind, Role};
use std::path::Path;

const CYCLES: u32 = 50;
/// Lives after which everything that is made once has been made.
const WARM_UP: u32 = 3;

fn files_below(path: &Path) -> usize {
    let Ok(entries) = std::fs::read_dir(path) else { return 1 };
    entries.flatten().map(|entry| if entry.path().is_dir() { files_below(&entry.path()) } else { 1 }).sum()
}

fn files(station: &Station) -> usize {
    station.leftovers().iter().map(|path| files_below(path)).sum()
}

/// One life of a tissue with a stream, a rendezvous, a reader and a client, all of which are killed.
fn life(station: &Station, links: &Links, incarnation: u32, fate: &str) {
    let _services = (
        links.create_service(Role::Tissue, incarnation, Kind::TissueState).unwrap(),
        links.create_rendezvous(Role::Tissue, incarnation, Kind::Appearance).unwrap(),
    );
    let page = station.slot_page(slot(Role::Tissue), incarnation);
    drop(station.create_slot(slot(Role::Tissue), incarnation).unwrap());
    let subscriber = links.subscriber(Role::Tissue, incarnation, Kind::TissueState).unwrap();
    let mut writer = Partner::start(station, "publish", incarnation, fate, 0);
    let mut reader = Partner::start(station, "hold", incarnation, "live", 0);
    let mut server = Partner::start(station, "serve", incarnation, "kill@in-answer", 0);
    for partner in [&mut writer, &mut reader, &mut server] {
        partner.expect("open");
    }
    let mut client = links.client(Role::Tissue, incarnation, Kind::Appearance).unwrap();
    client.begin(b"asked").unwrap();
    writer.tell("send");
    writer.expect("sent 1");
    reader.tell("take");
    reader.expect("holding 1");
    let held = subscriber.newest().unwrap().expect("the first message");
    server.tell("wait");
    writer.tell("send");
    reader.kill();
    writer.await_death();
    server.await_death();
    links.clean_up_dead();
    assert_eq!(held.bytes()[0], 1);
    std::fs::remove_file(page).unwrap();
}

#[test]
fn fifty_lives_ended_by_a_kill_leak_neither_files_nor_descriptors() {
    isolated(fifty_lives_ended_by_a_kill_leak_neither_files_nor_descriptors, |station| {
        let links = Links::join(station, "supervisor").unwrap();
        let fates = ["kill@before-loan:2", "kill@in-loan:2", "abort@before-send:2", "kill@after-send:2"];
        let count = || (files(station), std::fs::read_dir("/proc/self/fd").unwrap().count());
        let mut warm = (0, 0);
        for incarnation in 1..=WARM_UP + CYCLES {
            life(station, &links, incarnation, fates[incarnation as usize % fates.len()]);
            if incarnation == WARM_UP {
                warm = count();
            }
        }
        assert_eq!(count(), warm, "(files of the station, descriptors) after {CYCLES} lives more");
    });
}

#[test]
fn the_clean_up_removes_what_a_dead_process_left_and_nothing_of_the_living() {
    isolated(the_clean_up_removes_what_a_dead_process_left_and_nothing_of_the_living, |station| {
        let links = Links::join(station, "supervisor").unwrap();
        let _services = [1, 2].map(|incarnation| links.create_service(Role::Tissue, incarnation, Kind::TissueState).unwrap());
        let mut living = Partner::start(station, "publish", 2, "live", 0);
        living.expect("open");
        let before = files(station);
        let mut mortal = Partner::start(station, "publish", 1, "kill@in-loan", 0);
        mortal.expect("open");
        assert!(files(station) > before);
        mortal.tell("send");
        mortal.await_death();
        links.clean_up_dead();
        assert_eq!(files(station), before);
        let subscriber = links.subscriber(Role::Tissue, 2, Kind::TissueState).unwrap();
        subscriber.connect().unwrap();
        living.tell("send");
        living.expect("sent 1");
        assert!(subscriber.newest().unwrap().is_some());
    });
}
