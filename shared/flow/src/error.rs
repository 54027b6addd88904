//! The typed errors of the Flow Engine. Each message says what is wrong, where, and what to do.

/// Why a solver was not made, a state was not taken, or a phase did not run.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FlowError {
    /// A grid axis has no cells, too many, or the product is beyond [`crate::MAX_CELLS`].
    #[error("flow grid of {0}×{1}×{2} cells refused: every axis needs 1 to {max_axis} cells and the grid at most {max_cells}; choose a coarser grid",
        max_axis = crate::grid::MAX_AXIS, max_cells = crate::grid::MAX_CELLS)]
    GridSize(usize, usize, usize),
    /// A spacing is not a positive finite length, or the origin is not finite.
    #[error(
        "flow grid geometry refused on axis {axis}: spacing {spacing_m} m, origin {origin_m} m; both must be finite and the spacing 1e-6 to 1 m"
    )]
    GridGeometry {
        /// 0, 1, 2 for x, y, z.
        axis: usize,
        /// The refused spacing, m.
        spacing_m: f32,
        /// The refused origin, m.
        origin_m: f32,
    },
    /// More bands than layers or than [`crate::MAX_BANDS`].
    #[error("{bands} bands refused for {layers} layers: use 1 to {most}")]
    Bands {
        /// Bands asked for.
        bands: usize,
        /// Layers of the grid.
        layers: usize,
        /// The largest number allowed.
        most: usize,
    },
    /// A physical parameter is not finite or out of its range.
    #[error("flow parameter {name} = {value} refused: must be {range}")]
    Parameter {
        /// The field of the model.
        name: &'static str,
        /// Its value.
        value: f64,
        /// The values allowed.
        range: &'static str,
    },
    /// A mask or state block has another length than the grid asks for.
    #[error("{what} has {got} bytes where this grid needs {want}; take the length from the model")]
    Length {
        /// Which block.
        what: &'static str,
        /// Bytes or items handed in.
        got: usize,
        /// Bytes or items needed.
        want: usize,
    },
    /// A block does not begin on the boundary that its numbers need.
    #[error("the flow state begins at an address that is no multiple of 8; hand in an aligned block")]
    Alignment,
    /// The block is no flow state of this version and size.
    #[error(
        "flow state refused: {field} is {got:#x}, expected {want:#x}; it was written by another version, model or grid, or is damaged"
    )]
    State {
        /// Which field of the header.
        field: &'static str,
        /// What the block says.
        got: u64,
        /// What it should say.
        want: u64,
    },
    /// The block has the right form but holds a number that is not finite or out of range.
    #[error("flow state refused: {field} holds a value that is not finite or out of range at index {index}")]
    StateValue {
        /// Which array or counter.
        field: &'static str,
        /// Position in it.
        index: usize,
    },
    /// Two threads ran different phases at once, or one band twice.
    #[error(
        "a flow phase found its layers locked: run each band of a phase once, and the next phase only after all bands have finished"
    )]
    PhaseConflict,
}
