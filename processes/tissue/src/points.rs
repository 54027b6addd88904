//! The points of the contact test: those of the tool, then the nodes of tissue that may meet other tissue: the surfaces of what grows in the cavity and of what
//! has come free. All else meets them with its tets.

use crate::body::Body;
use crate::tool::Tool;
use crate::world::{Case, TOOL_ID};
use glam::Vec3;
use hyst_contact::{HashMut, HashSizes, Hit, Layout, NONE, PointGraph, Points, Share, Tissue, Topology, intersect};
use hyst_engine::Failure;
use hyst_messages::Pose;
use hyst_messages::stream::{ObjectKind, ObjectRecord};
use hyst_tissue::Attachment;

/// Points and what is known of them; all lists are parallel.
#[derive(Clone, Debug, Default)]
pub struct ContactPoints {
    /// How many are the tool's; they come first.
    pub tool: usize,
    /// Object of each.
    pub owner: Vec<u32>,
    /// Tissue node that each is, [`NONE`] for the tool's.
    pub node: Vec<u32>,
    /// Area that each stands for, at rest, m².
    pub area_m2: Vec<f32>,
    /// Edges between neighbours on one surface.
    pub graph: PointGraph,
    /// For each node of the tissue, whether it is at the surface of its object.
    pub is_surface: Vec<bool>,
}

impl ContactPoints {
    /// Those of a body and the case's tool. Nodes that lie in another object of the scene at rest, as the root of a polyp in the wall, meet nobody; nor do
    /// those beside the root of what is held, which comes out of the wall there.
    pub fn of(
        case: &Case,
        body: &Body,
        topology: &Topology,
        objects: &[ObjectRecord],
        attachments: &[Attachment],
    ) -> Result<ContactPoints, Failure> {
        let tool = &case.tool;
        let mut points = ContactPoints {
            tool: tool.points_m.len(),
            owner: vec![TOOL_ID; tool.points_m.len()],
            node: vec![NONE; tool.points_m.len()],
            area_m2: tool.area_m2.clone(),
            graph: PointGraph::default(),
            is_surface: vec![false; body.rest.positions_m.len()],
        };
        topology.boundary.iter().flatten().for_each(|node| points.is_surface[*node as usize] = true);
        let mut area_m2 = vec![0.0f32; body.rest.positions_m.len()];
        let mut owner_of = vec![NONE; area_m2.len()];
        let is_free = |object: u32| objects.get(object as usize).is_some_and(ObjectRecord::is_free_piece);
        let grows = |object: &ObjectRecord| object.kind == ObjectKind::Pathology as u32;
        let may_meet = |object: u32| is_free(object) || objects.get(object as usize).is_some_and(grows);
        let faces = topology.boundary.iter().zip(&topology.boundary_owner).filter(|(_, owner)| may_meet(**owner));
        for (face, owner) in faces.clone() {
            let [a, b, c] = face.map(|node| Vec3::from(body.rest.positions_m[node as usize]));
            let share_m2 = (b - a).cross(c - a).length() / 6.0;
            for node in face {
                area_m2[*node as usize] += share_m2;
                owner_of[*node as usize] = *owner;
            }
        }
        let buried = buried(case, body, &owner_of)?;
        let mut is_root = body.fixed.clone();
        attachments.iter().map(|held| held.node).chain(buried.iter().copied()).for_each(|node| is_root[node as usize] = true);
        for (tet, object) in body.rest.tets.iter().zip(&body.rest.regions) {
            if may_meet(*object) && !is_free(*object) && tet.iter().any(|node| is_root[*node as usize]) {
                tet.iter().for_each(|node| owner_of[*node as usize] = NONE);
            }
        }
        buried.into_iter().for_each(|node| owner_of[node as usize] = NONE);
        let mut place = vec![NONE; owner_of.len()];
        for (node, owner) in owner_of.iter().enumerate().filter(|(_, owner)| **owner != NONE) {
            place[node] = (points.owner.len() - points.tool) as u32;
            points.owner.push(*owner);
            points.node.push(node as u32);
            points.area_m2.push(area_m2[node]);
        }
        let triangles: Vec<[u32; 3]> = faces.map(|(face, _)| face.map(|node| place[node as usize])).collect();
        let of_tissue = PointGraph::from_triangles(points.owner.len() - points.tool, &triangles);
        points.graph = tool.graph.followed_by(&of_tissue);
        Ok(points)
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.owner.len()
    }

    /// As the contact crate sees them.
    pub fn view(&self) -> Points<'_> {
        Points { owner: &self.owner, node: &self.node, self_contact: false }
    }

    /// Puts the tool's points where the pose and its loop's way out say, and the others where their nodes are.
    pub fn place(&self, tool: &Tool, (pose, loop_m): (&Pose, f32), positions_m: &[[f32; 3]], out_m: &mut [[f32; 3]]) {
        let (of_tool, of_tissue) = out_m.split_at_mut(self.tool.min(out_m.len()));
        tool.place(pose, loop_m, of_tool);
        for (out, node) in of_tissue.iter_mut().zip(&self.node[self.tool..]) {
            *out = positions_m.get(*node as usize).copied().unwrap_or([f32::NAN; 3]);
        }
    }
}

/// Nodes that lie in tissue of another object of the scene at rest, of those that have an owner.
fn buried(case: &Case, body: &Body, owner_of: &[u32]) -> Result<Vec<u32>, Failure> {
    let broken = |error: hyst_contact::ContactError| Failure::Broken(error.to_string());
    let nodes: Vec<u32> = (0..owner_of.len() as u32).filter(|node| owner_of[*node as usize] != NONE).collect();
    if nodes.is_empty() {
        return Ok(nodes);
    }
    let owner: Vec<u32> = nodes.iter().map(|node| owner_of[*node as usize]).collect();
    let points_m: Vec<[f32; 3]> = nodes.iter().map(|node| body.rest.positions_m[*node as usize]).collect();
    let sizes = HashSizes::for_points(points_m.len());
    let mut words = vec![0; sizes.words()];
    let mut hash = HashMut::in_words(&mut words, sizes).map_err(broken)?;
    hash.build(&points_m, case.cell_m, Layout::Auto).map_err(broken)?;
    let hash = hyst_contact::HashRef::in_words(&words).map_err(broken)?;
    // Whose a tet was in the scene: where two parts of one object touch after a cut, neither is buried in the other.
    let origin = |object: &u32| case.origin(body, *object) as u32;
    let (owner, of_tet): (Vec<u32>, Vec<u32>) =
        (owner.iter().map(origin).collect(), body.rest.regions.iter().map(origin).collect());
    let tissue = Tissue { positions_m: &body.rest.positions_m, tets: &body.rest.tets, tet_owner: &of_tet };
    let mut hits = vec![Hit::default(); 4 * points_m.len()];
    let points = Points { owner: &owner, node: &[], self_contact: false };
    let found = intersect(Share::ALL, &hash, &points, &tissue, &mut hits).map_err(broken)?;
    Ok(hits[..found.count].iter().map(|hit| nodes[hit.point as usize]).collect())
}
