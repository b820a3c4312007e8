//! Checks the local links of HTML files: the file exists, and a page has the anchor.

use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

/// Returns a line for each broken link of the HTML files in a folder, in the order of their paths.
///
/// # Errors
/// If a file cannot be read.
pub fn broken_links(folder: &Path) -> Result<Vec<String>> {
    let mut pages = HashMap::new();
    read(folder, &mut pages)?;
    let mut broken: Vec<String> = pages
        .iter()
        .flat_map(|(path, text)| {
            let links = links(text).filter(|link| !leads(&pages, path, link));
            let name = path.strip_prefix(folder).unwrap_or(path).display();
            links.map(move |link| format!("{name}: the link `{link}` is broken"))
        })
        .collect();
    broken.sort();
    broken.dedup();
    Ok(broken)
}

fn read(folder: &Path, pages: &mut HashMap<PathBuf, String>) -> Result<()> {
    for entry in fs::read_dir(folder).with_context(|| folder.display().to_string())? {
        let path = entry?.path();
        if path.is_dir() {
            read(&path, pages)?;
        } else if path.extension().is_some_and(|extension| extension == "html") {
            let text = fs::read_to_string(&path).with_context(|| path.display().to_string())?;
            pages.insert(path, text);
        }
    }
    Ok(())
}

/// Returns the targets of all links and pictures.
fn links(text: &str) -> impl Iterator<Item = &str> {
    let values = |name| text.split(name).skip(1).filter_map(|rest| rest.split('"').next());
    values(" href=\"").chain(values(" src=\""))
}

/// Returns whether a link of a page leads somewhere. Links to other sites are not followed.
fn leads(pages: &HashMap<PathBuf, String>, page: &Path, link: &str) -> bool {
    if link.contains("://") || link.starts_with("mailto:") || link.starts_with("data:") {
        return true;
    }
    let (path, anchor) = link.split_once('#').unwrap_or((link, ""));
    let target = match path {
        "" => page.to_path_buf(),
        path => normal(&page.parent().unwrap_or(page).join(path)),
    };
    match pages.get(&target) {
        Some(text) => anchor.is_empty() || text.contains(&format!(" id=\"{anchor}\"")),
        None => target.exists(),
    }
}

/// Returns a path without `.` and `..`.
fn normal(path: &Path) -> PathBuf {
    let mut normal = PathBuf::new();
    for part in path.components() {
        match part {
            std::path::Component::CurDir => {}
            std::path::Component::ParentDir => drop(normal.pop()),
            part => normal.push(part),
        }
    }
    normal
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_link_needs_its_page_and_its_anchor() {
        let page = |path: &str, text: &str| (PathBuf::from(path), text.to_owned());
        let pages = HashMap::from([
            page("book/a/b.html", "<h1 id=\"top\">"),
            page("book/c.html", "<h2 class=\"x\" id=\"part\">"),
        ]);
        let leads = |link| leads(&pages, Path::new("book/a/b.html"), link);
        for link in ["#top", "../c.html", "../c.html#part", "./b.html", "https://a.b/c#d", "mailto:a@b.c"] {
            assert!(leads(link), "{link}");
        }
        for link in ["#part", "c.html", "../c.html#top", "../c.md"] {
            assert!(!leads(link), "{link}");
        }
    }

    #[test]
    fn links_and_pictures_are_found() {
        let text = "<a class=\"x\" href=\"a.html\">a</a> <img src=\"b.png\" alt=\"c\">";
        assert_eq!(links(text).collect::<Vec<_>>(), ["a.html", "b.png"]);
    }
}
