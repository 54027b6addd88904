//! Names: each object has its own, and whoever names another one names one that is there.

use crate::error::{SceneError, SceneErrorKind as Kind};
use crate::file::Scene;
use crate::validate::Checked;
use std::collections::BTreeSet;

/// Longest name, in bytes: it is shown in tables and sent in fixed-size messages.
const MAX_NAME_BYTES: usize = 63;

/// Every object has a short name that no other has.
pub(crate) fn names(scene: &Scene) -> Checked {
    let mut seen = BTreeSet::new();
    let deformables = scene.deformable.iter().enumerate().map(|(i, d)| (format!("deformable[{i}].name"), &d.name));
    let rigids = scene.rigid.iter().enumerate().map(|(i, r)| (format!("rigid[{i}].name"), &r.name));
    for (key, name) in deformables.chain(rigids) {
        is_name(&key, name)?;
        if !seen.insert(name) {
            return Err(SceneError::new(Kind::Name, key, format!("two objects are named “{name}”"), "rename one of them"));
        }
    }
    Ok(())
}

/// A name is short, and can be shown.
pub(crate) fn is_name(key: &str, name: &str) -> Checked {
    if name.trim().is_empty() || name.len() > MAX_NAME_BYTES || name.chars().any(char::is_control) {
        let what = format!("a name has 1 to {MAX_NAME_BYTES} bytes and no control characters");
        return Err(SceneError::new(Kind::Name, key, what, "give a short name"));
    }
    Ok(())
}

/// Every `attach_to` names another deformable, and no chain of them comes back to its start.
pub(crate) fn attachments(scene: &Scene) -> Checked {
    let find = |name: &str| scene.deformable.iter().position(|object| object.name == name);
    for (index, object) in scene.deformable.iter().enumerate() {
        let key = format!("deformable[{index}].attach_to");
        let mut host = object.attach_to.as_deref();
        for _ in 0..=scene.deformable.len() {
            let Some(name) = host else { break };
            let Some(found) = find(name) else {
                let known: Vec<&str> = scene.deformable.iter().map(|other| other.name.as_str()).collect();
                let what = format!("no deformable is named “{name}”; there are: {}", known.join(", "));
                return Err(SceneError::new(Kind::Name, key, what, "name one of these"));
            };
            if found == index {
                let what = format!("“{}” is attached to itself, directly or through others", object.name);
                return Err(SceneError::new(Kind::Name, key, what, "remove one attach_to of the circle"));
            }
            host = scene.deformable[found].attach_to.as_deref();
        }
    }
    Ok(())
}
