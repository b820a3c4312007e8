//! Test programs: linking one takes seconds of CPU time, so a package has at most two.

use super::{Problem, Tree};

/// Most test programs of a package: its tests, and those that need a program of their own.
const MOST: usize = 2;

pub fn check(tree: &Tree) -> Vec<Problem> {
    let manifests = tree.files.iter().filter(|file| file.path.ends_with("Cargo.toml"));
    manifests
        .flat_map(|manifest| {
            let folder = manifest.path.strip_suffix("Cargo.toml").unwrap_or_default();
            let main = tree.file(&format!("{folder}tests/main.rs"));
            let named = |file: &str| manifest.text.contains(&format!("[[test]]\nname = \"{file}\"\n"));
            let is_module = |file: &str| {
                main.is_some_and(|main| main.text.lines().any(|line| line == format!("mod {file};")))
            };
            let of_folder = tree.files.iter().filter_map(|file| {
                let name = file.path.strip_prefix(folder)?.strip_prefix("tests/")?.strip_suffix(".rs")?;
                (name != "main" && !name.contains('/')).then_some((file, name))
            });
            let finds_tests = !manifest.text.contains("\nautotests = false\n");
            let mut problems = Vec::new();
            let mut programs = usize::from(main.is_some());
            for (file, name) in of_folder {
                let what = match (finds_tests || named(name), is_module(name)) {
                    (true, true) => format!("is a test program and a module of {folder}tests/main.rs"),
                    (true, false) => {
                        programs += 1;
                        continue;
                    }
                    (false, true) => continue,
                    (false, false) if main.is_none() => continue,
                    (false, false) => {
                        format!("is missing in {folder}tests/main.rs, so its tests do not run")
                    }
                };
                problems.push(Problem { path: file.path.clone(), line: 1, what });
            }
            if programs > MOST {
                let what =
                    format!("has {programs} test programs; make them modules of {folder}tests/main.rs");
                problems.push(Problem { path: manifest.path.clone(), line: 1, what });
            }
            problems
        })
        .collect()
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
        assert_eq!(found, ["a/tests/lost.rs:1: is missing in a/tests/main.rs, so its tests do not run"]);
    }

    #[test]
    fn a_package_has_at_most_two_test_programs() {
        let two = [("b/Cargo.toml", "[package]\n"), ("b/tests/x.rs", ""), ("b/tests/y.rs", "")];
        assert!(problems(&two).is_empty());
        let found = problems(&[&two[..], &[("b/tests/z.rs", "")]].concat());
        assert_eq!(found, ["b/Cargo.toml:1: has 3 test programs; make them modules of b/tests/main.rs"]);
    }
}
