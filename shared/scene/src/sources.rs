//! The files that a scene is made of, as they stand: who has them beside each other in the same way has the same scene, to the hash.
//!
//! Promise: no name leads out of the folder that files are unpacked into, and one that would not be found there is refused when it is gathered: a whole path, and
//! one that leads down and up again, or up too far.

use crate::case::{Past, read_case};
use crate::embedded;
use crate::error::{SceneError, SceneErrorKind as Kind};
use crate::file::Scene;
use crate::load::{Found, ReadScene, read_file};
use crate::source::Folder;
use hyst_mesh::companion_name;
use std::io::{Error, ErrorKind, Result as IoResult};
use std::path::{Component, Path, PathBuf};

/// Most files of a scene, and most folders that a name leads up.
const MOST_FILES: usize = 256;
const MOST_UP: usize = 8;

/// A file of a scene.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SourceFile {
    /// Its name as the scene has it, relative to the scene's folder; of the scene itself its own.
    pub name: String,
    /// What it holds.
    pub bytes: Vec<u8>,
}

/// The files of the scene at a path, of a case's scene, or of the default scene where none is named: the scene first, or the mesh that stands for one, then
/// the meshes that it names.
///
/// # Errors
/// A [`SceneError`] about a file that cannot be read, or whose name would not be found elsewhere.
pub fn sources(path: Option<&Path>) -> Result<Vec<SourceFile>, SceneError> {
    let read = match path {
        None => {
            let (scene, text) = (Scene::embedded_default()?, embedded::DEFAULT_SCENE.to_owned());
            ReadScene { scene, text, origin: "default.toml".to_owned(), folder: Folder::Embedded }
        }
        Some(path) => match read_file(path)? {
            Found::Scene(read) => *read,
            Found::Case(text) => read_case(&text, path, Past::Played)?.1,
        },
    };
    let own = Path::new(&read.origin).file_name().and_then(|name| name.to_str()).unwrap_or_default().to_owned();
    let mut files = Vec::new();
    // Around a mesh alone there is no text.
    if !read.text.is_empty() {
        files.push(SourceFile { name: own, bytes: read.text.into_bytes() });
    }
    for (key, name) in named(&read.scene) {
        for name in [Some(name.clone()), companion_name(&name)].into_iter().flatten() {
            if name.starts_with(embedded::PREFIX) || files.iter().any(|file| file.name == name) {
                continue; // whatever has the same binary has it
            }
            if files.len() == MOST_FILES || steps(&name).is_none() {
                let what = format!("“{name}” would not be found in a copy of the scene");
                return Err(
                    SceneError::new(Kind::Missing, key, what, "name it relative to the folder of the scene").at(&read.origin)
                );
            }
            let (bytes, _) = read.folder.mesh(&key, &name).map_err(|error| error.at(&read.origin))?;
            files.push(SourceFile { name, bytes: bytes.into_owned() });
        }
    }
    Ok(files)
}

/// Writes the files of a scene such that it finds them, deep enough within a folder that none is outside of it; gives the path of the scene.
///
/// # Errors
/// A name that no scene's file has, or what the system says.
pub fn unpack(files: &[SourceFile], folder: &Path) -> IoResult<PathBuf> {
    let refused = |name: &str| Error::new(ErrorKind::InvalidInput, format!("“{name}” is no name of a scene's file"));
    let first = files.first().ok_or_else(|| refused(""))?;
    let base = (0..MOST_UP).fold(folder.to_owned(), |folder, _| folder.join("scene"));
    for file in files {
        let steps = steps(&file.name).ok_or_else(|| refused(&file.name))?;
        let path = steps.iter().fold(base.clone(), |mut path, step| {
            match step {
                Some(name) => path.push(name),
                None => drop(path.pop()),
            }
            path
        });
        std::fs::create_dir_all(path.parent().unwrap_or(folder))?;
        std::fs::write(&path, &file.bytes)?;
    }
    // A scene finds what its name leads to only through folders that are there.
    std::fs::create_dir_all(&base)?;
    Ok(base.join(&first.name))
}

/// The steps to a file from the scene's folder, `None` for one up; `None` at all for a name that no scene's copy may have.
fn steps(name: &str) -> Option<Vec<Option<String>>> {
    let mut steps = Vec::new();
    let mut is_name = false;
    for component in Path::new(name).components() {
        match component {
            Component::CurDir => {}
            // A folder that is passed need not be there in a copy, nor be where it seems to be.
            Component::ParentDir if !is_name && steps.len() < MOST_UP => steps.push(None),
            Component::Normal(step) => {
                is_name = true;
                steps.push(Some(step.to_str()?.to_owned()));
            }
            Component::ParentDir | Component::RootDir | Component::Prefix(_) => return None,
        }
    }
    is_name.then_some(steps)
}

/// The names of meshes in a scene, each with the key at which it stands.
fn named(scene: &Scene) -> Vec<(String, String)> {
    let mut named = Vec::new();
    for (index, object) in scene.deformable.iter().enumerate() {
        named.push((format!("deformable[{index}].mesh"), object.mesh.clone()));
        named.extend(object.surface.iter().map(|name| (format!("deformable[{index}].surface"), name.clone())));
    }
    for (index, rigid) in scene.rigid.iter().enumerate() {
        named.extend(rigid.mesh.iter().map(|name| (format!("rigid[{index}].mesh"), name.clone())));
        named.extend(rigid.jaws.iter().map(|jaws| (format!("rigid[{index}].jaws.mesh"), jaws.mesh.clone())));
    }
    named
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_leads_no_further_up_than_there_are_folders_and_to_a_file() {
        let of = |name: &str| steps(name).map(|steps| steps.len());
        assert_eq!([of("a.msh"), of("./a.msh"), of("../meshes/a.msh"), of("a/b.msh")], [Some(1), Some(1), Some(3), Some(2)]);
        let [most, more] = [MOST_UP, MOST_UP + 1].map(|up| format!("{}a", "../".repeat(up)));
        assert_eq!((of(&most), of(&more)), (Some(MOST_UP + 1), None));
        assert_eq!([of("/etc/passwd"), of(".."), of(""), of("."), of("a/../b.msh"), of("a/..")], [None; 6]);
    }

    #[test]
    fn what_is_unpacked_lies_within_its_folder_and_a_name_that_leads_out_of_it_is_refused() {
        let folder = std::env::temp_dir().join(format!("hyst-scene-unpack-{}", std::process::id()));
        let file = |name: &str| SourceFile { name: name.into(), bytes: vec![7] };
        let up = format!("{}a", "../".repeat(MOST_UP));
        let scene = unpack(&[file("s.toml"), file(&up), file("../m/b.msh")], &folder).unwrap();
        assert_eq!(std::fs::read(scene.with_file_name("../m/b.msh")).unwrap(), [7]);
        assert_eq!(std::fs::read(folder.join("a")).unwrap(), [7]);
        for name in ["/tmp/x", "", "..", &format!("../{up}")] {
            let error = unpack(&[file("s.toml"), file(name)], &folder).unwrap_err();
            assert_eq!(error.kind(), ErrorKind::InvalidInput, "{name}");
        }
        assert!(unpack(&[], &folder).is_err());
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
