//! A model that a maker makes of a cut mesh is the one that is made from nothing, to the bit, whatever the maker made before.

mod common;

use common::cuts::{shipped, straight};
use common::{block, with_flat_tets};
use glam::Vec3;
use hyst_mesh::{TetMesh, check};
use hyst_tissue::{CutOptions, Cuttable, Material, Model, ModelError, ModelMaker, Options, cut};
use proptest::prelude::*;
use proptest::test_runner::{RngSeed, TestRunner};
use std::cell::Cell;

/// Of so many models one is compared as text.
const TEXT_EVERY: usize = 8;

/// What comes between two models.
#[derive(Debug, Clone)]
enum Event {
    /// A wire drawn through the middle: its offset, its direction, its way, in how many ticks.
    Stroke([Vec3; 3], u32),
    /// Other options: substeps of which one alone is too few, and whether the frequency is told.
    Options(u32, bool),
    /// The mesh before all cuts.
    Fresh,
    /// A mesh of which no model can be made: a tet inverted, one without a material, a node nowhere.
    Broken(usize, u32),
}

fn event() -> impl Strategy<Value = Event> {
    let unit = || [-1.0_f32..1.0, -1.0_f32..1.0, -1.0_f32..1.0].prop_map(Vec3::from_array);
    prop_oneof![
        4 => ([unit(), unit(), unit()], 1..6_u32).prop_map(|(stroke, steps)| Event::Stroke(stroke, steps)),
        1 => (prop_oneof![Just(1_u32), Just(8), Just(32)], any::<bool>()).prop_map(|(most, told)| Event::Options(most, told)),
        1 => Just(Event::Fresh),
        1 => (any::<usize>(), 0..3_u32).prop_map(|(at, kind)| Event::Broken(at, kind)),
    ]
}

fn broken(mut mesh: TetMesh, at: usize, kind: u32) -> TetMesh {
    let tet = at % mesh.tets.len();
    match kind {
        0 => mesh.tets[tet].swap(1, 2),
        1 => mesh.regions[tet] = 99,
        _ => mesh.positions_m[at % 17][1] = f32::NAN,
    }
    mesh
}

/// Two materials, two options, and what they are used for.
struct Bench {
    maker: ModelMaker,
    materials: [(u32, Material); 2],
    /// Models made, those with softened tets among them, and meshes refused.
    counts: [usize; 3],
}

impl Bench {
    fn new() -> Bench {
        let material = |modulus_pa, poisson, damping| Material::new(modulus_pa, poisson, 1000.0, damping).unwrap();
        let materials = [(0, material(10_000.0, 0.45, 20.0)), (1, material(4_000.0, 0.48, 40.0))];
        let options = Options { max_added_mass_ratio: 0.5, contact_stiffness_n_m: 20.0, ..Options::default() };
        Bench { maker: ModelMaker::new(&materials, options), materials, counts: [0; 3] }
    }

    fn assert_same(&mut self, mesh: &TetMesh, fixed: &[bool]) -> Result<(), ModelError> {
        let made = self.maker.make(mesh, fixed);
        let from_nothing = Model::with_materials(mesh, fixed, &self.materials, self.maker.options);
        assert!(made == from_nothing, "{:?} is not {:?}", made.map(|made| made.1), from_nothing.map(|made| made.1));
        // The sign of a zero too; some of them, for text is slow.
        let is_looked_at = self.counts[0].is_multiple_of(TEXT_EVERY);
        assert!(!is_looked_at || format!("{made:?}") == format!("{from_nothing:?}"), "a zero has another sign");
        let (_, report) = made.inspect_err(|_| self.counts[2] += 1)?;
        self.counts[0] += 1;
        self.counts[1] += usize::from(report.softened_tets > 0);
        Ok(())
    }
}

/// Events upon a mesh, in cases; the least that they have to come to: models, models with softened tets, refusals.
fn whatever_happens(mut mesh: TetMesh, cases: u32, seed: u64, least: [usize; 3]) {
    let found = check(&mesh);
    let (low, high) = (Vec3::from_array(found.min_m), Vec3::from_array(found.max_m));
    let (middle, size) = (0.5 * (low + high), high - low);
    for (tet, region) in mesh.tets.iter().zip(&mut mesh.regions) {
        *region = u32::from(mesh.positions_m[tet[0] as usize][0] > middle.x);
    }
    let mut fresh = Cuttable::at_rest(mesh);
    fresh.fixed = fresh.rest.positions_m.iter().map(|place| place[2] < low.z + 0.1 * size.z).collect();
    let counts = Cell::new([0; 3]);
    let config = ProptestConfig { cases, rng_seed: RngSeed::Fixed(seed), failure_persistence: None, ..ProptestConfig::default() };
    let events = prop::collection::vec(event(), 1..6);
    let outcome = TestRunner::new(config).run(&events, |events| {
        let (mut bench, mut tissue) = (Bench::new(), fresh.clone());
        for event in events {
            match event {
                Event::Stroke([offset, wire, way], steps) => {
                    let wire = wire.normalize_or(Vec3::X) * size.max_element();
                    let way = way.normalize_or(Vec3::Z) * 1.5 * size.max_element();
                    let centre = middle + 0.3 * offset * size - 0.5 * way;
                    for place in straight(centre - wire, centre + wire, way, steps) {
                        cut(&mut tissue, &place, &CutOptions::default()).unwrap();
                        let _ = bench.assert_same(&tissue.rest, &tissue.fixed);
                    }
                    tissue.end_stroke();
                }
                Event::Options(max_substeps, told) => {
                    bench.maker.options.max_substeps = max_substeps;
                    bench.maker.options.omega_rest_per_s = told.then_some(3_000.0);
                }
                Event::Fresh => tissue = fresh.clone(),
                Event::Broken(at, kind) => {
                    prop_assert!(bench.assert_same(&broken(tissue.rest.clone(), at, kind), &tissue.fixed).is_err());
                }
            }
        }
        let [models, softened, refused] = counts.get();
        counts.set([models + bench.counts[0], softened + bench.counts[1], refused + bench.counts[2]]);
        Ok(())
    });
    outcome.unwrap();
    let counts = counts.get();
    assert!(counts.iter().zip(least).all(|(count, least)| *count >= least), "{counts:?}, expected {least:?} at least");
}

#[test]
fn a_maker_makes_of_a_cut_block_what_is_made_from_nothing() {
    whatever_happens(block([6, 5, 4], 0.003), 40, 1, [100, 0, 20]);
}

#[test]
fn a_maker_softens_the_flat_tets_of_a_cut_block_as_from_nothing() {
    whatever_happens(with_flat_tets(block([5, 4, 3], 0.003), 40, 1e-4), 40, 2, [100, 100, 20]);
}

#[test]
fn a_maker_makes_of_the_cut_polyp_what_is_made_from_nothing() {
    whatever_happens(shipped("polyp.msh"), 30, 3, [50, 0, 20]);
}

#[test]
fn a_maker_makes_of_what_is_left_of_burnt_tets_what_is_made_from_nothing() {
    let whole = block([6, 5, 4], 0.003);
    let fixed: Vec<bool> = whole.positions_m.iter().map(|place| place[2] == 0.0).collect();
    let config =
        ProptestConfig { cases: 40, rng_seed: RngSeed::Fixed(4), failure_persistence: None, ..ProptestConfig::default() };
    // Tets that are taken out from one on, and a node that moves, or does not.
    let burnt = prop::collection::vec((any::<usize>(), 1..60_usize, any::<usize>(), 0..3_u8), 1..6);
    let outcome = TestRunner::new(config).run(&burnt, |burnt| {
        let (mut bench, mut mesh) = (Bench::new(), whole.clone());
        bench.maker.options.omega_rest_per_s = Some(3_000.0);
        prop_assert!(bench.assert_same(&mesh, &fixed).is_ok());
        for (first, count, node, way) in burnt {
            let first = first % (mesh.tets.len() - count);
            mesh.tets.drain(first..first + count);
            mesh.regions.drain(first..first + count);
            let node = node % mesh.positions_m.len();
            mesh.positions_m[node][0] += 1e-5 * f32::from(way);
            let _ = bench.assert_same(&mesh, &fixed);
        }
        prop_assert!(bench.counts[0] > 1, "no model of what is left");
        Ok(())
    });
    outcome.unwrap();
}

#[test]
fn regions_that_a_maker_is_told_stand_for_those_of_the_mesh() {
    let told = block([4, 3, 2], 0.003);
    let regions: Vec<u32> = (0..told.tets.len() as u32).map(|tet| tet % 2).collect();
    let own = TetMesh { regions: regions.clone(), ..told.clone() };
    let fixed = vec![false; told.positions_m.len()];
    let mut bench = Bench::new();
    for _ in 0..2 {
        let from_nothing = Model::with_materials(&own, &fixed, &bench.materials, bench.maker.options).unwrap();
        assert!(bench.maker.make_of(&told, &regions, &fixed).unwrap() == from_nothing);
        assert!(bench.maker.make(&told, &fixed).unwrap() != from_nothing);
    }
}
