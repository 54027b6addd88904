//! The committed JSON schema of a campaign is the one that the types give, it is as strict as they are, and the handbook has each of its keys.
#![allow(missing_docs)]

use serde_json::Value;
use std::path::{Path, PathBuf};

/// Set to write the schema anew instead of comparing it, as for the scene's.
const UPDATE: &str = "HYST_UPDATE_SCHEMA";

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn schema() -> Value {
    serde_json::from_str(&hystation::campaign::file::schema_json()).unwrap()
}

/// The table of the schema that a table of a file is described by: the file itself for `""`.
fn described<'a>(schema: &'a Value, table: &str) -> &'a Value {
    let of_list = &schema["properties"][table]["items"]["$ref"];
    let name = of_list.as_str().or(schema["properties"][table]["$ref"].as_str()).unwrap_or("");
    name.strip_prefix("#/$defs/").map_or(schema, |name| &schema["$defs"][name])
}

const TABLES: [&str; 5] = ["", "station", "arm", "pool", "cell"];

#[test]
fn the_schema_of_a_campaign_is_up_to_date() {
    let (path, schema) = (root().join("assets/schema/campaign.schema.json"), hystation::campaign::file::schema_json());
    if std::env::var_os(UPDATE).is_some() {
        std::fs::write(&path, &schema).unwrap();
    }
    let committed = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(committed == schema, "{} is out of date: run the test with {UPDATE}=1 and commit it", path.display());
}

#[test]
fn the_schema_names_every_key_of_the_campaigns_that_are_shipped_and_forbids_others() {
    let schema = schema();
    for table in TABLES {
        assert_eq!(described(&schema, table)["additionalProperties"], false, "[{table}]");
    }
    // What the cell itself says of a fault is no key of its own.
    for key in ["kind", "target", "tick", "phase_us"] {
        assert!(described(&schema, "cell")["properties"].get(key).is_none(), "{key}");
    }
    let mut seen = 0;
    for entry in std::fs::read_dir(root().join("assets/campaigns")).unwrap().flatten() {
        let file: toml::Table = std::fs::read_to_string(entry.path()).unwrap().parse().unwrap();
        let mut look = |table: &str, keys: &toml::Table| {
            for key in keys.keys() {
                assert!(described(&schema, table)["properties"].get(key).is_some(), "{:?}: [{table}] {key}", entry.path());
                seen += 1;
            }
        };
        look("", &file);
        for table in TABLES.into_iter().skip(1) {
            let said = file.get(table);
            let one = said.and_then(|value| value.as_table()).into_iter();
            let many = said.and_then(|value| value.as_array()).into_iter().flatten().filter_map(|value| value.as_table());
            one.chain(many).for_each(|keys| look(table, keys));
        }
    }
    assert!(seen > 100, "{seen} keys");
}

#[test]
fn the_handbook_has_each_key_of_a_campaign() {
    let (schema, handbook) = (schema(), std::fs::read_to_string(root().join("docs/handbook.md")).unwrap());
    let section = handbook.split_once("### What a campaign says").map(|(_, rest)| rest).expect("a section");
    let section = section.split_once("\n### ").map_or(section, |(section, _)| section);
    for table in TABLES {
        let keys = described(&schema, table)["properties"].as_object().expect("properties").keys();
        // The tables' own names head their rows.
        for key in keys.filter(|key| !TABLES.contains(&key.as_str())) {
            assert!(section.contains(&format!("`{key}`")), "[{table}] {key}");
        }
    }
}
