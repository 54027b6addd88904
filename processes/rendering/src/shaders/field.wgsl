// The fluid's density as it came (x fastest, as many floats as cells) into a texture that can be filtered, smoothed: between cells a texture is read along
// straight lines, whose ends show as the lattice that they are where cells are some millimetres wide.
@group(0) @binding(0) var<storage, read> density: array<f32>;
@group(0) @binding(1) var solid: texture_storage_3d<rgba16float, write>;

// Of more cells each is finer than what is seen of it.
const SMOOTHED_CELLS: u32 = 65536u;

// The density of a cell, of one beyond the border that of the last one before it; 0 for what is no number.
fn of_cell(at: vec3<i32>, size: vec3<i32>) -> f32 {
    let c = clamp(at, vec3<i32>(0), size - vec3<i32>(1));
    let d = density[u32((c.z * size.y + c.y) * size.x + c.x)];
    let finite = (bitcast<u32>(d) & 0x7f800000u) != 0x7f800000u;
    return select(0.0, clamp(d, 0.0, 1000.0), finite);
}

@compute @workgroup_size(4, 4, 4)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let dims = textureDimensions(solid);
    if any(id >= dims) { return; }
    let size = vec3<i32>(dims);
    let at = vec3<i32>(id);
    var d = of_cell(at, size);
    if dims.x * dims.y * dims.z <= SMOOTHED_CELLS {
        // Half of its own and a twelfth of each of the six beside it: of a chequered field nothing is left, and none becomes negative.
        let x = of_cell(at - vec3<i32>(1, 0, 0), size) + of_cell(at + vec3<i32>(1, 0, 0), size);
        let y = of_cell(at - vec3<i32>(0, 1, 0), size) + of_cell(at + vec3<i32>(0, 1, 0), size);
        let z = of_cell(at - vec3<i32>(0, 0, 1), size) + of_cell(at + vec3<i32>(0, 0, 1), size);
        d = 0.5 * d + (x + y + z) / 12.0;
    }
    textureStore(solid, id, vec4<f32>(d, 0.0, 0.0, 0.0));
}
