//! One file per format. Each reader turns bytes into a [`Builder`](builder::Builder), which checks the whole.

pub(crate) mod builder;
pub(crate) mod gmsh;
pub(crate) mod gmsh4;
mod gmsh_binary;
pub(crate) mod medit;
pub(crate) mod obj;
pub(crate) mod tetgen;
mod vtk_binary;
pub(crate) mod vtk_legacy;
mod vtk_legacy_binary;
pub(crate) mod vtk_xml;
