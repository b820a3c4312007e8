//! Suggestions for misspelled names.

use strsim::levenshtein;

/// Returns the known name most similar to `name`.
///
/// That is the first known name that starts with `name`, otherwise the one with the smallest edit
/// distance (Levenshtein, ignoring case), if the distance is at most 2 or a third of the letters of
/// `name`, and not all letters differ.
///
/// # Example
/// ```
/// use mishandle_stl::nearest;
/// assert_eq!(nearest("strikt", ["success", "strict"]), Some("strict"));
/// assert_eq!(nearest("xyz", ["success", "strict"]), None);
/// ```
pub fn nearest<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let known: Vec<&str> = known.into_iter().collect();
    let completed = known.iter().find(|known| !name.is_empty() && known.starts_with(name));
    let limit = (name.chars().count() / 3).max(2);
    completed.copied().or_else(|| nearest_within(limit, name, known))
}

/// Returns the known name with the smallest edit distance to `name`, if the distance is at most
/// `limit`.
pub(crate) fn nearest_within<'a>(
    limit: usize,
    name: &str,
    known: impl IntoIterator<Item = &'a str>,
) -> Option<&'a str> {
    let ranked =
        known.into_iter().map(|known| (levenshtein(&name.to_lowercase(), &known.to_lowercase()), known));
    let letters = |known: &str| name.chars().count().max(known.chars().count());
    ranked
        .filter(|(distance, known)| *distance <= limit && *distance < letters(known))
        .min_by_key(|(distance, _)| *distance)
        .map(|(_, known)| known)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_name_has_the_smallest_edit_distance() {
        let known = ["cube_height", "cube_speed", "door_yaw_deg"];
        let check = |name: &str, expected: Option<&str>| {
            assert_eq!(nearest(name, known), expected, "{name}");
        };
        check("cube_hieght", Some("cube_height")); // two letters swapped: two edits
        check("Cube_Speed", Some("cube_speed"));
        check("door_yaw", Some("door_yaw_deg")); // four edits, but a prefix
        check("yaw_deg", None); // five edits, more than a third of seven letters
        check("x", None);
        assert_eq!(nearest("x", ["", "d", "yz"]), None);
        assert_eq!(nearest("dd", ["d"]), Some("d"));
        check("", None);
    }
}
