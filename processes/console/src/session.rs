//! The whole life of the console, on one thread: twenty times a second what happened, the pump, the case, the newest picture; between that, browsers. So a
//! console that beats also answers. Promise: it comes back at the address that it had, and a browser that stalls costs it nothing but a seat.

use crate::desk::{Desk, VERIFIERS};
use crate::door::{Door, SEATS, UNKNOWN, VISIT, Visitors};
use crate::look;
use crate::referee::Referee;
use crate::sources::Sources;
use crate::{ask, web};
use hyst_engine::journal::Journal;
use hyst_engine::{Failure, Life};
use hyst_exchange::system;
use hyst_messages::page::{ProcessState, console as layout, header};
use std::sync::Arc;
use std::time::Duration;
use tokio::time::MissedTickBehavior;

/// Between two looks: an event is shown this soon, and a stop noticed.
const LOOK: Duration = Duration::from_millis(50);

/// The whole life of the console.
pub fn run(life: &Life) -> Result<(), Failure> {
    let door = Door::open(life)?;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().max_blocking_threads(VERIFIERS).build()?;
    let result = runtime.block_on(live(life, door));
    runtime.shutdown_timeout(LOOK); // by then a binary that was being verified is given up, and ended
    result
}

async fn live(life: &Life, door: Door) -> Result<(), Failure> {
    let mut referee = Referee::of(life);
    let mut sources = Sources::open(life, referee.is_some())?;
    let mut journal = Journal::open(&life.station);
    let desk = Arc::new(Desk::new(door.address, life.clock.test_mode(), life.station.clone()));
    // A name that cannot be one is refused where the station is started.
    let trainee = life.settings.trainee().ok().flatten().map(str::to_string);
    desk.introduce(trainee, life.settings.recording().map(|file| file.display().to_string()));
    let visitors = Visitors::welcome(door.listener)?;
    let mut crowd = visitors.crowd();
    tokio::spawn(web::serve(visitors, Arc::clone(&desk)));
    tokio::spawn(ask::follow(Arc::clone(&desk)));
    let mut looks = tokio::time::interval(LOOK);
    looks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    life.page.set_state(ProcessState::Live);
    while !life.clock.stop_requested() && life.clock.incarnation(life.slot) <= life.incarnation {
        looks.tick().await;
        let begun_ns = system::now_ns();
        life.misbehave();
        if crowd.is_news(begun_ns) {
            life.say(&full());
        }
        desk.tell(journal.news());
        sources.helpers.look(life);
        sources.welcome();
        desk.note_pump(sources.pump(life.tick()));
        desk.note_tissue(sources.cutting());
        desk.note_pictures(sources.drawn());
        desk.note_swaps(look::swaps(|role| life.clock.swap(role)));
        desk.tell_look(begun_ns);
        if let Some(told) = referee.as_mut().and_then(|referee| referee.look(&sources)) {
            desk.note_case(&told);
        }
        let until_ns = desk.pictures_until_ns();
        life.page.store64(layout::PICTURES_UNTIL_NS, until_ns);
        if until_ns > begun_ns
            && let Some(picture) = sources.picture(life)
        {
            desk.show(picture);
        }
        life.drag(begun_ns);
        life.heartbeat();
        life.page.store64(header::VALUE_NS, system::now_ns());
        life.page.store64(header::TICK, life.tick());
        life.page.add64(header::STEPS, 1);
    }
    desk.verifying().close();
    if life.clock.stop_requested() {
        desk.end();
        tokio::time::sleep(LOOK).await; // meanwhile it goes out to the browsers
    }
    Ok(())
}

/// What is said when more browsers come than there are seats: they stall, or somebody opens connections and says nothing.
fn full() -> String {
    let [visit_s, unknown_s] = [VISIT, UNKNOWN].map(|time| time.as_secs());
    format!(
        "all {SEATS} seats of the operator's page are taken: who comes waits until one is free, after {visit_s} s at most, \
         or {unknown_s} s where the token was not shown"
    )
}
