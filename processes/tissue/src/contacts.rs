//! From hits to springs for the deformation, forces on the tool, and planes for the servo.

use crate::site::MAX_OBJECTS;
use crate::world::World;
use hyst_contact::{
    ContactForce, Gap, HashRef, Hit, Memory, Motion, Penetration, PenetrationInput, PenetrationParams, PlaneInput, PlaneParams,
    PlaneSet, Points, ResponseOutput, ResponseParams, Retreat, Rigid, Tissue, Workspace, Wrench, find_gaps, penetration, planes,
    respond,
};
use hyst_engine::Failure;
use hyst_tissue::{PlaneSpring, gather};

/// Contact stiffness per area, N/m³: a tip of 5 mm diameter (20 mm²) is met with about 1.5 kN/m, several times stiffer than tissue of 30 kPa
/// under it, so that the tissue yields and not the contact.
pub const STIFFNESS_N_M3: f32 = 7.5e7;
/// No tool point is taken deeper than this, m: a thick wall.
const MAX_DEPTH_M: f32 = 0.02;
/// Range in which the servo knows a wall before it is met, m: 0.5 m/s for 4 ms.
const ANTICIPATION_M: f32 = 0.002;
/// Largest force of one point, N.
const MAX_POINT_FORCE_N: f32 = 5.0;

const RESPONSE: ResponseParams = ResponseParams {
    stiffness_n_m3: STIFFNESS_N_M3,
    damping_speed_m_s: f32::INFINITY,
    friction: 0.05, // wet mucosa against metal slides
    slip_speed_m_s: 0.01,
    max_point_force_n: MAX_POINT_FORCE_N,
};

/// Buffers of the contact part of a step, sized once.
pub struct Contacts {
    work: Workspace,
    owner: Vec<u32>,
    area_m2: Vec<f32>,
    velocity_m_s: Vec<[f32; 3]>,
    found: Vec<Penetration>,
    forces: Vec<ContactForce>,
    node_force_n: Vec<[f32; 3]>,
    gaps: Vec<Gap>,
    /// Springs for the deformation; those in use are the first [`Contacts::count`].
    springs: Vec<PlaneSpring>,
    count: usize,
    tool_id: u32,
}

/// The tool in one step.
#[derive(Clone, Copy, Debug)]
pub struct ToolMotion<'a> {
    /// Points where they are, m.
    pub points_m: &'a [[f32; 3]],
    /// Velocity of the tip, taken for all points, m/s.
    pub velocity_m_s: [f32; 3],
    /// Tip, m.
    pub tip_m: [f32; 3],
    /// From tip to pivot, any length.
    pub back: [f32; 3],
}

/// Tissue as the contact crate sees it.
pub fn tissue<'a>(world: &'a World, positions_m: &'a [[f32; 3]]) -> Tissue<'a> {
    Tissue { positions_m, tets: world.model.tets(), tet_owner: &world.body.rest.regions }
}

impl Contacts {
    /// Buffers for a world.
    pub fn new(world: &World) -> Contacts {
        let points = world.case.tool.points_m.len();
        let hits = max_hits(world);
        let tool_id = MAX_OBJECTS as u32; // a number that no tet has, also when pieces come free
        Contacts {
            work: Workspace::new(points, hits, world.model.node_count()),
            owner: vec![tool_id; points],
            area_m2: world.case.tool.area_m2.clone(),
            velocity_m_s: vec![[0.0; 3]; points],
            found: vec![Penetration::default(); hits],
            forces: vec![ContactForce::default(); hits],
            node_force_n: vec![[0.0; 3]; world.model.node_count()],
            gaps: vec![Gap::FAR; points],
            springs: Vec::with_capacity(hits),
            count: 0,
            tool_id,
        }
    }

    /// Whom the tool's points belong to.
    pub fn points(&self) -> Points<'_> {
        Points { owner: &self.owner, node: &[], self_contact: false }
    }

    /// Depth, direction and force of each hit; the springs that the deformation feels.
    pub fn meet(
        &mut self,
        world: &World,
        hits: &[Hit],
        tool: &ToolMotion<'_>,
        positions_m: &[[f32; 3]],
        velocities_m_s: &[[f32; 3]],
        memory: &mut [Memory],
    ) -> Result<(), Failure> {
        let broken = |error: hyst_contact::ContactError| Failure::Broken(error.to_string());
        let tissue = tissue(world, positions_m);
        let points = Points { owner: &self.owner, node: &[], self_contact: false };
        let input = PenetrationInput {
            hits,
            points_m: tool.points_m,
            points,
            graph: &world.case.tool.graph,
            tissue,
            topology: &world.topology,
        };
        let retreats = [Retreat { owner: self.tool_id, direction: tool.back }];
        let params = PenetrationParams { max_depth_m: MAX_DEPTH_M, retreats: &retreats };
        self.count = penetration(&input, &params, memory, &mut self.work, &mut self.found).map_err(broken)?.count;
        self.velocity_m_s.fill(tool.velocity_m_s);
        self.node_force_n.fill([0.0; 3]);
        let motion = Motion {
            points_m: tool.points_m,
            point_velocity_m_s: &self.velocity_m_s,
            point_area_m2: &self.area_m2,
            node_velocity_m_s: velocities_m_s,
        };
        let rigids = [Rigid { owner: self.tool_id, reference_m: tool.tip_m }];
        let mut wrenches = [Wrench::default()];
        let mut out =
            ResponseOutput { node_force_n: &mut self.node_force_n, wrenches: &mut wrenches, contacts: &mut self.forces };
        let found = &self.found[..self.count];
        let answered = respond(found, &points, &motion, &tissue, &rigids, &RESPONSE, &mut out).map_err(broken)?;
        self.count = answered.count;
        self.spring(world, tool);
        Ok(())
    }

    /// A contact is a law for the deformation, not a force: it is evaluated in every substep.
    fn spring(&mut self, world: &World, tool: &ToolMotion<'_>) {
        self.springs.clear();
        self.node_force_n.fill([0.0; 3]);
        for (found, force) in self.found[..self.count].iter().zip(&self.forces) {
            let Some(nodes) = world.model.tets().get(found.tet as usize) else { continue };
            let point = tool.points_m[found.point as usize];
            let normal = found.direction.map(|c| -c);
            let along: f32 = normal.iter().zip(point).map(|(n, p)| n * p).sum();
            let stiffness_n_m = STIFFNESS_N_M3 * self.area_m2[found.point as usize];
            self.springs.push(PlaneSpring {
                nodes: *nodes,
                weights: found.weights.map(|w| w.clamp(0.0, 1.0)),
                normal,
                offset_m: along + found.depth_m,
                stiffness_n_m,
            });
            // Friction acts on the tissue as a force of the step: it is bounded by the normal force.
            let friction: [f32; 3] = std::array::from_fn(|axis| force.normal_n * found.direction[axis] - force.force_n[axis]);
            hyst_tissue::scatter(*nodes, found.weights, friction, &mut self.node_force_n);
        }
    }

    /// Springs of the step.
    pub fn springs(&self) -> &[PlaneSpring] {
        &self.springs
    }

    /// Forces on the nodes beside the springs, N, to which others may add.
    pub fn node_force_n(&mut self) -> &mut [[f32; 3]] {
        &mut self.node_force_n
    }

    /// Forces on the nodes beside the springs, N.
    pub fn forces_n(&self) -> &[[f32; 3]] {
        &self.node_force_n
    }

    /// Contacts in the step.
    pub fn count(&self) -> usize {
        self.count
    }

    /// The planes for the servo and the force on the tool, from the tissue as it is after the step.
    pub fn planes(
        &mut self,
        world: &World,
        hash: &HashRef<'_>,
        tool: &ToolMotion<'_>,
        positions_m: &[[f32; 3]],
    ) -> Result<(PlaneSet, [f32; 3]), Failure> {
        let mut total = [0.0f32; 3];
        for (spring, force) in self.springs.iter().zip(&mut self.forces) {
            let at = gather(spring.nodes, spring.weights, positions_m).unwrap_or([0.0; 3]);
            let along: f32 = spring.normal.iter().zip(at).map(|(n, p)| n * p).sum();
            let before = force.normal_n;
            force.normal_n = (spring.stiffness_n_m * (spring.offset_m - along)).clamp(0.0, MAX_POINT_FORCE_N);
            force.stiffness_n_m = spring.stiffness_n_m;
            for ((sum, part), along) in total.iter_mut().zip(&mut force.force_n).zip(force.direction) {
                *part += (force.normal_n - before) * along;
                *sum += *part;
            }
        }
        let points = Points { owner: &self.owner, node: &[], self_contact: false };
        let tissue = tissue(world, positions_m);
        find_gaps(hash, &points, &tissue, &world.topology, ANTICIPATION_M, &mut self.gaps)
            .map_err(|error| Failure::Broken(error.to_string()))?;
        let input = PlaneInput {
            contacts: &self.forces[..self.springs.len()],
            gaps: &self.gaps,
            owner: &self.owner,
            point_area_m2: &self.area_m2,
            tip_m: tool.tip_m,
            tool: self.tool_id,
        };
        let params = PlaneParams { range_m: ANTICIPATION_M, stiffness_n_m3: STIFFNESS_N_M3 };
        Ok((planes(&input, &params), total))
    }
}

/// Room for hits: each tool point in at most two objects.
pub fn max_hits(world: &World) -> usize {
    2 * world.case.tool.points_m.len()
}
