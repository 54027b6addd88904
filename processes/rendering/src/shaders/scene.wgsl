// The scene as the lens sees it, in linear light: wet tissue, metal, bubbles, the spotlight at the scope's tip, blood along the ray.
// Textures are solid noise looked up at the rest position, so that vessels and glands move with the tissue and need no unwrapping.
override METAL: bool = false;
override GAS: bool = false;
override FLUID: bool = false;
override OUTSIDE: bool = false;
// For developers: each leaves out a part of how tissue looks.
override NO_VESSELS: bool = false;
override NO_BUMP: bool = false;
override NO_WET: bool = false;
override NO_SOFT: bool = false;

struct Globals {
    view_proj: mat4x4<f32>,
    eye: vec4<f32>,          // m
    light: vec4<f32>,        // position m, intensity at 10 mm
    light_axis: vec4<f32>,   // unit, cosine of the cone's edge
    cone: vec4<f32>,         // cosine of the full-light cone, ambient, nearest distance drawn m, width of a texel of the shadow at a distance of one; 0 if nothing throws any
    clip: vec4<f32>,         // tissue with dot(n, p) > d is cut away; n = 0: no cut
    fluid_min: vec4<f32>,    // corner of the fluid's box m
    fluid_max: vec4<f32>,    // opposite corner m
    blood: vec4<f32>,        // linear colour of much blood that is lit
    murk: vec4<f32>,         // what each colour loses on a metre of density 1, there and back: twice the extinction 1/m
    blood_min: vec4<f32>,    // corner of the box in which there is any m
    blood_max: vec4<f32>,    // opposite corner m
    lamp: mat4x4<f32>,       // into the map of what the light meets first
};
struct Object {
    model: mat4x4<f32>,
    colour: vec4<f32>,       // linear, alpha
    surface: vec4<f32>,      // roughness, texture frequency 1/m, vessels 0..1, bump 0..1
    extra: vec4<f32>,        // 1 if the cut away half shows (never clipped: growths, metal); of metal the crust 0..1 and glow 0..1; mouths of glands 0..1
    mouths: array<vec4<f32>, 2>, // of the tubes: rest position m, radius m, 0 where there is none
    shape: vec4<f32>,        // height of its lobes m, their frequency 1/m, most light that it shows or 0, 1 if it is a myoma
    spots: array<vec4<f32>, 64>, // blanched by coagulation: rest position m, radius m, 0 behind the last
};
@group(0) @binding(0) var<uniform> g: Globals;
@group(0) @binding(1) var noise: texture_3d<f32>;
@group(0) @binding(2) var bump: texture_3d<f32>;
@group(0) @binding(3) var fluid: texture_3d<f32>;
@group(0) @binding(4) var tiled: sampler;
@group(0) @binding(5) var clamped: sampler;
@group(0) @binding(6) var shadow: texture_depth_2d;
@group(0) @binding(7) var compared: sampler_comparison;
@group(1) @binding(0) var<uniform> o: Object;

struct Varying {
    @builtin(position) clip: vec4<f32>,
    @location(0) world: vec3<f32>,
    @location(1) normal: vec3<f32>,
    @location(2) rest: vec3<f32>,
    @location(3) raw: f32,
    @location(4) open: f32,
};

fn sane(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7f800000u) != 0x7f800000u && abs(x) < 10.0;
}

@vertex
fn vertex(@location(0) position: vec3<f32>, @location(1) normal: vec3<f32>, @location(2) rest: vec3<f32>, @location(3) raw: u32,
          @location(4) open: f32, @location(5) lobes: f32) -> Varying {
    var p = position;
    if !(sane(p.x) && sane(p.y) && sane(p.z)) { p = rest; }
    var v: Varying;
    var n = normal;
    // None on a wound, nor where what is whole ends at its rim: one would look into nothing between the two.
    let height = o.shape.x * lobes;
    if height > 0.0 {
        // The lobes of a growth, and its normal with them: a texel's slope is that over two texels of the 64 in a tile.
        let relief = textureSampleLevel(bump, tiled, rest * o.shape.y, 0.0);
        let slope = relief.xyz * (32.0 * height * o.shape.y);
        p += n * relief.w * height;
        n = normalize(n - (slope - n * dot(slope, n)));
    }
    let w = o.model * vec4<f32>(p, 1.0);
    v.world = w.xyz;
    v.normal = (o.model * vec4<f32>(n, 0.0)).xyz;
    v.rest = rest;
    v.raw = f32(min(raw, 1u));
    v.open = open;
    v.clip = g.view_proj * w;
    return v;
}

// A frame around the round field, before everything: in pieces of a ring from just outside the field to beyond the corners.
const FRAME_PIECES: u32 = 32u;
@vertex
fn frame(@builtin(vertex_index) i: u32) -> @builtin(position) vec4<f32> {
    let corner = i % 6u;
    let angle = 6.2831853 * f32(i / 6u + select(0u, 1u, corner == 1u || corner == 2u || corner == 4u)) / f32(FRAME_PIECES);
    let radius = select(1.03, 1.6, corner == 2u || corner >= 4u);
    return vec4<f32>(radius * cos(angle), radius * sin(angle), 0.0, 1.0);
}

// The lines of a mesh, for developers: of the half that is shown.
@fragment
fn line(in: Varying) -> @location(0) vec4<f32> {
    if any(g.clip.xyz != vec3<f32>(0.0)) && o.extra.x < 0.5 && dot(g.clip.xyz, in.world) > g.clip.w { discard; }
    return vec4<f32>(0.01, 0.03, 0.06, 0.6);
}

@fragment
fn nothing() -> @location(0) vec4<f32> { return vec4<f32>(0.0); }

// Share of the lamp's light that nothing stands in the way of, 0 to 1; the fibres are as wide as a millimetre, so that an edge is soft.
const SOFT: f32 = 0.006;
fn unshaded(world: vec3<f32>) -> f32 {
    if g.cone.w <= 0.0 { return 1.0; }
    let q = g.lamp * vec4<f32>(world, 1.0);
    if q.w <= 0.0 { return 1.0; }
    let at = q.xy / q.w * vec2<f32>(0.5, -0.5) + vec2<f32>(0.5);
    let depth = q.z / q.w - 2.0e-4;
    var sum = 0.0;
    for (var k = 0; k < 4; k++) {
        let aside = vec2<f32>(f32(k % 2) - 0.5, f32(k / 2) - 0.5) * SOFT;
        sum += textureSampleCompareLevel(shadow, compared, at + aside, depth);
    }
    return 0.25 * sum;
}

// Light that would reach a point: inverse square (softened within 5 mm of the fibres), cone.
fn spot(to_light: vec3<f32>, distance: f32) -> f32 {
    let cone = smoothstep(g.light_axis.w, g.cone.x, -dot(to_light, g.light_axis.xyz));
    return g.light.w * cone * 1.0e-4 / (distance * distance + 2.5e-5);
}

// What a mirror at a point shows in one direction: the wall across a cavity, lit by the lamp with its fall-off, or outside a room.
const ACROSS_M: f32 = 0.015;    // how far off that wall is, m: less than half of a cavity's width of 4 cm
const ACROSS: vec3<f32> = vec3<f32>(0.75, 0.34, 0.30);  // its colour, linear
const ROOM: vec3<f32> = vec3<f32>(0.85, 0.88, 0.95);    // the room's, linear
const ACROSS_DARK: f32 = 0.04;  // light on it that the lamp does not give: what a cavity mirrors to and fro
const ACROSS_MOST: f32 = 1.5;   // most light on it
const ROOM_LIT: f32 = 0.13;     // light in the room, of that which the lamp outside gives at its target
fn across(at: vec3<f32>, way: vec3<f32>) -> vec3<f32> {
    if OUTSIDE { return ROOM * ROOM_LIT; }
    let to_light = g.light.xyz - (at + way * ACROSS_M);
    let distance = length(to_light);
    let l = to_light / max(distance, 1.0e-6);
    let lit = spot(l, distance) * max(-dot(way, l), 0.0) + ACROSS_DARK * g.cone.y;
    return ACROSS * min(lit, ACROSS_MOST);
}

fn lobe(n_dot_h: f32, power: f32) -> f32 {
    return (power + 8.0) * 0.04 * pow(max(n_dot_h, 0.0), power);
}

// How much of a point is the mouth of a tube, how much the dimple about it, which is redder than the wall, and which way that falls: a slit with a ragged edge.
// How it lies, how long it is and which way it bends goes by its place: no two are alike.
struct Mouth { pit: f32, rim: f32, fall: vec3<f32> };
const MOUTH_REACH: f32 = 3.4;   // radii to which the dimple about one goes
fn mouth_of_tube(rest: vec3<f32>, ragged: f32) -> Mouth {
    var found = Mouth(0.0, 0.0, vec3<f32>(0.0));
    for (var k = 0; k < 2; k++) {
        let mouth = o.mouths[k];
        if mouth.w <= 0.0 { continue; }
        let away = (rest - mouth.xyz) / mouth.w;
        let far = length(away);
        if far > 1.3 * MOUTH_REACH { continue; }
        let own = fract(mouth.xyz * vec3<f32>(700.0, 900.0, 1100.0));
        // The tubes leave to the sides: a slit lies in the plane across.
        let turn = 2.4 * own.x - 1.2;
        let along = vec3<f32>(0.0, sin(turn), cos(turn));
        let aside = vec3<f32>(0.0, along.z, -along.y);
        let run = dot(away, along);
        let off = dot(away, aside) + (0.9 * own.y - 0.45) * run * run;
        let narrow = vec3<f32>(1.0, mix(0.40, 0.80, own.z), 1.6) * vec3<f32>(away.x, run, off);
        let edge = 1.0 + 0.20 * ragged;
        let pit = 1.0 - smoothstep(0.25, 1.10, length(narrow) * edge);
        let d = far * edge;
        let rim = 1.0 - smoothstep(0.6, MOUTH_REACH, d);
        let fall = smoothstep(0.3, 1.2, d) * (1.0 - smoothstep(1.6, MOUTH_REACH, d));
        found = Mouth(max(found.pit, pit), max(found.rim, rim), found.fall - away / max(far, 1.0e-3) * fall);
    }
    return found;
}

// How much of a point contact coagulation has cooked: spots whose ragged edges fade.
fn blanched(rest: vec3<f32>, ragged: f32) -> f32 {
    var found = 0.0;
    for (var k = 0; k < 64; k++) {
        let mark = o.spots[k];
        if mark.w <= 0.0 { break; }
        let d = distance(rest, mark.xyz) / mark.w * (1.0 + 0.3 * ragged);
        found = max(found, 1.0 - smoothstep(0.20, 1.15, d));
    }
    return found;
}

// Where the wire has laid tissue open: what colour that adds, how much of the skin's is left, and how its strands tilt it.
struct Wound { colour: vec3<f32>, skin: f32, slope: vec3<f32> };
// Strands in a metre of the rest position along each axis, one in 0.96 mm, and those that lie across them: in the wall they run in bundles that cross.
const BUNDLES: vec3<f32> = vec3<f32>(890.0, 310.0, 430.0);
const ACROSS_THEM: vec3<f32> = vec3<f32>(-370.0, 410.0, 870.0);
const WHORL: f32 = 4.2;         // strands of a myoma on the whole of a noise, whose contours are closed curves: they whorl about its nodules
const FIBRES: f32 = 4.3;        // fibres in a strand
const FIBRES_SEEN_M: vec2<f32> = vec2<f32>(5.0e-5, 1.4e-4); // pixels so fine show each of them, pixels so coarse none
const TILT: f32 = 3.2e-3;       // how much a strand tilts what is laid open, for each of it in a metre
fn wave(at: f32) -> f32 {
    let near = 2.0 * abs(fract(at) - 0.5);
    return near * near * (3.0 - 2.0 * near);
}
// `cut` is 1 on a wound and falls to 0 within the edge of a triangle about it; `a`, `fine` and `height` are of the noise there.
fn wound(rest: vec3<f32>, cut: f32, a: vec4<f32>, fine: vec4<f32>, height: f32, grain: f32) -> Wound {
    let myoma = o.shape.w;
    let run = select(BUNDLES, ACROSS_THEM, a.w + 0.30 * fine.w + 0.20 > 0.0) * (1.0 - myoma);
    let at = dot(rest, run) + 0.57 * a.x + 0.25 * a.z + (0.13 + 0.12 * myoma) * fine.w + WHORL * myoma * a.y;
    let seen = 0.35 * (1.0 - smoothstep(FIBRES_SEEN_M.x, FIBRES_SEEN_M.y, grain));
    let strand = mix(wave(at), wave(FIBRES * at + 0.32 * fine.x), seen);
    // paler in a myoma, with a blush of blood, a film of coagulum and the stumps of vessels that ooze
    let furrow = mix(vec3<f32>(0.54, 0.19, 0.15), vec3<f32>(0.68, 0.43, 0.36), myoma);
    let ridge = mix(vec3<f32>(0.80, 0.49, 0.42), vec3<f32>(0.86, 0.70, 0.62), myoma);
    var flesh = mix(furrow, ridge, strand);
    flesh = mix(flesh, vec3<f32>(0.58, 0.15, 0.125), (0.50 + 0.25 * o.extra.x - 0.55 * myoma) * smoothstep(-0.20, 0.70, a.z));
    flesh = mix(flesh, vec3<f32>(0.72, 0.53, 0.37), (0.35 - 0.20 * o.extra.x) * smoothstep(0.10, 0.60, height));
    flesh = mix(flesh, vec3<f32>(0.44, 0.04, 0.04), (0.65 - 0.35 * myoma) * smoothstep(0.40, 0.85, fine.z));
    // Where the wound begins the wire has blanched the lining and scorched its edge; noise frays that, which lies along the mesh.
    let raw = smoothstep(0.30, 0.70, cut + 0.22 * fine.w);
    let heated = 0.30 * smoothstep(0.02, 0.30, cut * (1.0 + 0.5 * fine.w)) * (1.0 - smoothstep(0.62, 0.98, cut + 0.12 * fine.x));
    let seam = 4.0 * raw * (1.0 - raw);
    let charred = 0.80 * seam * seam * smoothstep(-0.30, 0.30, a.z + 0.5 * fine.z + 0.25);
    let colour = mix(mix(flesh * raw, vec3<f32>(0.82, 0.57, 0.46), heated), vec3<f32>(0.21, 0.12, 0.075), charred);
    let aside = fract(at) - 0.5;
    return Wound(colour, (1.0 - raw) * (1.0 - heated) * (1.0 - charred), run * (TILT * cut * aside * (1.0 - 2.0 * abs(aside))));
}

// How much a wet film in saline mirrors (refractive indices 1.40 and 1.33, Fresnel): of what falls squarely upon it hardly anything, and of what grazes it
// this part times the eighth power of one less the cosine: 0.12 at 80 degrees, 0.02 at 70, as the formulas have it.
const FILM_SQUARE: f32 = 0.0007;
const FILM_GLANCE: f32 = 0.55;

// What is left of the light where surfaces leave no room for any to come from the sides: most of it has gone through tissue on its way, and is red.
const CLOSED: vec3<f32> = vec3<f32>(0.40, 0.22, 0.20);

// `full` is the light that would reach it, `e` what of it does.
// `grain` is how much of the rest position a pixel covers, m: what is finer is looked up as its mean, or a wall far off would be of sand.
fn tissue(in: Varying, n0: vec3<f32>, v: vec3<f32>, l: vec3<f32>, full: f32, e: f32, grain: f32) -> vec3<f32> {
    let p = in.rest * o.surface.y;
    let level = log2(max(grain * o.surface.y * 64.0, 1.0e-3));
    let a = textureSampleLevel(noise, tiled, p, max(level, 0.0));
    let warped = p + a.wzx * 0.035;
    // Each is by so much finer: log2 of 6.5 and of 3.7.
    let level_fine = level + 2.7;
    let fine = textureSampleLevel(noise, tiled, warped * 6.5, max(level_fine, 0.0));
    let b1 = textureSampleLevel(bump, tiled, warped, max(level, 0.0));
    let b2 = textureSampleLevel(bump, tiled, warped * 3.7, max(level + 1.9, 0.0));
    let laid_open = wound(in.rest, in.raw, a, fine, b1.w, grain);
    let slope = b1.xyz * 0.34 + b2.xyz * 0.26 + laid_open.slope;
    var uneven = o.surface.w;
    if NO_BUMP { uneven = 0.0; }
    var n = normalize(n0 - (slope - n0 * dot(slope, n0)) * uneven);
    let tube = mouth_of_tube(in.rest, fine.w);
    n = normalize(n + 0.8 * tube.fall);

    // colour: a velvet between cream and orange-red, the mouths of glands as pale dots, a few vessels and the net of the finest ones between
    let patchy = smoothstep(-0.55, 0.65, a.z + 0.25 * fine.x);
    var albedo = o.colour.rgb * mix(vec3<f32>(0.98, 0.80, 0.74), vec3<f32>(1.04, 1.16, 1.12), patchy);
    albedo *= 1.0 + 0.13 * vec3<f32>(0.4, 1.0, 1.0) * (b1.w + 0.7 * b2.w);
    let spread = smoothstep(-0.25, 0.35, a.y);
    // What is a line near by is a share of each pixel far off: the mean of a field is no vessel, though it is as near to zero.
    let blurred = smoothstep(0.8, 3.0, level);
    let blurred_fine = smoothstep(0.8, 3.0, level_fine);
    let arcade = min(abs(a.x), mix(1.0, 1.6 * abs(a.z + 0.1), o.shape.w));
    let trunk = mix(1.0 - smoothstep(0.006, 0.030 + (0.03 + 0.03 * o.shape.w) * max(fine.z + 0.3 * o.shape.w, 0.0), arcade), 0.06, blurred);
    let net = mix(1.0 - smoothstep(0.01, 0.13, abs(fine.y)), 0.20, blurred_fine);
    var vessel = clamp((0.55 * trunk * smoothstep(-0.30, 0.25, a.w) + 0.40 * net * spread) * o.surface.z, 0.0, 1.0);
    if NO_VESSELS { vessel = 0.0; }
    albedo = mix(albedo, vec3<f32>(0.46, 0.065, 0.055) * (0.6 + 0.4 * o.colour.r), vessel * (1.0 - in.raw));
    let mouth = smoothstep(0.58, 0.84, fine.w) * (1.0 - 0.5 * spread) * o.extra.w;
    albedo = mix(albedo, vec3<f32>(0.93, 0.64, 0.53), 0.50 * mouth * (1.0 - in.raw));
    albedo = mix(albedo, vec3<f32>(0.42, 0.10, 0.085), 0.60 * tube.rim * (1.0 - in.raw));
    let depth = mix(vec3<f32>(0.20, 0.03, 0.025), vec3<f32>(0.09, 0.013, 0.011), tube.pit * tube.pit);
    albedo = mix(albedo, depth, smoothstep(0.0, 0.7, tube.pit) * (1.0 - in.raw));
    albedo = albedo * laid_open.skin + laid_open.colour;
    // contact coagulation: the lining blanches, within that the protein turns white, and in the middle, where it was hottest, there are crumbs of char
    let white = blanched(in.rest, fine.w + 0.9 * b1.w);
    albedo = mix(albedo, vec3<f32>(0.85, 0.58, 0.49), 0.80 * smoothstep(0.0, 0.50, white));
    albedo = mix(albedo, vec3<f32>(0.86, 0.74, 0.62) * (1.0 + 0.10 * b1.w), 0.92 * smoothstep(0.35, 0.75, white));
    albedo = mix(albedo, vec3<f32>(0.28, 0.18, 0.115), 0.75 * smoothstep(0.72, 1.0, white) * smoothstep(-0.15, 0.25, fine.z));

    // light: soft wrap (light travels in the tissue, red the furthest), then the light the cavity gives itself
    let nl = dot(n, l);
    var around = vec3<f32>(0.42, 0.18, 0.14);
    if NO_SOFT { around = vec3<f32>(0.0); }
    let soft = max(vec3<f32>(nl) + around, vec3<f32>(0.0)) / (vec3<f32>(1.0) + around);
    let mutual = albedo * albedo * (0.26 + 0.14 * n.y) * g.cone.y;
    var c = albedo * soft * (0.30 + 0.70 * soft) * e + mutual * (0.18 + 0.82 * min(full, 1.0));
    // A growth is thin at its limb: light that went in beside comes out there, red.
    let limb = 1.0 - max(dot(n0, v), 0.0);
    if !NO_SOFT { c += albedo * vec3<f32>(0.20, 0.05, 0.035) * (o.extra.x * limb * limb * min(e, 1.0) * (1.0 - in.raw)); }
    c *= mix(CLOSED, vec3<f32>(1.0), in.open);
    // wet film: a narrow and a broad lobe, and Fresnel towards the rim
    // Far off a pixel holds many ripples, whose glints are one broad shine and no grains of salt.
    let calm = smoothstep(0.006, 0.024, distance(in.world, g.eye.xyz));
    let ripple = (slope * 1.1 + fine.xyz * 0.60 - a.yzw * 0.30) * (1.0 - 0.65 * calm);
    let film_n = normalize(n0 - (ripple - n0 * dot(ripple, n0)) * uneven);
    let h = normalize(l + v);
    let nh = max(dot(film_n, h), 0.0);
    let nv = max(dot(n, v), 0.0);
    var wet = (1.0 - o.surface.x) * (1.0 - 0.6 * white) * (1.0 - 0.5 * in.raw) * (1.0 - 0.9 * tube.pit) * in.open;
    if NO_WET { wet = 0.0; }
    // In saline a wet wall mirrors a fortieth of what it does in air (n = 1.40 and 1.33): a few small glints near the lens.
    let film = (0.052 * lobe(nh, mix(260.0, 60.0, calm)) + 0.018 * lobe(nh, 30.0)) * (1.0 - 0.8 * calm) * wet * smoothstep(-0.05, 0.2, nl);
    // folds catch the light at a glance too: the film pools, so its slope lies between the wall's and the ripple's
    let glance = 1.0 - nv;
    let pooled = pow(max(dot(film_n, normalize(h + n0 * 0.8)), 0.0), 120.0) * smoothstep(0.0, 0.5, b2.w) * glance * 0.3 * wet;
    c += vec3<f32>(1.0, 0.96, 0.93) * (film * e + pooled * min(e, 1.0));
    // beside the lamp's own image it mirrors the walls about it: in a canal and on the flank of a fold one sees that it is wet
    let steep = glance * glance * glance * glance;
    return c + across(in.world, reflect(-v, film_n)) * ((FILM_SQUARE + FILM_GLANCE * steep * steep) * wet);
}

// Brushed steel in a pink room: no diffuse light to speak of, a bright band where the room's light part mirrors. With current in it a wire glows
// in the orange of sodium, as it does in saline.
const CRUST_PER_M: f32 = 300.0; // tiles of the noise in a metre: clumps of 0.3 to 0.7 mm
fn metal(in: Varying, n: vec3<f32>, v: vec3<f32>, l: vec3<f32>, e: f32) -> vec3<f32> {
    let r = reflect(-v, n);
    let band = 0.30 + 0.70 * smoothstep(-0.25, 0.35, r.y) * (1.0 - 0.55 * smoothstep(0.45, 0.9, r.y));
    let room = mix(ACROSS, ROOM, f32(OUTSIDE));
    let h = normalize(l + v);
    let sharp = 1.0 - o.surface.x;
    let glint = lobe(dot(n, h), mix(12.0, 160.0, sharp)) * 0.12;
    let fresnel = 0.65 + 0.35 * pow(1.0 - max(dot(n, v), 0.0), 5.0);
    let lit = min(e, 1.5);
    let facing = max(dot(n, l), 0.0);
    let steel = o.colour.rgb * (room * band * fresnel * (0.10 + 0.24 * lit) * (1.0 + f32(OUTSIDE)) + facing * facing * 0.10 * lit) + vec3<f32>(glint * lit);
    // what burns on a wire that has cut: clumps of brown and black that shine no more
    let crust = textureSampleLevel(noise, tiled, in.rest * CRUST_PER_M, 0.0);
    let crusted = smoothstep(0.0, 0.30, 0.5 + 0.5 * crust.w - (1.0 - 0.9 * o.extra.y));
    let burnt = mix(vec3<f32>(0.035, 0.022, 0.016), vec3<f32>(0.26, 0.155, 0.085), smoothstep(-0.2, 0.7, crust.y));
    // Where there are none the current finds its way.
    return mix(steel, burnt * ((0.25 + 0.75 * facing) * lit), crusted) + vec3<f32>(1.8, 0.62, 0.10) * (o.extra.z * (1.0 - 0.65 * crusted));
}

// A bubble of gas in saline: its colour, and how much of what lies behind it that covers. Its middle is clear. Farther out what is behind is seen bent aside,
// and beyond the critical angle, at three quarters of its radius, its skin mirrors all of what lies to the sides (Fresnel, unpolarised). That is darker than
// what lies ahead: a dark ring. The lamp shows twice, on the skin before and, turned about, on the one behind.
const GAS_RATIO: f32 = 0.752;                                 // refractive index of gas over saline's, 1.00 and 1.33
const GAS_BENT: vec2<f32> = vec2<f32>(0.30, 0.70);            // from where to where, in shares of its radius, the view straight through gives way to the bent one
const GAS_RING: vec4<f32> = vec4<f32>(0.62, 0.74, 0.84, 0.98); // where in its radius the ring begins, is darkest from and to, and ends
const GAS_DARK: f32 = 0.45;                                   // share of the light that the ring lacks beside what the cavity's shape takes from it
const GAS_FILL: f32 = 0.04;                                   // light from the sides that the lamp does not give, beside that of a wall
const GAS_EDGE: f32 = 0.93;                                   // from here to the edge it fades, or that would be drawn in steps
const GAS_GLINTS: vec2<f32> = vec2<f32>(0.35, 0.12);          // strength of the lamp's two images
const GAS_SHARP: f32 = 220.0;                                 // their sharpness, as a lobe's power
// Which way the skin of a ball of radius 1 looks where a ray towards `v` leaves it that goes through a place of the facets about it; beside the ball square to
// the ray, where nothing is drawn.
fn of_ball(place: vec3<f32>, v: vec3<f32>) -> vec3<f32> {
    let aside = place - v * dot(place, v);
    return normalize(aside + v * sqrt(max(1.0 - dot(aside, aside), 0.0)));
}
fn gas(in: Varying, n: vec3<f32>, v: vec3<f32>, l: vec3<f32>, e: f32) -> vec4<f32> {
    let facing = max(dot(n, v), 1.0e-3);
    let off = sqrt(max(1.0 - facing * facing, 0.0));
    let within = sqrt(max(1.0 - off * off / (GAS_RATIO * GAS_RATIO), 0.0));
    let across_plane = (facing - GAS_RATIO * within) / (facing + GAS_RATIO * within);
    let in_plane = (GAS_RATIO * facing - within) / (GAS_RATIO * facing + within);
    let mirrored = 0.5 * (across_plane * across_plane + in_plane * in_plane);
    let bent = (1.0 - mirrored) * smoothstep(GAS_BENT.x, GAS_BENT.y, off);
    // through the skin, across, and out of it on the other side
    let inner = refract(-v, n, 1.0 / GAS_RATIO);
    let far_n = n - 2.0 * dot(n, inner) * inner;
    let outer = refract(inner, -far_n, GAS_RATIO);
    let ring = smoothstep(GAS_RING.x, GAS_RING.y, off) * (1.0 - smoothstep(GAS_RING.z, GAS_RING.w, off));
    let fading = 1.0 - smoothstep(GAS_EDGE, 1.0, off);
    let fill = ACROSS * (GAS_FILL * g.cone.y);
    let from_sides = mirrored * (across(in.world, reflect(-v, n)) + fill) + bent * (across(in.world, outer) + fill);
    let shown = from_sides * ((1.0 - GAS_DARK * ring) * fading);
    let h = normalize(l + v);
    let glints = GAS_GLINTS.x * lobe(dot(n, h), GAS_SHARP) + GAS_GLINTS.y * lobe(dot(2.0 * facing * v - n, h), GAS_SHARP);
    let glint = glints * min(e, 1.5);
    let cover = max((mirrored + bent) * fading, min(glint, 1.0));
    return vec4<f32>((shown + o.colour.rgb * glint) / max(cover, 1.0e-3), cover);
}

// Blood between the lens and a point: what each colour loses along the ray, and the light that it scatters back. A cell of the flow is wider than the
// threads that blood draws in saline: where its density changes, and only there, it is looked up a little aside, so that its edge frays. How far aside
// is looked up once for some steps: what counts is how many looks into a solid there are, twelve in all.
const MURK_LOOKS: i32 = 2;      // into the noise
const MURK_STEPS: i32 = 5;      // into the density for each of them
const MURK_JITTER: f32 = 0.35;  // share of a step by which neighbouring pixels differ: more shows as a net where blood is thin
const MURK_LIGHT: f32 = 0.8;    // most light on it: close before the lens its distance says too much, for the lamp is beside it
const FRAY_M: f32 = 0.0022;     // how far aside at most
const FRAYS: f32 = 45.0;        // tiles of the noise in a metre: threads of some 2 to 5 mm
fn murk(c: vec3<f32>, world: vec3<f32>, pixel: vec2<f32>) -> vec3<f32> {
    let ray = world - g.eye.xyz;
    // Only the part of the ray that goes through the box in which there is blood.
    let safe = select(ray, vec3<f32>(1.0e-9), abs(ray) < vec3<f32>(1.0e-9));
    let a = (g.blood_min.xyz - FRAY_M - g.eye.xyz) / safe;
    let b = (g.blood_max.xyz + FRAY_M - g.eye.xyz) / safe;
    let low = min(a, b);
    let high = max(a, b);
    var near = max(max(low.x, low.y), max(low.z, 0.0));
    var far = min(min(high.x, high.y), min(high.z, 1.0));
    if OUTSIDE {
        // Nor is there any in the half that is cut away. No branch hangs on uniforms alone: `post.wgsl` says why.
        let across_cut = dot(g.clip.xyz, ray);
        let way = select(across_cut, 1.0e-9, abs(across_cut) < 1.0e-9);
        let at_cut = (g.clip.w - dot(g.clip.xyz, g.eye.xyz)) / way;
        let is_cut = any(g.clip.xyz != vec3<f32>(0.0));
        near = select(near, max(near, at_cut), is_cut & (way < 0.0));
        far = select(far, min(far, at_cut), is_cut & (way > 0.0));
    }
    if near >= far { return c; }
    let size = g.fluid_max.xyz - g.fluid_min.xyz;
    // Interleaved gradient noise (Jimenez 2014): neighbours differ as evenly as can be, and no lattice shows.
    let jitter = fract(52.9829189 * fract(dot(pixel, vec2<f32>(0.06711056, 0.00583715))));
    let first = 0.5 + MURK_JITTER * (jitter - 0.5);
    let step_m = length(ray) * (far - near) / f32(MURK_LOOKS * MURK_STEPS);
    var column_m = 0.0;            // as long as the blood so far would be undiluted
    var through = vec3<f32>(1.0);  // share of the light that comes so far and back: the lamp is beside the lens
    var glow = vec3<f32>(0.0);
    for (var look = 0; look < MURK_LOOKS; look++) {
        let amid = g.eye.xyz + ray * mix(near, far, (f32(look) + 0.5) / f32(MURK_LOOKS));
        let aside = textureSampleLevel(noise, tiled, amid * FRAYS, 0.0).xzw * FRAY_M;
        for (var part = 0; part < MURK_STEPS; part++) {
            let at = g.eye.xyz + ray * mix(near, far, (f32(look * MURK_STEPS + part) + first) / f32(MURK_LOOKS * MURK_STEPS));
            let u = (at + aside - g.fluid_min.xyz) / size;
            let is_inside = all(u >= vec3<f32>(0.0)) && all(u <= vec3<f32>(1.0));
            column_m += step_m * select(0.0, max(textureSampleLevel(fluid, clamped, u, 0.0).x, 0.0), is_inside);
            let left = exp(-column_m * g.murk.rgb);
            let to = g.light.xyz - at;
            glow += (through - left) * min(g.light.w * 1.0e-4 / (dot(to, to) + 2.5e-5), MURK_LIGHT);
            through = left;
        }
    }
    return c * through + g.blood.rgb * glow;
}

@fragment
fn fragment(in: Varying, @builtin(front_facing) front: bool) -> @location(0) vec4<f32> {
    // How much of the rest position a pixel covers: the mean of both ways, for the wall at a glance is to keep its lines. Before any discards.
    let grain = sqrt(max(length(dpdx(in.rest)) * length(dpdy(in.rest)), 1.0e-16));
    let cut = OUTSIDE && any(g.clip.xyz != vec3<f32>(0.0));
    if cut && o.extra.x < 0.5 && dot(g.clip.xyz, in.world) > g.clip.w { discard; }
    let to_eye = g.eye.xyz - in.world;
    let v = normalize(to_eye);
    var n = normalize(in.normal);
    if GAS { n = of_ball(in.rest, v); }
    if dot(n, v) < 0.0 && !(cut && !METAL && !GAS) { n = -n; }
    let to_light = g.light.xyz - in.world;
    let distance = length(to_light);
    let l = to_light / max(distance, 1.0e-6);
    var e = spot(l, distance);
    if o.shape.z > 0.0 { e = min(e, o.shape.z); }
    var c: vec3<f32>;
    var cover = o.colour.a;
    if GAS {
        let bubble = gas(in, n, v, l, e);
        c = bubble.rgb;
        cover = bubble.a;
    } else if METAL {
        c = metal(in, n, v, l, e);
    } else if cut && !front && o.extra.x < 0.5 {
        // the inside of a wall that was cut open reads as its section: flat, matte
        let speck = textureSampleLevel(noise, tiled, in.rest * 70.0, 0.0);
        c = o.colour.rgb * vec3<f32>(0.62, 0.40, 0.40) * min(0.55 * e, 0.8) * (1.0 + 0.25 * speck.z + 0.15 * speck.x);
    } else {
        // Where the light grazes, a texel of the map is looked for off the surface, so that nothing shades itself.
        let off = n * (1.5 * g.cone.w * distance * (1.0 - max(dot(n, l), 0.0)));
        c = tissue(in, n, v, l, e, e * unshaded(in.world + off), grain);
    }
    if FLUID { c = murk(c, in.world, in.clip.xy); }
    // Through the lens everything but gas is opaque, and alpha is the nearest distance over this one, by which the focus blurs; 0 is where nothing is. Gas
    // leaves there what it finds: what is seen through it is as sharp as without it.
    return vec4<f32>(min(c, vec3<f32>(60.0)), select(in.clip.w * g.cone.z, cover, OUTSIDE || GAS));
}
