//! Volume and quality of one tet, and the guess of a file's unit. All in double precision: the differences of single-precision
//! coordinates are exact there, up to the last bits.

use glam::DVec3;

/// The four corners of a tet. The tet must index into `positions_m`.
pub(crate) fn corners(positions_m: &[[f32; 3]], tet: [u32; 4]) -> [DVec3; 4] {
    tet.map(|node| DVec3::from_array(positions_m[node as usize].map(f64::from)))
}

/// Volume of a tet in m³, positive when `(b−a) × (c−a) · (d−a) > 0`.
pub fn signed_volume([a, b, c, d]: [DVec3; 4]) -> f64 {
    (b - a).cross(c - a).dot(d - a) / 6.0
}

/// The six edges of a tet.
pub(crate) fn edges([a, b, c, d]: [DVec3; 4]) -> [DVec3; 6] {
    [b - a, c - a, d - a, c - b, d - b, d - c]
}

/// Whether a tet has no volume that a model could use: zero, within the rounding of its coordinates, or too little for its size.
pub(crate) fn is_without_volume(corners: [DVec3; 4]) -> bool {
    signed_volume(corners).abs() <= volume_rounding(corners) || is_too_flat(corners)
}

/// Quality of a tet, from 0 (flat) to 1 (regular): 6 √2 |V| / l³ with l the root mean square of its six edges. Sliver, wedge, cap and
/// needle all come near 0.
///
/// Parthasarathy, Graichen and Hathaway, “A comparison of tetrahedron quality measures”, Finite Elements in Analysis and Design 15
/// (1994); it is the mean ratio to the power 3/2.
pub fn quality(corners: [DVec3; 4]) -> f64 {
    let mean_square = edges(corners).iter().map(|edge| edge.length_squared()).sum::<f64>() / 6.0;
    if mean_square <= 0.0 {
        return 0.0;
    }
    6.0 * std::f64::consts::SQRT_2 * signed_volume(corners).abs() / (mean_square * mean_square.sqrt())
}

/// A tet flatter than this (volume over the cube of its longest edge) has no usable inverse in single precision.
const FLATNESS_MIN: f64 = 1e-7;

/// Whether a tet, whichever way round it is, is too flat for a simulation in single precision.
pub fn is_too_flat(corners: [DVec3; 4]) -> bool {
    let longest = edges(corners).iter().map(|edge| edge.length_squared()).fold(0.0, f64::max).sqrt();
    signed_volume(corners).abs() <= FLATNESS_MIN * longest.powi(3)
}

/// A number and what it counts: “1 tet”, “2 tets”.
pub(crate) fn count(number: usize, what: &str) -> String {
    format!("{number} {what}{}", if number == 1 { "" } else { "s" })
}

/// The largest volume in m³ that the rounding of the corners to single precision can explain: half a unit in the last place of the
/// largest coordinate, times half the area of the faces. A tet below it has no known orientation.
fn volume_rounding(corners: [DVec3; 4]) -> f64 {
    let [a, b, c, d] = corners;
    let faces = [(b - a).cross(c - a), (b - a).cross(d - a), (c - a).cross(d - a), (c - b).cross(d - b)];
    let area: f64 = faces.iter().map(|normal| normal.length() / 2.0).sum();
    let largest = corners.iter().fold(0.0_f64, |largest, corner| largest.max(corner.abs().max_element()));
    largest * f64::from(f32::EPSILON) / 2.0 * area / 2.0
}

/// Unit of length of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unit {
    /// Metres.
    Metre,
    /// Centimetres.
    Centimetre,
    /// Millimetres.
    Millimetre,
}

impl Unit {
    /// Factor from this unit to metres.
    pub fn metres(self) -> f32 {
        match self {
            Unit::Metre => 1.0,
            Unit::Centimetre => 0.01,
            Unit::Millimetre => 0.001,
        }
    }

    /// Its symbol.
    pub fn symbol(self) -> &'static str {
        match self {
            Unit::Metre => "m",
            Unit::Centimetre => "cm",
            Unit::Millimetre => "mm",
        }
    }
}

/// The unit in which an object of size `extent` is nearest to `expected_m` metres, by ratio.
///
/// Only a guess: an extent or an expected size that is not a positive number gives metres.
pub fn guess_unit(extent: f32, expected_m: f32) -> Unit {
    let distance = |unit: Unit| (f64::from(extent) * f64::from(unit.metres()) / f64::from(expected_m)).ln().abs();
    let mut best = Unit::Metre;
    for unit in [Unit::Centimetre, Unit::Millimetre] {
        if distance(unit) < distance(best) {
            best = unit;
        }
    }
    best
}
