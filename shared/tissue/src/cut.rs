//! Cutting with a wire: what it sweeps from one tick to the next opens the mesh.
//!
//! Hybrid after Steinemann, Harders, Gross and Székely, "Hybrid cutting of deformable solids" (IEEE VR 2006): an edge that the sheet crosses near
//! one of its ends has that end snapped to the sheet, which makes no element at all; every other crossed edge is bisected, with all the tets
//! around it, so that the mesh stays conforming. Then each tet counts to one side of the sheet, and the faces between the two sides are opened: a
//! node is copied for each part of its star that hangs together by faces. Nodes on the sheet are *marked* until the stroke ends, so that the sheet
//! of the next tick goes on where this one ended; and so that it begins there although the tissue has moved, the wire is kept by the tets it was in.
//!
//! Promises, each a property test (`tests/random_strokes`, `tests/cuts_through`, `tests/momentum`): the volume of each region and material is kept, but for
//! pieces that were burnt away; every tet keeps a positive volume at rest and a quality above a bound; the boundary stays a 2-manifold, for faces that
//! would spoil it stay closed; momentum is kept by volume, and by the masses of the models before and after once [`keep_momentum`] has been asked for it;
//! what is burnt takes its own along; held nodes stay where they are; same tissue, same sweep: same bits. Everything that a later tick needs is in the
//! [`Cuttable`], which is plain data: whoever holds it continues.

mod burn;
mod cells;
mod enclosed;
mod fans;
mod joined;
mod loose;
mod momentum;
mod neighbourhood;
mod places;
mod refine;
mod rim;
mod separate;
mod sheet;
mod skin;
mod stars;
mod wire;

use burn::burn;
use hyst_mesh::{TetMesh, are_below, are_finite, signed_volume};
use places::corners;
use refine::Work;
use rim::OnSheet;
use sheet::Sheet;

pub use loose::{BoundSkin, Cut, LooseSkin};
pub use momentum::{Changed, Objects, keep_momentum};
pub use skin::Skin;
pub use wire::Seat;

/// A tissue as it can be cut: its mesh at rest, where it is now, and where the stroke runs that is under way.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Cuttable {
    /// The shape at rest. Nodes that no tet uses stay in it.
    pub rest: TetMesh,
    /// Where each node is now, m.
    pub position_m: Vec<[f32; 3]>,
    /// Velocity of each node, m/s.
    pub velocity_m_s: Vec<[f32; 3]>,
    /// What each tet is made of, which its parts inherit; empty where a region tells it.
    pub material: Vec<u32>,
    /// Whether a node is held in its place; a node on an edge between two held ones is held.
    pub fixed: Vec<bool>,
    /// Whether a node that is free keeps its place at rest, because somebody knows it by that; none behind the end. A sheet that comes near it goes through it.
    pub keeps_place: Vec<bool>,
    /// Unit normal of the sheet, in the shape at rest, at each node that it runs through; 0 at all others.
    pub marks: Vec<[f32; 3]>,
    /// Where the wire was last in this stroke; empty before it begins.
    pub wire: Vec<Seat>,
    /// The surface for the eye; may be empty.
    pub skin: Skin,
    /// The part of each tet after the last cut, numbered as [`component_of_each_tet`](hyst_mesh::component_of_each_tet) does; empty if that left the mesh as it
    /// was.
    pub part_of_tet: Vec<u32>,
    /// What the last cut has done to each region of which it has changed a tet, in the order of the regions; empty if it left the mesh as it was.
    pub changed: Vec<Changed>,
}

/// How a cut is made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CutOptions {
    /// Up to which share of an edge from its end the end is snapped to the sheet, 0 to 0.5.
    pub snap_share: f64,
    /// No bisection makes a tet of a lower quality (1 is regular): it snaps instead.
    pub min_quality: f64,
    /// No edge shorter than twice this is bisected, m; the shorter half of one may be shorter, by the share to which ends are snapped.
    pub min_edge_m: f64,
    /// Pieces that are smaller are burnt by the wire, m³; never the greatest.
    pub min_piece_m3: f64,
    /// Nodes that there is room for, those that no tet uses included: they are used again. When all are, edges are snapped only.
    pub max_nodes: usize,
    /// Tets that there is room for.
    pub max_tets: usize,
    /// Vertices of the surface for the eye that there is room for.
    pub max_vertices: usize,
    /// Its triangles.
    pub max_triangles: usize,
}

impl Default for CutOptions {
    /// Snaps up to a fifth of an edge; quality 0.03, edges of 0.5 mm, pieces of 0.5 mm³; room for 50 000 tets.
    fn default() -> Self {
        CutOptions {
            snap_share: 0.2,
            min_quality: 0.03,
            min_edge_m: 0.5e-3,
            min_piece_m3: 0.5e-9,
            max_nodes: 20_000,
            max_tets: 50_000,
            max_vertices: 50_000,
            max_triangles: 100_000,
        }
    }
}

/// What one sweep did.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct CutReport {
    /// Edges that were bisected: a new node each.
    pub split_edges: usize,
    /// Times that a node was snapped to the sheet.
    pub snapped_nodes: usize,
    /// Nodes that were moved onto it for that.
    pub moved_nodes: usize,
    /// Faces between the two sides that are open now: triangles on each side.
    pub opened_faces: usize,
    /// Faces between the two sides that stay closed: at the front of the cut, where open they would leave a boundary that is no surface, and where
    /// there is no room for copies of their nodes.
    pub closed_faces: usize,
    /// Nodes copied for it.
    pub copied_nodes: usize,
    /// Edges of the surface for the eye that the sheet divided: a new vertex each, also where it met no edge of a tet.
    pub divided_edges: usize,
    /// Parts that share no node, after this sweep; 0 if it changed nothing.
    pub parts: usize,
    /// Tets that were burnt, and their volume at rest, m³.
    pub burnt_tets: usize,
    /// Volume burnt, m³.
    pub burnt_m3: f64,
    /// Edges that were snapped because there was no room for another node or tet, one more if nothing could be opened for that reason, and what of the
    /// surface for the eye could not be divided.
    pub out_of_room: usize,
}

impl CutReport {
    /// Whether the mesh is another one than before. (A node that was marked only changes nothing but the marks.)
    pub fn has_changed_mesh(&self) -> bool {
        self.split_edges + self.moved_nodes + self.copied_nodes + self.burnt_tets > 0
    }

    /// Whether the mesh is another one than before, or the surface for the eye.
    pub fn has_changed(&self) -> bool {
        self.has_changed_mesh() || self.divided_edges > 0
    }
}

/// Why nothing was cut. The tissue is as before.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CutError {
    /// A list of another length.
    #[error("{what}: {found} entries for {expected}; give one for each")]
    Length {
        /// Name of the list.
        what: &'static str,
        /// Its length.
        found: usize,
        /// What it belongs to has so many.
        expected: usize,
    },
    /// A tet that names a node that is not there.
    #[error("tet {tet} names node {node}, but there are {nodes}; repair the mesh (hyst-mesh `repair`)")]
    NodeIndex {
        /// The tet.
        tet: usize,
        /// What it names.
        node: u32,
        /// Number of nodes.
        nodes: usize,
    },
    /// A number that is none, or a mesh that is not fit to be cut.
    #[error("node {node} has {what} that is not finite; repair the mesh, or go on from another state")]
    NotFinite {
        /// Name of the list.
        what: &'static str,
        /// The node.
        node: usize,
    },
    /// A tet near the sheet that has no positive volume at rest.
    #[error("tet {tet} is inverted or flat at rest; repair the mesh (hyst-mesh `repair`)")]
    BadTet {
        /// The tet.
        tet: usize,
    },
    /// A wire of too many points.
    #[error("the wire has {found} points, more than {MAX_WIRE_POINTS}; give it fewer")]
    LongWire {
        /// Its points.
        found: usize,
    },
    /// The wire has a point that is not finite.
    #[error("point {point} of the wire is not finite; sweep it again when the tool's pose is known")]
    Wire {
        /// The point.
        point: usize,
    },
    /// The surface for the eye belongs to another mesh.
    #[error("the surface does not fit the {tets} tets; bind it to this mesh (hyst-mesh `bind`)")]
    Skin {
        /// Number of tets.
        tets: usize,
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
}

/// Most points of a wire: each edge of the mesh near the sheet is tried against each piece of it.
pub const MAX_WIRE_POINTS: usize = 256;

impl Cuttable {
    /// A mesh at rest in its own place, without fixed nodes.
    pub fn at_rest(rest: TetMesh) -> Cuttable {
        let nodes = rest.positions_m.len();
        Cuttable {
            position_m: rest.positions_m.clone(),
            velocity_m_s: vec![[0.0; 3]; nodes],
            material: Vec::new(),
            fixed: vec![false; nodes],
            keeps_place: Vec::new(),
            marks: vec![[0.0; 3]; nodes],
            wire: Vec::new(),
            skin: Skin::default(),
            part_of_tet: Vec::new(),
            changed: Vec::new(),
            rest,
        }
    }

    /// The wire has left the tissue or burns no more: the next sweep begins a sheet of its own.
    pub fn end_stroke(&mut self) {
        self.marks.fill([0.0; 3]);
        self.wire.clear();
    }

    /// Volume at rest, m³.
    pub fn volume_m3(&self) -> f64 {
        self.rest.tets.iter().map(|tet| signed_volume(corners(&self.rest.positions_m, *tet))).sum()
    }

    fn check(&self) -> Result<(), CutError> {
        let nodes = self.rest.positions_m.len();
        let lists = [
            ("position_m", self.position_m.len(), nodes),
            ("velocity_m_s", self.velocity_m_s.len(), nodes),
            ("fixed", self.fixed.len(), nodes),
            ("marks", self.marks.len(), nodes),
            ("regions", self.rest.regions.len(), self.rest.tets.len()),
            ("material", self.material.len(), if self.material.is_empty() { 0 } else { self.rest.tets.len() }),
        ];
        if let Some((what, found, expected)) = lists.into_iter().find(|(_, found, expected)| found != expected) {
            return Err(CutError::Length { what, found, expected });
        }
        let names = self.rest.tets.as_flattened();
        let is_wrong = |node: &u32| *node as usize >= nodes;
        let wrong = if are_below(nodes, names) { None } else { names.iter().position(is_wrong) };
        match wrong {
            Some(place) => Err(CutError::NodeIndex { tet: place / 4, node: names[place], nodes }),
            None if self.skin.is_sound(self.rest.tets.len()) => Ok(()),
            None => Err(CutError::Skin { tets: self.rest.tets.len() }),
        }
    }

    /// What a cut would make worse: numbers that are none anywhere, and tets without a volume of those near the sheet.
    fn check_shape(&self, near: &[u32]) -> Result<(), CutError> {
        let is_bad = |point: &[f32; 3]| point.iter().any(|coordinate| !coordinate.is_finite());
        let lists = [
            ("a place at rest", &self.rest.positions_m),
            ("a place", &self.position_m),
            ("a velocity", &self.velocity_m_s),
            ("a mark", &self.marks),
        ];
        for (what, points) in lists.into_iter().filter(|(_, points)| !are_finite(points.as_flattened())) {
            if let Some(node) = points.iter().position(is_bad) {
                return Err(CutError::NotFinite { what, node });
            }
        }
        let is_flat = |tet: &&u32| signed_volume(corners(&self.rest.positions_m, self.rest.tets[**tet as usize])) <= 0.0;
        near.iter().find(is_flat).map_or(Ok(()), |tet| Err(CutError::BadTet { tet: *tet as usize }))
    }
}

impl CutOptions {
    fn check(&self) -> Result<(), CutError> {
        let ranges = [
            ("snap_share", self.snap_share, 0.0..=0.5, "from 0 to 0.5"),
            ("min_quality", self.min_quality, 0.0..=0.5, "from 0 to 0.5"),
            ("min_edge_m", self.min_edge_m, 0.0..=f64::MAX, "of 0 or more"),
            ("min_piece_m3", self.min_piece_m3, 0.0..=f64::MAX, "of 0 or more"),
        ];
        match ranges.into_iter().find(|(_, value, range, _)| !range.contains(value)) {
            Some((name, value, _, range)) => Err(CutError::Option { name, value, range }),
            None => Ok(()),
        }
    }
}

/// Cuts with what a wire has swept since it was last seen in this stroke, in the tissue, which has moved too. `wire`: its points, in the frame of
/// [`Cuttable::position_m`], m. The first wire of a stroke, and one of another number of points, begins a sheet and cuts nothing.
///
/// Errors: lists that do not fit, a wire that is not finite, options out of range; then nothing has changed.
pub fn cut(tissue: &mut Cuttable, wire: &[[f32; 3]], options: &CutOptions) -> Result<CutReport, CutError> {
    let done = cut_and_bind(tissue, wire, options, LooseSkin::bound)?;
    Ok(done.ended(tissue, std::convert::identity))
}

/// The same for who may have the surface for the eye bound elsewhere while the rest is done: `bind` is called with it, and with the mesh at rest that it is to
/// be bound to, as soon as that is cut.
///
/// Errors: as [`cut()`].
pub fn cut_and_bind<S>(
    tissue: &mut Cuttable,
    wire: &[[f32; 3]],
    options: &CutOptions,
    bind: impl FnOnce(LooseSkin, &TetMesh) -> S,
) -> Result<Cut<S>, CutError> {
    tissue.check()?;
    options.check()?;
    if wire.len() > MAX_WIRE_POINTS {
        return Err(CutError::LongWire { found: wire.len() });
    }
    let is_bad = |point: &[f32; 3]| point.iter().any(|coordinate| !coordinate.is_finite());
    if let Some(point) = wire.iter().position(is_bad) {
        return Err(CutError::Wire { point });
    }
    let mut report = CutReport::default();
    let motion = tissue.motion(wire);
    let sheet = Sheet::of(&motion);
    let near = sheet.near(tissue);
    if !near.is_empty() {
        tissue.check_shape(&near)?;
    }
    tissue.part_of_tet.clear();
    let mut bound = None;
    tissue.changed.clear();
    if !near.is_empty() {
        let (before_m, before) = (tissue.rest.positions_m.clone(), tissue.rest.tets.clone());
        let mut skin = std::mem::take(&mut tissue.skin);
        let vertices = skin.rest_m.len();
        report.out_of_room += skin.divide(tissue, &sheet, options);
        report.divided_edges = skin.rest_m.len() - vertices;
        let mut work = Work::new(tissue, options, near);
        work.refine(&sheet, &mut report);
        let opened = work.open(&mut report);
        let Work { touched, on_sheet, .. } = work;
        let changed = changed(&before_m, &before, touched, &tissue.rest);
        tissue.note_changed(&changed);
        let on_sheet = OnSheet::of(on_sheet, &tissue.marks);
        bound = Some(bind(LooseSkin::of(skin, changed, opened, on_sheet, options), &tissue.rest));
    }
    let number = if report.has_changed_mesh() { burn(tissue, options, &mut report) } else { None };
    tissue.seat_wire(&motion);
    Ok(Cut { report, skin: bound, number })
}

/// The tets that are not what they were, in their order. `before_m` and `before`: the places of the nodes at rest, and the tets; `touched`: those that may
/// be others.
fn changed(before_m: &[[f32; 3]], before: &[[u32; 4]], mut touched: Vec<u32>, after: &TetMesh) -> Vec<u32> {
    touched.sort_unstable();
    touched.dedup();
    let stays = |node: &u32| before_m.get(*node as usize) == Some(&after.positions_m[*node as usize]);
    touched.retain(|tet| {
        let nodes = &after.tets[*tet as usize];
        before.get(*tet as usize) != Some(nodes) || !nodes.iter().all(stays)
    });
    touched
}

#[cfg(test)]
mod tests;
