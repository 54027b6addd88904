//! What the shaders bind, group by group: the stages that see it and its type, in the order of the bindings as `shaders` declare them.
use wgpu::{BindingType as Bind, ShaderStages as At};

use crate::pipelines::LIGHT;

fn uniform() -> Bind {
    Bind::Buffer { ty: wgpu::BufferBindingType::Uniform, has_dynamic_offset: false, min_binding_size: None }
}

fn storage(read_only: bool) -> Bind {
    Bind::Buffer { ty: wgpu::BufferBindingType::Storage { read_only }, has_dynamic_offset: false, min_binding_size: None }
}

fn texture(view_dimension: wgpu::TextureViewDimension) -> Bind {
    Bind::Texture { sample_type: wgpu::TextureSampleType::Float { filterable: true }, view_dimension, multisampled: false }
}

/// What a picture has: its uniforms, noise, relief, fluid, their two samplers, the map of what the lamp meets first, and how it is compared with.
pub(crate) fn scene_entries() -> [(At, Bind); 8] {
    let solid = (At::FRAGMENT, texture(wgpu::TextureViewDimension::D3));
    let sampler = (At::FRAGMENT, Bind::Sampler(wgpu::SamplerBindingType::Filtering));
    let view_dimension = wgpu::TextureViewDimension::D2;
    let depth = Bind::Texture { sample_type: wgpu::TextureSampleType::Depth, view_dimension, multisampled: false };
    let compared = (At::FRAGMENT, Bind::Sampler(wgpu::SamplerBindingType::Comparison));
    // The relief shapes growths, too.
    let relief = (At::VERTEX_FRAGMENT, texture(wgpu::TextureViewDimension::D3));
    let tiled = (At::VERTEX_FRAGMENT, Bind::Sampler(wgpu::SamplerBindingType::Filtering));
    [(At::VERTEX_FRAGMENT, uniform()), solid, relief, solid, tiled, sampler, (At::FRAGMENT, depth), compared]
}

/// How one object looks.
pub(crate) fn object_entries() -> [(At, Bind); 1] {
    [(At::VERTEX_FRAGMENT, uniform())]
}

/// Positions, rest, triangles, first, incident, and the normals that come of them.
pub(crate) fn shape_entries() -> [(At, Bind); 6] {
    let read = (At::COMPUTE, storage(true));
    [read, read, read, read, read, (At::COMPUTE, storage(false))]
}

/// What turns light into a picture.
pub(crate) fn post_entries() -> [(At, Bind); 7] {
    let both = At::FRAGMENT | At::COMPUTE;
    let flat = (both, texture(wgpu::TextureViewDimension::D2));
    let sampler = (both, Bind::Sampler(wgpu::SamplerBindingType::Filtering));
    [(both | At::VERTEX, uniform()), flat, flat, sampler, (both, storage(false)), (both, storage(true)), flat]
}

/// A density as it came, and the texture of it.
pub(crate) fn field_entries() -> [(At, Bind); 2] {
    let solid = Bind::StorageTexture {
        access: wgpu::StorageTextureAccess::WriteOnly,
        format: LIGHT,
        view_dimension: wgpu::TextureViewDimension::D3,
    };
    [(At::COMPUTE, storage(true)), (At::COMPUTE, solid)]
}
