//! Text that is made, between two comments of a page that people write: `<!-- figures: NAME -->` and
//! `<!-- end of figures -->`.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result};

/// Puts `made` between the comments of that name in a file.
///
/// # Errors
/// If the file cannot be read or written, or has no such comments.
pub fn replace(path: &Path, name: &str, made: &str) -> Result<()> {
    let old = fs::read_to_string(path).with_context(|| path.display().to_string())?;
    let new = replaced(&old, name, made).with_context(|| path.display().to_string())?;
    fs::write(path, new)?;
    Ok(())
}

fn replaced(old: &str, name: &str, made: &str) -> Result<String> {
    let (begin, end) = (format!("<!-- figures: {name} -->"), "<!-- end of figures -->");
    let start = old.find(&begin).with_context(|| format!("it has no `{begin}`"))? + begin.len();
    let stop = start + old[start..].find(end).with_context(|| format!("it has no `{end}`"))?;
    Ok(format!("{}\n{}\n{}", &old[..start], made.trim_end(), &old[stop..]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_stands_between_the_comments_is_replaced() {
        let old = "a\n<!-- figures: x -->\nold\n<!-- end of figures -->\nb\n";
        let new = replaced(old, "x", "new\n").unwrap();
        assert_eq!(new, "a\n<!-- figures: x -->\nnew\n<!-- end of figures -->\nb\n");
        assert!(replaced(old, "y", "new").unwrap_err().to_string().contains("figures: y"));
    }
}
