//! What a misspelled name may have meant.

use strsim::levenshtein;

/// The known name that `wanted` begins, else the one that takes the fewest edits to reach, if that is at most a third of
/// its letters (or two edits).
///
/// # Example
/// ```
/// use mishandle_stl::nearest;
/// assert_eq!(nearest("strikt", ["success", "strict"]), Some("strict"));
/// assert_eq!(nearest("xyz", ["success", "strict"]), None);
/// ```
pub fn nearest<'a>(wanted: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let known: Vec<&str> = known.into_iter().collect();
    let begun = known.iter().find(|name| !wanted.is_empty() && name.starts_with(wanted));
    let limit = (wanted.chars().count() / 3).max(2);
    begun.copied().or_else(|| nearest_within(limit, wanted, known))
}

/// The known name that takes the fewest edits to reach, if it takes no more than `limit`.
pub(crate) fn nearest_within<'a>(
    limit: usize,
    wanted: &str,
    known: impl IntoIterator<Item = &'a str>,
) -> Option<&'a str> {
    let ranked =
        known.into_iter().map(|name| (levenshtein(&wanted.to_lowercase(), &name.to_lowercase()), name));
    ranked
        .filter(|(distance, _)| *distance <= limit)
        .min_by_key(|(distance, _)| *distance)
        .map(|(_, name)| name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_name_is_the_one_fewest_edits_away() {
        let known = ["cube_height", "cube_speed", "door_yaw_deg"];
        let check = |wanted: &str, expected: Option<&str>| {
            assert_eq!(nearest(wanted, known), expected, "{wanted}");
        };
        check("cube_hieght", Some("cube_height")); // two letters swapped: two edits
        check("Cube_Speed", Some("cube_speed"));
        check("door_yaw", Some("door_yaw_deg")); // four edits, but begun rightly
        check("yaw_deg", None); // five edits, more than a third of seven letters
        check("x", None);
        check("", None);
    }
}
