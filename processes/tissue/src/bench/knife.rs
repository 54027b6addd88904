//! What a cut costs: a wire is drawn through the middle of the scene's first pathology (without one, of its organ), and the model of what it leaves is
//! made anew after each tick in which the mesh changed.

use super::press::text;
use crate::materials::materials;
use crate::world::{Workshop, World};
use hyst_contact::Topology;
use hyst_exchange::system;
use hyst_mesh::{TetMesh, check};
use hyst_scene::{DeformableKind, LoadedScene};
use hyst_tissue::{CutOptions, Cuttable, Isa, ModelMaker, Options, cut};

/// Way of the wire in a tick of 1 ms, m: 0.2 m/s, faster than a hand cuts.
const WAY_M: f32 = 2e-4;
/// Most ticks: a way of 0.2 m.
const MAX_TICKS: usize = 1_000;

/// What was measured, ns and counts.
#[derive(Default)]
pub struct Knife {
    /// Each tick in which the wire was near.
    pub cut_ns: Vec<u64>,
    /// Making the model of the new mesh from what is known of the old one, each time that it changed.
    pub model_ns: Vec<u64>,
    /// Making its faces and neighbours.
    pub topology_ns: Vec<u64>,
    /// Tets before and after.
    pub tets: [usize; 2],
    /// Parts before and after.
    pub parts: [usize; 2],
}

fn timed<T>(times_ns: &mut Vec<u64>, work: impl FnOnce() -> T) -> T {
    let begun_ns = system::now_ns();
    let made = work();
    times_ns.push(system::now_ns() - begun_ns);
    made
}

/// All objects of the scene as they can be cut.
fn cuttable(world: &World) -> Cuttable {
    let rest = TetMesh {
        positions_m: world.model.rest_m().to_vec(),
        tets: world.model.tets().to_vec(),
        regions: world.body.rest.regions.clone(),
    };
    let fixed = (0..rest.positions_m.len()).map(|node| world.model.is_held(node)).collect();
    Cuttable { fixed, ..Cuttable::at_rest(rest) }
}

/// Draws the wire.
pub fn draw(scene: &LoadedScene, isa: Isa) -> Result<Knife, String> {
    let (_, world) = Workshop::open(scene, isa).map_err(text)?;
    let mut tissue = cuttable(&world);
    let first = scene.objects.iter().position(|object| object.kind == DeformableKind::Pathology).unwrap_or(0);
    let object = scene.objects.get(first).ok_or("the scene has no deformable object")?;
    let found = check(&object.mesh);
    let (low, high) = (found.min_m, found.max_m);
    let x = 0.5 * (low[0] + high[0]);
    let margin = 0.5 * (high[1] - low[1]);
    let materials = materials(scene).map_err(text)?;
    // What it takes to make a model is measured, not whether it is fast enough.
    let options = Options { max_substeps: 256, max_added_mass_ratio: 1e6, isa, ..Options::default() };
    let mut maker = ModelMaker::new(&materials, options);
    let (_, whole) = maker.make(&tissue.rest, &tissue.fixed).map_err(text)?;
    maker.options.omega_rest_per_s = Some(whole.omega_rest_per_s);
    let mut knife = Knife { tets: [tissue.rest.tets.len(); 2], parts: [check(&tissue.rest).components; 2], ..Knife::default() };
    for tick in 0..MAX_TICKS {
        let z = low[2] - WAY_M + tick as f32 * WAY_M;
        if z > high[2] + WAY_M {
            break;
        }
        let wire = [[x, low[1] - margin, z], [x, 0.5 * (low[1] + high[1]), z], [x, high[1] + margin, z]];
        let report = timed(&mut knife.cut_ns, || cut(&mut tissue, &wire, &CutOptions::default())).map_err(text)?;
        if report.has_changed_mesh() {
            timed(&mut knife.model_ns, || maker.make(&tissue.rest, &tissue.fixed)).map_err(text)?;
            timed(&mut knife.topology_ns, || Topology::new(&tissue.rest.tets, &tissue.rest.regions, &tissue.rest.positions_m))
                .map_err(text)?;
        }
    }
    knife.tets[1] = tissue.rest.tets.len();
    knife.parts[1] = check(&tissue.rest).components;
    Ok(knife)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_wire_parts_the_pathology_of_the_embedded_scene() {
        let scene = crate::world::load_scene(None).unwrap();
        let knife = draw(&scene, Isa::detect()).unwrap();
        assert_eq!(knife.parts[1], knife.parts[0] + 1);
        assert!(knife.tets[1] > knife.tets[0] && knife.model_ns.len() > 5 && knife.cut_ns.len() > knife.model_ns.len());
    }
}
