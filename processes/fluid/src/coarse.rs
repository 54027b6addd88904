//! On how many cells the flow of a session is computed: the scene's, or where the machine affords no step of that grid, half as many along each axis, a
//! quarter, …
//!
//! Promise: all fluids of a session have one grid, for the state of one grid is none of another. Who finds first what the machine affords writes it into the
//! station's root, in one step; whoever finds it written takes it from there, a restart and a newcomer too.

use hyst_engine::Failure;
use hyst_exchange::Station;
use hyst_scene::LoadedScene;
use std::io::ErrorKind;
use std::path::PathBuf;

/// Fewest cells along an axis of a grid that was made coarser: a cavity is no wider than a few dozens of millimetres.
const LEAST_CELLS: u32 = 8;
/// Most halvings: 512 cells along an axis become 8.
const MOST_HALVINGS: u32 = 6;

/// The cells of a grid that was halved so many times; `None` if that is none any more.
pub fn halved(cells: [u32; 3], halvings: u32) -> Option<[u32; 3]> {
    let coarse = cells.map(|count| count.div_ceil(1 << halvings.min(MOST_HALVINGS)));
    let is_grid = halvings == 0 || halvings <= MOST_HALVINGS && coarse.iter().all(|count| *count >= LEAST_CELLS);
    is_grid.then_some(coarse)
}

fn file(station: &Station) -> PathBuf {
    station.root().join("fluid-halvings")
}

/// How many times the scene's grid is halved in this session, if somebody has found that out.
pub fn agreed(station: &Station) -> Option<u32> {
    let text = std::fs::read_to_string(file(station)).ok()?;
    text.trim().parse().ok().filter(|halvings| *halvings <= MOST_HALVINGS)
}

/// The cells along x, y, z on which the flow of a station is computed, for an engine that comes to it: those that were found, or the scene's where nobody has
/// found any yet.
pub fn cells_of(station: &Station, scene: &LoadedScene) -> [usize; 3] {
    cells_on(scene, agreed(station).unwrap_or(0))
}

/// The cells of the scene's grid, halved so many times; its own where that is no grid any more.
pub fn cells_on(scene: &LoadedScene, halvings: u32) -> [usize; 3] {
    let grid = scene.fluid.grid;
    halved(grid, halvings).unwrap_or(grid).map(|count| count as usize)
}

/// Says, as an incarnation, how many times it is to be; gives how many times it is, which another may have said before.
pub fn agree(station: &Station, incarnation: u32, halvings: u32) -> Result<u32, Failure> {
    let failed = |error: std::io::Error| Failure::Broken(format!("{}: {error}", file(station).display()));
    let own = file(station).with_extension(incarnation.to_string());
    std::fs::write(&own, format!("{halvings}\n")).map_err(failed)?;
    let linked = std::fs::hard_link(&own, file(station));
    std::fs::remove_file(&own).map_err(failed)?;
    match linked {
        Err(error) if error.kind() != ErrorKind::AlreadyExists => Err(failed(error)),
        Err(_) => agreed(station).ok_or_else(|| Failure::Broken(format!("{} says nothing", file(station).display()))),
        Ok(()) => Ok(halvings),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_grid_is_halved_along_each_axis_as_long_as_there_is_a_cavity_to_be_seen() {
        assert_eq!(halved([32, 18, 32], 0), Some([32, 18, 32]));
        assert_eq!(halved([128, 57, 128], 2), Some([32, 15, 32]));
        assert_eq!(halved([32, 18, 32], 2), None);
        assert_eq!(halved([4, 4, 4], 0), Some([4, 4, 4]), "the scene's own is one whatever it is");
        assert_eq!(halved([512, 512, 512], 60), None);
    }

    #[test]
    fn the_first_word_about_the_grid_counts() {
        let station = Station::named(&format!("t{}-fluid-agree", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        assert_eq!(agreed(&station), None);
        let scene = hyst_scene::load_or_embedded(None).unwrap();
        assert_eq!(cells_of(&station, &scene), scene.fluid.grid.map(|count| count as usize));
        assert_eq!((agree(&station, 7, 1).unwrap(), agree(&station, 8, 2).unwrap()), (1, 1));
        assert_eq!(agreed(&station), Some(1));
        assert_eq!(cells_of(&station, &scene), halved(scene.fluid.grid, 1).unwrap().map(|count| count as usize), "a newcomer's");
        std::fs::write(file(&station), "99").unwrap();
        assert_eq!(agreed(&station), None, "nonsense is nobody's word");
        station.wipe();
    }

    /// Incumbent and spare as threads of one process wrote one file, and the later of the two found none.
    #[test]
    fn two_of_one_process_agree() {
        let station = Station::named(&format!("t{}-fluid-two", std::process::id())).unwrap();
        for _ in 0..50 {
            station.wipe();
            station.found().unwrap();
            let said = std::thread::scope(|scope| {
                let station = &station;
                let agree = move |incarnation: u32| agree(station, incarnation, incarnation).unwrap();
                [1, 2].map(|incarnation| scope.spawn(move || agree(incarnation))).map(|thread| thread.join().unwrap())
            });
            assert!(said[0] == said[1] && agreed(&station) == Some(said[0]), "{said:?}");
        }
        station.wipe();
    }
}
