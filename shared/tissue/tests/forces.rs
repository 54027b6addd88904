//! Forces between objects, from fluids, and on surfaces.

mod common;

use common::{Body, block, options};
use hyst_mesh::Binding;
use hyst_tissue::{
    Attachment, ContactLaw, Material, Model, ModelError, Options, PairSpring, StepInput, gather, join, pressure_forces, scatter,
    surface_update,
};

#[test]
fn a_scattered_force_keeps_its_sum_and_its_moment() {
    let position = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [5.0, 5.0, 5.0]];
    let (tet, weights, force) = ([3, 1, 0, 2], [0.125, 0.25, 0.5, 0.125], [1.0, 2.0, -4.0]);
    let mut out = [[0.0; 3]; 5];
    assert!(scatter(tet, weights, force, &mut out));
    let sum = [0, 1, 2].map(|axis| out.iter().map(|f: &[f32; 3]| f[axis]).sum::<f32>());
    assert_eq!(sum, force);
    let at = gather(tet, weights, &position).unwrap();
    let moment: f32 = out.iter().zip(position).map(|(f, x)| x[0] * f[1] - x[1] * f[0]).sum();
    assert_eq!(moment, at[0] * force[1] - at[1] * force[0]);
    let before = out;
    assert!(!scatter([0, 1, 2, 9], weights, force, &mut out) && !scatter(tet, weights, [f32::NAN; 3], &mut out));
    assert_eq!(out, before);
}

#[test]
fn pressure_pushes_against_the_normal_and_cancels_on_a_closed_surface() {
    let position = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 3.0, 0.0], [0.0, 0.0, 1.0]];
    let mut out = [[0.0; 3]; 4];
    assert_eq!(pressure_forces(&[[0, 1, 2]], &position, &[10.0], &mut out), 0);
    // Area 3 m², normal +z: 30 N downwards, 10 N at each corner.
    assert_eq!(out, [[0.0, 0.0, -10.0], [0.0, 0.0, -10.0], [0.0, 0.0, -10.0], [0.0; 3]]);
    let closed = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
    let mut out = [[0.0; 3]; 4];
    pressure_forces(&closed, &position, &[7.0; 4], &mut out);
    for axis in 0..3 {
        assert!(out.iter().map(|f| f[axis]).sum::<f32>().abs() < 1e-5);
    }
    assert_eq!(pressure_forces(&[[0, 1, 9], [0, 1, 2]], &position, &[1.0], &mut out), 2);
}

#[test]
fn a_bound_surface_follows_a_linear_motion_exactly() {
    let mesh = block([2, 2, 2], 1.0);
    let moved: Vec<[f32; 3]> = mesh.positions_m.iter().map(|p| [2.0 * p[0] + p[1], p[1] - p[2], 0.5 * p[2] + 1.0]).collect();
    let bind = |tet, weights| Binding { tet, weights };
    let bindings = [bind(0, [0.25; 4]), bind(7, [0.5, 0.5, 0.0, 0.0]), bind(999, [0.25; 4])];
    let (mut rest, mut out) = ([[0.0; 3]; 3], [[9.0; 3]; 3]);
    surface_update(&bindings, &mesh.tets, &mesh.positions_m, &mut rest);
    assert_eq!(surface_update(&bindings, &mesh.tets, &moved, &mut out), 1);
    for (p, q) in rest.iter().zip(out).take(2) {
        assert_eq!(q, [2.0 * p[0] + p[1], p[1] - p[2], 0.5 * p[2] + 1.0]);
    }
    assert_eq!(out[2], [9.0; 3], "a vertex without a tet stays where it is");
}

/// A polyp on a wall as one model, and the attachments of its foot.
fn polyp_on_wall(stiffness_n_m: f32) -> (Body, Vec<Attachment>, usize) {
    let wall = block([4, 4, 2], 0.003);
    let mut polyp = block([2, 2, 3], 0.002);
    polyp.positions_m.iter_mut().for_each(|p| *p = [p[0] + 0.0045, p[1] + 0.0045, p[2] + 0.0055]);
    polyp.regions.fill(1);
    let (mesh, starts) = join(&[&wall, &polyp]).unwrap();
    assert_eq!(starts, [0, 75, 75 + 36]);
    let attachments = (75..75 + 9).map(|node: u32| {
        let p = nalgebra::Vector3::from(mesh.positions_m[node as usize]);
        let (tet, weights) = wall
            .tets
            .iter()
            .find_map(|tet| {
                let x = tet.map(|i| nalgebra::Vector3::from(wall.positions_m[i as usize]));
                let edges = nalgebra::Matrix3::from_columns(&[x[1] - x[0], x[2] - x[0], x[3] - x[0]]);
                let w = edges.try_inverse()? * (p - x[0]);
                let weights = [1.0 - w.sum(), w[0], w[1], w[2]];
                weights.iter().all(|&w| w >= -1e-4).then(|| (*tet, weights.map(|w| w.clamp(0.0, 1.0))))
            })
            .expect("the foot lies in the wall");
        Attachment { node, tet, weights, stiffness_n_m }
    });
    let held: Vec<bool> = (0..mesh.positions_m.len()).map(|i| i < 75 && mesh.positions_m[i][2] == 0.0).collect();
    let materials =
        [(0, Material::new(10_000.0, 0.45, 1000.0, 20.0).unwrap()), (1, Material::new(4_000.0, 0.4, 1000.0, 20.0).unwrap())];
    let options = Options { contact_stiffness_n_m: 400.0, ..options() };
    let (model, _) = Model::with_materials(&mesh, &held, &materials, options).unwrap();
    (Body::new(model), attachments.collect(), starts[1])
}

#[test]
fn a_polyp_hangs_on_its_wall_and_comes_off_when_its_stalk_is_cut() {
    let (mut body, attachments, first) = polyp_on_wall(100.0);
    let pull: Vec<[f32; 3]> = (0..body.force_n.len()).map(|i| if i < first { [0.0; 3] } else { [1e-5, 0.0, 2e-5] }).collect();
    let mut input = StepInput { external_force_n: &pull, attachments: &attachments, ..StepInput::default() };
    for _ in 0..1500 {
        let report = body.step_with(&input);
        assert_eq!((report.ignored_springs, report.capped_nodes, report.recovered_nodes), (0, 0, 0));
    }
    let fastest = body.velocity_m_s.iter().flatten().fold(0.0f32, |a, v| a.max(v.abs()));
    assert!(fastest < 1e-3, "not at rest after 1.5 s: {fastest} m/s");
    // At rest the stalk carries what pulls on the polyp: 36 nodes with 20 µN each.
    let carried: f32 = attachments
        .iter()
        .map(|a| {
            let place = gather(a.tet, a.weights, &body.position_m).unwrap();
            a.stiffness_n_m * (body.position_m[a.node as usize][2] - place[2])
        })
        .sum();
    assert!((carried / 7.2e-4 - 1.0).abs() < 0.03, "the stalk carries {carried} N");
    input.attachments = &[];
    let before = body.position_m[first][2];
    for _ in 0..100 {
        body.step_with(&input);
    }
    assert!(body.position_m[first][2] > before + 0.001, "the polyp stays though its stalk is cut");
}

#[test]
fn an_attachment_pulls_both_ends_alike_and_is_softened_to_what_is_stable() {
    let (mut body, mut attachments, first) = polyp_on_wall(1e6);
    body.velocity_m_s[first..].fill([0.1, 0.0, 0.2]);
    attachments[0].weights = [0.5; 4];
    let input = StepInput { attachments: &attachments, ..StepInput::default() };
    let start = body.energy_j();
    for _ in 0..500 {
        let report = body.step_with(&input);
        assert_eq!((report.ignored_springs, report.softened_springs, report.capped_nodes), (1, 8, 0));
    }
    assert!(body.energy_j() < start);
}

/// A block of 4 × 4 × 2 cells of 3 mm, and above it, nothing held, a cube of 2 × 2 × 2 of 2 mm whose lowest nodes lie 0.5 mm deep in the block's uppermost
/// layer; with each of them the tet that it lies in.
fn cube_in_block() -> (Body, Vec<PairSpring>, usize) {
    let wall = block([4, 4, 2], 0.003);
    let mut cube = block([2, 2, 2], 0.002);
    cube.positions_m.iter_mut().for_each(|p| *p = [p[0] + 0.0041, p[1] + 0.0041, p[2] + 0.0055]);
    let (mesh, starts) = join(&[&wall, &cube]).unwrap();
    let deep = (starts[1]..starts[2]).filter(|node| mesh.positions_m[*node][2] < 0.006);
    let pairs = deep.map(|node| {
        let p = nalgebra::Vector3::from(mesh.positions_m[node]);
        let holds = |tet: &&[u32; 4]| {
            let x = tet.map(|i| nalgebra::Vector3::from(wall.positions_m[i as usize]));
            let w = nalgebra::Matrix3::from_columns(&[x[1] - x[0], x[2] - x[0], x[3] - x[0]]).try_inverse().unwrap() * (p - x[0]);
            (1.0 - w.sum()).min(w.min()) >= -1e-5
        };
        let tet = *wall.tets.iter().find(holds).expect("the node lies in the block");
        let x = tet.map(|i| nalgebra::Vector3::from(wall.positions_m[i as usize]));
        let w = nalgebra::Matrix3::from_columns(&[x[1] - x[0], x[2] - x[0], x[3] - x[0]]).try_inverse().unwrap() * (p - x[0]);
        let weights = [1.0 - w.sum(), w[0], w[1], w[2]].map(|weight| weight.clamp(0.0, 1.0));
        let (normal, sticks_at_m) = ([0.0, 0.0, 1.0], [0.0; 3]);
        PairSpring { node: node as u32, tet, weights, normal, depth_m: 5e-4, sticks_at_m, stiffness_n_m: 0.3 }
    });
    let pairs: Vec<PairSpring> = pairs.collect();
    assert_eq!(pairs.len(), 9);
    let held = vec![false; mesh.positions_m.len()];
    let material = Material::new(10_000.0, 0.45, 1000.0, 0.0).unwrap();
    let options = Options { contact_stiffness_n_m: 400.0, ..options() };
    (Body::new(Model::new(&mesh, &held, &material, options).unwrap().0), pairs, starts[1])
}

#[test]
fn what_lies_in_each_other_is_pushed_apart_and_neither_gains_what_the_other_does_not_lose() {
    part_by(ContactLaw::default());
    part_by(ContactLaw { damping_s: 1e-4, friction: 0.3, ..ContactLaw::default() });
}

fn part_by(law: ContactLaw) {
    let (mut body, pairs, first) = cube_in_block();
    let input = StepInput { pairs: &pairs, law, ..StepInput::default() };
    let momentum = |body: &Body| -> [f64; 2] {
        let along = |(velocity, mass): (&[f32; 3], &f32)| f64::from(velocity[2]) * f64::from(*mass);
        let all: Vec<f64> = body.velocity_m_s.iter().zip(body.model.mass_kg()).map(along).collect();
        [all[..first].iter().sum(), all[first..].iter().sum()]
    };
    let report = body.step_with(&input);
    assert_eq!((report.ignored_springs, report.softened_springs), (0, 0));
    // Nine nodes, 0.3 N/m, half a millimetre, a millisecond.
    let [of_block, of_cube] = momentum(&body);
    assert!((of_cube / (9.0 * 0.3 * 5e-4 * 1e-3) - 1.0).abs() < 0.1, "the cube has {of_cube} N·s");
    assert!((of_block + of_cube).abs() < 1e-3 * of_cube, "{of_block} and {of_cube} N·s");
    let deepest = |body: &Body| {
        let left = |pair: &PairSpring| {
            body.position_m[pair.node as usize][2] - gather(pair.tet, pair.weights, &body.position_m).unwrap()[2]
        };
        pairs.iter().map(|pair| pair.depth_m - left(pair)).fold(f32::MIN, f32::max)
    };
    for _ in 0..200 {
        body.step_with(&input);
    }
    // Once apart they are pushed no more, and fly on as they are.
    assert!(deepest(&body) < 0.0, "still {} m in each other", deepest(&body));
    let [of_block, of_cube] = momentum(&body);
    assert!(of_cube > 0.0 && (of_block + of_cube).abs() < 1e-2 * of_cube, "{of_block} and {of_cube} N·s");
}

#[test]
fn a_contact_of_two_parts_is_softened_to_what_is_stable_and_nonsense_is_left_out() {
    let (mut body, mut pairs, _) = cube_in_block();
    pairs.iter_mut().for_each(|pair| pair.stiffness_n_m = 1e7);
    pairs[0].normal = [0.0, 0.0, 2.0];
    pairs[1].depth_m = f32::NAN;
    pairs[2].node = 9_999;
    pairs[3].sticks_at_m = [0.0, f32::INFINITY, 0.0];
    let input = StepInput { pairs: &pairs, ..StepInput::default() };
    for _ in 0..300 {
        let report = body.step_with(&input);
        assert_eq!((report.ignored_springs, report.softened_springs, report.capped_nodes, report.recovered_nodes), (4, 5, 0, 0));
    }
}

#[test]
fn a_region_without_a_material_is_refused() {
    let mut mesh = block([1, 1, 1], 0.003);
    mesh.regions[2] = 7;
    let material = Material::new(10_000.0, 0.45, 1000.0, 20.0).unwrap();
    let made = Model::with_materials(&mesh, &[false; 8], &[(0, material)], options()).map(|made| made.1);
    assert_eq!(made, Err(ModelError::Region { tet: 2, region: Some(7) }));
}
