//! Parts of a body that hang together no more, and the numbers that they get as objects.
//!
//! Promise: nothing that is free stays a part of another object, where it would neither float nor be counted: without a number that nobody has it is burnt, the
//! smallest first. A number names one thing at a time, and is had again only when all have been given once; those of what is there at first are its own.

use super::{Body, Room};
use hyst_mesh::component_count;
use std::collections::BTreeMap;

/// The object of what is burnt, until it is taken away.
const ASH: u32 = u32::MAX;

/// A part that became an object of its own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Piece {
    /// Its object.
    pub object: u32,
    /// The object that it was a part of.
    pub of: u32,
    /// Its volume at rest, m³.
    pub volume_m3: f64,
    /// Whether anything holds it.
    pub is_held: bool,
}

impl Body {
    /// Makes an object of each part that has come free: the greatest part that something holds stays what it was, or the greatest of all. Without a number for
    /// another object a part that is held stays with its own, and one that is free is burnt. The parts are those of each tet, as
    /// [`hyst_mesh::component_of_each_tet`] numbers them.
    pub fn register_parts(&mut self, part_of_tet: &[u32], is_held: impl Fn(u32) -> bool, room: &Room) -> Vec<Piece> {
        let new = if self.has_parted(part_of_tet) { self.name_parts(part_of_tet, is_held, room) } else { Vec::new() };
        self.sort_skin();
        new
    }

    /// Whether an object has more than one part: few cuts leave one.
    fn has_parted(&self, part_of_tet: &[u32]) -> bool {
        let mut part_of: Vec<Option<u32>> = vec![None; self.origin.len()];
        let is_of_another =
            |(object, part): (&u32, &u32)| part_of[*object as usize].replace(*part).is_some_and(|before| before != *part);
        self.rest.regions.iter().zip(part_of_tet).any(is_of_another)
    }

    fn name_parts(&mut self, part_of_tet: &[u32], is_held: impl Fn(u32) -> bool, room: &Room) -> Vec<Piece> {
        let mut of_part = vec![Piece { object: 0, of: 0, volume_m3: 0.0, is_held: false }; component_count(part_of_tet)];
        for ((nodes, region), part) in self.rest.tets.iter().zip(&self.rest.regions).zip(part_of_tet) {
            let piece = &mut of_part[*part as usize];
            (piece.object, piece.of) = (*region, *region);
            piece.volume_m3 += self.volume_m3(*nodes);
            piece.is_held |= nodes.iter().any(|node| is_held(*node));
        }
        let parted = parted(&of_part);
        let numbers = self.free_numbers(parted.len(), room);
        let (numbered, others) = by_need(&of_part, parted, numbers.len());
        let mut new = Vec::with_capacity(numbered.len());
        for (part, number) in numbered.into_iter().zip(numbers) {
            let piece = &mut of_part[part];
            let origin = self.origin[piece.object as usize];
            match self.origin.get_mut(number as usize) {
                Some(before) => *before = origin,
                None => self.origin.push(origin),
            }
            piece.object = number;
            new.push(*piece);
        }
        let burnt: Vec<usize> = others.into_iter().filter(|part| !of_part[*part].is_held).collect();
        burnt.iter().for_each(|part| of_part[*part].object = ASH);
        for (region, part) in self.rest.regions.iter_mut().zip(part_of_tet) {
            *region = of_part[*part as usize].object;
        }
        if !burnt.is_empty() {
            *self = self.without(ASH);
        }
        new
    }

    /// As many numbers as are asked for, or as there are: first those that nobody has had, then those of pieces that are gone, the lowest first.
    fn free_numbers(&self, count: usize, room: &Room) -> Vec<u32> {
        let known = self.origin.len();
        let mut is_used = vec![false; known];
        self.rest.regions.iter().for_each(|region| is_used[*region as usize] = true);
        let gone = (room.named..known).filter(|number| !is_used[*number]);
        (known..room.objects).chain(gone).take(count).map(|number| number as u32).collect()
    }
}

/// The parts that are to be objects of their own, in their order: all but the greatest of each object.
fn parted(of_part: &[Piece]) -> Vec<usize> {
    let mut greatest: BTreeMap<u32, usize> = BTreeMap::new();
    for (part, piece) in of_part.iter().enumerate() {
        let place = greatest.entry(piece.object).or_insert(part);
        let before = &of_part[*place];
        if (piece.is_held, piece.volume_m3) > (before.is_held, before.volume_m3) {
            *place = part;
        }
    }
    (0..of_part.len()).filter(|part| greatest.get(&of_part[*part].object) != Some(part)).collect()
}

/// So many of some parts that get a number, and the others, each in their order: what is held can do without, and of the free ones the smallest have to.
fn by_need(of_part: &[Piece], parts: Vec<usize>, numbers: usize) -> (Vec<usize>, Vec<usize>) {
    let mut by_need = parts.clone();
    by_need.sort_by(|one, other| {
        let (one, other) = (&of_part[*one], &of_part[*other]);
        one.is_held.cmp(&other.is_held).then(other.volume_m3.total_cmp(&one.volume_m3))
    });
    let without: Vec<usize> = by_need.into_iter().skip(numbers).collect();
    parts.into_iter().partition(|part| !without.contains(part))
}

#[cfg(test)]
mod tests {
    use super::super::tests::{body, room};
    use super::*;
    use hyst_mesh::{TetMesh, component_of_each_tet};

    /// A tet of object 0, and a row of so many others of it that nothing joins to it or to each other; the edges are longer from one to the next.
    fn chips(count: usize) -> Body {
        let tet = |x: f32, edge: f32| [[x, 0.0, 0.0], [x + edge, 0.0, 0.0], [x, edge, 0.0], [x, 0.0, edge]];
        let edge = |chip: usize| if chip == 0 { 5.0 } else { 1.0 + chip as f32 / 1e3 };
        let positions_m: Vec<[f32; 3]> = (0..=count).flat_map(|chip| tet(10.0 * chip as f32, edge(chip))).collect();
        let tets: Vec<[u32; 4]> = (0..=count as u32).map(|chip| [0, 1, 2, 3].map(|corner| 4 * chip + corner)).collect();
        let fixed = vec![false; positions_m.len()];
        let rest = TetMesh { positions_m, regions: vec![0; tets.len()], tets };
        Body { rest, fixed, origin: vec![0], ..Body::default() }
    }

    fn registered(body: &mut Body, is_held: impl Fn(u32) -> bool, room: &Room) -> Vec<Piece> {
        let part_of_tet = component_of_each_tet(&body.rest);
        body.register_parts(&part_of_tet, is_held, room)
    }

    #[test]
    fn a_part_that_comes_free_is_an_object_and_takes_its_surface_along() {
        let mut body = body();
        assert!(registered(&mut body, |_| false, &room()).is_empty(), "nothing is cut");
        assert_eq!(body, self::body());
        // The second tet gets nodes of its own; the first is held.
        body.rest.positions_m.extend([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
        body.fixed.extend([false; 3]);
        body.rest.tets[1] = [9, 10, 11, 8];
        body.skin.bindings[0].tet = 1;
        let new = registered(&mut body, |node| node == 0, &room());
        assert_eq!((new.len(), new[0].object, new[0].of, new[0].is_held), (1, 2, 0, false));
        assert!((new[0].volume_m3 - 1.0 / 3.0).abs() < 1e-6, "{new:?}");
        assert_eq!((&body.rest.regions[..], &body.origin[..]), (&[0, 2, 1][..], &[0, 1, 0][..]));
        assert_eq!(body.skin.triangles, [[0, 1, 2], [3, 4, 5]], "the second object's triangle comes first now");
        assert_eq!(body.skin.bindings.iter().map(|binding| binding.tet).collect::<Vec<_>>(), [2, 2, 2, 1, 1, 1]);
        assert_eq!(body.skin.raw, [false, true, false, true, false, false], "and so do the flags of its vertices");
        let full = Room { objects: 2, ..room() };
        let mut body = self::body();
        body.rest.tets[1] = [9, 10, 11, 8];
        body.rest.positions_m.extend([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
        let parted = registered(&mut body, |node| node == 0 || node == 9, &full);
        assert!(parted.is_empty() && body.origin.len() == 2 && body.rest.tets.len() == 3, "what is held needs no number");
    }

    #[test]
    fn of_more_chips_than_there_are_numbers_the_smallest_are_burnt_and_none_stays_in_its_mother() {
        let room = Room { nodes: 4_000, tets: 1_000, vertices: 0, triangles: 0, objects: 256, regions: 0, named: 1, of_scene: 1 };
        let mut body = chips(300);
        let (before_m3, small_m3) = (body.volume_of_m3(0), body.volume_m3([180, 181, 182, 183]));
        let new = registered(&mut body, |node| node == 0, &room);
        assert_eq!((new.len(), body.origin.len(), body.rest.tets.len()), (255, 256, 256), "45 are burnt");
        assert!(new.iter().all(|piece| piece.of == 0 && piece.volume_m3 > small_m3), "the smallest ones");
        assert_eq!(body.rest.regions.iter().filter(|region| **region == 0).count(), 1, "the mother is what is held, alone");
        let free_m3 = body.volume_where_m3(|object| object > 0);
        let all_m3: f64 = new.iter().map(|piece| piece.volume_m3).sum();
        assert!((free_m3 - all_m3).abs() < 1e-9 * all_m3 && before_m3 > free_m3 + body.volume_of_m3(0), "{free_m3} of {all_m3}");
        assert_eq!(Body::unpack(&body.pack(), &room).as_ref(), Some(&body));
    }

    #[test]
    fn numbers_of_pieces_that_are_gone_are_given_again_once_all_were_given_and_those_of_the_scene_are_not() {
        let room = Room { nodes: 4_000, tets: 1_000, vertices: 0, triangles: 0, objects: 8, regions: 0, named: 2, of_scene: 2 };
        let mut body = chips(4);
        // The scene has two objects, of which the second is gone from the beginning.
        body.origin = vec![0, 1];
        let objects = |new: &[Piece]| new.iter().map(|piece| piece.object).collect::<Vec<u32>>();
        assert_eq!(objects(&registered(&mut body, |node| node == 0, &room)), [2, 3, 4, 5]);
        let mut body = body.without(3);
        let more = chips(8);
        for tet in &more.rest.tets[5..9] {
            body.rest.positions_m.extend(tet.map(|node| more.rest.positions_m[node as usize]));
            body.fixed.extend([false; 4]);
            let first = body.fixed.len() as u32 - 4;
            body.rest.tets.push([0, 1, 2, 3].map(|corner| first + corner));
            body.rest.regions.push(0);
        }
        let new = registered(&mut body, |node| node == 0, &room);
        assert_eq!(objects(&new), [6, 7, 3], "what nobody has had comes first, and there is none for the smallest");
        assert_eq!((body.origin.len(), body.rest.tets.len()), (8, 1 + 3 + 3));
        assert!(body.origin[2..].iter().all(|origin| *origin == 0) && body.origin[1] == 1, "{:?}", body.origin);
    }
}
