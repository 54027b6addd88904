//! What a rendezvous about looks is answered with: the scope, then each object. Promise: plain numbers, the same bytes on both sides.

use bytemuck::{Pod, Zeroable};

/// How the instrument sees and what is drawn of it: the head of the answer to a rendezvous about looks; the objects' records follow.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct ScopeRecord {
    /// Angle between the scope's axis and the line of sight, rad.
    pub oblique_rad: f32,
    /// Full angle that the round picture covers, rad.
    pub field_of_view_rad: f32,
    /// Size of what stands at the rim relative to what stands in the middle (barrel distortion).
    pub periphery_ratio: f32,
    /// Brightness of the light relative to the usual.
    pub light: f32,
    /// Outer radius of the shaft, m.
    pub shaft_radius_m: f32,
    /// Length of the shaft that is drawn, m.
    pub shaft_length_m: f32,
    /// Radius of the loop electrode's half ring, to the middle of its wire, m; 0 if the instrument has none.
    pub loop_radius_m: f32,
    /// Radius of its wire, m; 0 if the instrument has none.
    pub loop_wire_radius_m: f32,
}

/// One object's appearance, in the answer to a rendezvous.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct AppearanceRecord {
    /// Registration number of the object.
    pub id: u32,
    /// 0 mucosa, 1 polyp, 2 myoma, 3 metal.
    pub material: u32,
    /// Base colour, linear RGB.
    pub colour: [f32; 3],
    /// Roughness, 0…1.
    pub roughness: f32,
    /// Age of the last cut on it, ticks; 0 if never cut.
    pub cut_age_ticks: u32,
    /// Version of the topology in which the object has this number, as in [`crate::StreamHeader`]: when a piece comes free it takes the number that an
    /// instrument had. 0 if the writer does not say.
    pub topology_version: u32,
}
