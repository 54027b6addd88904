//! What a scene says of looks, optic and light is what the pictures of its station show: rendering asks the tissue for it by rendezvous, and asks
//! the successor of a tissue that died. What the loop does to tissue and medium is seen in them, too.

use hyst_scene::HandLeg;
use station_tests::shown::not_shown;
use station_tests::{Folder, Station, hystation, run, wait_for};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// A software driver on a busy machine takes seconds for its first pictures.
const PICTURE_LIMIT: Duration = Duration::from_secs(180);

/// A session in lock-step in which a chip is cut, and for how long the hand looks before it does: rendering, for which nobody waits, is there by then.
const SESSION: &str = "17s";
const LOOK_S: f64 = 6.0;
/// Pictures of it, of four a second, without which rendering came too late to have seen the tissue whole.
const LEAST_PICTURES: usize = 44;
/// How many come before the one by which the others are judged: a second, for the looks come after the first.
const FIRST_ONES: usize = 4;
/// Who takes part in it.
const ROLES: &str = "hardware,device,haptic,tissue,fluid,collision-worker,rendering";
/// Vessels that bleed much, and none.
const BLEEDING: &str = "[vessels]\npressure_pa = 11_000.0\nconductance_ml_s_pa = 2e-4\n";
const BLOODLESS: &str = "[vessels]\nconductance_ml_s_pa = 0.0\n";

/// Width, px, and RGBA of a picture.
type Pixels = (usize, Vec<u8>);

fn pixels(path: &Path) -> Option<Pixels> {
    let decoder = png::Decoder::new(std::io::BufReader::new(std::fs::File::open(path).ok()?));
    let mut reader = decoder.read_info().ok()?;
    let mut pixels = vec![0; reader.output_buffer_size()?];
    let info = reader.next_frame(&mut pixels).ok()?;
    Some((info.width as usize, pixels))
}

/// The mean colour of a picture's middle half.
fn middle(path: &Path) -> Option<[f64; 3]> {
    let (width, pixels) = pixels(path)?;
    let height = pixels.len() / 4 / width;
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

/// The hand that cuts a chip from the polyp, as one that looks at it first, from where it looks at the wound afterwards, the loop in.
fn looking_hand() -> String {
    let scene = hyst_scene::load_or_embedded(None).expect("the default scene");
    let legs = &scene.hand("polyp").expect("it has a polyp").legs;
    let is_out = |leg: &HandLeg| leg.is_extended;
    let [first, last] = [legs.iter().position(is_out), legs.iter().rposition(is_out)].map(|leg| leg.expect("it cuts"));
    let back = legs.get(last + 1).expect("the loop goes in");
    let written = |leg: &HandLeg| {
        let [pitch_deg, yaw_deg, roll_deg] = [leg.to.pitch_rad, leg.to.yaw_rad, leg.to.roll_rad].map(f32::to_degrees);
        let to = format!(
            "pitch_deg = {pitch_deg:.5}, yaw_deg = {yaw_deg:.5}, roll_deg = {roll_deg:.5}, insertion_m = {:.6}",
            leg.to.insertion_m
        );
        let electrode = if leg.is_energized { "cut" } else { ["in", "out"][usize::from(leg.is_extended)] };
        format!("    {{ to = {{ {to} }}, time_s = {:.3}, loop = \"{electrode}\" }},\n", leg.time_s)
    };
    let looks = HandLeg { time_s: LOOK_S, ..*back };
    let all: String = [&looks].into_iter().chain(&legs[first..=last + 1]).map(written).collect();
    format!("\n[hand.looks]\ntarget = \"polyp\"\nonce = true\nleg = [\n{all}]\n")
}

/// The pictures of that session from the first on that shows something; `organ` and `polyp` are looks, `vessels` what bleeds.
fn filmed(name: &str, [organ, polyp]: [&str; 2], vessels: &str) -> Vec<Pixels> {
    let folder = Folder::new(&format!("looks-{name}"));
    let scenes = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/scenes");
    let text = std::fs::read_to_string(scenes.join("default.toml")).unwrap();
    let text = text.replace("../meshes", scenes.join("../meshes").to_str().unwrap());
    let text = text.replace("kind = \"organ\"\n", &format!("kind = \"organ\"\n{organ}\n"));
    let text = text.replace("kind = \"pathology\"\n", &format!("kind = \"pathology\"\n{polyp}\n"));
    let scene = folder.write("scene.toml", &format!("{text}\n{vessels}{}", looking_hand()));
    let (album, station) = (folder.as_path().join("album"), format!("f{}-{name}", std::process::id()));
    let mut command = hystation();
    command.args(["--name", &station, "run", "--headless", "--lockstep", &scene, "--hand", "script:looks", "--roles", ROLES]);
    command.args(["--set", "picture_every_s=0.25", "--set", "picture_size=640x480", "--for", SESSION, "--pictures"]).arg(&album);
    let (code, _, said) = run(&mut command);
    assert_eq!(code, Some(0), "{name}: {said}");
    let mut files: Vec<PathBuf> = std::fs::read_dir(&album).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    let all = files.iter().filter_map(|path| pixels(path));
    all.skip_while(|picture| share(picture, |[red, green, blue]| red + green + blue > 90.0) < 0.5).collect()
}

/// The colours of the round field, a little inside of its rim.
fn colours((width, pixels): &Pixels) -> impl Iterator<Item = [f64; 3]> {
    let (width, height) = (*width, pixels.len() / 4 / width);
    let off = move |index: usize, size: usize| (index as f64 + 0.5 - 0.5 * size as f64) / (0.5 * height as f64);
    let inside = (0..width * height).filter(move |at| off(at % width, width).hypot(off(at / width, height)) < 0.95);
    inside.map(move |at| [0, 1, 2].map(|channel| f64::from(pixels[4 * at + channel])))
}

/// The share of such colours in a picture.
fn share(picture: &Pixels, is_such: impl Fn([f64; 3]) -> bool) -> f64 {
    colours(picture).filter(|colour| is_such(*colour)).count() as f64 / colours(picture).count() as f64
}

/// In `docs/resection.png` and `docs/fluid.png` the least green beside red of all that is no blood is a third, and a thousandth of a picture at least is of
/// the wire's orange while it cuts.
#[test]
fn in_the_pictures_of_a_session_the_wire_glows_while_it_cuts_and_there_is_blood_after_that() {
    if std::env::var_os("HYSTATION_NO_GPU").is_some() {
        eprintln!("not tried: HYSTATION_NO_GPU is set");
        return;
    }
    let shots = filmed("blood", ["", ""], BLEEDING);
    if shots.len() < LEAST_PICTURES {
        return not_shown("a cut in pictures: rendering was not there in time");
    }
    let is_hot = |[red, green, blue]: [f64; 3]| red > 180.0 && green > 120.0 && green < 0.95 * red && blue < 0.55 * green;
    let is_blood = |[red, green, _]: [f64; 3]| red > 60.0 && 3.0 * green < red;
    let (before, after) = (&shots[FIRST_ONES], &shots[shots.len() - 1]);
    let hottest = shots.iter().map(|shot| share(shot, is_hot)).fold(0.0, f64::max);
    let [hot, blood] = [[before, after].map(|shot| share(shot, is_hot)), [before, after].map(|shot| share(shot, is_blood))];
    println!("{} pictures; of the wire's orange at most {hottest}, before and after {hot:?}; of blood {blood:?}", shots.len());
    assert!((4e-4..0.03).contains(&hottest) && hot.iter().all(|share| *share < 1e-4), "{hottest} {hot:?}");
    assert!(blood[0] < 1e-3 && blood[1] > 0.01, "{blood:?}");
}

/// The organ is blue, the polyp green, and nothing bleeds: what turns from green to red is the ground of the wound. (Bubbles are reddish, too, and elsewhere.)
#[test]
fn in_the_pictures_of_a_session_the_polyp_has_a_wound_where_it_was_cut() {
    if std::env::var_os("HYSTATION_NO_GPU").is_some() {
        eprintln!("not tried: HYSTATION_NO_GPU is set");
        return;
    }
    let [blue, green] =
        ["0.02, 0.05, 0.9", "0.02, 0.9, 0.05"].map(|colour| format!("look = {{ colour = [{colour}], roughness = 0.9 }}"));
    let shots = filmed("wound", [&blue, &green], BLOODLESS);
    if shots.len() < LEAST_PICTURES {
        return not_shown("a wound in pictures: rendering was not there in time");
    }
    let before = &shots[FIRST_ONES];
    let is_green = |[red, green, blue]: [f64; 3]| green > red + 20.0 && green > blue + 20.0;
    let is_red = |[red, green, blue]: [f64; 3]| red > green + 20.0 && red > blue + 20.0;
    let turned = |picture: &Pixels| {
        let both = colours(before).zip(colours(picture));
        both.filter(|(was, is)| is_green(*was) && is_red(*is)).count() as f64 / colours(before).count() as f64
    };
    let (polyp, [later, cut]) = (share(before, is_green), [FIRST_ONES + 2, shots.len() - 1].map(|at| turned(&shots[at])));
    println!(
        "{} pictures; the polyp has {polyp}, of which {later} are red half a second later and {cut} after the cut",
        shots.len()
    );
    assert!((0.01..0.5).contains(&polyp) && later < 1e-4 && cut > 8e-4, "{polyp} {later} {cut}");
}
