//! Momentum of what a cut has changed. A mesh that is divided has other masses at its nodes: more or less is added to them for the step, and at the border of
//! two densities what a moved node loses was shared out by volume. With the velocities that the nodes have, that is another momentum.
//!
//! Promise: an object that a cut has changed has, with all that has come off it, the momentum by the masses of its new model that it had by those of the one
//! before, but for what was burnt. All its free nodes are made faster by the same, which is the least that does it: of all pushes of one momentum it is the one
//! of the least energy, and nothing of the object is drawn or pressed by it. That is no more than the fastest of its nodes had, so that nothing is thrown,
//! however little mass it has: for what loses more than half of its mass at once that may be too little. An object that no tet has changed of keeps its
//! velocities to the bit, also where its masses are others because the step has other substeps: it was not cut.
//!
//! Sums are of double precision, in the order of the nodes: same state, same cut, same bits.

use super::Cuttable;
use super::places::{at, corners, to_single};
use crate::model::Model;
use glam::DVec3;
use hyst_mesh::signed_volume;

/// What a cut has done to a region of the mesh.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Changed {
    /// The region, of which a tet is another one now, or was burnt.
    pub region: u32,
    /// Momentum of what of it was burnt over the density, m⁴/s.
    pub burnt_m4_s: [f64; 3],
}

/// The objects of a tissue.
#[derive(Debug, Clone, Copy)]
pub struct Objects<'a> {
    /// Their model.
    pub model: &'a Model,
    /// The object of each tet.
    pub of_tet: &'a [u32],
}

/// Of a node of nothing that has changed: no list has such a place.
const NONE: u32 = u32::MAX;

/// What the nodes of an object have together.
#[derive(Debug, Clone, Copy, Default)]
struct Sum {
    mass_kg: f64,
    /// What of it is not held.
    free_kg: f64,
    momentum_kg_m_s: DVec3,
    fastest_m_s: f64,
}

impl Cuttable {
    /// Remembers of which regions these tets are, which are others now.
    pub(super) fn note_changed(&mut self, tets: &[u32]) {
        let mut regions: Vec<u32> = tets.iter().map(|tet| self.rest.regions[*tet as usize]).collect();
        regions.sort_unstable();
        regions.dedup();
        self.changed = regions.into_iter().map(|region| Changed { region, burnt_m4_s: [0.0; 3] }).collect();
    }

    /// Remembers what the tets that are not kept take along, before they are taken away.
    pub(super) fn note_burnt(&mut self, is_kept: &[bool]) {
        let tets = self.rest.tets.iter().zip(&self.rest.regions).zip(is_kept);
        for ((tet, region), _) in tets.filter(|(_, is_kept)| !**is_kept) {
            let place = match self.changed.binary_search_by_key(region, |changed| changed.region) {
                Ok(place) => place,
                Err(place) => {
                    self.changed.insert(place, Changed { region: *region, burnt_m4_s: [0.0; 3] });
                    place
                }
            };
            let share_m3 = signed_volume(corners(&self.rest.positions_m, *tet)) / 4.0;
            let velocities_m_s: DVec3 = tet.iter().map(|node| at(&self.velocity_m_s, *node)).sum();
            let burnt_m4_s = &mut self.changed[place].burnt_m4_s;
            *burnt_m4_s = (DVec3::from_array(*burnt_m4_s) + share_m3 * velocities_m_s).to_array();
        }
    }
}

impl Objects<'_> {
    /// For each node the place in a list of the object that it is of. `was`: what each object was a part of before.
    fn places(&self, changed: &[Changed], was: impl Fn(u32) -> u32) -> Vec<u32> {
        let mut places = vec![NONE; self.model.node_count()];
        for (tet, object) in self.model.tets().iter().zip(self.of_tet) {
            let before = was(*object);
            if let Ok(place) = changed.binary_search_by_key(&before, |changed| changed.region) {
                tet.iter().for_each(|node| places[*node as usize] = place as u32);
            }
        }
        places
    }

    /// What the nodes at each of so many places have together.
    fn sums(&self, places: &[u32], velocity_m_s: &[[f32; 3]], count: usize) -> Vec<Sum> {
        let mut sums = vec![Sum::default(); count];
        let nodes = places.iter().zip(self.model.mass_kg()).zip(velocity_m_s);
        for (node, ((place, mass_kg), velocity_m_s)) in nodes.enumerate() {
            let Some(sum) = sums.get_mut(*place as usize) else { continue };
            let (mass_kg, velocity_m_s) = (f64::from(*mass_kg), at(&[*velocity_m_s], 0));
            sum.mass_kg += mass_kg;
            sum.free_kg += if self.model.is_held(node) { 0.0 } else { mass_kg };
            sum.momentum_kg_m_s += mass_kg * velocity_m_s;
            sum.fastest_m_s = sum.fastest_m_s.max(velocity_m_s.length());
        }
        sums
    }

    /// What was burnt took along of an object of this mass, kg·m/s: all its tets are as heavy, by their volume.
    fn burnt_kg_m_s(&self, changed: &Changed, mass_kg: f64) -> DVec3 {
        let burnt_m4_s = DVec3::from_array(changed.burnt_m4_s);
        if burnt_m4_s == DVec3::ZERO {
            return DVec3::ZERO;
        }
        let own = self.model.tets().iter().zip(self.of_tet).filter(|(_, object)| **object == changed.region);
        let volume_m3: f64 = own.map(|(tet, _)| signed_volume(corners(self.model.rest_m(), *tet))).sum();
        if volume_m3 > 0.0 { burnt_m4_s * (mass_kg / volume_m3) } else { DVec3::ZERO }
    }
}

/// Gives each object that a cut has changed the momentum that it had before, by the masses of the models before and after, with all that has come off it; what
/// was burnt takes its own along. `changed`: what the cut says of it ([`Cuttable::changed`]), whose regions are the objects as they were named before; `was`:
/// what each object of those after was a part of before. The velocities before are those of the state that was cut, those after what the cut has left.
///
/// Gives what the bound on the change of velocity has kept back, kg·m/s; mostly 0.
pub fn keep_momentum(
    (before, before_m_s): (&Objects<'_>, &[[f32; 3]]),
    (after, velocity_m_s): (&Objects<'_>, &mut [[f32; 3]]),
    changed: &[Changed],
    was: impl Fn(u32) -> u32,
) -> f64 {
    let places = after.places(changed, was);
    let had = before.sums(&before.places(changed, |object| object), before_m_s, changed.len());
    let has = after.sums(&places, velocity_m_s, changed.len());
    let mut kept_back_kg_m_s = 0.0;
    let mut shifts_m_s = Vec::with_capacity(changed.len());
    for ((changed, had), has) in changed.iter().zip(&had).zip(&has) {
        let burnt_kg_m_s = before.burnt_kg_m_s(changed, had.mass_kg);
        let wanted_m_s = (had.momentum_kg_m_s - burnt_kg_m_s - has.momentum_kg_m_s) / has.free_kg;
        // Where nothing is free, or left, nothing can be made faster.
        let wanted_m_s = if wanted_m_s.is_finite() { wanted_m_s } else { DVec3::ZERO };
        let shift_m_s = wanted_m_s.clamp_length_max(had.fastest_m_s);
        kept_back_kg_m_s += has.free_kg * (wanted_m_s - shift_m_s).length();
        shifts_m_s.push(shift_m_s);
    }
    for (node, (place, velocity_m_s)) in places.iter().zip(velocity_m_s).enumerate() {
        let shift_m_s = shifts_m_s.get(*place as usize).copied().unwrap_or(DVec3::ZERO);
        if shift_m_s != DVec3::ZERO && !after.model.is_held(node) {
            *velocity_m_s = to_single(at(&[*velocity_m_s], 0) + shift_m_s);
        }
    }
    kept_back_kg_m_s
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Material, Options};
    use hyst_mesh::TetMesh;

    /// Two tets of 10 mm that nothing joins, each an object.
    fn mesh() -> TetMesh {
        let corner = |x: f32| [[x, 0.0, 0.0], [x + 0.01, 0.0, 0.0], [x, 0.01, 0.0], [x, 0.0, 0.01]];
        TetMesh { positions_m: [corner(0.0), corner(0.05)].concat(), tets: vec![[0, 1, 2, 3], [4, 5, 6, 7]], regions: vec![0, 1] }
    }

    /// Its model where all has a density, kg/m³, and the first nodes are held.
    fn model(density_kg_m3: f64, held: usize) -> Model {
        let fixed: Vec<bool> = (0..8).map(|node| node < held).collect();
        let material = Material::new(1e3, 0.3, density_kg_m3, 5.0).unwrap();
        let options = Options { omega_rest_per_s: Some(100.0), ..Options::default() };
        Model::new(&mesh(), &fixed, &material, options).unwrap().0
    }

    /// The velocities of nodes that move with 0.1 m/s along x, held ones not, once the density has become another one, and what was kept back.
    fn kept([before, after]: [f64; 2], held: usize, changed: &[Changed]) -> (Vec<[f32; 3]>, f64) {
        let (before, after) = (model(before, held), model(after, held));
        let from: Vec<[f32; 3]> = (0..8).map(|node| if node < held { [0.0; 3] } else { [0.1, 0.0, 0.0] }).collect();
        let mut velocity_m_s = from.clone();
        let [had, mut has] = [&before, &after].map(|model| Objects { model, of_tet: &[0, 1] });
        // The first one has another name after it.
        has.of_tet = &[2, 1];
        let was = |object: u32| if object == 2 { 0 } else { object };
        let kept_back = keep_momentum((&had, &from[..]), (&has, &mut velocity_m_s[..]), changed, was);
        (velocity_m_s, kept_back)
    }

    fn of(region: u32, burnt_m4_s: [f64; 3]) -> Changed {
        Changed { region, burnt_m4_s }
    }

    fn is_near(velocity_m_s: &[f32; 3], x_m_s: f32) -> bool {
        (velocity_m_s[0] - x_m_s).abs() < 1e-7 && velocity_m_s[1..] == [0.0; 2]
    }

    #[test]
    fn what_has_changed_is_made_slower_or_faster_and_nothing_else_is() {
        for (densities, x_m_s) in [([1e3, 2e3], 0.05), ([1e3, 0.8e3], 0.125), ([1e3, 1e3], 0.1)] {
            let (velocity_m_s, kept_back) = kept(densities, 0, &[of(0, [0.0; 3])]);
            assert!(velocity_m_s[..4].iter().all(|velocity| is_near(velocity, x_m_s)), "{densities:?}: {velocity_m_s:?}");
            assert!(velocity_m_s[4..].iter().all(|velocity| *velocity == [0.1, 0.0, 0.0]), "{velocity_m_s:?}");
            assert_eq!(kept_back, 0.0, "{densities:?}");
        }
        let (velocity_m_s, _) = kept([1e3, 2e3], 0, &[of(0, [0.0; 3]), of(1, [0.0; 3])]);
        assert!(velocity_m_s.iter().all(|velocity| is_near(velocity, 0.05)), "{velocity_m_s:?}");
    }

    #[test]
    fn what_was_burnt_takes_its_own_along() {
        // As if a tenth as much again had been there, and had moved as the rest does.
        let burnt_m4_s = [0.1 * 0.1 * 1e-6 / 6.0, 0.0, 0.0];
        let (velocity_m_s, _) = kept([1e3, 0.9e3], 0, &[of(0, burnt_m4_s)]);
        assert!(velocity_m_s[..4].iter().all(|velocity| is_near(velocity, 0.1)), "{velocity_m_s:?}");
    }

    #[test]
    fn nothing_is_made_faster_by_more_than_it_was_and_what_is_held_not_at_all() {
        // Four times as fast would be right.
        let (velocity_m_s, kept_back) = kept([4e3, 1e3], 0, &[of(0, [0.0; 3])]);
        assert!(velocity_m_s[..4].iter().all(|velocity| is_near(velocity, 0.2)), "{velocity_m_s:?}");
        let missing = 0.2 * 1e3 * 1e-6 / 6.0;
        assert!((kept_back / missing - 1.0).abs() < 1e-5, "{kept_back} kg·m/s, {missing} are missing");
        for held in [2, 4] {
            let (velocity_m_s, _) = kept([1e3, 2e3], held, &[of(0, [0.0; 3])]);
            assert!(velocity_m_s[..held].iter().all(|velocity| *velocity == [0.0; 3]), "{held}: {velocity_m_s:?}");
            assert!(velocity_m_s[held..4].iter().all(|velocity| is_near(velocity, 0.05)), "{held}: {velocity_m_s:?}");
        }
    }
}
