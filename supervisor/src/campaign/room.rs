//! Whether the file systems that a campaign's faults fill may be filled, before anything is started.

use super::file::Campaign;
use crate::faultfile::FaultKind;
use crate::{neighbours, shortage};
use hyst_exchange::Station;
use std::path::{Path, PathBuf};

/// Refuses a cell whose fault would be refused each time: where the recordings lie, or /dev/shm, there is more room than is filled, or
/// another station trains.
pub(super) fn check(campaign: &Campaign, report: Option<&Path>) -> Result<(), String> {
    // A folder that is made for the results lies where its nearest ancestor does.
    let results = report.map_or_else(std::env::temp_dir, |path| std::path::absolute(path).unwrap_or_else(|_| path.into()));
    let results = results.ancestors().find(|path| path.is_dir()).unwrap_or(Path::new("/")).to_path_buf();
    let may_fill = |kind: FaultKind| {
        let folder = folder(kind, &results);
        shortage::check_folder(&folder, kind).and_then(|()| neighbours::check(&folder, kind, None))
    };
    check_with(campaign, may_fill)
}

fn folder(kind: FaultKind, results: &Path) -> PathBuf {
    let of_shm = || Station::named("default").ok().and_then(|station| station.root().parent().map(Path::to_path_buf));
    if kind == FaultKind::ShmFull { of_shm().unwrap_or_else(|| "/dev/shm".into()) } else { results.into() }
}

fn check_with(campaign: &Campaign, may_fill: impl Fn(FaultKind) -> Result<(), String>) -> Result<(), String> {
    for cell in &campaign.cells {
        for injection in [Some(&cell.injection), cell.with.as_ref()].into_iter().flatten() {
            if matches!(injection.kind, FaultKind::DiskFull | FaultKind::ShmFull) {
                may_fill(injection.kind).map_err(|reason| format!("cell {}: {reason}", cell.name))?;
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::campaign::file::parse;

    #[test]
    fn a_cell_that_fills_what_is_too_large_is_refused_and_others_are_not() {
        let text = |kind: &str, target: &str| {
            format!("[[cell]]\nkinds = [\"{kind}\"]\ntargets = [\"{target}\"]\ncount = 1\nfor = 1.0\n")
        };
        let large = |kind: FaultKind| Err(format!("{}: too large", kind.name()));
        for (kind, target) in [("disk-full", "recorder"), ("shm-full", "fluid")] {
            let campaign = parse("t", &text(kind, target)).unwrap();
            let reason = check_with(&campaign, large).unwrap_err();
            assert!(reason.starts_with(&format!("cell {kind} {target} for=1.0: {kind}: too large")), "{reason}");
            assert!(check_with(&campaign, |_| Ok(())).is_ok());
        }
        assert!(check_with(&parse("t", &text("stop", "fluid")).unwrap(), large).is_ok());
        assert_eq!(folder(FaultKind::DiskFull, Path::new("/x")), Path::new("/x"));
        assert_eq!(folder(FaultKind::ShmFull, Path::new("/x")), Path::new("/dev/shm"));
    }
}
