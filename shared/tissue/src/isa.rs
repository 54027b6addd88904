//! The instruction set that a model computes with: chosen once, part of what a recording names.
//!
//! Promise: the same set gives the same bits on every machine; AVX2 and AVX-512 give the same bits as each other.

/// Instruction set of the kernels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Isa {
    /// One lane, no fused multiply-add: runs everywhere, the slow reference.
    Baseline,
    /// 8 lanes with fused multiply-add (x86-64-v3).
    Avx2,
    /// 16 lanes with fused multiply-add (x86-64-v4).
    Avx512,
}

impl Isa {
    /// The widest set that this machine has.
    pub fn detect() -> Self {
        [Isa::Avx512, Isa::Avx2].into_iter().find(|isa| isa.available()).unwrap_or(Isa::Baseline)
    }

    /// Whether this machine has it.
    pub fn available(self) -> bool {
        match self {
            Isa::Baseline => true,
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2 => pulp::x86::V3::try_new().is_some(),
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 => pulp::x86::V4::try_new().is_some(),
            #[cfg(not(target_arch = "x86_64"))]
            _ => false,
        }
    }

    /// Its name on the command line: `baseline`, `avx2`, `avx512`.
    pub fn name(self) -> &'static str {
        match self {
            Isa::Baseline => "baseline",
            Isa::Avx2 => "avx2",
            Isa::Avx512 => "avx512",
        }
    }

    /// The set of that name.
    pub fn from_name(name: &str) -> Option<Self> {
        [Isa::Baseline, Isa::Avx2, Isa::Avx512].into_iter().find(|isa| isa.name() == name)
    }
}
