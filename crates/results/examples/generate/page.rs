//! The sections of the reference page: one for each document, and one for each type that several
//! fields have.

use mishandle_results::Document;

use crate::shape::{Field, Object, Shape, Types};

/// Returns the sections that follow the text of the page.
pub fn sections(documents: &[Document], types: &Types) -> String {
    let page = Page { documents, types };
    let mut text = String::new();
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
    /// Returns whether a type is described in a section of its own, because several keys hold it,
    /// or one key holds it or another type.
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
                    Some(document) => {
                        format!("[`{}`](#{})", document.command, anchor(document.command))
                    }
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
