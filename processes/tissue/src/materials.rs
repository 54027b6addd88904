//! What the scene's objects and their regions are made of, as far as plain tets can show it.

use crate::site::MAX_OBJECTS;
use hyst_engine::Failure;
use hyst_scene::{LoadedScene, Material as Stuff};
use hyst_tissue::{Material, POISSON_RATIO_MAX};

/// Number of the first region's material: one that no object has.
pub const FIRST_REGION: u32 = MAX_OBJECTS as u32;

/// What the Main Loop asks of a region beside its elasticity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Region {
    /// Its density.
    pub density_kg_m3: f64,
    /// Whether what is around it holds it.
    pub is_on_bed: bool,
}

/// The regions of all objects, in the order of the objects: what a body's tets are made of counts them from 1.
pub fn regions(scene: &LoadedScene) -> Vec<Region> {
    let regions = scene.objects.iter().flat_map(|object| &object.regions);
    regions.map(|of| Region { density_kg_m3: of.material.density_kg_m3, is_on_bed: of.bed_n_m4 > 0.0 }).collect()
}

/// The numbered material of each object, whose number is its index, and of each region, from [`FIRST_REGION`] on.
pub fn materials(scene: &LoadedScene) -> Result<Vec<(u32, Material)>, Failure> {
    let made = all(scene).map(|(number, name, stuff, bed_n_m4)| {
        let poisson = stuff.poisson_ratio.min(POISSON_RATIO_MAX);
        let material = Material::new(stuff.youngs_modulus_pa, poisson, stuff.density_kg_m3, stuff.damping_per_s);
        let material = material.and_then(|material| material.on_bed(bed_n_m4));
        material.map(|material| (number, material)).map_err(|error| Failure::Input(format!("{name}: {error}")))
    });
    made.collect()
}

/// What the tets can be made of: number, name, material, and stiffness of the bed that it is on, N/m⁴.
fn all(scene: &LoadedScene) -> impl Iterator<Item = (u32, String, &Stuff, f64)> {
    let objects = (0..).zip(&scene.objects).map(|(index, object)| (index, object.name.clone(), &object.material, 0.0));
    let regions = scene.objects.iter().flat_map(|object| object.regions.iter().map(move |region| (object, region)));
    let regions = (FIRST_REGION..).zip(regions).map(|(number, (object, region))| {
        (number, format!("{}, {}", object.name, region.name), &region.material, region.bed_n_m4)
    });
    objects.chain(regions)
}

/// The objects and regions whose Poisson's ratio is taken lower than the scene says, in one sentence; none if there are none.
pub fn lowered(scene: &LoadedScene) -> Vec<String> {
    let too_high = all(scene).filter(|(_, _, stuff, _)| stuff.poisson_ratio > POISSON_RATIO_MAX);
    let names: Vec<String> = too_high.map(|(_, name, stuff, _)| format!("{name} ({})", stuff.poisson_ratio)).collect();
    if names.is_empty() {
        return Vec::new();
    }
    vec![format!(
        "Poisson's ratio of {} is taken as {POISSON_RATIO_MAX}: linear tets lock above that (6 % too stiff at 0.45, 30 % at 0.49)",
        names.join(", ")
    )]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::Workshop;
    use hyst_tissue::Isa;

    #[test]
    fn a_poisson_ratio_that_is_taken_lower_is_said_in_one_sentence() {
        let mut scene = hyst_scene::load_embedded().unwrap();
        let said = |scene: &LoadedScene| {
            let (_, world) = Workshop::open(scene, Isa::detect()).unwrap();
            world.notes.into_iter().filter(|note| note.contains("Poisson")).collect::<Vec<_>>()
        };
        assert!(said(&scene).is_empty());
        scene.objects[0].material.poisson_ratio = 0.49;
        scene.objects[1].material.poisson_ratio = 0.47;
        let said = said(&scene);
        assert_eq!(said.len(), 1, "{said:?}");
        assert!(said[0].starts_with("Poisson's ratio of uterus (0.49), polyp (0.47) is taken as 0.45: "), "{said:?}");
        let ratios: Vec<f64> = materials(&scene).unwrap().iter().map(|(_, material)| material.poisson_ratio()).collect();
        assert_eq!(ratios, [POISSON_RATIO_MAX; 2]);
    }
}
