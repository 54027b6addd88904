//! Which stations there are beside the one that was asked for: whoever looks for a service's under the name that every command has by itself, or without the rights
//! of its user, is told how to speak to it.

use crate::neighbours::owner_and_name;
use hyst_exchange::{Station, system};

/// Most that are named.
const MOST_NAMED: usize = 4;

/// How to begin a command for each of the others, the first ones by their words.
pub fn others(station: &Station) -> Vec<String> {
    let own = station.root().file_name();
    let entries = station.root().parent().and_then(|folder| std::fs::read_dir(folder).ok()).into_iter().flatten().flatten();
    let roots =
        entries.filter(|entry| entry.file_type().is_ok_and(|kind| kind.is_dir()) && Some(entry.file_name().as_os_str()) != own);
    let mut found: Vec<String> =
        roots.filter_map(|entry| begin(&entry.file_name().to_string_lossy(), system::user_id())).collect();
    found.sort();
    found.truncate(MOST_NAMED);
    found
}

/// How a user begins a command for the station whose root is named so; `None` of what is no root.
fn begin(root: &str, user: u32) -> Option<String> {
    let (owner, name) = owner_and_name(root)?;
    Some(match owner {
        _ if owner == user => format!("hystation --name {name}"),
        0 => format!("sudo hystation --name {name}"),
        _ => format!("sudo -u '#{owner}' hystation --name {name}"),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_station_of_the_own_user_of_root_and_of_another_one_are_spoken_to_in_their_ways() {
        let begins = ["hystation-1000-second", "hystation-0-service", "hystation-1001-a-b", "hystation-x-y", "hyst1000_second_1"]
            .map(|root| begin(root, 1000));
        let wanted = ["hystation --name second", "sudo hystation --name service", "sudo -u '#1001' hystation --name a-b"];
        assert_eq!(begins[..3], wanted.map(|words| Some(words.to_string())));
        assert_eq!(begins[3..], [None, None]);
    }

    #[test]
    fn who_asks_for_a_station_that_does_not_run_is_told_of_those_that_do() {
        let [asked, runs] = ["asked", "others"].map(|name| Station::named(&format!("{name}-{}", std::process::id())).unwrap());
        runs.wipe();
        runs.found().unwrap();
        let begin = format!("hystation --name {}", runs.name());
        // Beside other stations of this machine, which come and go, it may not be among the first.
        let told = others(&asked);
        let is_told = told.contains(&begin) || told.len() == MOST_NAMED;
        let is_silent = !others(&runs).contains(&begin);
        runs.wipe();
        assert!(is_told && is_silent, "the other one, and not the one that is asked for");
    }
}
