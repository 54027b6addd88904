//! Whom a fault is for: engines, by role and place, or those who keep the station.

use hyst_messages::{Role, Slot};
use serde::{Deserialize, Serialize};

/// Which process of a role.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Which {
    /// The one that does the role's work now.
    Active,
    /// One that does not.
    Spare,
    /// The one that does the work and its spare, at the same instant.
    Both,
    /// The one that a swap has brought, while the swap is under way.
    Newcomer,
    /// This one.
    Slot(Slot),
}

/// An engine as on the command line: `haptic:active`, `tissue:spare`, `fluid:both`, `fluid:newcomer`, `collision-worker:1`, `device`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Target {
    /// Role.
    pub role: Role,
    /// Which of them.
    pub which: Which,
}

impl Target {
    /// Reads a target; an indexed role without a word after the colon means the active one.
    pub fn parse(text: &str) -> Option<Target> {
        let (name, which) = text.split_once(':').unwrap_or((text, "active"));
        let role = Role::from_name(name).filter(|role| role.is_engine())?;
        let which = match which {
            "active" => Which::Active,
            "spare" if role.is_indexed() => Which::Spare,
            "both" if role.is_replicated() => Which::Both,
            "newcomer" => Which::Newcomer,
            index => Which::Slot(Slot::new(role, index.parse().ok()?)?),
        };
        Some(Target { role, which })
    }
}

/// Those who keep the station: the supervisor, the guardian, or both at the same instant.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Keepers {
    /// The supervisor.
    Supervisor,
    /// The guardian, which is `hystation run`.
    Guardian,
    /// Both.
    Both,
}

impl Keepers {
    /// Reads `supervisor`, `guardian` or `supervisor+guardian`.
    pub fn parse(text: &str) -> Option<Keepers> {
        Some(match text {
            "supervisor" => Keepers::Supervisor,
            "guardian" => Keepers::Guardian,
            "supervisor+guardian" => Keepers::Both,
            _ => return None,
        })
    }

    /// Their roles; the guardian first, since it would start another supervisor.
    pub fn roles(self) -> &'static [Role] {
        match self {
            Keepers::Supervisor => &[Role::Supervisor],
            Keepers::Guardian => &[Role::Guardian],
            Keepers::Both => &[Role::Guardian, Role::Supervisor],
        }
    }
}

/// Whom a fault is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Aim {
    /// One or two engines; the supervisor does it.
    Engines(Target),
    /// The station's keepers; whoever wants it does it.
    Keepers(Keepers),
}

impl Aim {
    /// Reads what stands for a target on the command line.
    pub fn parse(text: &str) -> Option<Aim> {
        Keepers::parse(text).map(Aim::Keepers).or_else(|| Target::parse(text).map(Aim::Engines))
    }

    /// Whether a station of these slots has whom it means. Each has its keepers.
    pub fn is_in(self, slots: &[Slot]) -> bool {
        let Aim::Engines(target) = self else { return true };
        let of_role = slots.iter().filter(|slot| slot.role() == target.role).count();
        match target.which {
            Which::Active | Which::Newcomer => of_role >= 1,
            Which::Spare | Which::Both => of_role >= 2,
            Which::Slot(slot) => slots.contains(&slot),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn targets_are_read_and_the_hardware_is_none() {
        let haptic_1 = Slot::new(Role::Haptic, 1).unwrap();
        assert_eq!(Target::parse("haptic:1"), Some(Target { role: Role::Haptic, which: Which::Slot(haptic_1) }));
        assert_eq!(Target::parse("device"), Some(Target { role: Role::Device, which: Which::Active }));
        assert_eq!(Target::parse("tissue:spare"), Some(Target { role: Role::Tissue, which: Which::Spare }));
        assert_eq!(Target::parse("fluid:both"), Some(Target { role: Role::Fluid, which: Which::Both }));
        assert_eq!(Target::parse("console:newcomer"), Some(Target { role: Role::Console, which: Which::Newcomer }));
        for bad in [
            "hardware",
            "hardware:newcomer",
            "haptic:2",
            "haptic:x",
            "",
            "device:spare",
            "guardian",
            "collision-worker:both",
            "device:both",
        ] {
            assert_eq!(Target::parse(bad), None, "{bad}");
        }
        assert_eq!(Aim::parse("guardian"), Some(Aim::Keepers(Keepers::Guardian)));
        assert_eq!(Aim::parse("supervisor+guardian").map(|aim| aim == Aim::Keepers(Keepers::Both)), Some(true));
        assert_eq!((Aim::parse("guardian+supervisor"), Aim::parse("supervisor:0")), (None, None));
    }
}
