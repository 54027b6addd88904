//! The sweep of all points at once finds what looking along each path by itself finds, also where the tissue moves.

mod common;

use common::block;
use hyst_contact::*;

const MM: f32 = 1e-3;
/// Way of a point that counts as a jump, m.
const FARTHEST_M: f32 = 8.0 * MM;

fn random(state: &mut u64) -> f32 {
    *state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
    (*state >> 40) as f32 / (1u64 << 24) as f32 - 0.5
}

#[test]
fn a_sweep_finds_what_looking_along_each_path_finds() {
    let (positions_m, tets) = block([6, 6, 1], 1.0 * MM, [0.0; 3]);
    let topology = Topology::new(&tets, &vec![0; tets.len()], &positions_m).unwrap();
    let tet_owner = vec![0; tets.len()];
    let tissue = Tissue { positions_m: &positions_m, tets: &tets, tet_owner: &tet_owner };
    let mut state = 7u64;
    let mut place = |size_m: f32| -> [f32; 3] {
        let middle = [3.0 * MM, 3.0 * MM, 0.5 * MM];
        std::array::from_fn(|axis| middle[axis] + size_m * random(&mut state))
    };
    let mut from_m: Vec<[f32; 3]> = (0..300).map(|_| place(8.0 * MM)).collect();
    let mut to_m: Vec<[f32; 3]> = (0..300).map(|_| place(6.0 * MM)).collect();
    // Points that are nowhere, before or after, and some of tissue behind those that are looked at.
    from_m[7] = [f32::INFINITY; 3];
    to_m[8] = [f32::INFINITY; 3];
    to_m.extend([[3.0 * MM; 3]; 5]);
    let sizes = HashSizes::for_points(to_m.len());
    let mut words = vec![0u32; sizes.words()];
    let all = topology.boundary.len() as u32;
    let dt_s = 1e-3;
    for (layout, velocity) in [(Layout::Auto, [0.0; 3]), (Layout::Hashed, [0.0, 0.0, -2.0]), (Layout::Auto, [1.0, -0.5, 2.0])] {
        HashMut::in_words(&mut words, sizes).unwrap().build(&to_m, 1.0 * MM, layout).unwrap();
        let hash = HashRef::in_words(&words).unwrap();
        let velocity_m_s = vec![velocity; positions_m.len()];
        let input = SweepInput {
            hash: &hash,
            from_m: &from_m,
            tissue,
            velocity_m_s: &velocity_m_s,
            dt_s,
            topology: &topology,
            farthest_m: FARTHEST_M,
        };
        let mut entered = vec![None; from_m.len()];
        sweep(&input, &mut entered).unwrap();
        let mut crossed = 0;
        for (point, entered) in entered.iter().enumerate() {
            let from: [f32; 3] = std::array::from_fn(|axis| from_m[point][axis] + velocity[axis] * dt_s);
            let way_m = from.iter().zip(to_m[point]).map(|(a, b)| (a - b).powi(2)).sum::<f32>().sqrt();
            let wanted = first_crossing(from, to_m[point], Sense::In, &positions_m, &topology.boundary, 0..all);
            let wanted = wanted.filter(|_| way_m <= FARTHEST_M);
            // The tissue's way is a mean over the corners of a triangle, so the last bits differ.
            match (entered, wanted) {
                (Some(found), Some(wanted)) => {
                    assert!((found.fraction - wanted.fraction).abs() < 1e-4, "point {point}: {found:?}, {wanted:?}");
                }
                (found, wanted) => assert_eq!(found.is_some(), wanted.is_some(), "point {point} with {velocity:?}"),
            }
            crossed += usize::from(entered.is_some());
        }
        assert!(crossed > 30, "{crossed} paths go in");
    }
    let mut short = vec![None; 3];
    let hash = HashRef::in_words(&words).unwrap();
    let velocity_m_s = vec![[0.0; 3]; positions_m.len()];
    let (hash, velocity_m_s) = (&hash, &velocity_m_s[..]);
    let input = SweepInput { hash, from_m: &from_m, tissue, velocity_m_s, dt_s, topology: &topology, farthest_m: FARTHEST_M };
    assert!(sweep(&input, &mut short).is_err(), "no room for every point");
}
