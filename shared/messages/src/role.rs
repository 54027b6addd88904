//! Roles and slots. A role is what a process does; a slot is a place for one process of that role (`haptic:1`).
//! An incarnation is one life of a process in a slot; its number is unique in the station and only grows.

/// The most collision workers a station may have.
pub const MAX_WORKERS: usize = 16;
/// Number of slots; each has one word of every kind in the station page.
pub const SLOTS: usize = 32;

/// What a process does. The order of the variants is part of the page layout.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(u8)]
pub enum Role {
    /// The simulated hardware: outside the station's fault model, the ruler by which it is judged.
    Hardware = 0,
    /// The last hop to the hand, 1 kHz.
    Device = 1,
    /// The servo, two replicas, 1 kHz.
    Haptic = 2,
    /// The Main Loop and its spare.
    Tissue = 3,
    /// The Flow Engine and its spare.
    Fluid = 4,
    /// The Vision Engine.
    Rendering = 5,
    /// The session's recorder.
    Recorder = 6,
    /// The operator's page.
    Console = 7,
    /// One share of the intersection test.
    CollisionWorker = 8,
    /// Starts, watches and restarts the engines.
    Supervisor = 9,
    /// Starts and restarts the supervisor.
    Guardian = 10,
}

impl Role {
    /// All roles, in slot order.
    pub const ALL: [Role; 11] = [
        Role::Hardware,
        Role::Device,
        Role::Haptic,
        Role::Tissue,
        Role::Fluid,
        Role::Rendering,
        Role::Recorder,
        Role::Console,
        Role::CollisionWorker,
        Role::Supervisor,
        Role::Guardian,
    ];

    /// Roles with a state that a successor goes on from; the roster says who holds each.
    pub const STATEFUL: [Role; 2] = [Role::Tissue, Role::Fluid];
    /// Roles with two processes of which either can do the whole work.
    pub const REPLICATED: [Role; 3] = [Role::Haptic, Role::Tissue, Role::Fluid];

    /// First slot and number of slots of the role; the last slot of a role with a state is its guest's ([`Slot::guest`]).
    pub const fn slots(self) -> (usize, usize) {
        match self {
            Role::Hardware => (0, 1),
            Role::Device => (1, 1),
            Role::Haptic => (2, 2),
            Role::Tissue => (4, 3),
            Role::Fluid => (7, 3),
            Role::Rendering => (10, 1),
            Role::Recorder => (11, 1),
            Role::Console => (12, 1),
            Role::CollisionWorker => (13, MAX_WORKERS),
            Role::Supervisor => (29, 1),
            Role::Guardian => (30, 1),
        }
    }

    /// The role's name, which is also the name of its binary.
    pub const fn name(self) -> &'static str {
        match self {
            Role::Hardware => "hardware",
            Role::Device => "device",
            Role::Haptic => "haptic",
            Role::Tissue => "tissue",
            Role::Fluid => "fluid",
            Role::Rendering => "rendering",
            Role::Recorder => "recorder",
            Role::Console => "console",
            Role::CollisionWorker => "collision-worker",
            Role::Supervisor => "supervisor",
            Role::Guardian => "guardian",
        }
    }

    /// The role with this name.
    pub fn from_name(name: &str) -> Option<Role> {
        Role::ALL.into_iter().find(|role| role.name() == name)
    }

    /// What names the role in the name of a slot (`haptic:1`) or of whom else (`tissue:active`): all that stands before a colon.
    pub fn name_in(text: &str) -> &str {
        text.split(':').next().unwrap_or(text)
    }

    /// Whether the role is written with an index (`haptic:0`) because it may have several processes.
    pub const fn is_indexed(self) -> bool {
        self.is_replicated() || matches!(self, Role::CollisionWorker)
    }

    /// Whether it is one of [`Role::STATEFUL`].
    pub const fn is_stateful(self) -> bool {
        self.is_among(&Role::STATEFUL)
    }

    /// Whether it is one of [`Role::REPLICATED`].
    pub const fn is_replicated(self) -> bool {
        self.is_among(&Role::REPLICATED)
    }

    /// Whether it is an engine, which may be hurt, swapped and left to whoever comes after it: not the ruler, nor who keeps the station.
    pub const fn is_engine(self) -> bool {
        !matches!(self, Role::Hardware | Role::Supervisor | Role::Guardian)
    }

    const fn is_among(self, roles: &[Role]) -> bool {
        let mut at = 0;
        while at < roles.len() {
            if roles[at] as u8 == self as u8 {
                return true;
            }
            at += 1;
        }
        false
    }
}

/// A place for one process.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Slot(u8);

impl Slot {
    /// The slot of `role` with this index; `None` if the role has fewer.
    pub const fn new(role: Role, index: usize) -> Option<Slot> {
        let (first, count) = role.slots();
        if index < count { Some(Slot((first + index) as u8)) } else { None }
    }

    /// The first slot of a role; every role has one.
    pub const fn first(role: Role) -> Slot {
        Slot(role.slots().0 as u8)
    }

    /// The slot in which a role with a state takes a newcomer on trial, beside holder and spare; empty but for a swap.
    pub const fn guest(role: Role) -> Option<Slot> {
        if role.is_stateful() { Slot::new(role, role.slots().1 - 1) } else { None }
    }

    /// Whether this is the slot of a newcomer on trial.
    pub fn is_guest(self) -> bool {
        Slot::guest(self.role()) == Some(self)
    }

    /// The slot with this number, if it belongs to a role.
    pub fn from_number(number: usize) -> Option<Slot> {
        Role::ALL
            .into_iter()
            .find(|role| (role.slots().0..role.slots().0 + role.slots().1).contains(&number))
            .map(|_| Slot(number as u8))
    }

    /// The slot's number, `0..SLOTS`.
    pub const fn number(self) -> usize {
        self.0 as usize
    }

    /// The role that the slot belongs to.
    pub fn role(self) -> Role {
        let number = self.number();
        Role::ALL
            .into_iter()
            .find(|role| (role.slots().0..role.slots().0 + role.slots().1).contains(&number))
            .unwrap_or(Role::Guardian)
    }

    /// Index within the role.
    pub fn index(self) -> usize {
        self.number() - self.role().slots().0
    }

    /// Parses `haptic:1`, `device`; an indexed role without an index means index 0.
    pub fn parse(text: &str) -> Option<Slot> {
        let (name, index) = match text.split_once(':') {
            Some((name, index)) => (name, index.parse().ok()?),
            None => (text, 0),
        };
        Slot::new(Role::from_name(name)?, index)
    }
}

impl std::fmt::Display for Slot {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if self.role().is_indexed() {
            write!(f, "{}:{}", self.role().name(), self.index())
        } else {
            f.write_str(self.role().name())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slots_do_not_overlap_and_names_round_trip() {
        let mut taken = [false; SLOTS];
        for role in Role::ALL {
            for index in 0..role.slots().1 {
                let slot = Slot::new(role, index).unwrap();
                assert!(!taken[slot.number()], "{slot} overlaps");
                taken[slot.number()] = true;
                assert_eq!(Slot::parse(&slot.to_string()), Some(slot));
                assert_eq!(Role::name_in(&slot.to_string()), role.name());
                assert_eq!((slot.role(), slot.index()), (role, index));
                assert_eq!(Slot::from_number(slot.number()), Some(slot));
            }
            assert_eq!(Slot::new(role, role.slots().1), None);
            assert!(Slot::guest(role).is_none_or(|slot| slot.is_guest() && slot.index() == 2));
            assert!(!Slot::first(role).is_guest());
        }
    }

    #[test]
    fn a_role_has_as_many_slots_as_it_has_replicas_and_guests() {
        for role in Role::ALL {
            assert_eq!(
                (role.is_stateful(), role.is_replicated()),
                (Role::STATEFUL.contains(&role), Role::REPLICATED.contains(&role))
            );
            let (replicas, guests) = (1 + usize::from(role.is_replicated()), usize::from(role.is_stateful()));
            assert!(role.slots().1 == replicas + guests || role == Role::CollisionWorker, "{role:?}");
            assert_eq!((role.is_indexed(), Slot::guest(role).is_some()), (role.slots().1 > 1, role.is_stateful()), "{role:?}");
        }
    }
}
