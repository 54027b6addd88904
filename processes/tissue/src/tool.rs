//! The tool: the rigid object as points, with the area that each stands for and the edges between them. Its shaft comes first, then its loop electrode, which
//! is solid only while it is out of its sheath and there is no current in it: with current it cuts.

use glam::{Quat, Vec3};
use hyst_contact::PointGraph;
use hyst_messages::Pose;
use hyst_scene::{LoadedLoop, LoadedRigid, Tip};

/// Neighbours that a point is joined with: a point set on a surface has about six.
const NEIGHBOURS: usize = 6;
/// From one point of the loop's arms to the next, m: a third of an edge of the scene's meshes.
const ARM_STEP_M: f32 = 0.001;
/// Width of the tissue that a wire meets, m: far more than its own, because it presses all aside that is beside it. With the stiffness of the contacts
/// a metre of wire is met with 150 kPa, several times the modulus of tissue of 30 kPa, which a line load would be met with.
const STRIP_M: f32 = 0.002;

/// Where a point is that is not there: no table of points keeps it, so that it meets nothing.
pub const NOWHERE: [f32; 3] = [f32::INFINITY; 3];

/// The tool's model.
#[derive(Clone, Debug)]
pub struct Tool {
    /// Points in the tool's own frame: tip at the origin, shaft along −z, m; those of the loop at extension 0.
    pub points_m: Vec<[f32; 3]>,
    /// How many are the shaft's.
    pub shaft: usize,
    /// Area that each point stands for, m².
    pub area_m2: Vec<f32>,
    /// Edges between neighbours.
    pub graph: PointGraph,
    /// Unit vectors out of the tool in its own frame; zero for a wire, which has tissue on all sides.
    pub outward: Vec<[f32; 3]>,
}

impl Tool {
    /// The tool of a scene's instrument.
    pub fn of(rigid: &LoadedRigid) -> Tool {
        let mut tool = Tool::new(rigid.points_m.clone(), rigid.electrode.as_ref());
        for (outward, point) in tool.outward.iter_mut().zip(&rigid.points_m) {
            *outward = outward_at(rigid, Vec3::from(*point)).to_array();
        }
        tool
    }

    /// A tool from the points of its shaft, the first of them foremost, and its loop.
    pub fn new(mut points_m: Vec<[f32; 3]>, electrode: Option<&LoadedLoop>) -> Tool {
        let mut edges = Vec::new();
        let shaft = points_m.len();
        let mut area_m2 = Vec::with_capacity(shaft);
        for (index, point) in points_m.iter().enumerate() {
            let mut others: Vec<(f32, u32)> = points_m
                .iter()
                .enumerate()
                .filter(|(other, _)| *other != index)
                .map(|(other, at)| (Vec3::from(*point).distance_squared(Vec3::from(*at)), other as u32))
                .collect();
            others.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            others.truncate(NEIGHBOURS);
            edges.extend(others.iter().map(|(_, other)| [index as u32, *other]));
            // In a triangular lattice of spacing d each point stands for √3/2·d².
            let mean = others.iter().map(|(squared, _)| squared).sum::<f32>() / others.len().max(1) as f32;
            area_m2.push(0.866 * mean);
        }
        if let Some(electrode) = electrode {
            let (wire_m, arms) = wire(electrode);
            edges.extend((1..wire_m.len()).map(|next| [next - 1, next].map(|point| (shaft + point) as u32)));
            // Of an arm that lies in tissue along its whole length the foremost point of the shaft says which way is out.
            let of_arms = (0..arms).chain(wire_m.len() - arms..wire_m.len());
            edges.extend(of_arms.map(|point| [0, (shaft + point) as u32]));
            area_m2.extend((0..wire_m.len()).map(|point| STRIP_M * length_m(&wire_m, point)));
            points_m.extend(wire_m);
        }
        let graph = PointGraph::from_edges(points_m.len(), &edges);
        let outward = vec![[0.0; 3]; points_m.len()];
        Tool { points_m, shaft, area_m2, graph, outward }
    }

    /// Puts the points where the pose says, and the solid loop, if there is one, so far out; 0: nowhere.
    pub fn place(&self, pose: &Pose, loop_m: f32, out_m: &mut [[f32; 3]]) {
        let at = self.placer(pose, loop_m);
        out_m.iter_mut().enumerate().take(self.points_m.len()).for_each(|(index, out)| *out = at(index));
    }

    /// Where a pose, and a loop that is so far out, put a point.
    pub fn placer(&self, pose: &Pose, loop_m: f32) -> impl Fn(usize) -> [f32; 3] {
        let turn = Quat::from_array(pose.orientation);
        let tip = Vec3::from(pose.position_m);
        move |index| {
            let point = Vec3::from(self.points_m[index]);
            let ahead = point + Vec3::Z * loop_m;
            match index < self.shaft {
                true => (tip + turn * point).to_array(),
                false if loop_m > 0.0 && ahead.z > 0.0 => (tip + turn * ahead).to_array(),
                false => NOWHERE,
            }
        }
    }
}

/// Out of the shaft at one of its points: a capsule, or a cylinder with a flat end.
fn outward_at(rigid: &LoadedRigid, point: Vec3) -> Vec3 {
    let middle_z = match rigid.tip {
        Tip::Round => point.z.min(-rigid.radius_m),
        Tip::Flat if point.z >= 0.0 => return Vec3::Z,
        Tip::Flat => point.z,
    };
    (point - Vec3::Z * middle_z).normalize_or_zero()
}

/// The wire at extension 0 from the sheath over the half ring and back into it, and how many points each of its arms has: as many as are out at most.
fn wire(electrode: &LoadedLoop) -> (Vec<[f32; 3]>, usize) {
    let arms = (electrode.reach_m / ARM_STEP_M).ceil().max(1.0) as usize - 1;
    let behind = |end: [f32; 3], step: usize| [end[0], end[1], end[2] - step as f32 * ARM_STEP_M];
    let [first, last] = [electrode.wire_m.first(), electrode.wire_m.last()].map(|end| end.copied().unwrap_or_default());
    let one = (1..=arms).rev().map(|step| behind(first, step));
    let other = (1..=arms).map(|step| behind(last, step));
    (one.chain(electrode.wire_m.iter().copied()).chain(other).collect(), arms)
}

/// Half of what lies between a point of the wire and its neighbours, m.
fn length_m(wire_m: &[[f32; 3]], point: usize) -> f32 {
    let to = |other: Option<usize>| {
        let other = other.and_then(|other| wire_m.get(other));
        other.map_or(0.0, |other| Vec3::from(*other).distance(Vec3::from(wire_m[point])))
    };
    (to(point.checked_sub(1)) + to(Some(point + 1))) / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_areas_of_a_flat_square_of_points_add_up_to_it() {
        let points: Vec<[f32; 3]> = (0..400).map(|i| [(i % 20) as f32 * 1e-3, (i / 20) as f32 * 1e-3, 0.0]).collect();
        let tool = Tool::new(points, None);
        let area: f32 = tool.area_m2.iter().sum();
        assert!((area / 400e-6 - 1.0).abs() < 0.35, "{area}");
    }

    #[test]
    fn a_pose_puts_the_tip_where_it_says() {
        let tool = Tool::new(vec![[0.0; 3], [0.0, 0.0, -0.01]], None);
        let quarter = Quat::from_rotation_y(std::f32::consts::FRAC_PI_2);
        let pose = Pose { position_m: [1.0, 2.0, 3.0], orientation: quarter.to_array(), ..Pose::default() };
        let mut out = [[0.0; 3]; 2];
        tool.place(&pose, 0.0, &mut out);
        assert_eq!(out[0], [1.0, 2.0, 3.0]);
        assert!((out[1][0] - 0.99).abs() < 1e-6, "{out:?}");
    }

    #[test]
    fn the_loop_is_where_it_is_out_and_nowhere_else() {
        let scene = hyst_scene::load_embedded().unwrap();
        let (rigid, electrode) = (&scene.rigid[0], scene.rigid[0].electrode.as_ref().unwrap());
        let tool = Tool::new(rigid.points_m.clone(), Some(electrode));
        let count = tool.points_m.len();
        assert_eq!((tool.shaft, count, tool.area_m2.len(), tool.graph.points()), (400, 400 + 17 + 2 * 11, count, count));
        let pose = Pose { position_m: [0.0, 0.0, 0.1], orientation: [0.0, 0.0, 0.0, 1.0], ..Pose::default() };
        let out = |loop_m: f32| {
            let mut out = vec![[0.0; 3]; count];
            tool.place(&pose, loop_m, &mut out);
            out.split_off(tool.shaft)
        };
        let is_there = |point: &&[f32; 3]| point[2].is_finite();
        assert_eq!(out(0.0), vec![NOWHERE; count - tool.shaft]);
        // The ring, and of each arm what is out of the sheath: 1 and 2 mm behind the ring, and all.
        for (loop_m, arms) in [(0.0025, 2), (electrode.reach_m, 11)] {
            let out = out(loop_m);
            assert_eq!(out.iter().filter(is_there).count(), 17 + 2 * arms, "{loop_m} m out");
            let (low, high) =
                out.iter().filter(is_there).fold((f32::MAX, 0.0f32), |(low, high), at| (low.min(at[2]), high.max(at[2])));
            assert!((high - 0.1 - loop_m).abs() < 1e-6 && low > 0.1, "{low} to {high}");
        }
        // The wire's area is a strip of its length, and each point but the ends has its two neighbours.
        let length_m = std::f32::consts::PI * electrode.radius_m + 2.0 * 0.011;
        let area_m2: f32 = tool.area_m2[tool.shaft..].iter().sum();
        assert!((area_m2 / (STRIP_M * length_m) - 1.0).abs() < 0.01, "{area_m2}");
        let apex = (tool.shaft + 11 + 8) as u32;
        assert_eq!(tool.graph.joined(apex), [apex - 1, apex + 1]);
        assert_eq!(tool.graph.joined(tool.shaft as u32), [0, tool.shaft as u32 + 1], "an end of an arm and the tip");
    }

    #[test]
    fn the_outside_of_a_capsule_is_where_its_surface_looks() {
        let scene = hyst_scene::load_embedded().unwrap();
        let tool = Tool::of(&scene.rigid[0]);
        for (point, outward) in tool.points_m.iter().zip(&tool.outward).take(tool.shaft) {
            let (point, outward) = (Vec3::from(*point), Vec3::from(*outward));
            let axis = Vec3::new(0.0, 0.0, point.z.min(-scene.rigid[0].radius_m));
            assert!(
                (outward.length() - 1.0).abs() < 1e-5 && outward.dot((point - axis).normalize()) > 0.9999,
                "{point} {outward}"
            );
        }
        assert_eq!(tool.outward[0], [0.0, 0.0, 1.0]);
        assert!(tool.outward[tool.shaft..].iter().all(|outward| *outward == [0.0; 3]), "a wire has tissue on all sides");
    }
}
