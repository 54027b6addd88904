//! Promise of the Main Loop: a state and a job are written in full, so that what an older message left in the loan is nowhere in them.

mod apart;
mod blind;
mod closing;
mod cold;
mod corrections;
mod fold;
mod grasp;
mod grip;
mod held;
mod lattice;
mod leaves;
mod lent;
mod limits;
mod medium;
mod momentum;
mod outflow;
mod pieces;
mod remembers;
mod removed;
mod rubs;
mod sheet;
mod slides;
mod thrust;
mod unfit;

#[path = "../../../../shared/engine/tests/support/loans.rs"]
mod loans;

use super::*;
use hyst_exchange::roster::Tenure;
use hyst_exchange::usher::usher;
use hyst_exchange::{OwnedPage, Station};
use hyst_messages::{InputRecord, PieceFlow, Slot, contents};
use loans::{LEFT, written};
use std::ops::Range;

const STEPS: u64 = 12;

/// A station that leaves nothing, however its test ends.
struct Wiped(Station);

impl std::ops::Deref for Wiped {
    type Target = Station;

    fn deref(&self) -> &Station {
        &self.0
    }
}

impl Drop for Wiped {
    fn drop(&mut self) {
        self.0.wipe();
    }
}

/// A station with steps of one tick, and the pages of a tissue, a device and a worker.
fn founded(name: &str, settings: &str) -> (Wiped, [OwnedPage; 3]) {
    founded_with(1, name, settings)
}

/// The same with steps of so many ticks.
fn founded_with(step_ticks: u64, name: &str, settings: &str) -> (Wiped, [OwnedPage; 3]) {
    let station = Station::named(&format!("t{}-tissue-{name}", std::process::id())).unwrap();
    station.wipe();
    station.found().unwrap();
    std::fs::write(station.settings(), format!("{settings}\n[set]\ntissue_step_ticks = \"{step_ticks}\"\n")).unwrap();
    let roles = [Role::Tissue, Role::Device, Role::CollisionWorker];
    let pages = roles.map(|role| station.create_slot(Slot::first(role), 1).unwrap());
    (Wiped(station), pages)
}

/// One with steps of one tick and without workers, and what an engine of it has beside the pages: a life, and an inbox.
fn begun(name: &str) -> (Wiped, [OwnedPage; 3], Life, Inbox) {
    begun_with(1, name, "workers = 0")
}

/// The same with steps of so many ticks and other settings.
fn begun_with(step_ticks: u64, name: &str, settings: &str) -> (Wiped, [OwnedPage; 3], Life, Inbox) {
    let (station, pages) = founded_with(step_ticks, name, settings);
    let life = Life::begin(station.name(), Slot::first(Role::Tissue), 1).unwrap();
    let inbox = usher(&station, None, 1, Vec::new()).unwrap();
    (station, pages, life, inbox)
}

fn page_of(station: &Station, role: Role) -> Arrival {
    let slot = Slot::first(role);
    Arrival { slot, incarnation: 1, port: Port::Page(station.read_slot(slot, 1).unwrap()) }
}

/// An engine that has the device's page.
fn engine<'a>(station: &Station, life: &'a Life, inbox: &mut Inbox) -> MainLoop<'a> {
    let (workshop, world) = Workshop::load(life).unwrap();
    let mut main = MainLoop::new(life, workshop, world).unwrap();
    main.arrival(page_of(station, Role::Device), inbox);
    main
}

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

/// The scene's first state.
fn first_state(main: &mut MainLoop<'_>) -> Vec<u64> {
    let mut now = vec![0u64; main.message_bytes() / 8];
    main.initial(StreamHeader::default(), bytemuck::cast_slice_mut(&mut now)).unwrap();
    now
}

/// The state after a tick in which the tool is at a pose, the medium as the engine rests in it, and the flow at pieces is as it is said.
fn stepped(main: &mut MainLoop<'_>, device: &OwnedPage, now: &[u64], tick: u64, pose: Pose, flow: PieceFlow) -> Vec<u64> {
    let mut record = InputRecord { tick, pressure_pa: main.world.case.rest_pressure_pa, ..InputRecord::default() };
    (record.sample.pose, record.pieces[0]) = (pose, flow);
    fed(main, device, now, &record)
}

/// Whether a step begins in the tick after that of an input: of steps of several ticks nobody reads the inputs of those between.
fn is_read(main: &MainLoop<'_>, input_tick: u64) -> bool {
    (input_tick + 1).is_multiple_of(main.step_ticks())
}

/// The state after the step that begins in the tick after that of an input.
fn fed(main: &mut MainLoop<'_>, device: &OwnedPage, now: &[u64], record: &InputRecord) -> Vec<u64> {
    device.push(device::INPUTS, record.tick, record);
    // The states of these tests have no ticks, by which the engine would look for the input.
    let may_cut = record.sample.controls.buttons & BUTTON_ENERGIZED != 0;
    let bytes = if may_cut { main.message_bytes() } else { main.next_bytes(bytemuck::cast_slice(now)) };
    let mut next = vec![0u64; bytes / 8];
    let (of_one_tick, step_ticks) = (context(record.tick + 1), main.step_ticks());
    let context = StepContext { next_tick: of_one_tick.tick + step_ticks, step_ticks, ..of_one_tick };
    main.step(&context, bytemuck::cast_slice(now), bytemuck::cast_slice_mut(&mut next)).unwrap();
    next
}

/// What a state says beside its nodes.
fn core_of(now: &[u64]) -> Core {
    Message::parse(bytemuck::cast_slice(now), Kind::TissueState).unwrap().record(0).unwrap()
}

/// Largest displacement from rest, m.
fn displaced_m(main: &MainLoop<'_>, now: &[u64]) -> f32 {
    let away_m = |(now, rest): (&[f32; 3], &[f32; 3])| (0..3).map(|axis| (now[axis] - rest[axis]).powi(2)).sum::<f32>().sqrt();
    positions(now).iter().zip(main.world.model.rest_m()).map(away_m).fold(0.0, f32::max)
}

/// Where the nodes of a state are, m.
fn positions(now: &[u64]) -> &[[f32; 3]] {
    Message::parse(bytemuck::cast_slice(now), Kind::TissueState).unwrap().section(1).unwrap()
}

/// Which of some points lie in the first object, by brute force.
fn in_organ(world: &World, positions_m: &[[f32; 3]], points_m: &[[f32; 3]]) -> std::collections::BTreeSet<u32> {
    let rest = &world.body.rest;
    let organ: Vec<[u32; 4]> = rest.tets.iter().zip(&rest.regions).filter(|(_, of)| **of == 0).map(|(tet, _)| *tet).collect();
    let tissue = hyst_contact::Tissue { positions_m, tets: &organ, tet_owner: &vec![0; organ.len()] };
    let of_points = hyst_contact::Points { owner: &vec![1; points_m.len()], node: &[], own: None };
    let mut hits = vec![hyst_contact::Hit::default(); 4 * points_m.len()];
    let found = hyst_contact::intersect_brute(points_m, &of_points, &tissue, &mut hits).unwrap();
    hits[..found.count].iter().map(|hit| hit.point).collect()
}

/// A job is written into a loan of its own, so the pattern is put into the publisher's loans.
fn job(main: &mut MainLoop<'_>, left: u64) -> Vec<u8> {
    let fill = |bytes: &mut [u8]| bytes.fill(left as u8);
    main.collision.fill_loans(main.points_m.len(), fill);
    let (points_m, world) = (main.points_m.clone(), Arc::clone(&main.world));
    let job = main.collision.hash(&context(1), &points_m, &world.points, world.case.cell_m).unwrap();
    job.bytes().expect("a job for the worker that is seated").to_vec()
}

#[test]
fn states_and_jobs_have_the_same_bytes_whatever_lay_in_the_loan() {
    let (station, pages) = founded("loans", "workers = 1");
    let life = Life::begin(station.name(), Slot::first(Role::Tissue), 1).unwrap();
    let links = Links::join(&station, "loans").unwrap();
    let _service = links.create_service(Role::Tissue, 1, Kind::CollisionJob).unwrap();
    let mut inbox = usher(&station, None, 1, Vec::new()).unwrap();
    let mut main = engine(&station, &life, &mut inbox);
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
    assert_eq!(contents::check(bytemuck::cast_slice(&now), Kind::TissueState), Ok(()), "as docs/messages.md says");

    let world = Arc::clone(&main.world);
    main.collision.open(&life, &links, &world).unwrap();
    main.arrival(page_of(&station, Role::CollisionWorker), &mut inbox);
    let jobs = LEFT.map(|left| job(&mut main, left));
    assert!(jobs[0] == jobs[1] && jobs[0] == jobs[2], "a job depends on what lay in the loan");
    assert_eq!(contents::check(&jobs[0], Kind::CollisionJob), Ok(()), "as docs/messages.md says");
    drop((main, links, inbox));
}

/// Bits of a state that the next step depends on.
fn parts_of(state: &[u64]) -> (StreamHeader, Vec<u32>, usize) {
    let message = Message::parse(bytemuck::cast_slice(state), Kind::TissueState).unwrap();
    let words: &[u32] = message.section(crate::state::BODY).unwrap();
    (*message.header(), words.to_vec(), message.section::<u8>(crate::state::STROKE).unwrap().len())
}

/// Steps of the hand that puts the ring through the polyp.
const SWEEP: u64 = 80;

/// The ring goes upwards through the middle of the polyp, with the current on.
fn sweeping(world: &crate::world::World, tick: u64) -> InputRecord {
    const CUTS: u32 = hyst_messages::BUTTON_ENERGIZED | hyst_messages::BUTTON_EXTENDED;
    let (skin, electrode) = (&world.body.skin, world.case.electrode.as_ref().expect("the default instrument has a loop"));
    let is_polyp =
        |vertex: &usize| world.case.is_pathology(&world.body, world.body.rest.regions[skin.bindings[*vertex].tet as usize]);
    let polyp = (0..skin.rest_m.len()).filter(is_polyp).map(|vertex| skin.rest_m[vertex]);
    let bounds = |pick: fn(f32, f32) -> f32, start: f32| {
        polyp.clone().fold([start; 3], |so_far, place| std::array::from_fn(|axis| pick(so_far[axis], place[axis])))
    };
    let (low, high) = (bounds(f32::min, f32::MAX), bounds(f32::max, f32::MIN));
    let y = low[1] - electrode.radius_m - 1e-3 + tick as f32 / SWEEP as f32 * (high[1] - low[1] + 2e-3);
    let tip = [(low[0] + high[0]) / 2.0, y, (low[2] + high[2]) / 2.0 - electrode.reach_m];
    let mut record = InputRecord { tick, ..InputRecord::default() };
    record.sample.pose = Pose { position_m: tip, orientation: [0.0, 0.0, 0.0, 1.0], ..Pose::default() };
    record.sample.controls.buttons = CUTS;
    record.sample.controls.loop_extension_m = electrode.reach_m;
    record
}

/// A successor goes on from a state: to the same bits; and it takes no body of which a bit has flipped.
fn succeeds(successor: &mut MainLoop<'_>, tick: u64, before: &[u8], now: &[u64]) {
    assert!(successor.accepts(before), "the state before {tick}");
    let mut next = vec![0u64; now.len()];
    successor.step(&context(tick + 1), before, bytemuck::cast_slice_mut(&mut next)).unwrap();
    assert!(next == now, "the successor's state {tick} is another one");
    assert_eq!(successor.world.words, parts_of(now).1);
    let body: &[u8] = Message::parse(before, Kind::TissueState).unwrap().section(crate::state::BODY).unwrap();
    let mut spoilt = before.to_vec();
    spoilt[body.as_ptr() as usize - before.as_ptr() as usize + 400] ^= 1;
    assert!(!successor.accepts(&spoilt), "a bit of the body flipped at {tick}");
    assert_eq!(successor.why_refused(&spoilt), Refusal::Version);
}

/// Where a section of a state lies, bytes.
fn place_of(state: &[u64], section: usize) -> Range<usize> {
    let bytes: &[u8] = bytemuck::cast_slice(state);
    let part: &[u8] = Message::parse(bytes, Kind::TissueState).unwrap().section(section).unwrap();
    let first = part.as_ptr() as usize - bytes.as_ptr() as usize;
    first..first + part.len()
}

/// A state with another core.
fn with_core(state: &[u64], core: &Core) -> Vec<u64> {
    let (range, mut state) = (place_of(state, 0), state.to_vec());
    let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut state);
    bytes[range].copy_from_slice(bytemuck::bytes_of(core));
    state
}

/// Its maker takes a state that he has just made without reading its body again, and not if a number of it is none.
fn is_taken_by_its_maker(maker: &MainLoop<'_>, tick: u64, now: &[u64]) {
    assert!(maker.accepts(bytemuck::cast_slice(now)) && maker.accepts_own(bytemuck::cast_slice(now)), "state {tick}");
    let spoilt = |section: usize, word: u32| {
        let mut spoilt = now.to_vec();
        bytemuck::cast_slice_mut::<u64, u32>(&mut spoilt)[place_of(now, section).start / 4] = word;
        spoilt
    };
    let flaws = [
        (1, f32::NAN.to_bits(), Refusal::Numbers),
        (2, f32::INFINITY.to_bits(), Refusal::Numbers),
        (crate::state::BODY, 1, Refusal::Version),
    ];
    for (section, word, why) in flaws {
        let spoilt = spoilt(section, word);
        assert_eq!(maker.why_refused(bytemuck::cast_slice(&spoilt)), why, "section {section} of state {tick}");
        let taken = [maker.accepts(bytemuck::cast_slice(&spoilt)), maker.accepts_own(bytemuck::cast_slice(&spoilt))];
        assert_eq!(taken, [false; 2], "section {section} of state {tick} is spoilt");
    }
}

#[test]
fn who_finds_a_state_of_a_cut_goes_on_with_it_to_the_bit() {
    let (station, pages, life, mut inbox) = begun("cut");
    let [mut holder, mut successor] = [(); 2].map(|()| engine(&station, &life, &mut inbox));
    let whole = Arc::clone(&holder.world);
    let mut now = first_state(&mut holder);
    let (mut versions, mut strokes) = (vec![parts_of(&now).0.topology_version], 0);
    for tick in 1..=SWEEP {
        pages[1].push(device::INPUTS, tick, &sweeping(&whole, tick));
        let before: Vec<u64> = now.clone();
        let before: &[u8] = bytemuck::cast_slice(&before);
        let bytes = holder.next_bytes(before).max(before.len());
        now = written(bytes, &format!("state {tick}"), |block| holder.step(&context(tick + 1), before, block).unwrap());
        let (header, _, stroke) = parts_of(&now);
        strokes += usize::from(stroke > 0);
        if header.topology_version != versions[versions.len() - 1] {
            versions.push(header.topology_version);
        }
        // One that has seen nothing since some ticks ago.
        if tick % 7 == 0 {
            is_taken_by_its_maker(&holder, tick, &now);
            succeeds(&mut successor, tick, before, &now);
        }
    }
    assert!(versions.len() > 4, "the polyp was cut {} times", versions.len() - 1);
    assert!(strokes > 40, "a stroke was in {strokes} states");
    // The current ends: so does the stroke.
    pages[1].push(device::INPUTS, SWEEP + 1, &InputRecord { tick: SWEEP + 1, ..InputRecord::default() });
    let mut next = vec![0u64; holder.message_bytes() / 8];
    holder.step(&context(SWEEP + 2), bytemuck::cast_slice(&now), bytemuck::cast_slice_mut(&mut next)).unwrap();
    assert_eq!(parts_of(&next).2, 0);
    drop((holder, successor));
}
