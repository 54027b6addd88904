//! What a scene says of looks, optic and light is what the pictures of its station show: rendering asks the tissue for it by rendezvous, and asks
//! the successor of a tissue that died.

use station_tests::{Folder, Station, wait_for};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// A software driver on a busy machine takes seconds for its first pictures.
const PICTURE_LIMIT: Duration = Duration::from_secs(60);

/// The mean colour of a picture's middle half.
fn middle(path: &Path) -> Option<[f64; 3]> {
    let decoder = png::Decoder::new(std::io::BufReader::new(std::fs::File::open(path).ok()?));
    let mut reader = decoder.read_info().ok()?;
    let mut pixels = vec![0; reader.output_buffer_size()?];
    let info = reader.next_frame(&mut pixels).ok()?;
    let (width, height) = (info.width as usize, info.height as usize);
    let inside = |index: &usize| {
        (width / 4..3 * width / 4).contains(&(index % width)) && (height / 4..3 * height / 4).contains(&(index / width))
    };
    let chosen: Vec<&[u8]> =
        pixels.chunks_exact(4).enumerate().filter(|(index, _)| inside(index)).map(|(_, pixel)| pixel).collect();
    Some([0, 1, 2].map(|channel| chosen.iter().map(|pixel| f64::from(pixel[channel])).sum::<f64>() / chosen.len() as f64))
}

fn newest(album: &Path) -> Option<PathBuf> {
    std::fs::read_dir(album)
        .ok()?
        .flatten()
        .map(|entry| entry.path())
        .filter(|path| path.extension().is_some_and(|it| it == "png"))
        .max()
}

/// Waits for a picture, taken after another one, whose middle is as it should be; says what it was last.
fn wait_for_picture(station: &Station, album: &Path, what: &str, after: Option<PathBuf>, is_right: impl Fn([f64; 3]) -> bool) {
    let mut last = None;
    let found = wait_for(PICTURE_LIMIT, || {
        let path = newest(album).filter(|path| Some(path) > after.as_ref())?;
        last = middle(&path).or(last);
        last.filter(|colour| is_right(*colour))
    });
    assert!(found.is_some(), "no picture is {what}; the middle of the last was {last:?}\n{}", station.said());
}

/// Width and height, px, of a picture that is whole.
fn size_of(path: &Path) -> Option<[u32; 2]> {
    let reader = png::Decoder::new(std::io::BufReader::new(std::fs::File::open(path).ok()?)).read_info().ok()?;
    Some([reader.info().width, reader.info().height])
}

/// A thread of lavapipe's rasterizer unlocks a fence that its queue may have freed: it killed a rendering every few hours (docs/faults.md).
fn assert_without_rasterizer_threads(station: &Station) {
    let tasks = std::fs::read_dir(format!("/proc/{}/task", station.pid("rendering", true))).unwrap();
    let names: Vec<String> = tasks.flatten().flat_map(|task| std::fs::read_to_string(task.path().join("comm"))).collect();
    assert!(names.len() > 1, "rendering's threads: {names:?}");
    assert!(!names.iter().any(|name| name.starts_with("llvmpipe-")), "rendering's threads: {names:?}");
}

/// The pictures of a film: each begins and ends as a JPEG does, which nothing within one looks like, and has a size.
fn film_of(path: &Path) -> Vec<[usize; 2]> {
    let bytes = std::fs::read(path).unwrap_or_default();
    let begins: Vec<usize> = (0..bytes.len()).filter(|at| bytes[*at..].starts_with(&[0xff, 0xd8, 0xff])).collect();
    let whole = begins.iter().enumerate().filter_map(|(index, begin)| {
        let picture = &bytes[*begin..begins.get(index + 1).copied().unwrap_or(bytes.len())];
        let frame = picture.windows(2).position(|marker| marker == [0xff, 0xc0])?;
        let side = |at: usize| usize::from(picture[frame + at]) << 8 | usize::from(picture[frame + at + 1]);
        picture.ends_with(&[0xff, 0xd9]).then(|| [side(7), side(5)])
    });
    whole.collect()
}

#[test]
fn a_film_goes_on_where_rendering_died() {
    let folder = Folder::new("looks-film");
    let album = folder.as_path().join("film");
    let shown = album.display().to_string();
    let settings = ["picture_every_s=0.2", "picture_format=mjpeg", "picture_size=640x480"].map(|one| ["--set", one]).concat();
    let station = Station::start("film", &[&["--hand", "idle", "--pictures", shown.as_str()], &settings[..]].concat());
    let count = || film_of(&album.join("pictures.mjpeg")).len();
    let has_more = |than: usize| wait_for(PICTURE_LIMIT, || (count() > than + 2).then_some(()));
    assert!(has_more(0).is_some(), "no film\n{}", station.said());
    station.kill("rendering", true);
    let before = count();
    assert!(has_more(before).is_some(), "it does not go on after {before} pictures\n{}", station.said());
    station.stop().assert_clean();
    let film = film_of(&album.join("pictures.mjpeg"));
    assert!(film.iter().all(|size| *size == [640, 480]), "{film:?}");
    assert_eq!(std::fs::read_dir(&album).map(Iterator::count).ok(), Some(1), "nothing beside it");
}

#[test]
fn the_pictures_follow_the_scenes_looks_and_light_also_after_the_tissue_died() {
    if std::env::var_os("HYSTATION_NO_GPU").is_some() {
        eprintln!("not tried: HYSTATION_NO_GPU is set");
        return;
    }
    let folder = Folder::new("looks");
    let scene = |look: &str, view: &str| {
        format!(
            "version = 1\nname = \"x\"\n[[deformable]]\nname = \"organ\"\nmesh = \"builtin:uterus.msh\"\nscale_to_m = 0.001\n{look}\n\
             [[rigid]]\nname = \"scope\"\n{view}\n"
        )
    };
    let green = folder.write("green.toml", &scene("look = { colour = [0.05, 0.6, 0.05], roughness = 0.9 }", ""));
    let dark = folder.write("dark.toml", &scene("", "[view]\nlight = 0.0"));
    let usual = folder.write("usual.toml", &scene("", ""));
    let is_green = |[red, green, blue]: [f64; 3]| green > red + 20.0 && green > blue + 20.0;
    let is_red = |[red, green, blue]: [f64; 3]| red > green + 20.0 && red > blue + 20.0;
    let is_dark = |colour: [f64; 3]| colour.iter().all(|channel| *channel < 12.0);
    for (name, file, what, is_right) in [
        ("usual", &usual, "red", &is_red as &dyn Fn([f64; 3]) -> bool),
        ("green", &green, "green", &is_green),
        ("dark", &dark, "dark", &is_dark),
    ] {
        let album = folder.as_path().join(name);
        let shown = album.display().to_string();
        let (size, size_px) = if name == "dark" { ("1280x960", [1_280, 960]) } else { ("640x480", [640, 480]) };
        let size = format!("picture_size={size}");
        let arguments = ["--hand", "idle", "--pictures", &shown, "--set", "picture_every_s=0.2", "--set", &size];
        let station = Station::start(name, &[&[file.as_str()], &arguments[..]].concat());
        wait_for_picture(&station, &album, what, None, is_right);
        assert_eq!(newest(&album).and_then(|path| size_of(&path)), Some(size_px), "{name}");
        assert_without_rasterizer_threads(&station);
        if name == "green" {
            station.kill("tissue", true);
            station.kill("rendering", true);
            wait_for_picture(&station, &album, "green again", newest(&album), is_right);
        }
        station.stop().assert_clean();
    }
}
