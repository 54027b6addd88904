//! The force that the hand feels beside Hertz' theory: the round tip of the station's own instrument goes into a block that is refined where they meet, with
//! everything between the hand and the tissue that a Main Loop has, until nothing moves any more.
//!
//! Promise: the force is the one that belongs to the dent in the block, and the one that belongs to the tool's place, if what the contact gives way by itself
//! is counted; how much that is of a rigid contact's force is said, and bounded.

use super::linear::{block, with_mesh};
use super::press::{Press, Record};
use crate::contacts::STIFFNESS_N_M3;
use hyst_scene::{LoadedHand, LoadedScene, Pose, collision_points};
use hyst_tissue::Isa;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// What the block is made of, Pa: linear tets are not stiffened by its Poisson's ratio.
const YOUNG_PA: f64 = 30_000.0;
const POISSON: f64 = 0.3;
/// Density, kg/m³, and rate of decay, 1/s: what is at rest does not know them, and the small tets need no mass added.
const DENSITY_KG_M3: f64 = 10_000.0;
const DAMPING_PER_S: f64 = 300.0;
/// How far the tip goes into the block, m: so little that the theory of small strains holds, an eighth of its radius.
const DEPTH_M: f64 = 0.3e-3;
/// How far before the block it begins, m.
const BEFORE_M: f64 = 0.1e-3;
/// Ticks in which it goes in, and then stays; between two looks whether the force has come to rest.
const IN_TICKS: usize = 250;
const STAY_TICKS: usize = 120;
const LOOK_TICKS: usize = 20;
/// Thickness and half the width of the block, in radii of Hertz' circle: its far face is held, its sides are free and farther away.
const THICK: f64 = 5.0;
const HALF_WIDE: f64 = 7.0;
/// Half the width of what is refined, in such radii: all that may be touched.
const REFINED: f64 = 1.5;

/// Modulus of contact, Pa.
fn contact_pa() -> f64 {
    YOUNG_PA / (1.0 - POISSON * POISSON)
}

/// How much less deep a block on a held base goes down than a half-space under the same force, m/N: the first term of Dimitriadis et al., "Determination of
/// elastic moduli of thin layers of soft material using the atomic force microscope" (Biophysical Journal 82, 2002), for a sample that is bonded to its base.
/// It is the same all over a circle that is small beside the thickness.
fn base_m_n(thick_m: f64) -> f64 {
    let alpha = -(1.2876 - 1.4678 * POISSON + 1.3442 * POISSON * POISSON) / (1.0 - POISSON);
    -alpha / (PI * contact_pa() * thick_m)
}

/// Force of a rigid ball on such a block, N (Hertz 1882).
fn hertz_n(radius_m: f64, depth_m: f64, base_m_n: f64) -> f64 {
    let half_space_n = |depth_m: f64| 4.0 / 3.0 * contact_pa() * radius_m.sqrt() * depth_m.powf(1.5);
    (0..100).fold(0.0, |force_n, _| half_space_n(depth_m + base_m_n * force_n))
}

/// Complete elliptic integrals of the first and second kind for a parameter from 0 to below 1, by the arithmetic-geometric mean.
fn elliptic(parameter: f64) -> [f64; 2] {
    let (mut a, mut b, mut c) = (1.0f64, (1.0 - parameter).sqrt(), parameter.sqrt());
    let (mut power, mut sum) = (0.5f64, 0.0f64);
    for _ in 0..12 {
        sum += power * c * c;
        power *= 2.0;
        (a, b, c) = (0.5 * (a + b), (a * b).sqrt(), 0.5 * (a - b));
    }
    let first = PI / (2.0 * a);
    [first, first * (1.0 - sum)]
}

/// How far a half-space goes down at a distance from the middle of a circle under a pressure of 1 Pa, m (Johnson, "Contact Mechanics", 1985, section 3.4).
fn under_disc_m(circle_m: f64, away_m: f64) -> f64 {
    if circle_m == 0.0 {
        return 0.0;
    }
    let factor_m = 4.0 / (PI * contact_pa());
    let parameter = (circle_m.min(away_m) / circle_m.max(away_m)).powi(2);
    let [first, second] = elliptic(parameter);
    if away_m < circle_m { factor_m * circle_m * second } else { factor_m * away_m * (second - (1.0 - parameter) * first) }
}

/// Force of a ball whose contact gives way by its pressure over a stiffness, on a block on a base, N: by rings, none of which pulls.
fn theory_n(radius_m: f64, depth_m: f64, stiffness_n_m3: f64, base_m_n: f64) -> f64 {
    const RINGS: usize = 48;
    const SWEEPS: usize = 3_000;
    // Where the ball is outside of what was there, nothing is touched.
    let wide_m = (2.0 * radius_m * depth_m).sqrt() / RINGS as f64;
    let away_m = |ring: usize| (ring as f64 + 0.5) * wide_m;
    let area_m2 = |ring: usize| PI * wide_m * wide_m * (2.0 * ring as f64 + 1.0);
    let gives_m = |at: usize, under: usize| {
        let [inner_m, outer_m] = [under, under + 1].map(|edge| under_disc_m(edge as f64 * wide_m, away_m(at)));
        let own_m = if at == under { 1.0 / stiffness_n_m3 } else { 0.0 };
        outer_m - inner_m - base_m_n * area_m2(under) + own_m
    };
    let rows: Vec<Vec<f64>> = (0..RINGS).map(|at| (0..RINGS).map(|under| gives_m(at, under)).collect()).collect();
    let ball_m = |ring: usize| depth_m - (radius_m - (radius_m * radius_m - away_m(ring).powi(2)).sqrt());
    let mut pressure_pa = vec![0.0f64; RINGS];
    for ring in (0..SWEEPS).flat_map(|_| 0..RINGS) {
        let others: f64 = rows[ring].iter().zip(&pressure_pa).map(|(gives_m, pa)| gives_m * pa).sum();
        let own_m = rows[ring][ring] * pressure_pa[ring];
        pressure_pa[ring] = ((ball_m(ring) - others + own_m) / rows[ring][ring]).max(0.0);
    }
    pressure_pa.iter().enumerate().map(|(ring, pa)| pa * area_m2(ring)).sum()
}

/// How many cells a block has: refined ones from the middle to where that ends, and coarse ones from there to the side, each longer than the one before;
/// then the same downwards, where the refined ones go half as deep.
struct Cells {
    across: [usize; 2],
    down: [usize; 2],
}

/// From 0 on: refined cells of one size, then coarse ones, each longer than the one before by one factor, up to an end, m.
fn lines_m([refined, coarse]: [usize; 2], edge_m: f64, end_m: f64) -> Vec<f64> {
    let begun_m = refined as f64 * edge_m;
    let reach_m = |factor: f64| (1..=coarse as i32).map(|cell| edge_m * factor.powi(cell)).sum::<f64>();
    let (mut low, mut high) = (1.0f64, 10.0f64);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        (low, high) = if begun_m + reach_m(middle) < end_m { (middle, high) } else { (low, middle) };
    }
    let mut lines_m: Vec<f64> = (0..=refined).map(|line| line as f64 * edge_m).collect();
    let mut last_m = begun_m;
    for cell in 1..=coarse as i32 {
        last_m += edge_m * low.powi(cell);
        lines_m.push(last_m);
    }
    lines_m
}

/// A scene whose instrument's tip goes into a block, with that many points on the instrument.
struct Bench {
    scene: LoadedScene,
    radius_m: f64,
    circle_m: f64,
    thick_m: f64,
    /// Lines of the block's face, about the tip, m.
    lines_m: Vec<f64>,
    depth_m: f64,
}

fn bench(points: u32, cells: &Cells) -> Bench {
    let mut scene = hyst_scene::load_embedded().unwrap();
    let mut tool = scene.scene.rigid[0].clone();
    tool.points = points;
    (scene.rigid[0].points_m, scene.rigid[0].outward) = collision_points(&tool);
    let radius_m = 0.5 * tool.diameter_m;
    let circle_m = (radius_m * DEPTH_M).sqrt();
    let (edge_m, thick_m) = (REFINED * circle_m / cells.across[0] as f64, THICK * circle_m);
    let half_m = lines_m(cells.across, edge_m, HALF_WIDE * circle_m);
    let lines_m: Vec<f64> = half_m.iter().rev().map(|line| -line).chain(half_m[1..].iter().copied()).collect();
    let down_m = self::lines_m(cells.down, edge_m, thick_m);

    let rest = Pose::straight(scene.rest.insertion_m);
    let deep = Pose::straight(scene.rest.insertion_m + (BEFORE_M + DEPTH_M) as f32);
    let [from_m, to_m] = [rest, deep].map(|pose| pose.tip_m(scene.workspace.pivot_m));
    let face_m = from_m[2] + BEFORE_M as f32;
    let mut mesh = block([lines_m.len() - 1, lines_m.len() - 1, down_m.len() - 1], from_m);
    for (node, place) in mesh.positions_m.iter_mut().enumerate() {
        let (x, y, z) = (node % lines_m.len(), node / lines_m.len() % lines_m.len(), node / lines_m.len() / lines_m.len());
        *place = [from_m[0] + lines_m[x] as f32, from_m[1] + lines_m[y] as f32, face_m + down_m[z] as f32];
    }
    let held_m = face_m + 0.999 * thick_m as f32;
    let mut scene = with_mesh(&scene, mesh, |place| place[2] > held_m).unwrap();
    let stuff = &mut scene.objects[0].material;
    (stuff.youngs_modulus_pa, stuff.poisson_ratio) = (YOUNG_PA, POISSON);
    (stuff.density_kg_m3, stuff.damping_per_s) = (DENSITY_KG_M3, DAMPING_PER_S);
    let period_s = 2e-3 * IN_TICKS as f64;
    scene.hands = vec![LoadedHand { name: "press".to_owned(), way: vec![rest, deep], period_s, ..LoadedHand::default() }];
    Bench { scene, radius_m, circle_m, thick_m, lines_m, depth_m: f64::from(to_m[2] - face_m) }
}

/// How far the face has gone down at a place of it, m: between four of its nodes.
fn down_m(lines_m: &[f64], down_m: &[f64], [x, y]: [f64; 2]) -> f64 {
    let cell = |at_m: f64| {
        let cell = lines_m.partition_point(|line| *line <= at_m).clamp(1, lines_m.len() - 1) - 1;
        (cell, (at_m - lines_m[cell]) / (lines_m[cell + 1] - lines_m[cell]))
    };
    let ((i, s), (j, t)) = (cell(x), cell(y));
    let at = |i: usize, j: usize| down_m[j * lines_m.len() + i];
    (1.0 - t) * ((1.0 - s) * at(i, j) + s * at(i + 1, j)) + t * ((1.0 - s) * at(i, j + 1) + s * at(i + 1, j + 1))
}

impl Bench {
    /// The force that makes the face go down as it has, N, whatever the pressure within a circle is that makes it: by Betti's theorem it does the work on a
    /// flat punch's unit way that the punch's pressure does on these ways, F = 2E* ∫ w r dr / √(a² − r²) with r = a sin θ (Johnson, section 3.4).
    fn by_dent_n(&self, face_m: &[f64]) -> f64 {
        const DIRECTIONS: usize = 32;
        const PARTS: usize = 64;
        let circle_m = 2.0f64.sqrt() * self.circle_m; // beyond it the ball is outside of what was there
        let mut sum_m = 0.0f64;
        for (direction, part) in (0..DIRECTIONS).flat_map(|direction| (0..PARTS).map(move |part| (direction, part))) {
            let (sin, cos) = (TAU * (direction as f64 + 0.5) / DIRECTIONS as f64).sin_cos();
            let along = (FRAC_PI_2 * (part as f64 + 0.5) / PARTS as f64).sin();
            let place = [circle_m * along * cos, circle_m * along * sin];
            sum_m += along * down_m(&self.lines_m, face_m, place);
        }
        let stretch_n_m = 2.0 * contact_pa() * circle_m;
        let mean_m = FRAC_PI_2 * sum_m / (DIRECTIONS * PARTS) as f64;
        stretch_n_m * mean_m / (1.0 - stretch_n_m * base_m_n(self.thick_m))
    }
}

/// What a press came to.
#[derive(Debug)]
struct Pressed {
    /// What the hand feels, N.
    felt_n: f64,
    /// That over the force that belongs to the dent, less 1.
    beside_dent: f64,
    /// That over the force that belongs to the tool's place, less 1.
    beside_theory: f64,
    /// That over the force of a rigid ball in the tool's place, less 1.
    beside_hertz: f64,
    /// How far the middle of the face has gone down, of what the tip has.
    dent_share: f64,
    tets: usize,
    contacts: usize,
}

fn pressed(points: u32, cells: &Cells) -> Pressed {
    let bench = bench(points, cells);
    let mut press = Press::new(&bench.scene, Isa::detect(), 1).unwrap();
    let (mut record, mut before_n) = (Record::default(), 0.0);
    for tick in 0..=IN_TICKS + STAY_TICKS {
        press.tick(tick.min(IN_TICKS), &mut record).unwrap();
        if tick == IN_TICKS + STAY_TICKS - LOOK_TICKS {
            before_n = -f64::from(record.force_n[2]);
        }
    }
    let [x_n, y_n, z_n] = record.force_n.map(f64::from);
    let felt_n = -z_n;
    assert!((felt_n - before_n).abs() < 0.005 * felt_n, "not at rest: {before_n} N, {felt_n} N later");
    assert!(x_n.hypot(y_n) < 0.15 * felt_n, "drawn aside: {:?} N", record.force_n);
    let (now_m, face) = (press.positions_m(), bench.lines_m.len() * bench.lines_m.len());
    let face_m: Vec<f64> = now_m.iter().zip(press.rest_m()).take(face).map(|(now, rest)| f64::from(now[2] - rest[2])).collect();
    let base_m_n = base_m_n(bench.thick_m);
    let theory_n = theory_n(bench.radius_m, bench.depth_m, f64::from(STIFFNESS_N_M3), base_m_n);
    Pressed {
        felt_n,
        beside_dent: felt_n / bench.by_dent_n(&face_m) - 1.0,
        beside_theory: felt_n / theory_n - 1.0,
        beside_hertz: felt_n / hertz_n(bench.radius_m, bench.depth_m, base_m_n) - 1.0,
        dent_share: down_m(&bench.lines_m, &face_m, [0.0; 2]) / bench.depth_m,
        tets: press.tets(),
        contacts: record.contacts,
    }
}

/// 2.7 and 4 cells from the middle to Hertz' circle: 4 320 and 13 608 tets.
const COARSE: Cells = Cells { across: [4, 2], down: [2, 3] };
const FINE: Cells = Cells { across: [6, 3], down: [3, 4] };
/// How many times as fine the second is.
const FINER: f64 = 1.5;
/// Points of an instrument with one for each cell of the finer block.
const MANY_POINTS: u32 = 2_000;

/// The theory that the station is compared with: a contact that hardly gives way on a block that is thick is Hertz', but for a ball that is no paraboloid.
#[test]
fn the_theory_is_that_of_hertz_where_the_contact_does_not_give_way() {
    let (radius_m, circle_m) = (0.0025, (0.0025 * DEPTH_M).sqrt());
    for base_m_n in [0.0, base_m_n(THICK * circle_m)] {
        let ratio = theory_n(radius_m, DEPTH_M, 1e12, base_m_n) / hertz_n(radius_m, DEPTH_M, base_m_n);
        assert!((ratio - 1.0).abs() < 0.025, "{ratio} of Hertz, {base_m_n} m/N less");
    }
    let soft = theory_n(radius_m, DEPTH_M, f64::from(STIFFNESS_N_M3), 0.0) / hertz_n(radius_m, DEPTH_M, 0.0);
    assert!((0.7..0.9).contains(&soft), "{soft} of Hertz");
}

/// What is expected, by the same rules on a half-space that has no mesh: 10.7 mN, the contact takes a quarter of what a rigid ball would be met with, and the
/// depths that are handed on from the border inwards take another percent. Linear tets are too stiff by some hundredths, ever less the finer they are.
#[test]
fn the_force_that_the_hand_feels_is_that_of_the_dent_and_of_hertz_with_what_the_contact_gives_way() {
    let [coarse, fine] = [&COARSE, &FINE].map(|cells| pressed(MANY_POINTS, cells));
    println!("a round tip in a block: {coarse:?}, {fine:?}");
    assert_eq!([coarse.tets, fine.tets], [4_320, 13_608]);
    assert!(fine.contacts > 30 && (0.009..0.013).contains(&fine.felt_n) && (0.4..0.8).contains(&fine.dent_share), "{fine:?}");
    assert!((-0.03..0.10).contains(&fine.beside_dent) && fine.beside_dent < coarse.beside_dent, "{coarse:?}, {fine:?}");
    assert!(fine.beside_theory.abs() < 0.12, "{fine:?}");
    // Richardson: the error is quadratic in the edge.
    let limit = |coarse: f64, fine: f64| fine + (fine - coarse) / (FINER * FINER - 1.0);
    let by_dent = limit(coarse.beside_dent, fine.beside_dent);
    let by_theory = limit(coarse.beside_theory, fine.beside_theory);
    assert!(by_dent.abs() < 0.05 && by_theory.abs() < 0.08, "extrapolated {by_dent} and {by_theory} off: {coarse:?}, {fine:?}");
    // What the contact's own softness takes.
    assert!((-0.30..-0.10).contains(&fine.beside_hertz), "{fine:?}");
}
