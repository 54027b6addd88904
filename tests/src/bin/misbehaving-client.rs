//! A client that no station should have to suffer: it runs at the lowest priority there is, asks the tissue for the objects' appearance again and
//! again without waiting for the answer, and does not end before it is killed. `misbehaving-client STATION`; it says `answered` once it was.

use hyst_exchange::rendezvous::Client;
use hyst_exchange::{Links, Roster, Station, system};
use hyst_messages::{Kind, Role};

/// It gives up by itself if nobody kills it, ns.
const LIFE_NS: u64 = 120_000_000_000;
/// Requests between two looks for an answer: most are overwritten unread.
const FLOOD: usize = 50;

fn main() {
    let name = std::env::args().nth(1).expect("the name of a station");
    let end_ns = system::now_ns() + LIFE_NS;
    system::demote(0); // refused without rights: then it is only ordinary
    let station = Station::named(&name).expect("a name");
    let links = Links::join(&station, "misbehaving-client").expect("the station's link");
    let roster = Roster::open(&station).expect("the roster");
    let mut said = false;
    while system::now_ns() < end_ns {
        let holder = roster.holder(Role::Tissue).incarnation;
        let Ok(mut client) = links.client(Role::Tissue, holder, Kind::Appearance) else { continue };
        while system::now_ns() < end_ns && roster.holder(Role::Tissue).incarnation == holder {
            for _ in 0..FLOOD {
                let _ = client.begin(b"appearance"); // a server that has gone is asked no more
            }
            if matches!(client.poll(), Ok(Some(_))) && !std::mem::replace(&mut said, true) {
                println!("answered");
            }
        }
    }
}
