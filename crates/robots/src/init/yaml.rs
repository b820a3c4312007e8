//! The subset of YAML in which Isaac Lab writes its IO descriptors: blocks of keys and of list
//! entries, scalars of one or several lines, lists in brackets, anchors of lists. Everything else
//! is an error with its line.

use std::collections::HashMap;
use std::rc::Rc;

/// Largest depth of blocks.
const MAX_DEPTH: usize = 20;

/// A value of a document. Values that a file names twice are shared.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Yaml {
    Null,
    Text(String),
    List(Vec<Rc<Yaml>>),
    Map(Vec<(String, Rc<Yaml>)>),
}

/// A line without its comment: number, indentation, text.
#[derive(Clone, Debug)]
struct Line {
    number: usize,
    indent: usize,
    text: String,
}

struct Reader {
    lines: Vec<Line>,
    at: usize,
    anchors: HashMap<String, Rc<Yaml>>,
}

/// Parses a document.
///
/// # Errors
/// A message with the line.
pub(crate) fn parse(text: &str) -> Result<Rc<Yaml>, String> {
    let line = |(index, line): (usize, &str)| Line {
        number: index + 1,
        indent: line.len() - line.trim_start_matches(' ').len(),
        text: line.trim().to_string(),
    };
    let is_content = |line: &Line| {
        !line.text.is_empty() && !line.text.starts_with('#') && !matches!(line.text.as_str(), "---" | "...")
    };
    let starts_with_tab = |line: &str| line.trim_start_matches(' ').starts_with('\t');
    if let Some(number) = text.lines().position(starts_with_tab) {
        return Err(format!("line {}: the line starts with a tab; YAML is indented with spaces", number + 1));
    }
    let lines = text.lines().enumerate().map(line).filter(is_content).collect();
    let mut reader = Reader { lines, at: 0, anchors: HashMap::new() };
    let value = reader.block(0, 0)?;
    match reader.lines.get(reader.at) {
        None => Ok(value),
        Some(line) => Err(format!("line {}: this is neither a key nor an entry of a list", line.number)),
    }
}

impl Reader {
    /// Reads the block at the current line if it is indented by `least` or more.
    fn block(&mut self, least: usize, depth: usize) -> Result<Rc<Yaml>, String> {
        let Some(line) = self.lines.get(self.at).filter(|line| line.indent >= least) else {
            return Ok(Rc::new(Yaml::Null));
        };
        if depth > MAX_DEPTH {
            return Err(format!("line {}: more than {MAX_DEPTH} blocks inside each other", line.number));
        }
        let indent = line.indent;
        if entry(&line.text).is_some() {
            return self.list(indent, depth);
        }
        if key(&line.text).is_some() {
            return self.map(indent, depth);
        }
        let line = line.clone();
        self.at += 1;
        self.scalar(&line.text, line.number, indent)
    }

    fn list(&mut self, indent: usize, depth: usize) -> Result<Rc<Yaml>, String> {
        let mut values = Vec::new();
        while let Some(line) = self.lines.get_mut(self.at).filter(|line| line.indent == indent) {
            let Some(rest) = entry(&line.text) else { break };
            let (anchor, rest) = anchored(rest.trim_start());
            let rest = rest.to_string();
            let value = if rest.is_empty() {
                self.at += 1;
                self.block(indent + 1, depth + 1)?
            } else {
                // The rest of the line is the first line of the entry.
                line.indent += line.text.len() - rest.len();
                line.text = rest;
                let inner = line.indent;
                self.block(inner, depth + 1)?
            };
            if let Some(anchor) = anchor {
                self.anchors.insert(anchor, value.clone());
            }
            values.push(value);
        }
        Ok(Rc::new(Yaml::List(values)))
    }

    fn map(&mut self, indent: usize, depth: usize) -> Result<Rc<Yaml>, String> {
        let mut entries: Vec<(String, Rc<Yaml>)> = Vec::new();
        while let Some(line) = self.lines.get(self.at).filter(|line| line.indent == indent).cloned() {
            let Some((name, rest)) = key(&line.text) else { break };
            if entries.iter().any(|(known, _)| known == name) {
                return Err(format!("line {}: the key `{name}` is there twice", line.number));
            }
            self.at += 1;
            let (anchor, rest) = anchored(rest);
            let is_next_entry = |next: &Line| next.indent == indent && entry(&next.text).is_some();
            let value = match rest {
                // The entries of a list may be as far to the left as the key.
                "" if self.lines.get(self.at).is_some_and(is_next_entry) => self.list(indent, depth + 1)?,
                "" => self.block(indent + 1, depth + 1)?,
                rest => self.scalar(rest, line.number, indent)?,
            };
            if let Some(anchor) = anchor {
                self.anchors.insert(anchor, value.clone());
            }
            entries.push((name.to_string(), value));
        }
        Ok(Rc::new(Yaml::Map(entries)))
    }

    /// Reads a scalar or a list in brackets, with the deeper lines that continue it.
    fn scalar(&mut self, first: &str, number: usize, indent: usize) -> Result<Rc<Yaml>, String> {
        if let Some(name) = first.strip_prefix('*') {
            let known = self.anchors.get(name.trim()).cloned();
            return known.ok_or_else(|| format!("line {number}: there is no anchor `{name}`"));
        }
        if first.starts_with(['|', '>', '{', '&', '!', '?', '%', '@', '`']) && first != "{}" {
            return Err(format!("line {number}: this program does not read `{first}`; write it as a block"));
        }
        let mut text = first.to_string();
        while let Some(line) = self.lines.get(self.at).filter(|line| line.indent > indent) {
            text = format!("{text} {}", line.text);
            self.at += 1;
        }
        if let Some(inner) = text.strip_prefix('[') {
            let inner = inner.strip_suffix(']');
            let inner = inner.ok_or_else(|| format!("line {number}: the list has no `]`"))?;
            let parts = inner.split(',').map(str::trim).filter(|part| !part.is_empty());
            return Ok(Rc::new(Yaml::List(parts.map(|part| Rc::new(plain(part))).collect())));
        }
        Ok(Rc::new(plain(&text)))
    }
}

/// Returns the name of the anchor at the start of a value, and the rest of the value.
fn anchored(text: &str) -> (Option<String>, &str) {
    let Some(text) = text.strip_prefix('&') else { return (None, text) };
    let (name, rest) = text.split_once(' ').unwrap_or((text, ""));
    (Some(name.to_string()), rest.trim_start())
}

/// Returns the rest of an entry of a list.
fn entry(text: &str) -> Option<&str> {
    if text == "-" { Some("") } else { text.strip_prefix("- ") }
}

/// Returns a key and the rest of its line.
fn key(text: &str) -> Option<(&str, &str)> {
    if text.starts_with(['\'', '"', '[', '{', '*']) {
        return None;
    }
    let (name, rest) = match text.split_once(": ") {
        Some(found) => found,
        None => (text.strip_suffix(':')?, ""),
    };
    Some((name.trim(), rest.trim()))
}

fn plain(text: &str) -> Yaml {
    let quoted = |quote: char| text.strip_prefix(quote).and_then(|text| text.strip_suffix(quote));
    if let Some(inner) = quoted('\'') {
        return Yaml::Text(inner.replace("''", "'"));
    }
    if let Some(inner) = quoted('"') {
        return Yaml::Text(inner.to_string());
    }
    match text.split(" #").next().unwrap_or_default().trim() {
        "null" | "~" | "Null" | "NULL" | "" => Yaml::Null,
        text => Yaml::Text(text.to_string()),
    }
}

impl Yaml {
    /// Returns the value of a key; nothing for a missing one and for null.
    pub(crate) fn get(&self, key: &str) -> Option<&Yaml> {
        let Yaml::Map(entries) = self else { return None };
        let found = entries.iter().find(|(known, _)| known == key);
        found.map(|(_, value)| &**value).filter(|value| **value != Yaml::Null)
    }

    pub(crate) fn text(&self) -> Option<&str> {
        if let Yaml::Text(text) = self { Some(text) } else { None }
    }

    pub(crate) fn number(&self) -> Option<f64> {
        match self.text()? {
            ".inf" => Some(f64::INFINITY),
            "-.inf" => Some(f64::NEG_INFINITY),
            text => text.parse().ok(),
        }
    }

    pub(crate) fn list(&self) -> &[Rc<Yaml>] {
        if let Yaml::List(values) = self { values } else { &[] }
    }

    /// Returns a list of numbers, or one number.
    pub(crate) fn numbers(&self) -> Option<Vec<f64>> {
        match self {
            Yaml::List(values) => values.iter().map(|value| value.number()).collect(),
            _ => Some(vec![self.number()?]),
        }
    }

    pub(crate) fn texts(&self) -> Option<Vec<String>> {
        self.list().iter().map(|value| value.text().map(String::from)).collect()
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests")]

    use super::*;

    #[test]
    fn blocks_lists_and_folded_lines() {
        let text = "# comment\nactions:\n- name: move\n  extras:\n    description: Joint action term that\n      continues.\n  \
                    joint_names: &id001\n  - hip\n  - knee\n  scale: [0.5, -1e-3]\n  clip: null\nlimits:\n- - -1.0\n  - 2\n- - 3\n  \
                    - 4\nagain: *id001\nentries:\n- &id002\n  - hip\n- *id002\nquoted: 'it''s: fine'\n";
        let file = parse(text).unwrap();
        let action = &file.get("actions").unwrap().list()[0];
        let description = action.get("extras").unwrap().get("description").unwrap();
        assert_eq!(description.text(), Some("Joint action term that continues."));
        assert_eq!(action.get("joint_names").unwrap().texts().unwrap(), ["hip", "knee"]);
        assert_eq!(action.get("scale").unwrap().numbers().unwrap(), [0.5, -0.001]);
        assert_eq!(action.get("clip"), None);
        let limits = file.get("limits").unwrap().list();
        assert_eq!(limits[0].numbers().unwrap(), [-1.0, 2.0]);
        assert_eq!(limits[1].numbers().unwrap(), [3.0, 4.0]);
        assert_eq!(file.get("again").unwrap().texts().unwrap(), ["hip", "knee"]);
        let entries = file.get("entries").unwrap().list();
        assert_eq!(entries[0].texts().unwrap(), ["hip"]);
        assert_eq!(entries[1], entries[0]);
        assert_eq!(file.get("quoted").unwrap().text(), Some("it's: fine"));
    }

    #[test]
    fn other_yaml_is_an_error_with_its_line() {
        for (text, line) in [
            ("a: 1\nb: |\n  text\n", "line 2"),
            ("a: 1\na: 2\n", "line 2"),
            ("a: {b: 1}\n", "line 1"),
            ("a: *missing\n", "line 1"),
            ("a: [1, 2\n", "line 1"),
            ("a:\n\tb: 1\n", "line 2"),
            ("a: 1\n  - 2\n  b: 3\nc\n", "line 4"),
        ] {
            let error = parse(text).unwrap_err();
            assert!(error.contains(line), "{text}: {error}");
        }
        let deep: String = (0..40).map(|depth| format!("{}a:\n", " ".repeat(depth))).collect();
        assert!(parse(&deep).unwrap_err().contains("inside each other"));
    }
}
