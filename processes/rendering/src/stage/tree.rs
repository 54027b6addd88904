//! What hangs on what in the scene graph. The pose of an object that hangs on another is meant in that one's frame: whoever moves a scope moves its loop,
//! the loop's arms and the jaws, and whoever takes it off the stage takes them with it.
//!
//! Promise: nothing comes to hang on itself, whatever is asked, so that each way up ends; what hung on something that is gone is gone. Looks are each
//! one's own.

use super::{Object, Stage};
use crate::error::RenderError;
use glam::Mat4;

impl Stage {
    /// Hangs an object on another one, or with `None` on the station's frame: from now on its pose is meant in that.
    ///
    /// # Errors
    /// [`RenderError::UnknownObject`], [`RenderError::Circle`]; it hangs where it did.
    pub fn hang(&mut self, id: u64, on: Option<u64>) -> Result<(), RenderError> {
        if let Some(parent) = on {
            if !self.objects.contains_key(&parent) {
                return Err(RenderError::UnknownObject(parent));
            }
            if self.upwards(on).any(|above| above == id) {
                return Err(RenderError::Circle { object: id, on: parent });
            }
        }
        self.objects.get_mut(&id).ok_or(RenderError::UnknownObject(id))?.parent = on;
        Ok(())
    }

    /// Takes an object off the stage, and all that hangs on it; says whether it was there.
    pub fn remove_object(&mut self, id: u64) -> bool {
        let was_there = self.objects.remove(&id).is_some();
        // Each round takes one.
        while let Some(orphan) = self.orphan() {
            self.objects.remove(&orphan);
        }
        was_there
    }

    /// From an object's own frame to the station's.
    pub(super) fn world(&self, object: &Object) -> Mat4 {
        let above = self.upwards(object.parent).filter_map(|id| self.objects.get(&id));
        above.fold(object.pose, |below, above| above.pose * below)
    }

    /// An object, what it hangs on, what that hangs on, and so on.
    fn upwards(&self, first: Option<u64>) -> impl Iterator<Item = u64> + '_ {
        std::iter::successors(first, move |id| self.objects.get(id).and_then(|object| object.parent))
    }

    /// One that hangs on what is gone.
    fn orphan(&self) -> Option<u64> {
        let is_gone = |parent: u64| !self.objects.contains_key(&parent);
        self.objects.iter().find(|(_, object)| object.parent.is_some_and(is_gone)).map(|(id, _)| *id)
    }
}
