//! What can be wrong with the arguments of a contact step. Each message says what, where and what to do.

/// A refused argument. Nothing was written when one of these is returned.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum ContactError {
    /// The cell's edge is not a positive, finite, normal length.
    #[error("cell edge of {cell_m} m for the spatial hash: give a positive length, about the mean edge of the tets")]
    Cell {
        /// Edge that was given, metres.
        cell_m: f32,
    },
    /// More points than the table was sized for.
    #[error("{points} points for a spatial hash sized for {capacity}: size it with HashSizes::for_points({points})")]
    Capacity {
        /// Points given.
        points: usize,
        /// Points that fit.
        capacity: usize,
    },
    /// The words given are too few for the table.
    #[error("spatial hash in {have} words where {need} are needed: loan HashSizes::words() words")]
    Words {
        /// Words given.
        have: usize,
        /// Words needed.
        need: usize,
    },
    /// The words do not hold a table that `HashMut::build` wrote.
    #[error("the words hold no spatial hash ({what}): drop the block and wait for the next tick's")]
    Corrupt {
        /// The first check that failed.
        what: &'static str,
    },
    /// Two arrays that belong together differ in length.
    #[error("{what}: {got} entries where {expected} are needed: pass the arrays of one and the same scene version")]
    Length {
        /// Which array.
        what: &'static str,
        /// Entries needed.
        expected: usize,
        /// Entries given.
        got: usize,
    },
    /// A share that does not exist.
    #[error("share {index} of {count}: the index must be below the count")]
    Share {
        /// Index given.
        index: u32,
        /// Number of shares given.
        count: u32,
    },
}

/// Error unless `got` equals `expected`.
pub(crate) fn same_length(what: &'static str, expected: usize, got: usize) -> Result<(), ContactError> {
    if expected == got { Ok(()) } else { Err(ContactError::Length { what, expected, got }) }
}
