//! What the scene's objects are made of, as far as plain tets can show it.

use hyst_engine::Failure;
use hyst_scene::LoadedScene;
use hyst_tissue::{Material, POISSON_RATIO_MAX};

/// The material of each object; its region is the object's index.
pub fn materials(scene: &LoadedScene) -> Result<Vec<(u32, Material)>, Failure> {
    let made = scene.objects.iter().enumerate().map(|(index, object)| {
        let stuff = &object.material;
        let poisson = stuff.poisson_ratio.min(POISSON_RATIO_MAX);
        let material = Material::new(stuff.youngs_modulus_pa, poisson, stuff.density_kg_m3, stuff.damping_per_s);
        material.map(|material| (index as u32, material)).map_err(|error| Failure::Input(format!("{}: {error}", object.name)))
    });
    made.collect()
}

/// The objects whose Poisson's ratio is taken lower than the scene says, in one sentence; none if there are none.
pub fn lowered(scene: &LoadedScene) -> Vec<String> {
    let objects = scene.objects.iter().filter(|object| object.material.poisson_ratio > POISSON_RATIO_MAX);
    let names: Vec<String> = objects.map(|object| format!("{} ({})", object.name, object.material.poisson_ratio)).collect();
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
