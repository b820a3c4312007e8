//! Prepares the Markdown files of the book: chapters, their pictures, and mdBook's list of
//! chapters.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use anyhow::{Context, Result, ensure};

use crate::markdown::{resolve, rewrite};
use crate::reference::{FOLDER, PAGES};

/// The contents page, from the root.
const CONTENTS: &str = "docs/README.md";

/// Copies the chapters and their pictures to `folder`, and writes `SUMMARY.md`. Returns the number
/// of pages.
///
/// # Errors
/// If the contents page leads to a page that does not exist, or misses a page of `docs`.
pub fn prepare(root: &Path, folder: &Path) -> Result<usize> {
    let contents = fs::read_to_string(root.join(CONTENTS)).context(CONTENTS)?;
    let summary = summary(&contents);
    let mut pages: BTreeSet<String> =
        chapters(&contents).filter_map(|(_, link)| resolve(CONTENTS, link)).collect();
    pages.insert(CONTENTS.to_owned());
    let missing = missing(root, &pages)?;
    ensure!(missing.is_empty(), "{CONTENTS} does not list {}", missing.join(", "));
    for page in &pages {
        let whole = PAGES.iter().find(|(beginning, _)| beginning == page);
        let path = whole.map_or(root.join(page), |(_, name)| root.join(FOLDER).join(name));
        let text = fs::read_to_string(path).with_context(|| format!("{CONTENTS} lists {page}"))?;
        let mut pictures = BTreeSet::new();
        let text = rewrite(&text, |link| {
            let path = resolve(page, link.split(['#', '?']).next().unwrap_or(link))?;
            if is_picture(&path) {
                pictures.insert(path);
            }
            link_in_book(&pages, page, link)
        });
        write(folder, page, text.as_bytes())?;
        for picture in &pictures {
            write(
                folder,
                picture,
                &fs::read(root.join(picture)).with_context(|| format!("{page}: {picture}"))?,
            )?;
        }
    }
    write(folder, "SUMMARY.md", summary.as_bytes())?;
    Ok(pages.len())
}

fn write(folder: &Path, path: &str, content: &[u8]) -> Result<()> {
    let path = folder.join(in_book(path));
    fs::create_dir_all(path.parent().unwrap_or(folder))
        .and_then(|()| fs::write(&path, content))
        .with_context(|| path.display().to_string())
}

/// Returns the path of a file in the book. Files of `docs` are at its top. A README is the index of
/// its folder.
fn in_book(path: &str) -> String {
    let path = path.strip_prefix("docs/").unwrap_or(path);
    path.strip_suffix("README.md").map_or(path.to_owned(), |folder| format!("{folder}index.md"))
}

fn is_picture(path: &str) -> bool {
    path.ends_with(".png") || path.ends_with(".svg")
}

/// Returns the chapters of the contents page in order: each item of a list, with its indentation.
fn chapters(contents: &str) -> impl Iterator<Item = (&str, &str)> {
    contents.lines().filter(|line| line.trim_start().starts_with("- [")).filter_map(|line| {
        let (title, link) = line.split_once("](")?;
        Some((title, link.split(')').next()?))
    })
}

/// Returns mdBook's list of chapters. A section of the contents page is a part of the book.
fn summary(contents: &str) -> String {
    let mut summary = "# Summary\n\n[Documentation](index.md)\n".to_owned();
    for line in contents.lines() {
        if let Some(title) = line.strip_prefix("## ") {
            summary += &format!("\n# {title}\n\n");
        } else if let Some((title, link)) = chapters(line).next() {
            let path = resolve(CONTENTS, link).unwrap_or_default();
            summary += &format!("{title}]({})\n", in_book(&path));
        }
    }
    summary
}

/// Returns the Markdown files of `docs` that are not among the pages.
fn missing(root: &Path, pages: &BTreeSet<String>) -> Result<Vec<String>> {
    let mut missing = Vec::new();
    let mut folders = vec!["docs".to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(root.join(&folder)).with_context(|| folder.clone())? {
            let entry = entry?;
            let path = format!("{folder}/{}", entry.file_name().to_string_lossy());
            if entry.file_type()?.is_dir() {
                folders.push(path);
            } else if path.ends_with(".md") && !pages.contains(&path) {
                missing.push(path);
            }
        }
    }
    missing.sort();
    Ok(missing)
}

/// Returns the link in the book of a link of a page, or `None` if it stays. A link to a file that
/// is not in the book leads to the clone, whose folder `target` contains the book.
fn link_in_book(pages: &BTreeSet<String>, page: &str, link: &str) -> Option<String> {
    let (path, rest) = link.split_at(link.find(['#', '?']).unwrap_or(link.len()));
    if path.is_empty() || path.contains("://") || path.starts_with("mailto:") {
        return None;
    }
    let target = resolve(page, path)?;
    let up = "../".repeat(in_book(page).matches('/').count());
    if pages.contains(&target) || is_picture(&target) {
        Some(format!("{up}{}{rest}", in_book(&target)))
    } else {
        // mdBook takes every Markdown file for a chapter, so the link leads to its folder.
        let folder = target.rsplit_once('/').map_or("", |(folder, _)| folder);
        let source = if target.ends_with(".md") { format!("{folder}/") } else { target.clone() + rest };
        Some(format!("{up}../../{}", source.trim_start_matches('/')))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PAGE: &str = "# A\n\n| a | [b](guide/b.md) |\n\n## Guide\n\ntext\n\n- [B](guide/b.md)\n  - [C](../crates/c/page.md)\n";

    #[test]
    fn lists_of_the_contents_page_give_the_chapters() {
        let expected = "# Summary\n\n[Documentation](index.md)\n\n# Guide\n\n- [B](guide/b.md)\n  - [C](crates/c/page.md)\n";
        assert_eq!(summary(PAGE), expected);
    }

    #[test]
    fn a_link_leads_to_the_book_or_to_the_clone() {
        let pages = BTreeSet::from(["docs/guide/b.md".to_owned(), "crates/c/page.md".to_owned()]);
        let check = |page, link, expected: &str| {
            assert_eq!(link_in_book(&pages, page, link).as_deref(), Some(expected), "{link}");
        };
        check("docs/guide/b.md", "../../crates/c/page.md#x", "../crates/c/page.md#x");
        check("crates/c/page.md", "../../docs/guide/b.md", "../../guide/b.md");
        check("crates/c/page.md", "picture.png", "../../crates/c/picture.png");
        check("docs/guide/b.md", "../../src/lib.rs", "../../../src/lib.rs");
        check("docs/guide/b.md", "../../src/README.md#x", "../../../src/");
        for link in ["#here", "https://a.b/c", "mailto:a@b.c"] {
            assert_eq!(link_in_book(&pages, "docs/guide/b.md", link), None, "{link}");
        }
    }
}
