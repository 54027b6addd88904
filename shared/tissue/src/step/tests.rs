//! Promise of a step: what makes it cheaper changes no bit of what it writes.

use super::*;
use crate::links::{Attachment, PairSpring};
use crate::material::Material;
use crate::model::Options;
use hyst_mesh::{Binding, TetMesh};

/// Cubes along each axis.
const CELLS: u32 = 3;
const EDGE_M: f32 = 0.004;
const STEPS: usize = 12;
/// Of tets that hold their own volume, and of such whose nodes do.
const POISSON_RATIOS: [f64; 2] = [0.45, 0.49];
/// Each order of the three axes is a path from the lowest to the highest corner of a cube, and so a tet; whether it is an odd one.
const PATHS: [([usize; 3], bool); 6] =
    [([0, 1, 2], false), ([1, 2, 0], false), ([2, 0, 1], false), ([0, 2, 1], true), ([2, 1, 0], true), ([1, 0, 2], true)];

/// A cube of cubes, each cut into 6 tets along its diagonal.
fn block() -> TetMesh {
    let index = |at: [u32; 3]| at[0] + (CELLS + 1) * (at[1] + (CELLS + 1) * at[2]);
    let places = |end: u32| (0..end).flat_map(move |z| (0..end).flat_map(move |y| (0..end).map(move |x| [x, y, z])));
    let mut mesh = TetMesh::default();
    mesh.positions_m.extend(places(CELLS + 1).map(|at| at.map(|i| i as f32 * EDGE_M)));
    for from in places(CELLS) {
        for (path, odd) in PATHS {
            let (mut at, mut tet) = (from, [index(from); 4]);
            for (corner, axis) in path.into_iter().enumerate() {
                at[axis] += 1;
                tet[corner + 1] = index(at);
            }
            if odd {
                tet.swap(2, 3);
            }
            mesh.tets.push(tet);
            mesh.regions.push(0);
        }
    }
    mesh
}

/// Its model, with the lowest layer held.
fn model(isa: Isa) -> Model {
    model_of(&block(), isa, 0.45, None)
}

fn model_of(mesh: &TetMesh, isa: Isa, poisson_ratio: f64, omega_rest_per_s: Option<f64>) -> Model {
    let fixed: Vec<bool> = mesh.positions_m.iter().map(|place| place[2] == 0.0).collect();
    let material = Material::new(10_000.0, poisson_ratio, 1000.0, 5.0).unwrap();
    let options = Options { isa, contact_stiffness_n_m: 200.0, max_substeps: 32, omega_rest_per_s, ..Options::default() };
    Model::new(mesh, &fixed, &material, options).unwrap().0
}

fn sets() -> impl Iterator<Item = Isa> {
    [Isa::Baseline, Isa::Avx2, Isa::Avx512].into_iter().filter(|isa| isa.available())
}

/// Springs of every kind, some of them softened and one of each kind that cannot be used.
struct Held {
    springs: Vec<PlaneSpring>,
    pairs: Vec<PairSpring>,
    holds: Vec<Hold>,
    attachments: Vec<Attachment>,
}

impl Held {
    fn of(model: &Model) -> Held {
        let tets = model.tets();
        let count = model.node_count() as u32;
        let (weights, top_m) = ([0.4, 0.3, 0.2, 0.1], CELLS as f32 * EDGE_M);
        let spring = |tet: usize| PlaneSpring {
            nodes: tets[tet],
            weights,
            normal: [0.0, 0.0, -1.0],
            offset_m: -0.5 * top_m,
            velocity_m_s: [0.01, 0.0, -0.02],
            sticks_at_m: [0.001, 0.002, 0.5 * top_m],
            stiffness_n_m: 300.0,
        };
        let pair = |tet: usize| PairSpring {
            node: count - 1 - tet as u32,
            tet: tets[tet],
            weights,
            normal: [0.6, 0.0, 0.8],
            depth_m: 0.009,
            sticks_at_m: [0.002, -0.001, 0.004],
            stiffness_n_m: 50.0,
        };
        let hold = |tet: usize| Hold {
            nodes: tets[tet],
            weights,
            place_m: [0.0, 0.5 * top_m, top_m],
            velocity_m_s: [0.0; 3],
            stiffness_n_m: 80.0,
        };
        let attachment = |tet: usize| Attachment { node: count - 2 - tet as u32, tet: tets[tet], weights, stiffness_n_m: 150.0 };
        let last = tets.len() - 1;
        Held {
            springs: vec![spring(last), PlaneSpring { weights: [2.0; 4], ..spring(1) }, spring(last - 1), spring(last - 7)],
            pairs: vec![pair(0), PairSpring { node: count, ..pair(1) }, pair(2)],
            holds: vec![Hold { stiffness_n_m: f32::NAN, ..hold(3) }, hold(last - 2)],
            attachments: vec![attachment(1), Attachment { weights: [0.5; 4], ..attachment(2) }, attachment(4)],
        }
    }
}

/// Bits of a state after some steps, with what is done to the scratch before each.
fn stepped(model: &Model, scratch: &mut Scratch, change: impl Fn(&mut Scratch)) -> Vec<u32> {
    let held = Held::of(model);
    let (mut position_m, mut velocity_m_s) = (model.rest_m().to_vec(), vec![[0.0; 3]; model.node_count()]);
    for _ in 0..STEPS {
        let (mut next_m, mut next_m_s) = (position_m.clone(), velocity_m_s.clone());
        change(scratch);
        let law = ContactLaw { damping_s: 6e-4, friction: 0.05, most_n: 5.0 };
        let Held { springs, pairs, holds, attachments } = &held;
        let input = StepInput { springs, pairs, holds, attachments, law, ..StepInput::default() };
        let now = StateRef { position_m: &position_m, velocity_m_s: &velocity_m_s };
        let next = StateMut { position_m: &mut next_m, velocity_m_s: &mut next_m_s };
        let report = step(model, scratch, now, &input, next).unwrap();
        assert!(report.ignored_springs == 4 && report.softened_springs > 0, "{report:?}");
        (position_m, velocity_m_s) = (next_m, next_m_s);
    }
    assert!(position_m != model.rest_m(), "nothing has moved");
    position_m.iter().chain(&velocity_m_s).flatten().map(|number| number.to_bits()).collect()
}

#[test]
fn springs_that_are_weighed_once_a_step_do_what_those_do_that_are_weighed_in_every_substep() {
    for isa in sets() {
        let model = model(isa);
        let with_room = |room: usize| stepped(&model, &mut Scratch::new(&model), |scratch| scratch.ready.truncate(room));
        let kept = with_room(READY_MAX);
        // None is kept, some of each kind, and all but the last.
        for room in [0, 3, 5, 8, 11] {
            assert!(with_room(room) == kept, "{isa:?}, with room for {room}");
        }
    }
}

#[test]
fn nodes_that_16_bits_name_are_those_that_32_bits_name() {
    for (isa, poisson_ratio) in sets().flat_map(|isa| POISSON_RATIOS.map(|ratio| (isa, ratio))) {
        let short = model_of(&block(), isa, poisson_ratio, None);
        let Corners::Short(corners) = &short.corners else { panic!("a small model") };
        let wide = |block: &[[u16; LANES]; 4]| block.map(|lanes| lanes.map(layout::short_node));
        let long = Model { corners: Corners::Long(corners.iter().map(wide).collect()), ..short.clone() };
        let [by_short, by_long] = [&short, &long].map(|model| stepped(model, &mut Scratch::new(model), |_| {}));
        assert!(by_short == by_long, "{isa:?}, ν = {poisson_ratio}");
    }
}

#[test]
fn nodes_whose_numbers_16_bits_do_not_hold_move_as_the_same_ones_with_low_numbers_do() {
    // So many that no tet uses come before them.
    const UNUSED: usize = layout::SHORT_NODES + 101;
    let low_mesh = block();
    let mut high_mesh = low_mesh.clone();
    high_mesh.positions_m = [vec![[0.0; 3]; UNUSED], high_mesh.positions_m].concat();
    high_mesh.tets.iter_mut().flatten().for_each(|node| *node += UNUSED as u32);
    for (isa, poisson_ratio) in sets().flat_map(|isa| POISSON_RATIOS.map(|ratio| (isa, ratio))) {
        let low = model_of(&low_mesh, isa, poisson_ratio, None);
        let high = model_of(&high_mesh, isa, poisson_ratio, Some(low.omega_rest_per_s));
        assert!(matches!((&low.corners, &high.corners), (Corners::Short(_), Corners::Long(_))));
        assert_eq!([&low, &high].map(|model| model.bulk.is_some()), [poisson_ratio > 0.45; 2]);
        let [of_low, of_high] = [&low, &high].map(|model| stepped(model, &mut Scratch::new(model), |_| {}));
        let (places, velocities) = of_high.split_at(of_high.len() / 2);
        assert!([&places[3 * UNUSED..], &velocities[3 * UNUSED..]].concat() == of_low, "{isa:?}, ν = {poisson_ratio}");
    }
}

#[test]
fn a_scratch_that_was_another_models_is_as_good_as_a_new_one() {
    let mut mesh = block();
    mesh.tets.truncate(48);
    mesh.regions.truncate(48);
    let material = Material::new(5_000.0, 0.4, 1000.0, 5.0).unwrap();
    let options = Options { contact_stiffness_n_m: 200.0, max_substeps: 32, ..Options::default() };
    let fixed = vec![false; mesh.positions_m.len()];
    let (part, _) = Model::new(&mesh, &fixed, &material, options).unwrap();
    let (whole, mut used) = (model(options.isa), Scratch::new(&part));
    let new = [&part, &whole].map(|model| stepped(model, &mut Scratch::new(model), |_| {}));
    for round in 0..2 {
        for (model, new) in [&part, &whole].into_iter().zip(&new) {
            used.fit(model);
            assert!(stepped(model, &mut used, |_| {}) == *new, "round {round}");
        }
    }
}

/// What is added to forces that are there, with the rotations and by itself, where the mesh is sheared, turned and torn about.
fn added<S: Lanes>(simd: S, model: &Model) -> [Vec<Row>; 2] {
    let Corners::Short(corners) = &model.corners else { panic!("a small model") };
    let Scratch { mut position, mut frames, .. } = Scratch::new(model);
    let nodes: &mut [[f32; 4]] = bytemuck::cast_slice_mut(&mut position);
    for (node, (place, [x, y, z])) in nodes.iter_mut().zip(model.rest_m()).enumerate() {
        let apart = 2e-3 * (node * node % 7) as f32;
        *place = [1.2 * x - 0.6 * y + apart, 0.6 * x + 0.9 * y, z - 0.3 * x - apart, 0.0];
    }
    let [mut together, mut apart] = [(); 2].map(|()| vec![Row([-1.5e-3; LANES]); position.len()]);
    let (corners, blocks, rest, seen) = (&corners[..], &model.blocks[..], &model.rest_blocks[..], ShortNodes::of(&position));
    let written = (&mut frames[..], ShortNodes::of_mut(&mut together));
    let sums = kernel::rotations_and_forces(simd, corners, (blocks, rest), seen, written);
    kernel::element_forces(simd, corners, (blocks, &frames[..]), seen, ShortNodes::of_mut(&mut apart));
    assert!(sums.energy_j.0.iter().sum::<f32>() > 0.0 && sums.inverted.0.iter().sum::<f32>() > 0.0, "{sums:?}");
    assert!(together[..16] != vec![Row([-1.5e-3; LANES]); 16]);
    [together, apart]
}

#[test]
fn forces_that_come_with_the_rotations_are_those_that_are_added_by_themselves() {
    for isa in sets() {
        let model = model(isa);
        let [together, apart] = match isa {
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2 => added(pulp::x86::V3::try_new().unwrap(), &model),
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 => added(pulp::x86::V4::try_new().unwrap(), &model),
            _ => added(pulp::Scalar::new(), &model),
        };
        let bits = |rows: &[Row]| bytemuck::cast_slice::<Row, u32>(rows).to_vec();
        assert!(bits(&together) == bits(&apart), "{isa:?}");
    }
}

#[test]
fn a_surface_that_is_moved_by_the_rows_of_a_step_is_that_of_the_state_which_it_wrote() {
    let model = model(Isa::detect());
    let (rest_m, mut scratch) = (model.rest_m(), Scratch::new(&model));
    let bound = |at: u32| Binding { tet: at % 170, weights: [0.7 - 0.01 * at as f32, 0.01 * at as f32, 0.5, -0.2] };
    let bindings: Vec<Binding> = (0..300).map(bound).collect();
    let mut surface = BoundSurface::new(&bindings[100..], &model.tets()[..50]);
    surface.fit(&bindings, model.tets());
    // A held node comes from where it must not be, and one goes where it is told.
    let mut position_m = rest_m.to_vec();
    (position_m[0], position_m[20][1]) = ([f32::NAN; 3], position_m[20][1] + 0.001);
    let targets_m: Vec<[f32; 3]> = rest_m.iter().map(|[x, y, z]| [x + 1e-4, y - 1e-5, *z]).collect();
    let velocity_m_s = vec![[0.1, 0.0, -0.2]; rest_m.len()];
    let (mut next_m, mut next_m_s) = (vec![[0.0; 3]; rest_m.len()], vec![[0.0; 3]; rest_m.len()]);
    let now = StateRef { position_m: &position_m, velocity_m_s: &velocity_m_s };
    let next = StateMut { position_m: &mut next_m, velocity_m_s: &mut next_m_s };
    step(&model, &mut scratch, now, &StepInput { targets_m: &targets_m, ..StepInput::default() }, next).unwrap();
    let [mut by_rows, mut by_state] = [(); 2].map(|()| vec![[9.0f32; 3]; bindings.len() + 1]);
    let left = crate::surface_update(&bindings, model.tets(), &next_m, &mut by_state);
    assert_eq!(scratch.move_surface(&surface, &mut by_rows), left);
    assert!(left > 1 && left < 50, "{left} vertices are left");
    let bits = |points: &[[f32; 3]]| bytemuck::cast_slice::<[f32; 3], u32>(points).to_vec();
    assert!(bits(&by_rows) == bits(&by_state));
}

/// Bits of a state after some steps under forces, with targets, and with what is done to the positions before each.
fn pushed(model: &Model, targets_m: &[[f32; 3]], change: impl Fn(&mut [[f32; 3]])) -> Vec<u32> {
    let (mut position_m, mut velocity_m_s) = (model.rest_m().to_vec(), vec![[0.0; 3]; model.node_count()]);
    let force_n: Vec<[f32; 3]> = (0..model.node_count()).map(|node| [1e-4 * (node % 5) as f32, -0.0, 2e-4]).collect();
    let mut scratch = Scratch::new(model);
    for _ in 0..STEPS {
        let (mut next_m, mut next_m_s) = (position_m.clone(), velocity_m_s.clone());
        change(&mut position_m);
        let input = StepInput { external_force_n: &force_n, targets_m, ..StepInput::default() };
        let now = StateRef { position_m: &position_m, velocity_m_s: &velocity_m_s };
        let next = StateMut { position_m: &mut next_m, velocity_m_s: &mut next_m_s };
        step(model, &mut scratch, now, &input, next).unwrap();
        (position_m, velocity_m_s) = (next_m, next_m_s);
    }
    assert!(position_m != model.rest_m(), "nothing has moved");
    position_m.iter().chain(&velocity_m_s).flatten().map(|number| number.to_bits()).collect()
}

#[test]
fn numbers_that_are_looked_at_together_are_taken_as_those_that_are_looked_at_one_by_one() {
    for isa in sets() {
        let model = model(isa);
        let together = pushed(&model, &[], |_| {});
        // The first node is held: one that is nowhere is put back to where it is.
        let read = pushed(&model, &[], |position_m| position_m[0] = [f32::NAN; 3]);
        // Held nodes are told to be where they are.
        let written = pushed(&model, model.rest_m(), |_| {});
        assert!(together == read && together == written, "{isa:?}");
    }
}
