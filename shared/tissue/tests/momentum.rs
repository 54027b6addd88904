//! Momentum of tissue that moves while it is cut. By volume it is kept, which every sweep of the other tests asserts. Here is the model's: its nodes have the mass
//! of what they are made of, and what is added for the step.

mod common;

use common::cuts::{bar, momentum, parts, shape, shipped, straight, sweep};
use glam::{DVec3, Vec3};
use hyst_mesh::{check, component_of_each_tet};
use hyst_tissue::{CutOptions, Cuttable, Material, Model, ModelError, ModelReport, Options};

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

/// Makes a tissue of two regions, one in each half of its length.
fn in_halves(mut tissue: Cuttable) -> Cuttable {
    let found = check(&tissue.rest);
    let middle_m = 0.5 * (found.min_m[0] + found.max_m[0]);
    let rest = &mut tissue.rest;
    for (tet, region) in rest.tets.iter().zip(&mut rest.regions) {
        *region = u32::from(rest.positions_m[tet[0] as usize][0] > middle_m);
    }
    tissue
}

/// The model as the station makes it: with as few substeps as little enough mass, no more than its own, has to be added for.
fn model_of(tissue: &Cuttable, omega_rest_per_s: Option<f64>) -> (Model, ModelReport) {
    let [first, second] = DENSITIES_KG_M3.map(|density_kg_m3| Material::new(15e3, 0.45, density_kg_m3, 8.0).unwrap());
    let with = |max_substeps: u32| {
        let options = Options {
            max_substeps,
            max_added_mass_ratio: 1.0,
            contact_stiffness_n_m: CONTACT_N_M,
            omega_rest_per_s,
            ..Options::default()
        };
        Model::with_materials(&tissue.rest, &tissue.fixed, &[(0, first), (1, second)], options)
    };
    let made = SUBSTEPS.into_iter().map(with).find(|made| !matches!(made, Err(ModelError::TooStiff { .. })));
    made.expect("substeps that are enough").unwrap()
}

/// A moving tissue with its mass.
struct Seen {
    report: ModelReport,
    /// By the masses of the model, kg·m/s.
    all: DVec3,
    /// By what the tets are made of, without what is added, kg·m/s.
    own: DVec3,
}

fn velocity(tissue: &Cuttable, node: u32) -> DVec3 {
    DVec3::from_array(tissue.velocity_m_s[node as usize].map(f64::from))
}

fn seen(tissue: &Cuttable, omega_rest_per_s: Option<f64>) -> Seen {
    let (model, report) = model_of(tissue, omega_rest_per_s);
    let all = (0..).zip(model.mass_kg()).map(|(node, mass_kg)| velocity(tissue, node) * f64::from(*mass_kg)).sum();
    let of_tet = |(tet, volume_m3): (usize, f64)| {
        let mass_kg = volume_m3 * DENSITIES_KG_M3[tissue.rest.regions[tet] as usize];
        tissue.rest.tets[tet].map(|node| velocity(tissue, node)).iter().sum::<DVec3>() * (mass_kg / 4.0)
    };
    let own = shape(&tissue.rest).0.into_iter().enumerate().map(of_tet).sum();
    Seen { report, all, own }
}

/// How far the velocity of a node that is used is from one, at most, m/s.
fn farthest_m_s(tissue: &Cuttable, from: DVec3) -> f64 {
    tissue.rest.tets.iter().flatten().map(|node| velocity(tissue, *node).distance(from)).fold(0.0, f64::max)
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

#[test]
fn momentum_of_the_model_changes_by_the_mass_that_is_added_for_the_step_and_by_nothing_else() {
    for (name, fresh) in [("bar", bar()), ("polyp", Cuttable::at_rest(shipped("polyp.msh")))] {
        let mut tissue = moving(in_halves(fresh));
        let begun = seen(&tissue, None);
        let told_per_s = Some(begun.report.omega_rest_per_s);
        let (mut before, mut change, mut most_share, mut cuts) = (seen(&tissue, told_per_s), DVec3::ZERO, 0.0f64, 0);
        for places in strokes(&tissue) {
            for place in places {
                let earlier = tissue.clone();
                let reports = sweep(&mut tissue, &[place], &CutOptions::default());
                let after = seen(&tissue, told_per_s);
                // What is burnt takes its own along: below.
                if reports[0].has_changed_mesh() && reports[0].burnt_tets == 0 {
                    let own_kg_m_s = after.own.distance(before.own);
                    // What moved nodes lose is shared out by volume, at the border of the two densities too.
                    assert!(own_kg_m_s <= 5e-3 * before.own.length(), "{name}: {} became {}", before.own, after.own);
                    // Added mass comes with the velocity of its node, which differs from the mean one by so much at most.
                    let mean_m_s = before.own / before.report.mass_kg;
                    let swing_m_s = farthest_m_s(&earlier, mean_m_s).max(farthest_m_s(&tissue, mean_m_s));
                    let [added_kg, new_kg] = [&before, &after].map(|seen| seen.report.added_mass_kg);
                    let allowed = (new_kg - added_kg).abs() * mean_m_s.length() + (new_kg + added_kg) * swing_m_s;
                    let changed = after.all.distance(before.all);
                    assert!(changed <= own_kg_m_s + allowed + 1e-5 * before.all.length(), "{name}: {changed} of {}", before.all);
                    change += after.all - before.all;
                    most_share = most_share.max(changed / before.all.length());
                    cuts += 1;
                }
                before = after;
            }
            tissue.end_stroke();
        }
        let shares = [&begun, &before].map(|seen| 100.0 * seen.report.added_mass_kg / seen.report.mass_kg);
        println!(
            "{name}: momentum changed by {:.2} % in {cuts} sweeps, by {:.2} % in one at most; \
             {:.2} % of the mass were added, then {:.2} %",
            100.0 * change.length() / begun.all.length(),
            100.0 * most_share,
            shares[0],
            shares[1]
        );
        assert!(cuts > 5 && parts(&tissue.rest) > 1 && shares[1] > 0.0, "{name}: {cuts} cuts, {shares:?} % added");
    }
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
