//! What streams may hold when something else is broken: the picture stays, or one error says what is wrong.
mod stand;

use rendering::{Appearance, MAX_OBJECTS, MAX_TRIANGLES, Material, RenderError, SurfaceMesh, shapes};
use stand::*;

#[test]
fn positions_that_are_no_numbers_are_drawn_at_rest() {
    let Some((mut r, cavity)) = in_cavity() else {
        return;
    };
    let before = picture(&mut r, &through_scope());
    let mut poisoned = cavity.positions_m.clone();
    for (n, p) in poisoned.iter_mut().enumerate() {
        *p = match n % 4 {
            0 => [f32::NAN; 3],
            1 => [f32::INFINITY, 0.0, f32::NEG_INFINITY],
            2 => [1e30, -1e30, 1e38],
            _ => *p,
        };
    }
    r.stage().update_positions(CAVITY, &poisoned).unwrap();
    assert_eq!(changed(&before, &picture(&mut r, &through_scope())), 0);
    r.stage().update_positions(CAVITY, &vec![[f32::NAN; 3]; poisoned.len()]).unwrap();
    assert_eq!(changed(&before, &picture(&mut r, &through_scope())), 0);
}

#[test]
fn an_empty_stage_is_a_dark_picture() {
    let Some(mut r) = renderer() else { return };
    let shot = picture(&mut r, &through_scope());
    assert!(shot.chunks_exact(4).all(|p| p[..3].iter().all(|&c| c < 40)));
    let nothing = SurfaceMesh { triangles: &[], rest_m: &[], raw: &[], appearance: Appearance::of(Material::Polyp) };
    r.stage().set_object(7, nothing).unwrap();
    r.stage().update_positions(7, &[]).unwrap();
    assert_eq!(changed(&shot, &picture(&mut r, &through_scope())), 0);
}

#[test]
fn what_does_not_fit_is_refused_and_changes_nothing() {
    let Some((mut r, cavity)) = in_cavity() else {
        return;
    };
    let before = picture(&mut r, &through_scope());
    let bad =
        SurfaceMesh { triangles: &[[0, 1, 99]], rest_m: &[[0.0; 3]; 3], raw: &[], appearance: Appearance::of(Material::Metal) };
    assert!(matches!(r.stage().set_object(CAVITY, bad), Err(RenderError::BadTriangle { object: CAVITY, vertex: 99, .. })));
    let short = r.stage().update_positions(CAVITY, &cavity.positions_m[1..]);
    assert!(matches!(short, Err(RenderError::WrongLength { .. })));
    assert!(matches!(r.stage().update_positions(55, &[]), Err(RenderError::UnknownObject(55))));
    assert_eq!(changed(&before, &picture(&mut r, &through_scope())), 0);
    let dot = SurfaceMesh { triangles: &[], rest_m: &[], raw: &[], appearance: Appearance::of(Material::Polyp) };
    let added = (100..).take(MAX_OBJECTS + 1).filter(|&id| r.stage().set_object(id, dot).is_ok()).count();
    assert_eq!(added, MAX_OBJECTS - 1);
}

#[test]
fn topology_can_change_while_pictures_are_made() {
    let Some((mut r, _)) = in_cavity() else {
        return;
    };
    for rows in [6, 60, 12, 33] {
        put(&mut r, CAVITY, &shapes::cavity(0.045, rows, 24), Material::MucosaTissue);
        assert_eq!(r.render(&through_scope()).unwrap().triangles, u64::from((rows - 1) * 24 * 2));
    }
}

#[test]
fn a_picture_is_written_whole_or_an_error_names_the_file() {
    let Some((mut r, _)) = in_cavity() else {
        return;
    };
    r.resize(101, 67);
    r.render(&through_scope()).unwrap();
    let path = std::env::temp_dir().join(format!("hystation-picture-{}.png", std::process::id()));
    r.save_png(&path).unwrap();
    let info = png::Decoder::new(std::io::BufReader::new(std::fs::File::open(&path).unwrap())).read_info().unwrap().info().size();
    std::fs::remove_file(&path).unwrap();
    assert_eq!(info, (101, 67));
    let text = r.save_png("/nowhere/at/all.png".as_ref()).unwrap_err().to_string();
    assert!(text.contains("/nowhere/at/all.png") && text.lines().count() == 1, "{text}");
}

#[test]
fn a_million_triangles_are_drawn() {
    let Some(mut r) = renderer() else { return };
    put(&mut r, CAVITY, &shapes::cavity(0.045, 1_000, 501), Material::MucosaTissue);
    let stats = r.render(&through_scope()).unwrap();
    assert_eq!(stats.triangles, 999 * 501 * 2);
    let shot = r.read_rgba().unwrap().to_vec();
    assert!(pixel(&shot, WIDTH / 2, HEIGHT / 3)[0] > 40);
}

/// The system gives the memory of what is too many only where it is written or read, and nobody does.
#[test]
fn more_triangles_or_vertices_than_the_bound_are_refused_in_one_line_and_the_picture_stays() {
    let Some((mut r, _)) = in_cavity() else { return };
    let before = picture(&mut r, &through_scope());
    let (triangles, points_m) = (vec![[0_u32; 3]; MAX_TRIANGLES + 1], vec![[0.0_f32; 3]; MAX_TRIANGLES + 1]);
    let appearance = Appearance::of(Material::MucosaTissue);
    for (what, triangles, rest_m) in [("triangles", &triangles[..], &points_m[..3]), ("vertices", &triangles[..1], &points_m[..])]
    {
        let mesh = SurfaceMesh { triangles, rest_m, raw: &[], appearance };
        let text = r.stage().set_object(CAVITY, mesh).unwrap_err().to_string();
        assert_eq!(text, format!("{what}: {} is above the bound of {MAX_TRIANGLES}", MAX_TRIANGLES + 1));
    }
    assert_eq!(changed(&before, &picture(&mut r, &through_scope())), 0);
}
