//! Rules about the text and the names of files.

use std::path::Path;

use super::{File, Problem, Tree};

/// Text that certain files must not contain.
struct Rule {
    applies: fn(path: &str) -> bool,
    /// Split in two, so that this file passes its own rules.
    forbidden: &'static [(&'static str, &'static str)],
    /// Whether the text must not follow a letter, digit, point or slash.
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
        why: "is a path of one machine; write it from the repository's root",
    },
    Rule {
        applies: |path| path.ends_with(".rs"),
        forbidden: &[("to", "do!("), ("unimple", "mented!(")],
        is_whole_word: true,
        why: "is unfinished work; finish it or remove it",
    },
    Rule {
        applies: |path| path.ends_with(".rs") && !path.contains("/tests/") && !path.starts_with("tests/"),
        forbidden: &[
            ("rho < ", "0.0"),
            ("rho <= ", "0.0"),
            ("rho > ", "0.0"),
            ("rho >= ", "0.0"),
            ("robustness < ", "0.0"),
            ("robustness <= ", "0.0"),
            ("robustness > ", "0.0"),
            ("robustness >= ", "0.0"),
            ("robustness < ", "Some(0.0)"),
            ("robustness > ", "Some(0.0)"),
            ("robustness() < ", "Some(0.0)"),
        ],
        is_whole_word: false,
        why: "does not see the verdict of a zero; call `is_violated` or `is_satisfied`",
    },
    Rule {
        applies: |path| path.ends_with(".rs"),
        forbidden: &[("Command::new(\"ki", "ll\")")],
        is_whole_word: false,
        why: "needs a program that a small Debian lacks; send signals with rustix",
    },
    Rule {
        applies: |path| path.ends_with(".rs") && !may_be_unsafe(path),
        forbidden: &[("allow(uns", "afe_code"), ("expect(uns", "afe_code")],
        is_whole_word: false,
        why: "allows unsafe code, which only crates/world, the C interface, the buffers of the GPU in the Python package and a few tests may contain",
    },
];

/// Returns whether unsafe code is allowed: in the crate that calls C and the one that C calls, for
/// buffers that a Python object owns, in the allocator that counts for tests, and in the faults
/// that tests of run files inject into SQLite.
fn may_be_unsafe(path: &str) -> bool {
    path.starts_with("crates/world/")
        || path.starts_with("crates/monitor-c/")
        || path == "python/src/gpu.rs"
        || path.starts_with("crates/store/tests/faults/")
        || path == "crates/stl/tests/allocation_counter/mod.rs"
}

/// Names that do not describe the content.
const EMPTY_NAMES: [&str; 6] = ["utils", "util", "common", "helpers", "helper", "misc"];

pub fn check(tree: &Tree) -> Vec<Problem> {
    let of_file = |file| texts(file).chain(disabled(file)).chain(name(file)).chain(lints(file));
    tree.files.iter().flat_map(of_file).collect()
}

/// The start of an attribute that leaves a test out, and its end for tests that
/// `cargo xtask test --all` runs.
const DISABLED: [&str; 2] = ["#[ig", "nore"];
const LONG: &str = " = \"long\"]";

/// Finds tests that never run.
fn disabled(file: &File) -> impl Iterator<Item = Problem> {
    let lines = (1..).zip(file.text.lines()).filter(|_| file.path.ends_with(".rs"));
    let start = DISABLED.concat();
    lines.filter_map(move |(line, text)| {
        let rest = text.trim_start().strip_prefix(&start)?;
        let what =
            format!("`{start}` disables a test; fix it, or write `{start}{LONG}` if it takes many seconds");
        (rest != LONG).then(|| Problem { path: file.path.clone(), line, what })
    })
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
    let what = format!("the name `{empty}` does not describe the content");
    is_source.then(|| Problem { path: file.path.clone(), line: 1, what })
}

/// Checks that a package inherits the workspace's lints.
fn lints(file: &File) -> Option<Problem> {
    let is_package = file.path.ends_with("Cargo.toml") && file.text.contains("[package]");
    let what = "inherits no lints from the workspace; add `[lints]` with `workspace = true`".to_owned();
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
    fn absolute_paths_are_found_outside_golden_files() {
        let path = format!("a\nsee {}x/y", concat!("/wo", "rk/"));
        check_file("README.md", &path, &[2]);
        check_file("crates/stl/tests/golden/rtamt/a.json", &path, &[]);
        check_file("Cargo.lock", &path, &[]);
        check_file("README.md", "https://a.b/home/x, frame/work/x", &[]);
    }

    #[test]
    fn unfinished_code_and_disabled_tests_are_found() {
        check_file("src/a.rs", concat!("fn a() {\n    to", "do!()\n}\n#[ig", "nore = \"slow\"]\n"), &[2, 4]);
        check_file("src/a.rs", concat!("    #[ig", "nore]\n    #[ig", "nore = \"long\"]\n"), &[1]);
        check_file("src/a.rs", "// a list of things to do! (really)\n", &[]);
    }

    #[test]
    fn unsafe_code_is_found_outside_its_crate() {
        let text = concat!("#![allow(uns", "afe_code)]");
        check_file("crates/stl/src/lib.rs", text, &[1]);
        check_file("crates/world/src/ffi.rs", text, &[]);
        check_file("crates/stl/tests/allocation_counter/mod.rs", text, &[]);
        check_file("crates/store/tests/faults/vfs.rs", text, &[]);
        check_file("crates/store/tests/kill.rs", text, &[1]);
    }

    #[test]
    fn names_without_meaning_are_found() {
        check_file("crates/stl/src/utils.rs", "", &[1]);
        check_file("crates/stl/tests/common/mod.rs", "", &[1]);
        check_file("crates/stl/src/common_subformula.rs", "", &[]);
        check_file("docs/common.md", "", &[]);
    }

    #[test]
    fn packages_inherit_the_lints_of_the_workspace() {
        check_file("crates/stl/Cargo.toml", "[package]\nname = \"a\"\n", &[1]);
        check_file("crates/stl/Cargo.toml", "[package]\n\n[lints]\nworkspace = true\n", &[]);
        check_file("Cargo.toml", "[workspace]\n", &[]);
    }
}
