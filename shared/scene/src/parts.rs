//! Parts of an object that hang apart. The tissue makes an object of each: the largest one that something holds, or the largest of all, is the scene's, and of
//! the others those that nothing holds are free pieces from the beginning.

use crate::loaded::LoadedDeformable;
use hyst_mesh::{
    BindError, Binding, TetMesh, TriangleMesh, bind, boundary, component_count, component_of_each_tet, keep_tets, signed_volume,
};

/// Least volume of a part, m³: a cut burns what is smaller, wherever it lies.
pub const LEAST_PART_M3: f64 = 0.5e-9;
/// Most parts of an object: half of the numbers that there are for objects, for what is cut off takes some.
pub(crate) const MAX_PARTS: usize = 128;

fn volume_m3(mesh: &TetMesh, tet: [u32; 4]) -> f64 {
    signed_volume(tet.map(|node| mesh.positions_m[node as usize].map(f64::from).into()))
}

/// A mesh without the parts that are too small for an object, and how many these are. The largest stays, whatever its size.
///
/// # Errors
/// How many parts there are, if they are too many.
pub(crate) fn without_crumbs(mesh: TetMesh) -> Result<(TetMesh, usize), usize> {
    let part_of_tet = component_of_each_tet(&mesh);
    let mut volumes_m3 = vec![0.0f64; component_count(&part_of_tet)];
    if volumes_m3.len() > MAX_PARTS {
        return Err(volumes_m3.len());
    }
    for (tet, part) in mesh.tets.iter().zip(&part_of_tet) {
        volumes_m3[*part as usize] += volume_m3(&mesh, *tet);
    }
    let least_m3 = volumes_m3.iter().copied().fold(0.0, f64::max).min(LEAST_PART_M3);
    let crumbs = volumes_m3.iter().filter(|volume_m3| **volume_m3 < least_m3).count();
    if crumbs == 0 {
        return Ok((mesh, 0));
    }
    let is_kept: Vec<bool> = part_of_tet.iter().map(|part| volumes_m3[*part as usize] >= least_m3).collect();
    let (left, _) = keep_tets(mesh, &is_kept);
    Ok((left, crumbs))
}

/// The boundary of a mesh, that of each part bound to its own tets: where two parts touch, a vertex lies in tets of both.
pub(crate) fn bind_boundary(mesh: &TetMesh) -> Result<(TriangleMesh, Vec<Binding>), BindError> {
    let part_of_tet = component_of_each_tet(mesh);
    let (mut surface, mut bindings) = (TriangleMesh::default(), Vec::new());
    for part in 0..component_count(&part_of_tet) as u32 {
        let own: Vec<u32> = (0..).zip(&part_of_tet).filter(|(_, of)| **of == part).map(|(tet, _)| tet).collect();
        let tets: Vec<[u32; 4]> = own.iter().map(|tet| mesh.tets[*tet as usize]).collect();
        let of_part = TetMesh { positions_m: mesh.positions_m.clone(), regions: vec![0; tets.len()], tets };
        let (outside, _) = boundary(&of_part).to_mesh(&of_part.positions_m);
        let (bound, _) = bind(&outside, &of_part)?;
        let first = surface.positions_m.len() as u32;
        surface.positions_m.extend(outside.positions_m);
        surface.triangles.extend(outside.triangles.iter().map(|triangle| triangle.map(|vertex| vertex + first)));
        bindings.extend(bound.into_iter().map(|binding| Binding { tet: own[binding.tet as usize], ..binding }));
    }
    Ok((surface, bindings))
}

/// The part of each tet of an object, and whether anything holds each part.
fn held(object: &LoadedDeformable) -> (Vec<u32>, Vec<bool>) {
    let mesh = &object.mesh;
    let part_of_tet = component_of_each_tet(mesh);
    let mut is_rooted = object.fixed.clone();
    object.attach.iter().flat_map(|attach| &attach.nodes).for_each(|root| is_rooted[root.node as usize] = true);
    let is_bed: Vec<bool> = object.regions.iter().map(|region| region.bed_n_m4 > 0.0).collect();
    let is_on_bed = |region: u32| region.checked_sub(1).and_then(|index| is_bed.get(index as usize)) == Some(&true);
    let mut is_held = vec![false; component_count(&part_of_tet)];
    for ((tet, region), part) in mesh.tets.iter().zip(&mesh.regions).zip(&part_of_tet) {
        is_held[*part as usize] |= is_on_bed(*region) || tet.iter().any(|node| is_rooted[*node as usize]);
    }
    (part_of_tet, is_held)
}

/// Volume of what nothing holds of an object, m³, added up as [`hyst_mesh::check`] does.
pub(crate) fn loose_m3(object: &LoadedDeformable) -> f64 {
    let (part_of_tet, is_held) = held(object);
    let loose = object.mesh.tets.iter().zip(&part_of_tet).filter(|(_, part)| !is_held[**part as usize]);
    loose.map(|(tet, _)| volume_m3(&object.mesh, *tet).abs()).sum()
}

/// What is said of an object of several parts, one sentence each; nothing of one that hangs together.
pub(crate) fn notes(object: &LoadedDeformable) -> Vec<String> {
    let (part_of_tet, is_held) = held(object);
    if is_held.len() < 2 {
        return Vec::new();
    }
    let said = format!("{}: {} parts that hang apart, each an object of its own", object.name, is_held.len());
    let free = is_held.iter().filter(|is_held| !**is_held).count();
    let mut notes = vec![if free == 0 {
        format!("{said}; each is held")
    } else {
        let (mm3, cure) = (1e9 * loose_m3(object), "hold them, leave them out, or give parts whose faces fit each other");
        format!("{said}; nothing holds {free} of them ({mm3:.1} mm³), which are loose from the beginning: {cure}")
    }];
    let part = |vertex: u32| part_of_tet[object.bindings[vertex as usize].tet as usize];
    let is_across = |triangle: &&[u32; 3]| triangle.iter().any(|vertex| part(*vertex) != part(triangle[0]));
    let across = object.surface.triangles.iter().filter(is_across).count();
    if across > 0 {
        notes.push(format!("{}: {across} triangles of its surface lie across two parts, and are not drawn", object.name));
    }
    notes
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two tets of one size that lie apart and a crumb of one between them, m.
    fn apart() -> TetMesh {
        let tet = |x: f32, edge: f32| [[x, 0.0, 0.0], [x + edge, 0.0, 0.0], [x, edge, 0.0], [x, 0.0, edge]];
        let positions_m = [tet(0.0, 2e-3), tet(0.01, 1e-3), tet(0.02, 2e-3)].concat();
        TetMesh { positions_m, tets: vec![[0, 1, 2, 3], [4, 5, 6, 7], [8, 9, 10, 11]], regions: vec![1, 2, 3] }
    }

    #[test]
    fn a_part_that_a_cut_would_burn_is_left_out_and_the_largest_never() {
        let (whole, crumb) = (apart(), 1e-9 / 6.0);
        assert!((volume_m3(&whole, whole.tets[1]) - crumb).abs() < 1e-3 * crumb && crumb < LEAST_PART_M3);
        let (left, crumbs) = without_crumbs(whole.clone()).unwrap();
        assert_eq!((crumbs, &left.tets[..], &left.regions[..]), (1, &[[0, 1, 2, 3], [4, 5, 6, 7]][..], &[1, 3][..]));
        assert_eq!(left.positions_m, [&whole.positions_m[..4], &whole.positions_m[8..]].concat());
        assert_eq!(without_crumbs(left.clone()), Ok((left, 0)));
        let alone = TetMesh { positions_m: whole.positions_m[4..8].to_vec(), tets: vec![[0, 1, 2, 3]], regions: vec![0] };
        assert_eq!(without_crumbs(alone.clone()), Ok((alone, 0)), "nothing else is there");
    }

    #[test]
    fn a_mesh_whose_tets_share_no_nodes_is_refused() {
        let tets: Vec<[u32; 4]> = (0..=MAX_PARTS as u32).map(|tet| [0, 1, 2, 3].map(|corner| 4 * tet + corner)).collect();
        let positions_m = apart().positions_m[..4].iter().copied().cycle().take(4 * tets.len()).collect();
        assert_eq!(without_crumbs(TetMesh { positions_m, regions: vec![0; tets.len()], tets }), Err(MAX_PARTS + 1));
    }

    #[test]
    fn where_parts_touch_the_boundary_of_each_follows_its_own_tets() {
        // Two tets on either side of a face, each with nodes of its own there.
        let face = [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let positions_m = [&[[1.0, 0.0, 0.0]][..], &face[..], &[[-1.0, 0.0, 0.0]][..], &face[..]].concat();
        let mesh = TetMesh { positions_m, tets: vec![[1, 0, 2, 3], [4, 5, 6, 7]], regions: vec![0; 2] };
        assert!(mesh.tets.iter().all(|tet| volume_m3(&mesh, *tet) > 0.0));
        let (surface, bindings) = bind_boundary(&mesh).unwrap();
        assert_eq!((surface.positions_m.len(), surface.triangles.len()), (8, 8));
        let tets_of = |triangle: &[u32; 3]| triangle.map(|vertex| bindings[vertex as usize].tet);
        let of: Vec<[u32; 3]> = surface.triangles.iter().map(tets_of).collect();
        assert_eq!(of, [[[0; 3]; 4], [[1; 3]; 4]].concat());
    }
}
