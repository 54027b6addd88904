//! Bands of layers computed by several threads give the bits that one thread gives.

mod scene;

use std::sync::{Barrier, Mutex};

use hyst_flow::{Phase, Solver};

fn assert_sync<T: Sync + Send>(_: &T) {}

/// One step with one thread per band; thread 0 is also the coordinator.
fn step_threads(solver: &Solver, step: u32) {
    let bands = solver.bands();
    let barrier = Barrier::new(bands);
    let current: Mutex<Option<Phase>> = Mutex::new(None);
    solver.begin(&scene::inputs(step)).unwrap();
    std::thread::scope(|scope| {
        for band in 0..bands {
            let (barrier, current) = (&barrier, &current);
            scope.spawn(move || {
                loop {
                    if band == 0 {
                        *current.lock().unwrap() = solver.next_phase().unwrap();
                    }
                    barrier.wait();
                    let Some(phase) = *current.lock().unwrap() else {
                        return;
                    };
                    solver.run_phase(phase, band).unwrap();
                    barrier.wait();
                }
            });
        }
    });
}

fn same_bits(cells: [usize; 3], bands: &[usize], steps: u32) {
    let serial = scene::cavity(cells, 1);
    let mut expected = Vec::new();
    for step in 0..steps {
        serial.step_serial(&scene::inputs(step)).unwrap();
        expected.push(scene::state(&serial));
    }
    for &bands in bands {
        let solver = scene::cavity(cells, bands);
        assert_sync(&solver);
        for step in 0..steps {
            step_threads(&solver, step);
            assert!(scene::state(&solver) == expected[step as usize], "{bands} threads differ from one in step {step}");
        }
    }
}

#[test]
fn two_and_three_threads_give_the_bits_of_one() {
    same_bits([20, 18, 13], &[2, 3], 25);
}

#[test]
fn two_and_three_threads_give_the_bits_of_one_where_coarse_levels_are_parallel_too() {
    same_bits([48, 48, 30], &[2, 3], 6);
}

#[test]
fn any_number_of_bands_gives_the_same_bits_on_one_thread() {
    let states: Vec<_> = [1, 4, 8]
        .into_iter()
        .map(|bands| {
            let solver = scene::cavity([16, 12, 9], bands);
            for step in 0..15 {
                solver.step_serial(&scene::inputs(step)).unwrap();
            }
            scene::state(&solver)
        })
        .collect();
    assert!(states[0] == states[1] && states[0] == states[2]);
}

#[test]
fn a_band_that_does_not_exist_has_no_work() {
    let solver = scene::cavity([16, 12, 9], 2);
    solver.begin(&scene::inputs(0)).unwrap();
    let phase = solver.next_phase().unwrap().unwrap();
    assert_eq!(phase, Phase::Mask);
    assert!(solver.run_phase(phase, 99).is_ok());
}
