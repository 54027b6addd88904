//! What of a state names the mesh: the shape at rest, the tets and whose they are, the surface for the eye. It changes when something is cut, and so
//! it is part of the state: whoever holds a state makes his model of it, and goes on where the cut was.
//!
//! Promise: a body that is unpacked has indices in range, finite numbers and tets with a volume, whatever the words were; equal bodies have equal
//! words, equal words the same version.

mod order;
mod parts;

use hyst_mesh::{Binding, TetMesh, are_below, are_finite, signed_volume};
use hyst_messages::fnv_words;
use hyst_tissue::Skin;

pub use order::in_order;
pub use parts::Piece;

/// What there is room for: a state has a greatest size, said before the first one is written.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Room {
    /// Nodes.
    pub nodes: usize,
    /// Tets.
    pub tets: usize,
    /// Vertices of the surface for the eye.
    pub vertices: usize,
    /// Its triangles.
    pub triangles: usize,
    /// Objects of tissue.
    pub objects: usize,
    /// Regions of material that the scene has, of which there come no more.
    pub regions: usize,
    /// Numbers of what is there from the beginning, which nothing else gets: those below this.
    pub named: usize,
    /// Objects of the scene, of which every other one is a part that came off.
    pub of_scene: usize,
}

impl Room {
    /// Half as much again as the scene has, and what it takes to slice half of a myoma from a coarse mesh, the chips not rinsed out yet.
    pub fn for_body(body: &Body, objects: usize, regions: usize) -> Room {
        let more = |count: usize, least: usize| count + (count / 2).max(least);
        Room {
            nodes: more(body.rest.positions_m.len(), 4_608),
            tets: more(body.rest.tets.len(), 8_192),
            vertices: more(body.skin.rest_m.len(), 6_144),
            triangles: more(body.skin.triangles.len(), 8_192),
            objects,
            regions,
            named: body.origin.len(),
            of_scene: body.origin.len(),
        }
    }

    /// Words of the greatest body.
    pub fn words(&self) -> usize {
        words_of(&[self.nodes, self.tets, self.vertices, self.triangles, self.objects])
    }
}

/// Counts at the beginning of the words.
pub(crate) const COUNTS: usize = 5;

fn words_of(&[nodes, tets, vertices, triangles, objects]: &[usize; COUNTS]) -> usize {
    COUNTS + 4 * nodes + 5 * tets + 8 * vertices + bits_of(vertices) + 3 * triangles + objects
}

/// Bits of a tet's word that name its object; those above name what it is made of.
const OBJECT_BITS: u32 = 16;

/// Words of so many flags.
fn bits_of(flags: usize) -> usize {
    flags.div_ceil(u32::BITS as usize)
}

fn word_of_flags(flags: &[bool]) -> u32 {
    flags.iter().enumerate().fold(0, |word, (place, flag)| word | u32::from(*flag) << place)
}

/// So many flags of words; `None` if there are others beyond them.
fn flags_of_words(words: &[u32], count: usize) -> Option<Vec<bool>> {
    let flags: Vec<bool> = words.iter().flat_map(|word| (0..u32::BITS).map(move |place| word >> place & 1 == 1)).collect();
    let (own, others) = flags.split_at_checked(count)?;
    (!others.contains(&true)).then(|| own.to_vec())
}

/// All objects of tissue as one mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Body {
    /// The shape at rest; the region of a tet is its object.
    pub rest: TetMesh,
    /// What each tet is made of: 0 for what its object is, else one of the scene's regions of material, counted from 1. Empty where the scene has none.
    pub material: Vec<u32>,
    /// Whether a node is held.
    pub fixed: Vec<bool>,
    /// The surface for the eye: vertices and triangles of an object lie together, in the order of the objects.
    pub skin: Skin,
    /// For each object the one of the scene that it is, or was a part of.
    pub origin: Vec<u32>,
}

impl Body {
    /// Nodes, tets, vertices and triangles of a surface, objects.
    fn counts(&self, skin: &Skin) -> [usize; COUNTS] {
        let rest = &self.rest;
        [rest.positions_m.len(), rest.tets.len(), skin.rest_m.len(), skin.triangles.len(), self.origin.len()]
    }

    /// With its own surface for the eye.
    #[cfg(test)]
    pub fn pack(&self) -> Vec<u32> {
        self.pack_under(&self.skin)
    }

    /// As words, which are what a state carries, with this surface for the eye.
    pub fn pack_under(&self, skin: &Skin) -> Vec<u32> {
        let counts = self.counts(skin);
        let mut words = Vec::with_capacity(words_of(&counts));
        words.extend(counts.map(|count| count as u32));
        words.extend_from_slice(bytemuck::cast_slice(&self.rest.positions_m));
        words.extend(self.fixed.iter().map(|fixed| u32::from(*fixed)));
        words.extend_from_slice(self.rest.tets.as_flattened());
        if self.material.is_empty() {
            words.extend_from_slice(&self.rest.regions);
        } else {
            let kinds = self.rest.regions.iter().zip(&self.material);
            words.extend(kinds.map(|(object, material)| object | material << OBJECT_BITS));
        }
        words.extend_from_slice(bytemuck::cast_slice(&skin.rest_m));
        words.extend_from_slice(bytemuck::cast_slice(&skin.bindings));
        words.extend(skin.raw.chunks(u32::BITS as usize).map(word_of_flags));
        words.extend_from_slice(skin.triangles.as_flattened());
        words.extend_from_slice(&self.origin);
        words
    }

    /// From words of another process; `None` if they are no body, or one that there is no room for.
    pub fn unpack(words: &[u32], room: &Room) -> Option<Body> {
        let (counts, mut rest) = words.split_at_checked(COUNTS)?;
        let counts: [usize; COUNTS] = std::array::from_fn(|index| counts[index] as usize);
        if words.len() != words_of(&counts) {
            return None;
        }
        let [nodes, tets, vertices, triangles, objects] = counts;
        let mut take = |count: usize| {
            let (part, left) = rest.split_at(count);
            rest = left;
            part
        };
        let positions_m: &[[f32; 3]] = bytemuck::cast_slice(take(3 * nodes));
        let fixed = take(nodes).iter().map(|word| *word != 0).collect();
        let corners: &[[u32; 4]] = bytemuck::cast_slice(take(4 * tets));
        let kinds = take(tets);
        let regions = kinds.iter().map(|kind| kind & ((1 << OBJECT_BITS) - 1)).collect();
        let material = kinds.iter().map(|kind| kind >> OBJECT_BITS).collect();
        let skin_m: &[[f32; 3]] = bytemuck::cast_slice(take(3 * vertices));
        let bindings: &[Binding] = bytemuck::cast_slice(take(5 * vertices));
        let raw = flags_of_words(take(bits_of(vertices)), vertices)?;
        let faces: &[[u32; 3]] = bytemuck::cast_slice(take(3 * triangles));
        let mut body = Body {
            rest: TetMesh { positions_m: positions_m.to_vec(), tets: corners.to_vec(), regions },
            material,
            fixed,
            skin: Skin { rest_m: skin_m.to_vec(), triangles: faces.to_vec(), bindings: bindings.to_vec(), raw },
            origin: take(objects).to_vec(),
        };
        if !body.is_sound(room) {
            return None;
        }
        if room.regions == 0 {
            body.material.clear();
        }
        Some(body)
    }

    /// Whether everybody takes it who is sent its words: it has nothing that a cut or a model refuses, nor what a bit that flips in a place or a name can make
    /// of a tet.
    pub fn is_sound(&self, room: &Room) -> bool {
        self.fits(room) && self.rest.tets.iter().all(|tet| self.volume_m3(*tet) > 0.0)
    }

    /// The same but for the volume of its tets: whether there is room for it, its lists fit each other, indices are in range and numbers finite, and no tet has
    /// a node twice.
    pub fn fits(&self, room: &Room) -> bool {
        let Body { rest, material, fixed, skin, origin } = self;
        let counts @ [nodes, tets, vertices, _, objects] = self.counts(skin);
        let most = [room.nodes, room.tets, room.vertices, room.triangles, room.objects];
        let is_bound = |binding: &Binding| ((binding.tet as usize) < tets) & are_finite(&binding.weights);
        let is_once = |[a, b, c, d]: &[u32; 4]| (a != b) & (a != c) & (a != d) & (b != c) & (b != d) & (c != d);
        counts.iter().zip(most).all(|(count, most)| *count <= most)
            && [fixed.len(), rest.regions.len(), skin.bindings.len(), skin.raw.len()] == [nodes, tets, vertices, vertices]
            && (material.is_empty() || material.len() == tets)
            && are_below(nodes, rest.tets.as_flattened())
            && are_below(objects, &rest.regions)
            && are_below(room.regions + 1, material)
            && are_below(vertices, skin.triangles.as_flattened())
            && are_below(objects.min(room.of_scene), origin)
            && are_finite(rest.positions_m.as_flattened())
            && are_finite(skin.rest_m.as_flattened())
            && skin.bindings.iter().fold(true, |all, binding| all & is_bound(binding))
            && rest.tets.iter().fold(true, |all, tet| all & is_once(tet))
    }

    /// The object of each node, `None` for those that no tet uses.
    pub fn owners(&self) -> Vec<Option<u32>> {
        let mut owner = vec![None; self.rest.positions_m.len()];
        for (tet, object) in self.rest.tets.iter().zip(&self.rest.regions) {
            tet.iter().for_each(|node| owner[*node as usize] = Some(*object));
        }
        owner
    }

    /// The body without an object: its tets and its surface are gone. The object keeps its number until others run out, and the nodes keep
    /// theirs, so that states before and after have the same ones.
    pub fn without(&self, object: u32) -> Body {
        let mut next = 0..;
        let is_kept = |region: &u32| *region != object;
        let number: Vec<Option<u32>> =
            self.rest.regions.iter().map(|region| is_kept(region).then(|| next.next()).flatten()).collect();
        let mut body = self.clone();
        body.skin.without_tets(&number);
        let mut left = number.iter().map(Option::is_some);
        body.rest.tets.retain(|_| left.next().unwrap_or(true));
        body.rest.regions.retain(is_kept);
        let mut left = number.iter().map(Option::is_some);
        body.material.retain(|_| left.next().unwrap_or(true));
        body
    }

    /// Volume of an object at rest, m³.
    pub fn volume_of_m3(&self, object: u32) -> f64 {
        self.volume_where_m3(|region| region == object)
    }

    /// Volume at rest of all objects that are of a kind, m³.
    pub fn volume_where_m3(&self, is_of_kind: impl Fn(u32) -> bool) -> f64 {
        let tets = self.rest.tets.iter().zip(&self.rest.regions).filter(|(_, region)| is_of_kind(**region));
        tets.map(|(tet, _)| self.volume_m3(*tet)).sum()
    }

    /// The sum of what there is for each m³ of the tets of an object.
    pub fn weighed(&self, object: u32, for_each_m3: impl Fn(usize) -> f64) -> f64 {
        let tets = (0..self.rest.tets.len()).filter(|tet| self.rest.regions[*tet] == object);
        tets.map(|tet| for_each_m3(tet) * self.volume_m3(self.rest.tets[tet])).sum()
    }

    /// Volume of a tet at rest, m³.
    pub fn volume_m3(&self, tet: [u32; 4]) -> f64 {
        signed_volume(tet.map(|node| self.rest.positions_m[node as usize].map(f64::from).into()))
    }
}

/// The version of a body's words; never 0.
pub fn version_of(words: &[u32]) -> u32 {
    version_beside(words, || ())
}

/// Words of a version between which there is time for something else.
const BESIDE: usize = 8;

/// The same for who has something to do beside it, a little at a time: each word waits for the one before, and most of the core for that.
pub fn version_beside(words: &[u32], mut beside: impl FnMut()) -> u32 {
    let blocks = words.chunks(BESIDE).flat_map(|block| {
        beside();
        block.iter().map(|word| u64::from(*word))
    });
    let hash = fnv_words(0, blocks);
    ((hash ^ (hash >> 32)) as u32).max(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two tets of object 0 that share a face, one of object 1; a triangle on each object.
    pub(super) fn body() -> Body {
        let corner = |x: f32| [[x, 0.0, 0.0], [x + 1.0, 0.0, 0.0], [x, 1.0, 0.0], [x, 0.0, 1.0]];
        let positions_m = [corner(0.0), corner(5.0)].concat().into_iter().chain([[1.0, 1.0, 1.0]]).collect();
        let rest = TetMesh { positions_m, tets: vec![[0, 1, 2, 3], [1, 2, 3, 8], [4, 5, 6, 7]], regions: vec![0, 0, 1] };
        let bound = |tet: u32| Binding { tet, weights: [1.0, 0.0, 0.0, 0.0] };
        let skin = Skin {
            rest_m: vec![[0.0; 3], [1.0; 3], [2.0; 3], [3.0; 3], [4.0; 3], [5.0; 3]],
            triangles: vec![[0, 1, 2], [3, 4, 5]],
            bindings: [0, 1, 1, 2, 2, 2].map(bound).to_vec(),
            raw: vec![true, false, false, false, true, false],
        };
        Body { rest, material: Vec::new(), fixed: vec![false; 9], skin, origin: vec![0, 1] }
    }

    pub(super) fn room() -> Room {
        Room { nodes: 20, tets: 10, vertices: 20, triangles: 10, objects: 4, regions: 0, named: 2, of_scene: 2 }
    }

    #[test]
    fn what_is_packed_is_unpacked_and_no_other_words_are() {
        let body = body();
        let words = body.pack();
        assert_eq!(Body::unpack(&words, &room()).as_ref(), Some(&body));
        assert!(words.len() <= room().words());
        assert_ne!(version_of(&words), version_of(&words[1..]));
        for length in 0..words.len() {
            assert!(Body::unpack(&words[..length], &room()).is_none(), "{length} words");
        }
        let refused = |index: usize, word: u32| {
            let mut other = words.clone();
            other[index] = word;
            Body::unpack(&other, &room()).is_none()
        };
        let nodes = COUNTS + 4 * 9;
        assert!(refused(0, 8) && refused(4, u32::MAX), "counts");
        assert!(refused(COUNTS, f32::NAN.to_bits()), "a place");
        assert!(refused(nodes, 9), "a tet's node");
        assert!(refused(nodes, 1), "a node twice");
        assert!(refused(nodes, 8), "an inverted tet: node 8 is beyond the face of the other three");
        assert!(refused(COUNTS + 2, 1.0f32.to_bits()), "a flat tet: node 0 lies where node 3 does");
        assert!(refused(nodes + 12, 2), "a tet's object");
        assert!(refused(words.len() - 1, 2), "an object's origin");
        assert!(refused(words.len() - 2 - 6 - 1, 0b111_0001), "a flag of a vertex that is not there");
        assert!(Body::unpack(&words, &Room { nodes: 8, ..room() }).is_none(), "no room");
    }

    #[test]
    fn a_version_is_that_of_all_words_whatever_is_done_beside_it() {
        for length in [0, 1, BESIDE, 5 * BESIDE + 3] {
            let words: Vec<u32> = (1..=length as u32).map(|word| word.wrapping_mul(2_654_435_761)).collect();
            let hash = fnv_words(0, words.iter().map(|word| u64::from(*word)));
            let mut times = 0;
            let version = version_beside(&words, || times += 1);
            assert_eq!((version, times), (((hash ^ (hash >> 32)) as u32).max(1), length.div_ceil(BESIDE)), "{length} words");
            assert_eq!(version_of(&words), version);
        }
    }

    /// A body in which something is spoilt.
    fn spoilt(spoil: impl Fn(&mut Body)) -> Body {
        let mut body = body();
        spoil(&mut body);
        body
    }

    #[test]
    fn a_body_is_sound_where_its_words_are_one_for_others() {
        let bodies = [
            body(),
            spoilt(|body| body.material = vec![0, 1, 2]),
            spoilt(|body| body.origin.push(1)),
            spoilt(|body| body.origin.push(2)),
            spoilt(|body| body.material = vec![0, 4, 1]),
            spoilt(|body| body.rest.regions[2] = 2),
            spoilt(|body| body.rest.tets[2][1] = 9),
            spoilt(|body| body.rest.tets[2][1] = 4),
            spoilt(|body| body.rest.tets[2].swap(0, 1)),
            spoilt(|body| body.rest.positions_m[2][1] = f32::NAN),
            spoilt(|body| body.rest.positions_m[0] = [0.0, 0.0, 1.0]),
            spoilt(|body| body.skin.rest_m[5][2] = f32::INFINITY),
            spoilt(|body| body.skin.bindings[3].tet = 3),
            spoilt(|body| body.skin.bindings[3].weights[3] = f32::NAN),
            spoilt(|body| body.skin.triangles[1][2] = 6),
            spoilt(|body| body.origin[0] = 2),
        ];
        let room = Room { regions: 3, ..room() };
        let is_sound: Vec<bool> = bodies.iter().map(|body| body.is_sound(&room)).collect();
        let is_taken: Vec<bool> = bodies.iter().map(|body| Body::unpack(&body.pack(), &room).is_some()).collect();
        assert_eq!(is_sound, is_taken);
        assert_eq!(is_sound, (0..bodies.len()).map(|place| place < 3).collect::<Vec<bool>>());
        for small in
            [Room { nodes: 8, ..room }, Room { tets: 2, ..room }, Room { vertices: 5, ..room }, Room { triangles: 1, ..room }]
        {
            assert!(!bodies[0].is_sound(&small) && Body::unpack(&bodies[0].pack(), &small).is_none(), "{small:?}");
        }
        assert!(!spoilt(|body| body.fixed.truncate(8)).is_sound(&room), "a node of which nobody says whether it is held");
        assert!(!spoilt(|body| body.skin.raw.truncate(5)).is_sound(&room), "a vertex without a flag");
    }

    #[test]
    fn what_tets_are_made_of_is_in_their_words_and_goes_with_them() {
        let made = Body { material: vec![0, 3, 1], ..body() };
        let (words, room) = (made.pack(), Room { regions: 3, ..room() });
        assert_eq!(words.len(), body().pack().len(), "it takes no word more");
        assert_eq!(Body::unpack(&words, &room).as_ref(), Some(&made));
        assert!(Body::unpack(&words, &Room { regions: 2, ..room }).is_none(), "a region that is not there");
        assert!(Body::unpack(&words, &Room { regions: 0, ..room }).is_none(), "a scene without any");
        let plain = Body { material: vec![0; 3], ..body() };
        assert_eq!(plain.pack(), body().pack(), "a scene without regions has the words that it had");
        assert_eq!(Body::unpack(&plain.pack(), &room), Some(plain));
        assert_eq!((made.without(0).material, made.without(1).material), (vec![1], vec![0, 3]));
    }

    #[test]
    fn what_is_taken_away_leaves_nothing_of_its_own_and_nobody_elses_number_changes() {
        let (whole, body) = (body(), body().without(0));
        assert_eq!((&body.rest.tets[..], &body.rest.regions[..]), (&whole.rest.tets[2..], &[1][..]));
        assert_eq!((&body.rest.positions_m, &body.origin, &body.fixed), (&whole.rest.positions_m, &whole.origin, &whole.fixed));
        assert_eq!((body.skin.triangles.len(), body.skin.rest_m.as_slice()), (1, &whole.skin.rest_m[3..]));
        assert!(body.skin.bindings.iter().all(|binding| binding.tet == 0), "{:?}", body.skin.bindings);
        assert!((whole.volume_of_m3(1) - 1.0 / 6.0).abs() < 1e-6 && body.volume_of_m3(0) == 0.0);
        assert_eq!(Body::unpack(&body.pack(), &room()), Some(body));
    }
}
