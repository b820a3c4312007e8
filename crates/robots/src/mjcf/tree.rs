//! XML of untrusted files as a tree, and what edits need of it.

use std::ops::Range;

use roxmltree::{Document, Node, ParsingOptions};

use crate::mjcf::MjcfError;

/// The largest number of nodes of a document, which takes 200 bytes per node in memory.
const NODES: u32 = 4_000_000;

/// The largest depth of elements. MuJoCo's parser stops there.
const DEPTH: usize = 400;

/// The largest number of attributes of an element. The parser compares each with all before it.
const ATTRIBUTES: usize = 1_000;

/// Parses a document without document type. `file` names it in errors.
pub(crate) fn parse<'a>(text: &'a str, file: &str) -> Result<Document<'a>, MjcfError> {
    let error = |line, message: String| Err(MjcfError::new(file, line, message));
    if text.contains('\0') {
        return error(None, "the text contains a zero byte".to_string());
    }
    if let Some(line) = too_many_attributes(text) {
        return error(Some(line), format!("an element has more than {ATTRIBUTES} attributes"));
    }
    let options = ParsingOptions { allow_dtd: false, nodes_limit: NODES, ..ParsingOptions::default() };
    let document = match Document::parse_with_options(text, options) {
        Ok(document) => document,
        Err(reason) => {
            return error(Some(reason.pos().row as usize), format!("this is not valid XML: {reason}"));
        }
    };
    match too_deep(&document) {
        Some(line) => error(Some(line), format!("elements are nested more than {DEPTH} deep")),
        None => Ok(document),
    }
}

/// Returns a document in which everything that MuJoCo ignores, and what is not valid XML but MuJoCo
/// reads, is replaced by as many other bytes: texts, comments, declarations and document types by
/// spaces, and in values `<`, and `&` without an entity, by `_`. Lines stay.
pub(crate) fn lenient(document: &str) -> String {
    const SKIPPED: [(&str, &str); 4] = [("<!--", "-->"), ("<![CDATA[", "]]>"), ("<?", "?>"), ("<!", ">")];
    let mut out = String::with_capacity(document.len());
    let blank = |text: &str, out: &mut String| {
        out.extend(text.bytes().map(|byte| if byte == b'\n' { '\n' } else { ' ' }));
    };
    let mut rest = document;
    while !rest.is_empty() {
        let tag = rest.find('<').unwrap_or(rest.len());
        blank(&rest[..tag], &mut out);
        rest = &rest[tag..];
        let skipped = SKIPPED.iter().find(|(start, _)| rest.starts_with(start));
        if let Some((start, end)) = skipped {
            let length = rest[start.len()..].find(end).map_or(rest.len(), |at| start.len() + at + end.len());
            blank(&rest[..length], &mut out);
            rest = &rest[length..];
            continue;
        }
        let mut quote = None;
        let mut length = 0;
        for (at, letter) in rest.char_indices() {
            length = at + letter.len_utf8();
            let is_kept = quote.is_none() || (letter != '<' && (letter != '&' || is_entity(&rest[at..])));
            out.push(if is_kept { letter } else { '_' });
            match quote {
                None if letter == '>' => break,
                None => quote = Some(letter).filter(|letter| matches!(letter, '"' | '\'')),
                Some(open) if open == letter => quote = None,
                Some(_) => {}
            }
        }
        rest = &rest[length..];
    }
    out
}

/// Returns whether text begins with an entity that every XML document has.
fn is_entity(text: &str) -> bool {
    let Some((entity, _)) = text[1..].split_once(';') else { return false };
    match entity.strip_prefix('#') {
        None => ["amp", "lt", "gt", "quot", "apos"].contains(&entity),
        Some(code) => {
            let code = code
                .strip_prefix('x')
                .map_or_else(|| code.parse().ok(), |hex| u32::from_str_radix(hex, 16).ok());
            // roxmltree knows no control characters.
            code.and_then(char::from_u32).is_some_and(|letter| !letter.is_control() || letter.is_whitespace())
        }
    }
}

/// Returns the name of the first element of a document without comments.
pub(crate) fn root(lenient: &str) -> &str {
    let name = lenient.split_once('<').map_or("", |(_, rest)| rest);
    let end = name.find(|letter: char| letter.is_whitespace() || matches!(letter, '/' | '>'));
    &name[..end.unwrap_or(name.len())]
}

/// Returns the line of an element with too many attributes. Quotes are counted, also in texts.
fn too_many_attributes(text: &str) -> Option<usize> {
    let mut quotes = 0;
    let at = text.bytes().position(|byte| {
        match byte {
            b'<' | b'>' => quotes = 0,
            b'"' | b'\'' => quotes += 1,
            _ => {}
        }
        quotes > 2 * ATTRIBUTES
    })?;
    Some(line_at(text, at))
}

fn too_deep(document: &Document<'_>) -> Option<usize> {
    let mut depths: Vec<usize> = Vec::new();
    for node in document.descendants() {
        // Nodes are numbered in their order, so the parent has a depth.
        let depth = node.parent().map_or(0, |parent| depths[parent.id().get_usize()] + 1);
        if depth > DEPTH {
            return Some(line_at(document.input_text(), node.range().start));
        }
        depths.push(depth);
    }
    None
}

/// Returns the line of a byte, counted from 1.
pub(crate) fn line_at(text: &str, at: usize) -> usize {
    1 + text.as_bytes()[..at.min(text.len())].iter().filter(|byte| **byte == b'\n').count()
}

/// Returns the name of an element without its namespace, which MuJoCo does not know.
pub(crate) fn name<'a>(node: Node<'a, '_>) -> &'a str {
    node.tag_name().name()
}

/// Returns the elements directly in a node.
pub(crate) fn elements<'a, 'b>(node: Node<'a, 'b>) -> impl Iterator<Item = Node<'a, 'b>> {
    node.children().filter(Node::is_element)
}

/// Returns the sections of a document with this name, in their order.
pub(crate) fn sections<'a, 'b>(document: &'a Document<'b>, section: &str) -> Vec<Node<'a, 'b>> {
    elements(document.root_element()).filter(|node| name(*node) == section).collect()
}

/// Returns the bytes between the tags of an element; `None` for `<name/>`.
pub(crate) fn inner(node: Node<'_, '_>) -> Option<Range<usize>> {
    let text = &node.document().input_text()[node.range()];
    if !node.has_children() && text.ends_with("/>") {
        return None;
    }
    let end = node.range().start + text.rfind("</")?;
    Some(node.first_child().map_or(end, |child| child.range().start)..end)
}

/// Returns the byte after the name in the start tag of an element.
pub(crate) fn after_name(node: Node<'_, '_>) -> usize {
    let text = &node.document().input_text()[node.range()];
    let end = text.find(|letter: char| letter.is_whitespace() || letter == '/' || letter == '>');
    node.range().start + end.unwrap_or(text.len())
}
