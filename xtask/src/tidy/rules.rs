//! Rules of the house about the text and the names of files.

use std::path::Path;

use super::{File, Problem, Tree};

/// Text that must not stand in certain files.
struct Rule {
    applies: fn(path: &str) -> bool,
    /// Split in two, so that this file keeps its own rules.
    forbidden: &'static [(&'static str, &'static str)],
    /// Whether a letter, digit, point or slash before the text makes it something else.
    is_whole_word: bool,
    why: &'static str,
}

const RULES: &[Rule] = &[
    Rule {
        applies: |path| {
            !(path == "Cargo.lock" || path.starts_with("LICENSE") || path.contains("/tests/golden/"))
        },
        forbidden: &[("/wo", "rk/"), ("/ro", "ot/"), ("/ho", "me/")],
        is_whole_word: true,
        why: "is a path of one machine; name it from the repository's root",
    },
    Rule {
        applies: |path| path.ends_with(".rs"),
        forbidden: &[("to", "do!("), ("unimple", "mented!(")],
        is_whole_word: true,
        why: "is unfinished work; finish it or leave it out",
    },
    Rule {
        applies: |path| path.ends_with(".rs"),
        forbidden: &[("#[ig", "nore")],
        is_whole_word: false,
        why: "switches a test off; mend it, or assert what happens today and say why",
    },
    Rule {
        applies: |path| path.ends_with(".rs") && !may_be_unsafe(path),
        forbidden: &[("allow(uns", "afe_code"), ("expect(uns", "afe_code")],
        is_whole_word: false,
        why: "lets unsafe code in, which only crates/world may have",
    },
];

/// The one crate that talks to C, and tests that count allocations, which takes an allocator of one's own.
fn may_be_unsafe(path: &str) -> bool {
    path.starts_with("crates/world/") || (path.contains("/tests/") && path.ends_with("/allocations.rs"))
}

/// Names that say nothing about what is inside.
const EMPTY_NAMES: [&str; 6] = ["utils", "util", "common", "helpers", "helper", "misc"];

pub fn check(tree: &Tree) -> Vec<Problem> {
    tree.files.iter().flat_map(|file| texts(file).chain(name(file)).chain(lints(file))).collect()
}

fn texts(file: &File) -> impl Iterator<Item = Problem> {
    let rules = RULES.iter().filter(|rule| (rule.applies)(&file.path));
    rules.flat_map(move |rule| {
        (1..).zip(file.text.lines()).flat_map(move |(line, text)| {
            let found =
                rule.forbidden.iter().map(|(a, b)| format!("{a}{b}")).filter(|word| holds(text, word, rule));
            found.map(move |word| Problem {
                path: file.path.clone(),
                line,
                what: format!("`{word}` {}", rule.why),
            })
        })
    })
}

fn holds(text: &str, word: &str, rule: &Rule) -> bool {
    let belongs_to_word = |c: char| c.is_alphanumeric() || matches!(c, '_' | '.' | '/' | '-' | '}');
    text.match_indices(word).any(|(at, _)| !rule.is_whole_word || !text[..at].ends_with(belongs_to_word))
}

fn name(file: &File) -> Option<Problem> {
    let is_source = file.path.ends_with(".rs") || file.path.ends_with(".py");
    let empty = Path::new(&file.path)
        .components()
        .filter_map(|part| Path::new(part.as_os_str()).file_stem()?.to_str())
        .find(|name| EMPTY_NAMES.contains(name))?;
    let what = format!("the name `{empty}` says nothing; name what is inside");
    is_source.then(|| Problem { path: file.path.clone(), line: 1, what })
}

/// A package that does not take the workspace's lints escapes them all.
fn lints(file: &File) -> Option<Problem> {
    let is_package = file.path.ends_with("Cargo.toml") && file.text.contains("[package]");
    let what = "takes no lints from the workspace; add `[lints]` with `workspace = true`".to_owned();
    (is_package && !file.text.contains("[lints]\nworkspace = true")).then(|| Problem {
        path: file.path.clone(),
        line: 1,
        what,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check_file(path: &str, text: &str, lines: &[usize]) {
        let problems = check(&Tree::of(&[(path, text)]));
        assert_eq!(
            problems.iter().map(|problem| problem.line).collect::<Vec<_>>(),
            lines,
            "{path}: {problems:?}"
        );
    }

    #[test]
    fn paths_of_a_machine_are_found_where_they_matter() {
        let path = format!("a\nsee {}x/y", concat!("/wo", "rk/"));
        check_file("README.md", &path, &[2]);
        check_file("crates/stl/tests/golden/rtamt/a.json", &path, &[]);
        check_file("Cargo.lock", &path, &[]);
        check_file("README.md", "https://a.b/home/x, frame/work/x", &[]);
    }

    #[test]
    fn unfinished_and_switched_off_code_is_found() {
        check_file("src/a.rs", concat!("fn a() {\n    to", "do!()\n}\n#[ig", "nore = \"slow\"]\n"), &[2, 4]);
        check_file("src/a.rs", "// a list of things to do! (really)\n", &[]);
    }

    #[test]
    fn unsafe_code_stays_in_its_places() {
        let text = concat!("#![allow(uns", "afe_code)]");
        check_file("crates/stl/src/lib.rs", text, &[1]);
        check_file("crates/world/src/ffi.rs", text, &[]);
        check_file("crates/stl/tests/allocations.rs", text, &[]);
    }

    #[test]
    fn names_that_say_nothing_are_found() {
        check_file("crates/stl/src/utils.rs", "", &[1]);
        check_file("crates/stl/tests/common/mod.rs", "", &[1]);
        check_file("crates/stl/src/common_subformula.rs", "", &[]);
        check_file("docs/common.md", "", &[]);
    }

    #[test]
    fn packages_take_the_lints_of_the_workspace() {
        check_file("crates/stl/Cargo.toml", "[package]\nname = \"a\"\n", &[1]);
        check_file("crates/stl/Cargo.toml", "[package]\n\n[lints]\nworkspace = true\n", &[]);
        check_file("Cargo.toml", "[workspace]\n", &[]);
    }
}
