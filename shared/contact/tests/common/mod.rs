//! Bodies for tests and benchmark: a block of tets, a capsule of points with edges and areas, a run of the whole test.
#![allow(dead_code)]

pub mod tick;

use hyst_contact::*;

/// Block of cubes of edge `h_m`, six tets each, from a corner.
pub fn block(cubes: [usize; 3], h_m: f32, corner_m: [f32; 3]) -> (Vec<[f32; 3]>, Vec<[u32; 4]>) {
    let [nx, ny, nz] = cubes.map(|n| n + 1);
    let at = |i: usize, j: usize, k: usize| ((k * ny + j) * nx + i) as u32;
    let mut positions = Vec::new();
    for k in 0..nz {
        for j in 0..ny {
            for i in 0..nx {
                let g = [i, j, k];
                positions.push(std::array::from_fn(|a| corner_m[a] + h_m * g[a] as f32));
            }
        }
    }
    let ways = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
    let mut tets = Vec::new();
    for k in 0..cubes[2] {
        for j in 0..cubes[1] {
            for i in 0..cubes[0] {
                for way in ways {
                    let mut g = [i, j, k];
                    let mut tet = [at(i, j, k); 4];
                    for (step, axis) in way.into_iter().enumerate() {
                        g[axis] += 1;
                        tet[step + 1] = at(g[0], g[1], g[2]);
                    }
                    tets.push(tet);
                }
            }
        }
    }
    (positions, tets)
}

/// A tool: points on a capsule, their edges and the area that each stands for.
pub struct Capsule {
    pub points_m: Vec<[f32; 3]>,
    pub edges: Vec<[u32; 2]>,
    pub area_m2: Vec<f32>,
}

/// Capsule along +z with its tip at `tip_m`: point 0 is the tip, then rings of `around` points, hemisphere first.
pub fn capsule(tip_m: [f32; 3], radius_m: f32, length_m: f32, rings: usize, around: usize) -> Capsule {
    let cap = (rings / 4).max(2);
    let mut tool = Capsule { points_m: vec![tip_m], edges: Vec::new(), area_m2: vec![1e-7] };
    let arc = std::f32::consts::FRAC_PI_2;
    for ring in 0..rings {
        let (r, back) = if ring < cap {
            let angle = arc * (ring + 1) as f32 / cap as f32;
            (radius_m * angle.sin(), radius_m * (1.0 - angle.cos()))
        } else {
            (radius_m, radius_m + (length_m - radius_m) * (ring + 1 - cap) as f32 / (rings - cap) as f32)
        };
        for a in 0..around {
            let turn = std::f32::consts::TAU * a as f32 / around as f32;
            let id = (1 + ring * around + a) as u32;
            let next = (1 + ring * around + (a + 1) % around) as u32;
            tool.points_m.push([tip_m[0] + r * turn.cos(), tip_m[1] + r * turn.sin(), tip_m[2] - back]);
            tool.area_m2.push(2e-7);
            tool.edges.push([id, next]);
            tool.edges.push(if ring == 0 { [0, id] } else { [id - around as u32, id] });
            if ring > 0 {
                tool.edges.push([id - around as u32, next]);
            }
        }
    }
    tool
}

/// The words of a table of some points.
pub fn table(points_m: &[[f32; 3]], cell_m: f32, layout: Layout) -> Vec<u32> {
    let sizes = HashSizes::for_points(points_m.len());
    let mut words = vec![7u32; sizes.words()];
    HashMut::in_words(&mut words, sizes).unwrap().build(points_m, cell_m, layout).unwrap();
    words
}

/// Hashes and tests with a number of workers, and joins the shares.
pub fn hits_split(
    points_m: &[[f32; 3]],
    points: &Points,
    tissue: &Tissue,
    (cell_m, layout): (f32, Layout),
    (count, split): (u32, Split),
) -> Vec<Hit> {
    let mut culls: Vec<Cull> = (0..count).map(|_| Cull::default()).collect();
    hits_by(points_m, points, tissue, (cell_m, layout), split, culls.iter_mut())
}

/// The same with one worker for each of what they remember.
pub fn hits_by<'a>(
    points_m: &[[f32; 3]],
    points: &Points,
    tissue: &Tissue,
    (cell_m, layout): (f32, Layout),
    split: Split,
    culls: impl ExactSizeIterator<Item = &'a mut Cull>,
) -> Vec<Hit> {
    let words = table(points_m, cell_m, layout);
    let hash = HashRef::in_words(&words).unwrap();
    assert!(hash.is_of(points_m));
    let count = culls.len() as u32;
    // Two objects in the tests at most, and some room for points on common faces.
    let room = 3 * points_m.len() + 64;
    let parts: Vec<Vec<Hit>> = (0..)
        .zip(culls)
        .map(|(index, cull)| {
            let mut out = vec![Hit::default(); room];
            let share = Share { index, count, split };
            let found = intersect(share, &hash, points, tissue, cull, &mut out).unwrap();
            assert_eq!(found.dropped, 0);
            out.truncate(found.count);
            out
        })
        .collect();
    let mut out = vec![Hit::default(); room];
    let parts: Vec<&[Hit]> = parts.iter().map(Vec::as_slice).collect();
    let found = merge(&parts, tissue, &mut out);
    assert_eq!(found.dropped, 0);
    out.truncate(found.count);
    out
}

/// As one worker.
pub fn hits(points_m: &[[f32; 3]], points: &Points, tissue: &Tissue, cell_m: f32) -> Vec<Hit> {
    hits_split(points_m, points, tissue, (cell_m, Layout::Auto), (1, Split::Points))
}

/// The oracle.
pub fn brute(points_m: &[[f32; 3]], points: &Points, tissue: &Tissue) -> Vec<Hit> {
    let mut out = vec![Hit::default(); points_m.len() * (tissue.tets.len() + 1)];
    let found = intersect_brute(points_m, points, tissue, &mut out).unwrap();
    assert_eq!(found.dropped, 0);
    out.truncate(found.count);
    out
}

/// The force on a point of a tool that is so deep, with contacts of some stiffness per area, N/m³.
pub fn force_of(penetration: &Penetration, tool: &Capsule, stiffness_n_m3: f32) -> ContactForce {
    let point = penetration.point as usize;
    let stiffness_n_m = stiffness_n_m3 * tool.area_m2[point];
    let normal_n = stiffness_n_m * penetration.depth_m;
    ContactForce {
        point: penetration.point,
        owner: TOOL,
        place_m: tool.points_m[point],
        direction: penetration.direction,
        normal_n,
        stiffness_n_m,
        damping_n_s_m: normal_n / DAMPING_M_S,
    }
}

/// Speed of entering at which the damping of these forces doubles them, m/s.
const DAMPING_M_S: f32 = 0.5;

/// A tool against tissue of one owner, from the test to the depths.
pub struct Poke {
    pub positions_m: Vec<[f32; 3]>,
    pub tets: Vec<[u32; 4]>,
    pub tet_owner: Vec<u32>,
    pub topology: Topology,
    pub graph: PointGraph,
    pub owner: Vec<u32>,
    pub memory: Vec<Memory>,
    /// What none of the points meets.
    pub spared: Vec<u32>,
    pub work: Workspace,
}

/// Owner of the tool's points.
pub const TOOL: u32 = 9;

impl Poke {
    pub fn new(positions_m: Vec<[f32; 3]>, tets: Vec<[u32; 4]>, tool: &Capsule) -> Poke {
        let (n, tet_owner) = (tool.points_m.len(), vec![1; tets.len()]);
        Poke {
            topology: Topology::new(&tets, &tet_owner, &positions_m).unwrap(),
            graph: PointGraph::from_edges(n, &tool.edges),
            owner: vec![TOOL; n],
            memory: vec![Memory::default(); n],
            spared: Vec::new(),
            work: Workspace::new(n, 2 * n, positions_m.len()),
            positions_m,
            tets,
            tet_owner,
        }
    }

    pub fn points(&self) -> Points<'_> {
        Points { owner: &self.owner, node: &[], own: None }
    }

    pub fn tissue(&self) -> Tissue<'_> {
        Tissue { positions_m: &self.positions_m, tets: &self.tets, tet_owner: &self.tet_owner }
    }

    pub fn depths(&mut self, points_m: &[[f32; 3]], retreat: [f32; 3]) -> Vec<Penetration> {
        let hits = hits(points_m, &self.points(), &self.tissue(), 0.004);
        let Poke { positions_m, tets, tet_owner, topology, graph, owner, memory, work, spared } = self;
        let points = Points { owner, node: &[], own: None };
        let tissue = Tissue { positions_m, tets, tet_owner };
        let input = PenetrationInput { hits: &hits, points_m, points, graph, tissue, topology };
        let (retreats, spared) =
            ([Retreat { owner: TOOL, direction: retreat }], Spared { points: [0, u32::MAX], objects: spared });
        let params = PenetrationParams { max_depth_m: 0.015, retreats: &retreats, spared };
        let mut out = vec![Penetration::default(); hits.len()];
        assert_eq!(penetration(&input, &params, memory, work, &mut out).unwrap().dropped, 0);
        out
    }
}
