//! Questions about all entries of a list. All of them are looked at, which takes a few instructions for each line of memory, and less time than to stop at the
//! first one that answers no.

/// Whether all are numbers.
pub fn are_finite(values: &[f32]) -> bool {
    values.iter().fold(true, |all, value| all & value.is_finite())
}

/// Whether all names are below a number.
pub fn are_below(number: usize, names: &[u32]) -> bool {
    names.is_empty() || (names.iter().fold(0, |last: u32, name| last.max(*name)) as usize) < number
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn names_are_below_a_number_when_each_is(names in prop::collection::vec(0..5_u32, 0..9), number in 0..6_usize) {
            prop_assert_eq!(are_below(number, &names), names.iter().all(|name| (*name as usize) < number));
        }
    }
}
