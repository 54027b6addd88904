//! What can go wrong while pictures are made, as one line that names the cure. Nothing here ever reaches the haptic side.

/// Errors of this crate. Every message says what, where and what to do.
#[derive(Debug, thiserror::Error)]
pub enum RenderError {
    /// No Vulkan driver on this machine.
    #[error(
        "no Vulkan adapter found ({0}): install mesa-vulkan-drivers and libvulkan1 for software rendering, or run without pictures"
    )]
    NoVulkan(String),
    /// The adapter refused a device.
    #[error("the Vulkan adapter {adapter} gave no device ({reason}): update its driver, or install mesa-vulkan-drivers")]
    NoDevice {
        /// name of the adapter
        adapter: String,
        /// what the driver said
        reason: String,
    },
    /// The graphics device stopped answering or reported an error; everything on it is lost.
    #[error("the graphics device failed ({0}): restart the rendering process")]
    DeviceLost(String),
    /// There is no display, or it went away.
    #[error("no display ({0}): set DISPLAY to a running X server, or run headless")]
    NoDisplay(String),
    /// The window's surface cannot be drawn to with this adapter.
    #[error("the window cannot be drawn to with {adapter} ({reason}): run headless")]
    NoSurface {
        /// name of the adapter
        adapter: String,
        /// what is missing
        reason: String,
    },
    /// A triangle names a vertex that does not exist.
    #[error(
        "object {object}: triangle {triangle} names vertex {vertex} of {vertices}: send the topology that belongs to these vertices"
    )]
    BadTriangle {
        /// the object's id
        object: u64,
        /// number of the triangle
        triangle: usize,
        /// the vertex it names
        vertex: u32,
        /// how many there are
        vertices: usize,
    },
    /// A message's length does not fit the object's topology.
    #[error("object {object}: {got} positions for {expected} vertices: send the topology of this version first")]
    WrongLength {
        /// the object's id
        object: u64,
        /// positions received
        got: usize,
        /// vertices of the topology
        expected: usize,
    },
    /// The id is not on the stage.
    #[error("object {0} is not on the stage: send its topology first")]
    UnknownObject(u64),
    /// An object that would hang on itself.
    #[error("object {object} cannot hang on {on}, which is the same or hangs on it: hang it on another one, or on none")]
    Circle {
        /// the object's id
        object: u64,
        /// what it was to hang on
        on: u64,
    },
    /// A bound of the stage was reached.
    #[error("{what}: {got} is above the bound of {bound}")]
    TooLarge {
        /// what is too large
        what: &'static str,
        /// the size asked for
        got: usize,
        /// the bound
        bound: usize,
    },
    /// A fluid field whose numbers contradict each other.
    #[error("fluid field: {got} values for {dims:?} cells: send x*y*z values, x fastest")]
    BadField {
        /// values received of one kind
        got: usize,
        /// cells per axis
        dims: [u32; 3],
    },
    /// A picture could not be written.
    #[error("cannot write the picture {path}: {reason}")]
    Picture {
        /// the file
        path: String,
        /// what the system said
        reason: String,
    },
}
