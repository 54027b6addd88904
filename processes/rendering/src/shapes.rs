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

/// A loop electrode at the origin: a half ring in the x-y plane that opens towards -y, with its two arms back along -z.
pub fn loop_electrode(radius_m: f32, wire_m: f32, arm_m: f32) -> Shape {
    const AROUND: u32 = 8;
    const BEND: u32 = 24;
    let half = std::f32::consts::PI;
    let centre = |i: u32| -> ([f32; 3], [f32; 3]) {
        if i == 0 {
            ([radius_m, 0.0, -arm_m], [1.0, 0.0, 0.0])
        } else if i == BEND + 2 {
            ([-radius_m, 0.0, -arm_m], [-1.0, 0.0, 0.0])
        } else {
            let a = half * (i - 1) as f32 / BEND as f32;
            ([radius_m * a.cos(), radius_m * a.sin(), 0.0], [a.cos(), a.sin(), 0.0])
        }
    };
    let mut shape = Shape::default();
    shape.wrap(BEND + 3, AROUND, |row, column| {
        let (c, out) = centre(row);
        let a = -TAU * column as f32 / AROUND as f32;
        let (u, w) = (wire_m * a.cos(), wire_m * a.sin());
        let straight = row == 0 || row == BEND + 2;
        // across the wire: outwards and along z in the bend, outwards and along y on the arms
        if straight {
            let y = if row == 0 { w } else { -w };
            [c[0] + out[0] * u, c[1] - y, c[2]]
        } else {
            [c[0] + out[0] * u, c[1] + out[1] * u, c[2] + w]
        }
    });
    shape
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
        assert!(volume6(&loop_electrode(0.003, 0.0003, 0.01)) > 0.0);
        assert!(volume6(&cavity(0.045, 40, 48)) < 0.0, "a cavity is seen from inside");
    }
}
