//! Checks that relative links in Markdown lead to files of the repository, and that a list names a
//! page once.

use super::{File, Problem, Tree};
use crate::markdown::{links, resolve, until};

pub fn check(tree: &Tree) -> Vec<Problem> {
    let pages = tree.files.iter().filter(|file| file.path.ends_with(".md"));
    pages
        .flat_map(|page| {
            let broken = links(&page.text).filter_map(|(line, target)| broken(tree, page, line, target));
            broken.chain(repeated(page)).collect::<Vec<_>>()
        })
        .collect()
}

/// Returns the items of lists that begin with the same link as an earlier item. The book takes its
/// contents from the list of docs/README.md, and refuses a page that stands there twice.
fn repeated(page: &File) -> impl Iterator<Item = Problem> {
    let mut seen = std::collections::HashSet::new();
    (1..).zip(page.text.lines()).filter_map(move |(line, text)| {
        let item = text.strip_prefix("- [").filter(|item| item.contains("]("))?;
        let what = "is in the list twice; leave out one of both".to_owned();
        (!seen.insert(item)).then(|| Problem { path: page.path.clone(), line, what })
    })
}

fn broken(tree: &Tree, page: &File, line: usize, target: &str) -> Option<Problem> {
    let path = until(target, &['#', '?']);
    let leads_elsewhere = path.contains("://") || path.starts_with("mailto:") || path.is_empty();
    if leads_elsewhere {
        return None;
    }
    let resolved = resolve(&page.path, path);
    let exists = resolved
        .as_deref()
        .is_some_and(|path| path.is_empty() || tree.file(path).is_some() || tree.has_folder(path));
    let what =
        || format!("links to `{target}`, but the repository has no {}", resolved.as_deref().unwrap_or(path));
    (!exists).then(|| Problem { path: page.path.clone(), line, what: what() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check_page(text: &str, expected: &[&str]) {
        let tree = Tree::of(&[("book/guide/a.md", text), ("book/b.md", ""), ("LICENSE", "")]);
        let got: Vec<_> = check(&tree).iter().map(ToString::to_string).collect();
        assert_eq!(got, expected, "{text}");
    }

    #[test]
    fn links_to_files_folders_anchors_and_other_sites_are_accepted() {
        check_page(
            "[b](../b.md#part) ![x](../../book) [y](https://a.b/c) [z](#here) [l](../../LICENSE \"text\")",
            &[],
        );
        check_page("[b]: ../b.md\n<img src=\"../b.md\"> <a href=\"https://x.y\">", &[]);
        check_page("`[x](no.md)`\n```\n[x](no.md)\n```\n", &[]);
    }

    #[test]
    fn a_broken_link_is_reported_with_its_line() {
        let no = |line, link, path| {
            format!("book/guide/a.md:{line}: links to `{link}`, but the repository has no {path}")
        };
        check_page("[b](../b.md)\n\n[c](../c.md#x)", &[&no(3, "../c.md#x", "book/c.md")]);
        check_page("[b]: b.md", &[&no(1, "b.md", "book/guide/b.md")]);
        check_page("<img src=\"b.png\"/>", &[&no(1, "b.png", "book/guide/b.png")]);
        check_page("[out](../../../x.md)", &[&no(1, "../../../x.md", "../../../x.md")]);
    }

    #[test]
    fn a_page_stands_in_a_list_once() {
        check_page("- [b](../b.md)\n- [c](../b.md#c)\n", &[]);
        let twice = "book/guide/a.md:2: is in the list twice; leave out one of both";
        check_page("- [b](../b.md)\n- [b](../b.md)\n", &[twice]);
    }
}
