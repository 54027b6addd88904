//! Shapes that need no file: the instruments, and a cavity for tests and for a scene without an organ.
use std::f32::consts::TAU;

/// A triangle surface: positions, m, and triangles that are counter-clockwise seen from outside.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Shape {
    /// vertices, m
    pub positions_m: Vec<[f32; 3]>,
    /// vertex numbers
    pub triangles: Vec<[u32; 3]>,
}

impl Shape {
    /// Adds a grid of `rows` × `columns` points that closes around its columns.
    fn wrap(&mut self, rows: u32, columns: u32, point: impl Fn(u32, u32) -> [f32; 3]) {
        let base = self.positions_m.len() as u32;
        for row in 0..rows {
            self.positions_m.extend((0..columns).map(|column| point(row, column)));
        }
        for row in 0..rows.saturating_sub(1) {
            for column in 0..columns {
                let right = (column + 1) % columns;
                let [a, b] = [base + row * columns + column, base + row * columns + right];
                let [c, d] = [a + columns, b + columns];
                self.triangles.extend([[a, b, d], [a, d, c]]);
            }
        }
    }
}

/// A scope along its own axis: tip at the origin, shaft towards -z, so that the pose of the tip is the pose of the object.
/// The end is cut at `oblique_rad`, as the window of a fore-oblique optic is.
pub fn scope(radius_m: f32, length_m: f32, oblique_rad: f32) -> Shape {
    const AROUND: u32 = 32;
    let slant = oblique_rad.clamp(0.0, 1.2).tan();
    // rings from the eyepiece to the tip, then the rim of the window and its middle: (z, radius, share of the slant)
    let flange = 1.35 * radius_m;
    let rings = [
        (-length_m, 0.0, 0.0),
        (-length_m, 3.2 * radius_m, 0.0),
        (-0.86 * length_m, 3.2 * radius_m, 0.0),
        (-0.86 * length_m, flange, 0.0),
        (-0.80 * length_m, flange, 0.0),
        (-0.80 * length_m, radius_m, 0.0),
        (-0.20 * length_m, radius_m, 0.0),
        (-0.20 * length_m, radius_m, 0.0),
        (0.0, radius_m, 1.0),
        (0.0, radius_m, 1.0),
        (-0.1 * radius_m, 0.82 * radius_m, 0.82),
        (-0.1 * radius_m, 0.0, 0.0),
    ];
    let mut shape = Shape::default();
    shape.wrap(rings.len() as u32, AROUND, |row, column| {
        let (z, r, share) = rings[row as usize];
        let angle = TAU * column as f32 / AROUND as f32;
        [r * angle.cos(), r * angle.sin(), z - share * slant * (radius_m + radius_m * angle.sin()) * 0.5]
    });
    shape
}

/// The ring of a loop electrode at the origin: a half ring of wire, of radius `wire_m`, in the x-y plane that opens towards -y.
pub fn loop_ring(radius_m: f32, wire_m: f32) -> Shape {
    let mut shape = Shape::default();
    shape.wrap(BEND + 1, AROUND, |row, column| ring_point(radius_m, wire_m, row, column));
    shape
}

/// Its two arms, back along -z from where the ring ends.
pub fn loop_arms(radius_m: f32, wire_m: f32, arm_m: f32) -> Shape {
    let mut shape = Shape::default();
    for (ring_row, first) in [(0, 0), (BEND, 1)] {
        shape.wrap(2, AROUND, |row, column| {
            let [x, y, z] = ring_point(radius_m, wire_m, ring_row, column);
            // The first arm comes to the ring, the second goes from it.
            if row == first { [x, y, -arm_m] } else { [x, y, z] }
        });
    }
    shape
}

/// Points around the wire, and pieces of the half ring.
const AROUND: u32 = 8;
const BEND: u32 = 24;

/// A point of the ring's skin. Its last sections are mitred: there the wire turns by a right angle into the arms.
fn ring_point(radius_m: f32, wire_m: f32, row: u32, column: u32) -> [f32; 3] {
    let (sin, cos) = (std::f32::consts::PI * row as f32 / BEND as f32).sin_cos();
    let around = -TAU * column as f32 / AROUND as f32;
    let (out_m, front_m) = (wire_m * around.cos(), wire_m * around.sin());
    let mitre_m = if row == 0 || row == BEND { front_m } else { 0.0 };
    [(radius_m + out_m) * cos, (radius_m + out_m) * sin - mitre_m, front_m]
}

/// A cavity seen from inside: a flattened, tapering sack of `length_m` along +z from the origin, normals inwards, with folds.
pub fn cavity(length_m: f32, rows: u32, columns: u32) -> Shape {
    let (rows, columns) = (rows.clamp(4, 1_000), columns.clamp(6, 1_000));
    let mut shape = Shape::default();
    shape.wrap(rows, columns, |row, column| {
        let t = row as f32 / (rows - 1) as f32;
        let close = (1.0 - ((t - 0.78).max(0.0) / 0.22).powi(2)).max(0.0).sqrt();
        let angle = -TAU * column as f32 / columns as f32;
        let fold = 1.0 + 0.05 * (5.0 * angle + 9.0 * t).sin() + 0.03 * (11.0 * t + 2.0 * angle).cos();
        let [a, b] = [0.0035 + 0.0125 * t.powf(1.2), 0.0035 + 0.0045 * t.sqrt()].map(|r| r * close * fold);
        [a * angle.cos(), b * angle.sin(), length_m * (t + 0.06 * (1.0 - close) * t)]
    });
    shape
}

/// An arrow of length 1 from the origin along +z, its shaft of radius 1.
pub fn arrow() -> Shape {
    const PROFILE: [(f32, f32); 5] = [(0.0, 0.0), (0.0, 1.0), (0.7, 1.0), (0.7, 2.5), (1.0, 0.0)];
    let mut shape = Shape::default();
    shape.wrap(PROFILE.len() as u32, AROUND, |row, column| {
        let (z, radius) = PROFILE[row as usize];
        let angle = TAU * column as f32 / AROUND as f32;
        [radius * angle.cos(), radius * angle.sin(), z]
    });
    shape
}

/// A ball.
pub fn ball(centre_m: [f32; 3], radius_m: f32, rows: u32, columns: u32) -> Shape {
    let (rows, columns) = (rows.clamp(3, 1_000), columns.clamp(3, 1_000));
    let mut shape = Shape::default();
    shape.wrap(rows, columns, |row, column| {
        let polar = std::f32::consts::PI * (1.0 - row as f32 / (rows - 1) as f32);
        let angle = TAU * column as f32 / columns as f32;
        let r = radius_m * polar.sin();
        [centre_m[0] + r * angle.cos(), centre_m[1] + r * angle.sin(), centre_m[2] + radius_m * polar.cos()]
    });
    shape
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    /// Six times the signed volume: positive if triangles are counter-clockwise from outside.
    fn volume6(shape: &Shape) -> f32 {
        let p = |i: u32| Vec3::from(shape.positions_m[i as usize]);
        shape.triangles.iter().map(|&[a, b, c]| p(a).dot(p(b).cross(p(c)))).sum()
    }

    #[test]
    fn outsides_are_outside() {
        let ball = ball([0.01, 0.02, 0.03], 0.005, 24, 48);
        let exact = 8.0 * std::f32::consts::PI * 0.005_f32.powi(3);
        assert!((volume6(&ball) / exact - 1.0).abs() < 0.05, "{}", volume6(&ball) / exact);
        assert!(volume6(&scope(0.0025, 0.3, 0.5)) > 0.0);
        assert!(volume6(&cavity(0.045, 40, 48)) < 0.0, "a cavity is seen from inside");
    }

    #[test]
    fn the_wire_of_a_loop_is_as_thick_in_ring_and_arms_and_none_of_it_is_turned_inside_out() {
        let (ring, arms) = (loop_ring(0.003, 0.0003), loop_arms(0.003, 0.0003, 0.01));
        let axis = |p: Vec3| Vec3::new(p.x, p.y.max(0.0), 0.0).normalize_or(Vec3::X * p.x.signum()) * 0.003;
        for (what, shape) in [("ring", &ring), ("arms", &arms)] {
            for corners in &shape.triangles {
                let [a, b, c] = corners.map(|i| Vec3::from(shape.positions_m[i as usize]));
                let middle = (a + b + c) / 3.0;
                let wire = if what == "ring" { axis(middle) } else { Vec3::new(0.003 * middle.x.signum(), 0.0, middle.z) };
                assert!((b - a).cross(c - a).dot(middle - wire) > 0.0, "{what}: {middle}");
            }
        }
        for arm in arms.positions_m.iter().filter(|p| p[2] < -0.009) {
            assert!(((arm[0].abs() - 0.003).hypot(arm[1]) - 0.0003).abs() < 1e-7, "{arm:?}");
        }
        for [x, y, z] in ring.positions_m.iter().filter(|p| p[1] > 0.0004) {
            assert!(((x.hypot(*y) - 0.003).hypot(*z) - 0.0003).abs() < 1e-7, "{x} {y} {z}");
        }
    }
}
