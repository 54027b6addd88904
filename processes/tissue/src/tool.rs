//! The tool: the rigid object as points, with the area that each stands for and the edges between them. Its shaft comes first, then its working element: a
//! loop electrode, which is solid only while it is out of its sheath and there is no current in it, for with current it cuts; or jaws, which are
//! solid wherever they stand, and then their pads, which look what lies between them.

use glam::{Quat, Vec3};
use hyst_contact::PointGraph;
use hyst_messages::Pose;
use hyst_scene::{LoadedJaws, LoadedLoop, LoadedRigid};
use std::ops::Range;

/// Neighbours that a point is joined with: a point set on a surface has about six.
const NEIGHBOURS: usize = 6;
/// From one point of the loop's arms to the next, m: a third of an edge of the scene's meshes.
const ARM_STEP_M: f32 = 0.001;
/// Width of the tissue that a wire meets, m: far more than its own, because it presses all aside that is beside it. With the stiffness of the contacts
/// a metre of wire is met with 150 kPa, several times the modulus of tissue of 30 kPa, which a line load would be met with.
const STRIP_M: f32 = 0.002;
/// Points of a jaw that are so near to its hinge, as a share of its length, are joined with the foremost point of the shaft.
const HINGE_SHARE: f32 = 0.3;

/// Where a point is that is not there: no table of points keeps it, so that it meets nothing.
pub const NOWHERE: [f32; 3] = [f32::INFINITY; 3];

/// The tool's model.
#[derive(Clone, Debug)]
pub struct Tool {
    /// Points in the tool's own frame: tip at the origin, shaft along −z, m; those of the loop at extension 0, those of jaws closed.
    pub points_m: Vec<[f32; 3]>,
    /// How many are the shaft's.
    pub shaft: usize,
    /// From which on they are pads: no contact, and solid never.
    pub pads: usize,
    /// Area that each point stands for, m²; a pad for none.
    pub area_m2: Vec<f32>,
    /// Edges between neighbours.
    pub graph: PointGraph,
    /// Unit vectors out of the tool in its own frame; zero for a wire and for jaws, which have tissue on all sides.
    pub outward: Vec<[f32; 3]>,
    jaws: Option<LoadedJaws>,
}

/// How the tool's working element stands.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Stand {
    /// How far a loop is out, or jaws are apart, m; `None` where nothing of it is solid, which jaws always are.
    pub solid_m: Option<f32>,
    /// Whether the pads look what lies between the jaws.
    pub looks: bool,
}

impl Stand {
    /// A loop that is so far out, m; in its sheath it is not solid.
    pub fn of_loop(out_m: f32) -> Stand {
        Stand { solid_m: (out_m > 0.0).then_some(out_m), looks: false }
    }
}

/// Points as they are put together.
#[derive(Default)]
struct Parts {
    points_m: Vec<[f32; 3]>,
    area_m2: Vec<f32>,
    edges: Vec<[u32; 2]>,
}

impl Parts {
    /// Adds points on a surface, each joined with its nearest neighbours among them. Without an area of each it is that of a triangular lattice.
    fn add_surface(&mut self, points_m: impl Iterator<Item = [f32; 3]>, area_m2: Option<f32>) {
        let first = self.points_m.len();
        self.points_m.extend(points_m);
        let own = &self.points_m[first..];
        for (index, point) in own.iter().enumerate() {
            let mut others: Vec<(f32, u32)> = own
                .iter()
                .enumerate()
                .filter(|(other, _)| *other != index)
                .map(|(other, at)| (Vec3::from(*point).distance_squared(Vec3::from(*at)), (first + other) as u32))
                .collect();
            others.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            others.truncate(NEIGHBOURS);
            self.edges.extend(others.iter().map(|(_, other)| [(first + index) as u32, *other]));
            // In a triangular lattice of spacing d each point stands for √3/2·d².
            let mean = others.iter().map(|(squared, _)| squared).sum::<f32>() / others.len().max(1) as f32;
            self.area_m2.push(area_m2.unwrap_or(0.866 * mean));
        }
    }

    /// Adds the wire of a loop. Of an arm that lies in tissue along its whole length the foremost point of the shaft says which way is out.
    fn add_loop(&mut self, electrode: &LoadedLoop) {
        let first = self.points_m.len();
        let (wire_m, arms) = wire(electrode);
        self.edges.extend((1..wire_m.len()).map(|next| [next - 1, next].map(|point| (first + point) as u32)));
        let of_arms = (0..arms).chain(wire_m.len() - arms..wire_m.len());
        self.edges.extend(of_arms.map(|point| [0, (first + point) as u32]));
        self.area_m2.extend((0..wire_m.len()).map(|point| STRIP_M * length_m(&wire_m, point)));
        self.points_m.extend(wire_m);
    }

    /// Adds the jaw on the side of +x, the other one and the pads; gives where the pads begin. Of a jaw that lies in tissue along its whole length the foremost
    /// point of the shaft says which way is out.
    fn add_jaws(&mut self, jaws: &LoadedJaws) -> usize {
        for side in [1.0, -1.0] {
            let first = self.points_m.len();
            self.add_surface(jaws.points_m.iter().map(|[x, y, z]| [side * x, *y, *z]), Some(jaws.point_area_m2));
            let is_near = |point: &usize| self.points_m[*point][2] < HINGE_SHARE * jaws.length_m;
            self.edges.extend((first..self.points_m.len()).filter(is_near).map(|point| [0, point as u32]));
        }
        let pads = self.points_m.len();
        self.points_m.extend_from_slice(&jaws.pads_m);
        self.area_m2.resize(self.points_m.len(), 0.0);
        pads
    }
}

impl Tool {
    /// The tool of a scene's instrument.
    pub fn of(rigid: &LoadedRigid) -> Tool {
        let mut tool = Tool::with(&rigid.points_m, rigid.electrode.as_ref(), rigid.jaws.as_ref());
        tool.outward[..tool.shaft].copy_from_slice(&rigid.outward);
        tool
    }

    /// A tool from the points of its shaft, the first of them foremost, and its working element.
    fn with(points_m: &[[f32; 3]], electrode: Option<&LoadedLoop>, jaws: Option<&LoadedJaws>) -> Tool {
        let (mut parts, shaft) = (Parts::default(), points_m.len());
        parts.add_surface(points_m.iter().copied(), None);
        if let Some(electrode) = electrode {
            parts.add_loop(electrode);
        }
        let pads = jaws.map(|jaws| parts.add_jaws(jaws));
        let Parts { points_m, area_m2, edges } = parts;
        let graph = PointGraph::from_edges(points_m.len(), &edges);
        let outward = vec![[0.0; 3]; points_m.len()];
        Tool { shaft, pads: pads.unwrap_or(points_m.len()), area_m2, graph, outward, jaws: jaws.cloned(), points_m }
    }

    /// The points of the jaw on the side of +x, those of the other one, and the pads; of a tool without jaws nobody asks.
    pub fn parts(&self) -> [Range<usize>; 3] {
        let half = self.shaft + (self.pads - self.shaft) / 2;
        [self.shaft..half, half..self.pads, self.pads..self.points_m.len()]
    }

    /// Its jaws.
    pub fn jaws(&self) -> Option<&LoadedJaws> {
        self.jaws.as_ref()
    }

    /// Puts the points where the pose says, and its working element as it stands.
    pub fn place(&self, pose: &Pose, stand: Stand, out_m: &mut [[f32; 3]]) {
        let at = self.placer(pose, stand);
        out_m.iter_mut().enumerate().take(self.points_m.len()).for_each(|(index, out)| *out = at(index));
    }

    /// Where a pose and a stand put a point.
    pub fn placer(&self, pose: &Pose, stand: Stand) -> impl Fn(usize) -> [f32; 3] {
        let turn = Quat::from_array(pose.orientation);
        let tip = Vec3::from(pose.position_m);
        let opened = self.jaws.as_ref().zip(stand.solid_m).map(|(jaws, apart_m)| jaws.turn(apart_m));
        let [right, ..] = self.parts();
        move |index| {
            let point = Vec3::from(self.points_m[index]);
            let own = match (opened, stand.solid_m) {
                _ if index < self.shaft => Some(point),
                _ if index >= self.pads => stand.looks.then_some(point),
                (Some(opened), _) => Some(if right.contains(&index) { opened * point } else { opened.inverse() * point }),
                (None, Some(out_m)) => Some(point + Vec3::Z * out_m).filter(|ahead| ahead.z > 0.0),
                (None, None) => None,
            };
            own.map_or(NOWHERE, |point| (tip + turn * point).to_array())
        }
    }
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
        let tool = Tool::with(&points, None, None);
        let area: f32 = tool.area_m2.iter().sum();
        assert!((area / 400e-6 - 1.0).abs() < 0.35, "{area}");
    }

    #[test]
    fn a_pose_puts_the_tip_where_it_says() {
        let tool = Tool::with(&[[0.0; 3], [0.0, 0.0, -0.01]], None, None);
        let quarter = Quat::from_rotation_y(std::f32::consts::FRAC_PI_2);
        let pose = Pose { position_m: [1.0, 2.0, 3.0], orientation: quarter.to_array(), ..Pose::default() };
        let mut out = [[0.0; 3]; 2];
        tool.place(&pose, Stand::default(), &mut out);
        assert_eq!(out[0], [1.0, 2.0, 3.0]);
        assert!((out[1][0] - 0.99).abs() < 1e-6, "{out:?}");
    }

    #[test]
    fn the_loop_is_where_it_is_out_and_nowhere_else() {
        let scene = hyst_scene::load_embedded().unwrap();
        let (rigid, electrode) = (&scene.rigid[0], scene.rigid[0].electrode.as_ref().unwrap());
        let tool = Tool::with(&rigid.points_m, Some(electrode), None);
        let count = tool.points_m.len();
        assert_eq!((tool.shaft, count, tool.area_m2.len(), tool.graph.points()), (400, 400 + 17 + 2 * 11, count, count));
        let pose = Pose { position_m: [0.0, 0.0, 0.1], orientation: [0.0, 0.0, 0.0, 1.0], ..Pose::default() };
        let out = |loop_m: f32| {
            let mut out = vec![[0.0; 3]; count];
            tool.place(&pose, Stand::of_loop(loop_m), &mut out);
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
    fn jaws_open_about_their_hinge_to_both_sides_and_their_pads_are_there_while_they_look() {
        let scene = hyst_scene::load(&crate::grasper_scene()).unwrap();
        let (rigid, jaws) = (&scene.rigid[0], scene.rigid[0].jaws.as_ref().unwrap());
        let tool = Tool::of(rigid);
        let (shaft, each) = (tool.shaft, jaws.points_m.len());
        assert_eq!((tool.pads, tool.points_m.len()), (shaft + 2 * each, shaft + 2 * each + jaws.pads_m.len()));
        assert!(rigid.electrode.is_none() && tool.outward[shaft..].iter().all(|outward| *outward == [0.0; 3]));
        let pose = Pose { position_m: [0.0, 0.0, 0.1], orientation: [0.0, 0.0, 0.0, 1.0], ..Pose::default() };
        let place = |solid_m: Option<f32>, looks: bool| {
            let mut out = vec![[0.0; 3]; tool.points_m.len()];
            tool.place(&pose, Stand { solid_m, looks }, &mut out);
            out.split_off(shaft)
        };
        for apart_m in [0.0, 0.003, jaws.opening_m] {
            let out = place(Some(apart_m), false);
            // The foremost point of each jaw is its first one, and lies in the closing plane.
            let (right, left) = (out[0], out[each]);
            assert!((right[0] - left[0] - apart_m).abs() < 1e-5 && right[1] == left[1] && right[2] == left[2], "{apart_m}");
            assert!(
                out[..each].iter().zip(&out[each..2 * each]).all(|(a, b)| (a[0] + b[0]).abs() < 1e-7),
                "they are mirror images"
            );
            assert!(out[2 * each..].iter().all(|pad| *pad == NOWHERE));
            let reach = |point: &[f32; 3]| Vec3::from(*point).distance(Vec3::new(0.0, 0.0, 0.1));
            let closed = tool.points_m[shaft..].iter().map(|point| Vec3::from(*point).length());
            assert!(out[..2 * each].iter().map(reach).zip(closed).all(|(now, closed)| (now - closed).abs() < 1e-6), "rigid");
        }
        assert_eq!(place(None, false), vec![NOWHERE; 2 * each + jaws.pads_m.len()]);
        let looking = place(Some(0.004), true);
        assert!(looking[2 * each..].iter().all(|pad| pad[0] == 0.0 && pad[2] > 0.1), "between them");
        // The areas of both jaws are those of their surfaces; a pad stands for none.
        let area_m2: f32 = tool.area_m2[shaft..tool.pads].iter().sum();
        assert!((100e-6..160e-6).contains(&area_m2) && tool.area_m2[tool.pads..].iter().all(|area| *area == 0.0), "{area_m2}");
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
