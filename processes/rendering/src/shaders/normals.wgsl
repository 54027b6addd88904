// Smooth vertex normals: each vertex sums the area-weighted normals of its triangles in a fixed order, so no atomics are needed and the
// same positions always give the same bits. A position that is not finite counts as its rest position.
@group(0) @binding(0) var<storage, read> positions: array<f32>;
@group(0) @binding(1) var<storage, read> rest: array<f32>;
@group(0) @binding(2) var<storage, read> triangles: array<u32>;
@group(0) @binding(3) var<storage, read> first: array<u32>;     // per vertex + 1: where its incident triangles begin
@group(0) @binding(4) var<storage, read> incident: array<u32>;  // triangle numbers
@group(0) @binding(5) var<storage, read_write> normals: array<f32>;

fn sane(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7f800000u) != 0x7f800000u && abs(x) < 10.0;
}

fn position(v: u32) -> vec3<f32> {
    let p = vec3<f32>(positions[3u * v], positions[3u * v + 1u], positions[3u * v + 2u]);
    if sane(p.x) && sane(p.y) && sane(p.z) { return p; }
    return vec3<f32>(rest[3u * v], rest[3u * v + 1u], rest[3u * v + 2u]);
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let v = id.x + id.y * groups.x * 64u;
    if v + 1u >= arrayLength(&first) { return; }
    var sum = vec3<f32>(0.0);
    for (var k = first[v]; k < first[v + 1u]; k++) {
        let t = 3u * incident[k];
        let a = position(triangles[t]);
        let b = position(triangles[t + 1u]);
        let c = position(triangles[t + 2u]);
        sum += cross((b - a) * 1.0e3, (c - a) * 1.0e3); // millimetres: keeps tiny triangles away from denormals
    }
    let l = length(sum);
    let n = select(vec3<f32>(0.0, 0.0, 1.0), sum / max(l, 1.0e-20), l > 1.0e-12);
    normals[3u * v] = n.x;
    normals[3u * v + 1u] = n.y;
    normals[3u * v + 2u] = n.z;
}
