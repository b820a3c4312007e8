//! The types of the documents, read from their JSON Schemas.

use std::collections::BTreeMap;

use mishandle_results::Document;
use serde_json::Value;

/// The type of a value.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    Null,
    String,
    Boolean,
    Integer,
    Number,
    /// A number; infinities are strings.
    Extended,
    /// A string of digits.
    Seed,
    /// An object of this type.
    Object(String),
    Array(Box<Shape>),
    /// An array of this length.
    Fixed(Box<Shape>, u64),
    /// An object whose keys are names.
    Map(Box<Shape>),
    OneOf(Vec<Shape>),
}

/// A field of an object.
#[derive(Clone, Debug, PartialEq)]
pub struct Field {
    pub key: String,
    pub shape: Shape,
    /// Whether every object has it.
    pub is_required: bool,
    pub description: String,
}

/// An object type.
#[derive(Clone, Debug, PartialEq)]
pub struct Object {
    pub name: String,
    pub description: String,
    pub fields: Vec<Field>,
}

/// All object types of the documents.
pub struct Types {
    /// In the order of their first appearance; those that a type uses come before it.
    objects: Vec<Object>,
}

impl Types {
    pub fn new(documents: &[Document]) -> Types {
        let mut types = Types { objects: Vec::new() };
        for document in documents {
            let schema = document.schema().to_value();
            if let Some(definitions) = schema["$defs"].as_object() {
                for (name, definition) in definitions {
                    if definition["type"] == "object" {
                        types.add(object(name, definition));
                    }
                }
            }
            types.add(object(document.name, &schema));
        }
        types
    }

    fn add(&mut self, object: Object) {
        match self.objects.iter().find(|known| known.name == object.name) {
            None => self.objects.push(object),
            Some(known) => assert_eq!(*known, object, "two types have the name {}", known.name),
        }
    }

    pub fn all(&self) -> &[Object] {
        &self.objects
    }

    pub fn get(&self, name: &str) -> &Object {
        match self.objects.iter().find(|object| object.name == name) {
            Some(object) => object,
            None => panic!("there is no type {name}"),
        }
    }

    /// Returns the name of a field without a description, `TYPE.FIELD`.
    pub fn without_description(&self) -> Option<String> {
        let mut fields =
            self.objects.iter().flat_map(|object| object.fields.iter().map(move |field| (object, field)));
        let (object, field) = fields.find(|(_, field)| field.description.is_empty())?;
        Some(format!("{}.{}", object.name, field.key))
    }

    /// Returns how many fields have each type. One of several types of a field counts twice: its
    /// keys are not those of the field alone.
    pub fn uses(&self) -> BTreeMap<String, usize> {
        let mut uses = BTreeMap::new();
        for field in self.objects.iter().flat_map(|object| &object.fields) {
            count(&field.shape, &mut uses);
        }
        uses
    }
}

fn count(shape: &Shape, uses: &mut BTreeMap<String, usize>) {
    match shape {
        Shape::Object(name) => *uses.entry(name.clone()).or_default() += 1,
        Shape::Array(item) | Shape::Fixed(item, _) | Shape::Map(item) => count(item, uses),
        Shape::OneOf(shapes) => {
            let objects = shapes.iter().filter(|shape| matches!(shape, Shape::Object(_))).count();
            let times = if objects > 1 { 2 } else { 1 };
            shapes.iter().for_each(|shape| (0..times).for_each(|_| count(shape, uses)));
        }
        _ => {}
    }
}

fn text(value: &Value) -> String {
    // A paragraph of a doc comment is wrapped.
    value.as_str().unwrap_or_default().replace('\n', " ").replace("  ", "\n\n")
}

fn object(name: &str, schema: &Value) -> Object {
    let required = schema["required"].as_array().cloned().unwrap_or_default();
    let properties = schema["properties"].as_object().cloned().unwrap_or_default();
    let fields = properties.iter().map(|(key, property)| Field {
        key: key.clone(),
        shape: shape(property),
        is_required: required.iter().any(|known| known == key),
        description: text(&property["description"]),
    });
    Object { name: name.to_string(), description: text(&schema["description"]), fields: fields.collect() }
}

fn shape(schema: &Value) -> Shape {
    if let Some(reference) = schema["$ref"].as_str() {
        return match reference.rsplit('/').next().unwrap_or_default() {
            "Number" => Shape::Extended,
            "Seed" => Shape::Seed,
            name => Shape::Object(name.to_string()),
        };
    }
    if let Some(alternatives) = schema["anyOf"].as_array() {
        return Shape::OneOf(alternatives.iter().map(shape).collect());
    }
    match &schema["type"] {
        Value::Array(kinds) => Shape::OneOf(kinds.iter().map(|kind| of_kind(kind, schema)).collect()),
        kind => of_kind(kind, schema),
    }
}

fn of_kind(kind: &Value, schema: &Value) -> Shape {
    let item = || Box::new(shape(&schema["items"]));
    match (kind.as_str(), schema["maxItems"].as_u64()) {
        (Some("null"), _) => Shape::Null,
        (Some("string"), _) => Shape::String,
        (Some("boolean"), _) => Shape::Boolean,
        (Some("integer"), _) => Shape::Integer,
        (Some("number"), _) => Shape::Number,
        (Some("array"), None) => Shape::Array(item()),
        (Some("array"), Some(length)) => Shape::Fixed(item(), length),
        (Some("object"), _) => Shape::Map(Box::new(shape(&schema["additionalProperties"]))),
        _ => panic!("a schema of unknown type: {schema}"),
    }
}
