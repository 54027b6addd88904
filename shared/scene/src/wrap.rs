//! A scene around a mesh alone: the organ in front of the default instrument.

use crate::error::{SceneError, SceneErrorKind as Kind};
use crate::file::Scene;
use std::path::Path;

/// The scene that a mesh alone stands for. Nothing is read yet.
pub(crate) fn around_mesh(path: &Path) -> Result<Scene, SceneError> {
    let origin = path.display().to_string();
    let Some(file) = path.file_name().and_then(|name| name.to_str()) else {
        let what = "this is no file name in UTF-8";
        return Err(SceneError::new(Kind::Missing, "", what, "give the path of a scene (.toml) or of a mesh").at(&origin));
    };
    let quoted = toml::Value::String(file.to_owned());
    let text = format!(
        "version = 1\nname = {quoted}\n[[deformable]]\nname = \"organ\"\nmesh = {quoted}\nplace = \"auto\"\n\
         [[rigid]]\nname = \"hysteroscope\"\n"
    );
    Scene::parse(&text, &origin)
}
