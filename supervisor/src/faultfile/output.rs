//! By which of its outputs an engine lies: which there are, who has them, and what can be wrong in each.

use super::Injection;
use hyst_messages::Role;
use hyst_messages::mischief::{Mischief, Outlet};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// One output of an engine.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Output {
    /// The state that its steps send.
    State,
    /// What stands in its page for others to compute from.
    Cell,
    /// The topology.
    Topology,
    /// The jobs of the collision workers.
    Job,
    /// The stream of what was applied.
    Force,
    /// How the objects look.
    Appearance,
}

impl Output {
    /// All of them with their names.
    pub const ALL: [(Output, &'static str); 6] = [
        (Output::State, "state"),
        (Output::Cell, "cell"),
        (Output::Topology, "topology"),
        (Output::Job, "job"),
        (Output::Force, "force"),
        (Output::Appearance, "appearance"),
    ];

    /// The output with this name.
    pub fn from_name(name: &str) -> Option<Output> {
        Output::ALL.iter().find(|(_, known)| *known == name).map(|(output, _)| *output)
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        Output::ALL.iter().find(|(output, _)| *output == self).map_or("", |(_, name)| name)
    }

    /// What its engine is asked.
    pub fn outlet(self) -> Outlet {
        match self {
            Output::State => Outlet::State,
            Output::Cell => Outlet::Cell,
            Output::Topology => Outlet::Topology,
            Output::Job => Outlet::Job,
            Output::Force => Outlet::Force,
            Output::Appearance => Outlet::Appearance,
        }
    }

    /// Those of a role that has several, or one beside its steps.
    fn of(role: Role) -> &'static [Output] {
        match role {
            Role::Tissue => &[Output::State, Output::Cell, Output::Topology, Output::Job, Output::Appearance],
            Role::Fluid => &[Output::State, Output::Cell],
            Role::Haptic => &[Output::Cell, Output::Force],
            Role::Device => &[Output::Cell],
            _ => &[],
        }
    }
}

impl Injection {
    /// Why a process of this role cannot lie so by the output; `None` if it can.
    pub(super) fn untold(&self, role: Role) -> Option<&'static str> {
        let (output, what) = (self.output?, self.kind.mischief()?);
        let is_number = matches!(what, Mischief::Nan | Mischief::Inf | Mischief::Range);
        let is_layout = what == Mischief::Layout;
        match output {
            _ if !Output::of(role).contains(&output) => Some("it has no such output"),
            Output::Cell if is_layout => Some("the layout of a page is checked once, before anybody reads in it"),
            Output::State | Output::Cell => None,
            Output::Appearance if !is_number => Some("that answer has neither stamp nor layout; take nan, inf or range"),
            // The layout of a servo's is refused before this.
            Output::Force if !is_number => Some("nobody goes by the stamp of that; take nan, inf or range"),
            _ if !is_number && !is_layout => Some("nobody goes by the stamp of that; take nan, inf, range or layout"),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::faultfile::FaultKind;

    #[test]
    fn each_lies_by_the_outputs_that_it_has_in_what_can_be_wrong_there() {
        let checked = |kind: FaultKind, target: &str, output: Output| {
            Injection { output: Some(output), ..Injection::now(kind, target) }.check().map(|_| ())
        };
        for (kind, target, output) in [
            (FaultKind::Nan, "tissue:active", Output::State),
            (FaultKind::Frozen, "fluid:active", Output::Cell),
            (FaultKind::Range, "tissue:active", Output::Topology),
            (FaultKind::Layout, "tissue:active", Output::Job),
            (FaultKind::Inf, "haptic:active", Output::Force),
            (FaultKind::Nan, "tissue:active", Output::Appearance),
            (FaultKind::Nan, "device", Output::Cell),
        ] {
            assert_eq!(checked(kind, target, output), Ok(()), "{} {target} {output:?}", kind.name());
        }
        for (kind, target, output, words) in [
            (FaultKind::Nan, "fluid:active", Output::Topology, "no such output"),
            (FaultKind::Nan, "collision-worker:0", Output::State, "no such output"),
            (FaultKind::Frozen, "tissue:active", Output::Job, "stamp"),
            (FaultKind::Layout, "tissue:active", Output::Appearance, "nor layout"),
            (FaultKind::Layout, "fluid:active", Output::Cell, "checked once"),
            (FaultKind::Kill, "tissue:active", Output::State, "output belongs to"),
            (FaultKind::Block, "tissue:active", Output::State, "output belongs to"),
        ] {
            let refused = checked(kind, target, output).unwrap_err();
            assert!(refused.contains(words), "{} {target} {output:?}: {refused}", kind.name());
        }
        for (output, name) in Output::ALL {
            assert_eq!((Output::from_name(name), output.name()), (Some(output), name));
            let text = format!("kind = \"nan\"\ntarget = \"tissue\"\ntick = 1\noutput = \"{name}\"\n");
            assert_eq!(toml::from_str::<Injection>(&text).unwrap().output, Some(output));
        }
    }

    /// `stamp haptic --output force` was told to take `layout`, which no servo takes.
    #[test]
    fn what_a_refusal_advises_is_taken() {
        let checked = |kind: FaultKind, target: &str, output: Output| {
            Injection { output: Some(output), ..Injection::now(kind, target) }.check().map(|_| ())
        };
        let mut advised = 0;
        let of_targets = ["device", "haptic", "tissue", "fluid"].map(|target| Output::ALL.map(|(output, _)| (target, output)));
        for (target, output) in of_targets.into_iter().flatten() {
            for (kind, name, _) in FaultKind::ALL {
                let refused = checked(kind, target, output).err().unwrap_or_default();
                let advice = refused.split_once("; take ").map_or("", |(_, advice)| advice);
                for other in advice.split([' ', ',']).filter_map(FaultKind::from_name) {
                    assert_eq!(checked(other, target, output), Ok(()), "{name} {target} {output:?}: {refused}");
                    advised += 1;
                }
            }
        }
        assert!(advised > 0);
    }
}
