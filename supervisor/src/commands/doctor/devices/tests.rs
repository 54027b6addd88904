//! Machines with devices that are made up, as the kernel describes real ones.

use super::*;
use crate::commands::doctor::made_up::MadeUp;

const XBOX: &str = r#"I: Bus=0003 Vendor=045e Product=02ea Version=0301
N: Name="Microsoft X-Box One S pad"
P: Phys=usb-0000:00:14.0-2/input0
S: Sysfs=/devices/pci0000:00/0000:00:14.0/usb1/1-2/1-2:1.0/input/input20
U: Uniq=
H: Handlers=event7 js0 
B: PROP=0
B: EV=20000b
B: KEY=7cdb000000000000 0 0 0 0
B: ABS=3003f
B: FF=107030000 0
"#;

const SPACE_MOUSE: &str = r#"I: Bus=0003 Vendor=256f Product=c635 Version=0110
N: Name="3Dconnexion SpaceMouse Compact"
H: Handlers=mouse1 event9 
B: PROP=0
B: EV=1f
B: KEY=3 0 0 0 0
B: REL=3f
B: MSC=10
B: LED=100
"#;

const MOUSE: &str = r#"I: Bus=0003 Vendor=046d Product=c077 Version=0111
N: Name="Logitech USB Optical Mouse"
H: Handlers=mouse0 event3 
B: EV=17
B: KEY=70000 0 0 0 0
B: REL=903
"#;

/// All findings, each in a line: state, what it is of, what was found, the cure.
fn said(made: &MadeUp) -> Vec<String> {
    let line = |finding: &Finding| {
        let Finding { what, state, found, cure } = finding;
        format!("{state:?} {what}: {found}; {}", cure.as_deref().unwrap_or_default())
    };
    findings(&made.0).iter().map(line).collect()
}

fn assert_line(line: &str, head: &str, words: &[&str]) {
    assert!(line.starts_with(head) && words.iter().all(|word| line.contains(word)), "{head:?} {words:?}: {line}");
}

#[test]
fn a_gamepad_and_a_3d_mouse_are_told_from_a_mouse_and_each_has_the_word_that_takes_it() {
    let made = MadeUp::new("pads");
    let [none] = &said(&made)[..] else { panic!("{:?}", said(&made)) };
    assert_line(none, "Good device: none is plugged in: the simulated one", &[]);
    made.write("proc/bus/input/devices", [MOUSE, XBOX, SPACE_MOUSE].join("\n"));
    for node in ["event3", "event7", "event9"] {
        made.write(&format!("dev/input/{node}"), "");
    }
    let [pad, mouse] = &said(&made)[..] else { panic!("{:?}", said(&made)) };
    assert_line(pad, "Good gamepad: Microsoft X-Box One S pad, /dev/input/event7", &["--hand gamepad"]);
    assert_line(mouse, "Good 3D mouse: 3Dconnexion SpaceMouse Compact, /dev/input/event9", &["--hand spacemouse"]);
    for nonsense in ["B: KEY=", "B: KEY=xyz", &XBOX.replace("event7", ""), &XBOX.replace("ABS=3003f", "ABS=0")] {
        made.write("proc/bus/input/devices", nonsense);
        assert_line(&said(&made)[0], "Good device", &[]);
    }
}

#[test]
fn a_pad_that_may_not_be_read_and_one_without_a_node_are_told_with_their_cures() {
    let mut made = MadeUp::new("refused");
    made.write("proc/bus/input/devices", SPACE_MOUSE);
    assert_line(&said(&made)[0], "Weak 3D mouse", &["/dev/input/event9, which is not there", "--device /dev/input/event9"]);
    made.write("dev/input/event9", "");
    made.0.may = |_, _| false;
    let rule = "SUBSYSTEM==\"input\", KERNEL==\"event*\", ATTRS{id/vendor}==\"256f\", TAG+=\"uaccess\"";
    assert_line(&said(&made)[0], "Weak 3D mouse", &["may not read", rule, "/etc/udev/rules.d", "usermod -aG input"]);
}

#[test]
fn a_haptic_device_is_known_by_its_maker_and_a_driver_may_open_what_the_kernel_made_of_it() {
    let mut made = MadeUp::new("haptic");
    let usb = |device: &str, ids: [&str; 2], at: [&str; 2]| {
        let files = ["idVendor", "idProduct", "busnum", "devnum"];
        for (file, text) in files.iter().zip(ids.iter().chain(&at)) {
            made.write(&format!("sys/bus/usb/devices/{device}/{file}"), format!("{text}\n"));
        }
    };
    usb("1-1", ["1451", "0402"], ["1", "4"]);
    usb("1-2", ["046d", "c077"], ["1", "5"]);
    usb("2-1", ["2988", "0302"], ["2", "12"]);
    usb("2-2", ["0403", "6001"], ["2", "13"]); // a converter of the vendor whose chip is in the Falcon
    std::fs::create_dir_all(made.0.path("sys/bus/usb/devices/2-1/2-1:1.0/tty/ttyACM0")).unwrap();
    made.link("sys/bus/usb/devices/2-1/subsystem", "..");
    made.0.may = |path, _| path.ends_with("ttyACM0");
    let [force, touch] = &said(&made)[..] else { panic!("{:?}", said(&made)) };
    let rule = "ATTRS{idVendor}==\"1451\", ATTRS{idProduct}==\"0402\", TAG+=\"uaccess\"";
    assert_line(
        force,
        "Weak haptic device: Force Dimension (1451:0402, /dev/bus/usb/001/004)",
        &["may not open", rule, "plugdev"],
    );
    assert_line(
        touch,
        "Good haptic device: 3D Systems (OpenHaptics) (2988:0302, /dev/bus/usb/002/012, /dev/ttyACM0)",
        &["--driver"],
    );
    made.0.may = |path, access| path.ends_with("ttyACM0") && !access.contains(Access::WRITE_OK);
    assert_line(&said(&made)[1], "Weak haptic device: 3D Systems", &["usermod -aG dialout", "udevadm"]);
}

/// Whoever had the package had to type them all the same.
#[test]
fn the_packages_rules_open_every_device_that_is_known_to_who_sits_at_the_machine() {
    let rules = include_str!("../../../../../assets/debian/70-hystation.rules");
    let opens = |conditions: &[String]| {
        let granted = rules.lines().filter(|line| line.ends_with(", TAG+=\"uaccess\""));
        granted.filter(|line| conditions.iter().all(|condition| line.contains(condition.as_str()))).count() == 1
    };
    for (vendor, product, maker) in HAPTIC {
        let product = product.map(|product| format!("ATTRS{{idProduct}}==\"{product}\""));
        let conditions: Vec<String> = [format!("ATTRS{{idVendor}}==\"{vendor}\"")].into_iter().chain(product).collect();
        assert!(opens(&conditions), "{maker}: {conditions:?}");
    }
    assert!(opens(&["KERNEL==\"event*\", ATTRS{id/vendor}==\"256f\"".to_string()]), "{rules}");
}

#[test]
fn the_driver_of_the_service_is_the_one_that_its_last_command_names_and_it_must_do() {
    let made = MadeUp::new("service");
    made.write("usr/lib/systemd/system/hystation.service", "[Service]\nExecStart=/usr/bin/hystation run --headless\n");
    assert_eq!(said(&made).len(), 1);
    let added =
        "[Service]\nExecStart=\nExecStart=/usr/bin/hystation --name service \\\n run --driver /opt/omega/driver --headless\n";
    made.write("etc/systemd/system/hystation.service.d/override.conf", added);
    made.write("etc/systemd/system/hystation.service.d/notes", "ExecStart=/usr/bin/hystation run\n");
    let cure = ["systemctl edit hystation.service", "conformance driver"];
    assert_line(&said(&made)[1], "Bad driver: /opt/omega/driver, of hystation.service, does not do: is not there", &cure);
    made.write("opt/omega/driver", "");
    assert_line(&said(&made)[1], "Good driver: /opt/omega/driver, of hystation.service", &[]);
    // A unit of the operator's own stands before the package's.
    made.write("etc/systemd/system/hystation.service", "ExecStart=/usr/bin/hystation run --driver=/opt/none\n");
    std::fs::remove_dir_all(made.0.path("etc/systemd/system/hystation.service.d")).unwrap();
    assert_line(&said(&made)[1], "Bad driver: /opt/none", &[]);
}

/// Who followed the cure for a gamepad lost the package's rules for every other device: the file that was named takes the place of the package's.
#[test]
fn the_cures_rules_stand_beside_the_packages_and_before_those_that_grant_them() {
    let (_, name) = OWN_RULES.rsplit_once('/').unwrap();
    assert!("70-hystation.rules" < name && name < "73-seat-late.rules", "{name}");
    assert!(cure_of("a rule", "input").contains(&format!("put `a rule` into {OWN_RULES}, ")));
}

/// Nobody asked the driver of the service that the README names first.
#[test]
fn the_driver_of_the_users_own_service_is_asked_too_and_each_has_its_cure() {
    let mut made = MadeUp::new("own-service");
    made.set("HOME", "/home/ann");
    made.write("usr/lib/systemd/user/hystation.service", "[Service]\nExecStart=/usr/bin/hystation run\n");
    assert_eq!(said(&made).len(), 1);
    let added = "[Service]\nExecStart=\nExecStart=/usr/bin/hystation --name service run polyp --driver %h/omega/driver\n";
    made.write("home/ann/.config/systemd/user/hystation.service.d/override.conf", added);
    let bad = "Bad driver: /home/ann/omega/driver, of the user's hystation.service, does not do: is not there";
    assert_line(&said(&made)[1], bad, &["`systemctl --user edit hystation.service`"]);
    made.write("home/ann/omega/driver", "");
    made.write("etc/systemd/system/hystation.service", "ExecStart=/usr/bin/hystation run --driver=%h/driver\n");
    let [_, own, machines] = &said(&made)[..] else { panic!("{:?}", said(&made)) };
    assert_line(own, "Good driver: /home/ann/omega/driver, of the user's hystation.service", &[]);
    assert_line(machines, "Bad driver: /root/driver, of hystation.service, does not do", &["`sudo systemctl edit"]);
    // Whoever has their settings elsewhere has their units there.
    made.set("XDG_CONFIG_HOME", "/home/ann/settings");
    made.write("home/ann/settings/systemd/user/hystation.service", "ExecStart=/usr/bin/hystation run --driver=/opt/none\n");
    assert_line(&said(&made)[1], "Bad driver: /opt/none, of the user's hystation.service", &[]);
}
