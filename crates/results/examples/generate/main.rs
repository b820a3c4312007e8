//! Writes what is made from the result types: the reference page, the JSON Schemas and the Python
//! classes.
//!
//! `cargo xtask results` runs it; the test of this example compares them with the files.

mod page;
mod python;
mod shape;

use std::fs;
use std::path::{Path, PathBuf};

use mishandle_results::{Document, SCHEMA};
use serde_json::{Value, json};

use crate::shape::Types;

/// The reference page.
const PAGE: &str = "docs/reference/json.md";

/// Folder of the JSON Schemas, one for each document.
const SCHEMAS: &str = "docs/reference/schemas";

/// The Python classes.
const PYTHON: &str = "python/mishandle/results.py";

/// The command that writes the files.
const COMMAND: &str = "cargo xtask results";

fn main() -> std::io::Result<()> {
    let root = root();
    for (path, text) in files() {
        let path = root.join(path);
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder)?;
        }
        fs::write(path, text)?;
    }
    Ok(())
}

/// Returns the root of the repository.
fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Returns the path of each file, from the root of the repository, and its text.
fn files() -> Vec<(String, String)> {
    let documents = Document::all();
    let types = Types::new(&documents);
    let mut files: Vec<(String, String)> = documents
        .iter()
        .map(|document| (format!("{SCHEMAS}/{}.json", file_name(document)), schema(document)))
        .collect();
    files.push((PAGE.to_string(), page::page(&documents, &types, COMMAND)));
    files.push((PYTHON.to_string(), python::module(&types)));
    files
}

/// Returns the name of a schema without ending: `explain-masking` for `explain --masking`.
fn file_name(document: &Document) -> String {
    let words = document.command.to_lowercase();
    words.split([' ', '-']).filter(|word| !word.is_empty()).collect::<Vec<_>>().join("-")
}

/// Returns the JSON Schema of what a command prints: the object, or the array of objects, with the
/// key `schema`.
fn schema(document: &Document) -> String {
    let mut object = document.schema().to_value();
    let version = json!({ "const": SCHEMA, "description": "Version of the document." });
    if let Some(properties) = object["properties"].as_object_mut() {
        properties.shift_insert(0, "schema".to_string(), version);
    }
    if let Some(required) = object["required"].as_array_mut() {
        required.insert(0, Value::from("schema"));
    }
    let schema = match document.is_array {
        false => object,
        true => {
            let (dialect, types) = (object["$schema"].take(), object["$defs"].take());
            if let Some(entries) = object.as_object_mut() {
                entries.retain(|_, value| !value.is_null());
            }
            let mut array = json!({ "$schema": dialect, "type": "array", "items": object });
            if !types.is_null() {
                array["$defs"] = types;
            }
            array
        }
    };
    format!("{schema:#}\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_generated_files_are_up_to_date() {
        for (path, text) in files() {
            let found = fs::read_to_string(root().join(&path)).unwrap_or_default();
            assert!(found == text, "{path} is out of date; run: {COMMAND}");
        }
    }

    #[test]
    fn every_schema_of_the_folder_is_that_of_a_document() {
        let known: Vec<String> = files().into_iter().map(|(path, _)| path).collect();
        for entry in fs::read_dir(root().join(SCHEMAS)).unwrap() {
            let path = format!("{SCHEMAS}/{}", entry.unwrap().file_name().to_string_lossy());
            assert!(known.contains(&path), "{path} is not the schema of a document; remove it");
        }
    }

    #[test]
    fn every_field_has_a_description() {
        for (name, fields) in Types::new(&Document::all()).objects() {
            for field in fields {
                assert!(!field.description.is_empty(), "{name}.{} has no description", field.key);
            }
        }
    }
}
