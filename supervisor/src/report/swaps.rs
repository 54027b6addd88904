//! The swaps of a run in the line that people read at its end.

use serde_json::Value;

/// What became of those that were asked for, by the words of the report.
const BECAME: [(&str, &str); 4] =
    [("done", "done"), ("rolled_back", "rolled back"), ("refused", "refused"), ("under_way", "not over")];

/// How many came to what; nothing where none was asked for.
pub(super) fn in_words(report: &Value) -> String {
    let all: Vec<&Value> = report["swaps"].as_array().into_iter().flatten().collect();
    let counted = BECAME.map(|(became, words)| (all.iter().filter(|swap| swap["became"] == became).count(), words));
    let said: Vec<String> =
        counted.into_iter().filter(|(count, _)| *count > 0).map(|(count, words)| format!("{count} {words}")).collect();
    if said.is_empty() { String::new() } else { format!("; swaps: {}", said.join(", ")) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn the_line_counts_swaps_by_what_became_of_them_and_is_silent_where_there_were_none() {
        let of = |all: &[&str]| {
            let swaps: Vec<Value> = all.iter().map(|became| json!({ "became": became })).collect();
            in_words(&json!({ "swaps": swaps }))
        };
        assert_eq!(of(&["done", "refused", "rolled_back", "done"]), "; swaps: 2 done, 1 rolled back, 1 refused");
        assert_eq!(of(&["under_way"]), "; swaps: 1 not over");
        assert_eq!([of(&[]), in_words(&json!({})), in_words(&json!([]))], [""; 3]);
    }
}
