//! The deformation at equal accuracy: blocks with as few substeps as bring them near the solution that is converged in time, which is how many other
//! libraries are given for the same (`tests/peers/beside.py`). The station itself takes more, so that its stiffest modes come to rest sooner.

use super::felt::{distance, farthest};
use super::linear::with_block;
use super::press::{Press, Record};
use super::{FINER, MOST_APART, complete};
use crate::world::Otherwise;
use hyst_scene::LoadedScene;
use hyst_tissue::Isa;
use serde_json::{Value, json};

/// Cells of the blocks, six tets each, that others are given too.
const CELLS: [[usize; 3]; 2] = [[12, 12, 4], [12, 12, 12]];
/// Ticks until a block that the tip is pressed into rests, and those after them over which the force is averaged.
const SETTLING: usize = 1_000;
const AVERAGED: usize = 100;

/// What a block has come to.
struct Rest {
    /// Force on the tool in the mean, N.
    force_n: f64,
    /// How far its nodes are from their places at rest, m.
    moved_m: Vec<[f32; 3]>,
    record: Record,
}

impl Rest {
    fn of(press: &mut Press) -> Result<Rest, String> {
        let (mut record, mut force_n) = (Record::default(), 0.0);
        for tick in 0..SETTLING + AVERAGED {
            press.tick(tick, &mut record)?;
            if tick >= SETTLING {
                force_n += distance(record.force_n, [0.0; 3]) / AVERAGED as f64;
            }
        }
        let moved = |(at, rest): (&[f32; 3], &[f32; 3])| std::array::from_fn(|axis| at[axis] - rest[axis]);
        let moved_m = press.positions_m().iter().zip(press.rest_m()).map(moved).collect();
        Ok(Rest { force_n, moved_m, record })
    }

    /// How far force and displacement are from those of another one, as shares of its largest.
    fn apart(&self, right: &Rest) -> [f64; 2] {
        let most_m = farthest(&right.moved_m, &vec![[0.0; 3]; right.moved_m.len()]);
        [(self.force_n - right.force_n).abs() / right.force_n, farthest(&self.moved_m, &right.moved_m) / most_m]
    }
}

/// A row for each block.
pub fn rows(scene: &LoadedScene) -> Result<Vec<Value>, String> {
    CELLS.iter().map(|cells| row(&with_block(scene, *cells).ok_or("the scene has no deformable object")?)).collect()
}

fn row(scene: &LoadedScene) -> Result<Value, String> {
    let open = |otherwise: Otherwise| Press::with(scene, Isa::detect(), 1, otherwise);
    let right = Rest::of(&mut open(Otherwise { finer: FINER, ..Otherwise::default() })?)?;
    let of_station = Otherwise::default().first_substeps;
    for first_substeps in 1..=of_station {
        let mut press = open(Otherwise { first_substeps, ..Otherwise::default() })?;
        // Too few for the mass that may be added.
        if press.substeps() > first_substeps {
            continue;
        }
        let found = Rest::of(&mut press)?;
        let [force, displacement] = found.apart(&right);
        if force <= MOST_APART && displacement <= MOST_APART {
            let mut row = json!({
                "method": "a block, at equal accuracy",
                "substeps": found.record.substeps,
                "force_apart": force,
                "displacement_apart": displacement,
            });
            complete(&mut row, scene, &press, &found.record, |_| true);
            return Ok(row);
        }
    }
    Err(format!("with {of_station} substeps at the most a block is not near the converged solution"))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Fewer than the station's do, and what is compared can fail: a contact that is stiffer is met with more force.
    #[test]
    fn a_block_rests_where_the_converged_solution_does_with_fewer_substeps_than_the_stations_and_not_with_another_contact() {
        let scene = with_block(&crate::world::load_scene(None).unwrap(), [6, 6, 5]).unwrap();
        let row = row(&scene).unwrap();
        let substeps = row["substeps"].as_u64().unwrap();
        assert!((1..u64::from(Otherwise::default().first_substeps)).contains(&substeps), "{row}");
        let [right, other] = [1.0, 3.0].map(|stiffer| {
            let otherwise = Otherwise { stiffer, ..Otherwise::default() };
            Rest::of(&mut Press::with(&scene, Isa::detect(), 1, otherwise).unwrap()).unwrap()
        });
        assert!(right.force_n > 0.1, "the tip hardly touches: {} N", right.force_n);
        let [force, _] = other.apart(&right);
        assert!(force > MOST_APART, "a contact that is three times as stiff is within {force}");
    }
}
