//! Refuses turns of phrase in comments and Markdown that read as a translation.

use super::{File, Problem, Tree};

/// Words after `is no` that make it right, as in `is no longer`.
const RIGHT: [&str; 10] =
    ["longer", "more", "less", "better", "worse", "larger", "smaller", "faster", "slower", "such"];

pub fn check(tree: &Tree) -> Vec<Problem> {
    tree.files.iter().flat_map(check_file).collect()
}

fn check_file(file: &File) -> Vec<Problem> {
    let prose: fn(&str) -> Option<&str> = match file.path.rsplit_once('.') {
        Some((_, "rs")) => comment,
        Some((_, "md")) => |line| Some(line),
        _ => return Vec::new(),
    };
    let check_line = |(line, text): (usize, &str)| {
        let found = prose(text).map(problems).unwrap_or_default();
        found.into_iter().map(|what| Problem { path: file.path.clone(), line, what }).collect::<Vec<_>>()
    };
    (1..).zip(file.text.lines()).flat_map(check_line).collect()
}

/// Returns the comment of a line of Rust.
fn comment(line: &str) -> Option<&str> {
    let start = line.trim_start();
    if start.starts_with("//") { Some(start) } else { line.find(" // ").map(|at| &line[at + 1..]) }
}

fn problems(text: &str) -> Vec<String> {
    let mut found = Vec::new();
    if text.starts_with("/// What ") || text.starts_with("//! What ") {
        found.push("a doc comment starts with `What`: name the thing".to_owned());
    }
    let text = text.trim_start_matches(['/', '!']).to_lowercase();
    let words: Vec<&str> = text.split_whitespace().collect();
    for (at, pair) in words.windows(2).enumerate() {
        // The first word of a line may follow a `there` on the line before.
        let after_there = at == 0 || words[at - 1].trim_start_matches(['(', '"', '*']) == "there";
        let is_right =
            words.get(at + 2).is_some_and(|word| RIGHT.contains(&word.trim_matches([',', '.', ':'])));
        if matches!(pair, ["is" | "are", "no"]) && !after_there && !is_right {
            found.push(format!("`{} no`: write `{} not a`", pair[0], pair[0]));
        }
    }
    if text.contains("sample of the others") {
        found.push("`the others`: write `audit sample`, or name the simulations".to_owned());
    }
    if text.split(|c: char| !c.is_alphanumeric()).any(|word| word == "stranger" || word == "strangers") {
        found.push("`stranger`: write `untrusted`".to_owned());
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check_text(path: &str, text: &str, expected: &[&str]) {
        let problems = check(&Tree::of(&[(path, text)]));
        assert_eq!(problems.iter().map(ToString::to_string).collect::<Vec<_>>(), expected, "{text}");
    }

    #[test]
    fn phrases_are_found_in_comments_and_markdown() {
        let name = "crates/stl/src/a.rs:1: a doc comment starts with `What`: name the thing";
        check_text("crates/stl/src/a.rs", "    /// What is allowed.", &[name]);
        check_text("docs/a.md", "What is allowed.", &[]);
        check_text("docs/a.md", "This is no proof.", &["docs/a.md:1: `is no`: write `is not a`"]);
        check_text("docs/a.md", "There is no proof. It is no longer so, and it is no better.", &[]);
        let untrusted = "docs/a.md:1: `stranger`: write `untrusted`";
        check_text("docs/a.md", "The file of a stranger.", &[untrusted]);
        let others = "docs/a.md:1: `the others`: write `audit sample`, or name the simulations";
        check_text("docs/a.md", "A sample of the others; the others are nominal.", &[others]);
    }

    #[test]
    fn code_is_not_checked() {
        check_text("crates/stl/src/a.rs", "let text = \"this is no proof\";", &[]);
        check_text(
            "crates/stl/src/a.rs",
            concat!("let a = 1; /", "/ This is no proof."),
            &["crates/stl/src/a.rs:1: `is no`: write `is not a`"],
        );
        check_text("crates/stl/src/a.rs", concat!("/// If there\n", "/// is no proof.\n"), &[]);
    }
}
