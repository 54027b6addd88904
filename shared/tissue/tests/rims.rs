//! Promise of the surface for the eye where a cut has parted it: it ends on the rim of the wound, wherever the nodes go, so that nobody looks in between.

mod common;

use common::cuts::{polyp, straight, sweep};
use common::noise;
use glam::Vec3;
use hyst_mesh::{check, component_of_each_tet};
use hyst_tissue::{CutOptions, Cuttable};
use std::collections::BTreeMap;

/// How far along each axis nodes are moved to see what stays together, m, and how near to a wound its rim stays then.
const MOVED_M: f32 = 0.2e-3;
const NEAR_M: f32 = 20e-6;
/// Strokes through one polyp after the other, and how many polyps.
const STROKES: usize = 2;
const POLYPS: u64 = 6;

/// How far a place is from an edge, m.
fn away_m(place: Vec3, [from, to]: [Vec3; 2]) -> f32 {
    let along = to - from;
    let share = ((place - from).dot(along) / along.length_squared().max(f32::MIN_POSITIVE)).clamp(0.0, 1.0);
    place.distance(from + share * along)
}

/// Where the surface ends, once each node has gone a way of its own: how many of the ends and the middles of its edges there lie on an edge of a wound of the
/// same part, and how many there are.
fn met(tissue: &Cuttable, random: &mut impl FnMut() -> f32) -> [usize; 2] {
    let (rest, skin) = (&tissue.rest, &tissue.skin);
    let moved_m: Vec<[f32; 3]> = rest.positions_m.iter().map(|place| place.map(|at| at + MOVED_M * random())).collect();
    let (placed, part_of_tet) = (skin.place(&rest.tets, &moved_m), component_of_each_tet(rest));
    let at = |vertex: u32| Vec3::from(placed[vertex as usize]);
    let part_of = |vertex: u32| part_of_tet[skin.bindings[vertex as usize].tet as usize];
    let edges = |is_raw: bool| {
        let of_kind = skin.triangles.iter().filter(move |triangle| skin.raw[triangle[0] as usize] == is_raw);
        of_kind.flat_map(|[a, b, c]| [[*a, *b], [*b, *c], [*c, *a]])
    };
    let wound: Vec<(u32, [Vec3; 2])> = edges(true).map(|[a, b]| (part_of(a), [at(a), at(b)])).collect();
    let mut triangles_at: BTreeMap<[u32; 2], usize> = BTreeMap::new();
    for [a, b] in edges(false) {
        *triangles_at.entry([a.min(b), a.max(b)]).or_insert(0) += 1;
    }
    let mut found = [0; 2];
    for ([a, b], _) in triangles_at.into_iter().filter(|(_, triangles)| *triangles == 1) {
        for place in [at(a), at(a).midpoint(at(b)), at(b)] {
            let is_met = wound.iter().any(|(part, ends)| *part == part_of(a) && away_m(place, *ends) < NEAR_M);
            found = [found[0] + usize::from(is_met), found[1] + 1];
        }
    }
    found
}

/// A direction.
fn direction(random: &mut impl FnMut() -> f32) -> Vec3 {
    Vec3::new(random(), random(), random()).normalize_or(Vec3::X)
}

/// The polyp's surface is finer than its tets, lies beside their boundary, and is closed at first. The second stroke goes through the wounds of the first.
#[test]
fn a_surface_ends_on_the_rims_of_the_wounds_wherever_the_nodes_go() {
    let whole = polyp();
    let box_around = check(&whole.rest);
    let (low, high) = (Vec3::from_array(box_around.min_m), Vec3::from_array(box_around.max_m));
    let (middle, reach_m) = (low.midpoint(high), (high - low).length());
    assert_eq!(met(&whole, &mut noise(0)), [0; 2], "it is not closed");
    let mut found = [[0; 2]; STROKES];
    for seed in 0..POLYPS {
        let (mut tissue, mut random) = (whole.clone(), noise(seed));
        for found in &mut found {
            let wire = direction(&mut random);
            let way = direction(&mut random).reject_from_normalized(wire).normalize_or(wire.any_orthonormal_vector());
            let start = middle + 0.1 * reach_m * direction(&mut random) - 0.75 * reach_m * way;
            let wires = straight(start - reach_m * wire, start + reach_m * wire, 1.5 * reach_m * way, 16);
            sweep(&mut tissue, &wires, &CutOptions::default());
            tissue.end_stroke();
            let [on_wound, all] = met(&tissue, &mut random);
            *found = [found[0] + on_wound, found[1] + all];
        }
    }
    println!("stroke by stroke, places of the rims that lie on a wound, and all of them: {found:?}");
    for [on_wound, all] in found {
        assert!(all > 500 && 4 * on_wound >= 3 * all, "{on_wound} of {all} places of the rims lie on a wound: {found:?}");
    }
}
