//! What the scene's objects and their regions are made of.

use crate::site::MAX_OBJECTS;
use hyst_engine::Failure;
use hyst_scene::{LoadedScene, Material as Stuff};
use hyst_tissue::Material;

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
        let material = Material::new(stuff.youngs_modulus_pa, stuff.poisson_ratio, stuff.density_kg_m3, stuff.damping_per_s);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::Body;
    use crate::knife::{Knife, Stroke};
    use crate::world::{Workshop, World};
    use hyst_scene::LoadedRegion;
    use hyst_tissue::Isa;

    /// Gives an object of a scene a region: the tets whose middle has a y above that of the middle of its box, or all.
    fn add_region(scene: &mut LoadedScene, object: usize, is_whole: bool, region: LoadedRegion) {
        let object = &mut scene.objects[object];
        object.regions.push(region);
        let (number, mesh) = (object.regions.len() as u32, &mut object.mesh);
        let found = hyst_mesh::check(mesh);
        let middle_m = 0.5 * (found.min_m[1] + found.max_m[1]);
        for (tet, region) in mesh.tets.iter().zip(&mut mesh.regions) {
            let y_m = tet.iter().map(|node| mesh.positions_m[*node as usize][1]).sum::<f32>() / 4.0;
            *region = if is_whole || y_m > middle_m { number } else { *region };
        }
    }

    /// A region of what an object is made of.
    fn of_own(scene: &LoadedScene, object: usize) -> LoadedRegion {
        LoadedRegion { name: "part".to_owned(), material: scene.objects[object].material.clone(), bed_n_m4: 0.0 }
    }

    /// What is left once a wire has gone through the middle of the scene's second object, from end to end.
    fn cut_through(scene: &LoadedScene, workshop: &mut Workshop, mut world: World) -> World {
        const STEP_M: f32 = 4e-4;
        let found = hyst_mesh::check(&scene.objects[1].mesh);
        let (low, high) = (found.min_m, found.max_m);
        let x = 0.5 * (low[0] + high[0]);
        let margin = 0.5 * (high[1] - low[1]);
        let (mut knife, mut stroke) = (Knife::default(), Vec::<u32>::new());
        let mut nodes = (world.model.rest_m().to_vec(), vec![[0.0; 3]; world.model.node_count()]);
        for step in 0..((high[2] - low[2]) / STEP_M) as u32 + 2 {
            let z = low[2] + (step as f32 - 0.5) * STEP_M;
            let wire_m = [low[1] - margin, 0.5 * (low[1] + high[1]), high[1] + margin].map(|y| [x, y, z]);
            let now = (&nodes.0[..], &nodes.1[..]);
            let swept = knife.sweep(&world, Some(&wire_m[..]), bytemuck::cast_slice(&stroke), now).unwrap();
            if let Stroke::Cut { body, .. } = swept {
                match workshop.make(*body) {
                    Ok(next) => {
                        world = next;
                        let (position_m, velocity_m_s) = knife.moved();
                        nodes = (position_m.to_vec(), velocity_m_s.to_vec());
                    }
                    Err(_) => knife.end(),
                }
            }
            stroke.resize(knife.stroke_bytes() / size_of::<u32>(), 0);
            knife.write_stroke(bytemuck::cast_slice_mut(&mut stroke));
        }
        world
    }

    /// Volume of the tets that are made of something, m³.
    fn made_of_m3(world: &World, number: u32) -> f64 {
        let is_of = |tet: usize| f64::from(u8::from(world.case.material(&world.body, tet) == number));
        (0..world.body.origin.len() as u32).map(|object| world.body.weighed(object, is_of)).sum()
    }

    #[test]
    fn a_region_of_the_same_material_changes_no_bit_of_the_model() {
        let mut scene = hyst_scene::load_embedded().unwrap();
        let (_, plain) = Workshop::open(&scene, Isa::detect()).unwrap();
        for (object, is_whole) in [(0, false), (1, true)] {
            let region = of_own(&scene, object);
            add_region(&mut scene, object, is_whole, region);
        }
        let (_, parted) = Workshop::open(&scene, Isa::detect()).unwrap();
        assert!(parted.model == plain.model && parted.notes == plain.notes);
        assert!(parted.objects == plain.objects && parted.wall == plain.wall && parted.words.len() == plain.words.len());
        let density_kg_m3 = |world: &World| world.case.density_of_kg_m3(&world.body, 1);
        assert_eq!(density_kg_m3(&parted), density_kg_m3(&plain));
        assert!(plain.body.material.is_empty() && parted.body.material.len() == parted.body.rest.tets.len());
    }

    #[test]
    fn a_cut_keeps_what_tets_are_made_of_and_who_takes_the_state_makes_the_same_model() {
        let mut scene = hyst_scene::load_embedded().unwrap();
        let mut stiff = of_own(&scene, 1);
        stiff.material.youngs_modulus_pa *= 2.2;
        stiff.material.density_kg_m3 = 1_200.0;
        for object in [0, 1] {
            let region = if object == 1 { stiff.clone() } else { of_own(&scene, 0) };
            add_region(&mut scene, object, false, region);
        }
        let (mut workshop, world) = Workshop::open(&scene, Isa::detect()).unwrap();
        let numbers = [0, 1, FIRST_REGION, FIRST_REGION + 1];
        let (before_m3, tets) = (numbers.map(|number| made_of_m3(&world, number)), world.body.rest.tets.len());
        assert!(before_m3.iter().all(|volume_m3| *volume_m3 > 1e-8), "{before_m3:?}");
        let own = scene.objects[1].material.density_kg_m3;
        let expected = (before_m3[1] * own + before_m3[3] * 1_200.0) / (before_m3[1] + before_m3[3]);
        let found = world.case.density_of_kg_m3(&world.body, 1);
        assert!((found / expected - 1.0).abs() < 1e-9, "{found} kg/m³, expected {expected} kg/m³");
        let world = cut_through(&scene, &mut workshop, world);
        assert!(world.body.rest.tets.len() > tets + 20 && world.body.material.len() == world.body.rest.tets.len());
        for (number, before_m3) in numbers.into_iter().zip(before_m3) {
            let after_m3 = made_of_m3(&world, number);
            // Of the pathology crumbs may be burnt.
            assert!((0.9..1.000_01).contains(&(after_m3 / before_m3)), "{number}: {before_m3} m³ became {after_m3} m³");
        }
        let unpacked = Body::unpack(&world.words, &world.case.room).unwrap();
        assert_eq!(unpacked, world.body);
        let (mut other, _) = Workshop::open(&scene, Isa::detect()).unwrap();
        assert!(other.make(unpacked).unwrap().model == world.model);
    }

    #[test]
    fn an_organ_on_a_bed_is_held_and_its_cavity_keeps_its_wall() {
        let mut scene = hyst_scene::load_embedded().unwrap();
        let (_, fixed) = Workshop::open(&scene, Isa::detect()).unwrap();
        // What was fixed is on a bed: tets of which a node was.
        let organ = &mut scene.objects[0];
        let was_fixed = std::mem::replace(&mut organ.fixed, vec![false; organ.mesh.positions_m.len()]);
        for (tet, region) in organ.mesh.tets.iter().zip(&mut organ.mesh.regions) {
            *region = u32::from(tet.iter().any(|node| was_fixed[*node as usize]));
        }
        let bed = LoadedRegion { bed_n_m4: 3e8, ..of_own(&scene, 0) };
        scene.objects[0].regions.push(bed);
        let (_, world) = Workshop::open(&scene, Isa::detect()).unwrap();
        assert!(!world.objects[0].is_free_piece() && !world.case.is_loose_in_scene(0) && world.drifters == fixed.drifters);
        let held = world.case.held_nodes(&world.body);
        assert!(was_fixed.iter().zip(&held).all(|(fixed, held)| *held || !fixed), "what was fixed is held");
        assert!(world.wall.iter().flatten().all(|node| !held[*node as usize]), "no wall of the cavity is held");
        assert!(world.wall.len() * 4 > fixed.wall.len(), "{} triangles of {}", world.wall.len(), fixed.wall.len());
        assert!(!world.body.fixed.contains(&true) && world.model != fixed.model);
    }

    #[test]
    fn the_shipped_scene_with_regions_has_them_all_in_its_model() {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/scenes/regions.toml");
        let scene = hyst_scene::load(&path).unwrap_or_else(|error| panic!("{error}"));
        let (_, world) = Workshop::open(&scene, Isa::detect()).unwrap();
        let names: Vec<String> = all(&scene).map(|(_, name, ..)| name).collect();
        assert_eq!(names[2..], ["uterus, ligaments", "uterus, endometrium", "uterus, cervix", "myoma, core"]);
        for (number, name, ..) in all(&scene) {
            assert!(made_of_m3(&world, number) > 2e-8, "{name}: {} m³", made_of_m3(&world, number));
        }
        let held = world.case.held_nodes(&world.body);
        let bedded = (0..held.len()).filter(|node| held[*node] && !world.model.is_held(*node)).count();
        assert!(bedded > 200 && !world.wall.is_empty() && !world.objects[0].is_free_piece(), "{bedded} nodes on beds");
    }

    #[test]
    fn each_object_and_region_has_its_own_poisson_ratio_up_to_the_highest_that_a_scene_may_give() {
        let mut scene = hyst_scene::load_embedded().unwrap();
        scene.objects[0].material.poisson_ratio = 0.49;
        scene.objects[1].material.poisson_ratio = 0.47;
        let region = of_own(&scene, 1);
        add_region(&mut scene, 1, true, region);
        let made = materials(&scene).unwrap();
        let ratios: Vec<(u32, f64)> = made.iter().map(|(number, material)| (*number, material.poisson_ratio())).collect();
        assert_eq!(ratios, [(0, 0.49), (1, 0.47), (FIRST_REGION, 0.47)]);
        let (_, world) = Workshop::open(&scene, Isa::detect()).unwrap();
        assert!(world.model.substeps(1e-3) <= 32, "{} substeps", world.model.substeps(1e-3));
        scene.objects[1].regions[0].material.youngs_modulus_pa = 0.5;
        let error = materials(&scene).unwrap_err().to_string();
        assert!(error.contains("polyp, part: youngs_modulus_pa is 0.5"), "{error}");
    }
}
