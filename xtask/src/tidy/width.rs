//! Refuses text that is too wide: 100 columns for comments in Rust, Python and TOML, and for every
//! line of the Python package, 120 for prose in Markdown. Code blocks, tables and the targets of
//! links are not measured.

use super::{File, Problem, Tree};
use crate::markdown::lines;

/// Comments, and lines of the Python package.
const COMMENT: usize = 100;
const MARKDOWN: usize = 120;

/// Folder of pages that a program writes.
const GENERATED: &str = "studies/notebook/2026-11-28-paper/";

pub fn check(tree: &Tree) -> Vec<Problem> {
    tree.files.iter().filter(|file| !file.path.contains("/golden/")).flat_map(check_file).collect()
}

fn check_file(file: &File) -> Vec<Problem> {
    let wide: Vec<(usize, usize)> = match file.path.rsplit_once('.').map(|(_, extension)| extension) {
        Some("rs") => wide_comments(&file.text, "//"),
        Some("py" | "pyi") if file.path.starts_with("python/") => wide_lines(&file.text),
        Some("py" | "toml") => wide_comments(&file.text, "#"),
        Some("md") if !file.path.starts_with(GENERATED) => wide_prose(&file.text),
        _ => Vec::new(),
    };
    let problem = |(line, most)| Problem {
        path: file.path.clone(),
        line,
        what: format!("the text is wider than {most} columns"),
    };
    wide.into_iter().map(problem).collect()
}

/// Returns the lines that are a comment and too wide, with the limit. Code blocks of doc comments
/// are not measured.
fn wide_comments(text: &str, marker: &str) -> Vec<(usize, usize)> {
    let mut in_code = false;
    let mut wide = Vec::new();
    for (number, line) in (1..).zip(text.lines()) {
        let Some(comment) = line.trim_start().strip_prefix(marker) else {
            in_code = false;
            continue;
        };
        let content = comment.trim_start_matches(['/', '!']).trim_start();
        let is_fence = content.starts_with("```");
        in_code ^= is_fence;
        if !in_code && !is_fence && !content.starts_with('|') && is_wide(line, COMMENT) {
            wide.push((number, COMMENT));
        }
    }
    wide
}

/// Returns the lines that are too wide, with the limit.
fn wide_lines(text: &str) -> Vec<(usize, usize)> {
    let numbered = (1..).zip(text.lines());
    numbered.filter(|(_, line)| columns(line) > COMMENT).map(|(number, _)| (number, COMMENT)).collect()
}

fn wide_prose(text: &str) -> Vec<(usize, usize)> {
    lines(text)
        .filter(|(_, line, is_code)| {
            let start = line.trim_start();
            !is_code && !start.starts_with(['|', '<']) && !line.starts_with('[') && is_wide(line, MARKDOWN)
        })
        .map(|(number, _, _)| (number, MARKDOWN))
        .collect()
}

/// Returns whether a line is wider than `most` without the targets of its links. A long word or
/// code span cannot be wrapped.
fn is_wide(line: &str, most: usize) -> bool {
    let mut pieces = line.split("](");
    let first = pieces.next().map_or(0, columns);
    let rest: usize =
        pieces.map(|piece| piece.split_once(')').map_or(0, |(_, text)| 1 + columns(text))).sum();
    let is_long = |text: &str| columns(text) > most / 2;
    first + rest > most
        && !line.split('`').skip(1).step_by(2).any(is_long)
        && !line.split_whitespace().any(is_long)
}

fn columns(text: &str) -> usize {
    text.chars().count()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check_text(path: &str, text: &str, expected: &[usize]) {
        let problems = check(&Tree::of(&[(path, text)]));
        assert_eq!(problems.iter().map(|problem| problem.line).collect::<Vec<_>>(), expected, "{text}");
    }

    #[test]
    fn wide_comments_and_prose_are_found() {
        let wide = "word ".repeat(25);
        check_text("src/a.rs", &format!("/// {wide}\nlet a = \"{wide}\";\n    // {wide}"), &[1, 3]);
        check_text("a.py", &format!("# {wide}\ncall(\"{wide}\")"), &[1]);
        check_text("python/a.py", &format!("# {wide}\ncall(\"{wide}\")\npass"), &[1, 2]);
        check_text("a.md", &wide, &[1]);
        check_text("a.md", &"word ".repeat(23), &[]);
    }

    #[test]
    fn code_tables_and_targets_of_links_are_not_measured() {
        let wide = "word ".repeat(25);
        check_text("src/a.rs", &format!("/// ```\n/// {wide}\n/// ```\n/// | {wide} |"), &[]);
        check_text("a.md", &format!("```\n{wide}\n```\n| {wide} |\n[a]: {wide}"), &[]);
        check_text("a.md", &format!("- [a](b/{})", "c".repeat(130)), &[]);
        check_text("a.md", &format!("`{wide}`"), &[]);
    }
}
