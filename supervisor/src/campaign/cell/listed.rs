//! What a campaign's file lists, looked at before anything is made of it: some kilobytes of kinds, targets and states can ask for more cells than a machine has
//! room for. Promise: nothing stands in a list twice, no name is long, and how many faults a `[[cell]]` comes to is known before the first of its cells is made.

use super::Group;
use crate::campaign::file::Arm;
use std::collections::BTreeSet;

/// Longest name, bytes: that of a cell is made of them, and stands in each of its faults.
const MOST_NAME_BYTES: usize = 200;

/// Refuses a list in which a name stands twice, or one that is too long.
pub(in crate::campaign) fn names<T: AsRef<str> + Ord>(key: &str, list: impl IntoIterator<Item = T>) -> Result<(), String> {
    let mut seen = BTreeSet::new();
    for name in list {
        let bytes = name.as_ref().len();
        if bytes > MOST_NAME_BYTES {
            return Err(format!("{key}: one has {bytes} bytes, at most {MOST_NAME_BYTES} are allowed"));
        }
        if seen.contains(&name) {
            return Err(format!("{key}: {:?} is there twice; write it once", name.as_ref()));
        }
        seen.insert(name);
    }
    Ok(())
}

impl Group {
    /// Its faults in these arms, of more than can be counted the largest number; or what is wrong with its lists.
    pub fn faults(&self, arms: &[Arm]) -> Result<usize, String> {
        let lists = [("kinds", &self.kinds), ("targets", &self.targets), ("states", &self.states), ("arms", &self.arms)];
        lists.into_iter().try_for_each(|(key, list)| names(key, list))?;
        names("may", self.may.iter().map(|may| format!("{may:?}")))?;
        names("with", &self.with)?;
        if let Some(arm) = self.arms.iter().find(|arm| !arms.iter().any(|known| known.name == **arm)) {
            return Err(format!("arm {arm:?}: there is no [[arm]] of this name"));
        }
        let of_each = arms.iter().map(|arm| arm.count_among(&self.arms, self.count)).fold(0, usize::saturating_add);
        let cells = [&self.kinds, &self.targets, &self.states];
        Ok(cells.into_iter().fold(of_each, |faults, list| faults.saturating_mul(list.len())))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::campaign::draw::Draw;
    use crate::campaign::file::parse;
    use crate::faultfile::MOST_FAULTS;

    const TEXT: &str = "seed = 4\n[[pool]]\nname = \"all\"\nlimit_upper95 = 0.5\n[[arm]]\nname = \"a\"\n[[arm]]\nname = \"b\"\nshare = 0.5\n\
                        [[cell]]\nkinds = [\"kill\", \"stop\"]\ntargets = [\"fluid\", \"device\"]\nstates = [\"idle\", \"contact\"]\ncount = 3\npool = \"all\"\n\
                        arms = [\"a\", \"b\"]\nmay = [\"others-die\"]\n\
                        [[cell]]\nkinds = [\"slow\"]\ntargets = [\"fluid\"]\nstates = [\"recovery\"]\ncount = 2\nfor = 0.5\nfactor = 2.0\nwith = \"kill device\"\n";

    fn words(word: &str, count: usize) -> String {
        (0..count).map(|number| format!("\"{word}{number}\", ")).collect()
    }

    /// 20 kB of names made a million cells, each of which was compared with all before it; and as many as there is room for in a file more than a machine has.
    #[test]
    fn how_many_faults_a_cell_comes_to_is_known_before_one_of_its_cells_is_looked_at() {
        let many = format!("[[cell]]\nkinds = [{}]\ntargets = [{}]\ncount = 1\n", words("k", 1_000), words("t", 1_000));
        let refused = parse("t", &many).unwrap_err();
        assert_eq!(refused, "cell 1: 1000000 faults with those before it, at most 100000 are allowed");
        let cell =
            |target: &str, count: usize| format!("[[cell]]\nkinds = [\"kill\"]\ntargets = [\"{target}\"]\ncount = {count}\n");
        let together = |first: usize, second: usize| parse("t", &(cell("fluid", first) + &cell("device", second)));
        assert_eq!(together(60_000, 40_000).unwrap().faults(), MOST_FAULTS);
        assert!(together(60_000, 40_001).unwrap_err().starts_with("cell 2: 100001 faults with those before it"));
        // 2 × 2 × 2 × (3 + 2) in both arms, and 2 + 1.
        assert_eq!(parse("t", TEXT).unwrap().faults(), 43);
        let shared = TEXT.replace("count = 3", "count = 8333").replace("count = 2", "count = 1");
        assert_eq!(parse("t", &shared).unwrap_err(), "cell 2: 100002 faults with those before it, at most 100000 are allowed");
    }

    #[test]
    fn what_is_listed_twice_or_has_a_long_name_is_refused_by_its_list() {
        let long = "x".repeat(MOST_NAME_BYTES + 1);
        for (change, by, words) in [
            ("[\"kill\", \"stop\"]", "[\"kill\", \"kill\"]", "cell 1: kinds: \"kill\" is there twice"),
            ("\"fluid\", \"device\"", "\"device\", \"device\"", "cell 1: targets: \"device\" is there twice"),
            ("\"idle\", \"contact\"", "\"idle\", \"idle\"", "cell 1: states: \"idle\" is there twice"),
            ("arms = [\"a\", \"b\"]", "arms = [\"a\", \"a\"]", "cell 1: arms: \"a\" is there twice"),
            ("[\"others-die\"]", "[\"others-die\", \"others-die\"]", "cell 1: may: \"OthersDie\" is there twice"),
            ("name = \"b\"", "name = \"a\"", "[[arm]] name: \"a\" is there twice"),
            ("seed = 4\n", "[[pool]]\nname = \"all\"\nlimit_upper95 = 0.1\n", "[[pool]] name: \"all\" is there twice"),
            ("arms = [\"a\", \"b\"]", "arms = [\"c\"]", "cell 1: arm \"c\": there is no [[arm]] of this name"),
            ("kill device", format!("kill {long}").as_str(), "cell 2: with: one has 206 bytes, at most 200"),
            ("name = \"b\"", format!("name = \"{long}\"").as_str(), "[[arm]] name: one has 201 bytes"),
        ] {
            let refused = parse("t", &TEXT.replacen(change, by, 1)).unwrap_err();
            assert!(refused.starts_with(words), "{by}: {refused}");
        }
        // In two tables the same cell is there twice, too.
        let again = "[[cell]]\nkinds = [\"kill\"]\ntargets = [\"fluid\"]\nstates = [\"idle\"]\ncount = 1\n";
        assert_eq!(
            parse("t", &(TEXT.to_string() + again)).unwrap_err(),
            "cell \"kill fluid idle\" is there twice; give its counts in one"
        );
    }

    #[test]
    fn of_whatever_is_written_comes_a_campaign_of_as_many_faults_as_there_may_be_or_a_refusal() {
        let mut draw = Draw::new(1);
        let mut taken = 0;
        for _ in 0..2_000 {
            let mut lines: Vec<Vec<u8>> = TEXT.lines().map(|line| line.as_bytes().to_vec()).collect();
            for _ in 0..draw.between(1, 3) {
                let last = lines.len() as u64 - 1;
                let (at, other) = (draw.between(0, last) as usize, draw.between(0, last) as usize);
                match draw.between(0, 3) {
                    0 => lines[at] = lines[other].clone(),
                    1 => lines.swap(at, other),
                    2 => lines[at].truncate(draw.between(0, 9) as usize),
                    _ => lines[at].extend(draw.bits().to_le_bytes()),
                }
            }
            let text = String::from_utf8_lossy(&lines.join(&b'\n')).into_owned();
            match parse("t", &text) {
                Ok(campaign) => {
                    taken += 1;
                    assert!((1..=MOST_FAULTS).contains(&campaign.faults()) && campaign.cells.len() <= MOST_FAULTS, "{text}");
                }
                Err(refused) => assert!(!refused.is_empty(), "{text}"),
            }
        }
        assert!(taken > 0, "some lines may be left out");
    }
}
