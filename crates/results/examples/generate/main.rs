//! Writes what is made from the result types: the reference page, the JSON Schemas and the Python
//! classes. `cargo xtask results` runs it.

mod page;
mod python;
mod shape;

use std::fs;
use std::io::{Error, Result};
use std::path::Path;

use mishandle_results::{Document, SCHEMA};
use serde_json::{Value, json};

use crate::shape::Types;

/// The text before the tables of the reference page.
const HEAD: &str = "docs/reference/json.md";

/// Folder of the reference page and of the JSON Schemas, one for each document.
const REFERENCE: &str = "target/reference";

/// The Python classes.
const PYTHON: &str = "python/mishandle/results.py";

fn main() -> Result<()> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let documents = Document::all();
    let types = Types::new(&documents);
    if let Some(field) = types.without_description() {
        return Err(Error::other(format!("{field} has no doc comment")));
    }
    let schemas = root.join(REFERENCE).join("schemas");
    fs::create_dir_all(&schemas)?;
    for document in &documents {
        fs::write(schemas.join(file_name(document)), schema(document))?;
    }
    let head = fs::read_to_string(root.join(HEAD))?;
    fs::write(root.join(REFERENCE).join("json.md"), head + &page::sections(&documents, &types))?;
    fs::write(root.join(PYTHON), python::module(&types))
}

/// Returns the file name of a schema: `show-masking.json` for `show --masking`.
fn file_name(document: &Document) -> String {
    let words = document.command.to_lowercase();
    words.split([' ', '-']).filter(|word| !word.is_empty()).collect::<Vec<_>>().join("-") + ".json"
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
    let schema = if document.is_array {
        let dialect = object["$schema"].take();
        let types = object["$defs"].take();
        if let Some(entries) = object.as_object_mut() {
            entries.retain(|_, value| !value.is_null());
        }
        let mut array = json!({ "$schema": dialect, "type": "array", "items": object });
        if !types.is_null() {
            array["$defs"] = types;
        }
        array
    } else {
        object
    };
    format!("{schema:#}\n")
}
