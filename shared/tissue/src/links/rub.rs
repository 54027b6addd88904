//! Friction of a contact: a spring that slides.

use super::{ContactLaw, Ready};

/// What friction does: its force, N, and how far what sticks is bent by it, m.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Rub {
    pub(super) force_n: [f32; 3],
    pub(super) bent_m: [f32; 3],
}

/// Friction as a spring that slides, damped as the contact is: of what is pressed with so much, slips so fast, and sticks `away_m` from where it is.
pub(super) fn stick(
    law: &ContactLaw,
    ready: &Ready,
    (normal, away_m): (&[f32; 3], [f32; 3]),
    damped_n: f32,
    slip: [f32; 3],
) -> Rub {
    let most_n = law.friction * damped_n;
    let out_m = normal[0] * away_m[0] + normal[1] * away_m[1] + normal[2] * away_m[2];
    let along_m = [0, 1, 2].map(|axis| away_m[axis] - out_m * normal[axis]);
    let (stretched_m, stiffness_n_m) = (length(along_m), ready.stiffness_n_m);
    let held = if stiffness_n_m * stretched_m > most_n { most_n / (stiffness_n_m * stretched_m) } else { 1.0 };
    let bent_m = along_m.map(|part_m| held * part_m);
    let damping_n_s_m = (stiffness_n_m * law.damping_s).min(ready.most_n_s_m);
    let wanted_n = [0, 1, 2].map(|axis| stiffness_n_m * bent_m[axis] - damping_n_s_m * slip[axis]);
    let wanted = length(wanted_n);
    let share = if wanted > most_n { most_n / wanted } else { 1.0 };
    Rub { force_n: wanted_n.map(|part_n| share * part_n), bent_m }
}

fn length(vector: [f32; 3]) -> f32 {
    (vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2]).sqrt()
}
