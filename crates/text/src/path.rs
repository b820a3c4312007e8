use std::path::Path;

use crate::shell_quote;

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

/// Returns a path as a word of a shell that no command takes for a flag.
///
/// # Example
/// ```
/// assert_eq!(mishandle_text::shell_path("two words".as_ref()), "'two words'");
/// assert_eq!(mishandle_text::shell_path("-a.sqlite".as_ref()), "./-a.sqlite");
/// ```
pub fn shell_path(path: &Path) -> String {
    let text = path_text(path);
    if text.starts_with('-') { shell_quote(&format!("./{text}")) } else { shell_quote(&text) }
}
