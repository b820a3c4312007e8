//! Elements of a model by name or by pattern.

use mishandle_world::{ElementKind, Model};
use regex_lite::Regex;

/// Largest number of names that a message lists.
const LISTED: usize = 30;

/// Returns the indices of the elements of a kind with this name, or, without such an element,
/// whose whole names match it as a regular expression.
///
/// # Errors
/// A message if there are none.
pub(crate) fn select(model: &Model, kind: ElementKind, pattern: &str) -> Result<Vec<usize>, String> {
    if let Ok(index) = model.find(kind, pattern) {
        return Ok(vec![index]);
    }
    let names = model.names(kind);
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
    let listed = known[..known.len().min(LISTED)].join(", ");
    format!("no {label} `{name}`{hint} ({label}s: {listed}{more})")
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
