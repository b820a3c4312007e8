//! The tree of a TOML file, in the order of its text and with the place of each part.

use std::ops::Range;

use mishandle_rollout::Interval;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::error::Problem;

/// A value with its place in the text.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Item {
    pub value: Value,
    pub span: Range<usize>,
}

#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Value {
    Text(String),
    Number(f64),
    Bool(bool),
    List(Vec<Item>),
    Table(Table),
    /// A date or a time, which no key takes.
    Date,
}

/// A table: its keys in the order of the text.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Table {
    pub entries: Vec<(Key, Item)>,
    pub span: Range<usize>,
}

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Key {
    pub name: String,
    pub span: Range<usize>,
}

/// A text with its place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Text {
    pub text: String,
    pub span: Range<usize>,
}

/// Parses a file.
pub(crate) fn parse(text: &str) -> Result<Table, Problem> {
    let table = DeTable::parse(text)
        .map_err(|error| Problem::new(&error.span().unwrap_or_default(), error.message().to_string()))?;
    Ok(of_table(table.get_ref(), &table.span()))
}

fn of_table(table: &DeTable<'_>, span: &Range<usize>) -> Table {
    let mut entries: Vec<(Key, Item)> = table
        .iter()
        .map(|(key, value)| {
            let key = Key { name: key.get_ref().to_string(), span: key.span() };
            let item = of_value(value);
            (key, item)
        })
        .collect();
    entries.sort_by_key(|(key, _)| key.span.start);
    Table { entries, span: span.clone() }
}

fn of_value(value: &Spanned<DeValue<'_>>) -> Item {
    let span = value.span();
    let value = match value.get_ref() {
        DeValue::String(text) => Value::Text(text.to_string()),
        DeValue::Integer(integer) => {
            let digits = integer.as_str();
            i64::from_str_radix(digits, integer.radix())
                .map_or(Value::Date, |number| Value::Number(number as f64))
        }
        DeValue::Float(float) => float.as_str().parse().map_or(Value::Date, Value::Number),
        DeValue::Boolean(value) => Value::Bool(*value),
        DeValue::Datetime(_) => Value::Date,
        DeValue::Array(items) => Value::List(items.iter().map(of_value).collect()),
        DeValue::Table(table) => Value::Table(of_table(table, &span)),
    };
    Item { value, span }
}

impl Item {
    /// Returns the kind of value, for messages.
    pub(crate) fn kind(&self) -> &'static str {
        match self.value {
            Value::Text(_) => "a text",
            Value::Number(_) => "a number",
            Value::Bool(_) => "true or false",
            Value::List(_) => "a list",
            Value::Table(_) => "a table",
            Value::Date => "another value",
        }
    }

    fn expected(&self, what: &str, expected: &str) -> Problem {
        Problem::new(&self.span, format!("`{what}` must be {expected}, not {}", self.kind()))
    }

    pub(crate) fn text(&self, what: &str) -> Result<Text, Problem> {
        match &self.value {
            Value::Text(text) => Ok(Text { text: text.clone(), span: self.span.clone() }),
            _ => Err(self.expected(what, "a text in quotation marks")),
        }
    }

    pub(crate) fn number(&self, what: &str) -> Result<f64, Problem> {
        match self.value {
            Value::Number(number) if number.is_finite() => Ok(number),
            Value::Number(_) => Err(Problem::new(&self.span, format!("`{what}` must be finite"))),
            _ => Err(self.expected(what, "a number")),
        }
    }

    pub(crate) fn numbers(&self, what: &str) -> Result<Vec<f64>, Problem> {
        match &self.value {
            Value::List(items) => items.iter().map(|item| item.number(what)).collect(),
            _ => Err(self.expected(what, "a list of numbers")),
        }
    }

    /// Returns the bounds of a list of two numbers, or of an interval in quotation marks.
    pub(crate) fn range(&self, what: &str) -> Result<[f64; 2], Problem> {
        let wrong = || {
            let message = format!(
                "`{what}` must be two numbers [low, high], low at most high, or an interval such as \"[0, 1)\""
            );
            Problem::new(&self.span, message)
        };
        let [low, high] = match &self.value {
            Value::Text(text) => {
                let Interval { low, high } = text.parse().map_err(|_| wrong())?;
                [low, high]
            }
            _ => self.numbers(what)?.try_into().map_err(|_| wrong())?,
        };
        if low <= high && low.is_finite() && high.is_finite() { Ok([low, high]) } else { Err(wrong()) }
    }

    pub(crate) fn table(&self, what: &str) -> Result<&Table, Problem> {
        match &self.value {
            Value::Table(table) => Ok(table),
            _ => Err(self.expected(what, "a table")),
        }
    }

    /// Returns one text, or several of a list.
    pub(crate) fn texts(&self, what: &str) -> Result<Vec<Text>, Problem> {
        match &self.value {
            Value::List(items) => items.iter().map(|item| item.text(what)).collect(),
            _ => Ok(vec![self.text(what)?]),
        }
    }
}

/// Reads the keys of a table, and reports those that it does not know.
pub(crate) struct Fields<'a> {
    table: &'a Table,
    /// Name of the table in messages, for instance `[control]`.
    name: String,
    known: Vec<&'static str>,
}

impl<'a> Fields<'a> {
    pub(crate) fn new(table: &'a Table, name: impl Into<String>) -> Fields<'a> {
        Fields { table, name: name.into(), known: Vec::new() }
    }

    pub(crate) fn get(&mut self, key: &'static str) -> Option<&'a Item> {
        self.known.push(key);
        self.table.entries.iter().find(|(known, _)| known.name == key).map(|(_, item)| item)
    }

    pub(crate) fn need(&mut self, key: &'static str) -> Result<&'a Item, Problem> {
        let missing = Problem::new(&self.table.span, format!("{} needs the key `{key}`", self.name));
        self.get(key).ok_or(missing)
    }

    pub(crate) fn text(&mut self, key: &'static str) -> Result<Option<Text>, Problem> {
        self.get(key).map(|item| item.text(key)).transpose()
    }

    pub(crate) fn number(&mut self, key: &'static str) -> Result<Option<f64>, Problem> {
        self.get(key).map(|item| item.number(key)).transpose()
    }

    pub(crate) fn range(&mut self, key: &'static str) -> Result<Option<[f64; 2]>, Problem> {
        self.get(key).map(|item| item.range(key)).transpose()
    }

    pub(crate) fn texts(&mut self, key: &'static str) -> Result<Vec<Text>, Problem> {
        Ok(self.get(key).map(|item| item.texts(key)).transpose()?.unwrap_or_default())
    }

    /// Returns a switch; false if it is missing.
    pub(crate) fn flag(&mut self, key: &'static str) -> Result<bool, Problem> {
        match self.get(key).map(|item| (&item.value, &item.span)) {
            None => Ok(false),
            Some((Value::Bool(value), _)) => Ok(*value),
            Some((_, span)) => Err(Problem::new(span, format!("`{key}` must be true or false"))),
        }
    }

    /// Returns the table of a key; an empty one if it is missing.
    pub(crate) fn entries(&mut self, key: &'static str) -> Result<&'a [(Key, Item)], Problem> {
        Ok(self
            .get(key)
            .map(|item| item.table(key))
            .transpose()?
            .map_or(&[], |table| table.entries.as_slice()))
    }

    /// Reports a key that was not requested.
    pub(crate) fn finish(self) -> Result<(), Problem> {
        let unknown = self.table.entries.iter().find(|(key, _)| !self.known.contains(&key.name.as_str()));
        let Some((key, _)) = unknown else { return Ok(()) };
        let hint = mishandle_stl::nearest(&key.name, self.known.iter().copied());
        let hint = hint.map_or(String::new(), |known| format!("; did you mean `{known}`?"));
        let message =
            format!("{} has no key `{}`{hint} (keys: {})", self.name, key.name, self.known.join(", "));
        Err(Problem::new(&key.span, message))
    }
}
