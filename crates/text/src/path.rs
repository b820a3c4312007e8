use std::path::Path;

/// Returns a path as text, for plans, commands and results. Bytes that are invalid in UTF-8 are
/// replaced.
///
/// # Example
/// ```
/// assert_eq!(mishandle_text::path_text("runs/a.sqlite".as_ref()), "runs/a.sqlite");
/// ```
pub fn path_text(path: &Path) -> String {
    path.to_string_lossy().into_owned()
}
