//! Pictures that pages show, and the commands that make them.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result, ensure};

use super::Shown;

/// Start of a comment about a picture.
const MARK: &str = "<!-- picture ";

/// Returns the commands that make pictures.
pub fn commands(text: &str) -> impl Iterator<Item = Shown> {
    let comments = text.match_indices(MARK).filter_map(|(start, mark)| {
        let (path, rest) = text[start + mark.len()..].split_once(": ")?;
        Some((start, path, rest.split_once(" -->")?.0))
    });
    comments.map(|(start, path, command)| Shown {
        line: text[..start].lines().count() + 1,
        command: command.split_whitespace().collect::<Vec<_>>().join(" "),
        picture: Some(path.to_owned()),
        ..Shown::default()
    })
}

/// Compares a picture of the repository with the one that a command made, or replaces it.
pub fn compare(root: &Path, folder: &Path, picture: &str, is_update: bool) -> Result<()> {
    let made = folder.join(Path::new(picture).file_name().unwrap_or_default());
    let made = fs::read(&made).with_context(|| format!("the command did not write {}", made.display()))?;
    let path = root.join(picture);
    if is_update {
        return fs::write(&path, made).with_context(|| format!("cannot write {picture}"));
    }
    let shown = fs::read(&path).with_context(|| format!("cannot read {picture}"))?;
    ensure!(
        shown == made,
        "{picture} is another picture; look at the new one after `cargo xtask readme --update`"
    );
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::try_out;
    use super::*;

    #[test]
    fn a_picture_is_compared_with_the_one_that_its_command_makes() {
        let page = "text\n<!-- picture docs/a.png: printf new\n     > a.png --> ![a](docs/a.png)\n";
        let shown = &commands(page).next().unwrap();
        let expected = (2, "printf new > a.png", Some("docs/a.png"));
        assert_eq!((shown.line, shown.command.as_str(), shown.picture.as_deref()), expected);
        let root = std::env::temp_dir().join(format!("mishandle-picture-{}", std::process::id()));
        fs::create_dir_all(root.join("docs")).unwrap();
        fs::write(root.join("docs/a.png"), "old").unwrap();
        try_out(&root, &root, shown).unwrap();
        let error = compare(&root, &root, "docs/a.png", false).unwrap_err().to_string();
        let updated = compare(&root, &root, "docs/a.png", true);
        let same = compare(&root, &root, "docs/a.png", false);
        fs::remove_dir_all(&root).unwrap();
        assert!(error.contains("docs/a.png is another picture"), "{error}");
        assert!(updated.is_ok() && same.is_ok());
    }
}
