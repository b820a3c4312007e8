//! Test programs: linking one takes seconds of CPU time, so a package has at most two.

use super::{File, Problem, Tree};

/// Most test programs of a package: its tests, and those that need a program of their own.
const MOST: usize = 2;

pub fn check(tree: &Tree) -> Vec<Problem> {
    let manifests = tree.files.iter().filter(|file| file.path.ends_with("Cargo.toml"));
    manifests.flat_map(|manifest| of_package(tree, manifest)).collect()
}

/// Checks the files of a package that may have tests: `tests/NAME.rs`, `tests/NAME/main.rs` and
/// `tests/NAME/mod.rs`. Each is a test program, a module of one, or a file that another one names.
fn of_package(tree: &Tree, manifest: &File) -> Vec<Problem> {
    let folder = manifest.path.strip_suffix("Cargo.toml").unwrap_or_default();
    let files: Vec<(&File, &str, &str)> =
        tree.files.iter().filter_map(|file| of_tests(file, folder)).collect();
    let finds_tests = !manifest.text.contains("\nautotests = false\n");
    let is_program = |path: &str, name: &str| {
        let named = format!("[[test]]\nname = \"{name}\"\n");
        let placed = format!("path = \"{path}\"\n");
        !path.ends_with("/mod.rs")
            && (finds_tests || manifest.text.contains(&placed) || manifest.text.contains(&named))
    };
    let programs: Vec<&File> =
        files.iter().filter(|(_, path, name)| is_program(path, name)).map(|(file, ..)| *file).collect();
    let is_module = |name: &str| {
        let line = format!("mod {name};");
        programs.iter().any(|program| program.text.lines().any(|own| own == line))
    };
    let mut problems = Vec::new();
    for (file, path, name) in &files {
        let what = match (is_program(path, name), is_module(name)) {
            (true, true) => "is a test program and a module of another one",
            (false, false) if !is_named(tree, file) => {
                "is no part of a test program, so its tests do not run"
            }
            _ => continue,
        };
        problems.push(Problem { path: file.path.clone(), line: 1, what: what.to_string() });
    }
    if programs.len() > MOST {
        let what =
            format!("has {} test programs; make them modules of {folder}tests/main.rs", programs.len());
        problems.push(Problem { path: manifest.path.clone(), line: 1, what });
    }
    problems
}

/// Returns a file that may have tests of the package in this folder, its path from the folder, and
/// its name.
fn of_tests<'a>(file: &'a File, folder: &str) -> Option<(&'a File, &'a str, &'a str)> {
    let path = file.path.strip_prefix(folder)?;
    let rest = path.strip_prefix("tests/")?;
    let name = rest
        .strip_suffix("/main.rs")
        .or_else(|| rest.strip_suffix("/mod.rs"))
        .or_else(|| rest.strip_suffix(".rs"))?;
    (!name.contains('/')).then_some((file, path, name))
}

/// Returns whether a file outside of the package's programs names this one: an attribute `path`, or
/// a manifest.
fn is_named(tree: &Tree, file: &File) -> bool {
    let end = file.path.split_once("tests/").map_or("", |(_, end)| end);
    tree.files.iter().any(|other| {
        let is_source = other.path.ends_with(".rs") || other.path.ends_with("Cargo.toml");
        is_source && other.text.contains(&format!("tests/{end}\""))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const MANIFEST: &str =
        "[package]\nautotests = false\n\n[[test]]\nname = \"tests\"\npath = \"tests/main.rs\"\n";

    fn problems(files: &[(&str, &str)]) -> Vec<String> {
        check(&Tree::of(files)).iter().map(ToString::to_string).collect()
    }

    #[test]
    fn a_file_of_tests_that_never_run_is_found() {
        let found = problems(&[
            ("a/Cargo.toml", MANIFEST),
            ("a/tests/main.rs", "mod kept;\n"),
            ("a/tests/kept.rs", ""),
            ("a/tests/lost.rs", ""),
            ("a/tests/data/deep.rs", ""),
        ]);
        assert_eq!(found, ["a/tests/lost.rs:1: is no part of a test program, so its tests do not run"]);
    }

    #[test]
    fn a_folder_of_tests_that_never_run_is_found() {
        let lost = problems(&[
            ("a/Cargo.toml", MANIFEST),
            ("a/tests/main.rs", "mod kept;\n"),
            ("a/tests/kept/mod.rs", ""),
            ("a/tests/laws/mod.rs", ""),
            ("b/Cargo.toml", "[package]\nautotests = false\n"),
            ("b/tests/zoo/main.rs", ""),
        ]);
        let what = "is no part of a test program, so its tests do not run";
        assert_eq!(
            lost,
            ["a/tests/laws/mod.rs", "b/tests/zoo/main.rs"].map(|path| format!("{path}:1: {what}"))
        );
    }

    #[test]
    fn a_file_that_another_package_includes_is_used() {
        let includes = "#[path = \"../../a/tests/shared/mod.rs\"]\nmod shared;\n";
        let files = [("a/Cargo.toml", MANIFEST), ("a/tests/main.rs", ""), ("a/tests/shared/mod.rs", "")];
        assert_eq!(problems(&files).len(), 1);
        assert!(problems(&[&files[..], &[("b/src/lib.rs", includes)]].concat()).is_empty());
    }

    #[test]
    fn a_package_has_at_most_two_test_programs() {
        let two = [("b/Cargo.toml", "[package]\n"), ("b/tests/x.rs", ""), ("b/tests/y.rs", "")];
        assert!(problems(&two).is_empty());
        let found = problems(&[&two[..], &[("b/tests/z.rs", "")]].concat());
        assert_eq!(found, ["b/Cargo.toml:1: has 3 test programs; make them modules of b/tests/main.rs"]);
    }
}
