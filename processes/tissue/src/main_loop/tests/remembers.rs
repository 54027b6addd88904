//! Promise of the Main Loop about the test of the points: the tets near them are looked for once in a while, and not in each step.

use super::*;

const TICKS: u64 = 400;
/// Steps for each search, at least: some dozen in a press.
const STEPS_OF_ONE: u64 = 6;

#[test]
fn a_hand_that_presses_has_the_tets_near_it_looked_for_in_few_of_the_steps() {
    let (station, pages, life, mut inbox) = begun("remembers");
    let mut main = engine(&station, &life, &mut inbox);
    let scene = hyst_scene::load_embedded().unwrap();
    let hand = scene.hand("press").unwrap();
    let (mut now, mut met) = (first_state(&mut main), 0);
    for tick in 1..=TICKS {
        let pose = hand.pose_at(0.25 * hand.period_s + 1e-3 * tick as f64);
        let pose = main.world.case.pose_of(&pose);
        now = stepped(&mut main, &pages[1], &now, tick, pose, PieceFlow::default());
        met += usize::from(!main.collision.hits().is_empty());
    }
    let searches = main.collision.searches();
    println!("{searches} searches in {TICKS} steps, {met} of them with hits");
    assert!(met > 0 && (1..TICKS / STEPS_OF_ONE).contains(&searches), "{searches} searches, {met} steps with hits");
}
