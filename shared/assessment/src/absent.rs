//! What trainees are scored on and no recording holds, as each form of the report names it.

use crate::metric::Group;

/// Group, what, why.
pub const ABSENT: [(Group, &str, &str); 3] = [
    (Group::Visualisation, "what hid a landmark", "no shapes are recorded"),
    (Group::Safety, "wounds that took nothing off healthy tissue", "volumes are counted"),
    (Group::Safety, "where a force was applied", "contacts are recorded by number alone"),
];
