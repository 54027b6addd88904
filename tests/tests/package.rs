//! The Debian package: it is made of the programs that are tested here, and a root that has nothing but its dependencies runs a station.

use serde_json::Value;
use station_tests::shown::not_shown;
use station_tests::{Folder, binaries, run};
use std::path::{Path, PathBuf};
use std::process::Command;

/// What the package depends on.
const DEPENDED_ON: [&str; 2] = ["libc6", "libgcc-s1"];
/// What the tests themselves need in the root: a shell.
const SHELL: [&str; 1] = ["dash"];
/// What every Debian has that the package's scripts call, and what that depends on.
const ESSENTIAL: [&str; 6] = ["coreutils", "libacl1", "libattr1", "libselinux1", "libpcre2-8-0", "libgmp10"];

/// What of the sources lies in the package as it is, in /usr/share/hystation, and what of each has to be there.
const SHARED: [(&str, &[&str]); 6] = [
    ("cases", &["polyp.toml", "septum.toml", "fluid-overload.toml"]),
    ("scenes", &["default.toml", "myoma.toml"]),
    ("meshes", &["uterus.msh", "polyp.msh", "jaw.obj"]),
    ("campaigns", &["quick.toml", "kills.toml"]),
    ("schema", &["scene.schema.json", "case.schema.json", "campaign.schema.json"]),
    ("driver", &["hystation_driver.h", "example_driver.c"]),
];

/// What it has beside programs and what [`SHARED`] names.
const BESIDE: [&str; 15] = [
    "usr/share/man/man1/hystation.1.gz",
    "usr/share/man/man1/hystation-run.1.gz",
    "usr/share/bash-completion/completions/hystation",
    "usr/share/zsh/vendor-completions/_hystation",
    "usr/share/fish/vendor_completions.d/hystation.fish",
    "usr/share/doc/hystation/README.md",
    "usr/share/doc/hystation/docs/driver.md",
    "usr/share/doc/hystation/docs/handbook.md",
    "usr/share/doc/hystation/copyright",
    "usr/share/doc/hystation/changelog.gz",
    "usr/lib/systemd/system/hystation.service",
    "usr/lib/systemd/user/hystation.service",
    "etc/security/limits.d/hystation.conf",
    "usr/lib/udev/rules.d/70-hystation.rules",
    "usr/share/applications/hystation.desktop",
];

/// The files of all folders of [`SHARED`], each as it is named in there.
fn shared_files() -> Vec<String> {
    let assets = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets");
    let of_folder = |(folder, known): &(&str, &[&str])| {
        let files = std::fs::read_dir(assets.join(folder)).expect("a folder of the sources").flatten();
        let names: Vec<String> = files.map(|file| file.file_name().to_string_lossy().into_owned()).collect();
        assert!(known.iter().all(|file| names.iter().any(|name| name == file)), "{folder}: {names:?}");
        names.into_iter().map(|name| format!("{folder}/{name}")).collect::<Vec<_>>()
    };
    SHARED.iter().flat_map(of_folder).collect()
}

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
        not_shown("the Debian package: there is no dpkg-deb or no binutils");
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

/// The base of libgcc, which is named for the compiler of each Debian (gcc-12-base), as the machine has it: where another one was looked for, the package was
/// not tried.
fn base_of_libgcc() -> Vec<String> {
    let (_, depends, _) = run(Command::new("dpkg-query").args(["-W", "-f", "${Depends}", "libgcc-s1"]));
    let names = depends.split(',').filter_map(|one| one.split_whitespace().next());
    names.filter(|name| name.starts_with("gcc-")).map(str::to_string).collect()
}

/// A root that has what the package depends on and a shell, with what else is named; none where that is not to be had.
fn clean_root(folder: &Folder, more: &[&str]) -> Option<PathBuf> {
    let root = folder.as_path().join("root");
    std::fs::create_dir(&root).expect("a root");
    for place in ["tmp", "proc", "dev/shm", "run", "var/tmp", "usr/bin", "usr/sbin", "usr/lib", "usr/lib64"] {
        std::fs::create_dir_all(root.join(place)).expect("a place");
    }
    let (may, _, _) = run(Command::new("unshare").args(["--mount", "--pid", "--fork", "true"]));
    let base = base_of_libgcc();
    let base: Vec<&str> = base.iter().map(String::as_str).collect();
    if may != Some(0) || !install_installed(&[&DEPENDED_ON[..], &base[..], more].concat(), &root) {
        not_shown("the package in a clean root, which takes root and Debian's own packages");
        return None;
    }
    Some(root)
}

/// What has a page of its own in the manual, and is named in the first one.
const COMMANDS: [&str; 13] =
    ["run", "status", "top", "logs", "stop", "fault", "check", "doctor", "bench", "swap", "conformance", "report", "replay"];

/// Has bash complete the words that are its arguments, as it does on the key of the tabulator; its name is that of the completions.
const COMPLETE: &str = r#"
source "$0" && complete -p hystation | grep -q -- '-F _hystation ' || exit 1
COMP_WORDS=("$@")
COMP_CWORD=$(($# - 1))
_hystation hystation "${COMP_WORDS[COMP_CWORD]}" "${COMP_WORDS[COMP_CWORD - 1]}"
printf '%s\n' "${COMPREPLY[@]}"
"#;

/// The pages of the manual have a title and their sections, one for each command; bash completes what is begun.
fn assert_papers(package: &Path, folder: &Folder) {
    let root = folder.as_path().join("papers");
    said(Command::new("dpkg-deb").arg("-x").arg(package).arg(&root));
    let page = |name: &str| {
        let file = root.join(format!("usr/share/man/man1/{name}.1.gz"));
        said(Command::new("gzip").arg("-dc").arg(file)).replace("\\-", "-")
    };
    for name in std::iter::once("hystation".to_string()).chain(COMMANDS.map(|command| format!("hystation-{command}"))) {
        let text = page(&name);
        // Before the title it is only said how an apostrophe is written.
        let title = text.lines().find(|line| !line.starts_with(".ie ") && !line.starts_with(".el "));
        assert!(title.is_some_and(|title| title.starts_with(&format!(".TH {name} 1 "))), "{name}: {title:?}");
        for section in ["NAME", "SYNOPSIS", "DESCRIPTION", "OPTIONS"] {
            assert!(text.lines().any(|line| line == format!(".SH {section}")), "{name} has no {section}: {text}");
        }
    }
    let first = page("hystation");
    for command in COMMANDS {
        assert!(first.lines().any(|line| line == format!("hystation-{command}(1)")), "{command} is not named: {first}");
    }
    let file = root.join("usr/share/bash-completion/completions/hystation");
    assert_offered(&root, &file);
    if !has("bash") {
        not_shown("what bash completes: there is none");
        return;
    }
    let completed = |words: &[&str]| {
        let found = said(Command::new("bash").args(["-c", COMPLETE]).arg(&file).args(words));
        let mut found: Vec<String> = found.lines().map(str::to_string).collect();
        found.sort();
        found
    };
    assert_eq!(completed(&["hystation", "re"]), ["replay", "report"]);
    assert_eq!(completed(&["hystation", "run", "--rec"]), ["--record"]);
    assert_eq!(completed(&["hystation", "s"]), ["status", "stop", "swap"], "what only the station calls is not offered");
    assert_eq!(completed(&["hystation", "run", "--ro"]), [""], "nor what only tests give");
}

/// Each shell is told of every command, and of none that the help hides: a tabulator offered who stands in for a guardian.
fn assert_offered(root: &Path, bash: &Path) {
    let [zsh, fish] = ["zsh/vendor-completions/_hystation", "fish/vendor_completions.d/hystation.fish"]
        .map(|file| root.join("usr/share").join(file));
    for file in [bash, zsh.as_path(), fish.as_path()] {
        let text = std::fs::read_to_string(file).expect("completions");
        let is_there = |word: &str| text.split(|letter: char| !letter.is_alphanumeric() && letter != '-').any(|it| it == word);
        for command in COMMANDS {
            assert!(is_there(command), "{} does not offer {command}", file.display());
        }
        for hidden in ["supervise", "stand-in", "--roles", "with-parent"] {
            assert!(!is_there(hidden), "{} offers {hidden}", file.display());
        }
    }
}

/// The documents below a folder.
fn documents(folder: &Path) -> Vec<PathBuf> {
    let found = said(Command::new("find").arg(folder).args(["-name", "*.md", "-type", "f"]));
    found.lines().map(PathBuf::from).collect()
}

/// What a document of the package links to beside it is in the package, too; README.md named files of a source tree that was not there.
fn assert_links(root: &Path) {
    let documents = documents(&root.join("usr/share/doc/hystation"));
    assert!(documents.len() > 8, "{documents:?}");
    for document in documents {
        let text = std::fs::read_to_string(&document).expect("a document");
        let links = text.split("](").skip(1).filter_map(|rest| rest.split([')', '#']).next());
        for link in links.filter(|link| !link.is_empty() && !link.contains("://")) {
            let there = document.parent().expect("a folder").join(link).exists();
            assert!(there, "{}: there is no {link} beside it", document.display());
        }
    }
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
    for path in BESIDE {
        assert!(holds(path), "{path}\n{contents}");
    }
    for file in shared_files() {
        assert!(holds(&format!("usr/share/hystation/{file}")), "{file}\n{contents}");
    }
    assert!(contents.lines().all(|line| line.contains("root/root")), "{contents}");
    assert_papers(&package, &folder);
    assert_links(&folder.as_path().join("papers"));
    let field = |name: &str| said(Command::new("dpkg-deb").arg("-f").arg(&package).arg(name)).trim().to_string();
    let version = said(Command::new(binaries().join("hystation")).arg("--version"));
    assert_eq!(format!("hystation {}", field("Version")), version.trim());
    assert!(field("Depends").starts_with("libc6 (>= 2."), "{}", field("Depends"));

    let Some(root) = clean_root(&folder, &SHELL) else { return };
    said(Command::new("dpkg-deb").arg("-x").arg(&package).arg(&root));
    for (manager, command) in [("system", "service run --headless\n"), ("user", "service run\n")] {
        let unit = std::fs::read_to_string(root.join(format!("usr/lib/systemd/{manager}/hystation.service"))).expect("the unit");
        let starts = unit.contains(&format!("ExecStart=/usr/bin/hystation --name {command}"));
        assert!(starts && !unit.contains("/opt/"), "{manager}: {unit}");
    }
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
        return not_shown(&format!("the package in a clean root: mounts are refused ({})", why.trim()));
    }
    let (code, out, err) = inside("hystation --version && hystation check /usr/share/hystation/scenes/myoma.toml");
    assert_eq!((code, out.lines().next()), (Some(0), Some(version.trim())), "{err}");
    let (code, out, err) = inside("cd /tmp && hystation check polyp");
    assert_eq!(code, Some(0), "{err}");
    let first = out.lines().next();
    assert_eq!(first, Some("/usr/share/hystation/cases/polyp.toml: “Resection of a polyp”"), "{out}");
    let (code, _, err) = inside("hystation check polyps");
    assert!(code == Some(2) && err.contains("polyps"), "{code:?} {err}");
    let (code, _, err) = inside("hystation run --headless --for 3s --hand script:press --report /tmp/report.json");
    assert_eq!(code, Some(0), "{err}");
    let report = std::fs::read_to_string(root.join("tmp/report.json")).expect("a report");
    let report: Value = serde_json::from_str(&report).expect("a report");
    assert!(report["device"]["ticks"].as_u64().is_some_and(|ticks| ticks >= 3_000), "{report:#}");
    assert_eq!(report["leftovers"], serde_json::json!({ "processes": 0, "shared_memory": 0, "files": 0 }), "{err}");
}

/// Whoever began a case from the menu had nothing of it afterwards.
#[test]
fn a_case_of_the_menu_ends_with_its_session_and_is_recorded_into_a_folder_of_the_users_home() {
    let home = Folder::new("menu of a user");
    let program = home.write("hystation", "#!/bin/sh\nprintf '%s\\n' \"$@\"\n");
    std::fs::set_permissions(&program, std::os::unix::fs::PermissionsExt::from_mode(0o755)).expect("its rights");
    // In a text of such a file a backslash stands for itself only where it is two. What is left then is quoted as for a shell.
    let entry = include_str!("../../assets/debian/hystation.desktop");
    let commands = entry.lines().filter_map(|line| line.strip_prefix("Exec=")).map(|command| command.replace(r"\\", r"\"));
    let path = format!("{}:{PATH}", home.as_path().display());
    let started =
        |command: String| said(Command::new("sh").args(["-c", &command]).env("PATH", &path).env("HOME", home.as_path()));
    let of_case = |case: &str| format!("run\n{case}\n--until-end\n--record\n{}\n", home.path("hystation-sessions/"));
    let wanted = ["run\n".to_string(), of_case("access"), of_case("navigation"), of_case("polyp")];
    assert_eq!(commands.map(started).collect::<Vec<_>>(), wanted);
}

/// Where the shell looks for programs in a root of its own.
const PATH: &str = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin";

/// Says what it was asked for, and whether the programs were there then; the service is active where the file says so.
const SYSTEMD: &str = "#!/bin/sh\n[ -x /usr/lib/hystation/hystation ] && there=there || there=gone\n\
                       echo \"${0##*/} $* ($there)\" >>/calls\ncase \"$*\" in *is-active*) [ -e /active ] ;; esac\n";

/// Beside what dpkg does in a root ($0) a station of its programs runs, if it is to have a name; it must go on and stop as it should.
const DPKG: &str = r#"
mount -t proc proc "$0/proc" || exit 1
hystation() { "$0/usr/lib/hystation/hystation" --name "$STATION" "$@"; }
if [ -n "$STATION" ]; then
    hystation run --headless --hand idle --roles hardware,device >&2 &
    own=$!
    for look in $(seq 300); do hystation status --json 2>&1 | grep -q '"live"' && break || sleep 0.1; done
fi
dpkg --root="$0" --force-depends "$@" || exit 2
if [ -n "$STATION" ]; then
    hystation status --json | grep -q '"live"' && hystation stop && wait "$own" || exit 3
fi
"#;

/// What dpkg does in the root beside a station of this name, and what its scripts said; then the calls that systemd got.
fn dpkg(root: &Path, station: &str, arguments: &[&str]) -> (String, Vec<String>) {
    let calls = root.join("calls");
    let _ = std::fs::remove_file(&calls); // of the time before
    let mut command = Command::new("unshare");
    command.args(["--mount", "bash", "-c", DPKG]).arg(root).args(arguments).env("LC_ALL", "C").env("STATION", station);
    let (code, _, said) = run(&mut command);
    assert_eq!(code, Some(0), "{arguments:?}: {said}");
    let calls = std::fs::read_to_string(calls).unwrap_or_default();
    (said, calls.lines().map(str::to_string).collect())
}

/// What there is of the package, and of what was made for it, in a root.
fn left(root: &Path) -> Vec<String> {
    let found = said(Command::new("find").arg(root).args(["-path", "*hystation*", "-printf", "%P\n"]));
    found.lines().map(str::to_string).collect()
}

/// In the midst of a session whoever trained lost the station to a newer package.
fn assert_lets_a_session_end(root: &Path, package: &str) {
    let station = root.join("dev/shm/hystation-0-service");
    std::fs::create_dir(&station).expect("a station's root");
    for (key, is_session) in [("hand", false), ("case", true), ("record", true)] {
        std::fs::write(station.join("settings.toml"), format!("headless = true\n{key} = \"/x\"\n")).expect("its settings");
        let (complained, calls) = dpkg(root, "", &["-i", package]);
        assert_eq!(calls.iter().any(|call| call.contains(" restart ")), !is_session, "{key}: {calls:?}");
        assert_eq!(complained.contains("sudo systemctl restart hystation"), is_session, "{key}: {complained}");
    }
    std::fs::remove_dir_all(station).expect("it ends");
}

#[test]
fn a_package_is_installed_over_a_running_station_removed_and_purged_by_dpkg_and_leaves_nothing() {
    let folder = Folder::new("installed");
    let Some(package) = package(&folder) else { return };
    let Some(root) = clean_root(&folder, &[&SHELL[..], &ESSENTIAL].concat()) else { return };
    for place in ["run/systemd/system", "var/lib/dpkg/info", "var/lib/dpkg/updates"] {
        std::fs::create_dir_all(root.join(place)).expect("a place");
    }
    std::fs::write(root.join("var/lib/dpkg/status"), "").expect("no package");
    for name in ["systemctl", "deb-systemd-invoke"] {
        let path = root.join("usr/bin").join(name);
        std::fs::write(&path, SYSTEMD).expect("a systemd");
        std::fs::set_permissions(&path, std::os::unix::fs::PermissionsExt::from_mode(0o755)).expect("its rights");
    }
    let file = package.to_str().expect("a name");
    let (complained, calls) = dpkg(&root, "", &["-i", file]);
    assert_eq!(calls, ["systemctl --system daemon-reload (there)"], "nothing is started by itself: {complained}");

    // The operator enables it, in the package's way and in one of their own.
    let (units, wants) = (root.join("etc/systemd/system"), "hystation.service");
    for target in ["default.target.wants", "own.target.wants"] {
        std::fs::create_dir_all(units.join(target)).expect("a folder");
    }
    let enabled = units.join("default.target.wants").join(wants);
    std::os::unix::fs::symlink("/usr/lib/systemd/system/hystation.service", &enabled).expect("a link");
    let own = units.join("own.target.wants").join(wants);
    std::os::unix::fs::symlink("../../../passwd", &own).expect("a link");
    std::fs::write(root.join("etc/passwd"), "").expect("a file of another one");

    std::fs::write(root.join("active"), "").expect("it runs");
    let (complained, calls) = dpkg(&root, &format!("d{}", std::process::id()), &["-i", file]);
    assert!(complained.contains("a station still runs the programs of before"), "{complained}");
    assert!(calls.contains(&"deb-systemd-invoke restart hystation.service (there)".to_string()), "{calls:?}");
    assert!(!calls.iter().any(|call| call.contains(" stop ")), "it ran until the new programs were there: {calls:?}");
    assert_lets_a_session_end(&root, file);
    std::fs::remove_file(root.join("active")).expect("it stands");
    let (complained, calls) = dpkg(&root, "", &["-i", file]);
    assert!(!calls.iter().any(|call| call.contains("restart")), "it was not running: {calls:?}");
    assert!(!complained.contains("a station still runs"), "{complained}");

    let (_, calls) = dpkg(&root, "", &["-r", "hystation"]);
    assert_eq!(calls.first().map(String::as_str), Some("deb-systemd-invoke stop hystation.service (there)"), "{calls:?}");
    assert!(enabled.is_symlink(), "that it is enabled is the operator's");
    dpkg(&root, "", &["-P", "hystation"]);
    assert_eq!(left(&root), ["etc/systemd/system/own.target.wants/hystation.service"]);
}
