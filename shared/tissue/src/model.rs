//! The immutable description of one deformable object, as [`step`](crate::step()) needs it.
//!
//! Promise: every index in a model is in range, every mass positive, every constant finite in single precision, and the
//! substeps that it asks for keep explicit integration stable (see `bound`).

use crate::bed::Bed;
use crate::build::{Materials, ModelMaker};
use crate::bulk::Bulk;
use crate::isa::Isa;
use crate::layout::{Block, Corners, RestBlock, Row};
use crate::material::Material;
use hyst_mesh::TetMesh;

/// Largest ω·h for a substep h and the bound on ω. The integrator's limit is 2.
const STABLE_PHASE: f64 = 1.95;
/// Largest ω·h for the frequency at rest. Distorted starts come to rest at 1.2; at 1.3 some keep a swing of the stiffest modes
/// that a damping of 5/s does not take out (tests `robustness`).
const CLEAN_PHASE: f64 = 1.1;
/// Most substeps in one step: more than this cannot keep up with real time, and bounds the loop.
pub const SUBSTEPS_MAX: u32 = 256;

/// How a model is made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Step for which `max_substeps` is meant, s.
    pub step_s: f64,
    /// Most substeps per `step_s`. Mass is added at the nodes that would be unstable with them; where they suffice for stability
    /// but not for a clean motion of the stiffest modes, the object needs damping.
    pub max_substeps: u32,
    /// Most mass that may be added to reach that, as a share of the object's own mass.
    pub max_added_mass_ratio: f64,
    /// Stiffness that [`PlaneSpring`](crate::PlaneSpring)s and [`Attachment`](crate::Attachment)s may add up to at any free
    /// node, N/m.
    pub contact_stiffness_n_m: f64,
    /// Largest angular frequency at rest, 1/s, where it is known well enough, as that of the mesh before a cut; `None`: it is looked for, which takes
    /// most of the time that making a model takes. Stability does not depend on it. Who cuts looks once: the first model is made with `None`, all later
    /// ones with [`ModelReport::omega_rest_per_s`] of the first.
    pub omega_rest_per_s: Option<f64>,
    /// Largest velocity per axis, m/s: a watchdog, far above what a hand does.
    pub velocity_cap_m_s: f64,
    /// How far from its place at rest a node may stray along an axis, m, where that is less than what its mesh's size lets it.
    pub most_reach_m: Option<f64>,
    /// Instruction set of the kernels.
    pub isa: Isa,
}

impl Default for Options {
    /// 1 ms, 8 substeps, at most half the mass added, no contact, 10 m/s, the widest set of this machine.
    fn default() -> Self {
        Options {
            step_s: 1e-3,
            max_substeps: 8,
            max_added_mass_ratio: 0.5,
            contact_stiffness_n_m: 0.0,
            omega_rest_per_s: None,
            velocity_cap_m_s: 10.0,
            most_reach_m: None,
            isa: Isa::detect(),
        }
    }
}

/// What making the model found and did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ModelReport {
    /// Nodes, including those that no tet uses.
    pub nodes: usize,
    /// Tets.
    pub tets: usize,
    /// Nodes that no tet uses; they stay where they are.
    pub unused_nodes: usize,
    /// Volume at rest, m³.
    pub volume_m3: f64,
    /// Mass before scaling, kg.
    pub mass_kg: f64,
    /// Mass that was added for the sake of the step, kg.
    pub added_mass_kg: f64,
    /// Nodes that it was added to.
    pub scaled_nodes: usize,
    /// Flat tets that were made softer for the sake of the step.
    pub softened_tets: usize,
    /// What they fill of [`ModelReport::volume_m3`].
    pub softened_volume_m3: f64,
    /// Shortest edge, m.
    pub shortest_edge_m: f64,
    /// Largest angular frequency at rest, 1/s, found or told.
    pub omega_rest_per_s: f64,
    /// Bound on the largest angular frequency in any state, 1/s.
    pub omega_max_per_s: f64,
    /// Substeps for [`Options::step_s`].
    pub substeps: u32,
}

/// Why no model could be made.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ModelError {
    /// No tets.
    #[error("the mesh has no tetrahedra; a deformable object needs at least one")]
    Empty,
    /// More nodes or tets than 32-bit indices hold.
    #[error("the mesh has {nodes} nodes and {tets} tets, more than 2³¹; coarsen it")]
    TooLarge {
        /// Nodes.
        nodes: usize,
        /// Tets.
        tets: usize,
    },
    /// `fixed` has another length than the nodes.
    #[error("the mask of fixed nodes has {found} entries for {expected} nodes; give one per node")]
    FixedLength {
        /// Number of nodes.
        expected: usize,
        /// Length of the mask.
        found: usize,
    },
    /// An index without a node.
    #[error("tet {tet} names node {node}, but there are {nodes}; repair the mesh (hyst-mesh `repair`)")]
    NodeIndex {
        /// The tet.
        tet: usize,
        /// The index that it names.
        node: u32,
        /// Number of nodes.
        nodes: usize,
    },
    /// A position that is NaN or infinite.
    #[error("node {node} has a coordinate that is not finite; repair the mesh (hyst-mesh `repair`)")]
    NotFinite {
        /// The node.
        node: usize,
    },
    /// A tet without positive volume, or so flat or small that its stiffness is not finite in single precision.
    #[error("tet {tet} is inverted or flat (volume {volume_m3} m³); repair the mesh (hyst-mesh `repair`)")]
    BadTet {
        /// The tet.
        tet: usize,
        /// Its signed volume, m³.
        volume_m3: f64,
    },
    /// No region, or one without a material.
    #[error("tet {tet} lies in region {region:?}, which has no material; give one for each region of the mesh")]
    Region {
        /// The tet.
        tet: usize,
        /// Its region; `None` if the mesh has fewer regions than tets.
        region: Option<u32>,
    },
    /// An option outside its range.
    #[error("option {name} is {value}: give a value {range}")]
    Option {
        /// Name of the field.
        name: &'static str,
        /// Its value.
        value: f64,
        /// The range as words.
        range: &'static str,
    },
    /// The machine lacks the instruction set.
    #[error("this machine has no {}; choose isa={}", .0.name(), Isa::detect().name())]
    Isa(Isa),
    /// The step cannot be reached with the mass that may be added.
    #[error(
        "{substeps} substeps would need {ratio:.2} times the object's mass added ({unscaled_substeps} substeps need none); \
         raise max_substeps or max_added_mass_ratio, remesh without slivers, or take a softer material"
    )]
    TooStiff {
        /// [`Options::max_substeps`].
        substeps: u32,
        /// Mass to be added over own mass.
        ratio: f64,
        /// Substeps without adding mass.
        unscaled_substeps: u32,
        /// The least [`Options::max_substeps`] with which little enough mass has to be added; no less will do, and more only where flat tets, which are softened
        /// less then, ask for it.
        enough_substeps: u32,
    },
}

/// One deformable object: rest shape, masses, and tet data in blocks of 16.
#[derive(Debug, Clone, PartialEq)]
pub struct Model {
    pub(crate) rest_m: Vec<[f32; 3]>,
    pub(crate) tets: Vec<[u32; 4]>,
    /// Fixed by the caller, or used by no tet.
    pub(crate) held: Vec<bool>,
    /// What holds nodes that are free otherwise.
    pub(crate) beds: Vec<Bed>,
    pub(crate) mass_kg: Vec<f32>,
    /// What bounds the stiffness at each node, beds and contacts included, N/m.
    pub(crate) bound_n_m: Vec<f32>,
    /// Per node row: 1/m, 0 for held nodes and in the fourth lane; 1/kg.
    pub(crate) inv_mass: Vec<Row>,
    /// Per node row: damping, 0 for held nodes; 1/s.
    pub(crate) damping_per_s: Vec<Row>,
    pub(crate) corners: Corners,
    pub(crate) blocks: Vec<Block>,
    pub(crate) rest_blocks: Vec<RestBlock>,
    /// How nodes hold the volume of tets that do not hold their own.
    pub(crate) bulk: Option<Bulk>,
    pub(crate) options: Options,
    pub(crate) omega_rest_per_s: f64,
    pub(crate) omega_max_per_s: f64,
    /// How far from its place at rest a node may be, per axis, m: keeps forces finite.
    pub(crate) reach_m: f32,
}

impl Model {
    /// Makes the model of `mesh`. `fixed`: one per node; fixed nodes follow their targets. `regions` of the mesh are not used.
    ///
    /// Errors: a mesh that is not fit for simulation (repair it first), options out of range, or an object too stiff for the step.
    pub fn new(
        mesh: &TetMesh,
        fixed: &[bool],
        material: &Material,
        options: Options,
    ) -> Result<(Model, ModelReport), ModelError> {
        ModelMaker::of(Materials::Same(*material), options).make(mesh, fixed)
    }

    /// As [`Model::new`], with a material per region of the mesh: pairs of region and material, one for every region in use. Who makes many
    /// models of a mesh that is cut keeps a [`ModelMaker`].
    pub fn with_materials(
        mesh: &TetMesh,
        fixed: &[bool],
        materials: &[(u32, Material)],
        options: Options,
    ) -> Result<(Model, ModelReport), ModelError> {
        ModelMaker::new(materials, options).make(mesh, fixed)
    }

    /// Number of nodes: the length of every array of a state.
    pub fn node_count(&self) -> usize {
        self.rest_m.len()
    }

    /// Positions at rest, m.
    pub fn rest_m(&self) -> &[[f32; 3]] {
        &self.rest_m
    }

    /// The tets as the mesh had them.
    pub fn tets(&self) -> &[[u32; 4]] {
        &self.tets
    }

    /// Mass of each node with what was added, kg; 0 for nodes that no tet uses.
    pub fn mass_kg(&self) -> &[f32] {
        &self.mass_kg
    }

    /// Resistance of the medium about a node, which is what the material's damping stands for: its force per speed against the medium, N·s/m;
    /// 0 for held nodes.
    pub fn resistance_n_s_m(&self, node: usize) -> f32 {
        let damping_per_s: &[f32] = bytemuck::cast_slice(&self.damping_per_s);
        self.mass_kg.get(node).zip(damping_per_s.get(node * 4)).map_or(0.0, |(mass_kg, rate)| mass_kg * rate)
    }

    /// Whether a node is held: fixed by the caller, or used by no tet.
    pub fn is_held(&self, node: usize) -> bool {
        self.held.get(node).copied().unwrap_or(true)
    }

    /// The instruction set in use.
    pub fn isa(&self) -> Isa {
        self.options.isa
    }

    /// Substeps of a step of `step_s`, at least 1: enough for the bound, and up to `max_substeps` enough for a clean motion.
    pub fn substeps(&self, step_s: f64) -> u32 {
        let stable = substeps_stable(step_s, self.omega_max_per_s);
        let clean = whole(step_s * self.omega_rest_per_s / CLEAN_PHASE);
        let most = whole(step_s / self.options.step_s * f64::from(self.options.max_substeps));
        stable.max(clean.min(most))
    }
}

/// What rounding may add to a number of substeps: a step of 1 ms in single precision is 5e-8 longer than one in double precision, for which the
/// mass was scaled. [`STABLE_PHASE`] leaves room for 20 000 times as much.
const HAIR: f64 = 1e-6;

/// The least whole number that is no less, at least 1. A hair of rounding does not count as one more.
fn whole(substeps: f64) -> u32 {
    (substeps * (1.0 - HAIR)).ceil().clamp(1.0, f64::from(u32::MAX)) as u32
}

/// The frequency that `substeps` keep stable, 1/s.
pub(crate) fn omega_allowed_per_s(step_s: f64, substeps: u32) -> f64 {
    STABLE_PHASE * f64::from(substeps) / step_s
}

/// Substeps that keep `omega_per_s` stable.
pub(crate) fn substeps_stable(step_s: f64, omega_per_s: f64) -> u32 {
    whole(step_s * omega_per_s / STABLE_PHASE)
}
