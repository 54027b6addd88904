//! Promises of the Main Loop about a cavity whose walls are not parted: they come together, and apart again to where they were, slowly and without turning a
//! tet inside out; they lie on an instrument that is between them, with a force that has an end; a state on the way is all that a successor needs; and while
//! the pressure holds the walls apart, nothing of this is in a state.

use super::pieces::parted;
use super::*;
use hyst_mesh::signed_volume;
use std::sync::OnceLock;

/// 10 mmHg, and 70.
const LOW_PA: f32 = 1_333.2;
const HIGH_PA: f32 = 9_333.0;
/// Ticks in which a cavity closes or opens and comes to rest.
const TICKS: u64 = 1_500;
/// Most force that the largest device makes, N.
const DEVICE_N: f32 = 12.0;

struct Session<'a> {
    main: MainLoop<'a>,
    device: &'a OwnedPage,
    now: Vec<u64>,
    tick: u64,
    tip_m: [f32; 3],
    /// What the steps had at most.
    most_kinetic_j: f64,
    most_force_n: f32,
}

impl Session<'_> {
    /// So many ticks at a pressure, in which nothing is mended; every 25th has its tets looked at.
    fn go(&mut self, pressure_pa: f32, ticks: u64) {
        for _ in 0..ticks {
            self.tick += 1;
            let mut record = InputRecord { tick: self.tick, pressure_pa, ..InputRecord::default() };
            record.sample.pose = Pose { position_m: self.tip_m, orientation: [0.0, 0.0, 0.0, 1.0], ..Pose::default() };
            self.now = fed(&mut self.main, self.device, &self.now, &record);
            let core = core_of(&self.now);
            assert!(core.is_sane() && core.corrections == 0, "tick {}: {} corrections", self.tick, core.corrections);
            let force_n = core.force_n.iter().map(|part| part * part).sum::<f32>().sqrt();
            (self.most_force_n, self.most_kinetic_j) =
                (self.most_force_n.max(force_n), self.most_kinetic_j.max(self.kinetic_j()));
            if self.tick.is_multiple_of(25) {
                assert_eq!(self.inverted(), 0, "tick {}: tets are inside out", self.tick);
            }
        }
    }

    fn kinetic_j(&self) -> f64 {
        let of = |(velocity, mass_kg): (&[f32; 3], &f32)| {
            0.5 * f64::from(*mass_kg) * velocity.iter().map(|part| f64::from(*part).powi(2)).sum::<f64>()
        };
        let velocities: &[[f32; 3]] =
            Message::parse(bytemuck::cast_slice(&self.now), Kind::TissueState).unwrap().section(2).unwrap();
        velocities.iter().zip(self.main.world.model.mass_kg()).map(of).sum()
    }

    fn inverted(&self) -> usize {
        let places = positions(&self.now);
        let volume_m3 = |tet: &[u32; 4]| signed_volume(tet.map(|node| places[node as usize].map(f64::from).into()));
        self.main.world.model.tets().iter().filter(|tet| volume_m3(tet) <= 0.0).count()
    }

    /// How far the wall's nodes whose places at rest are within a range of x and of z are from the middle, m: less than 0 beyond it.
    fn halves_m(&self, x_m: std::ops::Range<f32>, z_m: std::ops::Range<f32>) -> Vec<f32> {
        let (rest_m, places) = (self.main.world.model.rest_m(), positions(&self.now));
        let mut nodes: Vec<usize> = self.main.world.wall.as_flattened().iter().map(|node| *node as usize).collect();
        nodes.sort_unstable();
        nodes.dedup();
        nodes.retain(|node| x_m.contains(&rest_m[*node][0]) && z_m.contains(&rest_m[*node][2]));
        assert!(nodes.len() > 4, "{} nodes of the wall", nodes.len());
        nodes.into_iter().map(|node| places[node][1] * rest_m[node][1].signum()).collect()
    }
}

/// The least and the greatest.
fn ends(all: &[f32]) -> [f32; 2] {
    all.iter().fold([f32::MAX, f32::MIN], |[low, high], at| [low.min(*at), high.max(*at)])
}

fn with_session(name: &str, tip_m: [f32; 3], try_it: impl FnOnce(&mut Session<'_>)) {
    let (station, pages, life, mut inbox) = begun(name);
    let mut main = engine(&station, &life, &mut inbox);
    let now = first_state(&mut main);
    let (most_kinetic_j, most_force_n) = (0.0, 0.0);
    let mut session = Session { main, device: &pages[1], now, tick: 0, tip_m, most_kinetic_j, most_force_n };
    try_it(&mut session);
}

#[test]
fn without_pressure_the_walls_come_together_and_with_it_they_are_where_they_were() {
    with_session("closes", [0.0, 0.0, -0.2], |session| {
        // The polyp hangs on the patient's right.
        let (left, body) = (-6e-3..0.0, 20e-3..40e-3);
        session.go(HIGH_PA, 20);
        let before = session.now.clone();
        let [open_m, _] = ends(&session.halves_m(left.clone(), body.clone()));
        assert!(open_m > 3e-3, "{open_m} m");
        session.go(LOW_PA, TICKS);
        assert_eq!(core_of(&session.now).closed, 1.0);
        let [least_m, most_m] = ends(&session.halves_m(left.clone(), body.clone()));
        println!(
            "{:.2} to {:.2} mm from the middle, {:.1} µJ at most",
            1e3 * least_m,
            1e3 * most_m,
            1e6 * session.most_kinetic_j
        );
        assert!(least_m > 0.2e-3 && most_m < 1.5e-3, "a slit, and no wall beyond the middle: {least_m} to {most_m} m");
        assert!(session.kinetic_j() < 1e-7, "they are at rest: {} J", session.kinetic_j());
        session.go(HIGH_PA, TICKS);
        assert_eq!(core_of(&session.now).closed.to_bits(), 0);
        let pairs = positions(&session.now).iter().zip(positions(&before));
        let away_m = pairs.map(|(now, was)| (0..3).map(|axis| (now[axis] - was[axis]).powi(2)).sum::<f32>().sqrt());
        let away_m = away_m.fold(0.0, f32::max);
        println!("open again within {:.3} mm", 1e3 * away_m);
        assert!(away_m < 2e-4, "{away_m} m from where they were");
        assert!(session.most_kinetic_j < 5e-3, "{} J: they come slowly", session.most_kinetic_j);
    });
}

#[test]
fn walls_lie_on_the_instrument_that_is_between_them() {
    with_session("between", [0.0, 0.0, 0.03], |session| {
        session.go(HIGH_PA, 50);
        assert_eq!(core_of(&session.now).contact_count, 0, "in the open cavity it touches nothing");
        session.go(LOW_PA, TICKS);
        let core = core_of(&session.now);
        let [least_m, most_m] = ends(&session.halves_m(-1.5e-3..1.5e-3, 12e-3..26e-3));
        println!(
            "{:.2} to {:.2} mm from the axis, {:?} N, {} contacts",
            1e3 * least_m,
            1e3 * most_m,
            core.force_n,
            core.contact_count
        );
        assert!(core.contact_count > 10, "{} contacts", core.contact_count);
        assert!(least_m > 1.6e-3, "a wall is {least_m} m from the axis of a shaft of 2.5 mm");
        assert!(most_m < 3.4e-3, "a wall is {most_m} m from the axis: it lies on nothing");
        // Half a millimetre to the front in a tenth of a second: the wall there pushes back.
        let still_n = core.force_n[1];
        for step in 1..=100 {
            session.tip_m[1] = 5e-6 * step as f32;
            session.go(LOW_PA, 1);
        }
        session.go(LOW_PA, 300);
        let back_n = core_of(&session.now).force_n[1] - still_n;
        println!("{back_n} N back, {} N at most", session.most_force_n);
        assert!(back_n < -0.02, "{back_n} N");
        session.tip_m[1] = 0.0;
        session.go(HIGH_PA, TICKS);
        assert_eq!(core_of(&session.now).contact_count, 0, "they let it go");
        assert!(session.most_force_n < DEVICE_N, "{} N", session.most_force_n);
    });
}

#[test]
fn while_the_pressure_holds_the_walls_apart_nothing_of_it_is_in_a_state() {
    let after = |name: &str, is_spoilt: bool| {
        let mut states = Vec::new();
        with_session(name, [0.0, 0.0, -0.2], |session| {
            let mut world = session.main.workshop.make(session.main.world.body.clone()).unwrap();
            if is_spoilt {
                world.shut_n = OnceLock::from(vec![[1e3; 3]; world.model.node_count()]);
            }
            session.main.take_world(world);
            // A pump that starts is below for less than a tenth of a second.
            for (pressure_pa, ticks) in [(5_333.0, 60), (LOW_PA, 60), (HIGH_PA, 60), (20_000.0, 60)] {
                session.go(pressure_pa, ticks);
                states.push(session.now.clone());
            }
            assert_eq!(core_of(&session.now).closed.to_bits(), 0);
        });
        states
    };
    assert!(after("open", false) == after("spoilt", true), "forces that hold the cavity shut are in a state of an open one");
}

#[test]
fn who_finds_a_state_on_the_way_goes_on_to_the_bit() {
    let (station, pages, life, mut inbox) = begun("onthe");
    let [mut holder, mut successor] = [(); 2].map(|()| engine(&station, &life, &mut inbox));
    let mut now = first_state(&mut holder);
    for tick in 1..=700 {
        let pressure_pa = if tick <= 400 { LOW_PA } else { HIGH_PA };
        let mut record = InputRecord { tick, pressure_pa, ..InputRecord::default() };
        record.sample.pose = Pose { position_m: [0.0, 0.0, -0.2], orientation: [0.0, 0.0, 0.0, 1.0], ..Pose::default() };
        let before = now.clone();
        now = fed(&mut holder, &pages[1], &now, &record);
        if tick % 100 == 50 {
            let closed = core_of(&now).closed;
            assert!(closed > 0.0 && closed < 1.0, "tick {tick}: {closed}");
            succeeds(&mut successor, tick, bytemuck::cast_slice(&before), &now);
        }
    }
    drop((holder, successor));
}

#[test]
fn what_is_cut_while_the_cavity_is_closed_has_the_forces_of_the_mesh_that_it_is_then() {
    with_session("shutcut", [0.0, 0.0, 0.004], |session| {
        session.go(LOW_PA, 400);
        let (whole, from) = (Arc::clone(&session.main.world), session.tick);
        for tick in 1..=SWEEP {
            session.tick = from + tick;
            let record = InputRecord { tick: session.tick, pressure_pa: LOW_PA, ..sweeping(&whole, tick) };
            session.now = fed(&mut session.main, session.device, &session.now, &record);
            assert!(session.main.accepts(bytemuck::cast_slice(&session.now)), "tick {tick}");
        }
        let cut = Arc::clone(&session.main.world);
        assert!(cut.version != whole.version, "nothing was cut");
        assert_eq!(cut.shut_n().len(), cut.model.node_count());
        // Where the polyp alone has changed, the wall is held as before.
        let (body, ..) = parted(&whole, 0.0);
        let halved = session.main.workshop.make(body).unwrap();
        assert!(halved.model.node_count() > whole.model.node_count() && halved.is_organ_whole);
        let owners = whole.body.owners();
        let off_n = (0..owners.len()).filter(|node| owners[*node] == Some(0)).map(|node| {
            let [before, now] = [&*whole, &halved].map(|world| world.shut_n()[node]);
            (0..3).map(|axis| (now[axis] - before[axis]).abs()).fold(0.0, f32::max)
        });
        let off_n = off_n.fold(0.0, f32::max);
        assert!(off_n < 1e-4, "the wall is held by other forces, by {off_n} N");
    });
}

/// Ticks in which the cavity begins to close, before a sweep in which it does not yet close so far that anything holds it.
const BEGUN: u64 = 10;

/// The step of the cut made them beside all else, and that of who followed when it was his turn.
#[test]
fn a_mesh_that_is_cut_while_the_cavity_is_shutting_has_its_forces_before_a_step_asks_for_them() {
    for (name, pressure_pa) in [("hasforces", LOW_PA), ("noforces", HIGH_PA)] {
        with_session(name, [0.0, 0.0, 0.004], |session| {
            session.go(pressure_pa, BEGUN);
            let (whole, from) = (Arc::clone(&session.main.world), session.tick);
            // As far as the first cut: an organ that is cut opens again.
            for tick in 1..=SWEEP {
                if session.main.world.version != whole.version {
                    break;
                }
                session.tick = from + tick;
                let record = InputRecord { tick: session.tick, pressure_pa, ..sweeping(&whole, tick) };
                session.now = fed(&mut session.main, session.device, &session.now, &record);
            }
            let (cut, closed) = (Arc::clone(&session.main.world), core_of(&session.now).closed);
            let is_shutting = closed > 0.0;
            assert!(cut.version != whole.version, "nothing was cut");
            assert_eq!((is_shutting, crate::closing::share(closed)), (pressure_pa == LOW_PA, 0.0), "a step has asked: {closed}");
            assert_eq!(cut.shut_n.get().is_some(), is_shutting, "those of the cut mesh");
            // Who has only its body.
            let same = session.main.workshop.make(cut.body.clone()).unwrap();
            assert!(same.version == cut.version && same.shut_n.get().is_none());
            session.main.take_world(same);
            session.main.prepare(bytemuck::cast_slice(&session.now)).unwrap();
            let follows = Arc::clone(&session.main.world);
            assert_eq!(follows.shut_n.get().is_some(), is_shutting, "those of who follows");
            assert!(follows.shut_n() == cut.shut_n(), "they are what a step would have made");
        });
    }
}

/// In the case `perforation` a wall that was cut through closed: 800 corrections in each step, and at last a place that none can be.
#[test]
fn a_cavity_whose_wall_is_cut_opens_and_stays_open_however_low_the_pressure_is() {
    with_session("cutwall", [0.0, 0.0, 0.004], |session| {
        session.go(LOW_PA, 600);
        assert_eq!(core_of(&session.now).closed, 1.0);
        let world = Arc::get_mut(&mut session.main.world).expect("nobody else has it");
        let mut body = world.body.clone();
        assert!(world.case.closing.is_whole(&body));
        let wall = body.rest.regions.iter().position(|object| *object == 0).expect("the organ is the first object");
        body.rest.regions[wall] = 7;
        world.is_organ_whole = world.case.closing.is_whole(&body);
        assert!(!world.is_organ_whole, "a tet of its wall is another's");
        session.go(LOW_PA, 600);
        assert_eq!(core_of(&session.now).closed.to_bits(), 0);
    });
}

/// A straight wire so far ahead of a tip that touches nothing, from its middle to each end, m; how high the wall is cut with it, from the middle to so far in
/// front, in so many ticks.
const AHEAD_M: f32 = 0.2;
const HALF_WIRE_M: f32 = 0.014;
const CUT_AT_M: f32 = 0.025;
const DEEP_M: f32 = 0.02;
const CUTS: u64 = 80;
/// Ticks in which the cavity is closed before that.
const CLOSES: u64 = 600;

/// Tets and nodes of a world's organ.
fn size_of_organ(world: &World) -> [usize; 2] {
    let rest = &world.body.rest;
    let of_organ = rest.tets.iter().zip(&rest.regions).filter(|(_, object)| **object == 0);
    let nodes: std::collections::BTreeSet<u32> = of_organ.clone().flat_map(|(tet, _)| *tet).collect();
    [of_organ.count(), nodes.len()]
}

/// The organ had as many tets as before, which alone were counted: the forces that close the cavity led a wall that was cut.
#[test]
fn a_cavity_whose_wall_is_parted_where_there_is_no_room_for_tets_opens_too() {
    let (station, pages, life, mut inbox) = begun("notets");
    let (mut workshop, world) = Workshop::load(&life).unwrap();
    let world = workshop.cramp(world, |case, body| {
        case.room.tets = body.rest.tets.len();
        let electrode = case.electrode.as_mut().expect("the default instrument has a loop");
        let ahead_m = AHEAD_M - electrode.reach_m;
        electrode.wire_m = [-HALF_WIRE_M, 0.0, HALF_WIRE_M].map(|x_m| [x_m, 0.0, ahead_m]).to_vec();
    });
    let mut main = MainLoop::new(&life, workshop, world).unwrap();
    main.arrival(page_of(&station, Role::Device), &mut inbox);
    let whole = Arc::clone(&main.world);
    let reach_m = whole.case.electrode.as_ref().map_or(0.0, |electrode| electrode.reach_m);
    let record = |tick: u64, cut_m: Option<f32>| {
        let mut record = InputRecord { tick, pressure_pa: LOW_PA, ..InputRecord::default() };
        let position_m = [0.0, cut_m.unwrap_or(0.0), CUT_AT_M - AHEAD_M];
        record.sample.pose = Pose { position_m, orientation: [0.0, 0.0, 0.0, 1.0], ..Pose::default() };
        if cut_m.is_some() {
            record.sample.controls.buttons = hyst_messages::BUTTON_ENERGIZED | hyst_messages::BUTTON_EXTENDED;
            record.sample.controls.loop_extension_m = reach_m;
        }
        record
    };
    let mut now = first_state(&mut main);
    for tick in 1..=CLOSES {
        now = fed(&mut main, &pages[1], &now, &record(tick, None));
    }
    assert!(whole.is_organ_whole && core_of(&now).closed == 1.0);
    let ([tets, nodes], mut tick) = (size_of_organ(&whole), CLOSES);
    while size_of_organ(&main.world)[1] == nodes {
        tick += 1;
        assert!(tick <= CLOSES + CUTS, "nothing was parted");
        let cut_m = DEEP_M * (tick - CLOSES) as f32 / CUTS as f32;
        now = fed(&mut main, &pages[1], &now, &record(tick, Some(cut_m)));
    }
    assert_eq!(size_of_organ(&main.world)[0], tets, "it was to be parted along what is there");
    assert!(!main.world.is_organ_whole && core_of(&now).cut_limits > 0);
    for tick in tick + 1..=tick + CLOSES {
        now = fed(&mut main, &pages[1], &now, &record(tick, None));
    }
    assert_eq!(core_of(&now).closed.to_bits(), 0, "it is open, however low the pressure is");
}
