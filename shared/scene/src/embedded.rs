//! The default scene and its meshes inside the binary, so that a binary alone works.

/// The default scene.
pub(crate) const DEFAULT_SCENE: &str = include_str!("../../../assets/scenes/default.toml");

/// Name under which errors speak of the default scene.
pub(crate) const DEFAULT_ORIGIN: &str = "builtin:default.toml";

/// Prefix of a mesh name that means a file inside the binary.
pub(crate) const PREFIX: &str = "builtin:";

/// Every mesh inside the binary, by file name.
const MESHES: [(&str, &[u8]); 4] = [
    ("uterus.msh", include_bytes!("../../../assets/meshes/uterus.msh")),
    ("uterus-surface.obj", include_bytes!("../../../assets/meshes/uterus-surface.obj")),
    ("polyp.msh", include_bytes!("../../../assets/meshes/polyp.msh")),
    ("polyp-surface.obj", include_bytes!("../../../assets/meshes/polyp-surface.obj")),
];

/// A mesh by its file name.
pub(crate) fn mesh(name: &str) -> Option<&'static [u8]> {
    MESHES.iter().find(|(known, _)| *known == name).map(|(_, bytes)| *bytes)
}

/// The names of all meshes, for a message.
pub(crate) fn names() -> String {
    MESHES.map(|(name, _)| format!("{PREFIX}{name}")).join(", ")
}
