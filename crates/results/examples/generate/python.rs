//! The Python classes: a frozen dataclass for each object type.

use crate::shape::{Field, Object, Shape, Types};

/// The code around the classes.
const HEAD: &str = include_str!("head.py");
const TAIL: &str = include_str!("tail.py");

/// Width of docstrings, in columns.
const WIDTH: usize = 100;

/// Returns the module.
pub fn module(types: &Types) -> String {
    let classes: Vec<String> = types.all().iter().map(class).collect();
    format!("{HEAD}\n\n{}\n\n{TAIL}", classes.join("\n\n"))
}

fn class(object: &Object) -> String {
    let fields: String = object.fields.iter().map(field).collect();
    format!(
        "@dataclasses.dataclass(frozen=True, kw_only=True)\nclass {}:\n{}\n{fields}",
        object.name,
        docstring(&object.description)
    )
}

fn field(field: &Field) -> String {
    let kind = kind(&field.shape);
    let kind = if field.is_required || kind.ends_with("| None") { kind } else { format!("{kind} | None") };
    let default = if field.is_required { "" } else { " = None" };
    format!("    {}: {kind}{default}\n{}", field.key, docstring(&field.description))
}

fn kind(shape: &Shape) -> String {
    match shape {
        Shape::Null => "None".to_string(),
        Shape::String => "str".to_string(),
        Shape::Boolean => "bool".to_string(),
        Shape::Integer | Shape::Seed => "int".to_string(),
        Shape::Number | Shape::Extended => "float".to_string(),
        Shape::Object(name) => name.clone(),
        Shape::Array(item) => format!("tuple[{}, ...]", kind(item)),
        Shape::Fixed(item, length) => {
            format!("tuple[{}]", vec![kind(item); *length as usize].join(", "))
        }
        Shape::Map(item) => {
            format!("dict[str, {}]", axis_value(item).unwrap_or_else(|| kind(item)))
        }
        Shape::OneOf(shapes) => shapes.iter().map(kind).collect::<Vec<_>>().join(" | "),
    }
}

/// Returns the Python type of values by axis, which have the names of categories. A scenario leaves
/// out values that are drawn at random.
fn axis_value(shape: &Shape) -> Option<String> {
    let Shape::OneOf(shapes) = shape else { return None };
    match shapes.as_slice() {
        [Shape::Number, Shape::Null] => Some("Value".to_string()),
        [Shape::Fixed(item, 2), Shape::Null] if **item == Shape::Number => {
            Some("tuple[Value, Value] | None".to_string())
        }
        _ => None,
    }
}

/// Returns a text as a docstring within a class.
fn docstring(text: &str) -> String {
    let text = text.replace("drawn at random is `null`", "drawn at random is missing");
    let text = text.replace("`null`", "`None`").replace('`', "``").replace('\\', "\\\\");
    let paragraphs: Vec<String> = text.split("\n\n").map(wrapped).collect();
    let body = paragraphs.join("\n\n    ");
    let end = if paragraphs.len() > 1 { "\n    " } else { "" };
    format!("    \"\"\"{body}{end}\"\"\"\n")
}

fn wrapped(paragraph: &str) -> String {
    let mut lines = vec![String::new()];
    for word in paragraph.split_whitespace() {
        let line = lines.len() - 1;
        let indent = if line == 0 { 7 } else { 4 };
        // The quotes at the end need three columns.
        if lines[line].is_empty() {
            lines[line] = word.to_string();
        } else if indent + lines[line].chars().count() + 1 + word.chars().count() + 3 <= WIDTH {
            lines[line] += &format!(" {word}");
        } else {
            lines.push(word.to_string());
        }
    }
    lines.join("\n    ")
}
