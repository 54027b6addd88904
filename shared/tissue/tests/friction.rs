//! Promise of friction of tissue with tissue: what is pressed on other tissue stays there under a push of less than its share, as on a spring, and comes back;
//! under one of more it slides with what is left over; and what is rubbed gains what the other loses.

mod common;

use common::{Body, block, options};
use hyst_tissue::{ContactLaw, Material, Model, Options, PairSpring, StateRef, StepInput, gather, join, scatter};

const LAW: ContactLaw = ContactLaw { damping_s: 6e-4, friction: 0.1, most_n: 5.0 };
/// How deep the lowest nodes lie in the tissue below, m, and the stiffness of the contact of each, N/m.
const DEEP_M: f32 = 5e-4;
const STIFFNESS_N_M: f32 = 0.2;
/// What each of them is pressed with, so that nothing moves at first, and what friction holds of that, N.
const PRESSED_N: f32 = STIFFNESS_N_M * DEEP_M;
const HELD_N: f32 = LAW.friction * PRESSED_N;
/// How many they are.
const LOWEST: usize = 9;

/// A cube of 4 mm that is pressed on a block of 12 × 12 × 6 mm.
struct Pile {
    body: Body,
    pairs: Vec<PairSpring>,
    /// What each contact remembers from step to step, m.
    bent_m: Vec<[f32; 3]>,
    /// The cube's first node; those of the block come before.
    first: usize,
    /// What presses the two on each other, N.
    pressed_n: Vec<[f32; 3]>,
}

/// With a block of which each node is held, or none.
fn pile(is_held: bool) -> Pile {
    let wall = block([4, 4, 2], 0.003);
    let mut cube = block([2, 2, 2], 0.002);
    cube.positions_m.iter_mut().for_each(|p| *p = [p[0] + 0.0041, p[1] + 0.0041, p[2] + 0.006 - DEEP_M]);
    let (mesh, starts) = join(&[&wall, &cube]).unwrap();
    let (first, nodes) = (starts[1], mesh.positions_m.len());
    let weights_in = |tet: &[u32; 4], place: [f32; 3]| {
        let x = tet.map(|node| nalgebra::Vector3::from(wall.positions_m[node as usize]));
        let edges = nalgebra::Matrix3::from_columns(&[x[1] - x[0], x[2] - x[0], x[3] - x[0]]);
        let w = edges.try_inverse().unwrap() * (nalgebra::Vector3::from(place) - x[0]);
        [1.0 - w.sum(), w[0], w[1], w[2]]
    };
    let (mut pressed_n, mut pairs) = (vec![[0.0f32; 3]; nodes], Vec::new());
    for node in (first..nodes).filter(|node| mesh.positions_m[*node][2] < 0.006) {
        let place = mesh.positions_m[node];
        let holds = |tet: &&[u32; 4]| weights_in(tet, place).iter().all(|weight| *weight >= -1e-5);
        let tet = *wall.tets.iter().find(holds).expect("the node lies in the block");
        let weights = weights_in(&tet, place).map(|weight| weight.clamp(0.0, 1.0));
        let (node, normal, sticks_at_m) = (node as u32, [0.0, 0.0, 1.0], [0.0; 3]);
        pairs.push(PairSpring { node, tet, weights, normal, depth_m: DEEP_M, sticks_at_m, stiffness_n_m: STIFFNESS_N_M });
        pressed_n[node as usize][2] -= PRESSED_N;
        assert!(scatter(tet, weights, [0.0, 0.0, PRESSED_N], &mut pressed_n));
    }
    assert_eq!(pairs.len(), LOWEST);
    let held: Vec<bool> = (0..nodes).map(|node| is_held && node < first).collect();
    let material = Material::new(10_000.0, 0.45, 1000.0, 0.0).unwrap();
    let options = Options { contact_stiffness_n_m: 20.0, ..options() };
    let (model, _) = Model::new(&mesh, &held, &material, options).unwrap();
    Pile { body: Body::new(model), bent_m: vec![[0.0; 3]; LOWEST], pairs, first, pressed_n }
}

impl Pile {
    /// A step of 1 ms in which the nodes are pushed along x beside.
    fn step(&mut self, push_n: impl Fn(usize) -> f32) {
        for (pair, bent_m) in self.pairs.iter_mut().zip(&self.bent_m) {
            let point = gather(pair.tet, pair.weights, &self.body.position_m).unwrap();
            let node = self.body.position_m[pair.node as usize];
            pair.sticks_at_m = [0, 1, 2].map(|axis| node[axis] - point[axis] + bent_m[axis]);
        }
        let pushed = |(node, [x, y, z]): (usize, &[f32; 3])| [x + push_n(node), *y, *z];
        let force_n: Vec<[f32; 3]> = self.pressed_n.iter().enumerate().map(pushed).collect();
        let input = StepInput { external_force_n: &force_n, pairs: &self.pairs, law: LAW, ..StepInput::default() };
        let report = self.body.step_with(&input);
        assert_eq!((report.ignored_springs, report.softened_springs, report.corrections()), (0, 0, 0));
        let Body { model, scratch, position_m, velocity_m_s, .. } = &self.body;
        let after = StateRef { position_m, velocity_m_s };
        for (pair, bent_m) in self.pairs.iter().enumerate().zip(&mut self.bent_m) {
            let press = scratch.press(model, &LAW, pair, &after);
            assert!(press.normal_n > 0.5 * PRESSED_N, "{press:?}: it is hardly pressed any more");
            *bent_m = press.bent_m;
        }
    }

    /// Mean place of the lowest nodes along x, m.
    fn place_m(&self) -> f32 {
        self.pairs.iter().map(|pair| self.body.position_m[pair.node as usize][0]).sum::<f32>() / LOWEST as f32
    }

    fn is_lowest(&self, node: usize) -> bool {
        self.pairs.iter().any(|pair| pair.node as usize == node)
    }

    /// Mass of block and cube, kg, and their momentum along x, kg·m/s.
    fn momentum(&self) -> [[f64; 2]; 2] {
        let (mass_kg, velocity_m_s) = (self.body.model.mass_kg(), &self.body.velocity_m_s);
        let of = |nodes: std::ops::Range<usize>| {
            let own = nodes.map(|node| (f64::from(mass_kg[node]), f64::from(velocity_m_s[node][0])));
            own.fold([0.0, 0.0], |[all_kg, sum], (own_kg, speed_m_s)| [all_kg + own_kg, sum + own_kg * speed_m_s])
        };
        [of(0..self.first), of(self.first..mass_kg.len())]
    }
}

#[test]
fn what_is_pushed_with_half_of_what_friction_holds_stays_as_on_a_spring_and_comes_back() {
    const RAMP: u32 = 200;
    let mut pile = pile(true);
    let before_m = pile.place_m();
    let lowest: Vec<bool> = (0..pile.pressed_n.len()).map(|node| pile.is_lowest(node)).collect();
    let push = |pile: &mut Pile, share: f32| pile.step(|node| if lowest[node] { share * HELD_N } else { 0.0 });
    (0..RAMP).for_each(|tick| push(&mut pile, 0.5 * tick as f32 / RAMP as f32));
    let mut moved_m = [0.0f32; 2];
    for moved_m in &mut moved_m {
        (0..500).for_each(|_| push(&mut pile, 0.5));
        *moved_m = pile.place_m() - before_m;
    }
    let expected_m = 0.5 * HELD_N / STIFFNESS_N_M;
    println!("moved by {moved_m:?} m, expected {expected_m}");
    assert!(moved_m.iter().all(|moved_m| (moved_m / expected_m - 1.0).abs() < 0.1), "{moved_m:?}, not {expected_m} m");
    (0..RAMP).for_each(|tick| push(&mut pile, 0.5 - 0.5 * tick as f32 / RAMP as f32));
    (0..500).for_each(|_| push(&mut pile, 0.0));
    let left_m = pile.place_m() - before_m;
    assert!(left_m.abs() < 0.1 * expected_m, "{left_m} m are left of {expected_m}");
}

#[test]
fn what_is_pushed_with_more_than_friction_holds_slides_with_what_is_left_over() {
    const SPEEDS_UP_M_S2: f32 = 1.4;
    const LATER: usize = 50;
    let mut pile = pile(true);
    // Friction is borne where it acts, so that the cube goes without turning over.
    let push_of = |node: usize| {
        let own_n = SPEEDS_UP_M_S2 * pile.body.model.mass_kg()[node];
        if pile.is_lowest(node) { own_n + HELD_N } else { own_n }
    };
    let nodes = 0..pile.pressed_n.len();
    let pushes_n: Vec<f32> = nodes.map(|node| if node < pile.first { 0.0 } else { push_of(node) }).collect();
    let pushed_n: f64 = pushes_n.iter().map(|push_n| f64::from(*push_n)).sum();
    (0..30).for_each(|_| pile.step(|node| pushes_n[node]));
    let [_, [mass_kg, begun]] = pile.momentum();
    (0..LATER).for_each(|_| pile.step(|node| pushes_n[node]));
    let [_, [_, ended]] = pile.momentum();
    let found_n = (ended - begun) / (LATER as f64 * 1e-3);
    let expected_n = pushed_n - LOWEST as f64 * f64::from(HELD_N);
    println!("{mass_kg} kg, {found_n} N of {pushed_n} N speed it up, expected {expected_n}");
    assert!((found_n / expected_n - 1.0).abs() < 0.05, "{found_n} N, not {expected_n}");
}

#[test]
fn what_slides_on_what_nothing_holds_gives_it_what_it_loses_itself() {
    const TICKS: usize = 20;
    let mut pile = pile(false);
    let first = pile.first;
    pile.body.velocity_m_s[first..].fill([0.05, 0.0, 0.0]);
    let [_, [_, had]] = pile.momentum();
    (0..TICKS).for_each(|_| pile.step(|_| 0.0));
    let [[_, gained], [_, has]] = pile.momentum();
    let (lost, expected) = (had - has, LOWEST as f64 * f64::from(HELD_N) * TICKS as f64 * 1e-3);
    println!("{lost} of {had} kg·m/s are lost, {gained} gained, expected {expected}");
    assert!((lost / expected - 1.0).abs() < 0.1, "{lost} kg·m/s, not {expected}");
    assert!((gained - lost).abs() < 1e-3 * lost, "{gained} kg·m/s gained, {lost} lost");
}
