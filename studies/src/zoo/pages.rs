//! Generated text in Markdown pages, between the comments `<!-- figures: NAME -->` and
//! `<!-- end of figures -->`.

use std::path::Path;

use crate::zoo::folder::{read, write};
use crate::zoo::{PageProblem, ZooError};

/// Replaces the text between the comments of that name.
///
/// # Errors
/// If the page cannot be read or written, or has no such comments.
pub(crate) fn replace(path: &Path, name: &str, text: &str) -> Result<(), ZooError> {
    let old = String::from_utf8_lossy(&read(path)?).into_owned();
    let new = replaced(&old, name, text);
    let new = new.map_err(|problem| ZooError::Page { path: path.to_path_buf(), problem })?;
    if new == old { Ok(()) } else { write(path, new.as_bytes()) }
}

fn replaced(old: &str, name: &str, text: &str) -> Result<String, PageProblem> {
    let no_place = || PageProblem::NoPlace { name: name.to_string() };
    let (before, rest) = old.split_once(&format!("<!-- figures: {name} -->")).ok_or_else(no_place)?;
    let (_, after) = rest.split_once("<!-- end of figures -->").ok_or_else(no_place)?;
    Ok(format!("{before}<!-- figures: {name} -->\n{}\n<!-- end of figures -->{after}", text.trim_end()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_text_between_the_comments_changes() {
        let old = "a\n<!-- figures: x -->\nold\n<!-- end of figures -->\nb\n";
        let new = replaced(old, "x", "new\n").unwrap();
        assert_eq!(new, "a\n<!-- figures: x -->\nnew\n<!-- end of figures -->\nb\n");
        assert!(replaced(old, "y", "new").unwrap_err().to_string().contains("figures: y"));
    }
}
