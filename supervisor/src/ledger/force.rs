//! What a force says: how large it is, and whether the hand feels tissue.

/// Ticks in a row with a force that make a contact. Fewer may be the beginning of a kick in the open.
pub const CONTACT_TICKS: usize = 5;
/// A force of more than this is that of tissue, N.
const FELT_N: f32 = 0.01;

/// Whether the hand feels tissue.
pub fn is_contact(force_n: [f32; 3]) -> bool {
    norm(force_n) > FELT_N
}

/// Length of a vector.
pub fn norm(v: [f32; 3]) -> f32 {
    (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt()
}

/// Length of the difference of two vectors.
pub fn distance(a: [f32; 3], b: [f32; 3]) -> f32 {
    norm([a[0] - b[0], a[1] - b[1], a[2] - b[2]])
}
