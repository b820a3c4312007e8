//! Refuses measured figures without a source, pages of tasks whose figures are older than their
//! task, and studies without a commit.

use std::fmt::Write;

use sha2::{Digest, Sha256};

use super::{File, Problem, Tree};
use crate::figures::{Sourced, sourced};
use crate::readme::PAGES;

/// The hashes of the tasks.
const FROZEN: &str = "crates/tasks/tests/frozen.txt";

/// Folder of the pages of tasks.
const TASKS: &str = "crates/tasks/src/";

/// Sources that need no measurement.
const FACTS: [&str; 3] = ["definition", "formula", "MJCF"];

const STUDIES: &str = "studies/notebook/";

pub fn check(tree: &Tree) -> Vec<Problem> {
    let mut found = Vec::new();
    for page in tree.files.iter().filter(|file| file.path.ends_with(".md")) {
        if page.path == "README.md" || page.path.starts_with("docs/") || page.path.starts_with(TASKS) {
            found.extend(sourced(&page.text).iter().filter_map(|part| without_source(tree, page, part)));
        }
        found.extend(old_world(tree, page));
        found.extend(without_commit(page));
    }
    found
}

fn problem(page: &File, line: usize, what: String) -> Option<Problem> {
    Some(Problem { path: page.path.clone(), line, what })
}

fn without_source(tree: &Tree, page: &File, part: &Sourced) -> Option<Problem> {
    let what = match &part.source {
        None => "have no source: delete them, or write `<!-- from: COMMAND OR FILE -->`",
        Some(_) if part.command().is_some() => {
            if PAGES.contains(&page.path.as_str()) {
                return None;
            }
            "have a command that nothing runs: add the page in xtask/src/readme.rs"
        }
        Some(source) if is_source(tree, source) => return None,
        Some(_) => "have a source that is not a file and not a whole command",
    };
    problem(page, part.line, format!("the figures {} {what}", part.figures.join(", ")))
}

fn is_source(tree: &Tree, source: &str) -> bool {
    let mut words = source.split(['`', ' ', ',', ':', '#']);
    let is_there = |path: &str| !path.is_empty() && (tree.file(path).is_some() || tree.has_folder(path));
    FACTS.iter().any(|fact| source.starts_with(fact))
        || source.starts_with("`cargo test ")
        || words.any(|word| is_there(word.trim_start_matches("../").trim_end_matches('/')))
}

/// Returns the problem of a page of a task that was measured in another world.
fn old_world(tree: &Tree, page: &File) -> Option<Problem> {
    let name = page.path.strip_prefix(TASKS)?;
    let task = name.split_once('/').map_or(String::new(), |(folder, _)| folder.replace('_', "-") + " ");
    let hashes = &tree.file(FROZEN)?.text;
    let mut digest = Sha256::new();
    for line in hashes.lines().filter(|line| line.starts_with(&task)) {
        digest.update(line);
    }
    let world = digest.finalize().iter().take(4).fold(String::new(), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    });
    let comment = format!("<!-- world: {world} -->");
    let what = format!("its figures are older than {FROZEN}: measure them again, then write `{comment}`");
    if page.text.contains(&comment) { None } else { problem(page, 1, what) }
}

/// Returns the problem of a study that names no commit.
fn without_commit(page: &File) -> Option<Problem> {
    page.path.strip_prefix(STUDIES).filter(|name| !name.contains('/'))?;
    let is_hash = |word: &str| {
        let word = word.trim_matches(|mark: char| !mark.is_ascii_alphanumeric());
        (7..=40).contains(&word.len()) && word.chars().all(|digit| digit.is_ascii_hexdigit())
    };
    let words: Vec<&str> = page.text.split_whitespace().collect();
    let is_named = words.windows(2).any(|pair| pair[0].ends_with("ommit") && is_hash(pair[1]));
    let what = "names no `commit HASH` at which it measured".to_owned();
    if is_named { None } else { problem(page, 1, what) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check_pages(files: &[(&str, &str)], expected: &[&str]) {
        let found: Vec<String> = check(&Tree::of(files)).iter().map(ToString::to_string).collect();
        assert_eq!(found.len(), expected.len(), "{found:#?}");
        for (found, expected) in found.iter().zip(expected) {
            assert!(found.contains(expected), "{found}");
        }
    }

    #[test]
    fn a_figure_needs_a_source_that_exists() {
        let row = |source: &str| format!("| what | measured |\n|---|---|\n| 3 % | {source} |\n");
        let check_row = |source: &str, expected: &[&str]| {
            check_pages(&[("docs/a.md", &row(source)), ("studies/a.py", "")], expected);
        };
        for source in ["formula", "`studies/a.py`, seed 1", "`cargo test -p a b::`", "`studies`"] {
            check_row(source, &[]);
        }
        for source in ["the expert", "`studies/b.py`", "`mishandle evaluate TASK`", ""] {
            check_row(source, &["docs/a.md:3: "]);
        }
        check_row("`mishandle evaluate a`", &["that nothing runs"]);
        check_pages(&[(PAGES[0], &row("`mishandle evaluate a`"))], &[]);
        check_pages(&[("README.md", "It fails in 3 %.\n")], &["README.md:1: the figures 3 have no source"]);
        check_pages(&[("studies/README.md", "It fails in 3 %.\n")], &[]);
    }

    #[test]
    fn a_page_of_a_task_is_of_the_world_of_its_task() {
        let page = "crates/tasks/src/a_b/page.md";
        // `printf 'a-b physics 12' | sha256sum`
        let frozen = "a-b physics 12\nc physics 34\n";
        let of = |text: &'static str| [(FROZEN, frozen), (page, text)];
        check_pages(&of("<!-- world: 6a3ec31e -->\n"), &[]);
        check_pages(&of("<!-- world: 00000000 -->\n"), &["write `<!-- world: 6a3ec31e -->`"]);
        check_pages(&of("text\n"), &["older than"]);
    }

    #[test]
    fn a_study_names_its_commit() {
        let what = ["names no `commit HASH`"];
        check_pages(&[("studies/notebook/a.md", "# A\n\nCommit 0c6647698.\n\n## B\n")], &[]);
        check_pages(&[("studies/notebook/a.md", "# A\n\nAt commit\n0c66476.\n")], &[]);
        check_pages(&[("studies/notebook/a.md", "# A\n\nAt the commit of the day.\n")], &what);
        check_pages(&[("studies/notebook/a/b.md", "# A\n")], &[]);
    }
}
