use roxmltree::{Document, Node};

use crate::mjcf::classes::{Classes, class_of};
use crate::mjcf::compose::Composed;
use crate::mjcf::matching::{Pattern, known_names};
use crate::mjcf::splice::{Splices, escape};
use crate::mjcf::tree::{after_name, elements, lenient, name, parse, sections};
use crate::mjcf::{MjcfError, Source, add};

/// An edit of a document.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Edit {
    /// Adds elements.
    Add {
        /// `world`, the name of a body, or one of the sections `asset`, `contact`, `sensor`,
        /// `equality`, `default`, `keyframe`, `tendon` and `actuator`.
        parent: String,
        /// One or several elements of MJCF.
        xml: String,
    },
    /// Sets attributes of elements. They win over those of default classes.
    Set {
        /// The name of an element, such as `joint` or `geom`, or `actuator`, `sensor`, `equality`,
        /// `tendon` or `contact` for all kinds of them.
        kind: String,
        /// Which of them.
        select: Select,
        /// Names and values.
        attributes: Vec<(String, String)>,
    },
    /// Adds an actuator for each matching joint, in the order of the model. It has the name of the
    /// joint.
    Actuator {
        /// A regular expression that matches the whole name of a joint. Free joints do not count.
        joints: String,
        /// The kind of actuator, such as `position` or `motor`.
        kind: String,
        /// Its other attributes.
        attributes: Vec<(String, String)>,
    },
    /// Sets attributes of the compiler.
    Compiler {
        /// Names and values.
        attributes: Vec<(String, String)>,
    },
    /// Sets options of the physics, such as `timestep`.
    Option {
        /// Names and values.
        attributes: Vec<(String, String)>,
    },
}

/// Which elements of a kind an edit changes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Select {
    /// Those whose whole name matches this regular expression. Names that MuJoCo makes, of
    /// replicated elements, do not count.
    Name(String),
    /// Geoms that collide: with a contype or conaffinity that is not 0, also by their class.
    Colliding,
    /// Those of this default class, which bodies may give to their elements.
    Class(String),
    /// All.
    All,
}

/// Kinds of actuators of a joint.
const ACTUATORS: [&str; 8] =
    ["motor", "position", "velocity", "intvelocity", "damper", "cylinder", "muscle", "general"];

/// Sections whose elements have several names.
const MIXED: [&str; 5] = ["actuator", "sensor", "equality", "tendon", "contact"];

/// Attributes of the compiler that say where files are.
pub(crate) const FOLDERS: [&str; 4] = ["meshdir", "texturedir", "assetdir", "strippath"];

/// Makes an edit.
pub(crate) fn apply(edit: &Edit, source: &mut Source) -> Result<(), MjcfError> {
    let composed = Composed::new(source)?;
    let text = lenient(&composed.text);
    let document = parse(&text, "")?;
    let mut splices = Splices::default();
    match edit {
        Edit::Add { parent, xml } => add::elements_of(parent, xml, &document, &mut splices)?,
        Edit::Set { kind, select, attributes } => {
            check_attributes(attributes)?;
            for element in selected(&document, kind, select)? {
                set(element, attributes, &mut splices);
            }
        }
        Edit::Actuator { joints, kind, attributes } => {
            check_attributes(attributes)?;
            let xml = actuators(&document, joints, kind, attributes)?;
            add::to_section("actuator", &xml, &document, &mut splices);
        }
        Edit::Compiler { attributes } => set_section("compiler", attributes, &document, &mut splices)?,
        Edit::Option { attributes } => set_section("option", attributes, &document, &mut splices)?,
    }
    composed.apply(splices, source);
    Ok(())
}

/// Returns the elements of a kind in the model, without those of default classes.
pub(crate) fn of_kind<'a, 'b>(document: &'a Document<'b>, kind: &str) -> Vec<Node<'a, 'b>> {
    if MIXED.contains(&kind) {
        return sections(document, kind).into_iter().flat_map(elements).collect();
    }
    let sections = elements(document.root_element()).filter(|section| name(*section) != "default");
    // A joint of a tendon or of an equality refers to a joint.
    let is_reference = |node: Node<'_, '_>| {
        matches!(kind, "joint" | "geom" | "site" | "body" | "camera" | "light")
            && !node.ancestors().any(|above| name(above) == "worldbody")
    };
    sections
        .flat_map(|section| section.descendants().skip(1))
        .filter(|node| node.is_element() && name(*node) == kind && !is_reference(*node))
        .collect()
}

/// Returns the names of elements.
pub(crate) fn names<'a>(nodes: &[Node<'a, '_>]) -> Vec<&'a str> {
    nodes.iter().filter_map(|node| node.attribute("name")).collect()
}

fn selected<'a, 'b>(
    document: &'a Document<'b>,
    kind: &str,
    select: &Select,
) -> Result<Vec<Node<'a, 'b>>, MjcfError> {
    let all = of_kind(document, kind);
    if all.is_empty() {
        return Err(MjcfError::edit(format!("the model has no element `{kind}`")));
    }
    let (found, error): (Vec<Node<'a, 'b>>, _) = match select {
        Select::All => return Ok(all),
        Select::Name(pattern) => {
            let pattern = Pattern::new(pattern)?;
            let is_match =
                |node: &Node<'_, '_>| node.attribute("name").is_some_and(|name| pattern.is_match(name));
            let found = all.iter().copied().filter(is_match).collect();
            (found, pattern.none(kind, &names(&all)))
        }
        Select::Class(class) => {
            let mut known: Vec<&str> = all.iter().map(|node| class_of(*node)).collect();
            known.sort_unstable();
            known.dedup();
            let message = format!("no {kind} has the class `{class}`{}", known_names("class", class, &known));
            (all.into_iter().filter(|node| class_of(*node) == class).collect(), MjcfError::edit(message))
        }
        Select::Colliding if kind != "geom" => {
            return Err(MjcfError::edit(format!("only geoms collide; a {kind} cannot be selected so")));
        }
        Select::Colliding => {
            let classes = Classes::of(document);
            let collides = |node: &Node<'a, 'b>| {
                let bits = |key: &str| {
                    classes.value(*node, key).map_or(1.0, |text| text.trim().parse().unwrap_or(1.0))
                };
                bits("contype") != 0.0 || bits("conaffinity") != 0.0
            };
            (all.into_iter().filter(collides).collect(), MjcfError::edit("no geom collides"))
        }
    };
    if found.is_empty() { Err(error) } else { Ok(found) }
}

/// Sets attributes of an element.
fn set(element: Node<'_, '_>, attributes: &[(String, String)], splices: &mut Splices) {
    for (key, value) in attributes {
        match element.attribute_node(key.as_str()) {
            Some(own) => splices.replace(own.range(), assignment(key, value)),
            None => splices.insert(after_name(element), format!(" {}", assignment(key, value))),
        }
    }
}

/// Returns `key="value"`.
pub(crate) fn assignment(key: &str, value: &str) -> String {
    format!("{key}=\"{}\"", escape(value))
}

/// Sets attributes of the last section with a name, which win over those of earlier ones.
fn set_section(
    section: &str,
    attributes: &[(String, String)],
    document: &Document<'_>,
    splices: &mut Splices,
) -> Result<(), MjcfError> {
    check_attributes(attributes)?;
    if let Some((key, _)) = attributes.iter().find(|(key, _)| FOLDERS.contains(&key.as_str())) {
        return Err(MjcfError::edit(format!("`{key}` cannot be set; the files of the model have been read")));
    }
    match sections(document, section).pop() {
        Some(last) => set(last, attributes, splices),
        None => {
            let all: Vec<String> = attributes.iter().map(|(key, value)| assignment(key, value)).collect();
            add::to_root(&format!("<{section} {}/>", all.join(" ")), document, splices);
        }
    }
    Ok(())
}

fn check_attributes(attributes: &[(String, String)]) -> Result<(), MjcfError> {
    for (index, (key, value)) in attributes.iter().enumerate() {
        let is_letter = |letter: char| letter.is_ascii_alphanumeric() || letter == '_';
        if key.is_empty()
            || !key.chars().all(is_letter)
            || key.starts_with(|first: char| first.is_ascii_digit())
        {
            return Err(MjcfError::edit(format!("`{key}` is not the name of an attribute")));
        }
        if key.starts_with("file") {
            return Err(MjcfError::edit(format!(
                "`{key}` cannot be set; the files of the model have been read"
            )));
        }
        if attributes[..index].iter().any(|(other, _)| other == key) {
            return Err(MjcfError::edit(format!("`{key}` is set twice")));
        }
        if value.chars().any(|letter| letter.is_control() && !matches!(letter, '\n' | '\r' | '\t')) {
            return Err(MjcfError::edit(format!("the value of `{key}` has a control character")));
        }
    }
    Ok(())
}

/// Returns the actuators of the joints that match a pattern.
fn actuators(
    document: &Document<'_>,
    joints: &str,
    kind: &str,
    attributes: &[(String, String)],
) -> Result<String, MjcfError> {
    if !ACTUATORS.contains(&kind) {
        let message = format!("no kind of actuator is `{kind}`{}", known_names("kind", kind, &ACTUATORS));
        return Err(MjcfError::edit(message));
    }
    if let Some((key, _)) = attributes.iter().find(|(key, _)| key == "joint" || key == "name") {
        return Err(MjcfError::edit(format!("`{key}` follows from the joint and cannot be set")));
    }
    let pattern = Pattern::new(joints)?;
    let classes = Classes::of(document);
    let mut all = Vec::new();
    for world in sections(document, "worldbody") {
        joints_below(world, &mut all);
    }
    all.retain(|joint| name(*joint) == "joint" && classes.value(*joint, "type") != Some("free"));
    let known = names(&all);
    let taken = names(&of_kind(document, "actuator"));
    let rest: String = attributes.iter().map(|(key, value)| format!(" {}", assignment(key, value))).collect();
    let mut out = String::new();
    for joint in known.iter().filter(|joint| pattern.is_match(joint)) {
        if taken.contains(joint) {
            return Err(MjcfError::edit(format!("the model has an actuator `{joint}` already")));
        }
        let own = assignment("name", joint);
        let target = assignment("joint", joint);
        out += &format!("<{kind} {own} {target}{rest}/>");
    }
    if out.is_empty() { Err(pattern.none("joint", &known)) } else { Ok(out) }
}

/// Appends the joints of a body and its descendants in the order of MuJoCo: those of a body before
/// those of its children. Frames are transparent.
fn joints_below<'a, 'b>(body: Node<'a, 'b>, joints: &mut Vec<Node<'a, 'b>>) {
    let mut children = Vec::new();
    own_elements(body, joints, &mut children);
    for child in children {
        joints_below(child, joints);
    }
}

fn own_elements<'a, 'b>(node: Node<'a, 'b>, joints: &mut Vec<Node<'a, 'b>>, bodies: &mut Vec<Node<'a, 'b>>) {
    for element in elements(node) {
        match name(element) {
            "joint" | "freejoint" => joints.push(element),
            "body" => bodies.push(element),
            "frame" => own_elements(element, joints, bodies),
            _ => {}
        }
    }
}
