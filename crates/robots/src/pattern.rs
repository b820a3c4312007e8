//! Elements of a model by name or by pattern.

use mishandle_world::{ElementKind, JointKind, Model};
use regex_lite::Regex;

/// Largest number of names that a message lists.
const LISTED: usize = 30;

/// Returns the indices of the elements of a kind with this name, or, without such an element,
/// whose whole names match it as a regular expression.
///
/// # Errors
/// A message if there are none.
pub(crate) fn select(model: &Model, kind: ElementKind, pattern: &str) -> Result<Vec<usize>, String> {
    let names = names(model, kind);
    if let Some(index) = names.iter().position(|name| name == pattern && !name.is_empty()) {
        return Ok(vec![index]);
    }
    let label = kind.label();
    let regex = Regex::new(&format!("^(?:{pattern})$")).map_err(|error| {
        format!("`{pattern}` is neither the name of a {label} nor a regular expression: {error}")
    })?;
    let found: Vec<usize> = names
        .iter()
        .enumerate()
        .filter(|(_, name)| !name.is_empty() && regex.is_match(name))
        .map(|(i, _)| i)
        .collect();
    if found.is_empty() {
        return Err(missing(label, pattern, &names));
    }
    Ok(found)
}

/// Returns the names of the elements of a kind. A free joint without a name is called as its body,
/// an actuator without one as its joint.
pub(crate) fn names(model: &Model, kind: ElementKind) -> Vec<String> {
    let mut own = model.names(kind);
    let unnamed: Vec<usize> = (0..own.len()).filter(|index| own[*index].is_empty()).collect();
    for index in unnamed {
        let owner = match kind {
            ElementKind::Joint if model.joint_kind(index) == JointKind::Free => {
                Some((ElementKind::Body, model.body_of_joint(index).index()))
            }
            ElementKind::Actuator => model.actuator_joint(index).map(|joint| (ElementKind::Joint, joint)),
            _ => None,
        };
        let Some((kind, owner)) = owner else { continue };
        let name = model.names(kind).swap_remove(owner);
        // A name of its own wins.
        if !own.contains(&name) {
            own[index] = name;
        }
    }
    own
}

/// Returns the keyframe with a name or, without such a name, a number.
///
/// # Errors
/// A message if the model has no such keyframe.
pub(crate) fn keyframe(model: &Model, text: &str) -> Result<usize, String> {
    let names = model.names(ElementKind::Key);
    let named = names.iter().position(|name| name == text && !name.is_empty());
    let number = text.parse().ok().filter(|number| *number < names.len());
    named.or(number).ok_or_else(|| match names.len() {
        0 => "the model has no keyframe".to_string(),
        count => format!(
            "{}; keyframes also have numbers, from 0 to {}",
            missing("keyframe", text, &names),
            count - 1
        ),
    })
}

/// Returns the message that no element has a name.
pub(crate) fn missing(label: &str, name: &str, known: &[String]) -> String {
    let known: Vec<&str> = known.iter().map(String::as_str).filter(|name| !name.is_empty()).collect();
    if known.is_empty() {
        return format!("no {label} `{name}`: the model has none with a name");
    }
    let hint = mishandle_stl::nearest(name, known.iter().copied());
    let hint = hint.map_or(String::new(), |nearest| format!("; did you mean `{nearest}`?"));
    let more =
        if known.len() > LISTED { format!(" and {} more", known.len() - LISTED) } else { String::new() };
    let kinds = label.strip_suffix('y').map_or_else(|| format!("{label}s"), |stem| format!("{stem}ies"));
    let listed = known[..known.len().min(LISTED)].join(", ");
    format!("no {label} `{name}`{hint} ({kinds}: {listed}{more})")
}

/// Returns the kind with the name that files use.
pub(crate) fn kind(name: &str) -> Option<ElementKind> {
    let kinds = [
        ("body", ElementKind::Body),
        ("joint", ElementKind::Joint),
        ("geom", ElementKind::Geom),
        ("site", ElementKind::Site),
        ("actuator", ElementKind::Actuator),
        ("sensor", ElementKind::Sensor),
    ];
    kinds.iter().find(|(known, _)| *known == name).map(|(_, kind)| *kind)
}
