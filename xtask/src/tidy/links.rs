//! Checks that relative links in Markdown lead to files of the repository.

use super::{File, Problem, Tree};

pub fn check(tree: &Tree) -> Vec<Problem> {
    let pages = tree.files.iter().filter(|file| file.path.ends_with(".md"));
    pages.flat_map(|page| links(page).filter_map(|(line, target)| broken(tree, page, line, target))).collect()
}

/// Returns every link of a page outside code, with its line.
fn links(page: &File) -> impl Iterator<Item = (usize, &str)> {
    let mut in_code = false;
    (1..)
        .zip(page.text.lines())
        .filter(move |(_, line)| {
            let is_fence = line.trim_start().starts_with("```");
            in_code ^= is_fence;
            !in_code && !is_fence
        })
        .flat_map(|(number, line)| targets(line).map(move |target| (number, target)))
}

/// Returns the link targets of a line: inline (`[a](b)`), definitions (`[a]: b`) and HTML (`src="b"`, `href="b"`).
fn targets(line: &str) -> impl Iterator<Item = &str> {
    // Odd pieces between backticks are code.
    let prose = line.split('`').step_by(2);
    let inline = prose.flat_map(|text| text.split("](").skip(1).map(|rest| until(rest, &[')', ' '])));
    let html = line
        .split_once('<')
        .map_or("", |(_, tags)| tags)
        .split("src=\"")
        .flat_map(|part| part.split("href=\""))
        .skip(1)
        .map(|rest| until(rest, &['"']));
    let definition =
        line.strip_prefix('[').and_then(|rest| rest.split_once("]: ")).map(|(_, rest)| until(rest, &[' ']));
    inline.chain(html).chain(definition)
}

fn until<'a>(text: &'a str, ends: &[char]) -> &'a str {
    text.split(ends).next().unwrap_or(text)
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

/// Returns the path of a link from the root, where a leading `/` also starts; `None` if it leaves the repository.
fn resolve(page: &str, link: &str) -> Option<String> {
    let folder = page.rsplit_once('/').filter(|_| !link.starts_with('/')).map_or("", |(folder, _)| folder);
    let mut parts: Vec<&str> = Vec::new();
    for part in folder.split('/').chain(link.split('/')) {
        match part {
            "" | "." => {}
            ".." => drop(parts.pop()?),
            name => parts.push(name),
        }
    }
    Some(parts.join("/"))
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
}
