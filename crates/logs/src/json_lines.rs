//! JSON lines: one object per line. The names of nested fields are joined by `/`, elements of
//! arrays have their index in brackets: `pose/position/x`, `ranges[0]`.

use std::borrow::Cow;
use std::collections::HashMap;
use std::fmt;
use std::io::{BufRead, BufReader, Read};

use mishandle_text::visible;
use serde::de::{DeserializeSeed, Deserializer, Error as _, IgnoredAny, MapAccess, SeqAccess, Visitor};

use crate::cell::{Cell, Sinks};
use crate::error::{Result, content};
use crate::place::Counted;
use crate::table::Table;

/// Largest size of a line in bytes.
const MAX_LINE: u64 = 16 << 20;

/// The lines whose fields are the columns: this many lines, of this many bytes.
pub(crate) const HEAD_LINES: usize = 1000;
const HEAD_BYTES: usize = 4 << 20;

/// Largest number of columns, and of the bytes of their names.
const MAX_NAMES: usize = 1_000_000;
const MAX_NAME_BYTES: usize = 64 << 20;

/// The columns of a file.
pub(crate) struct JsonHead<'a> {
    /// The fields of this many lines, without blank ones.
    pub(crate) lines: usize,
    /// Fields that only later lines can have.
    pub(crate) more: &'a [String],
}

/// A file of JSON lines whose first lines were read.
pub(crate) struct JsonTable {
    source: BufReader<Box<dyn Read>>,
    head: Vec<Vec<u8>>,
    names: Vec<String>,
}

impl JsonTable {
    /// Reads the first lines, whose fields are the columns.
    pub(crate) fn open(source: Box<dyn Read>, of: &JsonHead<'_>) -> Result<JsonTable> {
        let mut source = BufReader::new(source);
        let mut known = Names::default();
        let mut head = Vec::new();
        let mut bytes = 0;
        let mut read = 0;
        while read < of.lines && bytes < HEAD_BYTES {
            let Some(line) = next_line(&mut source, head.len())? else { break };
            bytes += line.len();
            read += usize::from(!line.trim_ascii().is_empty());
            read_line(&line, head.len() as u64 + 1, &mut known)?;
            head.push(line);
        }
        if known.list.is_empty() {
            return Err(content(
                "the file has no fields; each line must be a JSON object such as {\"time\": 0.1, \"d\": 2}",
            ));
        }
        for name in of.more {
            known.add(name);
        }
        Ok(JsonTable { source, head, names: known.list })
    }
}

impl Table for JsonTable {
    fn names(&self) -> &[String] {
        &self.names
    }

    fn counted(&self) -> Counted {
        Counted::Lines
    }

    fn read(mut self: Box<Self>, sinks: &mut Sinks) -> Result<()> {
        let mut slots: HashMap<String, usize> = HashMap::new();
        let mut columns: Vec<usize> = sinks.columns.iter().map(|(column, _)| *column).collect();
        columns.sort_unstable();
        columns.dedup();
        for (slot, column) in columns.iter().enumerate() {
            slots.insert(self.names[*column].clone(), slot);
        }
        let slot_of: Vec<usize> =
            sinks.columns.iter().map(|(column, _)| columns.partition_point(|known| known < column)).collect();
        let mut row = Row { slots, cells: vec![None; columns.len()], twice: None };
        let mut number = 0;
        let mut head = std::mem::take(&mut self.head).into_iter();
        loop {
            let line = match head.next() {
                Some(line) => line,
                None => match next_line(&mut self.source, number)? {
                    Some(line) => line,
                    None => return Ok(()),
                },
            };
            number += 1;
            if line.trim_ascii().is_empty() {
                continue;
            }
            row.cells.fill(None);
            read_line(&line, number as u64, &mut row)?;
            if let Some(name) = &row.twice {
                return Err(content(format!("line {number}: `{}` has two values", visible(name))));
            }
            for ((_, sink), slot) in sinks.columns.iter_mut().zip(&slot_of) {
                let cell = row.cells[*slot].as_ref().map_or(Cell::Missing, Leaf::cell);
                sink.push(cell, number as u64)?;
            }
            sinks.end_row(number as u64)?;
        }
    }
}

fn next_line(source: &mut BufReader<Box<dyn Read>>, before: usize) -> Result<Option<Vec<u8>>> {
    let mut line = Vec::new();
    source.by_ref().take(MAX_LINE).read_until(b'\n', &mut line)?;
    if line.len() as u64 == MAX_LINE {
        return Err(content(format!("line {} has more than {} MiB", before + 1, MAX_LINE >> 20)));
    }
    Ok((!line.is_empty()).then_some(line))
}

/// Gives the fields of a line to `leaves`.
fn read_line(line: &[u8], number: u64, leaves: &mut dyn Leaves) -> Result<()> {
    let line = line.strip_prefix(b"\xef\xbb\xbf").unwrap_or(line).trim_ascii();
    if line.is_empty() {
        return Ok(());
    }
    if line.first() != Some(&b'{') {
        let hint = match (number, line.first()) {
            (1, Some(b'[')) => "; this file is one JSON array: write one object per line (JSON lines)",
            _ => "",
        };
        return Err(content(format!("line {number}: expected a JSON object{hint}")));
    }
    let line = without_nan(line);
    let mut reader = serde_json::Deserializer::from_slice(&line);
    let mut path = String::new();
    Node { path: &mut path, leaves }
        .deserialize(&mut reader)
        .and_then(|()| reader.end())
        .map_err(|error| content(format!("line {number}: {}", error_text(&error))))
}

/// Replaces the numbers that JSON lacks and that Python writes, `NaN` and `Infinity`, by `null`.
fn without_nan(line: &[u8]) -> Cow<'_, [u8]> {
    const WORDS: [&[u8]; 3] = [b"NaN", b"-Infinity", b"Infinity"];
    if !line.windows(3).any(|bytes| bytes == b"NaN" || bytes == b"Inf") {
        return Cow::Borrowed(line);
    }
    let mut found = Vec::with_capacity(line.len() + 8);
    let mut rest = line;
    let mut in_text = false;
    while let [first, ..] = rest {
        let word = WORDS.iter().find(|word| !in_text && rest.starts_with(word));
        let length = match (word, first) {
            (Some(word), _) => word.len(),
            (None, b'\\') if in_text => 2.min(rest.len()),
            (None, _) => 1,
        };
        in_text ^= *first == b'"';
        found.extend_from_slice(if word.is_some() { b"null" } else { &rest[..length] });
        rest = &rest[length..];
    }
    Cow::Owned(found)
}

/// Returns the message with the column alone, because the line is that of the file.
fn error_text(error: &serde_json::Error) -> String {
    error.to_string().replace(" at line 1 column ", " at column ")
}

/// A value that has no parts.
#[derive(Clone, Debug, PartialEq)]
enum Leaf {
    Null,
    Number(f64),
    Integer(i128),
    Text(String),
}

impl Leaf {
    fn cell(&self) -> Cell<'_> {
        match self {
            Leaf::Null => Cell::Missing,
            Leaf::Number(value) => Cell::Number(*value),
            Leaf::Integer(value) => Cell::Integer(*value),
            Leaf::Text(text) => Cell::Text(text.trim()),
        }
    }
}

/// Takes the leaves of a line.
trait Leaves {
    fn take(&mut self, path: &str, leaf: &dyn Fn() -> Leaf);
}

#[derive(Default)]
struct Names {
    list: Vec<String>,
    known: std::collections::HashSet<String>,
    bytes: usize,
}

impl Names {
    fn add(&mut self, path: &str) {
        let is_full = self.list.len() >= MAX_NAMES || self.bytes + path.len() > MAX_NAME_BYTES;
        if !is_full && !self.known.contains(path) {
            self.bytes += path.len();
            self.known.insert(path.to_owned());
            self.list.push(path.to_owned());
        }
    }
}

impl Leaves for Names {
    fn take(&mut self, path: &str, _: &dyn Fn() -> Leaf) {
        self.add(path);
    }
}

struct Row {
    slots: HashMap<String, usize>,
    cells: Vec<Option<Leaf>>,
    /// A name that has two values.
    twice: Option<String>,
}

impl Leaves for Row {
    fn take(&mut self, path: &str, leaf: &dyn Fn() -> Leaf) {
        let Some(slot) = self.slots.get(path) else { return };
        if self.cells[*slot].replace(leaf()).is_some() {
            self.twice = Some(path.to_owned());
        }
    }
}

/// A value of a line, at a path.
struct Node<'a> {
    path: &'a mut String,
    leaves: &'a mut dyn Leaves,
}

impl Node<'_> {
    fn leaf<E>(self, leaf: impl Fn() -> Leaf) -> std::result::Result<(), E> {
        self.leaves.take(self.path, &leaf);
        Ok(())
    }
}

impl<'de> DeserializeSeed<'de> for Node<'_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> std::result::Result<(), D::Error> {
        deserializer.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for Node<'_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a JSON value")
    }

    fn visit_unit<E>(self) -> std::result::Result<(), E> {
        self.leaf(|| Leaf::Null)
    }

    fn visit_bool<E>(self, value: bool) -> std::result::Result<(), E> {
        self.leaf(|| Leaf::Integer(value.into()))
    }

    fn visit_i64<E>(self, value: i64) -> std::result::Result<(), E> {
        self.leaf(|| Leaf::Integer(value.into()))
    }

    fn visit_u64<E>(self, value: u64) -> std::result::Result<(), E> {
        self.leaf(|| Leaf::Integer(value.into()))
    }

    fn visit_f64<E>(self, value: f64) -> std::result::Result<(), E> {
        self.leaf(|| Leaf::Number(value))
    }

    fn visit_str<E>(self, value: &str) -> std::result::Result<(), E> {
        self.leaf(|| Leaf::Text(value.to_owned()))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> std::result::Result<(), A::Error> {
        let Node { path, leaves } = self;
        let length = path.len();
        while let Some(key) = map.next_key::<Cow<'_, str>>()? {
            if length > 0 {
                path.push('/');
            }
            path.push_str(&key);
            map.next_value_seed(Node { path, leaves })?;
            path.truncate(length);
        }
        Ok(())
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> std::result::Result<(), A::Error> {
        use std::fmt::Write;
        let Node { path, leaves } = self;
        let length = path.len();
        for index in 0.. {
            if index >= MAX_NAMES {
                // The rest is nobody's column.
                while seq.next_element::<IgnoredAny>()?.is_some() {}
                return Ok(());
            }
            write!(path, "[{index}]").map_err(A::Error::custom)?;
            let next = seq.next_element_seed(Node { path, leaves })?;
            path.truncate(length);
            if next.is_none() {
                break;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEAD: JsonHead<'_> = JsonHead { lines: HEAD_LINES, more: &[] };

    fn names(text: &str) -> Vec<String> {
        JsonTable::open(Box::new(std::io::Cursor::new(text.to_owned())), &HEAD).expect("JSON lines").names
    }

    #[track_caller]
    fn refuses(text: &str, message: &str) {
        let error =
            JsonTable::open(Box::new(std::io::Cursor::new(text.to_owned())), &HEAD).err().expect("an error");
        assert!(error.to_string().contains(message), "{text}: {error}");
    }

    #[test]
    fn nested_fields_are_joined_by_slashes_and_elements_have_brackets() {
        let text = "{\"t\":1,\"pose\":{\"x\":[1,{\"y\":2}]}}\n\n{\"late\":null,\"t\":2}\n";
        assert_eq!(names(text), ["t", "pose/x[0]", "pose/x[1]/y", "late"]);
    }

    #[test]
    fn what_is_no_object_is_an_error_with_its_line() {
        refuses("{\"a\":1}\n[1]\n", "line 2: expected a JSON object");
        refuses("[{\"a\":1}]\n", "one JSON array: write one object per line");
        refuses("{\"a\":1}\n{\"a\":\n", "line 2: EOF while parsing");
        refuses("{\"a\":1} x\n", "line 1: trailing characters at column 9");
        refuses("{\"a\":Nan}\n", "line 1: expected value");
        refuses("", "no fields");
        refuses("{}\n", "no fields");
        refuses(&format!("{}{}\n", "{\"a\":".repeat(300), "1"), "line 1: recursion limit");
    }
}
