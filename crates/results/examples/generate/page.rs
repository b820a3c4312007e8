//! The reference page: a section for each document, and one for each type that several fields have.

use mishandle_results::Document;

use crate::shape::{Field, Object, Shape, Types};

/// The text before the tables. The block is the output of the example.
const HEAD: &str = r#"# Read results as JSON

To process results in a script, add `--json` to a command:

```console
$ mishandle monitor --formula 'always[0:2](d <= 0.35)' d.csv --json
{
  "schema": 1,
  "robustness": 0.04999999999999999,
  "windows": "cut",
  "cuts_windows": false,
  "robustness_signal": [
    0.04999999999999999,
    0.04999999999999999,
    0.24999999999999997
  ]
}
```

Here `d.csv` has the lines `d`, `0.2`, `0.3` and `0.1`.

The command prints one document to stdout: an object, or an array of objects for `tasks`, `searches` and `runs`. Messages go to
stderr. The same command with the same seed prints the same bytes, except for `run`, the path of the run file, and
`wall_clock_secs`. If a command fails, stdout is empty and stderr contains the error message. An interrupted command prints the
document of its finished simulations.

- `schema` is the first key of every object that a command prints: the version of the documents, 1. Within a version, keys are
  only added.
- A `seed` is a string of digits, because many JSON readers round integers above 2^53.
- An infinity is the string `"inf"` or `"-inf"`. Missing values are `null`.
- Rates are fractions from 0 to 1. Times are in seconds or in control steps, as stated in the tables.
- A `map` is an object whose keys are names, such as the names of axes or options.
- A key whose type ends with `?` is missing where the text says so.

Each document has a [JSON Schema](SCHEMAS). The Python package has the same types as classes: `mishandle.results`. This page, the
schemas and the classes are written by `COMMAND`.
"#;

/// Link from the page to the folder of the schemas.
const SCHEMAS: &str = "schemas";

/// Returns the page. `command` is the command that writes it.
pub fn page(documents: &[Document], types: &Types, command: &str) -> String {
    let page = Page { documents, types };
    let mut text = HEAD.replace("SCHEMAS", SCHEMAS).replace("COMMAND", command);
    for document in documents {
        let object = types.get(document.name);
        text += &format!("\n## `{}`\n\n", document.command);
        if document.is_array {
            text += "An array of objects. ";
        }
        text += &format!("{}\n\n{}", object.description, page.table(object));
    }
    text += "\n## Types\n\nObjects that several keys hold, or that are one of several of a key.\n";
    for object in types.all().iter().filter(|object| page.has_section(&object.name)) {
        text += &format!("\n### {}\n\n{}\n\n{}", object.name, object.description, page.table(object));
    }
    text
}

struct Page<'a> {
    documents: &'a [Document],
    types: &'a Types,
}

impl Page<'_> {
    /// Returns whether a type is described in a section of its own, because several keys hold it, or
    /// one key holds it or another type.
    fn has_section(&self, name: &str) -> bool {
        self.document(name).is_none() && self.types.uses().get(name).is_some_and(|uses| *uses > 1)
    }

    fn document(&self, name: &str) -> Option<&Document> {
        self.documents.iter().find(|document| document.name == name)
    }

    fn table(&self, object: &Object) -> String {
        let mut rows = String::from("| key | type | meaning |\n|---|---|---|\n");
        self.rows(object, "", &mut rows);
        rows
    }

    fn rows(&self, object: &Object, prefix: &str, rows: &mut String) {
        for field in &object.fields {
            let optional = if field.is_required { "" } else { "?" };
            let key = format!("{prefix}{}", field.key);
            *rows += &format!(
                "| `{key}` | {}{optional} | {} |\n",
                self.kind(&field.shape),
                meaning(field).replace('|', "\\|")
            );
            if let Some((name, suffix)) = nested(&field.shape)
                && self.document(name).is_none()
                && !self.has_section(name)
            {
                self.rows(self.types.get(name), &format!("{key}{suffix}."), rows);
            }
        }
    }

    fn kind(&self, shape: &Shape) -> String {
        let name = match shape {
            Shape::Null => "null",
            Shape::String => "string",
            Shape::Boolean => "boolean",
            Shape::Integer => "integer",
            Shape::Number => "number",
            Shape::Extended => "number or infinity",
            Shape::Seed => "seed",
            Shape::Object(name) => {
                return match self.document(name) {
                    Some(document) => format!("[`{}`](#{})", document.command, anchor(document.command)),
                    None if self.has_section(name) => format!("[{name}](#{})", name.to_lowercase()),
                    None => "object".to_string(),
                };
            }
            Shape::Array(item) => return format!("array of {}", self.kind(item)),
            Shape::Fixed(item, length) => return format!("array of {length} {}", self.kind(item)),
            Shape::Map(item) => return format!("map to {}", self.kind(item)),
            Shape::OneOf(shapes) => {
                return shapes.iter().map(|shape| self.kind(shape)).collect::<Vec<_>>().join(" or ");
            }
        };
        name.to_string()
    }
}

fn meaning(field: &Field) -> String {
    field.description.trim_end_matches('.').to_string()
}

/// Returns the object type in a field, and what follows the key of the field in those of the
/// object.
fn nested(shape: &Shape) -> Option<(&str, &'static str)> {
    match shape {
        Shape::Object(name) => Some((name, "")),
        Shape::Array(item) => nested(item).map(|(name, _)| (name, "[]")),
        Shape::Map(item) => nested(item).map(|(name, _)| (name, ".NAME")),
        Shape::OneOf(shapes) => shapes.iter().find_map(nested),
        _ => None,
    }
}

/// Returns the anchor that Markdown makes of the title of a section.
fn anchor(command: &str) -> String {
    command.to_lowercase().replace(' ', "-")
}
