//! Promise of the Main Loop about jaws: they take hold of what is between them when they close, it comes along with them, whoever goes on from which state,
//! they let it go when they open, and the hand feels what holds on to it until it slips out. All else meets them where they stand.

use super::pieces::sunk;
use super::*;
use glam::{Quat, Vec3};
use hyst_messages::Controls;
use hyst_messages::stream::ObjectKind;

/// How fast the device opens and closes the jaws, m per tick.
const CLOSES_M: f32 = 30e-6;
/// How fast a hand opens them that nobody sees open them, m per tick, and how far jaws tremble.
const SLOWLY_M: f32 = 7e-6;
const TREMBLE_M: f32 = 15e-6;
/// For how many ticks they do: in the last one they are as far apart as before.
const TREMBLES: u64 = 20;
/// How much farther apart they are than when they took hold once they have let go, m.
const LOOSE_M: f32 = 1e-4;
/// How fast the hand goes back with what it holds, m/s, and for how many ticks.
const BACK_M_S: f32 = 0.02;
const BACK: u64 = 250;
/// A fast hand, m/s, which goes back by more in a step of four ticks than what is held may be drawn from its pad; steps for which it does, with what nothing
/// holds, and at most with what grows on the wall.
const FAST_M_S: f32 = 0.45;
const FAST_STEPS: u64 = 3;
const MOST_STEPS: u64 = 60;
/// Ticks of which no input comes, and how fast the hand goes on meanwhile, m/s: likewise by more than that.
const GAP: u64 = 20;
const ON_M_S: f32 = 0.09;
/// How far a piece may come from where jaws took hold of it while they close on, or in the step in which they jump, m.
const FLUNG_M: f32 = 1e-3;
/// Ticks within which jaws that go on meet what is before them, and with how much they push that at least, N: far more than what grazes them on the way.
const MEETS: u64 = 2_000;
const MET_N: f32 = 0.02;
/// How far jaws roll in a tick, rad, and how fast the pads at their sides go then at least, m/s.
const ROLL_RAD: f32 = 2e-3;
const AROUND_M_S: f32 = 5e-4;
/// How deep the hand is in the cavity, m; the tests' tool stands where they want it.
const IN_M: f32 = 0.03;

/// An input: jaws that are so far apart and are to close on a place, the tool going with a velocity along its axis.
fn at(world: &World, tick: u64, (middle_m, apart_m): (Vec3, f32), (velocity_m_s, insertion_m): (f32, f32)) -> InputRecord {
    let jaws = world.case.tool.jaws().expect("the scene's instrument has jaws");
    let mut record = InputRecord { tick, pressure_pa: world.case.rest_pressure_pa, ..InputRecord::default() };
    let aim = hyst_scene::Pose::aim(world.case.pivot_m, middle_m.to_array()).unwrap();
    let tip_m = middle_m - 0.7 * jaws.length_m * Vec3::from(aim.axis());
    record.sample.pose = Pose { position_m: tip_m.to_array(), orientation: aim.orientation(), insertion_m, ..Pose::default() };
    record.sample.velocity_m_s = (velocity_m_s * Vec3::from(aim.axis())).to_array();
    record.sample.controls = Controls { loop_extension_m: apart_m, ..Controls::default() };
    record
}

/// Ticks in which what is loose has sunk to the wall.
const SINKS: u64 = 700;

/// Jaws that wait far off until what is loose has sunk to the wall: the state, and where the middle of an object is then.
fn sunk_with_jaws(main: &mut MainLoop<'_>, device: &OwnedPage, object: u32) -> (Vec<u64>, Vec3) {
    let mut now = first_state(main);
    let world = Arc::clone(&main.world);
    for tick in 1..=SINKS {
        now = fed(main, device, &now, &at(&world, tick, (0.2 * Vec3::NEG_Z, 0.0), (0.0, IN_M)));
    }
    let (_, middle_m) = sunk(main, &now, object);
    (now, middle_m)
}

/// Jaws that have closed on the middle of an object: the state, where that was, and the next tick.
fn closed_on(main: &mut MainLoop<'_>, device: &OwnedPage, object: u32) -> (Vec<u64>, Vec3, u64) {
    let (mut now, middle_m) = sunk_with_jaws(main, device, object);
    let world = Arc::clone(&main.world);
    let open_m = world.case.tool.jaws().unwrap().opening_m;
    let ticks = (open_m / CLOSES_M) as u64 + 2;
    for step in 0..=ticks {
        let apart_m = (open_m - CLOSES_M * step as f32).max(0.0);
        now = fed(main, device, &now, &at(&world, SINKS + 1 + step, (middle_m, apart_m), (0.0, IN_M)));
        let held = core_of(&now).held;
        assert!(step > 0 || held == 0, "{held} points are held by jaws that do not close");
    }
    (now, middle_m, SINKS + ticks + 2)
}

/// The same once what they hold is lifted off the wall below, to the height of the pivot, at the speed of a hand.
fn lifted(
    main: &mut MainLoop<'_>,
    device: &OwnedPage,
    (mut now, mut middle_m, mut tick): (Vec<u64>, Vec3, u64),
) -> (Vec<u64>, Vec3, u64) {
    let (world, step_ticks) = (Arc::clone(&main.world), main.step_ticks());
    while middle_m.y < 0.0 {
        middle_m.y = (middle_m.y + 1e-3 * BACK_M_S * step_ticks as f32).min(0.0);
        now = fed(main, device, &now, &at(&world, tick, (middle_m, 0.0), (0.0, IN_M)));
        tick += step_ticks;
    }
    (now, middle_m, tick)
}

/// How many points of the jaws push something else than an object in the step that made a state, and with how much all together, N; the object they do not.
fn pushed_by_jaws(main: &MainLoop<'_>, now: &[u64], object: u32) -> (usize, f32) {
    let (world, tool) = (&main.world, &main.world.case.tool);
    let message = Message::parse(bytemuck::cast_slice(now), Kind::TissueState).unwrap();
    let after = StateRef { position_m: message.section(1).unwrap(), velocity_m_s: message.section(2).unwrap() };
    let (mut points, mut push_n) = (0, 0.0);
    for hit in main.collision.hits().iter().filter(|hit| (tool.shaft..tool.pads).contains(&(hit.point as usize))) {
        let (nodes, weights) = (world.model.tets()[hit.tet as usize], hit.weights.map(|weight| weight.clamp(0.0, 1.0)));
        let spring = main.contacts.springs().iter().find(|spring| spring.nodes == nodes && spring.weights == weights);
        if world.body.rest.regions[hit.tet as usize] == object {
            assert!(spring.is_none(), "what the jaws hold is pushed by them");
        } else if let Some(spring) = spring {
            points += 1;
            push_n += Vec3::from(main.scratch.push(&world.model, &LAW, spring, &after).force_n).length();
        }
    }
    (points, push_n)
}

/// Jaws that jump far off, out of the cavity, let go of what they hold, which stays.
fn assert_jumps_without_it(main: &mut MainLoop<'_>, device: &OwnedPage, now: &[u64], (object, tick): (u32, u64)) {
    let jumps = at(&main.world, tick, (0.2 * Vec3::NEG_Z, 0.0), (0.0, 0.004));
    let after = fed(main, device, now, &jumps);
    assert_eq!((core_of(&after).held, core_of(&after).taken_out), (0, 0), "the jaws have jumped");
    let went_m = sunk(main, &after, object).1.distance(sunk(main, now, object).1);
    assert!(went_m < FLUNG_M, "what they held is flung after them by {went_m} m");
}

/// Jaws that have closed on a place and roll on the spot draw what each pad holds around their axis.
fn assert_rolls(main: &mut MainLoop<'_>, device: &OwnedPage, now: &[u64], (tick, middle_m): (u64, Vec3)) {
    let mut record = at(&main.world, tick, (middle_m, 0.0), (0.0, IN_M));
    let pose = &mut record.sample.pose;
    let (turn, tip) = (Quat::from_array(pose.orientation), Vec3::from(pose.position_m));
    pose.orientation = (turn * Quat::from_rotation_z(ROLL_RAD)).to_array();
    fed(main, device, now, &record);
    let rolls = turn * Vec3::Z * (ROLL_RAD / 1e-3);
    let mut fastest_m_s = 0.0f32;
    for hold in main.grasp.holds() {
        let wanted = rolls.cross(Vec3::from(hold.place_m) - tip);
        assert!(Vec3::from(hold.velocity_m_s).distance(wanted) < 1e-4, "{:?}, not {wanted} m/s", hold.velocity_m_s);
        fastest_m_s = fastest_m_s.max(wanted.length());
    }
    assert!(fastest_m_s > AROUND_M_S, "all pads that hold are on the axis: {fastest_m_s} m/s");
}

/// A station whose scene has jaws, and the settings of its tissue.
fn settings() -> String {
    format!("workers = 0\nscene = {:?}", crate::grasper_scene())
}

/// The scene's loose piece.
fn piece(world: &World) -> u32 {
    let free = world.objects.iter().find(|object| object.is_free_piece());
    free.expect("a piece that nothing holds from the beginning").id
}

#[test]
fn what_is_between_jaws_that_close_comes_along_is_let_go_when_they_open_and_can_be_taken_out() {
    let (station, pages, life, mut inbox) = begun_with(1, "grasp", &settings());
    let [mut main, mut successor] = [(); 2].map(|()| engine(&station, &life, &mut inbox));
    let (world, object) = (Arc::clone(&main.world), piece(&main.world));
    let (mut now, mut middle_m, mut tick) = closed_on(&mut main, &pages[1], object);
    let held = core_of(&now).held;
    assert!(held >= 6, "{held} points are held");
    let (from_m, back) = (sunk(&main, &now, object).1, middle_m.normalize());

    // Back, and whoever finds a state on the way holds the same.
    for step in 0..BACK {
        middle_m -= 1e-3 * BACK_M_S * back;
        let before = now.clone();
        now = fed(&mut main, &pages[1], &now, &at(&world, tick, (middle_m, 0.0), (-BACK_M_S, IN_M)));
        if step % 50 == 0 {
            succeeds(&mut successor, tick, bytemuck::cast_slice(&before), &now);
        }
        tick += 1;
    }
    let came_m = sunk(&main, &now, object).1 - from_m;
    let went_m = 1e-3 * BACK_M_S * BACK as f32;
    println!("{held} points are held, the jaws went back by {went_m} m, the piece by {came_m}");
    assert!(came_m.distance(-went_m * back) < 0.15 * went_m, "{came_m} of {went_m} m");
    assert_eq!(core_of(&now).held, held, "nothing slipped out");
    let gripped = now.clone();

    // Opened, they hold nothing, and what they held stays.
    let (mut open, mut away_m) = (now, middle_m);
    for step in 1..=BACK {
        away_m -= 1e-3 * BACK_M_S * back;
        let apart_m = (CLOSES_M * step as f32).min(0.008);
        open = fed(&mut main, &pages[1], &open, &at(&world, tick + step, (away_m, apart_m), (-BACK_M_S, IN_M)));
        assert_eq!(core_of(&open).held, 0);
    }
    let stayed_m = sunk(&main, &open, object).1 - from_m - came_m;
    assert!(stayed_m.length() < 0.4 * went_m, "let go, it still went by {stayed_m} m of {went_m}");

    // Drawn back into the cervix, they bring out what they hold: once.
    let present = main.site.present();
    let volume_ml = 1e6 * world.body.volume_of_m3(object);
    let out = fed(&mut main, &pages[1], &gripped, &at(&world, tick, (middle_m, 0.0), (0.0, 0.004)));
    let core = core_of(&out);
    assert_eq!((core.taken_out, core.held, core.washed_out, main.site.present()), (1, 0, 0, present - 1));
    assert!((core.removed_volume_ml - volume_ml).abs() < 1e-9, "{} ml of {volume_ml}", core.removed_volume_ml);
    succeeds(&mut successor, tick, bytemuck::cast_slice(&gripped), &out);
    let after = fed(&mut main, &pages[1], &out, &at(&world, tick + 1, (middle_m, 0.0), (0.0, 0.004)));
    assert_eq!((core_of(&after).taken_out, core_of(&after).removed_volume_ml), (1, core.removed_volume_ml));
    drop((main, successor));
}

#[test]
fn the_hand_feels_what_holds_on_to_the_tissue_and_it_slips_out_of_jaws_that_pull_too_far() {
    let (station, pages, life, mut inbox) = begun_with(1, "pull", &settings());
    let mut main = engine(&station, &life, &mut inbox);
    let world = Arc::clone(&main.world);
    let polyp = world.objects.iter().find(|object| object.kind == ObjectKind::Pathology as u32).unwrap().id;
    let (mut now, mut middle_m, mut tick) = closed_on(&mut main, &pages[1], polyp);
    let held = core_of(&now).held;
    assert!(held >= 3, "{held} points are held");
    assert_rolls(&mut main, &pages[1], &now, (tick, middle_m));
    let back = middle_m.normalize();
    let (mut pulled_n, mut planes) = (Vec::new(), 0);
    while core_of(&now).held > 0 {
        middle_m -= 1e-3 * BACK_M_S * back;
        now = fed(&mut main, &pages[1], &now, &at(&world, tick, (middle_m, 0.0), (-BACK_M_S, IN_M)));
        pulled_n.push(Vec3::from(core_of(&now).force_n).dot(back));
        planes = planes.max(main.planes.count);
        tick += 1;
        assert!(pulled_n.len() < 3_000, "it holds for ever: {:?} N", pulled_n.last());
    }
    let most_n = pulled_n.iter().copied().fold(0.0, f32::max);
    let quarter_n = pulled_n[pulled_n.len() / 4];
    println!("{held} points are held; pulled by {:.1} mm with {most_n:.2} N until they slip", 0.02 * pulled_n.len() as f32);
    assert!(most_n > 0.2 && most_n < 5.0 && quarter_n > 0.02 && quarter_n < most_n && planes > 0, "{quarter_n} of {most_n} N");
    assert_eq!(core_of(&now).taken_out, 0);
    for more in 0..50 {
        now = fed(&mut main, &pages[1], &now, &at(&world, tick + more, (middle_m, 0.0), (0.0, IN_M)));
    }
    assert!(
        Vec3::from(core_of(&now).force_n).dot(back) < 0.1 * most_n,
        "let go, the tissue still pulls: {:?}",
        core_of(&now).force_n
    );
}

#[test]
fn jaws_that_hold_a_piece_meet_the_wall_where_they_stand_and_what_they_hold_is_not_flung_by_them() {
    let (station, pages, life, mut inbox) = begun_with(1, "meet", &settings());
    let mut main = engine(&station, &life, &mut inbox);
    let (world, object) = (Arc::clone(&main.world), piece(&main.world));
    let owners = (0..).zip(world.body.owners());
    let of_piece: Vec<usize> = owners.filter(|(_, of)| *of == Some(object)).map(|(node, _)| node).collect();
    let place = |now: &[u64]| of_piece.iter().map(|node| Vec3::from(positions(now)[*node])).sum::<Vec3>() / of_piece.len() as f32;
    let (mut now, middle_m) = sunk_with_jaws(&mut main, &pages[1], object);
    let (mut tick, mut apart_m) = (SINKS, world.case.tool.jaws().unwrap().opening_m + CLOSES_M);
    let (mut taken_at, mut flung_m) = (None, 0.0f32);
    while apart_m > 0.0 {
        (tick, apart_m) = (tick + 1, (apart_m - CLOSES_M).max(0.0));
        now = fed(&mut main, &pages[1], &now, &at(&world, tick, (middle_m, apart_m), (0.0, IN_M)));
        if core_of(&now).held > 0 {
            flung_m = flung_m.max(taken_at.get_or_insert(place(&now)).distance(place(&now)));
        }
    }
    let Core { held, hold_m, .. } = core_of(&now);
    println!("{held} points are held by jaws {hold_m} m apart; meanwhile the piece was up to {flung_m} m beside");
    assert!(held >= 3 && hold_m > 0.0, "{held} points are held");
    assert!(flung_m < FLUNG_M, "jaws that close on fling what they hold by {flung_m} m");

    let (mut now, mut middle_m, mut tick) = lifted(&mut main, &pages[1], (now, middle_m, tick + 1));
    let (ahead, end) = (middle_m.normalize(), tick + MEETS);
    let (mut met, mut push_n) = (0, 0.0);
    while push_n < MET_N && tick < end {
        middle_m += 1e-3 * BACK_M_S * ahead;
        now = fed(&mut main, &pages[1], &now, &at(&world, tick, (middle_m, 0.0), (BACK_M_S, IN_M)));
        tick += 1;
        (met, push_n) = pushed_by_jaws(&main, &now, object);
    }
    let felt_n = Vec3::from(core_of(&now).force_n);
    println!("{met} points of the jaws push what is before them with {push_n} N at {middle_m} m, and {felt_n} N are felt");
    assert!(push_n >= MET_N, "the jaws go through what is before them: {met} points push with {push_n} N at {middle_m} m");
    assert!(core_of(&now).held > 0, "the piece has slipped out");
    drop(main);
}

#[test]
fn nothing_slips_for_long_steps_or_lost_ticks_of_a_fast_hand_and_what_is_pulled_too_hard_or_by_a_jump_does() {
    let (station, pages, life, mut inbox) = begun_with(1, "fast", &settings());
    let mut main = engine(&station, &life, &mut inbox);
    let (world, object) = (Arc::clone(&main.world), piece(&main.world));
    let closed = closed_on(&mut main, &pages[1], object);
    let (gripped, gripped_m, tick) = lifted(&mut main, &pages[1], closed);
    let (held, back) = (core_of(&gripped).held, gripped_m.normalize());
    assert!(held >= 3, "{held} points are held");
    main.take_step(4);
    let back_by = |way_m: f32, tick: u64, m_s: f32| at(&world, tick, (gripped_m - way_m * back, 0.0), (-m_s, IN_M));

    let mut now = gripped.clone();
    for step in 1..=FAST_STEPS {
        now = fed(&mut main, &pages[1], &now, &back_by(4e-3 * FAST_M_S * step as f32, tick + 4 * (step - 1), FAST_M_S));
        assert_eq!(core_of(&now).held, held, "after {step} steps with {FAST_M_S} m/s");
    }
    let came_m = sunk(&main, &gripped, object).1.distance(sunk(&main, &now, object).1);
    let went_m = 4e-3 * FAST_M_S * FAST_STEPS as f32;
    assert!((came_m - went_m).abs() < 0.4 * went_m, "the piece came by {came_m} of {went_m} m");

    let mut now = gripped.clone();
    for step in 0..3 {
        now = fed(&mut main, &pages[1], &now, &back_by(1e-3 * ON_M_S * GAP as f32, tick + GAP + 4 * step, ON_M_S));
        assert_eq!(core_of(&now).held, held, "{GAP} ticks were lost, {step} steps ago");
    }
    assert_jumps_without_it(&mut main, &pages[1], &gripped, (object, tick));

    let polyp = world.objects.iter().find(|object| object.kind == ObjectKind::Pathology as u32).unwrap().id;
    main.take_step(1);
    let (mut now, mut middle_m, mut tick) = closed_on(&mut main, &pages[1], polyp);
    let (held, back, mut steps) = (core_of(&now).held, middle_m.normalize(), 0);
    assert!(held >= 3, "{held} points of the polyp are held");
    main.take_step(4);
    while core_of(&now).held > 0 {
        (middle_m, steps, tick) = (middle_m - 4e-3 * FAST_M_S * back, steps + 1, tick + 4);
        assert!(steps <= MOST_STEPS, "it holds for ever");
        now = fed(&mut main, &pages[1], &now, &at(&world, tick, (middle_m, 0.0), (-FAST_M_S, IN_M)));
    }
    println!("{held} points of the polyp slip after {steps} steps, pulled by {:.1} mm", 4.0 * FAST_M_S * steps as f32);
    assert!(steps > 1, "it slips before the tissue was drawn at all");
    drop(main);
}

#[test]
fn jaws_that_tremble_hold_on_and_those_that_open_slowly_let_go_once_they_are_farther_apart_than_when_they_took_hold() {
    let (station, pages, life, mut inbox) = begun_with(1, "slowly", &settings());
    let [mut main, mut successor] = [(); 2].map(|()| engine(&station, &life, &mut inbox));
    let (world, object) = (Arc::clone(&main.world), piece(&main.world));
    let (mut now, middle_m) = sunk_with_jaws(&mut main, &pages[1], object);
    let (mut tick, mut apart_m) = (SINKS, world.case.tool.jaws().unwrap().opening_m + CLOSES_M);
    while core_of(&now).held == 0 {
        (tick, apart_m) = (tick + 1, apart_m - CLOSES_M);
        assert!(apart_m > 0.0, "nothing is between the jaws");
        now = fed(&mut main, &pages[1], &now, &at(&world, tick, (middle_m, apart_m), (0.0, IN_M)));
    }
    let (held, hold_m) = (core_of(&now).held, core_of(&now).hold_m);
    assert_eq!(hold_m, apart_m);
    for step in 1..=TREMBLES {
        tick += 1;
        now = fed(&mut main, &pages[1], &now, &at(&world, tick, (middle_m, hold_m - TREMBLE_M * (step % 2) as f32), (0.0, IN_M)));
        assert_eq!(core_of(&now).held, held, "after {step} ticks");
    }
    let mut before = now.clone();
    while core_of(&now).held > 0 {
        (tick, apart_m) = (tick + 1, apart_m + SLOWLY_M);
        assert!(apart_m < hold_m + LOOSE_M + 2.0 * SLOWLY_M, "jaws that have opened by {} m hold on", apart_m - hold_m);
        before = now;
        now = fed(&mut main, &pages[1], &before, &at(&world, tick, (middle_m, apart_m), (0.0, IN_M)));
    }
    assert!(apart_m > hold_m + 0.9 * LOOSE_M, "they are {apart_m} m apart and were {hold_m}, and have let go");
    assert_eq!(core_of(&now).hold_m, 0.0, "they are solid again");
    succeeds(&mut successor, tick, bytemuck::cast_slice(&before), &now);

    // A damaged state has them farther apart than they can be.
    let before = with_core(&before, &Core { hold_m: 1e30, ..core_of(&before) });
    let open_m = world.case.tool.jaws().unwrap().opening_m;
    let open = fed(&mut main, &pages[1], &before, &at(&world, tick, (middle_m, open_m), (0.0, IN_M)));
    assert_eq!((core_of(&open).held, core_of(&open).hold_m), (0, 0.0), "fully open they have let go");
    drop((main, successor));
}
