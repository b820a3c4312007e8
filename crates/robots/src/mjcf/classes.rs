//! Default classes: the attributes that elements do not set themselves.

use std::collections::BTreeMap;

use roxmltree::{Document, Node};

use crate::mjcf::tree::{elements, name, sections};

/// The name of the outermost class.
const MAIN: &str = "main";

/// The default classes of a document.
#[derive(Debug)]
pub(crate) struct Classes<'a> {
    /// Attributes by class, kind of element and name, those of outer classes included.
    attributes: BTreeMap<&'a str, BTreeMap<(&'a str, &'a str), &'a str>>,
}

impl<'a> Classes<'a> {
    pub(crate) fn of(document: &'a Document<'_>) -> Classes<'a> {
        let mut classes = Classes { attributes: BTreeMap::from([(MAIN, BTreeMap::new())]) };
        // As MuJoCo does: a class copies what the outer class has at that point.
        for root in sections(document, "default") {
            classes.read(root, MAIN);
            classes.add_inner(root, MAIN);
        }
        classes
    }

    fn read(&mut self, class: Node<'a, '_>, own: &'a str) {
        for element in elements(class).filter(|element| name(*element) != "default") {
            for attribute in element.attributes() {
                let values = self.attributes.entry(own).or_default();
                values.insert((name(element), attribute.name()), attribute.value());
            }
        }
    }

    fn add_inner(&mut self, class: Node<'a, '_>, own: &'a str) {
        for inner in elements(class).filter(|element| name(*element) == "default") {
            let Some(class) = inner.attribute("class") else { continue };
            let outer = self.attributes.get(own).cloned().unwrap_or_default();
            self.attributes.insert(class, outer);
            self.read(inner, class);
            self.add_inner(inner, class);
        }
    }

    /// Returns the value of an attribute of an element or of its class.
    pub(crate) fn value(&self, element: Node<'a, '_>, attribute: &str) -> Option<&'a str> {
        element.attribute(attribute).or_else(|| {
            let key = (name(element), attribute);
            self.attributes.get(class_of(element))?.get(&key).copied()
        })
    }
}

/// Returns the class of an element: its own, that of the nearest body or frame, or the outermost.
pub(crate) fn class_of<'a>(element: Node<'a, '_>) -> &'a str {
    let inherited = || element.ancestors().skip(1).find_map(|node| node.attribute("childclass"));
    element.attribute("class").or_else(inherited).unwrap_or(MAIN)
}
