//! Where pictures come from: the drivers that the Vulkan loader would find (its document LoaderDriverInterface.md says where it looks), as far as files tell
//! it without loading one; which GPUs the kernel has a driver of, and whether this user may use them; and the window.

use super::{Finding, Machine};
use rustix::fs::Access;
use serde_json::Value;
use std::path::{Path, PathBuf};

const WHAT: &str = "Vulkan";
const INSTALL: &str = "`apt install mesa-vulkan-drivers libvulkan1`: the software driver is enough";

/// Folders of libraries that are looked through without being named anywhere.
const LIBRARY_FOLDERS: [&str; 6] =
    ["/lib/x86_64-linux-gnu", "/usr/lib/x86_64-linux-gnu", "/lib64", "/usr/lib64", "/lib", "/usr/lib"];
/// What stands in the names of the libraries of drivers that need no GPU.
const IN_SOFTWARE: [&str; 2] = ["vulkan_lvp", "swiftshader"];
/// Drivers of the kernel, and what stands in the names of the libraries that go with them.
const OF_KERNEL: [(&str, &[&str]); 7] = [
    ("i915", &["intel"]),
    ("xe", &["intel"]),
    ("amdgpu", &["radeon", "amdvlk"]),
    ("radeon", &["radeon"]),
    ("nvidia", &["nvidia"]),
    ("nouveau", &["nouveau"]),
    ("virtio_gpu", &["virtio", "gfxstream"]),
];

/// First bytes of a 64-bit ELF file, and its machine, x86-64, at [`ELF_MACHINE`].
const ELF: [u8; 5] = *b"\x7fELF\x02";
const ELF_MACHINE: usize = 18;
const X86_64: [u8; 2] = [62, 0];

/// A GPU that the kernel drives.
struct Gpu {
    /// By which of its drivers.
    kernel: String,
    /// What is opened to use it.
    node: String,
}

/// Whether pictures are drawn, and by what.
pub fn pictures(machine: &Machine) -> Finding {
    if find_library(machine, "libvulkan.so.1", Path::new("/")).is_none() {
        return Finding::weak(WHAT, "no loader (libvulkan.so.1): there are no pictures", INSTALL);
    }
    let (drivers, faults) = drivers(machine);
    let software = drivers.iter().find(|driver| is_any_of(driver, &IN_SOFTWARE));
    let software_name = software.map(|driver| format!("the software driver ({driver})"));
    let gpus = gpus(machine);
    let of_gpu = |gpu: &Gpu| drivers.iter().find(|driver| goes_with(driver, &gpu.kernel));
    let may_open = |gpu: &&Gpu| (machine.may)(&machine.path(&gpu.node), Access::READ_OK | Access::WRITE_OK);
    if let Some((gpu, driver)) = gpus.iter().filter(may_open).find_map(|gpu| Some((gpu, of_gpu(gpu)?))) {
        return Finding::good(WHAT, format!("a GPU of {} ({driver}, {})", gpu.kernel, gpu.node));
    }
    let instead = software_name.clone().map_or("there are no pictures".into(), |name| format!("pictures come from {name}"));
    if let Some(gpu) = gpus.first() {
        let found = format!("a GPU of {} ({})", gpu.kernel, gpu.node);
        return if of_gpu(gpu).is_none() {
            let cure = "`apt install mesa-vulkan-drivers`, for one of nvidia the maker's driver";
            Finding::weak(WHAT, format!("{found} for which no driver can be loaded{}: {instead}", told(&faults)), cure)
        } else {
            let cure = "`sudo usermod -aG render,video $USER` and log in again; docker: --device /dev/dri, --gpus all";
            Finding::weak(WHAT, format!("{found} that this user may not open: {instead}"), cure)
        };
    }
    match (software_name, faults.is_empty()) {
        (Some(name), _) => Finding::good(WHAT, name),
        // What needs none of the GPUs that are known here may find its own.
        (None, true) if drivers.iter().any(|driver| OF_KERNEL.iter().all(|(kernel, _)| !goes_with(driver, kernel))) => {
            Finding::good(WHAT, drivers.join(", "))
        }
        (None, true) if drivers.is_empty() => Finding::weak(WHAT, "no driver: there are no pictures", INSTALL),
        (None, true) => Finding::weak(WHAT, format!("{}, but no GPU: there are no pictures", drivers.join(", ")), INSTALL),
        (None, false) => {
            let cure = if asked(machine).is_some() {
                "`unset VK_DRIVER_FILES VK_ICD_FILENAMES`, or name what is there; else "
            } else {
                ""
            };
            Finding::weak(
                WHAT,
                format!("no driver can be loaded{}: there are no pictures", told(&faults)),
                format!("{cure}{INSTALL}"),
            )
        }
    }
}

fn told(faults: &[String]) -> String {
    if faults.is_empty() { String::new() } else { format!(" ({})", faults.join("; ")) }
}

fn is_any_of(library: &str, words: &[&str]) -> bool {
    words.iter().any(|word| library.contains(word))
}

fn goes_with(library: &str, kernel: &str) -> bool {
    OF_KERNEL.iter().any(|(known, words)| *known == kernel && is_any_of(library, words))
}

/// The drivers that can be loaded, by the names of their libraries and in the loader's order, and what is wrong with others.
fn drivers(machine: &Machine) -> (Vec<String>, Vec<String>) {
    let (mut drivers, mut faults) = (Vec::new(), Vec::new());
    for manifest in manifests(machine) {
        match driver(machine, &manifest) {
            Ok(Some(driver)) if !drivers.contains(&driver) => drivers.push(driver),
            Ok(_) => {}
            Err(why) => faults.push(why),
        }
    }
    (drivers, faults)
}

/// The files and folders that the loader is told to look at instead of its own.
fn asked<'m>(machine: &'m Machine) -> Option<&'m str> {
    machine.variable("VK_DRIVER_FILES").or_else(|| machine.variable("VK_ICD_FILENAMES"))
}

/// The files that name drivers, in the loader's order.
fn manifests(machine: &Machine) -> Vec<PathBuf> {
    let list = |text: &str| text.split(':').filter(|path| !path.is_empty()).map(PathBuf::from).collect::<Vec<_>>();
    let places = match asked(machine) {
        Some(asked) => list(asked),
        None => {
            let home = |variable: &str, folder: &str| {
                let of_home = || Some(Path::new(machine.variable("HOME")?).join(folder));
                machine.variable(variable).map(PathBuf::from).or_else(of_home)
            };
            let or = |variable: &str, folders: &'static str| list(machine.variable(variable).unwrap_or(folders));
            let above = [
                home("XDG_CONFIG_HOME", ".config").into_iter().collect(),
                or("XDG_CONFIG_DIRS", "/etc/xdg"),
                vec![PathBuf::from("/usr/local/etc"), PathBuf::from("/etc")],
                home("XDG_DATA_HOME", ".local/share").into_iter().collect(),
                or("XDG_DATA_DIRS", "/usr/local/share:/usr/share"),
            ];
            let added = machine.variable("VK_ADD_DRIVER_FILES").map(list).unwrap_or_default();
            added.into_iter().chain(above.concat().into_iter().map(|folder| folder.join("vulkan/icd.d"))).collect()
        }
    };
    let of_place = |place: PathBuf| match machine.path(&place).is_dir() {
        true => machine.names(&place).into_iter().filter(|name| name.ends_with(".json")).map(|name| place.join(name)).collect(),
        // A folder of the loader's own need not be there; what was asked for is said to be missing when it is read.
        false if place.ends_with("vulkan/icd.d") => Vec::new(),
        false => vec![place],
    };
    places.into_iter().flat_map(of_place).collect()
}

/// The driver that a file names, if it can be loaded; none if it is for programs of another machine, whose file the loader passes over, too.
fn driver(machine: &Machine, manifest: &Path) -> Result<Option<String>, String> {
    let refuse = |why: &str| format!("{}: {why}", manifest.display());
    let text = std::fs::read_to_string(machine.path(manifest)).map_err(|error| refuse(&error.to_string()))?;
    let said: Value = serde_json::from_str(&text).map_err(|_| refuse("is no JSON"))?;
    let library = said["ICD"]["library_path"].as_str().ok_or_else(|| refuse("names no library"))?;
    let found = find_library(machine, library, manifest.parent().unwrap_or(Path::new("/")));
    let found = found.ok_or_else(|| refuse(&format!("{library} is not there")))?;
    let mut head = [0u8; ELF_MACHINE + X86_64.len()];
    let file = std::fs::File::open(&found).map_err(|error| refuse(&format!("{library}: {error}")))?;
    if std::io::Read::read_exact(&mut &file, &mut head).is_err() || !head.starts_with(&ELF[..4]) {
        return Err(refuse(&format!("{library} is no library")));
    }
    if !head.starts_with(&ELF) || head[ELF_MACHINE..] != X86_64 {
        return Ok(None);
    }
    match (machine.lacks)(&found).as_slice() {
        [] => Ok(Path::new(library).file_name().map(|name| name.to_string_lossy().into_owned())),
        lacking => Err(refuse(&format!("{library} needs {}, which is not there", lacking.join(", ")))),
    }
}

/// Where the linker finds a library; one with a folder in its name lies there, as seen from the file that names it.
fn find_library(machine: &Machine, name: &str, from: &Path) -> Option<PathBuf> {
    let is_there = |path: &PathBuf| path.is_file();
    if name.contains('/') {
        return Some(machine.path(from.join(name))).filter(is_there);
    }
    let told = machine.variable("LD_LIBRARY_PATH").map(|folders| folders.split(':').map(str::to_string).collect::<Vec<_>>());
    let files = machine.names("/etc/ld.so.conf.d").into_iter().filter(|name| name.ends_with(".conf"));
    let files = ["/etc/ld.so.conf".to_string()].into_iter().chain(files.map(|name| format!("/etc/ld.so.conf.d/{name}")));
    let lines = files.map(|file| machine.text(file)).collect::<String>();
    let set = lines.lines().map(str::trim).filter(|line| line.starts_with('/')).map(str::to_string).collect::<Vec<_>>();
    let folders = told.unwrap_or_default().into_iter().chain(set).chain(LIBRARY_FOLDERS.map(String::from));
    folders.map(|folder| machine.path(Path::new(&folder).join(name))).find(is_there)
}

/// The GPUs that the kernel drives.
fn gpus(machine: &Machine) -> Vec<Gpu> {
    let nodes = machine.names("/sys/class/drm").into_iter().filter(|name| name.starts_with("renderD"));
    let drawn = nodes.filter_map(|name| {
        let kernel = machine.linked(format!("/sys/class/drm/{name}/device/driver"))?;
        Some(Gpu { kernel, node: format!("/dev/dri/{name}") })
    });
    let mut gpus: Vec<Gpu> = drawn.collect();
    // The maker's driver opens its own node, and has the others only with a display.
    if machine.path("/dev/nvidiactl").exists() {
        gpus.retain(|gpu| gpu.kernel != "nvidia");
        gpus.insert(0, Gpu { kernel: "nvidia".into(), node: "/dev/nvidiactl".into() });
    }
    gpus
}

/// Whether there is a window to be had: it is one of X11.
pub fn display(machine: &Machine) -> Finding {
    match (machine.variable("DISPLAY"), machine.variable("WAYLAND_DISPLAY")) {
        (Some(display), _) => Finding::good("display", display),
        (None, Some(wayland)) => Finding::weak(
            "display",
            format!("{wayland} of Wayland alone, and the window is one of X11: the station runs headless, with a scripted hand"),
            "`apt install xwayland` and log in again; then DISPLAY is set, too",
        ),
        (None, None) => Finding::weak(
            "display",
            "none: the station runs headless, a scene with a scripted hand, and a case is refused unless its hand is named",
            "start it in a terminal of the desktop; or name the hand: `--hand gamepad`, `--hand spacemouse` or `--driver FILE`",
        ),
    }
}

#[cfg(test)]
mod tests;
