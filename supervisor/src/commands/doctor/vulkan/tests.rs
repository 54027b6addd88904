//! Machines with drivers and GPUs that are made up.

use super::*;
use crate::commands::doctor::State;
use crate::commands::doctor::made_up::MadeUp;

const SHARE: &str = "usr/share/vulkan/icd.d";

/// The head of a library for a machine of this class and number.
fn library(class: u8, machine: u8) -> Vec<u8> {
    let mut head = vec![0u8; 64];
    head[..4].copy_from_slice(b"\x7fELF");
    (head[4], head[ELF_MACHINE]) = (class, machine);
    head
}

fn manifest(library: &str) -> String {
    format!(
        "{{ \"ICD\": {{ \"api_version\": \"1.3.0\", \"library_path\": \"{library}\" }}, \"file_format_version\": \"1.0.0\" }}"
    )
}

/// A machine with the loader and these drivers; each library lies where Debian puts it.
fn made(name: &str, drivers: &[&str]) -> MadeUp {
    let made = MadeUp::new(name);
    made.write("usr/lib/x86_64-linux-gnu/libvulkan.so.1", library(2, 62));
    for driver in drivers {
        let path = format!("/usr/lib/x86_64-linux-gnu/libvulkan_{driver}.so");
        made.write(&format!("{SHARE}/{driver}_icd.json"), manifest(&path));
        made.write(&path, library(2, 62));
    }
    made
}

/// With a GPU that the kernel drives so.
fn plug(made: &MadeUp, node: &str, kernel: &str) {
    made.link(&format!("sys/class/drm/{node}/device/driver"), &format!("../../../bus/pci/drivers/{kernel}"));
    made.write(&format!("dev/dri/{node}"), "");
}

fn assert_found(made: &MadeUp, state: State, words: &[&str]) {
    let found = pictures(&made.0);
    let said = format!("{}; {}", found.found, found.cure.as_deref().unwrap_or_default());
    assert!(found.state == state && words.iter().all(|word| said.contains(word)), "{state:?} {words:?}: {found:?}");
    assert_eq!(found.cure.is_none(), state == State::Good, "{found:?}");
}

#[test]
fn a_driver_is_one_only_if_its_library_is_there_and_can_be_loaded() {
    let mut made = made("load", &["lvp"]);
    assert_found(&made, State::Good, &["the software driver (libvulkan_lvp.so)"]);
    made.0.lacks = |_| vec!["libLLVM-15.so.1".into()];
    assert_found(&made, State::Weak, &["no driver can be loaded", "needs libLLVM-15.so.1", "apt install mesa-vulkan-drivers"]);
    made.0.lacks = |_| Vec::new();
    let path = "usr/lib/x86_64-linux-gnu/libvulkan_lvp.so";
    made.write(path, "a text");
    assert_found(&made, State::Weak, &["libvulkan_lvp.so is no library"]);
    made.write(path, library(2, 183)); // of arm64: the loader passes over it, too
    assert_found(&made, State::Weak, &["no driver: there are no pictures"]);
    made.write(path, library(1, 3)); // of 32 bits
    assert_found(&made, State::Weak, &["no driver: there are no pictures"]);
    std::fs::remove_file(made.0.path(path)).unwrap();
    assert_found(&made, State::Weak, &["libvulkan_lvp.so is not there", "apt install"]);
    for (text, word) in
        [("{", "is no JSON"), ("{}", "names no library"), ("{\"ICD\": {\"library_path\": 3}}", "names no library")]
    {
        made.write(&format!("{SHARE}/lvp_icd.json"), text);
        assert_found(&made, State::Weak, &[word]);
    }
    std::fs::remove_file(made.0.path("usr/lib/x86_64-linux-gnu/libvulkan.so.1")).unwrap();
    assert_found(&made, State::Weak, &["no loader (libvulkan.so.1)", "libvulkan1"]);
}

#[test]
fn a_gpu_that_may_be_opened_and_has_its_driver_draws_and_what_is_missing_is_named() {
    let mut made = made("gpu", &["lvp", "intel"]);
    assert_found(&made, State::Good, &["the software driver"]);
    plug(&made, "renderD128", "amdgpu");
    assert_found(&made, State::Weak, &["a GPU of amdgpu (/dev/dri/renderD128) for which no driver", "from the software driver"]);
    plug(&made, "renderD129", "i915");
    assert_found(&made, State::Good, &["a GPU of i915 (libvulkan_intel.so, /dev/dri/renderD129)"]);
    made.0.may = |path, _| !path.ends_with("renderD129");
    assert_found(&made, State::Weak, &["a GPU of amdgpu"]);
    std::fs::remove_dir_all(made.0.path("sys/class/drm/renderD128")).unwrap();
    assert_found(&made, State::Weak, &["that this user may not open", "usermod -aG render", "the software driver"]);
    made.0.may = |path, _| path.exists();
    std::fs::remove_file(made.0.path("dev/dri/renderD129")).unwrap();
    assert_found(&made, State::Weak, &["may not open", "--device /dev/dri"]);
    std::fs::remove_file(made.0.path(format!("{SHARE}/lvp_icd.json"))).unwrap();
    assert_found(&made, State::Weak, &["there are no pictures"]);
    std::fs::remove_dir_all(made.0.path("sys/class/drm")).unwrap();
    assert_found(&made, State::Weak, &["libvulkan_intel.so, but no GPU: there are no pictures", "apt install"]);
}

#[test]
fn the_makers_driver_of_nvidia_is_found_by_its_own_node_and_by_the_linkers_folders() {
    let made = made("nvidia", &["lvp"]);
    made.write("etc/vulkan/icd.d/nvidia_icd.json", manifest("libGLX_nvidia.so.0"));
    plug(&made, "renderD128", "nvidia");
    made.write("dev/nvidiactl", "");
    assert_found(
        &made,
        State::Weak,
        &["a GPU of nvidia (/dev/nvidiactl) for which no driver", "libGLX_nvidia.so.0 is not there"],
    );
    made.write("opt/nvidia/lib/libGLX_nvidia.so.0", library(2, 62));
    made.write("etc/ld.so.conf.d/nvidia.conf", "# the maker's\n/opt/nvidia/lib\n");
    assert_found(&made, State::Good, &["a GPU of nvidia (libGLX_nvidia.so.0, /dev/nvidiactl)"]);
}

#[test]
fn the_environment_says_where_drivers_are_instead_of_or_beside_the_folders() {
    let mut made = made("environment", &["lvp"]);
    made.set("VK_ICD_FILENAMES", "/opt/none.json");
    assert_found(&made, State::Weak, &["/opt/none.json: No such file", "unset VK_DRIVER_FILES VK_ICD_FILENAMES"]);
    // Beside the file that names it; the older variable counts only without the newer one, which may name a folder.
    made.write("opt/vulkan/mine.json", manifest("./libvulkan_mine.so"));
    made.write("opt/vulkan/libvulkan_mine.so", library(2, 62));
    made.set("VK_DRIVER_FILES", "/opt/vulkan");
    assert_found(&made, State::Good, &["libvulkan_mine.so"]);
    let mut made = self::made("added", &[]);
    made.write("opt/swiftshader.json", manifest("libvk_swiftshader.so"));
    made.write("opt/lib/libvk_swiftshader.so", library(2, 62));
    made.set("VK_ADD_DRIVER_FILES", "/opt/swiftshader.json");
    assert_found(&made, State::Weak, &["libvk_swiftshader.so is not there"]);
    made.set("LD_LIBRARY_PATH", "/nowhere:/opt/lib");
    assert_found(&made, State::Good, &["the software driver (libvk_swiftshader.so)"]);
    made.set("VK_ADD_DRIVER_FILES", "");
    made.set("HOME", "/home/me");
    made.write("home/me/.local/share/vulkan/icd.d/mine.json", manifest("libvk_swiftshader.so"));
    assert_found(&made, State::Good, &["the software driver (libvk_swiftshader.so)"]);
}

/// One of Wayland was called good, and no window opened there; and none at all was, where no case could be run as it is.
#[test]
fn a_display_is_one_of_x11_and_without_it_one_of_wayland_is_told_what_it_lacks() {
    let mut made = MadeUp::new("display");
    made.set("DISPLAY", "");
    let none = display(&made.0);
    assert!(none.state == State::Weak && none.found.contains("headless"), "{none:?}");
    assert!(none.cure.is_some_and(|cure| cure.contains("`--hand gamepad`") && cure.contains("`--driver FILE`")));
    made.set("WAYLAND_DISPLAY", "wayland-0");
    let wayland = display(&made.0);
    assert!(wayland.state == State::Weak && wayland.found.contains("wayland-0"), "{wayland:?}");
    assert!(wayland.cure.is_some_and(|cure| cure.contains("xwayland")));
    made.set("DISPLAY", ":1");
    assert_eq!((display(&made.0).state, display(&made.0).found), (State::Good, ":1".to_string()));
}
