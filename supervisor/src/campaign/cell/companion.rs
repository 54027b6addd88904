//! The fault beside another: the one in whose recovery, or hand-over, that is to come.

use super::{injection, is_of_newcomer};
use crate::faultfile::{FaultKind, Injection, Keepers, Place, Target, Which};
use hyst_messages::Role;

/// The fault in whose recovery one of this target comes.
pub(super) fn in_recovery(text: Option<&str>, target: &str) -> Result<Injection, String> {
    let is_tissue = Role::name_in(target) == Role::Tissue.name();
    let with = read(text.unwrap_or(if is_tissue { "kill haptic:active" } else { "kill tissue:active" }), target)?;
    // A damaged checkpoint hurts nobody while a holder lives: whoever comes after both reads it.
    let founds_from_it = with.place == Some(Place::Checkpoint);
    if with.target.ends_with(":both") || target.ends_with(":both") && !founds_from_it {
        return Err(format!("{target}: one fault falls into the recovery of one other; take state any for :both"));
    }
    Ok(with)
}

/// The fault for which a role is handed over while one of this target comes.
pub(super) fn in_handover(text: Option<&str>, target: &str) -> Result<Injection, String> {
    let role = Target::parse(target).map(|target| target.role).filter(|role| role.is_replicated()).unwrap_or(Role::Tissue);
    let own = format!("block {}:active thread=\"usher\"", role.name());
    let with = read(text.unwrap_or(&own), target)?;
    if target.ends_with(":both") {
        return Err(format!("{target}: one fault falls into a hand-over; take state any for :both"));
    }
    let is_found_slowly = match with.kind {
        FaultKind::Block => with.thread.is_some(),
        kind => matches!(kind, FaultKind::LeakMemory | FaultKind::LeakFiles),
    };
    // Where both grow, the one that goes last waits for a successor of the first.
    let is_of_holder =
        Target::parse(&with.target).is_some_and(|it| it.role.is_replicated() && matches!(it.which, Which::Active | Which::Both));
    if !is_found_slowly || !is_of_holder || with.for_s.is_some() {
        return Err(format!(
            "with = \"{} {}\": nobody hands a role over for that; take leak-memory, leak-files, or block with a thread, without an end, of \
             haptic, tissue or fluid, :active or :both",
            with.kind.name(),
            with.target
        ));
    }
    Ok(with)
}

/// Reads what stands for a fault beside one of this target.
fn read(text: &str, target: &str) -> Result<Injection, String> {
    let form =
        || format!("with = {text:?}: write KIND TARGET, as \"kill tissue:active\", and options, as \"no-files device for=0.5\"");
    let mut words = text.split(' ');
    let (kind, other) = words.next().zip(words.next()).ok_or_else(form)?;
    let options: toml::Table = toml::from_str(&words.collect::<Vec<_>>().join("\n")).map_err(|_| form())?;
    if Keepers::parse(other).is_some() {
        return Err(format!(
            "with = {text:?}: those who keep the station have no recovery that another fault could fall into; take an engine's"
        ));
    }
    if Keepers::parse(target) == Some(Keepers::Both) {
        return Err(format!("{target}: one fault falls into the recovery of one other; take supervisor or guardian"));
    }
    if is_of_newcomer(other) {
        return Err(format!("with = {text:?}: take state swap for who a swap brings"));
    }
    injection(kind, other, &options)
}
