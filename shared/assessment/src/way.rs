//! The way of the tip from two sides, as SVG in plain text, before the anatomy where the recording holds it.

use crate::anatomy::{Anatomy, Drawn};
use crate::curves::Curves;
use crate::markup::escape;
use crate::plots::{steps, tidy};
use std::fmt::Write;

/// Size of a side view, and its edge, px.
const SIDE_WIDTH: f64 = 470.0;
const SIDE_HEIGHT: f64 = 300.0;
const EDGE: f64 = 34.0;
/// Least extent of a side view, mm.
const LEAST_MM: f64 = 1.0;
/// And where the anatomy is drawn, which says nothing if it is too large, mm.
const LEAST_BEFORE_MM: f64 = 36.0;

/// From where the way is looked at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Side {
    /// From the patient's left: into the uterus is to the right, anterior is up.
    Left,
    /// From the front: into the uterus is to the right, the patient's right is up.
    Front,
}

impl Side {
    /// Right and up, mm.
    pub(crate) fn of(self, [x_m, y_m, z_m]: [f32; 3]) -> [f64; 2] {
        let up_m = if matches!(self, Side::Left) { y_m } else { x_m };
        [z_m, up_m].map(|value_m| f64::from(value_m) * 1e3)
    }

    /// How far towards the eye, or away from it, m.
    pub(crate) fn depth_m(self, [x_m, y_m, _]: [f32; 3]) -> f32 {
        if matches!(self, Side::Left) { x_m } else { y_m }
    }

    const fn name(self) -> &'static str {
        match self {
            Side::Left => "from-left",
            Side::Front => "from-front",
        }
    }

    fn title(self) -> &'static str {
        match self {
            Side::Left => "from the patient's left, mm: into the uterus →, anterior ↑",
            Side::Front => "from the front, mm: into the uterus →, the patient's right ↑",
        }
    }
}

/// The way of the tip, seen from one side, in true proportion, before the anatomy if that is known.
pub(crate) fn way(curves: &Curves, anatomy: Option<&Anatomy>, side: Side) -> String {
    let points: Vec<[f64; 2]> = curves.trace.points_m().iter().map(|point| side.of(*point)).collect();
    let (Some(first), Some(last)) = (points.first(), points.last()) else {
        return "<p class=\"note\">No pose is recorded.</p>\n".into();
    };
    let peak = curves.peak_at_m.map(|point| side.of(point));
    let bounds = |axis: usize| {
        let values = || points.iter().chain(&peak).map(move |point| point[axis]);
        (values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max))
    };
    let ((left, right), (low, high)) = (bounds(0), bounds(1));
    let least_mm = if anatomy.is_some() { LEAST_BEFORE_MM } else { LEAST_MM };
    let scale_x = (SIDE_WIDTH - 2.0 * EDGE) / (right - left).max(least_mm);
    let scale_y = (SIDE_HEIGHT - 2.0 * EDGE) / (high - low).max(least_mm);
    let scale = scale_x.min(scale_y);
    let x_of = |mm: f64| 0.5 * SIDE_WIDTH + (mm - 0.5 * (left + right)) * scale;
    let y_of = |mm: f64| 0.5 * SIDE_HEIGHT - (mm - 0.5 * (low + high)) * scale;
    let mut svg = format!("<text x=\"{EDGE}\" y=\"14\" class=\"title\">{}</text>", side.title());
    let (half_width, half_height) = ((0.5 * SIDE_WIDTH - EDGE) / scale, (0.5 * SIDE_HEIGHT - EDGE) / scale);
    for mm in steps(0.5 * (left + right) - half_width, 0.5 * (left + right) + half_width, 6) {
        line(&mut svg, [x_of(mm), EDGE], [x_of(mm), SIDE_HEIGHT - EDGE], [x_of(mm), SIDE_HEIGHT - EDGE + 15.0], mm);
    }
    for mm in steps(0.5 * (low + high) - half_height, 0.5 * (low + high) + half_height, 5) {
        line(&mut svg, [EDGE, y_of(mm)], [SIDE_WIDTH - EDGE, y_of(mm)], [0.5 * EDGE, y_of(mm) + 4.0], mm);
    }
    if let Some(anatomy) = anatomy {
        behind(&mut svg, &anatomy.sides[side as usize], side, |[right, up]| [x_of(right), y_of(up)]);
    }
    let text: Vec<String> = points.iter().map(|[right, up]| format!("{:.1},{:.1}", x_of(*right), y_of(*up))).collect();
    let _ = write!(svg, "<polyline class=\"way\" points=\"{}\"/>", text.join(" "));
    for (class, name, point) in [("begin", "begin", Some(*first)), ("end", "end", Some(*last)), ("peak", "largest force", peak)] {
        if let Some([right, up]) = point {
            let (x, y) = (x_of(right), y_of(up));
            let _ =
                write!(svg, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4.5\" class=\"dot {class}\"><title>{name}</title></circle>");
        }
    }
    format!("<svg viewBox=\"0 0 {SIDE_WIDTH} {SIDE_HEIGHT}\" role=\"img\" aria-label=\"{}\">{svg}</svg>\n", escape(side.title()))
}

/// The anatomy from a side, within the frame.
fn behind(svg: &mut String, drawn: &Drawn, side: Side, place: impl Fn([f64; 2]) -> [f64; 2]) {
    let (name, width, height) = (side.name(), SIDE_WIDTH - 2.0 * EDGE, SIDE_HEIGHT - 2.0 * EDGE);
    let _ = write!(
        svg,
        "<clipPath id=\"{name}\"><rect x=\"{EDGE}\" y=\"{EDGE}\" width=\"{width}\" height=\"{height}\"/></clipPath><g clip-path=\"url(#{name})\">"
    );
    for shape in &drawn.shapes_mm {
        let text: Vec<String> = shape.iter().map(|point| place(*point)).map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
        let _ = write!(svg, "<polygon class=\"pathology\" points=\"{}\"/>", text.join(" "));
    }
    let mut path = String::new();
    for [from, to] in drawn.cuts_mm.iter().map(|ends| ends.map(&place)) {
        let _ = write!(path, "M{:.1} {:.1}L{:.1} {:.1}", from[0], from[1], to[0], to[1]);
    }
    let _ = write!(svg, "<path class=\"organ\" d=\"{path}\"/></g>");
}

/// A line of the grid with its number.
fn line(svg: &mut String, [x1, y1]: [f64; 2], [x2, y2]: [f64; 2], [x, y]: [f64; 2], mm: f64) {
    let _ = write!(
        svg,
        "<line x1=\"{x1:.1}\" y1=\"{y1:.1}\" x2=\"{x2:.1}\" y2=\"{y2:.1}\" class=\"grid\"/>\
         <text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"middle\">{}</text>",
        tidy(mm)
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_anatomy_is_drawn_at_the_same_scale_within_the_frame_and_the_way_over_it() {
        let mut curves = Curves::default();
        [[0.0, 0.0, 0.010], [0.0, 0.001, 0.030]].iter().for_each(|tip_m| curves.trace.add(*tip_m));
        let drawn =
            Drawn { cuts_mm: vec![[[10.0, 0.0], [30.0, 1.0]]], shapes_mm: vec![vec![[20.0, 0.0], [21.0, 0.0], [20.0, 1.0]]] };
        let anatomy = Anatomy { sides: [drawn, Drawn::default()] };
        let ends =
            |svg: &str, before: &str, after: &str| svg.split_once(before).unwrap().1.split_once(after).unwrap().0.to_owned();
        let svg = way(&curves, Some(&anatomy), Side::Left);
        let cut = ends(&svg, "class=\"organ\" d=\"M", "\"").replace('L', " ").replace(' ', ",");
        let line = ends(&svg, "class=\"way\" points=\"", "\"").replace(' ', ",");
        assert_eq!(cut, line, "the cut lies where the tip went: {svg}");
        assert!(svg.find("clip-path=\"url(#from-left)\"") < svg.find("class=\"way\""), "behind the way");
        assert_eq!(svg.matches("<polygon").count(), 1);
        assert!(!way(&curves, None, Side::Left).contains("organ"));
    }
}
