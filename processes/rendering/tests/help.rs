//! The help over the picture: it can be read, keeps to its corner, and leaves the trainee the view.
mod stand;

use hyst_messages::controls::WINDOW_ALL;
use rendering::{Overlay, ROWS, help};
use stand::*;

/// The smallest picture that a station makes, px.
const SIZE_PX: [u32; 2] = [640, 480];
/// From the picture's edge to the text, and a character's cell, px.
const EDGE: u32 = 6;
const CELL: [u32; 2] = [7, 11];

#[test]
fn the_help_can_be_read_keeps_to_its_corner_and_leaves_the_view() {
    let Some((mut r, _)) = in_cavity() else { return };
    let [width, height] = SIZE_PX;
    r.resize(width, height);
    let mut view = through_scope();
    let plain = picture(&mut r, &view);
    let above = ["01:01   30 pictures/s", "pressure   70 mmHg, set 75", ""].map(String::from);
    let lines: Vec<String> = above.into_iter().chain(help(WINDOW_ALL)).collect();
    let rows = lines.len() as u32;
    assert!(lines.len() < ROWS);
    view.overlay = Overlay { lines: lines.clone(), sign: String::new() };
    let written = picture(&mut r, &view);
    let at = |shot: &[u8], x: u32, y: u32| -> [u8; 3] {
        let at = 4 * (y * width + x) as usize;
        [shot[at], shot[at + 1], shot[at + 2]]
    };
    let cell = |x: u32, y: u32| {
        let [column, row] = [(x, 0), (y, 1)].map(|(px, axis)| px.checked_sub(EDGE).map(|px| px / CELL[axis]));
        let length = row.and_then(|row| lines.get(row as usize)).map_or(0, |line| line.len() as u32);
        column.zip(row).filter(|(column, _)| *column < length)
    };
    let mut ink = vec![0; rows as usize];
    let mut covered = 0;
    for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
        let (before, after) = (at(&plain, x, y), at(&written, x, y));
        let Some((_, row)) = cell(x, y) else {
            assert_eq!(before, after, "{x}, {y} is beside the text");
            continue;
        };
        let is_ink = after.iter().zip([219, 242, 230]).all(|(channel, of_ink)| channel.abs_diff(of_ink) <= 1);
        ink[row as usize] += u32::from(is_ink);
        assert!(is_ink || after.iter().zip(before).all(|(after, before)| *after <= before), "{x}, {y} is brighter, and no ink");
        let from_middle = (x as f32 - 0.5 * width as f32).hypot(y as f32 - 0.5 * height as f32);
        covered += u32::from(from_middle < 0.5 * height as f32);
    }
    for (line, ink) in lines.iter().zip(&ink) {
        let letters = line.chars().filter(|c| *c != ' ').count() as u32;
        assert!((5 * letters..25 * letters + 1).contains(ink), "{ink} pixels of ink for {line:?}");
    }
    let field = std::f32::consts::FRAC_PI_4 * (height * height) as f32;
    assert!(covered as f32 <= 0.2 * field, "{:.0} % of the view are covered", 100.0 * covered as f32 / field);
    view.overlay = Overlay::default();
    assert_eq!(picture(&mut r, &view), plain, "it leaves nothing behind");
}

/// Letters of 5 × 7 pixels are two millimetres wide on a desk's display: an alarm could be read no better than the rate of the pictures.
#[test]
fn an_alarm_is_written_twice_as_wide_and_high_as_other_words_and_in_amber() {
    let Some((mut r, _)) = in_cavity() else { return };
    r.resize(SIZE_PX[0], SIZE_PX[1]);
    let mut drawn_px = |line: &str, ink: [u8; 3]| {
        let mut view = through_scope();
        view.overlay = Overlay { lines: vec![line.into()], sign: String::new() };
        let is_ink = |pixel: &&[u8]| pixel.iter().zip(ink).all(|(channel, of_ink)| channel.abs_diff(of_ink) <= 1);
        picture(&mut r, &view).chunks_exact(4).filter(is_ink).count()
    };
    let [usual, large] =
        [(" ALARM  deficit", [219, 242, 230]), ("ALARM  deficit", [255, 189, 51])].map(|(line, ink)| drawn_px(line, ink));
    println!("{usual} pixels of ink as other words are written, {large} of an alarm");
    assert!(usual > 100 && large == 4 * usual, "{usual} {large}");
}
