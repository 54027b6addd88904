//! The statistics by which the whole-station tests judge promises about time, by hand.

use station_tests::shown::{Outcome, Promise, lower99_of_difference, lower99_of_mean};

#[test]
fn the_interval_by_hand() {
    // No spread is that of one in ten: 2 − 3.250 · √(0.1 / 10).
    assert!((lower99_of_mean(&[2.0; 10]) - 1.675).abs() < 1e-3);
    // Mean 0.5, standard deviation 0.5270, standard error 0.1667, t = 3.250.
    let halves = [0.0, 1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 1.0];
    assert!((lower99_of_mean(&halves) + 0.0417).abs() < 1e-3);
    // Four are few: 2 − 5.841 · √((1/4) / 4) for equal ones.
    assert!((lower99_of_mean(&[2.0; 4]) - 0.5398).abs() < 1e-3);
    assert_eq!(lower99_of_difference(9.0, 0.0), 9.0 - 2.576 * 3.0);
}

#[test]
fn what_does_not_work_is_broken_what_works_is_held_and_noise_shows_nothing() {
    let promise = Promise { allowed: 1.0, least: 5, most: 101.0 };
    // What does not work costs 20 ticks and more, and is seen in five.
    assert_eq!(promise.outcome(&[20.0, 25.0, 30.0, 22.0, 28.0]), Outcome::Broken);
    assert_eq!(promise.outcome(&[0.0, 1.0, 0.0, -1.0, 2.0]), Outcome::Held);
    assert_eq!(promise.outcome(&[0.0, 1.0]), Outcome::NotShown, "too few");
    assert_eq!(promise.outcome(&[0.0, 40.0, -20.0, 0.0, 1.0]), Outcome::NotShown, "one burst");
    assert_eq!(promise.outcome(&[]), Outcome::NotShown);
    assert_eq!(promise.outcome(&[30.0]), Outcome::NotShown, "one tells nothing of its spread");
}

/// One of seven swaps that lost half a second was not shown.
#[test]
fn one_figure_that_no_stall_of_the_host_explains_breaks_a_promise_whatever_the_mean_shows() {
    let promise = Promise::of_ticks(0.05, 3, 0.0);
    let with_one_of = |ticks: f64| [0.0, 1.0, 0.0, ticks, -1.0, 0.0, 0.0];
    assert!(lower99_of_mean(&with_one_of(500.0)) < 0.0, "the mean shows nothing");
    assert_eq!(promise.outcome(&with_one_of(500.0)), Outcome::Broken);
    assert_eq!(promise.outcome(&with_one_of(50.0)), Outcome::NotShown, "a stall of the host");
    assert_eq!(promise.outcome(&with_one_of(0.0)), Outcome::Held);
    // What is allowed comes on top.
    let of_device = |ticks: f64| Promise::of_ticks(20.0, 3, 0.0).outcome(&[ticks, 5.0, 6.0]);
    assert_eq!([119.0, 121.0].map(of_device), [Outcome::NotShown, Outcome::Broken]);
    // A host that takes as much from a control explains it.
    let of_noise = |worst_control: f64| Promise::of_ticks(0.05, 3, worst_control).outcome(&with_one_of(500.0));
    assert_eq!([499.0, 501.0].map(of_noise), [Outcome::Broken, Outcome::NotShown]);
    let is_accepted = |ticks: f64| std::panic::catch_unwind(|| promise.assert_one("a swap", ticks, String::new)).is_ok();
    assert_eq!([99.0, 101.0, f64::NAN].map(is_accepted), [true, false, false]);
}
