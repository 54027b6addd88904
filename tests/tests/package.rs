//! The Debian package: it is made of the programs that are tested here, and a root that has nothing but its dependencies runs a station.

use serde_json::Value;
use station_tests::{Folder, binaries, run};
use std::path::{Path, PathBuf};
use std::process::Command;

/// What the package depends on, and on what that does; of Debian 12, as the machine has it.
const DEPENDED_ON: [&str; 3] = ["libc6", "libgcc-s1", "gcc-12-base"];
/// What the tests themselves need in the root: a shell.
const SHELL: [&str; 1] = ["dash"];

fn has(program: &str) -> bool {
    Command::new("sh").args(["-c", &format!("command -v {program}")]).output().is_ok_and(|found| found.status.success())
}

fn said(command: &mut Command) -> String {
    let (code, out, said) = run(command);
    assert_eq!(code, Some(0), "{command:?}: {said}");
    out
}

/// Makes the package of the programs that lie beside this test; `None` where the machine has not the tools.
fn package(folder: &Folder) -> Option<PathBuf> {
    if !["dpkg-deb", "strip", "objdump"].into_iter().all(has) {
        eprintln!("NOT TRIED: the Debian package, for there is no dpkg-deb or no binutils");
        return None;
    }
    let build = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/debian/build");
    let made = said(Command::new(build).arg(binaries()).arg(folder.as_path()));
    Some(PathBuf::from(made.trim()))
}

/// Copies what installed packages brought into a root of its own; false where this is no Debian machine that has them.
fn install_installed(packages: &[&str], root: &Path) -> bool {
    let (code, files, _) = run(Command::new("dpkg-query").arg("-L").args(packages));
    if code != Some(0) {
        return false;
    }
    let list = root.join("../files");
    let files: Vec<&str> = files.lines().filter(|file| Path::new(file).symlink_metadata().is_ok_and(|it| !it.is_dir())).collect();
    std::fs::write(&list, files.join("\n")).expect("a list of files");
    let copied = format!("tar -C / -cf - -T '{}' 2>/dev/null | tar -C '{}' -xf -", list.display(), root.display());
    said(Command::new("sh").args(["-c", &copied]));
    true
}

#[test]
fn a_package_is_made_and_a_clean_root_with_its_dependencies_runs_a_station() {
    let folder = Folder::new("package");
    let Some(package) = package(&folder) else { return };
    let contents = said(Command::new("dpkg-deb").arg("-c").arg(&package));
    let holds = |path: &str| contents.lines().any(|line| line.split_whitespace().any(|word| word == format!("./{path}")));
    for program in ["hystation", "device", "haptic", "tissue", "collision-worker", "fluid", "rendering", "recorder", "console"] {
        assert!(holds(&format!("usr/lib/hystation/{program}")), "{program}\n{contents}");
    }
    for path in [
        "usr/share/man/man1/hystation.1.gz",
        "usr/share/man/man1/hystation-run.1.gz",
        "usr/share/bash-completion/completions/hystation",
        "usr/share/zsh/vendor-completions/_hystation",
        "usr/share/fish/vendor_completions.d/hystation.fish",
        "usr/share/hystation/scenes/default.toml",
        "usr/share/doc/hystation/copyright",
        "usr/lib/systemd/system/hystation.service",
    ] {
        assert!(holds(path), "{path}\n{contents}");
    }
    assert!(contents.lines().all(|line| line.contains("root/root")), "{contents}");
    let field = |name: &str| said(Command::new("dpkg-deb").arg("-f").arg(&package).arg(name)).trim().to_string();
    let version = said(Command::new(binaries().join("hystation")).arg("--version"));
    assert_eq!(format!("hystation {}", field("Version")), version.trim());
    assert!(field("Depends").starts_with("libc6 (>= 2."), "{}", field("Depends"));

    let root = folder.as_path().join("root");
    std::fs::create_dir(&root).expect("a root");
    for place in ["tmp", "proc", "dev/shm", "run", "var/tmp", "usr/bin", "usr/sbin", "usr/lib", "usr/lib64"] {
        std::fs::create_dir_all(root.join(place)).expect("a place");
    }
    let (may, _, _) = run(Command::new("unshare").args(["--mount", "--pid", "--fork", "true"]));
    if may != Some(0) || !install_installed(&[&DEPENDED_ON[..], &SHELL[..]].concat(), &root) {
        eprintln!("NOT TRIED: the package in a clean root, which takes root and Debian's own packages");
        return;
    }
    said(Command::new("dpkg-deb").arg("-x").arg(&package).arg(&root));
    let unit = std::fs::read_to_string(root.join("usr/lib/systemd/system/hystation.service")).expect("the unit");
    assert!(unit.contains("ExecStart=/usr/bin/hystation ") && !unit.contains("/opt/"), "{unit}");
    let inside = |script: &str| {
        let mounts = "mount --bind /dev $0/dev && mount -t tmpfs shm $0/dev/shm && mount -t tmpfs run $0/run && mount -t proc proc $0/proc";
        let script = format!("{mounts} && exec chroot $0 /bin/sh -c '{script}'");
        run(Command::new("unshare")
            .args(["--mount", "--pid", "--fork", "sh", "-c", &script])
            .arg(&root)
            .env_clear()
            .env("PATH", PATH))
    };
    let (may, _, why) = inside("true");
    if may != Some(0) {
        eprintln!("NOT TRIED: the package in a clean root, for mounts are refused: {why}");
        return;
    }
    let (code, out, err) = inside("hystation --version && hystation check /usr/share/hystation/scenes/myoma.toml");
    assert_eq!((code, out.lines().next()), (Some(0), Some(version.trim())), "{err}");
    let (code, _, err) = inside("hystation run --headless --for 3s --hand script:press --report /tmp/report.json");
    assert_eq!(code, Some(0), "{err}");
    let report = std::fs::read_to_string(root.join("tmp/report.json")).expect("a report");
    let report: Value = serde_json::from_str(&report).expect("a report");
    assert!(report["device"]["ticks"].as_u64().is_some_and(|ticks| ticks >= 3_000), "{report:#}");
    assert_eq!(report["leftovers"], serde_json::json!({ "processes": 0, "shared_memory": 0, "files": 0 }), "{err}");
}

/// Where the shell looks for programs in a root of its own.
const PATH: &str = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin";
