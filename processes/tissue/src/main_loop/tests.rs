//! Promise of the Main Loop: a state and a job are written in full, so that what an older message left in the loan is nowhere in them.

#[path = "../../../../shared/engine/tests/support/loans.rs"]
mod loans;

use super::*;
use hyst_exchange::Station;
use hyst_exchange::roster::Tenure;
use hyst_exchange::usher::usher;
use hyst_messages::Slot;
use loans::{LEFT, written};

const STEPS: u64 = 12;

fn context(tick: u64) -> StepContext {
    StepContext {
        tick,
        next_tick: tick + 1,
        state_epoch: 1,
        state_writer: 1,
        step_ticks: 1,
        tenure: Tenure { epoch: 1, incarnation: 1 },
        holding: true,
        deadline_ns: 0,
    }
}

/// A job is written into a loan of its own, so the pattern is put into the publisher's loans.
fn job(main: &mut MainLoop<'_>, left: u64) -> Vec<u8> {
    let fill = |bytes: &mut [u8]| bytes.fill(left as u8);
    main.collision.fill_loans(main.points_m.len(), fill);
    let (points_m, owner, cell_m) = (main.points_m.clone(), main.owner.clone(), main.world.cell_m);
    let job = main.collision.hash(&context(1), &points_m, &owner, cell_m).unwrap();
    job.bytes().expect("a job for the worker that is seated").to_vec()
}

#[test]
fn states_and_jobs_have_the_same_bytes_whatever_lay_in_the_loan() {
    let station = Station::named(&format!("t{}-tissue-loans", std::process::id())).unwrap();
    station.wipe();
    station.found().unwrap();
    std::fs::write(station.settings(), "workers = 1\n[set]\ntissue_step_ticks = \"1\"\n").unwrap();
    let [tissue, device, worker] = [Role::Tissue, Role::Device, Role::CollisionWorker].map(Slot::first);
    let pages = [tissue, device, worker].map(|slot| station.create_slot(slot, 1).unwrap());
    let page_of = |slot| Arrival { slot, incarnation: 1, port: Port::Page(station.read_slot(slot, 1).unwrap()) };
    let life = Life::begin(station.name(), tissue, 1).unwrap();
    let links = Links::join(&station, "loans").unwrap();
    let _service = links.create_service(Role::Tissue, 1, Kind::CollisionJob).unwrap();
    let mut inbox = usher(&station, None, 1, Vec::new()).unwrap();
    let mut main = MainLoop::new(&life, World::load(&life).unwrap()).unwrap();
    main.arrival(page_of(device), &mut inbox);
    let bytes = main.message_bytes();

    let mut now = written(bytes, "the first state", |block| main.initial(StreamHeader::default(), block).unwrap());
    // The tip goes into the wall, so that contacts, memory and planes are part of the states.
    let surface: Vec<[f32; 3]> =
        Message::parse(bytemuck::cast_slice(&now), Kind::TissueState).unwrap().section(3).unwrap().to_vec();
    let mut contacts = 0;
    for tick in 1..=STEPS {
        let mut record = InputRecord { tick, ..InputRecord::default() };
        record.sample.pose = Pose { position_m: surface[0], ..main.first_core().pose };
        pages[1].push(device::INPUTS, tick, &record);
        let before: Vec<u64> = now.clone();
        let before: &[u8] = bytemuck::cast_slice(&before);
        let step = |block: &mut [u8]| main.step(&context(tick + 1), &before[..bytes], block).unwrap();
        now = written(bytes, &format!("state {tick}"), step);
        contacts += main.status.contact_count;
    }
    assert!(contacts > 0, "the tool touched nothing: the memory of its points was not looked at");

    main.collision.open(&life, &links, main.points_m.len()).unwrap();
    main.arrival(page_of(worker), &mut inbox);
    let jobs = LEFT.map(|left| job(&mut main, left));
    assert!(jobs[0] == jobs[1] && jobs[0] == jobs[2], "a job depends on what lay in the loan");
    drop((main, links, inbox));
    station.wipe();
}
