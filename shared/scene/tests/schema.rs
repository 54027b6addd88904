//! The committed JSON schemas are those that the types give.
#![allow(missing_docs)]

use std::path::Path;

/// Set to write the schema anew instead of comparing it.
const UPDATE: &str = "HYST_UPDATE_SCHEMA";

#[test]
fn the_schemas_in_assets_are_up_to_date() {
    for (name, schema) in [("scene", hyst_scene::schema_json()), ("case", hyst_scene::case_schema_json())] {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../../assets/schema/{name}.schema.json"));
        if std::env::var_os(UPDATE).is_some() {
            std::fs::write(&path, &schema).unwrap();
        }
        let committed = std::fs::read_to_string(&path).unwrap_or_default();
        assert!(committed == schema, "{} is out of date: run the test with {UPDATE}=1 and commit it", path.display());
    }
}

#[test]
fn the_schema_names_every_table_and_forbids_unknown_keys() {
    let schema: serde_json::Value = serde_json::from_str(&hyst_scene::schema_json()).unwrap();
    for table in ["deformable", "rigid", "workspace", "fluid", "view", "hand"] {
        assert!(schema["properties"].get(table).is_some(), "{table}");
    }
    assert_eq!(schema["additionalProperties"], false);
}

#[test]
fn the_schema_of_a_case_names_every_table_and_forbids_unknown_keys() {
    let schema: serde_json::Value = serde_json::from_str(&hyst_scene::case_schema_json()).unwrap();
    for table in ["rung", "task", "scene", "seed", "vary", "rules", "place", "goal", "end", "warning", "score"] {
        assert!(schema["properties"].get(table).is_some(), "{table}");
    }
    assert_eq!(schema["additionalProperties"], false);
}
