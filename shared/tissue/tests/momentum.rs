//! Momentum of tissue that moves while it is cut. By volume it is kept, which every sweep of the other tests asserts. Here it is the model's: its nodes
//! have the mass of what they are made of, and what is added for the step.

mod common;

use common::cuts::{bar, momentum, parts, shape, shipped, straight, sweep};
use glam::{DVec3, Vec3};
use hyst_mesh::{TetMesh, check, component_of_each_tet};
use hyst_tissue::{CutOptions, Cuttable, Material, Model, ModelError, ModelReport, Objects, Options, keep_momentum};
use std::collections::BTreeSet;

/// Density of each half, kg/m³.
const DENSITIES_KG_M3: [f64; 2] = [1_000.0, 1_500.0];
/// With as many substeps the station tries to make a model, and the stiffness of its contacts, N/m.
const SUBSTEPS: [u32; 5] = [8, 12, 16, 24, 32];
const CONTACT_N_M: f64 = 400.0;
/// Waves of the velocity, radians for each m.
const WAVES_PER_M: f32 = 300.0;

/// Moves a tissue along, and some of it faster: that is no linear field, of which all would be kept.
fn moving(mut tissue: Cuttable) -> Cuttable {
    for (velocity, place) in tissue.velocity_m_s.iter_mut().zip(&tissue.rest.positions_m) {
        let wave = 0.05 * (WAVES_PER_M * (place[0] + place[2])).sin();
        *velocity = [0.2 + wave, 0.1, -0.1 - wave];
    }
    tissue
}

/// Makes a tissue of two materials, one in each half of its length; its regions are the objects, of which each hangs together.
fn in_halves(mut tissue: Cuttable) -> Cuttable {
    let found = check(&tissue.rest);
    let middle_m = 0.5 * (found.min_m[0] + found.max_m[0]);
    let rest = &tissue.rest;
    tissue.material = rest.tets.iter().map(|tet| u32::from(rest.positions_m[tet[0] as usize][0] > middle_m)).collect();
    tissue.rest.regions = component_of_each_tet(&tissue.rest);
    tissue
}

/// The model as the station makes it: with as few substeps as little enough mass, no more than its own, has to be added for.
fn model_of(tissue: &Cuttable, omega_rest_per_s: Option<f64>) -> (Model, ModelReport) {
    let [first, second] = DENSITIES_KG_M3.map(|density_kg_m3| Material::new(15e3, 0.45, density_kg_m3, 8.0).unwrap());
    let mesh = TetMesh { regions: tissue.material.clone(), ..tissue.rest.clone() };
    let with = |max_substeps: u32| {
        let options = Options {
            max_substeps,
            max_added_mass_ratio: 1.0,
            contact_stiffness_n_m: CONTACT_N_M,
            omega_rest_per_s,
            ..Options::default()
        };
        Model::with_materials(&mesh, &tissue.fixed, &[(0, first), (1, second)], options)
    };
    let made = SUBSTEPS.into_iter().map(with).find(|made| !matches!(made, Err(ModelError::TooStiff { .. })));
    made.expect("substeps that are enough").unwrap()
}

fn velocity(tissue: &Cuttable, node: u32) -> DVec3 {
    DVec3::from_array(tissue.velocity_m_s[node as usize].map(f64::from))
}

/// Momentum of an object by the masses of a model, kg·m/s.
fn by_model(model: &Model, tissue: &Cuttable, object: u32) -> DVec3 {
    let own = tissue.rest.tets.iter().zip(&tissue.rest.regions).filter(|(_, region)| **region == object);
    let nodes: BTreeSet<u32> = own.flat_map(|(tet, _)| *tet).collect();
    nodes.into_iter().map(|node| velocity(tissue, node) * f64::from(model.mass_kg()[node as usize])).sum()
}

/// Momentum by what the tets are made of, without what is added, kg·m/s.
fn own_momentum(tissue: &Cuttable) -> DVec3 {
    let of_tet = |(tet, volume_m3): (usize, f64)| {
        let mass_kg = volume_m3 * DENSITIES_KG_M3[tissue.material[tet] as usize];
        tissue.rest.tets[tet].map(|node| velocity(tissue, node)).iter().sum::<DVec3>() * (mass_kg / 4.0)
    };
    shape(&tissue.rest).0.into_iter().enumerate().map(of_tet).sum()
}

/// Gives what was cut the momentum that it had; what the bound has kept back, kg·m/s.
fn keep((before, earlier): (&Model, &Cuttable), after: &Model, tissue: &mut Cuttable) -> f64 {
    let had = Objects { model: before, of_tet: &earlier.rest.regions };
    let has = Objects { model: after, of_tet: &tissue.rest.regions };
    let velocity_m_s = &mut tissue.velocity_m_s[..];
    keep_momentum((&had, &earlier.velocity_m_s[..]), (&has, velocity_m_s), &tissue.changed, |object| object)
}

/// Three strokes through a tissue, along its height and a little aslant: where the wire is in each sweep, m.
fn strokes(tissue: &Cuttable) -> [Vec<Vec<[f32; 3]>>; 3] {
    let found = check(&tissue.rest);
    let (low, high) = (Vec3::from_array(found.min_m), Vec3::from_array(found.max_m));
    let (size, margin) = (high - low, 0.2 * (high - low));
    [0.3, 0.5, 0.75].map(|share| {
        let from = Vec3::new(low.x + share * size.x, low.y - margin.y, low.z - margin.z);
        let to = Vec3::new(from.x + 0.1 * size.x, high.y + margin.y, from.z);
        straight(from, to, Vec3::Z * (size.z + 2.0 * margin.z), 5)
    })
}

/// What a sweep did to the momentum of what it cut.
#[derive(Default)]
struct Seen {
    sweeps: usize,
    /// Most by which an object's would have become another one, as a share of it.
    most_share: f64,
    /// Sweeps in which the bound has kept some back.
    bounded: usize,
}

impl Seen {
    /// One sweep: what it cuts keeps its momentum, what it does not cut its velocities.
    fn look(&mut self, name: &str, before: (&Model, &Cuttable), after: &Model, tissue: &mut Cuttable) {
        let cut = tissue.clone();
        let kept_back_kg_m_s = keep(before, after, tissue);
        // What is burnt takes its own along: below.
        for changed in cut.changed.iter().filter(|changed| changed.burnt_m4_s == [0.0; 3]) {
            let object = changed.region;
            let had = by_model(before.0, before.1, object);
            let [left, has] = [&cut, &*tissue].map(|tissue| by_model(after, tissue, object));
            let changed_kg_m_s = has.distance(had);
            assert!(changed_kg_m_s <= 1e-5 * had.length() + 1.001 * kept_back_kg_m_s, "{name}, {object}: {had} became {has}");
            self.most_share = self.most_share.max(left.distance(had) / had.length());
        }
        let is_cut = |object: &u32| cut.changed.iter().any(|changed| changed.region == *object);
        for (tet, _) in cut.rest.tets.iter().zip(&cut.rest.regions).filter(|(_, object)| !is_cut(object)) {
            assert!(tet.iter().all(|node| velocity(&cut, *node) == velocity(tissue, *node)), "{name}: what is not cut is pushed");
        }
        self.sweeps += 1;
        self.bounded += usize::from(kept_back_kg_m_s > 0.0);
    }
}

#[test]
fn what_is_cut_keeps_its_momentum_by_the_masses_of_its_model_at_a_border_of_densities_too() {
    for (name, fresh) in [("bar", bar()), ("polyp", Cuttable::at_rest(shipped("polyp.msh")))] {
        let mut tissue = moving(in_halves(fresh));
        let (mut model, begun) = model_of(&tissue, None);
        let (told_per_s, mut seen, mut report) = (Some(begun.omega_rest_per_s), Seen::default(), begun);
        for places in strokes(&tissue) {
            for place in places {
                let earlier = tissue.clone();
                let reports = sweep(&mut tissue, &[place], &CutOptions::default());
                let (after, made) = model_of(&tissue, told_per_s);
                if reports[0].has_changed_mesh() {
                    let [before_kg_m_s, own_kg_m_s] = [&earlier, &tissue].map(own_momentum);
                    // What moved nodes lose is shared out by volume, at the border of the two densities too.
                    let is_near = own_kg_m_s.distance(before_kg_m_s) <= 5e-3 * before_kg_m_s.length();
                    assert!(reports[0].burnt_tets > 0 || is_near, "{name}: {before_kg_m_s} became {own_kg_m_s}");
                    seen.look(name, (&model, &earlier), &after, &mut tissue);
                    tissue.rest.regions = component_of_each_tet(&tissue.rest);
                }
                (model, report) = (after, made);
            }
            tissue.end_stroke();
        }
        let Seen { sweeps, most_share, bounded } = seen;
        println!(
            "{name}: momentum would have changed by {:.2} % in one of {sweeps} sweeps, in {bounded} the bound was met; \
             {:.2} % of the mass were added, then {:.2} %",
            100.0 * most_share,
            100.0 * begun.added_mass_kg / begun.mass_kg,
            100.0 * report.added_mass_kg / report.mass_kg
        );
        assert!(sweeps > 5 && parts(&tissue.rest) > 1 && report.added_mass_kg > 0.0, "{name}: {sweeps} sweeps, {report:?}");
        assert!(most_share > 0.01 && 4 * bounded <= sweeps, "{name}: {most_share}, {bounded} of {sweeps}: nothing was tried");
    }
}

#[test]
fn what_is_burnt_takes_its_share_along_and_what_is_left_of_an_object_goes_on_as_it_went() {
    let mut tissue = bar();
    tissue.material = vec![0; tissue.rest.tets.len()];
    tissue.velocity_m_s.fill([0.2, 0.1, -0.1]);
    let whole_m3 = tissue.volume_m3();
    let options = CutOptions { min_piece_m3: 0.4 * whole_m3, ..CutOptions::default() };
    let (before, begun) = model_of(&tissue, None);
    let mut reports = Vec::new();
    let mut earlier = tissue.clone();
    for place in straight(Vec3::new(0.0105, -0.002, -0.002), Vec3::new(0.0105, 0.014, -0.002), Vec3::Z * 0.016, 1) {
        earlier.clone_from(&tissue);
        reports.extend(sweep(&mut tissue, &[place], &options));
    }
    assert!(reports.len() == 2 && reports[1].burnt_tets > 0 && !reports[0].has_changed_mesh(), "{reports:?}");
    let (after, _) = model_of(&tissue, Some(begun.omega_rest_per_s));
    let kept_back_kg_m_s = keep((&before, &earlier), &after, &mut tissue);
    let [had, has] = [(&before, &earlier), (&after, &tissue)].map(|(model, tissue)| by_model(model, tissue, 0));
    let expected = had * (1.0 - reports[1].burnt_m3 / whole_m3);
    assert!(kept_back_kg_m_s == 0.0 && has.distance(expected) <= 1e-5 * had.length(), "{had} became {has}, not {expected}");
}

#[test]
fn what_is_burnt_takes_its_momentum_along_and_the_nodes_that_are_left_move_as_they_would() {
    // Through a bar of 36 mm at 10.5 mm: three tenths of it come off.
    let places = straight(Vec3::new(0.0105, -0.002, -0.002), Vec3::new(0.0105, 0.014, -0.002), Vec3::Z * 0.016, 1);
    let whole = moving(bar());
    let cut_with = |min_piece_m3: f64| {
        let mut tissue = whole.clone();
        let reports = sweep(&mut tissue, &places, &CutOptions { min_piece_m3, ..CutOptions::default() });
        (tissue, reports[1])
    };
    let (both, kept) = cut_with(CutOptions::default().min_piece_m3);
    let (left, burnt) = cut_with(0.4 * whole.volume_m3());
    assert!(kept.parts == 2 && kept.burnt_tets == 0 && burnt.parts == 1 && burnt.burnt_tets > 0, "{kept:?}, {burnt:?}");
    for node in left.rest.tets.iter().flatten().map(|node| *node as usize) {
        let of = |tissue: &Cuttable| (tissue.rest.positions_m[node], tissue.position_m[node], tissue.velocity_m_s[node]);
        assert_eq!(of(&left), of(&both), "node {node}");
    }
    // The momentum of each part, over the density.
    let (part, volumes) = (component_of_each_tet(&both.rest), shape(&both.rest).0);
    let mut of_parts = [(0, DVec3::ZERO); 2];
    for ((tet, volume), part) in both.rest.tets.iter().zip(volumes).zip(part) {
        let (tets, sum) = &mut of_parts[part as usize];
        *tets += 1;
        *sum += tet.map(|node| velocity(&both, node)).iter().sum::<DVec3>() * (volume / 4.0);
    }
    of_parts.sort_by_key(|(tets, _)| *tets != burnt.burnt_tets);
    let [(_, gone), (_, stays)] = of_parts;
    let scale = momentum(&whole).length();
    assert!(gone.length() > 0.2 * scale, "{gone} of {}", momentum(&whole));
    assert!(momentum(&left).distance(stays) <= 1e-9 * scale, "{} is not {stays}", momentum(&left));
    assert!((momentum(&left) + gone).distance(momentum(&whole)) <= 2e-5 * scale, "{gone} were burnt");
}
