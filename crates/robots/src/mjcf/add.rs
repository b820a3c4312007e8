//! Insertion of elements.

use roxmltree::{Document, Node};

use crate::mjcf::MjcfError;
use crate::mjcf::edit::{FOLDERS, names, of_kind};
use crate::mjcf::matching::known_names;
use crate::mjcf::splice::Splices;
use crate::mjcf::tree::{elements, inner, line_at, name, parse, sections};

/// Sections to which elements can be added.
const SECTIONS: [&str; 8] =
    ["asset", "contact", "sensor", "equality", "default", "keyframe", "tendon", "actuator"];

/// Adds the elements of a fragment to a body or a section.
pub(crate) fn elements_of(
    parent: &str,
    xml: &str,
    document: &Document<'_>,
    splices: &mut Splices,
) -> Result<(), MjcfError> {
    check(xml)?;
    if parent == "world" {
        to_section("worldbody", xml, document, splices);
        return Ok(());
    }
    if SECTIONS.contains(&parent) {
        to_section(parent, xml, document, splices);
        return Ok(());
    }
    let bodies = of_kind(document, "body");
    let Some(body) = bodies.iter().find(|body| body.attribute("name") == Some(parent)) else {
        let known = [names(&bodies), vec!["world"], SECTIONS.to_vec()].concat();
        let message = format!("no body has the name `{parent}`{}", known_names("body", parent, &known));
        return Err(MjcfError::edit(message));
    };
    append(*body, xml, splices);
    Ok(())
}

/// Checks that a fragment consists of elements that can be added.
fn check(xml: &str) -> Result<(), MjcfError> {
    let wrapped = format!("<fragment>{xml}</fragment>");
    let fragment = parse(&wrapped, "")?;
    let root = fragment.root_element();
    if elements(root).next().is_none() {
        return Err(MjcfError::edit("the XML to add has no element"));
    }
    let is_text =
        |node: &Node<'_, '_>| node.text().is_some_and(|text| node.is_text() && !text.trim().is_empty());
    if let Some(text) = root.descendants().find(is_text) {
        let line = line_at(&wrapped, text.range().start);
        return Err(MjcfError::new("", Some(line), "the XML to add has text between its elements"));
    }
    let folders = |node: &Node<'_, '_>| node.attributes().any(|key| FOLDERS.contains(&key.name()));
    if root.descendants().any(|node| name(node) == "compiler" || folders(&node)) {
        return Err(MjcfError::edit("a compiler cannot be added; set its attributes"));
    }
    for node in root.descendants().filter(Node::is_element) {
        let reason = match name(node) {
            "plugin" | "extension" => "plugins run code and are not loaded; remove them from the model",
            "include" => "includes are not possible here",
            _ => continue,
        };
        return Err(MjcfError::new("", Some(line_at(&wrapped, node.range().start)), reason));
    }
    Ok(())
}

/// Adds elements to the last section with a name, which is made if it is missing.
pub(crate) fn to_section(section: &str, xml: &str, document: &Document<'_>, splices: &mut Splices) {
    match sections(document, section).pop() {
        Some(last) => append(last, xml, splices),
        None => to_root(&format!("<{section}>{xml}</{section}>"), document, splices),
    }
}

/// Adds a section at the end of the document.
pub(crate) fn to_root(xml: &str, document: &Document<'_>, splices: &mut Splices) {
    append(document.root_element(), xml, splices);
}

/// Adds elements at the end of an element.
fn append(element: Node<'_, '_>, xml: &str, splices: &mut Splices) {
    match inner(element) {
        Some(range) => splices.insert(range.end, xml),
        None => {
            // `<name a="b"/>` becomes `<name a="b">…</name>`; the name may have a prefix.
            let range = element.range();
            let text = &element.document().input_text()[range.clone()];
            let tag = &text[1..crate::mjcf::tree::after_name(element) - range.start];
            splices.replace(range.end - 2..range.end, format!(">{xml}</{tag}>"));
        }
    }
}
