//! What is done at once has the bits of what is done one after the other.

use super::*;

/// Numbers from −1 to 1.
fn numbers(seed: u64, count: usize) -> Vec<f32> {
    let mut x = seed;
    let mut number = || {
        x = x.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (x >> 40) as f32 / (1u64 << 23) as f32 - 1.0
    };
    (0..count).map(|_| number()).collect()
}

fn bits(row: &[f32]) -> Vec<u32> {
    row.iter().map(|x| x.to_bits()).collect()
}

#[test]
fn what_is_done_at_once_has_the_bits_of_one_after_the_other() {
    let (stride, weights, beta) = (37, [1.1, 0.7, 0.3], 0.6);
    for n in [1, 8, 35, 200] {
        let planes = [1, 2, 3].map(|seed| numbers(seed, n + 2 * stride + 2));
        let star = Star::new(planes.each_ref().map(|plane| plane.as_slice()), stride + 1, stride, n);
        // Some half of the cells are solid.
        let diagonal: Vec<f32> = numbers(4, n).iter().map(|x| larger(*x, 0.0)).collect();
        let v: Vec<f32> = diagonal.iter().map(|d| if *d > 0.0 { 0.9 / d } else { 0.0 }).collect();
        let (r, before) = (numbers(5, n), numbers(6, n));
        let image: Vec<f32> =
            (0..n).map(|i| if diagonal[i] > 0.0 { diagonal[i] * star.c[i] - star.around(i, weights) } else { 0.0 }).collect();

        let mut out = before.clone();
        fine_operator(&mut out, &diagonal, &star, weights);
        assert_eq!(bits(&out), bits(&image), "{n}");
        let (mut sum, mut apart) = (before.clone(), before.clone());
        fine_residual(&mut sum, &r, &diagonal, &star, weights);
        add_residual(&mut apart, &r, &image);
        assert_eq!(bits(&sum), bits(&apart), "{n}");
        fine_smooth(&mut out, [&v[..], &r[..]], &diagonal, &star, weights);
        smooth(&mut apart, star.c, &v, &r, &image);
        assert_eq!(bits(&out), bits(&apart), "{n}");
        let (mut d, mut q) = (before.clone(), r.clone());
        fine_direction(&mut d, &mut q, &diagonal, &star, weights, beta);
        let next: [Vec<f32>; 2] =
            [(0..n).map(|i| star.c[i] + beta * before[i]).collect(), (0..n).map(|i| image[i] + beta * r[i]).collect()];
        assert_eq!([bits(&d), bits(&q)], next.map(|row| bits(&row)), "{n}");
        correct(&mut out, &r, &v, &before);
        let fluid: Vec<f32> = (0..n).map(|i| if diagonal[i] > 0.0 { v[i] * r[i] + before[i] } else { 0.0 }).collect();
        assert_eq!(bits(&out), bits(&fluid), "{n}");
    }
}

#[test]
fn rows_are_the_same_if_no_cell_differs() {
    for n in [0, 1, 7, 16, 33] {
        let row = numbers(1, n);
        assert!(are_same(&row, &row.clone()), "{n}");
        for at in 0..n {
            let mut other = row.clone();
            other[at] += 1.0;
            assert!(!are_same(&row, &other), "{n} {at}");
        }
    }
}

#[test]
fn a_diagonal_is_the_sum_of_the_open_faces_and_a_cell_without_any_has_no_inverse() {
    let (stride, weights, damping) = (41, [1.1, 0.7, 0.3], 0.9f32);
    let inverse = |diagonal: f32| if diagonal > 0.0 { damping / diagonal } else { 0.0 };
    for n in [1, 8, 35] {
        let cells = |seed: u64| -> Vec<f32> {
            numbers(seed, n + 2 * stride + 2).iter().map(|x| if *x > 0.0 { 1.0 } else { 0.0 }).collect()
        };
        let planes = [1, 2, 3].map(cells);
        let star = Star::new(planes.each_ref().map(|plane| plane.as_slice()), stride + 1, stride, n);
        let (mut d, mut v) = (vec![0.0; n], vec![0.0; n]);
        fine_diagonal(&mut d, &mut v, &star, weights, damping);
        for i in 0..n {
            let own = star.c[i] * star.around(i, weights);
            assert_eq!([d[i].to_bits(), v[i].to_bits()], [own.to_bits(), inverse(own).to_bits()], "{n} {i}");
        }
        let faces = [4, 5, 6, 7, 8, 9].map(|seed| numbers(seed, n));
        coarse_diagonal(&mut d, &mut v, faces.each_ref().map(|face| face.as_slice()), damping);
        for i in 0..n {
            let own = faces[0][i] + faces[1][i] + faces[2][i] + faces[3][i] + faces[4][i] + faces[5][i];
            assert_eq!([d[i].to_bits(), v[i].to_bits()], [own.to_bits(), inverse(own).to_bits()], "{n} {i}");
        }
    }
}
