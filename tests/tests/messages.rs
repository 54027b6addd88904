//! What engines say to each other is what docs/messages.md says: whoever reads the streams of a station that works finds the sections in them that are stated.

use hyst_exchange::Links;
use hyst_messages::{Kind, Role, contents};
use station_tests::{RECOVERY_LIMIT, Station, wait_for};

/// The streams that are there at any time. A job and its answers come when the workers are asked, which is not on each machine; a picture, when somebody looks.
const STREAMS: [(Role, Kind); 4] = [
    (Role::Tissue, Kind::TissueState),
    (Role::Tissue, Kind::Topology),
    (Role::Fluid, Kind::FluidState),
    (Role::Haptic, Kind::Force),
];

/// Reads one message of each stream.
fn read(name: &str) {
    let station = hyst_exchange::Station::named(name).expect("a name");
    let page = station.open().expect("the station's page");
    let links = Links::join(&station, "messages").expect("the station's link");
    for (role, kind) in STREAMS {
        let (_, incarnation) = page.occupied(role).next().expect("somebody of the role");
        let reader = links.subscriber(role, incarnation, kind).expect("its stream");
        let newest = || {
            reader.connect().ok()?;
            reader.newest().ok()?
        };
        let held = wait_for(RECOVERY_LIMIT, newest).unwrap_or_else(|| panic!("no {kind:?} has come"));
        assert_eq!(contents::check(held.bytes(), kind), Ok(()), "{kind:?}");
    }
}

#[test]
fn each_stream_of_a_station_holds_the_sections_that_the_document_says() {
    let station = Station::start("messages", &["--hand", "script:press"]);
    read(station.name());
    station.stop().assert_clean();
}
