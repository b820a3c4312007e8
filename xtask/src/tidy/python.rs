//! Checks the Python package against its table in ARCHITECTURE.md: order of imports, sizes of
//! packages, number of exported names.

use std::collections::BTreeMap;

use super::crates::{cells, quoted};
use super::{File, Problem, Tree};

const PAGE: &str = "ARCHITECTURE.md";
const COLUMNS: [&str; 2] = ["Python package", "holds"];
const FOLDER: &str = "python/mishandle/";
const FACE: &str = "python/mishandle/__init__.py";

/// Modules that the build writes.
const GENERATED: [&str; 2] = ["_native", "results"];

/// Largest number of modules of a package, without its `__init__.py`.
const MODULES: usize = 12;

/// Largest number of names that the package exports.
const NAMES: usize = 50;

pub fn check(tree: &Tree) -> Vec<Problem> {
    let text = tree.file(PAGE).map_or("", |file| &file.text);
    let rows = table(text);
    if rows.is_empty() {
        let what = format!("no table with the columns {}", COLUMNS.join(", "));
        return vec![Problem { path: PAGE.into(), line: 1, what }];
    }
    let names: Vec<&str> = rows.iter().map(|(_, name)| *name).collect();
    let files: Vec<&File> = tree.files.iter().filter(|file| is_module(&file.path)).collect();
    let has_files = |name: &str| files.iter().any(|file| part(&file.path) == name);
    let unused = rows.iter().filter(|(_, name)| !GENERATED.contains(name) && !has_files(name));
    let mut problems: Vec<Problem> = unused
        .map(|(line, name)| Problem {
            path: PAGE.into(),
            line: *line,
            what: format!("`{FOLDER}` has no package or module `{name}`"),
        })
        .collect();
    for file in files.iter().filter(|file| file.path != FACE) {
        problems.extend(check_imports(file, &names));
    }
    problems.extend(crowded(&files));
    problems.extend(tree.file(FACE).and_then(check_face));
    problems
}

fn is_module(path: &str) -> bool {
    path.starts_with(FOLDER) && path.ends_with(".py")
}

/// Returns the first name below the package: `logs` for `python/mishandle/logs/columns.py`.
fn part(path: &str) -> &str {
    let rest = path.strip_prefix(FOLDER).unwrap_or(path);
    rest.split('/').next().unwrap_or(rest).trim_end_matches(".py")
}

fn check_imports(file: &File, names: &[&str]) -> Vec<Problem> {
    let place = |name: &str| names.iter().position(|other| *other == name);
    let problem = |line, what| Problem { path: file.path.clone(), line, what };
    let own = part(&file.path);
    let Some(own_place) = place(own) else {
        return vec![problem(1, format!("the table in {PAGE} has no row for `{own}`"))];
    };
    let mut problems = Vec::new();
    for (line, text) in (1..).zip(file.text.lines()) {
        let words: Vec<&str> = text.split_whitespace().collect();
        let ["from" | "import", module, ..] = words[..] else { continue };
        let mut parts = module.split('.');
        if parts.next() != Some("mishandle") {
            continue;
        }
        let found = match parts.next().map(|other| (other, place(other))) {
            None => Some("imports from `mishandle`; name the module that has it".to_owned()),
            Some((other, None)) => Some(format!("the table in {PAGE} has no row for `{other}`")),
            Some((other, Some(place))) if place > own_place => {
                Some(format!("`{own}` imports `{other}`, which is above it in {PAGE}"))
            }
            Some(_) => None,
        };
        problems.extend(found.map(|what| problem(line, what)));
    }
    problems
}

/// Finds folders with too many modules.
fn crowded(files: &[&File]) -> Vec<Problem> {
    let mut modules: BTreeMap<&str, usize> = BTreeMap::new();
    for file in files {
        let (folder, name) = file.path.rsplit_once('/').unwrap_or(("", &file.path));
        *modules.entry(folder).or_default() += usize::from(name != "__init__.py");
    }
    let large = modules.into_iter().filter(|(_, count)| *count > MODULES);
    large
        .map(|(folder, count)| Problem {
            path: folder.into(),
            line: 1,
            what: format!("has {count} modules, more than {MODULES}; divide it"),
        })
        .collect()
}

fn check_face(face: &File) -> Option<Problem> {
    let (_, list) = face.text.split_once("__all__ = [")?;
    let count = list.split(']').next()?.matches('"').count() / 2;
    (count > NAMES).then(|| Problem {
        path: FACE.into(),
        line: 1,
        what: format!("exports {count} names, more than {NAMES}; let users reach rare ones in their package"),
    })
}

/// Returns line and name of each row, the lowest first.
fn table(text: &str) -> Vec<(usize, &str)> {
    let lines = (1..).zip(text.lines()).skip_while(|(_, line)| cells(line) != COLUMNS).skip(2);
    let rows = lines.take_while(|(_, line)| line.starts_with('|'));
    rows.flat_map(|(line, text)| quoted(cells(text)[0]).map(move |name| (line, name))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROWS: &str = "| Python package | holds |\n|---|---|\n| `errors` | text |\n| `logs` | text |\n\
                        | `ask` | text |\n";

    #[track_caller]
    fn check_files(files: &[(&str, &str)], expected: &[&str]) {
        let rest = [(PAGE, ROWS), ("python/mishandle/errors.py", ""), ("python/mishandle/logs/a.py", "")];
        let files = [&rest, files].concat();
        let got: Vec<_> = check(&Tree::of(&files)).iter().map(ToString::to_string).collect();
        assert_eq!(got, expected);
    }

    #[test]
    fn imports_run_down() {
        let low = "\"\"\"Doc.\n\n>>> from mishandle import Axis\n\"\"\"\nimport os\nfrom mishandle.errors import E\n";
        check_files(
            &[("python/mishandle/ask/a.py", low), (FACE, "from mishandle.ask import evaluate\n")],
            &[],
        );
        let up =
            "import mishandle.ask.a as a\n    from mishandle import Axis\nfrom mishandle.other import b\n";
        check_files(
            &[("python/mishandle/ask/a.py", ""), ("python/mishandle/logs/b.py", up)],
            &[
                "python/mishandle/logs/b.py:1: `logs` imports `ask`, which is above it in ARCHITECTURE.md",
                "python/mishandle/logs/b.py:2: imports from `mishandle`; name the module that has it",
                "python/mishandle/logs/b.py:3: the table in ARCHITECTURE.md has no row for `other`",
            ],
        );
    }

    #[test]
    fn rows_are_the_packages() {
        check_files(&[], &["ARCHITECTURE.md:5: `python/mishandle/` has no package or module `ask`"]);
        let files = [("python/mishandle/ask/a.py", ""), ("python/mishandle/new.py", "")];
        check_files(
            &files,
            &["python/mishandle/new.py:1: the table in ARCHITECTURE.md has no row for `new`"],
        );
        let missing = check(&Tree::of(&[]));
        assert_eq!(missing[0].what, "no table with the columns Python package, holds");
    }

    #[test]
    fn a_package_has_few_modules_and_the_face_few_names() {
        let paths: Vec<String> = (0..13).map(|n| format!("python/mishandle/ask/m{n}.py")).collect();
        let mut files: Vec<(&str, &str)> = paths[1..].iter().map(|path| (path.as_str(), "")).collect();
        files.push(("python/mishandle/ask/__init__.py", ""));
        check_files(&files, &[]);
        files.push((&paths[0], ""));
        let names: Vec<String> = (0..51).map(|n| format!("    \"name{n}\",\n")).collect();
        let face = format!("__all__ = [\n{}]\n", names.concat());
        files.push((FACE, &face));
        let what = "exports 51 names, more than 50; let users reach rare ones in their package";
        check_files(
            &files,
            &[
                "python/mishandle/ask:1: has 13 modules, more than 12; divide it",
                &format!("{FACE}:1: {what}"),
            ],
        );
    }
}
