//! A step allocates nothing: counted by an allocator that this test installs.
#![allow(unsafe_code)] // implementing GlobalAlloc, the only way to count allocations, is unsafe; it only forwards to System

mod common;

use common::{Body, block, options};
use hyst_tissue::{Material, Model, PlaneSpring, StepInput};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

thread_local! {
    /// Allocations of this thread, so that the test harness's own threads do not count.
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

struct Counting;

// SAFETY: every call is forwarded unchanged to System, which upholds the contract; counting touches no heap memory.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let _ = ALLOCATIONS.try_with(|count| count.set(count.get() + 1));
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn a_step_allocates_nothing() {
    // The second is of nodes that hold the volume of their tets.
    [0.45, 0.48].into_iter().for_each(steps_allocate_nothing);
}

fn steps_allocate_nothing(poisson_ratio: f64) {
    let mesh = block([4, 4, 4], 0.003);
    let fixed: Vec<bool> = mesh.positions_m.iter().map(|p| p[2] == 0.0).collect();
    let material = Material::new(10_000.0, poisson_ratio, 1000.0, 5.0).unwrap();
    let with_contact = hyst_tissue::Options { contact_stiffness_n_m: 100.0, ..options() };
    let mut body = Body::new(Model::new(&mesh, &fixed, &material, with_contact).unwrap().0);
    let force = vec![[0.0, 1e-4, f32::NAN]; mesh.positions_m.len()];
    let springs = [PlaneSpring {
        nodes: [100; 4],
        weights: [0.25; 4],
        normal: [0.0, 0.0, -1.0],
        offset_m: -0.011,
        velocity_m_s: [0.0; 3],
        sticks_at_m: [0.0; 3],
        stiffness_n_m: 500.0,
    }];
    let before = ALLOCATIONS.get();
    for _ in 0..20 {
        body.step_with(&StepInput {
            external_force_n: &force,
            targets_m: &mesh.positions_m,
            springs: &springs,
            ..StepInput::default()
        });
    }
    let during = ALLOCATIONS.get() - before;
    assert_eq!(during, 0, "{during} allocations in 20 steps, ν = {poisson_ratio}");
    let counted = ALLOCATIONS.get();
    drop(vec![1u8; 100]);
    assert_eq!(ALLOCATIONS.get(), counted + 1, "the counter counts");
}
