//! Which thread of an engine is blocked: that of its steps, or one that helps it, which that one watches.

use super::Injection;
use hyst_messages::Role;
use hyst_messages::mischief;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A thread that helps an engine.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Helper {
    /// It opens the pages and streams of newcomers.
    Usher,
    /// Of a servo: it publishes what was applied.
    Drain,
    /// Of who has a state: it writes checkpoints.
    Keeper,
    /// Of a tissue: it sends the topology, and says how the objects look.
    Clerk,
}

impl Helper {
    /// All of them with their names.
    pub const ALL: [(Helper, &'static str); 4] =
        [(Helper::Usher, "usher"), (Helper::Drain, "drain"), (Helper::Keeper, "keeper"), (Helper::Clerk, "clerk")];

    /// The one with this name.
    pub fn from_name(name: &str) -> Option<Helper> {
        Helper::ALL.iter().find(|(_, known)| *known == name).map(|(helper, _)| *helper)
    }

    /// What its engine is asked.
    pub fn thread(self) -> mischief::Thread {
        match self {
            Helper::Usher => mischief::Thread::Usher,
            Helper::Drain => mischief::Thread::Drain,
            Helper::Keeper => mischief::Thread::Keeper,
            Helper::Clerk => mischief::Thread::Clerk,
        }
    }

    fn is_of(self, role: Role) -> bool {
        match self {
            Helper::Usher => true,
            Helper::Drain => role == Role::Haptic,
            Helper::Keeper => role.is_stateful(),
            Helper::Clerk => role == Role::Tissue,
        }
    }
}

impl Injection {
    /// Why a process of this role has no such thread; `None` if it has.
    pub(super) fn unhelped(&self, role: Role) -> Option<&'static str> {
        self.thread.filter(|helper| !helper.is_of(role)).map(|_| "it has no such thread")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::faultfile::FaultKind;

    #[test]
    fn a_helper_is_blocked_where_there_is_one_and_nothing_else_is_done_to_it() {
        let checked = |kind: FaultKind, target: &str, helper: Helper| {
            Injection { thread: Some(helper), ..Injection::now(kind, target) }.check().map(|_| ())
        };
        let all = [("recorder", Helper::Usher), ("haptic:spare", Helper::Drain), ("fluid:active", Helper::Keeper)];
        for (target, helper) in all.into_iter().chain([("tissue:active", Helper::Clerk)]) {
            assert_eq!(checked(FaultKind::Block, target, helper), Ok(()), "{target} {helper:?}");
        }
        for (target, helper) in [("tissue", Helper::Drain), ("haptic:active", Helper::Keeper), ("fluid:active", Helper::Clerk)] {
            assert!(checked(FaultKind::Block, target, helper).unwrap_err().contains("no such thread"), "{target} {helper:?}");
        }
        assert!(checked(FaultKind::Spin, "tissue:active", Helper::Usher).unwrap_err().contains("thread belongs to block"));
        for (helper, name) in Helper::ALL {
            assert_eq!(Helper::from_name(name), Some(helper));
        }
    }
}
