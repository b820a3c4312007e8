//! Refuses functions that take a parameter apart as a tuple, `(a, b): (A, B)`, which hides how many
//! parameters there are. Closures may: they get the pairs of iterators.

use super::{Problem, Tree};

/// Files that have such functions. The list may only shrink.
const LEFT: [&str; 35] = [
    "crates/evidence/src/checks.rs",
    "crates/logs/src/verdict.rs",
    "crates/report/src/charts/draw.rs",
    "crates/report/src/charts/linked_mark.rs",
    "crates/report/src/hardened_modes.rs",
    "crates/report/src/measure.rs",
    "crates/report/src/pictures.rs",
    "crates/report/src/ranking.rs",
    "crates/report/src/seen.rs",
    "crates/report/src/sensitivity.rs",
    "crates/report/src/trace.rs",
    "crates/report/tests/hardening.rs",
    "python/src/policy.rs",
    "python/src/remote.rs",
    "src/counterexample/export.rs",
    "src/harden/measure.rs",
    "src/harden/minimized.rs",
    "src/harden/result.rs",
    "src/harden/round.rs",
    "src/harden/search.rs",
    "src/inspect/axes_at_nominal.rs",
    "src/picture/cameras.rs",
    "src/picture/frames.rs",
    "src/picture/recorded_scene.rs",
    "src/picture/trajectory.rs",
    "src/record/mod.rs",
    "src/replay/mod.rs",
    "src/resolve/guard.rs",
    "src/resolve/scene.rs",
    "src/resolve/training.rs",
    "src/run/header.rs",
    "src/train/mod.rs",
    "src/tune/alarm.rs",
    "studies/src/zoo/plan_entry.rs",
    "tests/train_scenarios.rs",
];

pub fn check(tree: &Tree) -> Vec<Problem> {
    let mut found = Vec::new();
    for file in tree.files.iter().filter(|file| file.path.ends_with(".rs")) {
        let problem = |line: usize, what: String| Problem { path: file.path.clone(), line, what };
        let names = functions(&file.text);
        if !LEFT.contains(&&*file.path) {
            found.extend(names.into_iter().map(|(line, name)| {
                problem(line, format!("`{name}` takes a tuple apart: write two parameters, or a struct"))
            }));
        } else if names.is_empty() {
            let what = "takes no tuple apart; remove it from the list in xtask/src/tidy/tuples.rs";
            found.push(problem(1, what.to_owned()));
        }
    }
    found
}

/// Returns the functions that take a tuple apart, with their lines.
fn functions(text: &str) -> Vec<(usize, &str)> {
    let declared = text.match_indices("fn ").filter(|(at, _)| {
        let line = text[..*at].rsplit('\n').next().unwrap_or_default();
        !line.trim_start().starts_with("//") && !line.ends_with(char::is_alphanumeric)
    });
    let found = declared.filter_map(|(at, keyword)| {
        let rest = &text[at + keyword.len()..];
        let name = rest.split(|c: char| !c.is_alphanumeric() && c != '_').next().unwrap_or_default();
        let declaration = &rest[name.len()..];
        (declaration.starts_with(['(', '<']) && takes_tuple_apart(declaration))
            .then(|| (1 + text[..at].matches('\n').count(), name))
    });
    found.collect()
}

/// Returns whether a parameter starts with a parenthesis. `declaration` starts after the name.
fn takes_tuple_apart(declaration: &str) -> bool {
    let mut depth = 0;
    let mut is_in_list = false;
    let mut starts = false;
    let mut before = ' ';
    for c in declaration.chars() {
        match c {
            '(' if starts => return true,
            '(' if depth == 0 => (is_in_list, starts, depth) = (true, true, 1),
            ',' if depth == 1 && is_in_list => starts = true,
            '(' | '[' | '<' => depth += 1,
            '>' if before == '-' => {}
            ')' | ']' | '>' => depth -= 1,
            _ => {}
        }
        if depth == 0 && (is_in_list || matches!(c, '{' | ';')) {
            return false;
        }
        starts &= matches!(c, '(' | ',' | '&') || c.is_whitespace();
        before = c;
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_functions_that_take_tuples_apart_are_found() {
        let text = "f! a(&self, x: (u8, u8), y: Vec<(u8, u8)>) -> (u8, u8) {
    |(x, y)| f((x, y))
}
f! b<F: Fn((u8, u8)) -> u8>(f: F, x: HashMap<u8, (u8, u8)>, [y, z]: [u8; 2]);
// f! c((x, y): (u8, u8))
    f! d<const N: usize>(
        &self,
        (x, y): (u8, u8),
    ) {}
f! e(x: fn(u8, (u8, u8)), &(y, z): &(u8, u8)) {}"
            .replace("f!", "fn");
        assert_eq!(functions(&text), [(6, "d"), (10, "e")]);
    }

    #[test]
    fn a_file_that_takes_none_apart_is_not_listed() {
        let problems = |path: &str, parameters: &str| {
            check(&Tree::of(&[(path, &format!("fn a({parameters}) {{}}"))])).len()
        };
        assert_eq!(problems("crates/stl/src/a.rs", "(x, y): (u8, u8)"), 1);
        assert_eq!(problems(LEFT[0], "(x, y): (u8, u8)"), 0);
        assert_eq!(problems(LEFT[0], "x: u8, y: u8"), 1);
    }
}
