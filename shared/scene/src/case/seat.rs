//! How an attached object sits on its wall: larger or smaller about its root, and further along the wall, as deep in it as before. What would grow into
//! another wall, or off its own, is drawn back until it does not.

use crate::locate::Locator;
use crate::mirror::Planes;
use glam::Vec3;
use hyst_mesh::{TetMesh, TriangleMesh};

/// Shares of what was drawn that are tried, one after the other; the last is the scene's own seat.
const SHARES: [f32; 5] = [1.0, 0.75, 0.5, 0.25, 0.0];
/// Steps in which the wall is looked for below the object's top, and how far.
const STEP_M: f32 = 0.000_1;
const MOST_STEPS: u32 = 1_000;
/// Nodes in the wall are the root if they lie no further from its middle than the deepest and highest did, and this much.
const ROOT_MARGIN_M: f32 = 0.001;
/// Nodes in the wall after it was moved, as a share of those before: fewer hold it badly, more are buried.
const ROOTED_SHARES: [f32; 2] = [0.5, 2.0];

/// What is drawn of an object's place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Seat {
    /// Factor of its size.
    pub(crate) size: f32,
    /// How far it goes along the wall.
    pub(crate) shift_m: f32,
    /// Where to, in the plane of the wall; of length 1.
    pub(crate) direction: [f32; 2],
}

/// How all objects of a scene sit.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Seats {
    /// What is drawn of each object's place, in the scene's order; of a scene by itself nothing.
    pub(crate) of: Vec<Option<Seat>>,
    /// About which planes all is mirrored then.
    pub(crate) mirrored: Planes,
}

/// The root of an object in its host.
struct Root {
    middle: Vec3,
    /// Out of the wall.
    axis: Vec3,
    /// Highest node in the wall above the middle, along the axis.
    highest_m: f32,
    nodes: usize,
}

impl Seat {
    /// Moves tets and surface of an object; answers what came of it in words. One that is rooted in nothing stays where it is.
    pub(crate) fn take(
        &self,
        name: &str,
        mesh: &mut TetMesh,
        surface: Option<&mut TriangleMesh>,
        host: &Locator,
    ) -> Option<String> {
        let root = root(&mesh.positions_m, host)?;
        let (size, shift) = SHARES.iter().find_map(|share| self.fit(*share, &root, mesh, host))?;
        let moved = |points: &mut [[f32; 3]]| points.iter_mut().for_each(|point| *point = root.moved(*point, size, shift));
        moved(&mut mesh.positions_m);
        if let Some(surface) = surface {
            moved(&mut surface.positions_m);
        }
        Some(format!("{name}: {size:.2} times as large as in the scene, {:.1} mm beside it", 1e3 * shift.length()))
    }

    /// Size and shift of a share of what was drawn, if the object can sit so.
    fn fit(&self, share: f32, root: &Root, mesh: &TetMesh, host: &Locator) -> Option<(f32, Vec3)> {
        if share == 0.0 {
            return Some((1.0, Vec3::ZERO));
        }
        let size = 1.0 + (self.size - 1.0) * share;
        let (right, up) = root.axis.any_orthonormal_pair();
        let along = (right * self.direction[0] + up * self.direction[1]) * (self.shift_m * share);
        let place =
            |shift: Vec3| -> Vec<[f32; 3]> { mesh.positions_m.iter().map(|point| root.moved(*point, size, shift)).collect() };
        // The wall is nearer or further there: it goes along its axis until its top is as high above it as it would be at home.
        let at_home_m = clearance(&place(Vec3::ZERO), root.axis, host)?;
        let there_m = clearance(&place(along), root.axis, host)?;
        let shift = along - root.axis * (there_m - at_home_m);
        let points = place(shift);
        let in_wall: Vec<&[f32; 3]> = points.iter().filter(|point| host.find(**point).is_some()).collect();
        let height = |point: &[f32; 3]| (Vec3::from(*point) - (root.middle + shift)).dot(root.axis);
        let is_root = in_wall.iter().all(|point| height(point) <= root.highest_m * size.max(1.0) + ROOT_MARGIN_M);
        let [fewest, most] = ROOTED_SHARES.map(|share| share * root.nodes as f32);
        let is_held = (fewest..=most).contains(&(in_wall.len() as f32));
        (is_root && is_held).then_some((size, shift))
    }
}

impl Root {
    fn moved(&self, point: [f32; 3], size: f32, shift: Vec3) -> [f32; 3] {
        (self.middle + (Vec3::from(point) - self.middle) * size + shift).to_array()
    }
}

fn root(points: &[[f32; 3]], host: &Locator) -> Option<Root> {
    let rooted: Vec<Vec3> = points.iter().filter(|point| host.find(**point).is_some()).map(|point| Vec3::from(*point)).collect();
    let mean = |points: &[Vec3]| points.iter().sum::<Vec3>() / points.len().max(1) as f32;
    let all: Vec<Vec3> = points.iter().map(|point| Vec3::from(*point)).collect();
    let middle = mean(&rooted);
    let axis = (mean(&all) - middle).try_normalize()?;
    let highest_m = rooted.iter().map(|point| (*point - middle).dot(axis)).fold(0.0, f32::max);
    (!rooted.is_empty()).then_some(Root { middle, axis, highest_m, nodes: rooted.len() })
}

/// From the top of an object down along its axis to the wall; `None` where there is none, or its top lies in it.
fn clearance(points: &[[f32; 3]], axis: Vec3, host: &Locator) -> Option<f32> {
    let tops = points.iter().map(|point| Vec3::from(*point));
    let top = tops.reduce(|best, point| if point.dot(axis) > best.dot(axis) { point } else { best })?;
    let is_wall = |step: &u32| host.find((top - axis * (*step as f32 * STEP_M)).to_array()).is_some();
    (0..MOST_STEPS).find(is_wall).filter(|step| *step > 0).map(|step| step as f32 * STEP_M)
}
