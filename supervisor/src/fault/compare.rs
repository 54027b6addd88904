//! A fault's window beside its control: whether the two can be compared, and what the window lost beyond the control.

use crate::ledger::Window;

/// Share of a window that may be void: where the host stalled for longer, what is left of it tells nothing of a fault, nor does a control of it.
const MOST_VOID: f64 = 0.2;
/// Fewest windows without a fault of which one in a hundred is left out.
pub const MANY: usize = 100;

/// Whether something can be said of the misses of a window: it has all its ticks, and nearly all of them count.
pub fn tells(window: &Window) -> bool {
    window.is_whole() && window.voided as f64 <= MOST_VOID * (window.ticks + window.voided) as f64
}

/// Misses of a window beyond those of as many counted ticks of its control: the host does not stall in both for equally long. In whole misses; of half a one
/// nobody says on which side it lies, so that it is none.
pub fn excess(window: &Window, control: &Window) -> i64 {
    let scale = window.ticks as f64 / control.ticks.max(1) as f64;
    let beyond = window.missed as f64 - scale * control.missed as f64;
    ((beyond.abs() - 0.5).ceil().max(0.0) * beyond.signum()) as i64
}

/// Most ticks that one of these controls lost: what the host takes by itself is no fault's doing. Of many the hundredth part that lost most does not count, so
/// that a single bad one does not excuse every fault.
pub fn most_missed(controls: impl Iterator<Item = Window>) -> u64 {
    let mut missed: Vec<u64> = controls.filter(tells).map(|control| control.missed).collect();
    missed.sort_unstable();
    missed.len().checked_sub(1 + missed.len() / MANY).and_then(|at| missed.get(at)).copied().unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn window(ticks: u64, missed: u64) -> Window {
        Window { to_tick: 200, ticks, missed, voided: 200 - ticks, ..Window::default() }
    }

    #[test]
    fn of_a_window_that_is_void_for_more_than_a_fifth_or_has_gaps_nothing_is_said() {
        assert_eq!([200, 160, 159, 101].map(|ticks| tells(&window(ticks, 0))), [true, true, false, false]);
        assert!(!tells(&Window { voided: 0, ..window(160, 0) }), "its last ticks are not in the ledger");
    }

    #[test]
    fn the_worst_hundredth_of_many_controls_excuses_nothing_and_one_that_tells_nothing_neither() {
        let most = |windows: &[Window]| most_missed(windows.iter().copied());
        let few = [window(200, 1), window(200, 30), window(159, 90)];
        let many: Vec<Window> = (0..100).map(|index| window(200, if index == 7 { 30 } else { 2 })).collect();
        assert_eq!([most(&[]), most(&few), most(&many[..99]), most(&many)], [0, 30, 30, 2]);
    }

    #[test]
    fn misses_are_compared_with_those_of_as_many_ticks() {
        let beyond = |(ticks, missed), (control_ticks, control_missed)| {
            excess(&window(ticks, missed), &window(control_ticks, control_missed))
        };
        assert_eq!([beyond((200, 3), (200, 1)), beyond((200, 0), (200, 2)), beyond((200, 1), (200, 1))], [2, -2, 0]);
        // Ten misses in 160 ticks are 12.5 in 200, and eight of 200 are 6.4 in 160.
        assert_eq!([beyond((200, 12), (160, 10)), beyond((200, 13), (160, 10)), beyond((200, 14), (160, 10))], [0, 0, 1]);
        assert_eq!([beyond((160, 6), (200, 8)), beyond((160, 7), (200, 8)), beyond((160, 5), (200, 8))], [0, 1, -1]);
        assert_eq!([beyond((200, 1), (160, 1)), beyond((160, 1), (200, 1))], [0, 0], "a miss for a miss");
    }
}
