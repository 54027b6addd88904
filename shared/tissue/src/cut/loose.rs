//! The surface for the eye once the mesh is cut under it. To bind it anew takes longest of what is left then, and needs the mesh at rest alone: somebody else
//! may do it while the cut goes on.
//!
//! Promise (`tests/skin`): it is the same, whoever binds it, and when.

use super::rim::OnSheet;
use super::skin::Skin;
use super::{CutOptions, CutReport, Cuttable};
use hyst_mesh::TetMesh;

/// A surface for the eye that is divided where the wire went through it, and bound to the mesh as it was before that.
#[derive(Debug)]
pub struct LooseSkin {
    skin: Skin,
    /// The tets that are not what they were.
    changed: Vec<u32>,
    /// The two tets of each face that is open now.
    opened: Vec<[u32; 2]>,
    /// What of the mesh the stroke has come through so far.
    passed: OnSheet,
    options: CutOptions,
}

impl LooseSkin {
    pub(super) fn of(skin: Skin, changed: Vec<u32>, opened: Vec<[u32; 2]>, passed: OnSheet, options: &CutOptions) -> LooseSkin {
        LooseSkin { skin, changed, opened, passed, options: *options }
    }

    /// Whether no tet is another one than before: then there is nothing to do.
    pub fn is_bound(&self) -> bool {
        self.changed.is_empty() && self.opened.is_empty()
    }

    /// Binds it to the mesh at rest that it was given out with, and lays the wound open.
    pub fn bound(self, rest: &TetMesh) -> BoundSkin {
        let LooseSkin { mut skin, changed, opened, passed, options } = self;
        let mut out_of_room = skin.bind_again(rest, &changed, &passed, &options);
        out_of_room += skin.add_wound(rest, &opened, &options);
        BoundSkin { skin, out_of_room, options }
    }
}

/// One that is bound to the mesh that the cut has left. It may join parts of that still.
#[derive(Debug)]
pub struct BoundSkin {
    skin: Skin,
    /// How much of it found no room.
    out_of_room: usize,
    options: CutOptions,
}

impl BoundSkin {
    /// Lets come apart what joins parts; with how much of it found no room since it was loose. `part_of_tet`: the part of each tet of the mesh at rest, as in
    /// [`Cuttable::part_of_tet`], which has none where the mesh is what it was.
    pub fn parted(self, rest: &TetMesh, part_of_tet: &[u32]) -> (Skin, usize) {
        let BoundSkin { mut skin, mut out_of_room, options } = self;
        if !part_of_tet.is_empty() {
            out_of_room += skin.part_by(rest, part_of_tet, &options);
        }
        (skin, out_of_room)
    }
}

/// A sweep that is done, but for the surface for the eye, which the tissue is without until then.
#[derive(Debug)]
pub struct Cut<S> {
    /// What it did; what finds no room while the surface is bound is not in it.
    pub report: CutReport,
    /// What was made of the surface; `None` where the wire came near nothing: then the tissue has it.
    pub skin: Option<S>,
    /// The new number of each tet that is left; `None` where nothing was burnt.
    pub(super) number: Option<Vec<Option<u32>>>,
}

impl<S> Cut<S> {
    /// Gives the tissue its surface, which is bound by then. Tells all that the sweep did.
    pub fn ended(self, tissue: &mut Cuttable, bound: impl FnOnce(S) -> BoundSkin) -> CutReport {
        let Cut { mut report, skin, number } = self;
        if let Some(mut bound) = skin.map(bound) {
            if let Some(number) = &number {
                bound.skin.without_tets(number);
            }
            let (skin, out_of_room) = bound.parted(&tissue.rest, &tissue.part_of_tet);
            tissue.skin = skin;
            report.out_of_room += out_of_room;
        }
        report
    }
}
