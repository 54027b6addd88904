//! The device beside two servos of which one lies, stands still, or is late.

use super::*;
use hyst_exchange::{OwnedPage, Station};

/// What the device takes in a tick if the servos say this: the force along y, and the flags; `None` says nothing in this tick.
fn taken(life: &Life, replicas: &mut Replicas, pages: &[OwnedPage; 2], tick: u64, said: [Option<(f32, u32)>; 2]) -> Option<f32> {
    let input = InputRecord { tick, ..InputRecord::default() };
    for (page, said) in pages.iter().zip(said) {
        let Some((newton, flags)) = said else { continue };
        say(page, &input, [0.0, newton, 0.0], flags);
    }
    replicas.choose(life, &input, &LastHopParams::default(), 0).force_n.map(|force_n| force_n[1])
}

/// A device and two servos, seated.
fn seated(name: &str) -> (Station, Life, [OwnedPage; 2], Replicas) {
    let station = Station::named(&format!("t{}-{name}", std::process::id())).unwrap();
    station.wipe();
    station.found().unwrap();
    std::fs::write(station.settings(), "").unwrap();
    drop(station.create_slot(slot(Role::Device, 0), 1).unwrap());
    let life = Life::begin(station.name(), slot(Role::Device, 0), 1).unwrap();
    let pages = [0, 1].map(|index| station.create_slot(slot(Role::Haptic, index), 2 + index as u32).unwrap());
    let mut replicas = Replicas::default();
    for index in 0..2 {
        let page = station.read_slot(slot(Role::Haptic, index), 2 + index as u32).unwrap();
        assert!(replicas.seat(index, page, &life).is_none());
    }
    (station, life, pages, replicas)
}

fn slot(role: Role, index: usize) -> Slot {
    Slot::new(role, index).unwrap()
}

fn say(page: &OwnedPage, input: &InputRecord, force_n: [f32; 3], flags: u32) {
    let record = ForceRecord { tick: input.tick, input_hash: input_hash(input), force_n, flags, ..Default::default() };
    page.push(haptic::FORCES, input.tick, &record);
    page.write(haptic::FORCE, &record);
    page.store64(header::TICK, input.tick);
    page.bump_and_wake(header::NEWS);
}

#[test]
fn nonsense_of_the_one_that_is_followed_is_no_reason_not_to_wait_for_the_other() {
    let (station, life, [liar, other], mut replicas) = seated("nonsense");
    let begun_ns = system::now_ns();
    for (tick, nonsense) in [(1, f32::NAN), (3, 9.9), (5, f32::INFINITY)] {
        let input = InputRecord { tick, ..InputRecord::default() };
        say(&liar, &input, [0.0, nonsense, 0.0], 0);
        let chosen = std::thread::scope(|scope| {
            scope.spawn(|| {
                std::thread::sleep(std::time::Duration::from_millis(30)); // not a synchronization: the other takes its time
                say(&other, &input, [0.0, 0.1, 0.0], 0);
            });
            replicas.choose(&life, &input, &LastHopParams::default(), system::now_ns() + 60_000_000_000)
        });
        assert_eq!((chosen.force_n, chosen.incarnation), (Some([0.0, 0.1, 0.0]), 3), "{nonsense}");
        // The liar is well again, and followed for a tick.
        let input = InputRecord { tick: tick + 1, ..InputRecord::default() };
        say(&liar, &input, [0.0, 0.1, 0.0], 0);
        say(&other, &input, [0.0, f32::NAN, 0.0], 0);
        let chosen = replicas.choose(&life, &input, &LastHopParams::default(), system::now_ns() + 60_000_000_000);
        assert_eq!(chosen.incarnation, 2);
    }
    assert!(system::now_ns() - begun_ns < 50_000_000_000, "one who answered is waited for");
    drop(replicas);
    station.wipe();
}

#[test]
fn one_that_may_stand_still_is_no_reason_not_to_wait_for_the_other() {
    let (station, life, pages, mut replicas) = seated("stands");
    let word = |replicas: &Replicas, tick, newton| {
        let input = InputRecord { tick, ..InputRecord::default() };
        say(&pages[0], &input, [0.0, newton, 0.0], 0);
        replicas.word(0, tick, input_hash(&input), &LastHopParams::default())
    };
    let here = |newton| Some((newton, 0));
    assert_eq!(taken(&life, &mut replicas, &pages, 1, [here(0.0), here(0.0)]), Some(0.0));
    assert_eq!(word(&replicas, 2, 0.0), Word::Counts, "without touch each tick is like the one before");
    assert_eq!(taken(&life, &mut replicas, &pages, 2, [here(0.10), here(0.10)]), Some(0.10));
    assert_eq!([0.10, 0.11, f32::NAN].map(|newton| word(&replicas, 3, newton)), [Word::Doubted, Word::Counts, Word::Nothing]);
    let input = InputRecord { tick: 3, ..InputRecord::default() };
    say(&pages[0], &input, [0.0, 0.10, 0.0], 0);
    let chosen = std::thread::scope(|scope| {
        scope.spawn(|| {
            std::thread::sleep(std::time::Duration::from_millis(30)); // not a synchronization: the other takes its time
            say(&pages[1], &input, [0.0, 0.11, 0.0], 0);
        });
        replicas.choose(&life, &input, &LastHopParams::default(), system::now_ns() + 60_000_000_000)
    });
    assert_eq!(chosen.force_n, Some([0.0, 0.11, 0.0]), "the first, which is followed, stands");
    assert_eq!(taken(&life, &mut replicas, &pages, 4, [here(0.0), here(0.0)]), Some(0.0));
    assert_eq!(taken(&life, &mut replicas, &pages, 5, [here(0.0), here(0.02)]), Some(0.02));
    assert_eq!(taken(&life, &mut replicas, &pages, 6, [here(0.0), here(0.03)]), Some(0.03));
    assert_eq!(
        [0.0, 0.01].map(|newton| word(&replicas, 7, newton)),
        [Word::Doubted, Word::Counts],
        "nor is zero of one that stood"
    );
    drop(replicas);
    station.wipe();
}

#[test]
fn one_that_stands_still_is_found_although_it_answers_after_the_one_that_is_followed() {
    let (station, life, [liar, followed], mut replicas) = seated("late");
    let distrusted = || life.page.load64(layout::DISTRUSTED) >> 32;
    for tick in 1..=30u64 {
        let input = InputRecord { tick, ..InputRecord::default() };
        // At first neither touches; then the hand does, and the liar says zero as before.
        let newton = if tick < 10 { 0.0 } else { 0.01 * (tick - 9) as f32 };
        say(&followed, &input, [0.0, newton, 0.0], 0);
        let chosen = replicas.choose(&life, &input, &LastHopParams::default(), 0);
        assert_eq!(chosen.force_n, Some([0.0, newton, 0.0]), "tick {tick}");
        say(&liar, &input, [0.0; 3], 0);
        let is_found = distrusted() == Distrust::Frozen as u64;
        assert_eq!(is_found, tick > 9 + u64::from(STOOD_TICKS), "tick {tick}");
    }
    drop(replicas);
    station.wipe();
}

#[test]
fn the_one_that_is_followed_stays_until_it_is_not_valid_and_a_newborn_counts_only_out_of_its_shadow() {
    let (station, life, pages, mut replicas) = seated("replicas");
    let distrusted = |index: usize| life.page.load64(layout::DISTRUSTED + index) >> 32;
    let mut take = |tick, said| {
        let force_n = taken(&life, &mut replicas, &pages, tick, said);
        (force_n, replicas.selected_incarnation())
    };
    let (here, shadow) = (|newton| Some((newton, 0)), |newton| Some((newton, FORCE_SHADOW)));
    assert_eq!(take(1, [here(0.10), here(0.10)]), (Some(0.10), 2), "the first is followed");
    assert_eq!(take(2, [here(0.11), shadow(0.30)]), (Some(0.11), 2));
    assert_eq!(distrusted(1), 0, "one in its shadow does not disagree with anybody");
    assert_eq!(take(3, [shadow(0.30), here(0.12)]), (Some(0.12), 3), "nor is it taken where it was followed before");
    assert_eq!(take(4, [here(0.13), here(0.13)]), (Some(0.13), 3), "the selection stays");
    assert_eq!(take(5, [here(0.14), here(f32::NAN)]), (Some(0.14), 2));
    assert_eq!(distrusted(1), Distrust::Invalid as u64);
    assert_eq!(take(6, [None, here(0.15)]), (Some(0.15), 3), "what is of another tick is not taken");
    assert_eq!(take(7, [shadow(0.16), shadow(0.16)]).0, None, "nobody is out of the shadow");
    assert_eq!(take(8, [here(9.9), None]).0, None, "beyond any motor");
    assert_eq!(take(9, [here(0.17), None]), (Some(0.17), 2));
    let mut born = |index: usize, incarnation: u32| {
        drop(station.create_slot(slot(Role::Haptic, index), incarnation).unwrap());
        let page = station.read_slot(slot(Role::Haptic, index), incarnation).unwrap();
        assert!(replicas.seat(index, page, &life).is_some());
        replicas.selected_incarnation()
    };
    assert_eq!(born(0, 9), 3, "who sits where the one that was followed sat is another");
    let keeping = station.open_for_keeping().unwrap();
    keeping.store32(station::SLOT_INCARNATION + slot(Role::Haptic, 0).number(), 9);
    keeping.store32(station::SLOT_DEAD + slot(Role::Haptic, 0).number(), 1);
    assert_eq!(born(1, 10), 10, "the other one is dead");
    drop(replicas);
    station.wipe();
}

#[test]
fn while_force_is_withheld_who_goes_on_from_what_was_chosen_is_followed_and_not_who_is_near_to_the_little_that_is_applied() {
    let (station, life, pages, mut replicas) = seated("withheld");
    for (tick, withholds, expected_n) in [(1, false, 0.1), (4, true, 1.03)] {
        for (later, newton) in [(0, 1.01), (1, 1.02)] {
            assert_eq!(taken(&life, &mut replicas, &pages, tick + later, [Some((newton, 0)); 2]), Some(newton));
        }
        replicas.withhold(withholds);
        let chosen = taken(&life, &mut replicas, &pages, tick + 2, [Some((0.1, 0)), Some((1.03, 0))]);
        assert_eq!(chosen, Some(expected_n), "withheld: {withholds}");
        replicas.withhold(false);
    }
    drop(replicas);
    station.wipe();
}

/// The one that had answered in time was alone with that. In the replay both have, and whoever was nearer was taken, and the other one distrusted.
#[test]
fn in_a_replay_who_was_followed_is_followed_although_the_other_one_has_answered_too_and_is_nearer() {
    let (station, life, pages, mut replicas) = seated("recorded");
    let here = |newton| Some((newton, 0));
    let mut take = |tick, followed, said| {
        replicas.follow(followed);
        let force_n = taken(&life, &mut replicas, &pages, tick, said);
        (force_n, replicas.last.incarnation, replicas.last.followed)
    };
    assert_eq!(take(1, 0, [here(0.10), here(0.10)]), (Some(0.10), 2, 1), "it is not said who");
    assert_eq!(take(2, 2, [here(0.11), here(0.30)]), (Some(0.30), 3, 2));
    assert_eq!(take(3, 1, [here(0.12), here(0.11)]), (Some(0.12), 2, 1));
    assert_eq!([0, 1].map(|index| life.page.load64(layout::DISTRUSTED + index)), [0; 2], "nobody differs from whom nobody asked");
    assert_eq!(take(4, 2, [here(0.13), None]), (Some(0.13), 2, 1), "it is dead in the replay");
    assert_eq!(take(5, 2, [here(0.14), Some((0.30, FORCE_SHADOW))]), (Some(0.14), 2, 1), "and so is another in its place");
    assert_eq!(take(6, 9, [here(0.15), here(0.15)]), (Some(0.15), 2, 1), "there is no such servo");
    assert_eq!(take(7, 1, [None, None]).2, 0);
    drop(replicas);
    station.wipe();
}

#[test]
fn a_force_that_is_the_mediums_alone_is_no_touch_that_stands_still() {
    let mut record = ForceRecord { force_n: [0.003, 0.0, -0.001], ..Default::default() };
    assert_eq!(touch_n(&record), record.force_n, "the servo says of no medium");
    let words = record.servo_state.len();
    // The servo's state, of which the medium's force is the one that the record has.
    let at = (0..4 * words).find(|at| {
        let mut halves: Vec<u32> = vec![0; 2 * words];
        let Some(place) = halves.get_mut(*at..*at + 3) else { return false };
        place.copy_from_slice(&record.force_n.map(f32::to_bits));
        record.servo_state = std::array::from_fn(|word| u64::from(halves[2 * word]) | u64::from(halves[2 * word + 1]) << 32);
        ServoState::of_words(&record.servo_state).medium_n == record.force_n
    });
    assert!(at.is_some() && touch_n(&record) == [0.0; 3], "{at:?}");
    record.force_n[1] = 1e-6;
    assert_eq!(touch_n(&record), record.force_n, "and what is more is felt of tissue");
}
