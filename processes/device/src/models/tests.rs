//! Which models and statuses the device uses, which it refuses, and which it waits for.

use super::*;
use hyst_exchange::Station;
use hyst_messages::page::station;
use hyst_messages::{ContactPlane, Slot};

fn by_epoch(epoch: u32, tick: u64) -> (u32, u64) {
    (epoch, tick)
}

#[test]
fn a_model_with_any_number_out_of_range_is_refused() {
    let plane = ContactPlane { point_m: [0.0, 0.01, 0.05], stiffness_n_m: 300.0, normal: [0.0, 1.0, 0.0], damping_n_s_m: 0.5 };
    let good = ContactModel { plane_count: 1, planes: [plane; MAX_PLANES], ..Default::default() };
    assert!(is_valid(&good));
    assert!(!is_valid(&ContactModel { plane_count: 9, ..good }));
    assert!(is_valid(&ContactModel { friction: 1.0, ..good }));
    for friction in [-0.01, 1.01, f32::NAN, f32::INFINITY] {
        assert!(!is_valid(&ContactModel { friction, ..good }), "{friction}");
    }
    let changes: [fn(&mut ContactPlane); 6] = [
        |plane| plane.point_m[2] = f32::NAN,
        |plane| plane.point_m[0] = 2.0,
        |plane| plane.normal = [0.0, 0.5, 0.0],
        |plane| plane.normal = [f32::INFINITY, 0.0, 0.0],
        |plane| plane.stiffness_n_m = -1.0,
        |plane| plane.damping_n_s_m = f32::NAN,
    ];
    for change in changes {
        let mut bad = good;
        change(&mut bad.planes[0]);
        assert!(!is_valid(&bad), "{:?}", bad.planes[0]);
    }
}

#[test]
fn a_newborn_device_has_all_seated_only_with_the_page_of_each_tissue_and_fluid_that_lives() {
    let station = Station::named(&format!("t{}-seats", std::process::id())).unwrap();
    station.wipe();
    station.found().unwrap();
    let (keeping, clock) = (station.open_for_keeping().unwrap(), station.open().unwrap());
    let slots = [(Role::Tissue, 0), (Role::Tissue, 1), (Role::Fluid, 0)].map(|(role, index)| Slot::new(role, index).unwrap());
    for (slot, incarnation) in slots.into_iter().zip(3..) {
        station.create_slot(slot, incarnation).unwrap();
        keeping.store32(station::SLOT_INCARNATION + slot.number(), incarnation);
    }
    let page = |at: usize| station.read_slot(slots[at], 3 + at as u32).unwrap();
    let mut models = Models::new([None, None], by_epoch);
    assert!(!models.are_all_seated(&clock));
    assert!(models.seat(0, page(0)).is_none() && models.seat_fluid(0, page(2)).is_none());
    assert!(!models.are_all_seated(&clock), "the second tissue's page is missing");
    assert!(models.seat(1, page(1)).is_none());
    assert!(models.are_all_seated(&clock));
    station.create_slot(slots[1], 9).unwrap();
    keeping.store32(station::SLOT_INCARNATION + slots[1].number(), 9);
    assert!(!models.are_all_seated(&clock), "its successor has another page");
    keeping.store32(station::SLOT_DEAD + slots[1].number(), 1);
    assert!(models.are_all_seated(&clock), "nobody waits for the dead");
    station.wipe();
}

#[test]
fn a_newborn_device_uses_no_model_and_no_medium_older_than_its_predecessors() {
    let station = Station::named(&format!("t{}-newborn", std::process::id())).unwrap();
    station.wipe();
    station.found().unwrap();
    std::fs::write(station.settings(), "").unwrap();
    let slots = [(Role::Device, 0), (Role::Tissue, 0), (Role::Tissue, 1), (Role::Fluid, 1)];
    let [own, first, spare, fluid] = slots.map(|(role, index)| Slot::new(role, index).unwrap());
    let pages = [(own, 9), (first, 3), (spare, 4), (fluid, 5)].map(|(slot, life)| station.create_slot(slot, life).unwrap());
    let life = Life::begin(station.name(), own, 9).unwrap();
    let model = |epoch: u32, state_tick: u64| ContactModel { epoch, state_tick, ..ContactModel::default() };
    let status = |epoch: u32, state_tick: u64| FluidStatus { epoch, state_tick, pressure_pa: 1_000.0, ..Default::default() };
    pages[2].write(tissue::MODEL, &model(2, 9)); // from when it held the role
    pages[3].write(fluid::STATUS, &status(1, 12));
    let mut models = Models::new([None, None], by_epoch);
    models.seat(1, station.read_slot(spare, 4).unwrap());
    models.seat_fluid(1, station.read_slot(fluid, 5).unwrap());
    let before =
        InputRecord { model: model(3, 7), pressure_pa: 5_000.0, medium_epoch: 1, medium_tick: 40, ..InputRecord::default() };
    models.go_on_from(&before, &life);
    let key = |model: ContactModel| (model.epoch, model.state_tick);
    assert_eq!(key(models.newest(&life, 20)), (3, 7), "the spare's page has an older one");
    assert_eq!(models.medium(&life, 20), (before.medium(), (1, 40)));
    models.seat(0, station.read_slot(first, 3).unwrap());
    pages[1].write(tissue::MODEL, &model(3, 6));
    assert_eq!(key(models.newest(&life, 20)), (3, 7));
    pages[1].write(tissue::MODEL, &model(3, 8));
    assert_eq!(key(models.newest(&life, 20)), (3, 8));
    let stale = life.page.load64(header::STALE);
    pages[1].write(tissue::MODEL, &model(SHADOW_EPOCH, 9));
    assert_eq!(key(models.newest(&life, 20)), (3, 8), "one that was computed beside the role");
    assert_eq!(life.page.load64(header::STALE), stale, "and no reproach to its writer");
    pages[3].write(fluid::STATUS, &status(1, 45));
    assert_eq!(models.medium(&life, 20).1, (1, 45));
    for nonsense in [
        InputRecord { model: ContactModel { plane_count: 99, ..model(4, 9) }, ..before },
        InputRecord { medium_tick: 50, pressure_pa: f32::NAN, ..before },
        InputRecord::default(),
    ] {
        models.go_on_from(&nonsense, &life);
        assert_eq!((key(models.newest(&life, 20)), models.medium(&life, 20).1), ((3, 8), (1, 45)));
    }
    station.wipe();
}

#[test]
fn a_status_that_is_no_number_stands_still_or_comes_again_is_refused() {
    let before =
        FluidStatus { state_tick: 66, deficit_ml: 3.0, pressure_pa: 9_000.0, inflow_ml_min: 90.0, ..FluidStatus::default() };
    let good = FluidStatus { state_tick: 99, deficit_ml: 3.1, ..before };
    let judge = |status: FluidStatus| judge_status(&status, Some(&before), 90);
    assert_eq!(judge(good), Ok(()));
    assert_eq!(judge(FluidStatus { pressure_pa: f32::NAN, ..good }), Err(Distrust::Invalid));
    assert_eq!(judge(FluidStatus { pressure_pa: 1e9, ..good }), Err(Distrust::Invalid));
    assert_eq!(judge(FluidStatus { deficit_ml: f64::INFINITY, ..good }), Err(Distrust::Invalid));
    assert_eq!(judge(FluidStatus { state_tick: u64::MAX, ..good }), Err(Distrust::Invalid));
    for speed in [f32::NAN, 1e6, f32::NEG_INFINITY] {
        let mut bad = good;
        bad.pieces[hyst_messages::MAX_PIECES - 1].velocity_m_s[1] = speed;
        assert_eq!(judge(bad), Err(Distrust::Invalid), "{speed} m/s");
    }
    for newton in [f32::NAN, f32::INFINITY, -0.51] {
        assert_eq!(judge(FluidStatus { on_scope_n: [0.0, newton, 0.0], ..good }), Err(Distrust::Invalid), "{newton} N");
    }
    assert_eq!(judge(FluidStatus { on_scope_n: [0.5, 0.0, -0.5], ..good }), Ok(()));
    assert_eq!(judge(FluidStatus { state_tick: 66, ..good }), Err(Distrust::Still));
    assert_eq!(judge(FluidStatus { deficit_ml: 3.0, ..good }), Err(Distrust::Frozen));
    let shut = FluidStatus { deficit_ml: 3.0, inflow_ml_min: 0.0, ..good };
    assert_eq!(judge(shut), Ok(()), "nothing flows: nothing need change");
}

#[test]
fn what_a_medium_does_to_the_scope_fades_once_nobody_says_it_any_more_and_its_pressure_stays() {
    let medium = Medium { pressure_pa: 9_000.0, on_scope_n: [0.02, -0.04, 0.1], ..Medium::default() };
    for (age_ticks, share) in [(0, 1.0), (33, 1.0), (500, 1.0), (750, 0.5), (1_000, 0.0), (u64::MAX, 0.0)] {
        let old = aged(&medium, age_ticks);
        assert_eq!(old.on_scope_n, medium.on_scope_n.map(|newton| newton * share), "{age_ticks} ticks");
        assert_eq!((old.pressure_pa, old.pieces), (medium.pressure_pa, medium.pieces));
    }
    let step_n = (501..=1_000).map(|age| aged(&medium, age - 1).on_scope_n[2] - aged(&medium, age).on_scope_n[2]);
    assert!(step_n.fold(0.0, f32::max) < 0.000_3, "nothing that is felt in a tick");
}

/// On a virtual clock the device would wait for them in each tick, and with it the whole run.
#[test]
fn a_model_or_a_status_that_was_refused_has_come_and_the_one_before_stays_in_use() {
    let station = Station::named(&format!("t{}-refused", std::process::id())).unwrap();
    station.wipe();
    station.found().unwrap();
    std::fs::write(station.settings(), "").unwrap();
    let [own, tissue, fluid] = [Role::Device, Role::Tissue, Role::Fluid].map(Slot::first);
    let pages = [(own, 9), (tissue, 3), (fluid, 5)].map(|(slot, life)| station.create_slot(slot, life).unwrap());
    let life = Life::begin(station.name(), own, 9).unwrap();
    let keeping = station.open_for_keeping().unwrap();
    keeping.store32(station::LOCKSTEP, 1);
    keeping.store64(station::BEGUN_TICK, 34);
    let mut models = Models::new([None, None], by_epoch);
    models.seat(0, station.read_slot(tissue, 3).unwrap());
    models.seat_fluid(0, station.read_slot(fluid, 5).unwrap());
    let model = |state_tick: u64| ContactModel { epoch: 1, state_tick, ..ContactModel::default() };
    let status = |state_tick: u64, pressure_pa: f32| FluidStatus { epoch: 1, state_tick, pressure_pa, ..Default::default() };
    pages[1].write(tissue::MODEL, &model(32));
    pages[2].write(fluid::STATUS, &status(32, 5_000.0));
    let mut look = || {
        let used = (models.newest(&life, 34).state_tick, models.medium(&life, 34).1.1);
        (used, models.has_reached(33, 33), models.has_reached(34, 33), models.has_reached(33, 34))
    };
    assert_eq!(look(), ((32, 32), false, false, false));
    pages[1].write(tissue::MODEL, &ContactModel { plane_count: 99, ..model(33) });
    pages[2].write(fluid::STATUS, &status(33, f32::NAN));
    assert_eq!(look(), ((32, 32), true, false, false), "of tick 33 nothing more comes, and of 34 it does");
    pages[1].write(tissue::MODEL, &model(34));
    pages[2].write(fluid::STATUS, &status(34, 6_000.0));
    assert_eq!(look(), ((34, 34), true, true, true), "the next good ones are used");
    assert_eq!((told_tick(34, &life), told_tick(35, &life)), (34, 0), "one that is ahead says nothing of the ticks until then");
    station.wipe();
}
