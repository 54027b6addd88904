//! Convergence to the theory of elasticity: a beam, a thick-walled sphere under pressure, the dent of a ball. Each is solved at several resolutions with the solver of the
//! station; the error against the formula shrinks, and at the finest it is small.

mod common;

use common::{Body, block};
use hyst_mesh::TetMesh;
use hyst_tissue::{Material, Model, Options, pressure_forces};

/// Enough substeps that no mass is added on the finest of these meshes.
const SUBSTEPS: u32 = 200;

fn body(mesh: &TetMesh, fixed: &[bool], material: &Material) -> Body {
    let options = Options { max_substeps: SUBSTEPS, ..Options::default() };
    Body::new(Model::new(mesh, fixed, material, options).unwrap().0)
}

/// Timoshenko's deflection of a beam of square cross-section under a load at its tip, m.
fn timoshenko_m(load_n: f64, length_m: f64, side_m: f64, young_pa: f64, nu: f64) -> f64 {
    let (area, inertia) = (side_m * side_m, side_m.powi(4) / 12.0);
    let (shear_pa, share) = (young_pa / (2.0 * (1.0 + nu)), 10.0 * (1.0 + nu) / (12.0 + 11.0 * nu));
    load_n * length_m.powi(3) / (3.0 * young_pa * inertia) + load_n * length_m / (share * area * shear_pa)
}

/// Deflection of the tip of a cantilever with so many cubes across, m.
fn deflection_m(across: u32, length_m: f64, side_m: f64, load_n: f64, material: &Material) -> f64 {
    let mesh = block([across, across, across * 5], (side_m / f64::from(across)) as f32);
    let fixed: Vec<bool> = mesh.positions_m.iter().map(|p| p[2] == 0.0).collect();
    let mut body = body(&mesh, &fixed, material);
    let end = length_m as f32 - 1e-5;
    let tip: Vec<usize> = (0..mesh.positions_m.len()).filter(|&i| mesh.positions_m[i][2] > end).collect();
    tip.iter().for_each(|&node| body.force_n[node][0] = (load_n / tip.len() as f64) as f32);
    for _ in 0..400 {
        body.step();
    }
    tip.iter().map(|&node| f64::from(body.position_m[node][0] - mesh.positions_m[node][0])).sum::<f64>() / tip.len() as f64
}

#[test]
fn a_cantilever_that_hardly_gives_way_to_pressure_bends_as_one_that_does() {
    let (length_m, side_m, load_n, young_pa) = (0.03, 0.006, 2e-4, 100_000.0);
    let ratios = [0.3, 0.45, 0.49].map(|nu| {
        let material = Material::new(young_pa, nu, 1000.0, 120.0).unwrap();
        deflection_m(4, length_m, side_m, load_n, &material) / timoshenko_m(load_n, length_m, side_m, young_pa, nu)
    });
    println!("cantilever of 4 cubes across, ν = 0.3, 0.45, 0.49: {ratios:?} of theory");
    assert!(ratios[2] > ratios[1] && ratios[2] < 1.05, "with its volume held at the nodes it does not lock: {ratios:?}");
}

#[test]
fn a_series_of_cantilevers_converges_to_beam_theory() {
    let (length_m, side_m, load_n, young_pa, nu) = (0.03, 0.006, 2e-4, 100_000.0, 0.3);
    let material = Material::new(young_pa, nu, 1000.0, 120.0).unwrap();
    let theory_m = timoshenko_m(load_n, length_m, side_m, young_pa, nu);
    let error = |across| deflection_m(across, length_m, side_m, load_n, &material) / theory_m - 1.0;
    let errors = [error(2), error(4), error(8)];
    println!("cantilever of 2, 4, 8 cubes across: {errors:?} of {theory_m} m");
    assert!(errors.iter().all(|error| *error < 0.0), "linear tets are too stiff, never too soft: {errors:?}");
    assert!(errors[1] / errors[0] < 0.5 && errors[2] / errors[1] < 0.5, "{errors:?}");
    assert!(errors[2] > -0.08, "{errors:?}");
    // Richardson: the error is quadratic in the edge. Held nodes keep their distances, which theory does not ask for: a short beam is stiffer by that.
    let limit = errors[2] + (errors[2] - errors[1]) / 3.0;
    assert!(limit.abs() < 0.04, "extrapolated to {limit} off: {errors:?}");
}

/// A ball with a hole: the faces of an icosahedron cut into four so many times, in so many layers; and the triangles of the hole, seen from it.
fn hollow_sphere(inner_m: f32, outer_m: f32, cuts: u32, layers: u32) -> (TetMesh, Vec<[u32; 3]>) {
    use glam::Vec3;
    let golden = (1.0 + 5.0_f32.sqrt()) / 2.0;
    let mut points: Vec<Vec3> = Vec::new();
    for (a, b) in [(-1.0, golden), (1.0, golden), (-1.0, -golden), (1.0, -golden)] {
        points.extend([Vec3::new(a, b, 0.0), Vec3::new(0.0, a, b), Vec3::new(b, 0.0, a)].map(Vec3::normalize));
    }
    // Its faces are the triples of corners at the shortest distance from each other.
    let near = |a: usize, b: usize| points[a].distance(points[b]) < 1.1;
    let mut faces = Vec::new();
    for a in 0..12 {
        for b in a + 1..12 {
            faces.extend((b + 1..12).filter(|&c| near(a, b) && near(b, c) && near(a, c)).map(|c| [a, b, c]));
        }
    }
    assert_eq!(faces.len(), 20);
    for _ in 0..cuts {
        let mut middles = std::collections::BTreeMap::new();
        let mut middle = |a: usize, b: usize, points: &mut Vec<Vec3>| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                points.push((points[a] + points[b]).normalize());
                points.len() - 1
            })
        };
        faces = (faces.iter())
            .flat_map(|&[a, b, c]| {
                let [ab, bc, ca] = [middle(a, b, &mut points), middle(b, c, &mut points), middle(c, a, &mut points)];
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            })
            .collect();
    }
    let mut mesh = TetMesh::default();
    for layer in 0..=layers {
        // Layers of about the shape of their triangles: radii in geometric progression.
        let radius = inner_m * (outer_m / inner_m).powf(layer as f32 / layers as f32);
        mesh.positions_m.extend(points.iter().map(|point| (*point * radius).to_array()));
    }
    let at = |layer: u32, point: usize| layer * points.len() as u32 + point as u32;
    for layer in 0..layers {
        for face in &faces {
            let mut sorted = *face;
            sorted.sort_unstable(); // so that neighbours cut their common quadrangle alike
            let ([a, b, c], [d, e, f]) = (sorted.map(|p| at(layer, p)), sorted.map(|p| at(layer + 1, p)));
            for mut tet in [[a, b, c, f], [a, b, e, f], [a, d, e, f]] {
                let [o, x, y, z] = tet.map(|node| Vec3::from(mesh.positions_m[node as usize]));
                if (x - o).cross(y - o).dot(z - o) < 0.0 {
                    tet.swap(2, 3);
                }
                mesh.tets.push(tet);
                mesh.regions.push(0);
            }
        }
    }
    let towards_hole = |face: &[usize; 3]| {
        let [a, b, c] = face.map(|point| points[point]);
        let inwards = (b - a).cross(c - a).dot(a) < 0.0;
        let [a, b, c] = face.map(|point| at(0, point));
        if inwards { [a, b, c] } else { [a, c, b] }
    };
    let hole = faces.iter().map(towards_hole).collect();
    (mesh, hole)
}

/// Growth of the inner radius of a sphere under pressure from inside, m (Lamé).
fn lame_m(pressure_pa: f64, inner_m: f64, outer_m: f64, young_pa: f64, nu: f64) -> f64 {
    let (a, b) = (inner_m, outer_m);
    pressure_pa * a.powi(3) / (young_pa * (b.powi(3) - a.powi(3)))
        * ((1.0 - 2.0 * nu) * a + (1.0 + nu) * b.powi(3) / (2.0 * a * a))
}

#[test]
fn a_thick_walled_sphere_under_pressure_converges_to_lame() {
    let (inner_m, outer_m, young_pa, pressure_pa) = (0.01, 0.02, 30_000.0, 200.0);
    for (nu, most) in [(0.3, 0.03), (0.45, 0.06), (0.49, 0.06)] {
        let material = Material::new(young_pa, nu, 1000.0, 250.0).unwrap();
        let theory_m = lame_m(pressure_pa, inner_m, outer_m, young_pa, nu);
        let error = |cuts: u32, layers: u32| {
            let (mesh, hole) = hollow_sphere(inner_m as f32, outer_m as f32, cuts, layers);
            let mut body = body(&mesh, &vec![false; mesh.positions_m.len()], &material);
            let skipped = pressure_forces(&hole, &mesh.positions_m, &vec![pressure_pa as f32; hole.len()], &mut body.force_n);
            assert_eq!(skipped, 0);
            for _ in 0..200 {
                body.step();
            }
            let inner = mesh.positions_m.len() / (layers as usize + 1);
            let radius = |at: &[f32; 3]| f64::from(glam::Vec3::from(*at).length());
            let grown: f64 = (0..inner).map(|node| radius(&body.position_m[node]) - radius(&mesh.positions_m[node])).sum();
            grown / inner as f64 / theory_m - 1.0
        };
        let errors = [error(1, 2), error(2, 4), error(3, 8)];
        println!("hollow sphere, ν = {nu}: {errors:?} of {theory_m} m");
        assert!(errors[1].abs() < errors[0].abs() && errors[2].abs() < 0.6 * errors[1].abs(), "ν = {nu}: {errors:?}");
        assert!(errors[2].abs() < most, "ν = {nu}: {errors:?}");
    }
}

/// A block whose cubes are small in the middle of the face z = 0 and grow away from there: 2 × `cells` across, `cells` deep; m.
fn graded_block(cells: u32, half_m: f32, power: f32) -> TetMesh {
    let mut mesh = block([2 * cells, 2 * cells, cells], 1.0);
    let stretch = |x: f32| half_m * x.signum() * (x.abs() / cells as f32).powf(power);
    for p in &mut mesh.positions_m {
        *p = [stretch(p[0] - cells as f32), stretch(p[1] - cells as f32), stretch(p[2])];
    }
    mesh
}

/// The forces of a pressure on the face z = 0 at its nodes, N, and their sum: each triangle by the middles of 256 parts.
fn face_forces_n(mesh: &TetMesh, pressure_pa: impl Fn(f64) -> f64) -> (Vec<[f64; 3]>, f64) {
    const PARTS: u32 = 16;
    let mut forces = vec![[0.0; 3]; mesh.positions_m.len()];
    let mut sum_n = 0.0;
    for triangle in hyst_mesh::boundary(mesh).triangles {
        let [a, b, c] = triangle.map(|node| glam::DVec3::from(mesh.positions_m[node as usize].map(f64::from)));
        if [a, b, c].iter().any(|p| p.z != 0.0) {
            continue;
        }
        let part_m2 = (b - a).cross(c - a).length() / 2.0 / f64::from(PARTS * PARTS);
        for (i, j) in (0..PARTS).flat_map(|i| (0..PARTS).map(move |j| (i, j))) {
            // a parallelogram of parts, folded over its diagonal
            let (mut s, mut t) = ((f64::from(i) + 0.5) / f64::from(PARTS), (f64::from(j) + 0.5) / f64::from(PARTS));
            if s + t > 1.0 {
                (s, t) = (1.0 - s, 1.0 - t);
            }
            let point = a + (b - a) * s + (c - a) * t;
            let force_n = pressure_pa(point.truncate().length()) * part_m2;
            for (node, weight) in triangle.into_iter().zip([1.0 - s - t, s, t]) {
                forces[node as usize][2] += force_n * weight;
            }
            sum_n += force_n;
        }
    }
    (forces, sum_n)
}

/// Displacement of a half-space at a point under a force at the origin along z, into it, m (Boussinesq 1885; Johnson, section 3.2).
fn boussinesq_m(point: [f32; 3], force_n: f64, young_pa: f64, nu: f64) -> glam::DVec3 {
    let point = glam::DVec3::from(point.map(f64::from));
    let (far, across, z) = (point.length(), point.truncate(), point.z);
    let outward = across * (z / far.powi(3) - (1.0 - 2.0 * nu) / (far * (far + z)));
    outward.extend(z * z / far.powi(3) + 2.0 * (1.0 - nu) / far)
        * (force_n * (1.0 + nu) / (2.0 * std::f64::consts::PI * young_pa))
}

#[test]
fn the_pressure_of_a_ball_makes_the_dent_of_hertz() {
    // Hertz (1882): a ball of radius R that goes d deep touches a circle of radius √(R d) with the pressure p₀ √(1 − r²/a²), and the surface there
    // goes down as the ball is round: (1 − ν²)/E · π p₀/(4a) · (2a² − r²) (Johnson, "Contact Mechanics", 1985, section 3.4).
    let (radius_m, depth_m, young_pa, nu) = (0.008_f64, 0.0005_f64, 30_000.0, 0.3);
    let circle_m = (radius_m * depth_m).sqrt();
    let peak_pa = 2.0 / std::f64::consts::PI * young_pa / (1.0 - nu * nu) * circle_m / radius_m;
    let hertz_n = 4.0 / 3.0 * young_pa / (1.0 - nu * nu) * radius_m.sqrt() * depth_m.powf(1.5);
    // A tenth of the dent: so small that the theory of small strains holds, as that of the material does.
    const SHARE: f64 = 0.1;
    /// Half the block's width, m, five times the circle: on its other faces it is as far from home as a half-space under the same force is.
    const HALF_M: f32 = 0.010;
    let material = Material::new(young_pa, nu, 1000.0, 150.0).unwrap();
    let error = |cells: u32| {
        let mesh = graded_block(cells, HALF_M, 1.5);
        let is_far = |p: &[f32; 3]| p[2].max(p[0].abs()).max(p[1].abs()) > 0.999 * HALF_M;
        let fixed: Vec<bool> = mesh.positions_m.iter().map(is_far).collect();
        // What is at rest does not know its mass.
        let options = Options { max_substeps: 24, max_added_mass_ratio: 1e4, ..Options::default() };
        let mut body = Body::new(Model::new(&mesh, &fixed, &material, options).unwrap().0);
        let pressure = |r: f64| peak_pa * (1.0 - (r / circle_m).powi(2)).max(0.0).sqrt();
        let (forces, sum_n) = face_forces_n(&mesh, pressure);
        assert!((sum_n / hertz_n - 1.0).abs() < 0.02, "{cells} cells: the pressure adds up to {sum_n} N, Hertz {hertz_n} N");
        for (force, own) in body.force_n.iter_mut().zip(forces) {
            *force = own.map(|n| (n * SHARE * hertz_n / sum_n) as f32);
        }
        for (place, rest) in body.position_m.iter_mut().zip(&mesh.positions_m).filter(|(_, rest)| is_far(rest)) {
            *place = (glam::DVec3::from(rest.map(f64::from)) + boussinesq_m(*rest, SHARE * hertz_n, young_pa, nu))
                .as_vec3()
                .to_array();
        }
        let centre = mesh.positions_m.iter().position(|p| *p == [0.0; 3]).unwrap();
        for _ in 0..600 {
            body.step();
        }
        // In the middle, and at the node on the axis that is the last inside the circle: there it is 1 − r²/2a² as deep.
        let on_axis = |p: &[f32; 3]| p[1] == 0.0 && p[2] == 0.0 && f64::from(p[0]) < circle_m;
        let nodes = mesh.positions_m.iter().enumerate().filter(|(_, p)| on_axis(p));
        let last = nodes.max_by(|left, right| left.1[0].total_cmp(&right.1[0])).map_or(0, |(node, _)| node);
        [centre, last].map(|node| {
            let r = f64::from(mesh.positions_m[node][0]);
            let expected_m = depth_m * (1.0 - r * r / (2.0 * circle_m * circle_m));
            f64::from(body.position_m[node][2]) / SHARE / expected_m - 1.0
        })
    };
    let errors = [error(6), error(8), error(10)];
    println!("the dent of a ball with 6, 8, 10 cubes from its middle to the block's side: {errors:?}");
    let [coarse, middle, fine] = errors.map(|[in_the_middle, _]| in_the_middle);
    assert!(coarse < middle && middle < fine && fine < 0.0, "linear tets are too stiff, ever less: {errors:?}");
    assert!(fine > -0.08 && errors[2][1].abs() < 0.08, "{errors:?}");
    let limit = fine + (fine - middle) / ((10.0_f64 / 8.0).powi(2) - 1.0);
    assert!(limit.abs() < 0.03, "extrapolated to {limit} off: {errors:?}");
}
