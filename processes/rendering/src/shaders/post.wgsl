// From linear light to the picture: focus, bloom, exposure, the lens (barrel distortion, vignetting, round mask with notch), text.
struct Post {
    size: vec4<f32>,     // picture px: width, height; scene texels: width, height
    lens: vec4<f32>,     // k1, k2 of the radial polynomial, 1 if round, notch angle rad
    tone: vec4<f32>,     // gain, rate of adaptation 0..1, 1 if exposure is fixed, bloom 0..1
    text: vec4<f32>,     // glyph scale px, columns, rows, 1 if the last row is a sign
    focus: vec4<f32>,    // alpha of what is sharp, texels of a disc's radius for each unit of alpha off it, largest radius texels, 0
};
@group(0) @binding(0) var<uniform> p: Post;
@group(0) @binding(1) var source: texture_2d<f32>;
@group(0) @binding(2) var glow: texture_2d<f32>;
@group(0) @binding(3) var smooth_sampler: sampler;
@group(0) @binding(4) var<storage, read_write> exposure: array<f32>;
@group(0) @binding(5) var<storage, read> glyphs: array<u32>;  // 8 bytes per glyph, a byte per row, then the text, a code per word
@group(0) @binding(6) var soft: texture_2d<f32>;               // what is out of focus, with how much of it there is in place of the sharp
override FOCUSED: bool = false;

// What the last passes branch on comes from its vertices: lavapipe (Mesa 22.3) compiles a fragment shader that branches on uniforms alone
// anew for every frame, which costs 10 ms and is never freed.
struct Screen {
    @builtin(position) at: vec4<f32>,
    @location(0) uv: vec2<f32>,
    @location(1) @interpolate(flat) is: vec2<f32>,   // 1 if round, 1 if the last row is a sign
    @location(2) @interpolate(flat) turn: vec2<f32>, // cosine and sine of the notch's angle
};

@vertex
fn screen(@builtin(vertex_index) i: u32) -> Screen {
    var s: Screen;
    s.uv = vec2<f32>(f32((i << 1u) & 2u), f32(i & 2u));
    s.at = vec4<f32>(s.uv * vec2<f32>(2.0, -2.0) + vec2<f32>(-1.0, 1.0), 0.0, 1.0);
    s.is = vec2<f32>(p.lens.z, p.text.w);
    s.turn = vec2<f32>(cos(p.lens.w), sin(p.lens.w));
    return s;
}

fn clean(c: vec3<f32>) -> vec3<f32> { return clamp(c, vec3<f32>(0.0), vec3<f32>(60.0)); }

// Radius of the disc that a point of this alpha is seen as, texels of the scene.
fn disc(alpha: f32) -> f32 { return min(abs(alpha - p.focus.x) * p.focus.y, p.focus.z); }

// Half of the size, out of focus: the mean over a texel's disc. What lies before it counts as far as its own disc reaches, so that a sharp loop
// leaves no halo on the wall behind, and a blurred one spreads over it.
const TAPS: u32 = 12u;
const LEAST_RADIUS: f32 = 0.45;
@fragment
fn defocus(s: Screen) -> @location(0) vec4<f32> {
    let t = 1.0 / p.size.zw;
    let own = textureSampleLevel(source, smooth_sampler, s.uv, 0.0);
    let front = own.a * 1.08 + 1.0e-4;
    var radius = disc(own.a);
    for (var corner = 0; corner < 4; corner++) {
        let to = vec2<f32>(f32(corner & 1), f32(corner >> 1u)) * 4.4 - 2.2;
        let beside = textureSampleLevel(source, smooth_sampler, s.uv + t * to, 0.0).a;
        let reach = disc(beside);
        if beside > front && reach > 3.0 { radius = max(radius, reach); }
    }
    if radius < LEAST_RADIUS { return vec4<f32>(own.rgb, 0.0); }
    var sum = vec4<f32>(min(own.rgb, vec3<f32>(4.0)), 1.0);
    for (var k = 0u; k < TAPS; k++) {
        let far = radius * sqrt((f32(k) + 0.5) / f32(TAPS));
        let angle = 2.399963 * f32(k);
        let tap = textureSampleLevel(source, smooth_sampler, s.uv + t * far * vec2<f32>(cos(angle), sin(angle)), 0.0);
        let weight = select(1.0, clamp(disc(tap.a) - far + 1.0, 0.0, 1.0), tap.a > front);
        sum += vec4<f32>(min(tap.rgb, vec3<f32>(4.0)), 1.0) * weight;
    }
    return vec4<f32>(sum.rgb / sum.w, smoothstep(LEAST_RADIUS, 3.0 * LEAST_RADIUS, radius));
}

// A quarter of the size, each texel the mean of 4 × 4; its alpha is 0 where nothing is.
@fragment
fn shrink(s: Screen) -> @location(0) vec4<f32> {
    let t = 1.0 / p.size.zw;
    var sum = vec4<f32>(0.0);
    for (var corner = 0; corner < 4; corner++) {
        let to = vec2<f32>(f32(corner & 1), f32(corner >> 1u)) * 2.0 - 1.0;
        let texel = textureSampleLevel(source, smooth_sampler, s.uv + t * to, 0.0);
        sum += vec4<f32>(clean(texel.rgb), clamp(texel.a, 0.0, 1.0));
    }
    return sum * 0.25;
}

fn blur(uv: vec2<f32>, step: vec2<f32>, threshold: f32) -> vec4<f32> {
    var c = vec3<f32>(0.0);
    var weights = array<f32, 4>(0.22, 0.19, 0.13, 0.07);
    for (var k = -3; k <= 3; k++) {
        let t = textureSampleLevel(source, smooth_sampler, uv + step * f32(k) * 1.5, 0.0).rgb;
        c += max(t - vec3<f32>(threshold), vec3<f32>(0.0)) * weights[abs(k)];
    }
    return vec4<f32>(c, 1.0);
}

@fragment
fn blur_across(s: Screen) -> @location(0) vec4<f32> {
    return blur(s.uv, vec2<f32>(4.0 / p.size.z, 0.0), 0.7 / max(exposure[0], 1.0e-3));
}

@fragment
fn blur_down(s: Screen) -> @location(0) vec4<f32> {
    return blur(s.uv, vec2<f32>(0.0, 4.0 / p.size.w), 0.0);
}

// Exposure from the mean logarithm of luminance over the round field, as a camera head does it; eased from frame to frame. A field in which
// nothing stands is not metered, and the first that is sets the exposure at once: else a stage that is still empty would dazzle the eye.
const LEAST_COVERED: f32 = 0.05;
var<workgroup> partial: array<vec3<f32>, 64>;
@compute @workgroup_size(64)
fn meter(@builtin(local_invocation_index) i: u32) {
    let size = vec2<f32>(textureDimensions(source));
    var sum = vec3<f32>(0.0);
    for (var k = i; k < 1024u; k += 64u) {
        let uv = (vec2<f32>(f32(k % 32u), f32(k / 32u)) + 0.5) / 32.0;
        let q = uv * 2.0 - 1.0;
        let texel = textureLoad(source, vec2<i32>(uv * size), 0);
        let c = clean(texel.rgb);
        let inside = select(0.0, 1.0, dot(q, q) < 0.9);
        let lum = dot(c, vec3<f32>(0.30, 0.59, 0.11));
        sum += vec3<f32>(log(lum + 0.01), 1.0, select(0.0, 1.0, texel.a > 0.0)) * inside;
    }
    partial[i] = sum;
    workgroupBarrier();
    if i == 0u {
        var total = vec3<f32>(0.0);
        for (var k = 0u; k < 64u; k++) { total += partial[k]; }
        var wanted = clamp(0.21 / exp(total.x / max(total.y, 1.0)), 0.15, 6.0);
        if p.tone.z > 0.5 { wanted = 1.0; }
        let old = exposure[0];
        let eased = select(wanted, old + (wanted - old) * p.tone.y, old > 0.0 && old < 100.0);
        if p.tone.z > 0.5 || total.z > LEAST_COVERED * total.y { exposure[0] = eased; }
    }
}

fn curve(x: vec3<f32>) -> vec3<f32> {
    return clamp(x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14), vec3<f32>(0.0), vec3<f32>(1.0));
}

// A film's curve for the brightest channel, the others mostly in proportion: near the lamp tissue bleaches to pink and not to cream.
fn filmic(x: vec3<f32>) -> vec3<f32> {
    let most = max(max(x.r, x.g), max(x.b, 1.0e-4));
    return mix(curve(x), x * (curve(vec3<f32>(most)).x / most), 0.6);
}

// Where a pixel lies in the round field, whose rim is at 1.
fn in_field(pixel: vec2<f32>) -> vec2<f32> {
    return (pixel - 0.5 * p.size.xy) / (0.5 * min(p.size.x, p.size.y));
}

// Whether a place of the field lies outside of it, or in the orientation notch, a small triangle.
fn is_masked(q: vec2<f32>, turn: vec2<f32>) -> bool {
    let turned = vec2<f32>(q.x * turn.x + q.y * turn.y, -q.x * turn.y + q.y * turn.x);
    return dot(q, q) > 1.0 || abs(turned.x) < (turned.y * -1.0 - 0.93) * 0.55;
}

// What the lens draws at a place of the field: where that is in the scene as it was drawn.
fn through_lens(q: vec2<f32>) -> vec2<f32> {
    let r2 = dot(q, q);
    let src = q * (1.0 + p.lens.x * r2 + p.lens.y * r2 * r2) / (1.0 + p.lens.x + p.lens.y);
    return src * 0.5 + 0.5;
}

// Share of the light that comes to a place so far from the middle, squared.
fn vignette(r2: f32) -> f32 { return 1.0 - 0.48 * r2 * r2; }

// Where something lies before something else an edge is drawn in steps: mean of four texels about it.
fn smoothed(lit: vec4<f32>, uv: vec2<f32>) -> vec4<f32> {
    let t = 0.6 / p.size.zw;
    let s0 = textureSampleLevel(source, smooth_sampler, uv + t * vec2<f32>(1.0, 0.4), 0.0);
    let s1 = textureSampleLevel(source, smooth_sampler, uv + t * vec2<f32>(-0.4, 1.0), 0.0);
    let s2 = textureSampleLevel(source, smooth_sampler, uv + t * vec2<f32>(-1.0, -0.4), 0.0);
    let s3 = textureSampleLevel(source, smooth_sampler, uv + t * vec2<f32>(0.4, -1.0), 0.0);
    let top = max(max(s0.a, s1.a), max(s2.a, s3.a));
    let low = min(min(s0.a, s1.a), min(s2.a, s3.a));
    let edge = smoothstep(0.08, 0.30, (top - low) / max(top, 1.0e-5));
    return vec4<f32>(mix(lit.rgb, 0.25 * (s0.rgb + s1.rgb + s2.rgb + s3.rgb), 0.8 * edge), lit.a);
}

// Light as a screen shows it.
fn developed(c: vec3<f32>, shade: f32) -> vec3<f32> {
    return pow(filmic(clean(c) * exposure[0] * p.tone.x * shade), vec3<f32>(0.4545));
}

fn picture(pixel: vec2<f32>, is_round: bool, turn: vec2<f32>) -> vec3<f32> {
    var uv = pixel / p.size.xy;
    var shade = 1.0;
    if is_round {
        let q = in_field(pixel);
        if is_masked(q, turn) { return vec3<f32>(0.0); }
        uv = through_lens(q);
        let r2 = dot(q, q);
        shade = vignette(r2) * (1.0 - smoothstep(0.975, 1.0, sqrt(r2)));
    }
    var lit = textureSampleLevel(source, smooth_sampler, uv, 0.0);
    if FOCUSED {
        let blurred = textureSampleLevel(soft, smooth_sampler, uv, 0.0);
        lit = vec4<f32>(mix(lit.rgb, blurred.rgb, blurred.a), lit.a);
    }
    if !FOCUSED && is_round { lit = smoothed(lit, uv); }
    var behind = vec3<f32>(0.0);
    if !is_round { behind = mix(vec3<f32>(0.085, 0.095, 0.115), vec3<f32>(0.012, 0.014, 0.018), length(uv - vec2<f32>(0.5, 0.42)) * 1.3); }
    let c = lit.rgb + behind * (1.0 - lit.a) + textureSampleLevel(glow, smooth_sampler, uv, 0.0).rgb * p.tone.w;
    return developed(c, shade);
}

// A round field that is drawn coarsely, and of which nothing is out of focus, is developed texel by texel, and enlarged through the lens after that: of its
// texels there are a third as many as pixels, or a tenth. Each is darkened as where the lens will draw it, which is found by Newton's way.
const STEPS_TO_RIM: i32 = 3;
@fragment
fn tone(s: Screen) -> @location(0) vec4<f32> {
    let lit = smoothed(textureSampleLevel(source, smooth_sampler, s.uv, 0.0), s.uv);
    let c = lit.rgb + textureSampleLevel(glow, smooth_sampler, s.uv, 0.0).rgb * p.tone.w;
    let off = length(s.uv * 2.0 - 1.0);
    let wanted = off * (1.0 + p.lens.x + p.lens.y);
    var r = off;
    for (var k = 0; k < STEPS_TO_RIM; k++) {
        let r2 = r * r;
        let there = r * (1.0 + p.lens.x * r2 + p.lens.y * r2 * r2);
        let slope = 1.0 + 3.0 * p.lens.x * r2 + 5.0 * p.lens.y * r2 * r2;
        r = clamp(r - (there - wanted) / max(slope, 0.1), 0.0, 1.0);
    }
    return vec4<f32>(developed(c, vignette(r * r)), 1.0);
}

// Such a field, enlarged.
@fragment
fn plain(s: Screen) -> @location(0) vec4<f32> {
    let q = in_field(s.at.xy);
    if is_masked(q, s.turn) { return vec4<f32>(0.0, 0.0, 0.0, 1.0); }
    // The rim ends softly: of light that is developed already it takes the root.
    let rim = sqrt(1.0 - smoothstep(0.975, 1.0, length(q)));
    return vec4<f32>(textureSampleLevel(source, smooth_sampler, through_lens(q), 0.0).rgb * rim, 1.0);
}

// x: ink, y: in a cell with a glyph, z: on the sign's row or an alarm's
fn glyph(pixel: vec2<f32>, has_sign: bool) -> vec3<f32> {
    let at = (pixel - vec2<f32>(6.0)) / p.text.x;
    let cell = floor(at / vec2<f32>(7.0, 11.0));
    if any(cell < vec2<f32>(0.0)) || cell.x >= p.text.y || cell.y >= p.text.z { return vec3<f32>(0.0); }
    let code = glyphs[256u + u32(cell.y * p.text.y + cell.x)];
    if code == 0u { return vec3<f32>(0.0); }
    // A large character lies in four cells, each of which holds a quarter of it.
    let quarter = vec2<f32>(f32((code >> 9u) & 1u), f32((code >> 10u) & 1u));
    let size = 1.0 + f32((code >> 8u) & 1u);
    let inside = (at - cell * vec2<f32>(7.0, 11.0) + quarter * vec2<f32>(7.0, 11.0)) / size;
    let row = u32(inside.y) - 1u;
    let sign = max(select(0.0, 1.0, has_sign && cell.y == p.text.z - 1.0), f32((code >> 7u) & 1u));
    if u32(inside.y) < 1u || row >= 8u { return vec3<f32>(0.0, 1.0, sign); }
    let bits = (glyphs[2u * (code & 127u) + row / 4u] >> ((row % 4u) * 8u)) & 255u;
    let column = u32(inside.x);
    return vec3<f32>(f32((bits >> (7u - min(column, 7u))) & 1u), 1.0, sign);
}

@fragment
fn finish(s: Screen) -> @location(0) vec4<f32> {
    return vec4<f32>(picture(s.at.xy, s.is.x > 0.5, s.turn), 1.0);
}

// Ink where there is any, and a veil over the picture about it.
@fragment
fn text(s: Screen) -> @location(0) vec4<f32> {
    let t = glyph(s.at.xy, s.is.y > 0.5);
    let ink = mix(vec3<f32>(0.86, 0.95, 0.90), vec3<f32>(1.0, 0.74, 0.20), t.z);
    return vec4<f32>(ink * t.x, max(t.x, 0.55 * t.y));
}

// The finished picture on the window, whole, with its own aspect ratio.
@fragment
fn show(s: Screen) -> @location(0) vec4<f32> {
    return vec4<f32>(textureSampleLevel(source, smooth_sampler, s.uv, 0.0).rgb, 1.0);
}
