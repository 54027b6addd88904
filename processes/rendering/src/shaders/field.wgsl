// The fluid's density as it came (x fastest, as many floats as cells) into a texture that can be filtered.
@group(0) @binding(0) var<storage, read> density: array<f32>;
@group(0) @binding(1) var solid: texture_storage_3d<rgba16float, write>;

@compute @workgroup_size(4, 4, 4)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let size = textureDimensions(solid);
    if any(id >= size) { return; }
    let d = density[(id.z * size.y + id.y) * size.x + id.x];
    let finite = (bitcast<u32>(d) & 0x7f800000u) != 0x7f800000u;
    textureStore(solid, id, vec4<f32>(select(0.0, clamp(d, 0.0, 1000.0), finite), 0.0, 0.0, 0.0));
}
