//! The elastic constants of a deformable object or of a region of it, checked once.
//!
//! Promise: a [`Material`] that exists has finite Lamé constants and a positive density.

/// Largest Poisson ratio that is accepted: the stiffness against a change of volume, and with it the number of substeps, goes up without an end towards 0.5.
pub const POISSON_RATIO_MAX: f64 = 0.49;
/// Largest with which each tet holds its own volume: above it a mesh of tets would lock (6 % too stiff at 0.45, 30 % at 0.49), so nodes hold that of theirs.
const OWN_VOLUME_RATIO_MAX: f64 = 0.45;

/// An isotropic, linear elastic material with damping proportional to mass.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Material {
    youngs_modulus_pa: f64,
    poisson_ratio: f64,
    density_kg_m3: f64,
    damping_per_s: f64,
    bed_n_m4: f64,
}

/// Why a material was refused.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum MaterialError {
    /// Outside 1 Pa to 1 GPa.
    #[error("youngs_modulus_pa is {0}: give a value from 1 to 1e9 (soft tissue: 1e3 to 1e5)")]
    YoungsModulus(f64),
    /// Outside 0 to 0.49.
    #[error("poisson_ratio is {0}: give a value from 0 to 0.49; nearer to 0.5 steps become too short")]
    PoissonRatio(f64),
    /// Outside 1 to 100 000 kg/m³.
    #[error("density_kg_m3 is {0}: give a value from 1 to 1e5 (tissue: about 1050)")]
    Density(f64),
    /// Outside 0 to 10 000 per second.
    #[error("damping_per_s is {0}: give a value from 0 to 1e4 (tissue under water: 5 to 50)")]
    Damping(f64),
    /// Outside 0 to 1e12 N/m⁴.
    #[error("bed_n_m4 is {0}: give a value from 0 to 1e12 (what is around an organ: 1e7 to 1e9)")]
    Bed(f64),
}

impl Material {
    /// Checks the four constants. `damping_per_s` is the rate at which a free velocity decays: v ∝ exp(−damping·t).
    pub fn new(
        youngs_modulus_pa: f64,
        poisson_ratio: f64,
        density_kg_m3: f64,
        damping_per_s: f64,
    ) -> Result<Self, MaterialError> {
        if !(1.0..=1e9).contains(&youngs_modulus_pa) {
            return Err(MaterialError::YoungsModulus(youngs_modulus_pa));
        }
        if !(0.0..=POISSON_RATIO_MAX).contains(&poisson_ratio) {
            return Err(MaterialError::PoissonRatio(poisson_ratio));
        }
        if !(1.0..=1e5).contains(&density_kg_m3) {
            return Err(MaterialError::Density(density_kg_m3));
        }
        if !(0.0..=1e4).contains(&damping_per_s) {
            return Err(MaterialError::Damping(damping_per_s));
        }
        Ok(Self { youngs_modulus_pa, poisson_ratio, density_kg_m3, damping_per_s, bed_n_m4: 0.0 })
    }

    /// The same material on a bed: what is around it, as ligaments, holds it at its place at rest as springs do. `bed_n_m4` is their stiffness, N/m for
    /// each m³ of the material: for a layer of a thickness it is that of the bed by area (Winkler's modulus, N/m³) over the thickness.
    pub fn on_bed(self, bed_n_m4: f64) -> Result<Self, MaterialError> {
        if !(0.0..=1e12).contains(&bed_n_m4) {
            return Err(MaterialError::Bed(bed_n_m4));
        }
        Ok(Self { bed_n_m4, ..self })
    }

    /// The same material with this share of its stiffness, of a tet that holds its own volume: its nodes are to hold that of their other tets as ever.
    pub(crate) fn softened(self, share: f64) -> Self {
        let poisson_ratio = self.poisson_ratio.min(OWN_VOLUME_RATIO_MAX);
        Self { youngs_modulus_pa: self.youngs_modulus_pa * share, poisson_ratio, ..self }
    }

    /// Young's modulus, Pa.
    pub fn youngs_modulus_pa(&self) -> f64 {
        self.youngs_modulus_pa
    }

    /// Poisson's ratio.
    pub fn poisson_ratio(&self) -> f64 {
        self.poisson_ratio
    }

    /// Whether the nodes hold the volume of its tets.
    pub(crate) fn is_nearly_incompressible(&self) -> bool {
        self.poisson_ratio > OWN_VOLUME_RATIO_MAX
    }

    /// Density, kg/m³.
    pub fn density_kg_m3(&self) -> f64 {
        self.density_kg_m3
    }

    /// Rate of decay of a free velocity, 1/s.
    pub fn damping_per_s(&self) -> f64 {
        self.damping_per_s
    }

    /// Stiffness of what holds it at its place at rest, N/m for each m³; 0 for none.
    pub fn bed_n_m4(&self) -> f64 {
        self.bed_n_m4
    }

    /// Second Lamé constant μ (shear modulus), Pa.
    pub fn shear_modulus_pa(&self) -> f64 {
        self.youngs_modulus_pa / (2.0 * (1.0 + self.poisson_ratio))
    }

    /// First Lamé constant λ, Pa.
    pub fn lame_lambda_pa(&self) -> f64 {
        let nu = self.poisson_ratio;
        self.youngs_modulus_pa * nu / ((1.0 + nu) * (1.0 - 2.0 * nu))
    }
}
