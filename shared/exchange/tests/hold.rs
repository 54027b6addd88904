//! What a supervisor that was restarted relies on: services that it holds live on without their creator.

use hyst_exchange::{Links, Station};
use hyst_messages::{Kind, Role};

#[test]
fn a_service_that_is_held_outlives_its_creator_and_one_that_is_not_there_cannot_be_held() {
    let station = Station::named(&format!("t{}-hold", std::process::id())).unwrap();
    station.wipe();
    station.found().unwrap();
    {
        let links = Links::join(&station, "creator").unwrap();
        assert!(links.hold_service(Role::Fluid, 3, Kind::FluidState).is_err());
        assert!(links.hold_rendezvous(Role::Tissue, 3, Kind::Appearance).is_err());
        let created = links.create_service(Role::Fluid, 3, Kind::FluidState).unwrap();
        let rendezvous = links.create_rendezvous(Role::Tissue, 3, Kind::Appearance).unwrap();
        let held = links.hold_service(Role::Fluid, 3, Kind::FluidState).unwrap();
        let held_rendezvous = links.hold_rendezvous(Role::Tissue, 3, Kind::Appearance).unwrap();
        drop((created, rendezvous));
        assert!(links.publisher(Role::Fluid, 3, Kind::FluidState, 64).is_ok(), "the successor's hold is enough");
        assert!(links.server(Role::Tissue, 3, Kind::Appearance).is_ok());
        drop((held, held_rendezvous));
        assert!(links.publisher(Role::Fluid, 3, Kind::FluidState, 64).is_err(), "and without it the service is gone");
    }
    station.wipe();
}
