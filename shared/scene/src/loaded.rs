//! A scene with its meshes read, checked, placed and bound: what the engines start from.

use crate::file::{DeformableKind, Look, Material, Scene};
use crate::fixed::outside_triangles;
use crate::fluid::LoadedFluid;
use crate::locate::Locator;
use crate::parts::loose_m3;
use crate::pose::{LoadedHand, Pose};
use crate::region::LoadedRegion;
use crate::rigid::LoadedRigid;
use hyst_mesh::{Binding, TetMesh, TriangleMesh};

/// A scene that is ready to run. Metres and radians, in the scene's frame.
#[derive(Debug, Clone, PartialEq)]
pub struct LoadedScene {
    /// The scene as it was read, with what a case has drawn of materials and vessels.
    pub scene: Scene,
    /// The file that it was read from.
    pub origin: String,
    /// The deformable objects, in the scene's order.
    pub objects: Vec<LoadedDeformable>,
    /// The instruments: exactly one, which the hand holds.
    pub rigid: Vec<LoadedRigid>,
    /// Pivot and limits.
    pub workspace: LoadedWorkspace,
    /// The fluid's grid and figures.
    pub fluid: LoadedFluid,
    /// The scripted hands, by ascending name: those of the scene, and `press`, `explore` and `polyp` where the geometry allows them.
    pub hands: Vec<LoadedHand>,
    /// Where the hand rests: inserted a little, straight.
    pub rest: Pose,
    /// Hash of all content: the scene, every mesh as placed, every binding and point.
    pub hash: u64,
    /// What was found, assumed or repaired, one sentence each.
    pub notes: Vec<String>,
    /// What a case has drawn from its seed, one sentence each; nothing of a scene by itself.
    pub drawn: Vec<String>,
    /// Whether the camera head goes along with a scope that somebody turns, as a case may have it; else the horizon is kept for everybody.
    pub is_head_free: bool,
}

impl LoadedScene {
    /// A scripted hand by its name.
    pub fn hand(&self, name: &str) -> Option<&LoadedHand> {
        self.hands.iter().find(|hand| hand.name == name)
    }

    /// Volume of what is to be removed, ml: of all pathology, but in a scene with jaws, which cut nothing, of what of it lies free.
    pub fn pathology_ml(&self) -> f64 {
        let has_jaws = self.rigid.first().is_some_and(|rigid| rigid.jaws.is_some());
        let pathologies = self.objects.iter().filter(|object| object.kind == DeformableKind::Pathology);
        let whole_m3 = |object: &LoadedDeformable| hyst_mesh::check(&object.mesh).volume_m3;
        pathologies.map(|object| 1e6 * if has_jaws { loose_m3(object) } else { whole_m3(object) }).sum()
    }
}

/// A deformable object, ready for simulation.
#[derive(Debug, Clone, PartialEq)]
pub struct LoadedDeformable {
    /// Its name in the scene.
    pub name: String,
    /// Organ or pathology.
    pub kind: DeformableKind,
    /// Its tets: sound, none inverted, in place. The region of a tet is 0 where it is made of `material`, else that of `regions`, counted from 1.
    pub mesh: TetMesh,
    /// Its surface for the eye, in place.
    pub surface: TriangleMesh,
    /// One per vertex of the surface: the tet and the weights that it follows.
    pub bindings: Vec<Binding>,
    /// One per node: whether it never moves.
    pub fixed: Vec<bool>,
    /// What it is made of.
    pub material: Material,
    /// Its parts that are made of something else, or that are held by what is around them.
    pub regions: Vec<LoadedRegion>,
    /// Where it is rooted.
    pub attach: Option<Attach>,
    /// How it looks, if the scene says so.
    pub look: Option<Look>,
    /// Whether it has a cavity that the instrument can be in.
    pub hollow: bool,
}

impl LoadedDeformable {
    /// Whether anything outside of the scene's objects holds it: a node is fixed, or a tet is on a bed.
    pub fn is_held(&self) -> bool {
        let on_bed = (1u32..).zip(&self.regions).filter(|(_, region)| region.bed_n_m4 > 0.0);
        self.fixed.contains(&true) || on_bed.map(|(number, _)| number).any(|number| self.mesh.regions.contains(&number))
    }

    /// Triangles of the mesh's boundary that lie on the outside of a hollow object and have no fixed node; of a solid one none.
    pub fn outside(&self) -> Vec<[u32; 3]> {
        if !self.hollow {
            return Vec::new();
        }
        let mut triangles = hyst_mesh::boundary(&self.mesh).triangles;
        triangles.retain(|triangle| triangle.iter().all(|node| self.fixed.get(*node as usize) != Some(&true)));
        outside_triangles(&self.mesh.positions_m, &triangles, &Locator::new(&self.mesh))
    }
}

/// Where an object is rooted in another one.
#[derive(Debug, Clone, PartialEq)]
pub struct Attach {
    /// Index of the host in [`LoadedScene::objects`].
    pub host: usize,
    /// The nodes that lie in the host, at least one.
    pub nodes: Vec<AttachedNode>,
}

/// A node that follows a tet of the host.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AttachedNode {
    /// Node of the attached object.
    pub node: u32,
    /// Tet of the host.
    pub tet: u32,
    /// The node's barycentric weights in that tet; they add up to 1.
    pub weights: [f32; 4],
}

/// Pivot and limits of the hand. Radians.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LoadedWorkspace {
    /// The pivot.
    pub pivot_m: [f32; 3],
    /// Lowest and highest pitch.
    pub pitch_rad: [f32; 2],
    /// Lowest and highest yaw.
    pub yaw_rad: [f32; 2],
    /// Lowest and highest roll.
    pub roll_rad: [f32; 2],
    /// Shortest and longest insertion.
    pub insertion_m: [f32; 2],
}
