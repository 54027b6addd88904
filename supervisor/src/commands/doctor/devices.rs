//! What the hand may hold: gamepads and 3D mice, which the station reads itself; haptic devices, for which somebody has a driver; and the driver of a
//! station that runs as a service. What is plugged in is read of the kernel, which tells everybody; whether this user may use it, of the nodes.

use super::{Finding, Machine};
use rustix::fs::Access;
use std::path::{Path, PathBuf};

/// Axes and buttons by which a gamepad and a 3D mouse are known, as `processes/device` knows them (codes of `input-event-codes.h`).
const FIRST_AXES: [usize; 2] = [0, 1];
const ALL_AXES: [usize; 6] = [0, 1, 2, 3, 4, 5];
const BUTTON_SOUTH: usize = 0x130;
const BUTTON_0: usize = 0x100;

/// Haptic devices by the vendor on the USB, and by the product where the vendor's number is not theirs alone; and whose they are.
const HAPTIC: [(&str, Option<&str>, &str); 4] = [
    ("1451", None, "Force Dimension"),
    ("2988", None, "3D Systems (OpenHaptics)"),
    ("0301", Some("2988"), "3D Systems (OpenHaptics)"),
    ("0403", Some("cb48"), "Novint Falcon"),
];
/// Deepest folder below a USB device in which the kernel names a node of it.
const DEEPEST: usize = 4;

const UNIT: &str = "hystation.service";

/// One of the managers of systemd that may have the service.
struct Manager {
    /// Where it looks for a unit, its additions first; the first place that has it counts.
    folders: Vec<PathBuf>,
    /// The folder that its units call `%h`.
    home: String,
    /// How its service is called here, and what edits it.
    unit: String,
    edit: &'static str,
}

/// That of who asks, whose service has their window, and the machine's.
fn managers(machine: &Machine) -> [Manager; 2] {
    let home = machine.variable("HOME").unwrap_or("/");
    let settings = machine.variable("XDG_CONFIG_HOME").map_or_else(|| Path::new(home).join(".config"), PathBuf::from);
    let places = |kind: &str| ["/etc/systemd", "/run/systemd", "/usr/lib/systemd"].map(|place| Path::new(place).join(kind));
    let of_user = [settings.join("systemd/user")].into_iter().chain(places("user")).collect();
    let [home, root] = [home, "/root"].map(str::to_string);
    [
        Manager { folders: of_user, home, unit: format!("the user's {UNIT}"), edit: "systemctl --user edit" },
        Manager { folders: places("system").into(), home: root, unit: UNIT.into(), edit: "sudo systemctl edit" },
    ]
}

/// All of them.
pub fn findings(machine: &Machine) -> Vec<Finding> {
    let mut findings: Vec<Finding> = pads(machine).iter().map(|pad| pad.finding(machine)).collect();
    findings.extend(haptic_devices(machine));
    if findings.is_empty() {
        let found = "none is plugged in: the simulated one, held by the mouse in a window, or by a script";
        findings.push(Finding::good("device", found));
    }
    findings.extend(managers(machine).iter().filter_map(|manager| service(machine, manager)));
    findings
}

/// A gamepad or a 3D mouse.
struct Pad {
    /// As `--hand` calls it.
    hand: &'static str,
    what: &'static str,
    name: String,
    vendor: String,
    node: String,
}

/// Those that the kernel says it has, each a paragraph of `/proc/bus/input/devices`.
fn pads(machine: &Machine) -> Vec<Pad> {
    machine.text("/proc/bus/input/devices").split("\n\n").filter_map(pad).collect()
}

fn pad(text: &str) -> Option<Pad> {
    let line = |head: &str| text.lines().find_map(|line| line.strip_prefix(head)).unwrap_or_default();
    let [keys, absolute, relative] = ["B: KEY=", "B: ABS=", "B: REL="].map(|head| bits(line(head)));
    let turns = |axis: &usize| has(&absolute, *axis) || has(&relative, *axis);
    let (hand, what) = if has(&keys, BUTTON_SOUTH) && FIRST_AXES.iter().all(turns) {
        ("gamepad", "gamepad")
    } else if has(&keys, BUTTON_0) && !has(&keys, BUTTON_SOUTH) && ALL_AXES.iter().all(turns) {
        ("spacemouse", "3D mouse")
    } else {
        return None;
    };
    let node = line("H: Handlers=").split_whitespace().find(|word| word.starts_with("event"))?;
    let vendor = line("I: ").split_whitespace().find_map(|word| word.strip_prefix("Vendor=")).unwrap_or_default();
    let name = line("N: Name=").trim_matches('"').to_string();
    Some(Pad { hand, what, name, vendor: vendor.to_string(), node: format!("/dev/input/{node}") })
}

/// The words of a set of bits, the last first; none if it is no such set.
fn bits(text: &str) -> Vec<u64> {
    text.split_whitespace().rev().map(|word| u64::from_str_radix(word, 16)).collect::<Result<_, _>>().unwrap_or_default()
}

fn has(bits: &[u64], bit: usize) -> bool {
    bits.get(bit / 64).is_some_and(|word| word >> (bit % 64) & 1 == 1)
}

impl Pad {
    fn finding(&self, machine: &Machine) -> Finding {
        let Pad { hand, what, name, vendor, node } = self;
        let found = format!("{name}, {node}");
        let path = machine.path(node);
        if !path.exists() {
            let cure = format!("docker: --device {node}; else look whether udev runs (`systemctl status systemd-udevd`)");
            Finding::weak(what, format!("{found}, which is not there"), cure)
        } else if !(machine.may)(&path, Access::READ_OK) {
            let rule = format!("SUBSYSTEM==\"input\", KERNEL==\"event*\", ATTRS{{id/vendor}}==\"{vendor}\", TAG+=\"uaccess\"");
            Finding::weak(what, format!("{found}, which this user may not read"), cure_of(&rule, "input"))
        } else {
            Finding::good(what, format!("{found}: `run --hand {hand}`"))
        }
    }
}

/// Where the cure's rule goes: behind the package's file, which one of its name would take the place of, and before 73-seat-late.rules, which grants it.
const OWN_RULES: &str = "/etc/udev/rules.d/71-hystation-local.rules";

/// How a user gets the right to open a node: by a rule for whoever sits at the machine, or by a group.
fn cure_of(rule: &str, group: &str) -> String {
    format!(
        "put `{rule}` into {OWN_RULES}, `sudo udevadm control --reload && sudo udevadm trigger`, and plug it in \
         again; or `sudo usermod -aG {group} $USER` and log in again"
    )
}

/// Haptic devices on the USB. A driver opens the device itself, or the serial port or the raw node that the kernel made of it.
fn haptic_devices(machine: &Machine) -> Vec<Finding> {
    const FOLDER: &str = "/sys/bus/usb/devices";
    let read = |device: &str, file: &str| machine.text(format!("{FOLDER}/{device}/{file}")).trim().to_string();
    let of_device = |device: String| {
        let (vendor, product) = (read(&device, "idVendor"), read(&device, "idProduct"));
        let is_known = |(of, only, _): &&(&str, Option<&str>, &str)| *of == vendor && only.is_none_or(|only| only == product);
        let (_, _, maker) = HAPTIC.iter().find(is_known)?;
        let number = |file: &str| read(&device, file).parse::<u32>().unwrap_or_default();
        let mut nodes = vec![format!("/dev/bus/usb/{:03}/{:03}", number("busnum"), number("devnum"))];
        made_nodes(&machine.path(format!("{FOLDER}/{device}")), DEEPEST, &mut nodes);
        let found = format!("{maker} ({vendor}:{product}, {})", nodes.join(", "));
        let may = |node: &&String| (machine.may)(&machine.path(node), Access::READ_OK | Access::WRITE_OK);
        Some(match nodes.iter().rfind(may) {
            Some(_) => Finding::good("haptic device", format!("{found}: `run --driver FILE` with its driver (docs/driver.md)")),
            None => {
                let rule = format!("ATTRS{{idVendor}}==\"{vendor}\", ATTRS{{idProduct}}==\"{product}\", TAG+=\"uaccess\"");
                let is_port = nodes.iter().any(|node| node.contains("/tty"));
                let cure = cure_of(&rule, if is_port { "dialout" } else { "plugdev" });
                Finding::weak("haptic device", format!("{found}, which this user may not open"), cure)
            }
        })
    };
    machine.names(FOLDER).into_iter().filter_map(of_device).collect()
}

/// Adds the nodes that the kernel made of a device: the names in folders `tty` and `hidraw` below it.
fn made_nodes(folder: &Path, deepest: usize, nodes: &mut Vec<String>) {
    let Some(deepest) = deepest.checked_sub(1) else { return };
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    // A link leads out of the device.
    let mut folders: Vec<PathBuf> =
        entries.filter(|entry| entry.file_type().is_ok_and(|kind| kind.is_dir())).map(|entry| entry.path()).collect();
    folders.sort_unstable();
    for folder in folders {
        let names_nodes = folder.ends_with("tty") || folder.ends_with("hidraw");
        if !names_nodes {
            made_nodes(&folder, deepest, nodes);
            continue;
        }
        let named = std::fs::read_dir(&folder).into_iter().flatten().flatten();
        nodes.extend(named.map(|node| format!("/dev/{}", node.file_name().to_string_lossy())));
    }
}

/// The driver that a manager's service is set up with, if it is.
fn service(machine: &Machine, manager: &Manager) -> Option<Finding> {
    let (file, unit) = (option_of_service(machine, manager, "--driver")?, &manager.unit);
    Some(match (machine.refuses)(&machine.path(&file)) {
        None => Finding::good("driver", format!("{file}, of {unit}")),
        Some(why) => {
            let cure =
                format!("`{} {UNIT}` names another one, or none; `hystation conformance driver FILE` tries it", manager.edit);
            Finding::bad("driver", format!("{file}, of {unit}, does not do: {why}"), cure)
        }
    })
}

/// What the services record into, as their commands name it, each with how it is called here, and whether it is this user's.
pub fn recordings(machine: &Machine) -> Vec<(PathBuf, String, bool)> {
    let [own, machines] = managers(machine);
    let of = |manager: Manager, is_own: bool| {
        let path = option_of_service(machine, &manager, "--record")?;
        Some((PathBuf::from(path), manager.unit, is_own))
    };
    [of(own, true), of(machines, false)].into_iter().flatten().collect()
}

/// What the command of a manager's service gives with an option, if it has that.
fn option_of_service(machine: &Machine, manager: &Manager, option: &str) -> Option<String> {
    let line = command_of_service(machine, &manager.folders)?;
    let mut words = line.split_whitespace().map(|word| word.trim_matches(['"', '\'']));
    let value = loop {
        let word = words.next()?;
        if let Some(value) = word.strip_prefix(option).and_then(|rest| rest.strip_prefix('=')) {
            break value;
        }
        if word == option {
            break words.next()?;
        }
    };
    Some(value.replace("%h", &manager.home))
}

/// What starts the service: the last command of the unit and of what an operator added to it, as systemd reads them.
fn command_of_service(machine: &Machine, folders: &[PathBuf]) -> Option<String> {
    let has_unit = |folder: &&PathBuf| machine.path(folder.join(UNIT)).is_file();
    let unit = folders.iter().find(has_unit).map(|folder| folder.join(UNIT))?;
    let added = folders.iter().rev().flat_map(|folder| {
        let folder = folder.join(format!("{UNIT}.d"));
        let names = machine.names(&folder).into_iter().filter(|name| name.ends_with(".conf"));
        names.map(|name| folder.join(name)).collect::<Vec<_>>()
    });
    let texts: String = std::iter::once(unit).chain(added).map(|file| machine.text(file) + "\n").collect();
    let whole = texts.replace("\\\n", " ");
    whole.lines().filter_map(|line| line.trim().strip_prefix("ExecStart=")).next_back().map(str::to_string)
}

#[cfg(test)]
mod tests;
