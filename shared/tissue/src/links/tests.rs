//! Promise of a contact at one moment: it never pulls, and rubs against the sliding with its share of what it pushes with at most.

#[path = "../../tests/common/noise.rs"]
mod random;

use super::*;
use random::noise;

const LAW: ContactLaw = ContactLaw { damping_s: 6e-4, friction: 0.3, most_n: 5.0 };
/// A contact that no damping which integration forbids holds back.
const READY: Ready = Ready { stiffness_n_m: 800.0, most_n_s_m: 1e3, is_softened: false };

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// A vector along a unit vector, and what of it is across.
fn parts(vector: [f32; 3], unit: [f32; 3]) -> (f32, [f32; 3]) {
    let along = dot(vector, unit);
    (along, [0, 1, 2].map(|axis| vector[axis] - along * unit[axis]))
}

/// A contact that is where it sticks.
fn rubbed(normal: &[f32; 3], depth_m: f32, apart_m_s: [f32; 3]) -> Push {
    push(&LAW, normal, &READY, (depth_m, apart_m_s), [0.0; 3])
}

/// By hand: 800 N/m, and three tenths of what it is pressed with at most, whichever way and however fast it goes.
#[test]
fn what_sticks_draws_along_the_plane_as_a_spring_until_it_slides_and_never_with_more_than_its_share() {
    let (mut random, still) = (noise(7), ContactLaw { damping_s: 0.0, ..LAW });
    let (mut slid, mut stuck) = (0, 0);
    for _ in 0..2_000 {
        let direction = [random(), random(), random()];
        let size = dot(direction, direction).sqrt();
        let (normal, pressed_n) = (direction.map(|part| part / size), 1.0 + random());
        let away_m = [random(), random(), random()].map(|part| 1e-3 * part);
        let (_, along_m) = parts(away_m, normal);
        let rub = stick(&still, &READY, (&normal, away_m), pressed_n, [random(), random(), random()]);
        let (drawn_n, most_n) = (800.0 * dot(along_m, along_m).sqrt(), LAW.friction * pressed_n);
        let expected_n = along_m.map(|part| 800.0 * part * (most_n / drawn_n).min(1.0));
        assert!(rub.force_n.iter().zip(expected_n).all(|(found, expected)| (found - expected).abs() < 1e-5), "{rub:?}");
        assert!(rub.bent_m.iter().zip(rub.force_n).all(|(bent, newton)| (800.0 * bent - newton).abs() < 1e-5), "{rub:?}");
        let damped = stick(&LAW, &READY, (&normal, away_m), pressed_n, [random(), random(), random()]);
        assert!(dot(damped.force_n, damped.force_n).sqrt() <= most_n * 1.000_01 && damped.bent_m == rub.bent_m, "{damped:?}");
        slid += usize::from(drawn_n > most_n);
        stuck += usize::from(drawn_n < most_n);
    }
    assert!(slid > 200 && stuck > 200, "{slid} and {stuck}");
}

#[test]
fn a_contact_never_pulls_and_its_friction_is_at_most_its_share_of_the_push_and_against_the_sliding() {
    let mut random = noise(5);
    let (mut full, mut gone) = (0, 0);
    for _ in 0..2_000 {
        let direction = [random(), random(), random()];
        let length = dot(direction, direction).sqrt();
        let (normal, depth_m) = (direction.map(|part| part / length), 1e-3 * (1.0 + random()));
        // From nearly at rest to a few metres a second.
        let speed_m_s = 10.0f32.powf(1.5 * random() - 1.0);
        let apart_m_s = [random(), random(), random()].map(|part| speed_m_s * part);
        let told = rubbed(&normal, depth_m, apart_m_s);
        let ((pushed_n, rubbed_n), (_, slip_m_s)) = (parts(told.force_n, normal), parts(apart_m_s, normal));
        let (friction_n, slides_m_s) = (dot(rubbed_n, rubbed_n).sqrt(), dot(slip_m_s, slip_m_s).sqrt());
        assert!((-1e-5..=LAW.most_n + 1e-5).contains(&pushed_n), "{told:?} along {normal:?}");
        assert!(friction_n <= LAW.friction * pushed_n.max(0.0) + 2e-5, "{told:?} along {normal:?}, {apart_m_s:?} m/s");
        assert!(dot(rubbed_n, slip_m_s) <= 1e-5 * slides_m_s, "{told:?} along {normal:?}, {apart_m_s:?} m/s");
        // Where damping alone would hold it back with more, it is all of that.
        if READY.stiffness_n_m * LAW.damping_s * slides_m_s > LAW.friction * pushed_n.max(0.0) + 2e-5 {
            assert!((friction_n - LAW.friction * pushed_n).abs() < 2e-5, "{told:?} along {normal:?}, {apart_m_s:?} m/s");
            full += 1;
        }
        gone += usize::from(pushed_n.abs() < 1e-5);
    }
    // Some were left so fast that nothing was left of them.
    assert!(full > 300 && gone > 10, "{full} and {gone}");
    assert_eq!(rubbed(&[0.0, 0.0, 1.0], 0.0, [0.1, 0.0, -3.0]), Push::default(), "what is not touched");
}
