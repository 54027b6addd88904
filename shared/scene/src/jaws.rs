//! The jaws of a grasper, ready to grasp. The instrument's frame: tip and hinge at the origin, shaft along −z; the jaws open to both sides of x.

use crate::error::{SceneError, SceneErrorKind as Kind};
use crate::instrument::Jaws;
use crate::rigid::read_surface;
use crate::source::Folder;
use crate::spread::spread;
use glam::{Quat, Vec3};
use hyst_mesh::TriangleMesh;

/// Shortest and longest jaw.
const LENGTH_M: [f32; 2] = [0.001, 0.03];
/// The jaws' tips are at most this share of their length apart: then each is turned by 53°.
const MOST_OPENING: f64 = 1.6;
/// Where the pads are, at which the jaws hold: rows along a jaw, as shares of its length, and columns across, of half its width.
const PAD_ROWS: [f32; 5] = [0.4, 0.55, 0.7, 0.82, 0.94];
const PAD_COLUMNS: [f32; 3] = [-0.6, 0.0, 0.6];

/// Two jaws.
#[derive(Debug, Clone, PartialEq)]
pub struct LoadedJaws {
    /// From the hinge to the tip.
    pub length_m: f32,
    /// How far the tips are apart when they are open.
    pub opening_m: f32,
    /// The jaw on the side of +x, closed.
    pub surface: TriangleMesh,
    /// Its collision points, closed, the foremost one first, spread evenly.
    pub points_m: Vec<[f32; 3]>,
    /// The area that each of them stands for, m².
    pub point_area_m2: f32,
    /// Points of the plane in which the jaws close, at which they hold.
    pub pads_m: Vec<[f32; 3]>,
    /// The area that each of them stands for, m².
    pub pad_area_m2: f32,
}

impl LoadedJaws {
    /// The turn of the jaw on the side of +x when the tips are so far apart; the other one turns the opposite way.
    pub fn turn(&self, opening_m: f32) -> Quat {
        Quat::from_rotation_y((opening_m / (2.0 * self.length_m)).clamp(0.0, 1.0).asin())
    }
}

/// Reads the jaws of an instrument.
pub(crate) fn load_jaws(jaws: &Jaws, key: &str, folder: &Folder, notes: &mut Vec<String>) -> Result<LoadedJaws, SceneError> {
    let key = format!("{key}.jaws");
    let surface = read_surface(&jaws.mesh, jaws.scale_to_m, &format!("{key}.mesh"), folder, notes)?;
    let most = |axis: usize| surface.positions_m.iter().map(|place| place[axis].abs()).fold(0.0, f32::max);
    let length_m = surface.positions_m.iter().map(|place| place[2]).fold(0.0, f32::max);
    let behind_m = surface.positions_m.iter().map(|place| -place[2]).fold(0.0, f32::max);
    let across_m = surface.positions_m.iter().map(|place| -place[0]).fold(0.0, f32::max);
    let refused = |what: String, cure: &str| Err(SceneError::new(Kind::Size, format!("{key}.mesh"), what, cure).at(&jaws.mesh));
    if !(LENGTH_M[0]..=LENGTH_M[1]).contains(&length_m) {
        let what = format!("the jaw is {length_m:.3e} m long along +z, allowed is {} to {} m", LENGTH_M[0], LENGTH_M[1]);
        return refused(what, "set jaws.scale_to_m, or turn the jaw so that it lies along +z from its hinge");
    }
    if behind_m > 0.5 * length_m || across_m > 0.05 * length_m || most(0).max(most(1)) > length_m {
        let cure =
            "put the hinge at the origin, the jaw along +z, its closing face in the plane x = 0 and the jaw on the side of +x";
        return refused("the jaw does not lie along +z on the side of +x".to_owned(), cure);
    }
    if jaws.opening_m > MOST_OPENING * f64::from(length_m) {
        let what = format!("is {} m, the jaws are {length_m} m long", jaws.opening_m);
        let cure = format!("give at most {:.4} m", MOST_OPENING * f64::from(length_m));
        return Err(SceneError::new(Kind::Range, format!("{key}.opening_m"), what, cure));
    }
    let (points_m, _) = spread(&surface, jaws.points, |_| 1.0);
    let point_area_m2 = area_m2(&surface) / points_m.len() as f32;
    let half_width_m = most(1);
    let pad = |row: &f32| PAD_COLUMNS.map(|column| [0.0, column * half_width_m, row * length_m]);
    let pads_m: Vec<[f32; 3]> = PAD_ROWS.iter().flat_map(pad).collect();
    // What lies before the first row is too near to the hinge to hold.
    let pad_area_m2 = 2.0 * half_width_m * (1.0 - PAD_ROWS[0]) * length_m / pads_m.len() as f32;
    Ok(LoadedJaws { length_m, opening_m: jaws.opening_m as f32, surface, points_m, point_area_m2, pads_m, pad_area_m2 })
}

fn area_m2(surface: &TriangleMesh) -> f32 {
    let area = |triangle: &[u32; 3]| {
        let [a, b, c] = triangle.map(|vertex| Vec3::from(surface.positions_m[vertex as usize]));
        (b - a).cross(c - a).length() / 2.0
    };
    surface.triangles.iter().map(area).sum()
}
