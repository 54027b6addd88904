//! The surface for the eye of what a cut has left: it is bound on another core, and comes when all is done that does not ask for it.
//!
//! Promise: it is the same as one that is bound at once, and so is the world that it becomes a part of.

use super::Workshop;
use super::modeller::{Job, Sent};
use crate::body::{Body, in_order};
use hyst_mesh::TetMesh;
use hyst_tissue::{BoundSkin, LooseSkin, Skin};

/// A surface that is to be bound, and the mesh at rest that it is to be bound to.
#[derive(Debug)]
pub(super) struct SurfaceJob {
    pub(super) loose: LooseSkin,
    pub(super) rest: TetMesh,
}

impl Job for SurfaceJob {
    type Made = BoundSkin;

    fn done(self) -> BoundSkin {
        let SurfaceJob { loose, rest } = self;
        loose.bound(&rest)
    }
}

/// A surface that is bound, or is being bound.
#[derive(Debug)]
pub struct Coming(Way);

#[derive(Debug)]
enum Way {
    Here(BoundSkin),
    Beside(Sent<SurfaceJob>),
}

impl Coming {
    /// Binds one here and now.
    pub fn at_once(loose: LooseSkin, rest: &TetMesh) -> Coming {
        Coming(Way::Here(loose.bound(rest)))
    }

    /// One that was given to the thread; or came back, and is bound here and now.
    pub(super) fn given(given: Result<Sent<SurfaceJob>, SurfaceJob>) -> Coming {
        Coming(match given {
            Ok(sent) => Way::Beside(sent),
            Err(job) => Way::Here(job.done()),
        })
    }

    /// Whether it may be bound yet.
    pub fn is_beside(&self) -> bool {
        matches!(self.0, Way::Beside(_))
    }

    /// The surface, once it is bound.
    pub fn bound(self) -> BoundSkin {
        match self.0 {
            Way::Here(bound) => bound,
            Way::Beside(sent) => sent.ended(),
        }
    }
}

/// The surface that a body is yet to get.
#[derive(Debug)]
pub struct Trailing {
    coming: Coming,
    part_of_tet: Vec<u32>,
    /// The object of each tet before the body's parts were named, where one got another name: by these it was bound.
    regions: Option<Vec<u32>>,
}

impl Trailing {
    /// That of a body without burnt tets: of which part each of them is, and of which object it was where that is another one now.
    pub fn new(coming: Coming, part_of_tet: Vec<u32>, regions: Option<Vec<u32>>) -> Trailing {
        Trailing { coming, part_of_tet, regions }
    }

    /// Waits for it, and puts it into the order of the body's objects; with how much of it found no room.
    pub(super) fn come(self, body: &Body) -> (Skin, usize) {
        let Trailing { coming, part_of_tet, regions } = self;
        let bound = coming.bound();
        let (skin, out_of_room) = match regions {
            Some(regions) => bound.parted(&TetMesh { regions, ..body.rest.clone() }, &part_of_tet),
            None => bound.parted(&body.rest, &part_of_tet),
        };
        (in_order(skin, &body.rest.regions), out_of_room)
    }
}

impl Workshop {
    /// Has a surface bound on another core, where there is one for it, and here and now where not.
    pub fn bind(&mut self, loose: LooseSkin, rest: &TetMesh) -> Coming {
        match &mut self.modeller {
            Some(modeller) if !loose.is_bound() => modeller.bind(loose, rest),
            _ => Coming::at_once(loose, rest),
        }
    }
}
