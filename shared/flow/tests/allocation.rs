//! A step allocates nothing: counted by an allocator around the system's.
#![allow(unsafe_code)] // the trait of a global allocator is unsafe to implement; both functions hand on to the system's unchanged

mod scene;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

thread_local! {
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

struct Counting;

// SAFETY: every call goes to `System` with the arguments it came with; the counter is a plain thread-local cell without a destructor.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.with(|n| n.set(n.get() + 1));
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

#[test]
fn steps_store_and_load_allocate_nothing() {
    let solver = scene::cavity([16, 16, 10], 2);
    let mut block = scene::state(&solver);
    let before = ALLOCATIONS.with(Cell::get);
    assert!(before > 0, "the counter counts");
    for step in 0..120 {
        solver.step_serial(&scene::inputs(step)).unwrap();
        solver.store(bytemuck::cast_slice_mut(&mut block)).unwrap();
        solver.load(bytemuck::cast_slice(&block)).unwrap();
    }
    let allocations = ALLOCATIONS.with(Cell::get) - before;
    assert_eq!(allocations, 0, "in 120 steps with moving mask, bleeding and jets");
}
