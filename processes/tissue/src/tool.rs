//! The tool: the rigid object as points, with the area that each stands for and the edges between them.

use glam::{Quat, Vec3};
use hyst_contact::PointGraph;
use hyst_messages::Pose;

/// Neighbours that a point is joined with: a point set on a surface has about six.
const NEIGHBOURS: usize = 6;

/// The tool's model.
#[derive(Clone, Debug)]
pub struct Tool {
    /// Points in the tool's own frame: tip at the origin, shaft along −z, m.
    pub points_m: Vec<[f32; 3]>,
    /// Area that each point stands for, m².
    pub area_m2: Vec<f32>,
    /// Edges between neighbours.
    pub graph: PointGraph,
}

impl Tool {
    /// A tool from its points.
    pub fn new(points_m: Vec<[f32; 3]>) -> Tool {
        let mut edges = Vec::new();
        let mut area_m2 = Vec::with_capacity(points_m.len());
        for (index, point) in points_m.iter().enumerate() {
            let mut others: Vec<(f32, u32)> = points_m
                .iter()
                .enumerate()
                .filter(|(other, _)| *other != index)
                .map(|(other, at)| (Vec3::from(*point).distance_squared(Vec3::from(*at)), other as u32))
                .collect();
            others.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            others.truncate(NEIGHBOURS);
            edges.extend(others.iter().map(|(_, other)| [index as u32, *other]));
            // In a triangular lattice of spacing d each point stands for √3/2·d².
            let mean = others.iter().map(|(squared, _)| squared).sum::<f32>() / others.len().max(1) as f32;
            area_m2.push(0.866 * mean);
        }
        let graph = PointGraph::from_edges(points_m.len(), &edges);
        Tool { points_m, area_m2, graph }
    }

    /// Puts the points where the pose says.
    pub fn place(&self, pose: &Pose, out_m: &mut [[f32; 3]]) {
        let turn = Quat::from_array(pose.orientation);
        let tip = Vec3::from(pose.position_m);
        for (out, point) in out_m.iter_mut().zip(&self.points_m) {
            *out = (tip + turn * Vec3::from(*point)).to_array();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_areas_of_a_flat_square_of_points_add_up_to_it() {
        let points: Vec<[f32; 3]> = (0..400).map(|i| [(i % 20) as f32 * 1e-3, (i / 20) as f32 * 1e-3, 0.0]).collect();
        let tool = Tool::new(points);
        let area: f32 = tool.area_m2.iter().sum();
        assert!((area / 400e-6 - 1.0).abs() < 0.35, "{area}");
    }

    #[test]
    fn a_pose_puts_the_tip_where_it_says() {
        let tool = Tool::new(vec![[0.0; 3], [0.0, 0.0, -0.01]]);
        let quarter = Quat::from_rotation_y(std::f32::consts::FRAC_PI_2);
        let pose = Pose { position_m: [1.0, 2.0, 3.0], orientation: quarter.to_array(), ..Pose::default() };
        let mut out = [[0.0; 3]; 2];
        tool.place(&pose, &mut out);
        assert_eq!(out[0], [1.0, 2.0, 3.0]);
        assert!((out[1][0] - 0.99).abs() < 1e-6, "{out:?}");
    }
}
