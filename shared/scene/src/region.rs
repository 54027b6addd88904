//! Regions of a deformable object that are made of something else: which tets they have, and of what.
//!
//! They are found where the scene puts the object, before a case moves or mirrors it: its tets take them along. Promise: a region that names nothing is
//! refused, and so is a name of nothing within one.

use crate::error::{SceneError, SceneErrorKind as Kind};
use crate::file::{Deformable, Material};
use crate::fixed::{in_box, in_sphere};
use crate::layer::Skin;
use crate::names::is_name;
use crate::validate::{Checked, coordinate, corners, range, sphere, stuff};
use hyst_mesh::{Place, TetMesh};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};

/// Most regions of an object.
const MAX_REGIONS: usize = 64;
/// Thickest layer: no wall of an organ is thicker.
const MAX_LAYER_M: f64 = 0.1;
/// Stiffest bed: with it a layer of 1 mm stands as firmly as on bone.
const MAX_BED_N_M4: f64 = 1e12;
/// Most tags of a mesh that an error names.
const NAMED_TAGS: usize = 12;

/// A part of a deformable object that is made of something else, as the cervix. What it does not say is as the object's own material has it; where
/// regions overlap, the later one counts.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MaterialRegion {
    /// Name, different from that of the object's other regions.
    pub name: String,
    /// Which tets are of it: those of each entry.
    pub tets: Vec<Part>,
    /// Young's modulus, 1 to 1e9 Pa.
    pub youngs_modulus_pa: Option<f64>,
    /// Poisson ratio, 0 to 0.49.
    pub poisson_ratio: Option<f64>,
    /// Density, 100 to 20 000 kg/m³.
    pub density_kg_m3: Option<f64>,
    /// Share of the velocity lost per second, 0 to 1e4.
    pub damping_per_s: Option<f64>,
    /// Where the figures come from.
    pub source: Option<String>,
    /// Stiffness with which what is around the organ (ligaments, the vagina) holds the region at its place, N/m for each m³ of it, 0 to 1e12: for a
    /// layer the stiffness of the bed by area, N/m³, over the layer's thickness. Default: 0, nothing.
    pub bed_n_m4: Option<f64>,
}

/// A set of tets of an object, by their number in the mesh file or by where the middle of each lies in the scene's frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Part {
    /// Tets with this number in the file: Gmsh's physical group (without one the volume's own), TetGen's attribute, Medit's reference.
    Tag(u32),
    /// Tets within a sphere.
    Sphere {
        /// Its centre.
        centre_m: [f64; 3],
        /// Its radius.
        radius_m: f64,
    },
    /// Tets within a box.
    Box {
        /// Its lowest corner.
        min_m: [f64; 3],
        /// Its highest corner.
        max_m: [f64; 3],
    },
    /// Tets with a z at or below this.
    BelowZM(f64),
    /// Tets with a z at or above this.
    AboveZM(f64),
    /// Tets no farther than this from the wall of a hollow organ's cavity, up to 0.1.
    InnerLayerM(f64),
    /// Tets no farther than this from the rest of the boundary, up to 0.1.
    OuterLayerM(f64),
}

/// A region of an object that is ready for simulation.
#[derive(Debug, Clone, PartialEq)]
pub struct LoadedRegion {
    /// Its name in the scene.
    pub name: String,
    /// What it is made of.
    pub material: Material,
    /// Stiffness of what holds it at its place, N/m for each m³; 0 for nothing.
    pub bed_n_m4: f64,
}

impl MaterialRegion {
    /// What it is made of within an object of a material.
    fn within(&self, own: &Material) -> Material {
        Material {
            youngs_modulus_pa: self.youngs_modulus_pa.unwrap_or(own.youngs_modulus_pa),
            poisson_ratio: self.poisson_ratio.unwrap_or(own.poisson_ratio),
            density_kg_m3: self.density_kg_m3.unwrap_or(own.density_kg_m3),
            damping_per_s: self.damping_per_s.unwrap_or(own.damping_per_s),
            source: self.source.clone().unwrap_or_else(|| own.source.clone()),
        }
    }
}

/// The regions of an object with what each is made of.
pub(crate) fn loaded(object: &Deformable) -> Vec<LoadedRegion> {
    let one = |region: &MaterialRegion| LoadedRegion {
        name: region.name.clone(),
        material: region.within(&object.material),
        bed_n_m4: region.bed_n_m4.unwrap_or(0.0),
    };
    object.region.iter().map(one).collect()
}

/// Checks what the text alone shows of an object's regions.
pub(crate) fn validate(object: &Deformable, key: &str) -> Checked {
    range(format!("{key}.region"), object.region.len() as f64, 0.0, MAX_REGIONS as f64, "entries")?;
    let mut seen = BTreeSet::new();
    for (index, region) in object.region.iter().enumerate() {
        let key = format!("{key}.region[{index}]");
        is_name(&format!("{key}.name"), &region.name)?;
        if !seen.insert(&region.name) {
            let what = format!("two regions of “{}” are named “{}”", object.name, region.name);
            return Err(SceneError::new(
                Kind::Name,
                format!("{key}.name"),
                what,
                "rename one of them, or make them one with more tets",
            ));
        }
        if region.tets.is_empty() {
            let what = format!("“{}” names no tets", region.name);
            let cure = "name some, for example tets = [{ inner_layer_m = 0.004 }] or tets = [{ tag = 2 }]";
            return Err(SceneError::new(Kind::Incomplete, format!("{key}.tets"), what, cure));
        }
        region.tets.iter().enumerate().try_for_each(|(place, part)| validate_part(part, &format!("{key}.tets[{place}]")))?;
        stuff(&region.within(&object.material), &key)?;
        range(format!("{key}.bed_n_m4"), region.bed_n_m4.unwrap_or(0.0), 0.0, MAX_BED_N_M4, "N/m⁴")?;
    }
    Ok(())
}

fn validate_part(part: &Part, key: &str) -> Checked {
    match part {
        Part::Tag(_) => Ok(()),
        Part::Sphere { radius_m, .. } => sphere(key, *radius_m),
        Part::Box { min_m, max_m } => corners(&format!("{key}.box.min_m"), min_m, max_m),
        Part::BelowZM(z) => coordinate(format!("{key}.below_z_m"), *z),
        Part::AboveZM(z) => coordinate(format!("{key}.above_z_m"), *z),
        Part::InnerLayerM(thick_m) => range(format!("{key}.inner_layer_m"), *thick_m, 0.0, MAX_LAYER_M, "m"),
        Part::OuterLayerM(thick_m) => range(format!("{key}.outer_layer_m"), *thick_m, 0.0, MAX_LAYER_M, "m"),
    }
}

/// Refuses a region by a number that a physical group and a volume in none share: nobody knows which of them it means.
pub(crate) fn refuse_shared(object: &Deformable, index: usize, shared: &[(u32, Place)]) -> Checked {
    for (number, region) in object.region.iter().enumerate() {
        for (place, part) in region.tets.iter().enumerate() {
            let Part::Tag(tag) = part else { continue };
            let Some((_, second)) = shared.iter().find(|(shared, _)| shared == tag) else { continue };
            let what = format!(
                "the region “{}”: {} has a physical group {tag} and a volume {tag} in none; at {second} the second of the two begins",
                region.name, object.mesh
            );
            let cure = "put each volume in a physical group, or save without Mesh.SaveAll";
            return Err(SceneError::new(Kind::Name, format!("deformable[{index}].region[{number}].tets[{place}]"), what, cure));
        }
    }
    Ok(())
}

/// Puts into the mesh of an object that stands in its place which region each tet is of, in place of the file's numbers: 0 for none, else the region's, counted
/// from 1. A region of which later ones leave nothing is noted.
pub(crate) fn assign(object: &Deformable, index: usize, mesh: &mut TetMesh, notes: &mut Vec<String>) -> Checked {
    let tags = std::mem::take(&mut mesh.regions);
    let mut region_of = vec![0; mesh.tets.len()];
    let mut skin = None;
    for (number, region) in (1u32..).zip(&object.region) {
        for (place, part) in region.tets.iter().enumerate() {
            let found = tets_of(part, mesh, &tags, &mut skin);
            if found.is_empty() {
                let key = format!("deformable[{index}].region[{}].tets[{place}]", number - 1);
                return Err(nothing(part, region, object, &tags, key));
            }
            found.into_iter().for_each(|tet| region_of[tet] = number);
        }
    }
    for (number, region) in (1u32..).zip(&object.region) {
        if !region_of.contains(&number) {
            notes.push(format!("{}: later regions leave nothing of “{}”; put it behind them", object.name, region.name));
        }
    }
    mesh.regions = region_of;
    Ok(())
}

/// The middle of each tet, m.
fn middles_m(mesh: &TetMesh) -> impl Iterator<Item = [f64; 3]> + '_ {
    let middle = move |tet: &[u32; 4]| {
        let sum = |axis: usize| tet.iter().map(|node| f64::from(mesh.positions_m[*node as usize][axis])).sum::<f64>();
        [0, 1, 2].map(|axis| sum(axis) / 4.0)
    };
    mesh.tets.iter().map(middle)
}

/// The tets of a part. The skin of the mesh is made when a layer first asks for it.
fn tets_of(part: &Part, mesh: &TetMesh, tags: &[u32], skin: &mut Option<Skin>) -> Vec<usize> {
    let of_middles = |is_in: &dyn Fn(&[f64; 3]) -> bool| -> Vec<usize> {
        middles_m(mesh).enumerate().filter(|(_, middle)| is_in(middle)).map(|(tet, _)| tet).collect()
    };
    match part {
        Part::Tag(tag) => tags.iter().enumerate().filter(|(_, of)| *of == tag).map(|(tet, _)| tet).collect(),
        Part::Sphere { centre_m, radius_m } => of_middles(&|middle| in_sphere(middle, centre_m, *radius_m)),
        Part::Box { min_m, max_m } => of_middles(&|middle| in_box(middle, min_m, max_m)),
        Part::BelowZM(z) => of_middles(&|middle| middle[2] <= *z),
        Part::AboveZM(z) => of_middles(&|middle| middle[2] >= *z),
        Part::InnerLayerM(thick_m) | Part::OuterLayerM(thick_m) => {
            let skin = skin.get_or_insert_with(|| Skin::of(mesh));
            let near = skin.near(matches!(part, Part::InnerLayerM(_)), *thick_m);
            of_middles(&|middle| near.has(middle))
        }
    }
}

/// The error about a part that no tet is of.
fn nothing(part: &Part, region: &MaterialRegion, object: &Deformable, tags: &[u32], key: String) -> SceneError {
    let mut known: BTreeMap<u32, usize> = BTreeMap::new();
    tags.iter().for_each(|tag| *known.entry(*tag).or_default() += 1);
    let listed = known.iter().take(NAMED_TAGS).map(|(tag, tets)| format!("{tag} ({tets} tets)")).collect::<Vec<_>>().join(", ");
    let more = if known.len() > NAMED_TAGS { " and more" } else { "" };
    let (kind, asked, cure) = match part {
        Part::Tag(tag) => {
            (Kind::Name, format!("has the tag {tag}"), format!("{} has {listed}{more}: name one of these", object.mesh))
        }
        Part::Sphere { centre_m, radius_m } => {
            (Kind::Apart, format!("is within {radius_m} m of {centre_m:?} m"), "move or enlarge the sphere".to_owned())
        }
        Part::Box { min_m, max_m } => {
            (Kind::Apart, format!("is between {min_m:?} and {max_m:?} m"), "move or enlarge the box".to_owned())
        }
        Part::BelowZM(z) => (Kind::Apart, format!("is below z = {z} m"), "give a higher z, in the scene's frame".to_owned()),
        Part::AboveZM(z) => (Kind::Apart, format!("is above z = {z} m"), "give a lower z, in the scene's frame".to_owned()),
        Part::InnerLayerM(thick_m) => {
            let cure = "only a hollow organ has an inner wall; a layer is to be thicker than half a tet";
            (Kind::Apart, format!("is within {thick_m} m of the wall of its cavity"), cure.to_owned())
        }
        Part::OuterLayerM(thick_m) => {
            let cure = "a layer is to be thicker than half a tet";
            (Kind::Apart, format!("is within {thick_m} m of its outer boundary"), cure.to_owned())
        }
    };
    SceneError::new(kind, key, format!("the region “{}”: no tet of “{}” {asked}", region.name, object.name), cure)
}
