//! A press with what is remembered of the step before, and without.

use super::*;

impl Press {
    /// The planes of the last step.
    pub fn planes(&self) -> &PlaneSet {
        &self.planes
    }

    /// Where the tip is in a tick, m.
    pub fn tip_m(&self, tick: usize) -> [f32; 3] {
        self.pose(tick).position_m
    }
}

#[test]
fn what_is_remembered_of_the_step_before_changes_no_bit_of_a_press() {
    let scene = crate::world::load_scene(None).unwrap();
    let open = |make: fn(&LoadedScene, Isa, usize) -> Result<Press, String>| make(&scene, Isa::detect(), 2).unwrap();
    let [mut remembering, mut searching] = [open(Press::new), open(Press::searching)];
    let [mut record, mut other] = [(); 2].map(|()| Record::default());
    for tick in 0..1_500 {
        remembering.tick(tick, &mut record).unwrap();
        searching.tick(tick, &mut other).unwrap();
        assert_eq!(record.force_n.map(f32::to_bits), other.force_n.map(f32::to_bits), "tick {tick}");
    }
    assert!(remembering.positions_m() == searching.positions_m() && record.contacts > 50, "{} contacts", record.contacts);
    let searches = |press: &Press| press.shared.shares.iter().map(|share| share.lock().2.searches()).max();
    let (made, none) = (searches(&remembering), searches(&searching));
    assert!(made.is_some_and(|made| (20..500).contains(&made)) && none == Some(0), "{made:?} searches, {none:?}");
}
