//! `tissue check [SCENE] [--isa NAME] [--timed]`: makes the model as the Main Loop would and prints, one sentence a line, what that takes; or says on
//! stderr why it cannot be made, with exit code 2. So a scene that no step can bear, or with `--timed` that this machine is too slow for, is refused before
//! anything starts.

use crate::afford::affordable_step;
use crate::world::{Workshop, isa, load_scene};
use hyst_engine::{Failure, Settings};
use std::path::PathBuf;
use std::process::ExitCode;

/// Runs the check that the arguments ask for; the embedded scene where they name none.
pub fn run(arguments: impl Iterator<Item = String>) -> ExitCode {
    match notes(arguments) {
        Ok(notes) => {
            notes.iter().for_each(|note| println!("{note}"));
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("{error}");
            ExitCode::from(2)
        }
    }
}

fn notes(mut arguments: impl Iterator<Item = String>) -> Result<Vec<String>, Failure> {
    let (mut settings, mut timed) = (Settings::default(), false);
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--isa" => {
                let name = arguments.next().ok_or_else(|| Failure::Input("--isa without a name".into()))?;
                settings.set.insert("isa".into(), name);
            }
            "--timed" => timed = true,
            _ if settings.scene.is_none() && !argument.starts_with('-') => settings.scene = Some(PathBuf::from(argument)),
            _ => {
                return Err(Failure::Input(format!(
                    "unknown argument {argument:?}; expected check [SCENE] [--isa NAME] [--timed]"
                )));
            }
        }
    }
    let scene = load_scene(settings.scene.as_deref())?;
    let (_, mut world) = Workshop::open(&scene, isa(&settings)?)?;
    if timed {
        world.notes.push(format!("on this machine the tissue takes steps of {} ms", affordable_step(&world)?));
    }
    Ok(world.notes)
}
