//! One tick of a capsule pressed into a block, step by step, with all buffers sized before.

use super::{Capsule, TOOL, block, capsule, force_of};
use hyst_contact::*;

const MM: f32 = 1e-3;
const STIFFNESS_N_M3: f32 = 1e7;
/// What the capsule turns about.
const PIVOT_M: [f32; 3] = [0.0, 0.0, -40.0 * MM];

/// A step of the tick.
pub type Step = fn(&mut Tick);

/// What lies still: tissue and whom its and the tool's parts belong to.
pub struct Body {
    pub tets: Vec<[u32; 4]>,
    positions_m: Vec<[f32; 3]>,
    tet_owner: Vec<u32>,
    owner: Vec<u32>,
    topology: Topology,
    graph: PointGraph,
}

impl Body {
    fn points(&self) -> Points<'_> {
        Points { owner: &self.owner, node: &[], own: None }
    }

    fn tissue(&self) -> Tissue<'_> {
        Tissue { positions_m: &self.positions_m, tets: &self.tets, tet_owner: &self.tet_owner }
    }
}

pub struct Tick {
    pub body: Body,
    pub tool: Capsule,
    pub set: PlaneSet,
    pub found: usize,
    words: Vec<u32>,
    cull: Cull,
    part: Vec<Hit>,
    hits: Vec<Hit>,
    memory: Vec<Memory>,
    work: Workspace,
    depths: Vec<Penetration>,
    contacts: Vec<ContactForce>,
    gaps: Vec<Gap>,
}

impl Tick {
    /// A block of cubes of 2 mm; the capsule's tip is 4 mm deep.
    pub fn new(cubes: [usize; 3]) -> Tick {
        let corner_m = [-MM * cubes[0] as f32, -MM * cubes[1] as f32, 0.0];
        let (positions_m, tets) = block(cubes, 2.0 * MM, corner_m);
        let tool = capsule([0.3 * MM, 0.1 * MM, 4.0 * MM], 2.0 * MM, 30.0 * MM, 30, 16);
        let (n, nodes, tet_owner) = (tool.points_m.len(), positions_m.len(), vec![1; tets.len()]);
        let graph = PointGraph::from_edges(n, &tool.edges);
        Tick {
            set: PlaneSet::default(),
            found: 0,
            words: vec![0; HashSizes::for_points(n).words()],
            cull: Cull::remembering(nodes, tets.len(), n),
            part: vec![Hit::default(); 2 * n],
            hits: vec![Hit::default(); 2 * n],
            memory: vec![Memory::default(); n],
            work: Workspace::new(n, 2 * n, nodes),
            depths: vec![Penetration::default(); 2 * n],
            contacts: vec![ContactForce::default(); 2 * n],
            gaps: vec![Gap::FAR; n],
            tool,
            body: Body {
                topology: Topology::new(&tets, &tet_owner, &positions_m).unwrap(),
                owner: vec![TOOL; n],
                graph,
                tets,
                positions_m,
                tet_owner,
            },
        }
    }

    /// The steps by name, in order.
    pub const STEPS: [(&'static str, Step); 6] = [
        ("hash", Tick::hash),
        ("test", Tick::test),
        ("depth", Tick::depth),
        ("forces", Tick::forces),
        ("gaps", Tick::near),
        ("planes", Tick::planes),
    ];

    fn hash(&mut self) {
        let sizes = HashSizes::for_points(self.tool.points_m.len());
        let mut table = HashMut::in_words(&mut self.words, sizes).unwrap();
        table.build(&self.tool.points_m, 3.0 * MM, Layout::Auto).unwrap();
    }

    fn test(&mut self) {
        let (points, tissue) = (self.body.points(), self.body.tissue());
        let hash = HashRef::in_words(&self.words).unwrap();
        let found = intersect(Share::ALL, &hash, &points, &tissue, self.cull.of(1), &mut self.part).unwrap();
        self.found = merge(&[&self.part[..found.count]], &tissue, &mut self.hits).count;
    }

    fn depth(&mut self) {
        let input = PenetrationInput {
            hits: &self.hits[..self.found],
            points_m: &self.tool.points_m,
            points: self.body.points(),
            graph: &self.body.graph,
            tissue: self.body.tissue(),
            topology: &self.body.topology,
        };
        let params = PenetrationParams { max_depth_m: 15.0 * MM, retreats: &[], spared: Spared::default() };
        let (memory, work) = (&mut self.memory, &mut self.work);
        let found = penetration(&input, &params, memory, work, &mut self.depths).unwrap();
        assert_eq!(found.count, self.found);
    }

    fn forces(&mut self) {
        for (contact, penetration) in self.contacts.iter_mut().zip(&self.depths[..self.found]) {
            *contact = force_of(penetration, &self.tool, STIFFNESS_N_M3);
        }
    }

    fn near(&mut self) {
        let Body { topology, .. } = &self.body;
        let (points, tissue) = (self.body.points(), self.body.tissue());
        let hash = HashRef::in_words(&self.words).unwrap();
        find_gaps(&hash, &points, &tissue, topology, 2.0 * MM, &mut self.gaps).unwrap();
    }

    fn planes(&mut self) {
        let input = PlaneInput {
            contacts: &self.contacts[..self.found],
            gaps: &self.gaps,
            points_m: &self.tool.points_m,
            owner: &self.body.owner,
            point_area_m2: &self.tool.area_m2,
            tip_m: self.tool.points_m[0],
            pivot_m: Some(PIVOT_M),
            tool: TOOL,
        };
        let params = PlaneParams { range_m: 2.0 * MM, stiffness_n_m3: STIFFNESS_N_M3, most_stiffness_n_m: f32::INFINITY };
        self.set = planes(&input, &params);
    }
}
