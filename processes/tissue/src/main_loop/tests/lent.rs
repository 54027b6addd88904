//! Promise of the Main Loop about the memory that it is lent for a state: what has no room in it waits.

use super::*;

/// The record with the current came after the memory was lent by the one before: the first state of a stroke found no room in it, and the process ended.
#[test]
fn a_current_that_comes_on_after_the_loan_cuts_from_the_next_step_on() {
    let (station, pages, life, mut inbox) = begun("lent");
    let mut main = engine(&station, &life, &mut inbox);
    let whole = Arc::clone(&main.world);
    let now = first_state(&mut main);
    let lent = main.next_bytes(bytemuck::cast_slice(&now));
    assert!(lent < main.message_bytes(), "{lent} bytes are as many as a cut may take");
    pages[1].push(device::INPUTS, 1, &sweeping(&whole, 1));
    let mut next = vec![0u64; lent / 8];
    main.step(&context(2), bytemuck::cast_slice(&now), bytemuck::cast_slice_mut(&mut next)).unwrap();
    assert_eq!((core_of(&next).is_cutting, parts_of(&next).2), (0, 0), "there is no room for a stroke");
    assert!(main.accepts(bytemuck::cast_slice(&next)));
    let stroke = fed(&mut main, &pages[1], &next, &sweeping(&whole, 2));
    assert!(core_of(&stroke).is_cutting == 1 && parts_of(&stroke).2 > 0, "it begins as soon as there is");
    drop(main);
}
