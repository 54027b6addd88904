//! Promise of the knife, and of who makes worlds of what it leaves: a surface that comes when all else is done leaves the world of one that is bound at once,
//! to the last bit, and tells what found no room.

use super::*;
use hyst_exchange::system;

/// Where the wire goes through the polyp, as a share of its width.
const PLACES: [f32; 3] = [0.3, 0.5, 0.7];
/// Vertices that there is room for where there is little.
const FEW: usize = 3;

/// Who binds a surface.
#[derive(Clone, Copy, Debug)]
enum Binds {
    /// The knife, within its cut.
    AtOnce,
    /// Nobody before it is asked for.
    Late,
    /// The thread beside, where the test may be as urgent as the Main Loop; else the knife.
    Beside,
}

/// What a sweep has left.
struct Left {
    world: World,
    has_parted: bool,
    is_limited: bool,
    /// Its surface came behind all else.
    has_trailed: bool,
    /// Who swept was as urgent as the thread beside has to be.
    was_urgent: bool,
}

/// Sweeps with a knife of its own, and makes the world of what is left where that is another one.
fn swept(
    workshop: &mut Workshop,
    world: &World,
    (wire_m, stroke): (&[[f32; 3]], &[u32]),
    nodes: (&[[f32; 3]], &[[f32; 3]]),
    binds: Binds,
) -> (Knife, Option<Left>) {
    let mut knife = Knife::default();
    let (wire_m, stroke): (_, &[u8]) = (Some(wire_m), bytemuck::cast_slice(stroke));
    // Refused: as an ordinary tissue.
    let was_urgent = matches!(binds, Binds::Beside) && system::become_fifo(1);
    let swept = match binds {
        Binds::AtOnce => knife.sweep(world, wire_m, stroke, nodes),
        Binds::Late => knife.sweep_by(world, wire_m, stroke, nodes, Coming::late, || ()),
        Binds::Beside => knife.sweep_by(world, wire_m, stroke, nodes, |loose, rest| workshop.bind(loose, rest), || ()),
    };
    let mut left = None;
    if let Stroke::Cut { body, held, parted, trailing, is_limited } = swept.unwrap() {
        let (has_parted, has_trailed) = (!parted.is_empty(), trailing.is_some());
        match workshop.make_sound(*body, (Some(held), trailing), false, &mut || ()) {
            Ok((world, out_of_room)) => {
                left = Some(Left { world, has_parted, is_limited: is_limited || out_of_room > 0, has_trailed, was_urgent });
            }
            Err(_) => knife.end(),
        }
    }
    system::demote(0);
    (knife, left)
}

/// Both have gone on alike, and left the same.
fn assert_alike((knife, left): &(Knife, Option<Left>), (other_knife, other): &(Knife, Option<Left>), what: &str) {
    assert!(stroke_of(knife) == stroke_of(other_knife) && knife.moved() == other_knife.moved(), "{what}: another stroke");
    assert_eq!(left.is_some(), other.is_some(), "{what}: the one has cut, and not the other");
    let Some((left, other)) = left.as_ref().zip(other.as_ref()) else { return };
    let (one, another) = (&left.world, &other.world);
    assert!(one.body == another.body && one.words == another.words && one.version == another.version, "{what}: another body");
    assert!(one.model == another.model && one.topology == another.topology, "{what}: another model");
    assert!(one.objects == another.objects && one.wall == another.wall, "{what}: other objects");
    assert_eq!((left.has_parted, left.is_limited), (other.has_parted, other.is_limited), "{what}");
}

/// Draws the wire upwards through a place of the polyp, each time bound in all ways; gives what the sweeps left whose surfaces came late: how many, how many of
/// them parted something, and how many met a limit.
fn drawn_through(scene: &LoadedScene, place: f32, room: Option<usize>) -> [usize; 3] {
    let (mut workshop, whole) = Workshop::open(scene, Isa::detect()).unwrap();
    let mut world = match room {
        Some(few) => workshop.cramp(whole, |case, body| case.room.vertices = body.skin.rest_m.len() + few),
        None => whole,
    };
    let polyp = hyst_mesh::check(&scene.objects[1].mesh);
    let (low, high) = (polyp.min_m, polyp.max_m);
    let (x, margin_m) = (low[0] + place * (high[0] - low[0]), 0.5 * (high[1] - low[1]));
    let (mut stroke, mut found) = (Vec::<u32>::new(), [0; 3]);
    let (mut positions_m, mut velocities_m_s) = (world.model.rest_m().to_vec(), vec![[0.0; 3]; world.model.node_count()]);
    let steps = ((high[2] - low[2] + 2e-3) / WAY_M) as u32;
    for step in 0..=steps {
        let z = low[2] - 1e-3 + step as f32 * WAY_M;
        let wire_m = [low[1] - margin_m, 0.5 * (low[1] + high[1]), high[1] + margin_m].map(|y| [x, y, z]);
        let nodes = (&positions_m[..], &velocities_m_s[..]);
        let mut bound = |binds: Binds| swept(&mut workshop, &world, (&wire_m[..], &stroke[..]), nodes, binds);
        let (at_once, late, beside) = (bound(Binds::AtOnce), bound(Binds::Late), bound(Binds::Beside));
        let what = format!("place {place}, step {step}, room {room:?}");
        assert_alike(&at_once, &late, &format!("{what}, late"));
        assert_alike(&at_once, &beside, &format!("{what}, beside"));
        if let Some((late, beside)) = late.1.as_ref().zip(beside.1.as_ref()).filter(|(_, beside)| beside.was_urgent) {
            let may_be_beside = system::places() > 1;
            assert!(!may_be_beside || late.has_trailed == beside.has_trailed, "{what}: the thread beside binds nothing");
        }
        if let Some(left) = late.1.filter(|left| left.has_trailed) {
            found = [found[0] + 1, found[1] + usize::from(left.has_parted), found[2] + usize::from(left.is_limited)];
        }
        let (knife, left) = at_once;
        stroke = stroke_of(&knife);
        if let Some(left) = left {
            assert!(!left.has_trailed, "{what}: it is bound at once");
            let (moved_m, moved_m_s) = knife.moved();
            (positions_m, velocities_m_s, world) = (moved_m.to_vec(), moved_m_s.to_vec(), left.world);
        }
    }
    found
}

#[test]
fn a_surface_that_comes_behind_all_else_leaves_the_world_of_one_that_is_bound_at_once() {
    let scene = hyst_scene::load_embedded().unwrap();
    let of_places = PLACES.map(|place| drawn_through(&scene, place, None));
    let [trailed, parted] = [0, 1].map(|of| of_places.iter().map(|found| found[of]).sum::<usize>());
    let cramped = drawn_through(&scene, PLACES[1], Some(FEW));
    println!("{trailed} surfaces came late, {parted} of them where something was parted; {cramped:?} with little room");
    assert!(trailed > 10 && parted > 0, "{trailed} surfaces came late, {parted} of them where something was parted");
    assert!(cramped[2] > 0, "no limit was met");
}
